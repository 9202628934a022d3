"""Waldo with two visitors: t1 stays for 12 s and is offered help, t2 leaves after 5 s."""

from __future__ import annotations

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.graph.files import parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.run import LiveRun
from socialbot.runtime.run import observed_topics
from tests.runs.runs import DETECTED, START

VISITS = {"t1": (2.0, 14.0), "t2": (20.0, 25.0)}
END_S = 30.0


def two_visitors() -> LiveRun:
    """Return the run."""
    graph = parse_graph(DETECTED, where="waldo_run.py")
    run, runner = LiveRun(graph), InlineRunner(graph, start=START)
    for topic in observed_topics(graph):
        runner.tap(topic, run.observe)
    runner.start()
    for tenth in range(int(END_S * 10)):
        persons = tuple(
            PersonDetection(x=100, y=50, w=80, h=200, score=0.9, track_id=name, distance_m=4.0, facing_rad=0.2)
            for name, (begin, end) in VISITS.items()
            if begin <= tenth / 10 < end
        )
        stamp = START + tenth * SECOND // 10
        frame = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=persons)
        runner.feed("/humans/bodies/detections", frame)
    runner.close()
    return run
