"""A graph on live input, watched and recorded until it is told to end."""

from __future__ import annotations

import time
from collections.abc import Callable

from socialbot.bridge.process import Ending
from socialbot.clock import WallClock
from socialbot.display import Display
from socialbot.graph import Graph
from socialbot.replay import keep_speech, recorded_topics
from socialbot.run_record import RunRecord


def run_live(graph: Graph, record: RunRecord, *, composed: bool, display: Callable[[int], Display]) -> None:
    """Runs ``graph`` until SIGINT or SIGTERM. Raises NodeError when one of its processes fails."""
    from socialbot.bridge.launch import Launch
    from socialbot.bridge.observing import Fates, observing

    graph = keep_speech(graph, record.folder)
    with Ending().on_signals() as ending, display(WallClock().now()) as shown:

        def observe(topic: str, message: object) -> None:
            record.observe(topic, message)  # type: ignore[arg-type]
            shown.show(topic, message)  # type: ignore[arg-type]

        with (
            observing(recorded_topics(graph), observe, Fates().note),
            Launch(graph, record.folder / "log", composed=composed) as launch,
        ):
            while not ending.asked:
                launch.check()
                time.sleep(0.1)
