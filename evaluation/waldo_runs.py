"""Runs of Waldo on given detections, in simulated time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetections
from socialbot.graph.files import parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.record import RunRecord
from socialbot.runtime.run import observed_topics

DETECTIONS = "/humans/bodies/detections"
START = 1_700_000_000 * SECOND
"""Stamp of the first detections (ns)."""

_GRAPH = """
name: waldo
inputs: [/humans/bodies/detections]
nodes:
  bdi_engine: {type: waldo}
  listener: {type: listener}
  speech: {type: speaker, parameters: {playback: 'off'}}
  head: {type: head}
"""
"""Waldo without a camera that he could miss."""


def record_waldo(frames: Iterable[PersonDetections], folder: Path, **parameters: float) -> None:
    """Record what Waldo does on ``frames``; ``parameters`` are those of his node in results.json."""
    graph = parse_graph(_GRAPH, where=__name__)
    runner = InlineRunner(graph, start=START)
    with RunRecord(folder) as record:
        record.describe(graph)
        for topic in observed_topics(graph):
            runner.tap(topic, record.observe)
        runner.start()
        for frame in frames:
            runner.feed(DETECTIONS, frame)
        runner.close()
        record.write_results({"graph": "waldo", "runner": "inline", "parameters": {"bdi_engine": parameters}})
