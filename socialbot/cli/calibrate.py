"""``socialbot calibrate``: find the pose of a camera above the floor from the people in its images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from socialbot.cli._options import BagArgument, many


def calibrate(
    bag: BagArgument,
    image_topic: Annotated[str | None, typer.Option(help="Image topic, when the bag has several.")] = None,
    hfov_rad: Annotated[float, typer.Option(min=0.1, max=3.0, help="Field of view without a camera_info.")] = 1.09,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the pose file.")] = None,
) -> None:
    """Find height and pitch of the camera of a bag from the people in view.

    The intrinsics come from camera_info. The person detector takes the result by its parameters, or reads the file that
    its parameter camera_file names. A file NAME.camera.json beside a bag is used by replay and evaluate.
    """
    from socialbot.bags.reader import open_bag
    from socialbot.core.errors import BagError, ImageError
    from socialbot.vision.camera import ASSUMED, CameraModel
    from socialbot.vision.camera_pose import save_pose
    from socialbot.vision.detectors import DETECTORS, DetectorSettings
    from socialbot.vision.metrics.frames import BagImages
    from socialbot.vision.pipeline import PersonPipeline

    console = Console(highlight=False)
    with open_bag(bag) as opened:
        topic = opened.choose_image_topic(image_topic).name
    spec = DETECTORS["nanodet"]
    pipeline = PersonPipeline(spec, spec.make(DetectorSettings()), hide_still=False)
    frames, calibrated = 0, False
    for encoded in BagImages(str(bag), topic).read():
        try:
            image = encoded.bgr()
        except ImageError:
            continue
        height, width = image.shape[:2]
        camera = CameraModel.of_images(encoded.info, width, height, hfov_rad=hfov_rad, pose=ASSUMED)
        pipeline.find(image, encoded.stamp, camera)
        frames, calibrated = frames + 1, encoded.info is not None
    pose = pipeline.pose
    if not pose.people:
        raise BagError(
            f"nobody is wholly visible in {many(frames, 'image')}",
            where=str(bag),
            remedy="record people who walk through the view from head to feet, at several distances",
        )
    console.print(f"height  {pose.height_m:.2f} +- {pose.height_std_m:.2f} m above the floor")
    console.print(f"pitch   {pose.pitch_rad:.3f} +- {pose.pitch_std_rad:.3f} rad down")
    console.print(f"from    {pose.people} tracks of people in {many(frames, 'image')}")
    if not calibrated:
        console.print(f"[yellow]no camera_info[/]: a field of view of {hfov_rad:.2f} rad is assumed (--hfov-rad)")
    settings = f"--set person_detector.mount_height_m={pose.height_m:.2f}"
    console.print(f"use     {settings} --set person_detector.pitch_rad={pose.pitch_rad:.3f}", soft_wrap=True)
    if save is not None:
        save_pose(pose, save)
        console.print(f"file    {save}; or: --set person_detector.camera_file={save}", soft_wrap=True)
