"""``socialbot calibrate``: find the pose of a camera above the floor from its transforms or the people in view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from rich.console import Console

from socialbot.cli._options import many

if TYPE_CHECKING:
    import numpy as np

    from socialbot.core.messages import CameraInfo
    from socialbot.vision.camera import CameraPose

_STEADY_M, _STEADY_RAD = 0.02, 0.01  # A pose that changes more is that of a camera that moves.


PANEL = "Bags, cameras and scores"
EXAMPLES = (
    "socialbot calibrate my_bag",
    "socialbot calibrate 0",
)


class _View(NamedTuple):
    """Image with its stamp (ns), the intrinsics, and the pose of the camera by transforms, if known."""

    image: np.ndarray
    stamp: int
    info: CameraInfo | None = None
    pose: CameraPose | None = None


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
        pose = None
        if encoded.sensors is not None and isinstance(encoded.content, (Image, CompressedImage)):
            pose = encoded.sensors.camera_pose(encoded.content.frame_id, encoded.stamp)
        yield _View(image, encoded.stamp, encoded.info, pose)


def _camera_views(device: str, seconds: float) -> Iterator[_View]:
    """Read images of a camera for ``seconds``. Raises DeviceError without the camera."""
    from socialbot.core.clock import nanoseconds
    from socialbot.vision.camera_node import open_frames

    begun = monotonic()
    with closing(open_frames(device)) as frames:
        while (passed := monotonic() - begun) < seconds and (image := frames.read()) is not None:
            yield _View(image, nanoseconds(passed))


def calibrate(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="Bag, or a camera: its index or device file.")],
    image_topic: Annotated[str | None, typer.Option(help="Image topic, when the bag has several.")] = None,
    hfov_rad: Annotated[float, typer.Option(min=0.1, max=3.0, help="Field of view without a camera_info.")] = 1.09,
    seconds: Annotated[float, typer.Option(min=1.0, help="How long to watch a camera.")] = 60.0,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the pose file.")] = None,
) -> None:
    """Find height and pitch of a camera, live or of a bag, from transforms, or else from the people in view.

    The intrinsics come from camera_info. The person detector takes the result by its parameters, or reads the file that
    its parameter camera_file names. A file NAME.camera.json beside a bag is used by replay and evaluate.
    """
    from socialbot.core.errors import BagError
    from socialbot.vision.camera import ASSUMED, CameraModel
    from socialbot.vision.camera_node import is_device
    from socialbot.vision.camera_pose import save_pose
    from socialbot.vision.detectors import DETECTORS, DetectorSettings
    from socialbot.vision.pipeline import PersonPipeline

    console = Console(highlight=False)
    if is_device(source):
        console.print(f"watching camera {source} for {seconds:g} s: walk through its view, from head to feet")
    views = _camera_views(source, seconds) if is_device(source) else _bag_views(Path(source), image_topic)
    spec = DETECTORS["nanodet"]
    pipeline = PersonPipeline(spec, spec.make(DetectorSettings()), hide_still=False)
    frames, calibrated = 0, False
    placed: list[CameraPose] = []
    for view in views:
        height, width = view.image.shape[:2]
        frames, calibrated = frames + 1, view.info is not None
        if view.pose is not None and not view.pose.height_std_m:
            placed.append(view.pose)
        else:
            pose = view.pose or ASSUMED
            camera = CameraModel.of_images(view.info, width, height, hfov_rad=hfov_rad, pose=pose)
            pipeline.find(view.image, view.stamp, camera)
    if placed:
        _show_placed(console, placed, frames, source, save)
        return
    pose = pipeline.pose
    if not pose.people:
        raise BagError(
            f"nobody is wholly visible in {many(frames, 'image')}",
            where=source,
            remedy="record people who walk through the view from head to feet, at several distances",
        )
    console.print(f"height  {pose.height_m:.2f} +- {pose.height_std_m:.2f} m above the floor")
    console.print(f"pitch   {pose.pitch_rad:.3f} +- {pose.pitch_std_rad:.3f} rad down")
    console.print(f"source  people: {pose.people} tracks of people in {many(frames, 'image')}")
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
