"""Recorded runs for `evaluation.questions`: replays, simulations, played visits, and agents of users."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec

from socialbot.bdi import Engine, Record
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.files import parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.record import RunRecord
from socialbot.runtime.run import observed_topics
from socialbot.testing import ManualClock, run_engine

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


def record_waldo(frames: Iterable[PersonDetections], folder: Path, **results: Any) -> None:
    """Record what Waldo does on ``frames``; ``results`` are further entries of results.json."""
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
        record.write_results({"graph": "waldo", "runner": "inline", "parameters": {"bdi_engine": {}}, **results})


GUARD = Path("examples/door_guard.py")

TOWARDS, AWAY = 0.2, 2.9
VISITS = (
    ("t1", 3.0, 16.0, 3.0, TOWARDS),
    ("t2", 22.0, 26.0, 2.5, TOWARDS),
    ("t3", 33.0, 39.0, 4.0, AWAY),
    ("t4", 45.0, 58.0, 2.0, TOWARDS),
    ("t5", 45.0, 50.0, 3.5, TOWARDS),
)
"""Track id, first and last second, distance (m) and facing (rad) of the visitors of the run ``visits``."""
VISITS_END_S = 65.0


def visits(folder: Path) -> None:
    """Record Waldo with five visitors: a long stay, a short one, one who looks away, and two who come together."""
    record_waldo(_frames(), folder)


def _frames() -> Iterator[PersonDetections]:
    for tenth in range(int(VISITS_END_S * 10)):
        persons = tuple(
            PersonDetection(
                x=100.0, y=50.0, w=80.0, h=200.0, score=0.9, track_id=name, distance_m=distance_m, facing_rad=facing
            )
            for name, begin, end, distance_m, facing in VISITS
            if begin <= tenth / 10 < end
        )  # fmt: skip
        stamp = START + tenth * nanoseconds(0.1)
        yield PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=persons)


def guard(folder: Path) -> None:
    """Record the door guard of the examples, an agent without vocabulary and phrases."""
    spec = importlib.util.spec_from_file_location("door_guard", GUARD)
    assert spec is not None
    assert spec.loader is not None
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    records: list[TraceRecord] = []

    def keep(record: Record) -> None:
        about = {name: getattr(record, name) for name in ("id", "kind", "what", "cause", "detail")}
        records.append(TraceRecord(stamp=record.time, source="guard", **about))

    engine = Engine("guard", ManualClock(), sink=keep)
    engine.add_rules(*program.RULES)
    with redirect_stdout(StringIO()):
        engine.believe(program.known("Ann"))
        for name in ("Ann", "Bob"):
            engine.believe(program.bell())
            run_engine(engine, 3.0)
            engine.believe(program.badge(name))
            run_engine(engine, 17.0)
        engine.believe(program.door_open())
        run_engine(engine, 12.0)
        engine.forget(program.door_open())
        run_engine(engine, 5.0)
    _write_trace(folder, records)


HARBOUR = (
    ("crane_a", "lift(crane_a, crate_b1, pier_1)"),
    ("crane_a", "lower(crane_a, crate_b1, truck_a)"),
    ("truck_a", "drive(truck_a, pier_1, depot_a)"),
    ("truck_a", "park(truck_a, depot_a)"),
    ("watchman_a", 'inspect("Eve")'),
    ("watchman_a", 'say("Please open the gate.")'),
    ("scout_a", "go(scout_a, pier_2)"),
    ("scout_a", "go_back(scout_a)"),
    ("crane_a", "lift(crane_a, crate_c2, pier_1)"),
    ("watchman_a", 'say("Good night.")'),
)
"""Agents with their actions, one each two seconds."""


def harbour(folder: Path) -> None:
    """Record four agents without vocabulary and phrases, of which only the actions are known."""
    records = [
        TraceRecord(stamp=2 * n * SECOND, id=f"{source}-{n}", source=source, kind="action", what=what)
        for n, (source, what) in enumerate(HARBOUR)
    ]
    _write_trace(folder, records)


def _write_trace(folder: Path, records: Iterable[TraceRecord]) -> None:
    folder.mkdir(parents=True)
    (folder / "trace.jsonl").write_bytes(b"".join(msgspec.json.encode(record) + b"\n" for record in records))
    (folder / "results.json").write_text("{}")


def _made_by(*arguments: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        command = [sys.executable, "-m", "socialbot", *arguments, "--out", str(folder)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

    return make


RUNS: Mapping[str, Callable[[Path], None]] = {
    "visits": visits,
    "guard": guard,
    "harbour": harbour,
    "hospital": _made_by("demo", "hospital", "--problems", "100", "--seed", "3"),
    "warehouse": _made_by("demo", "warehouse"),
    "warehouse2": _made_by("demo", "warehouse", "--run", "2"),
    "cleaner": _made_by("demo", "cleaner"),
    "reception": _made_by("demo", "reception"),
    "corridor": _made_by("replay", "data/synthetic/corridor", "--no-video"),
}
"""Functions that record each run into a folder, the cheapest ones first."""

VOCABULARIES: Mapping[str, str] = {
    "visits": "greet, offer help, visitor, T1, T2",
    "guard": "Ann, Bob, badge",
    "harbour": "crane A, truck A, watchman, scout A, crate B1, pier 1, depot, Eve",
    "hospital": "spotrobot1, uvdrobot1, nurse, room 1, milestone, disinfect, patrol, tidy",
    "warehouse": "gripper A, carrier A, carrier B, carrier C, box A1, box B2, base 1, deposit, pick up, unload",
    "warehouse2": "gripper A, carrier A, carrier B, carrier C, box A1, box B2, base 1, deposit, pick up, unload",
    "cleaner": "kitchen, bathroom, bedroom, dock, battery",
    "reception": "greet, offer help, library",
    "corridor": "greet, offer help, visitor",
}
"""Words that the recogniser of each robot expects, as the parameter ``vocabulary`` of the node ``hearing``."""
