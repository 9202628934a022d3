"""Runs of Waldo with people whom a test describes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from socialbot.core.clock import SECOND
from socialbot.core.messages import HeardSpeech, PersonDetection, PersonDetections
from socialbot.graph.files import parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.run import LiveRun
from socialbot.runtime.run import observed_topics
from tests.runs.runs import DETECTED, START

TALKING = """
name: talking
inputs: [/humans/bodies/detections, /humans/voices/speech]
nodes:
  bdi_engine: {type: talking_waldo}
  listener: {type: listener}
  speech: {type: speaker, parameters: {playback: 'off'}}
"""
VISITS = {"t1": (2.0, 14.0), "t2": (20.0, 25.0)}


def person(name: str, distance_m: float, *, bearing_rad: float | None = None) -> PersonDetection:
    """Return the detection of a person who faces the robot."""
    return PersonDetection(
        x=100, y=50, w=80, h=200, score=0.9, track_id=name, distance_m=distance_m, bearing_rad=bearing_rad,
        facing_rad=0.2,
    )  # fmt: skip


def run_of(
    seen: Callable[[float], Iterable[PersonDetection]],
    end_s: float,
    *,
    heard: Mapping[float, str] | None = None,
) -> LiveRun:
    """Return the run of Waldo who sees these people, by the time (s), in ten frames a second.

    With ``heard``, he talks and hears these sentences of t1, by the time (s).
    """
    graph = parse_graph(DETECTED if heard is None else TALKING, where="waldo_run.py")
    run, runner = LiveRun(graph), InlineRunner(graph, start=START)
    for topic in observed_topics(graph):
        runner.tap(topic, run.observe)
    runner.start()
    for tenth in range(int(end_s * 10)):
        stamp, persons = START + tenth * SECOND // 10, tuple(seen(tenth / 10))
        frame = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=persons)
        runner.feed("/humans/bodies/detections", frame)
        text = (heard or {}).get(tenth / 10)
        if text is not None:
            speech = HeardSpeech(
                stamp=stamp, start=stamp - SECOND, text=text, language="en", confidence=0.9, person="t1"
            )
            runner.feed("/humans/voices/speech", speech)
    runner.close()
    return run


def two_visitors() -> LiveRun:
    """Return a run with two visitors: t1 stays for 12 s and is offered help, t2 leaves after 5 s."""

    def seen(at_s: float) -> Iterable[PersonDetection]:
        return (person(name, 4.0) for name, (begin, end) in VISITS.items() if begin <= at_s < end)

    return run_of(seen, 30.0)
