"""The commands ``socialbot bag``: show, make, record, convert and play bags."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.markup import escape
from rich.table import Table

from socialbot.bags import codec
from socialbot.cli._console import Console, print_line
from socialbot.cli._options import BagArgument, CameraInfoOption, ParentOption, bar, expect_effect, many, plain_table
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, ImageError, ParameterError
from socialbot.core.messages import CompressedImage, Image
from socialbot.core.process import Ending

if TYPE_CHECKING:
    from socialbot.bags.reader import Bag, BagTopic
    from socialbot.runtime.redaction import Privacy, Redaction

PANEL = "Bags, cameras and scores"
EXAMPLES = (
    "socialbot bag info my_bag",
    "socialbot bag import corridor.mp4 my_bag",
    "socialbot bag record my_bag",
)
bag = typer.Typer(add_completion=False, help="Inspect, make, record, convert and play bags.", no_args_is_help=True)

OutArgument = Annotated[Path, typer.Argument(help="New bag folder.")]
StorageOption = Annotated[str, typer.Option(help="mcap or sqlite3.")]
DurationOption = Annotated[float | None, typer.Option(metavar="SECONDS", help="Time limit.")]


@bag.command()
def play(
    context: typer.Context,
    path: BagArgument,
    graph: Annotated[str | None, typer.Option(help="Graph to wait for; its topics get the messages.")] = None,
    image_topic: Annotated[str | None, typer.Option(help="Image topic of the bag for the graph.")] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="Speed; 1 is as recorded.")] = 1.0,
    pace: Annotated[bool, typer.Option(help="Wait until slow nodes have processed each image.")] = True,
    report: Annotated[Path | None, typer.Option(hidden=True, help="Write the result as JSON.")] = None,
    parent: ParentOption = None,
) -> None:
    """Play a bag into ROS, with /clock; without --graph, every topic under its own name."""
    import msgspec

    from socialbot.bags.playback import feeding
    from socialbot.bags.reader import open_bag
    from socialbot.bridge.player import PlaybackOptions, play_bag
    from socialbot.graph.files import load_graph

    if graph is None:
        expect_effect(context, ("image_topic", "pace") if pace else ("image_topic",), "without --graph")
    with open_bag(path) as opened:
        if graph is None:
            topics = {topic.name: topic.name for topic in opened.topics if topic.count}
            playing = PlaybackOptions(rate=rate, tail_s=0.0)
        else:
            loaded = load_graph(graph).without_sources()
            topics = feeding(opened, loaded, image_topic)
            playing = PlaybackOptions(rate=rate, await_graph=loaded, paced=pace)
        played = play_bag(opened, topics, playing, parent=parent)
    if report is not None:
        report.write_bytes(msgspec.json.encode(played))
    print_line(f"played {many(played.sent, 'message')}; images not answered in time: {played.unanswered}")


_YEAR_2000 = 946_684_800 * SECOND


@bag.command()
def info(
    path: BagArgument,
    quick: Annotated[bool, typer.Option("--quick", help="Skip a slow check: the search for damaged messages.")] = False,
) -> None:
    """Show the topics of a bag, and any damage."""
    from socialbot.bags.reader import IMAGE_TYPES, open_bag

    console = Console()
    with open_bag(path) as opened:
        images = {
            topic.name: _picture(opened, topic) for topic in opened.topics if topic.type in IMAGE_TYPES and topic.count
        }
        break_off = None
        try:
            if not quick:
                opened.check()
        except BagError as error:
            break_off = error
        # Imported bags have no meaningful start time.
        began = datetime.fromtimestamp(opened.start / SECOND, timezone.utc)
        since = f", from {began:%Y-%m-%d %H:%M:%S} UTC" if opened.start > _YEAR_2000 else ""
        count = sum(topic.count for topic in opened.topics)
        console.print(
            f"[bold]{escape(opened.path.name)}[/]  {opened.duration_s:.1f} s, {many(count, 'message')}{since}"
        )
        console.print(_table(opened, images, checked=not quick))
        for topic, skipped in sorted(opened.skipped.items()):
            console.print(f"[red]{escape(topic)}[/]: {skipped.count} damaged, first: {escape(skipped.first)}")
        for what in opened.damage:
            console.print(f"[red]incomplete[/]: {escape(what)}")
    if break_off is not None:
        raise break_off


@bag.command(name="import")
def import_(
    context: typer.Context,
    source: Annotated[str, typer.Argument(help="Video file, folder of images, or camera (0, /dev/video0).")],
    out: OutArgument,
    image_rate: Annotated[float, typer.Option(help="Image rate of a folder, Hz.")] = 10.0,
    start: Annotated[float, typer.Option(help="Stamp of the first image, s; not for a camera.")] = 1.0,
    hfov: Annotated[
        float | None, typer.Option(help="Horizontal field of view, degrees; default: 60 along the longer side.")
    ] = None,
    camera_info: CameraInfoOption = None,
    quality: Annotated[int, typer.Option(help="JPEG quality, 1 to 100.")] = 90,
    width: Annotated[int | None, typer.Option(help="Scale images to this width, pixels.")] = None,
    topic: Annotated[str, typer.Option(help="Topic of the images.")] = "/camera/image_raw/compressed",
    sound: Annotated[bool, typer.Option(help="Keep the sound of a video, on /audio.")] = True,
    duration: DurationOption = None,
) -> None:
    """Make a bag from a video, a folder of images or a camera. A camera is recorded until Ctrl-C."""
    from socialbot.bags.conversion import import_bag
    from socialbot.vision.camera import read_calibration, scaled_info, shape_problem, size_problem
    from socialbot.vision.camera_node import is_device, open_frames

    if is_device(source):
        expect_effect(context, ("image_rate", "start", "sound") if sound else ("image_rate", "start"), "for a camera")
    elif not Path(source).is_dir():
        expect_effect(context, ("image_rate",), "for a video, which has time stamps")
    calibration = None
    if camera_info is not None:
        expect_effect(context, ("hfov",), "with --camera-info")
        calibration = read_calibration(camera_info)
    with Ending().on_signals() as ending, bar(f"writing {out}", "images") as advance:
        made = import_bag(
            source,
            out,
            camera=open_frames(source) if is_device(source) else None,
            rate_hz=image_rate,
            start=round(start * SECOND),
            hfov_deg=hfov,
            camera_info=functools.partial(scaled_info, calibration) if calibration else None,
            jpeg_quality=quality,
            topic=topic,
            limit_s=duration,
            width=width,
            sound=sound,
            stopped=lambda: ending.asked,
            advance=advance,
        )
    size = f"{made.width}x{made.height}"
    sound_text = f", {made.sound_s:.1f} s of sound" if made.sound_s else ""
    sound_text += f", {many(made.depths, 'depth image')}" if made.depths else ""
    text = f"{many(made.images, 'image')} of {size}, {made.duration_s:.1f} s{sound_text}, in {made.path}"
    Console().print(text)
    problem = "" if hfov is not None else shape_problem(made.width, made.height)
    if calibration is not None:
        problem = size_problem(calibration, made.width, made.height)
    if problem:
        Console(stderr=True).print_plain(f"warning: {problem}")


@bag.command()
def record(
    context: typer.Context,
    out: OutArgument,
    topics: Annotated[list[str] | None, typer.Option(help="Topic, repeatable; default: all.")] = None,
    duration: DurationOption = None,
    storage: StorageOption = "mcap",
    privacy: Annotated[
        Literal["none", "blur", "no-images"],
        typer.Option(help="Pictures: unchanged, with people blurred, or removed, after the recording."),
    ] = "none",
    graph: Annotated[str | None, typer.Option(help="Graph whose detections are stored with --privacy.")] = None,
) -> None:
    """Record ROS topics, until Ctrl-C or for a duration."""
    from socialbot.bridge import recorder

    if privacy == "none":
        expect_effect(context, ("graph",), "without --privacy")
    console = Console()
    target = out if privacy == "none" else out.with_name(f"{out.name}.original")
    if target != out and out.exists():
        raise BagError("already exists", where=str(out), remedy="give another name, or remove it first")
    with Ending().on_signals() as ending:
        console.print(f"recording to {out}; Ctrl-C ends it")
        made = recorder.record(
            target, topics=topics or (), duration_s=duration, storage=storage, stopped=lambda: ending.asked
        )
    if privacy != "none":
        _redact_recording(console, target, out, privacy, graph, storage)
    for topic, count in sorted(made.counts.items()):
        console.print(f"{count:7d}  {topic}", markup=False)
    for topic, why in made.refused.items():
        console.print(f"[yellow]not recorded[/]: {escape(topic)}: {escape(why)}")
    for topic in sorted({name.lstrip("/") for name in topics or ()} - {name.lstrip("/") for name in made.counts}):
        console.print(f"[yellow]no messages on[/] /{escape(topic)}")
    console.print(f"{many(sum(made.counts.values()), 'message')} in {made.duration_s:.1f} s")


def _redact_recording(
    console: Console, original: Path, out: Path, privacy: Privacy, graph: str | None, storage: str
) -> None:
    """Redact a recording, and remove the original."""
    import shutil

    from socialbot.runtime.redaction import has_pictures
    from socialbot.runtime.redaction import redact as make

    if not has_pictures(original):
        original.rename(out)
        return
    try:
        with bar("redacting", "images") as advance:
            made = make(original, out, privacy, graph=graph, storage=storage, advance=advance)
    except BagError as error:
        remedy = f"it is still in {original}: remove it, or redact it with `socialbot bag redact`"
        raise BagError(f"the recording is not redacted: {error.what}", where=str(original), remedy=remedy) from error
    shutil.rmtree(original)
    _print_redaction(console, made)


@bag.command()
def convert(
    source: BagArgument,
    out: OutArgument,
    wire: Annotated[
        Literal["json", "typed"] | None,
        typer.Option(help="Structured messages: json: text in std_msgs/String; typed: socialbot_msgs."),
    ] = None,
    decode: Annotated[
        bool, typer.Option("--decode", help="Images in place of video packets and images of Foxglove.")
    ] = False,
    storage: StorageOption = "mcap",
) -> None:
    """Convert the structured messages of a bag to JSON or to their own ROS types, or decode its video."""
    from socialbot.bags.conversion import convert_bag

    if wire is None and not decode:
        raise ParameterError("nothing to convert", where="bag convert", remedy="give --wire or --decode")

    console = Console()
    with console.status(f"writing {out}"):
        made = convert_bag(source, out, wire, decode=decode, storage=storage)
    for topic, kept in sorted(made.kept.items()):
        console.print(f"[yellow]as before[/]: {escape(topic)}: {kept.count}, first: {escape(kept.first)}")
    for topic, skipped in sorted(made.skipped.items()):
        console.print(f"[red]{escape(topic)}[/]: {skipped.count} damaged, left out, first: {escape(skipped.first)}")
    form = " or ".join(filter(None, (wire, "images" if decode else "")))
    console.print(f"{many(made.messages, 'message')} in {made.path}, {made.converted} of them now {form}")


@bag.command()
def redact(
    context: typer.Context,
    source: BagArgument,
    out: OutArgument,
    privacy: Annotated[
        Literal["blur", "no-images"],
        typer.Option(
            help="Pictures: with people blurred, or removed; then images and point clouds keep their headers."
        ),
    ] = "blur",
    whole: Annotated[bool, typer.Option("--whole", help="Blur whole people instead of their heads.")] = False,
    graph: Annotated[
        str | None,
        typer.Option(help="Graph whose detections are stored for replays; default: the bag's own, or waldo."),
    ] = None,
    storage: StorageOption = "mcap",
) -> None:
    """Copy a bag without recognisable pictures of people; replays of it make the same decisions.

    All other messages are copied byte for byte. docs/privacy.md lists the remaining inferences.
    """
    from socialbot.runtime.redaction import redact as make

    if privacy == "no-images":
        expect_effect(context, ("whole",), "with --privacy no-images")
    with bar("redacting", "images") as advance:
        made = make(source, out, privacy, whole=whole, graph=graph, storage=storage, advance=advance)
    _print_redaction(Console(soft_wrap=True), made)


def _print_redaction(console: Console, made: Redaction) -> None:
    """Print the changed and the unchanged parts of a bag."""
    for topic, count in sorted(made.images.items()):
        console.print(f"blurred: {many(count, 'image')} of {topic}", markup=False)
    for topic, count in sorted(made.emptied.items()):
        reason = " that cannot be decoded" if topic in made.unreadable else ""
        console.print(f"emptied: {many(count, 'message')} of {topic}{reason}", markup=False)
    for topic, count in sorted(made.left_out.items()):
        console.print(f"left out: {many(count, 'message')} of {topic}: their pictures cannot be redacted", markup=False)
    for topic, kind in sorted(made.unknown.items()):
        console.print(f"[yellow]kept[/]: {escape(topic)}: {escape(kind)} is unknown and may hold pictures")
    for topic in made.depth:
        console.print(f"[yellow]kept[/]: {escape(topic)}: depth shows shapes of people; --privacy no-images removes it")
    if made.perception == "recorded":
        console.print("stored for replays: the detections, in seen.percepts")
    else:
        console.print(f"[yellow]not stored[/]: detections for replays: {escape(made.perception)}")
    if made.files:
        console.print(f"copied: {', '.join(made.files)}", markup=False)
    console.print(f"{made.kept} messages are the same, byte for byte; the new bag: {made.path}", markup=False)


def _table(opened: Bag, images: Mapping[str, str], *, checked: bool) -> Table:
    table = plain_table("topic", "type", right=("count", "Hz", "damaged") if checked else ("count", "Hz"))
    table.add_column("image", overflow="fold")
    table.padding = (0, 1, 0, 0)
    for topic in opened.topics:
        # Short names of known types keep the line within 80 characters.
        known = topic.type in codec.decodable_types()
        kind = escape(topic.type.rpartition("/")[2] if known else topic.type.replace("/msg/", "/"))
        rate = opened.rate_hz(topic)
        cells = [f"[bold]{escape(topic.name)}[/]", kind, str(topic.count), "" if rate is None else f"{rate:.1f}"]
        if checked:
            skipped = opened.skipped.get(topic.name)
            cells.append(f"[red]{skipped.count}[/]" if skipped else "0")
        table.add_row(*cells, escape(images.get(topic.name, "")))
    return table


def _picture(opened: Bag, topic: BagTopic) -> str:
    """Return the size and encoding of the first intact image."""
    from socialbot.bags.image_files import decode_image

    try:
        for _, message in opened.messages({topic.name: topic.name}):
            if isinstance(message, Image):
                return f"{message.width}x{message.height} {message.encoding}"
            if isinstance(message, CompressedImage):
                # Depth has a header of 12 bytes before its PNG.
                data = message.data[12:] if "compresseddepth" in message.format.lower() else message.data
                try:
                    pixels = decode_image(data.tobytes(), where=topic.name)
                    size = f"{pixels.shape[1]}x{pixels.shape[0]}"
                except ImageError:
                    size = "unreadable"
                # Drivers write ``jpeg`` or ``bgr8; jpeg compressed bgr8``.
                name = message.format
                known = (kind for kind in ("jpeg", "png") if kind in name or kind.replace("e", "") in name)
                return f"{size} {next(known, name)}"
    except BagError:
        pass
    return ""
