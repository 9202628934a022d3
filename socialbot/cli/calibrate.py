"""``socialbot calibrate``: find the pose of a camera above the floor from its transforms or the people in view."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import CameraInfoOption, expect_effect, many

if TYPE_CHECKING:
    import numpy as np

    from socialbot.core.messages import CameraInfo
    from socialbot.vision.camera import CameraPose
    from socialbot.vision.depth_sensors import DepthSensors

_STEADY_M, _STEADY_RAD = 0.02, 0.01  # A pose that changes more is that of a camera that moves.
_WAIT_S = 10.0  # Time limit for the publisher of a topic.


PANEL = "Bags, cameras and scores"
EXAMPLES = (
    "socialbot calibrate my_bag",
    "socialbot calibrate 0",
)


class _View(NamedTuple):
    """Image with its stamp (ns), the intrinsics, and depth and transforms at that time, if known."""

    image: np.ndarray
    stamp: int
    info: CameraInfo | None = None
    frame_id: str = ""
    sensors: DepthSensors | None = None


def _bag_views(bag: Path, image_topic: str | None) -> Iterator[_View]:
    """Read the images of a bag; damaged ones are skipped. Raises BagError for an unreadable bag."""
    from socialbot.bags.reader import open_bag
    from socialbot.core.errors import ImageError
    from socialbot.core.messages import CompressedImage, Image
    from socialbot.vision.metrics.frames import BagImages

    with open_bag(bag) as opened:
        topic = opened.choose_image_topic(image_topic).name
    for encoded in BagImages(str(bag), topic).read():
        try:
            image = encoded.bgr()
        except ImageError:
            continue
        frame_id = encoded.content.frame_id if isinstance(encoded.content, (Image, CompressedImage)) else ""
        yield _View(image, encoded.stamp, encoded.info, frame_id, encoded.sensors)


def _topic_views(topic: str, seconds: float) -> Generator[_View]:
    """Read images of a ROS topic for ``seconds``, with the camera_info, depth and transforms of the running graph.

    Raises:
        GraphError: No topic can have this name, or nobody publishes it.
        ParameterError: It has no images.
    """
    from socialbot.bags.cameras import ImageKind, best_depth, camera_info_of, image_kind, is_rectified, transform_topics
    from socialbot.bags.codec import ROS_TYPES, decodable_types
    from socialbot.bridge.topics import await_publisher, merged_messages, observer_node, settled_topics
    from socialbot.core.errors import ImageError, ParameterError
    from socialbot.core.messages import (
        CameraInfo,
        CompressedDepth,
        CompressedImage,
        DepthImage,
        DepthInfo,
        Image,
        Message,
        Transforms,
    )
    from socialbot.graph.node import check_topic
    from socialbot.vision.camera import without_lens
    from socialbot.vision.depth_sensors import DepthSensors
    from socialbot.vision.images import bgr_from_compressed, bgr_from_image

    check_topic(topic, "SOURCE is no file")
    with observer_node("_calibrate") as ros:
        kind = decodable_types().get(await_publisher(ros, topic, timeout_s=_WAIT_S) or "")
        if kind not in (Image, CompressedImage) or image_kind(topic, None) >= ImageKind.DEPTH:
            remedy = "name a topic of sensor_msgs/Image or CompressedImage; socialbot topic list shows all"
            raise ParameterError("has no pictures", where=topic, remedy=remedy)
        types = {each.name: each.types[0] for each in settled_topics(ros)}
        topics: dict[str, type[Message]] = {topic: kind}
        trees = [name for name, type in types.items() if type == ROS_TYPES[Transforms]]
        topics |= dict.fromkeys(transform_topics(topic, trees), Transforms)
        depths = {
            name: DepthImage if types[name] == ROS_TYPES[DepthImage] else CompressedDepth
            for name in types
            if types[name] in (ROS_TYPES[DepthImage], ROS_TYPES[CompressedDepth])
            and image_kind(name, None) == ImageKind.DEPTH
        }
        infos = [name for name in types if types[name] == ROS_TYPES[CameraInfo]]
        images = [name for name in types if decodable_types().get(types[name]) in (Image, CompressedImage)]
        depth = best_depth(topic, "", dict.fromkeys(depths, ""))
        if depth is not None:
            topics[depth] = depths[depth]
            if depth_info := camera_info_of(depth, infos, images, lambda _: ""):
                topics[depth_info] = DepthInfo
        if info_topic := camera_info_of(topic, infos, images, lambda _: ""):
            topics[info_topic] = CameraInfo
        sensors, info, begun = DepthSensors(), None, monotonic()
        for arrived in merged_messages(ros, topics, newest=[topic], ended=lambda: monotonic() - begun > seconds):
            name, message = arrived or ("", None)
            if isinstance(message, CameraInfo) and not isinstance(message, DepthInfo):
                info = without_lens(message) if is_rectified(topic) else message
            elif name == topic and isinstance(message, (Image, CompressedImage)):
                try:
                    image = bgr_from_image(message) if isinstance(message, Image) else bgr_from_compressed(message)
                except ImageError:
                    continue
                yield _View(image, message.stamp, info, message.frame_id, sensors)
            elif message is not None:
                sensors.take(message)


def _camera_views(device: str, seconds: float) -> Iterator[_View]:
    """Read images of a camera for ``seconds``. Raises DeviceError without the camera."""
    from socialbot.core.clock import nanoseconds
    from socialbot.vision.camera_node import open_frames

    begun = monotonic()
    with closing(open_frames(device)) as frames:
        while (passed := monotonic() - begun) < seconds and (image := frames.read()) is not None:
            yield _View(image, nanoseconds(passed))


def calibrate(
    context: typer.Context,
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="Bag, camera (its index or device file), or live ROS image topic.")
    ],
    image_topic: Annotated[str | None, typer.Option(help="Image topic, when the bag has several.")] = None,
    hfov_rad: Annotated[float, typer.Option(min=0.1, max=3.0, help="Field of view without a camera_info.")] = 1.09,
    camera_info: CameraInfoOption = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="How long to watch a camera or topic.")] = 60.0,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the pose file.")] = None,
) -> None:
    """Find height and pitch of a camera, live or of a bag, from transforms, or else from people and the floor in depth.

    The intrinsics come from camera_info. The person detector takes the result by its parameters, or reads the file that
    its parameter camera_file names. A file NAME.camera.json beside a bag is used by replay and evaluate.
    """
    from socialbot.core.errors import BagError, DeviceError
    from socialbot.vision.camera import ASSUMED, CameraModel, calibrated_info, read_calibration
    from socialbot.vision.camera_node import is_device
    from socialbot.vision.camera_pose import save_pose
    from socialbot.vision.detectors import DETECTORS, DetectorSettings
    from socialbot.vision.pipeline import PersonPipeline

    console = Console()
    live = is_device(source) or (source.startswith("/") and not Path(source).exists())
    expect_effect(context, ("image_topic",) if live else ("seconds",), f"for a {'camera or topic' if live else 'bag'}")
    if live:
        what = f"camera {source}" if is_device(source) else source
        console.print(f"watching {what} for {seconds:g} s: walk through its view, from head to feet", soft_wrap=True)
    if is_device(source):
        views = _camera_views(source, seconds)
    else:
        views = _topic_views(source, seconds) if live else _bag_views(Path(source), image_topic)
    spec = DETECTORS["nanodet"]
    pipeline = PersonPipeline(spec, spec.make(DetectorSettings()), hide_still=False)
    if camera_info is not None:
        expect_effect(context, ("hfov_rad",), "with --camera-info")
    given = read_calibration(camera_info) if camera_info is not None else None
    frames, calibrated = 0, False
    placed: list[CameraPose] = []
    for view in views:
        height, width = view.image.shape[:2]
        info = calibrated_info(view.info, given)
        frames, calibrated = frames + 1, info is not None
        known = view.sensors and view.sensors.camera_pose(view.frame_id, view.stamp)
        if known is not None and not known.height_std_m:
            placed.append(known)
        else:
            camera = CameraModel.of_images(info, width, height, hfov_rad=hfov_rad, pose=known or ASSUMED)
            depth = view.sensors.at(view.stamp, view.frame_id, camera) if view.sensors is not None else ()
            pipeline.find(view.image, view.stamp, camera, depth)
    if placed:
        _show_placed(console, placed, frames, source, save)
        return
    pose = pipeline.pose
    if not pose.people and pose.source != "floor":
        fault = DeviceError if live else BagError
        remedy = "people must walk through the view from head to feet, at several distances"
        raise fault(f"nobody is wholly visible in {many(frames, 'image')}", where=source, remedy=remedy)
    console.print(f"height  {pose.height_m:.2f} +- {pose.height_std_m:.2f} m above the floor")
    console.print(f"pitch   {pose.pitch_rad:.3f} +- {pose.pitch_std_rad:.3f} rad down")
    floor = "depth of the floor" if pipeline.sees_floor else ""
    people = f"people: {many(pose.people, 'track')} of people in {many(frames, 'image')}" if pose.people else ""
    console.print(f"source  {' and '.join(filter(None, (people, floor)))}")
    if not calibrated:
        console.print(f"[yellow]no camera_info[/]: a field of view of {hfov_rad:.2f} rad is assumed (--hfov-rad)")
    settings = f"--set person_detector.mount_height_m={pose.height_m:.2f}"
    console.print(f"use     {settings} --set person_detector.pitch_rad={pose.pitch_rad:.3f}", soft_wrap=True)
    if save is not None:
        save_pose(pose, save)
        console.print(f"file    {save}; or: --set person_detector.camera_file={save}", soft_wrap=True)


def _show_placed(console: Console, poses: Sequence[CameraPose], frames: int, source: str, save: Path | None) -> None:
    """Show the poses of the transforms, and save that of a camera that does not move."""
    from socialbot.core.errors import BagError
    from socialbot.vision.camera_pose import save_pose

    heights, pitches = [each.height_m for each in poses], [each.pitch_rad for each in poses]
    moves = max(heights) - min(heights) > _STEADY_M or max(pitches) - min(pitches) > _STEADY_RAD
    pose = poses[len(poses) // 2]
    if moves:
        console.print(f"height  {min(heights):.2f} to {max(heights):.2f} m above the floor: the camera moves")
        console.print(f"pitch   {min(pitches):.3f} to {max(pitches):.3f} rad down")
    else:
        console.print(f"height  {pose.height_m:.2f} m above the floor")
        console.print(f"pitch   {pose.pitch_rad:.3f} rad down")
    console.print(f"source  transforms, in {len(poses)} of {many(frames, 'image')}")
    console.print("use     no settings: the person detector takes the pose from /tf and /tf_static")
    if save is not None and moves:
        raise BagError("the camera moves, so it has no fixed pose", where=source, remedy="omit --save")
    if save is not None:
        save_pose(pose, save)
        console.print(f"file    {save}; or: --set person_detector.camera_file={save}", soft_wrap=True)
