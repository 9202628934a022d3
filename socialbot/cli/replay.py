"""``socialbot replay``: replay a bag through a graph."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from socialbot.cli import _options as options
from socialbot.cli._console import Console, print_line
from socialbot.graph.node import Graph

PANEL = "Run a graph"
EXAMPLES = (
    "socialbot replay data/synthetic/corridor",
    "socialbot replay my_bag --runner ros --inspect",
    "socialbot replay my_bag --graph my_graph.yaml --set person_detector.detector=hog",
)


def replay_bag(
    context: typer.Context,
    bag: Path,
    graph: Graph,
    runner: options.RunnerOption = "inline",
    composed: options.ComposedOption = False,
    domain: options.DomainOption = None,
    image_topic: Annotated[str | None, typer.Option(help="Image topic, when the bag has several.")] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="Speed; 1 is as recorded (ros).")] = 1.0,
    pace: Annotated[bool, typer.Option(help="Wait for slow nodes instead of skipping frames (ros).")] = True,
    truth: Annotated[Path | None, typer.Option(help="Ground truth; default: BAG.truth.json if it exists.")] = None,
    out: options.OutOption = None,
    cache: Annotated[
        bool, typer.Option(help="Reuse cached detections of this bag, and cache new ones (inline).")
    ] = True,
    privacy: Annotated[
        Literal["none", "blur", "no-images"],
        typer.Option(help="Pictures in the record: unchanged, with people blurred, or removed."),
    ] = "none",
    video: Annotated[bool, typer.Option(help="Write the annotated video.")] = True,
    show_page: options.InspectOption = False,
    port: options.PortOption = options.PORT,
    changes: options.SetOption = None,
    labels: options.LabelOption = None,
    verbose: options.VerboseOption = False,
) -> None:
    """Replay a bag through ``graph``, with the options of ``socialbot replay``."""
    from socialbot.bags.playback import takes_images
    from socialbot.bags.reader import open_bag
    from socialbot.cli._runs import ROS_OPTIONS, enter_domain, print_dialogue, print_outcome, write_page
    from socialbot.cli.inspect import watched
    from socialbot.core.errors import SocialbotError
    from socialbot.graph.files import with_changes
    from socialbot.runs.bag_images import write_video
    from socialbot.runs.console import Display
    from socialbot.runs.heard_sounds import write_heard
    from socialbot.runs.record import VIDEO, RunRecord
    from socialbot.runtime.bag_source import BagSource, find_truth
    from socialbot.runtime.perception_cache import PerceptionCache
    from socialbot.runtime.run import new_run_folder, run

    console = Console()
    enter_domain(context, console, domain, runner, (*ROS_OPTIONS, "rate"), verbose=verbose)
    if cache and runner == "ros":
        options.expect_effect(context, ("cache",), "with --runner ros")
    if not show_page:
        options.expect_effect(context, ("port",), "without --inspect")
    whole = with_changes(graph, changes or [])
    takes_images = takes_images(whole.without_sources())
    title, folder = f"{whole.name.capitalize()}: replay of {bag}", out or new_run_folder()
    with open_bag(bag) as opened:
        chosen = image_topic or _ask_image_topic(opened.preferred_image_topics if takes_images else ())
        kept = PerceptionCache() if cache and runner == "inline" else None
        source = BagSource(opened, chosen, rate, pace, find_truth(opened, truth), kept)
        topic = opened.choose_image_topic(chosen).name if takes_images else None
        with RunRecord(folder, labels=options.labels_of(labels)) as record:
            record.privacy = privacy
            if show_page:
                images = None if topic is None else (bag, topic)
                context.with_resource(watched(record, whole, console, port, over_ros=runner == "ros", bag=images))
            shown = Display(console, whole.without_sources(), start=opened.start, until=opened.end, details=verbose)
            with shown as display:
                try:
                    result = run(whole, source, record, display.show, runner=runner, composed=composed)
                except SocialbotError:
                    write_page(console, record, title)
                    raise
            if record.privacy == "none":
                write_heard(opened, folder)
            video = video and privacy != "no-images"
            if video and topic is not None and record.detections and not _is_without_images(bag):
                with options.bar("writing annotated.mp4", "images", opened.topic(topic).count) as advance:
                    write_video(opened, topic, record, source.truth, folder / VIDEO, advance, blur=privacy == "blur")
    print_outcome(console, result)
    print_dialogue(console, record.folder)
    write_page(console, record, title)
    result.check()


def _opened(bag: options.BagArgument, graph: options.BagGraphOption = None) -> tuple[Path, Graph]:
    """Replay a bag through a graph; show, record and score the run."""
    from socialbot.graph.files import load_graph
    from socialbot.runtime.bag_source import BAG_GRAPH, graph_of

    if graph:
        return bag, load_graph(graph)
    chosen = graph_of(bag)
    if bag.exists() and not (bag / BAG_GRAPH).is_file():
        print_line(f"{bag} has no graph of its own: it goes through {chosen.name} (--graph GRAPH: another)", err=True)
    return bag, chosen


replay = options.command_of(_opened, ("bag", "graph"), replay_bag)


def _is_without_images(bag: Path) -> bool:
    """Whether the images of a bag are redacted and have no pixels."""
    from socialbot.runtime.perception_cache import is_redacted
    from socialbot.runtime.redaction import has_pixels

    return is_redacted(bag) and not has_pixels(bag)


def _ask_image_topic(names: Sequence[str]) -> str | None:
    """Ask on a terminal which of several image topics to use."""
    if len(names) < 2 or not sys.stdin.isatty():
        return None
    for number, name in enumerate(names, 1):
        print_line(f"  {number}  {name}")
    answer: int = typer.prompt("Topic of the images", type=int, default=1)
    return names[answer - 1] if 1 <= answer <= len(names) else None
