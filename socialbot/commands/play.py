"""``socialbot bag play``: a bag into a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def play(
    bag: Annotated[Path, typer.Argument(help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag.")],
    graph: Annotated[str | None, typer.Option(help="Feed this graph: wait for it, and use its topics.")] = None,
    image_topic: Annotated[str | None, typer.Option(help="The pictures to feed the graph with.")] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="1 is as recorded.")] = 1.0,
    pace: Annotated[bool, typer.Option(help="Wait for the graph's answer to each picture.")] = True,
    report: Annotated[Path | None, typer.Option(hidden=True, help="Write here, as JSON, how it went.")] = None,
    parent: Annotated[int | None, typer.Option(hidden=True)] = None,
) -> None:
    """Play a bag into ROS, with /clock. Without --graph: every topic, under its own name."""
    import msgspec

    from socialbot.bridge.bags import open_bag
    from socialbot.bridge.feeding import feeding
    from socialbot.bridge.player import Playing, play_bag
    from socialbot.graph_file import load_graph

    with open_bag(bag) as opened:
        if graph is None:
            topics = {topic.name: topic.name for topic in opened.topics if topic.count}
            playing = Playing(rate=rate, tail_s=0.0)
        else:
            loaded = load_graph(graph).without_sources()
            topics = feeding(opened, loaded, image_topic)
            playing = Playing(rate=rate, await_graph=loaded, paced=pace)
        played = play_bag(opened, topics, playing, parent=parent)
    if report is not None:
        report.write_bytes(msgspec.json.encode(played))
    typer.echo(f"played {played.sent} messages, {played.unanswered} pictures were not answered in time")
