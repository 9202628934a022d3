"""A graph on live input, watched and recorded until it is told to end."""

from __future__ import annotations

import time
from collections.abc import Callable

from socialbot.bridge.launch import Launch
from socialbot.bridge.observing import Fates, observing
from socialbot.bridge.readiness import expect_free_names
from socialbot.clock import WallClock
from socialbot.display import Display
from socialbot.ending import Ending
from socialbot.graph import Graph
from socialbot.messages import Message
from socialbot.replay import keep_speech, recorded_topics
from socialbot.run_record import RunRecord


def run_live(graph: Graph, record: RunRecord, *, composed: bool, display: Callable[[int], Display]) -> None:
    """Runs ``graph`` until SIGINT or SIGTERM. Raises NodeError when one of its processes fails."""
    graph = keep_speech(graph, record.folder)
    with Ending().on_signals() as ending, display(WallClock().now()) as shown:

        def observe(topic: str, message: Message) -> None:
            record.observe(topic, message)
            shown.show(topic, message)

        with observing(recorded_topics(graph), observe, Fates(graph).note) as onlooker:
            expect_free_names(onlooker.ros, graph)
            with Launch(graph, record.folder / "log", composed=composed) as launch:
                while not ending.asked:
                    launch.check()
                    time.sleep(0.1)
