"""Runs in folders, and whatever reads them: records with wrong, missing or huge values are left out, or shown."""

from __future__ import annotations

import functools
import json
import random
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from socialbot.agents import waldo
from socialbot.core.errors import SocialbotError
from socialbot.runs.annotations import write_csv, write_elan
from socialbot.runs.asking import answer
from socialbot.runs.difference import difference
from socialbot.runs.expectations import evaluate
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.forgetting import forget_person
from socialbot.runs.foxglove import export_foxglove
from socialbot.runs.record import SEEN, TRACE
from socialbot.runs.report import difference_page, report_html
from socialbot.runs.run import NoCommands, overview
from socialbot.runs.visits import visits_of
from socialbot.runs.why import actions, considered, decided_at, explain, why_not
from tests.runs.deliberating_runs import DETOUR
from tests.runs.runs import greeting

WRONGS: tuple[Any, ...] = (
    None, True, -1, 2.5, 10**30, 1e308, -(2**63), "", "x\0\u202e", [], [[]], {}, {"a": {"b": [None]}}, [1, "a", None],
    "x" * 20_000, [0] * 2000,
)  # fmt: skip
"""Values of each type of JSON."""

RECORDED = Path(__file__).parents[1] / "data" / "run_0_1"
BEHAVIOURS = Path(waldo.__file__).with_name("behaviours.py")
FILES = ("graph.yaml", "results.json")
QUESTIONS = (
    "Why did you do that?", "What did you see?", "How often did you greet?", "Who was there?", "What do you want?",
    "What did ann plan?", "Why did the plan fail?", "When did somebody come?",
)  # fmt: skip


@functools.cache
def recorded_lines() -> dict[str, tuple[tuple[bytes, ...], dict[str, bytes]]]:
    """The first records of each kind of some runs, and their other files, by name."""
    from tests.fuzz.decoders import scratch

    folder = scratch() / "waldo"
    if not folder.exists():
        greeting(folder, tenths=40)
    found = {
        name: (tuple(_first(folder / TRACE)), {file: (folder / file).read_bytes() for file in (*FILES, SEEN)})
        for name, folder in (("waldo", folder), ("hospital", RECORDED))
    }
    found["plans"] = (tuple(map(msgspec.json.encode, DETOUR)), {})
    return found


def _first(path: Path, most: int = 4) -> Iterator[bytes]:
    """The first records of each kind, which keep their order."""
    counts: dict[str, int] = {}
    for line in path.read_bytes().splitlines():
        kind = json.loads(line)["kind"]
        counts[kind] = counts.get(kind, 0) + 1
        if counts[kind] <= most:
            yield line


def places(record: Any, *path: Any) -> Iterator[tuple[Any, ...]]:
    """Paths to all values in a record."""
    parts = record.items() if isinstance(record, dict) else enumerate(record) if isinstance(record, list) else ()
    for key, part in parts:
        yield (*path, key)
        yield from places(part, *path, key)


def with_wrong(line: bytes, path: tuple[Any, ...], wrong: Any, *, missing: bool = False) -> bytes:
    """The line with a wrong value at ``path``, or without one."""
    record = json.loads(line)
    *above, last = path
    holder = functools.reduce(lambda value, key: value[key], above, record)
    if missing:
        del holder[last]
    else:
        holder[last] = wrong
    return json.dumps(record).encode()


def mutated(data: bytes) -> tuple[str, bytes]:
    """The name of a run, and its trace with some wrong values, drawn with ``data`` as the seed."""
    chance = random.Random(data)
    name, (lines, _) = chance.choice(sorted(recorded_lines().items()))
    changed = list(lines)
    for _ in range(chance.choice((1, 1, 2, 5))):
        number = chance.randrange(len(changed))
        found = list(places(json.loads(changed[number])))
        if found:
            missing = chance.random() < 0.1
            changed[number] = with_wrong(changed[number], chance.choice(found), chance.choice(WRONGS), missing=missing)
    return name, b"\n".join(changed) + b"\n"


def write_run(folder: Path, name: str, trace: bytes) -> Path:
    """Write a run with this trace, and the other files of the run ``name``."""
    folder.mkdir(exist_ok=True)
    for file in (*FILES, SEEN):
        (folder / file).unlink(missing_ok=True)
    for file, content in recorded_lines()[name][1].items():
        (folder / file).write_bytes(content)
    (folder / TRACE).write_bytes(trace)
    return folder


def read_all(folder: Path) -> RecordedRun:
    """Use a run in all ways that its commands and pages do."""
    run = open_run(folder)
    overview(run, NoCommands("it has ended"))
    history = run.history
    for stamp in (history.start, (history.start + history.end) // 2, history.end):
        msgspec.json.encode(run.states.at(stamp))
        msgspec.json.encode(run.trees(stamp))
        run.world(stamp)
        for record in decided_at(history, stamp):
            explain(history, run.wording, record).text()
    for record in actions(history):
        msgspec.json.encode(explain(history, run.wording, record))
    for plan in considered(history):
        with suppress(SocialbotError):
            msgspec.json.encode(why_not(history, plan.plan))
    for question in QUESTIONS:
        msgspec.json.encode(answer(run, question))
    report_html(run, world=run.world_view)
    msgspec.json.encode(visits_of(run))
    evaluate(BEHAVIOURS, run)
    other = open_run(folder)
    found = difference(run, other)
    list(found.text())
    difference_page(run, other, found).html()
    write_csv(run, folder / "run.csv")
    write_elan(run, folder / "run.eaf")
    (folder / "run.mcap").unlink(missing_ok=True)
    with suppress(SocialbotError):  # ROS texts have no zero bytes
        export_foxglove(run, None, folder / "run.mcap")
    with suppress(SocialbotError):
        forget_person(folder, "t1")
    return run
