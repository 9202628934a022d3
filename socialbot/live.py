"""A graph on live input, watched and recorded until it is told to end."""

from __future__ import annotations

import time

from rich.console import Console

from socialbot.bridge.launch import Launch
from socialbot.bridge.observing import Fates, observing
from socialbot.bridge.readiness import expect_free_names
from socialbot.clock import WallClock
from socialbot.display import Display
from socialbot.ending import Ending
from socialbot.graph import Graph
from socialbot.messages import Message
from socialbot.replay import keep_speech, observed_topics
from socialbot.report.display import RunDisplay
from socialbot.run_record import RunRecord
from socialbot.run_report import RunReport


def run_live(graph: Graph, record: RunRecord, console: Console, *, composed: bool) -> None:
    """Runs ``graph`` until SIGINT or SIGTERM, and tells on ``console`` what happens.

    Raises NodeError when one of its processes fails.
    """
    graph = keep_speech(graph, record.folder)
    with Ending().on_signals() as ending, display_of(graph, console) as shown:

        def observe(topic: str, message: Message) -> None:
            record.observe(topic, message)
            shown.show(topic, message)

        with observing(observed_topics(graph), observe, Fates(graph).note) as onlooker:
            expect_free_names(onlooker.ros, graph)
            with Launch(graph, record.folder / "log", composed=composed) as launch:
                while not ending.asked:
                    launch.check()
                    time.sleep(0.1)


def display_of(graph: Graph, console: Console) -> Display | RunDisplay:
    """What shows a live run of ``graph``: as a story where agents deliberate, else what is perceived and done."""
    report = RunReport(graph)
    if report.deliberates:
        return RunDisplay(console, report.phrases, graph.without_sources())
    now = WallClock().now()
    return Display(console, start=now, until=now)
