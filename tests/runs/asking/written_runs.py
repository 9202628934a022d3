"""Runs written by hand, as folders and as views, and the check of answers about them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import msgspec

from evaluation.questions_check import Verifier
from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.asking import Answer
from socialbot.runs.history import History
from socialbot.runs.run import RunView


def write_run(folder: Path, records: Iterable[TraceRecord]) -> Path:
    """Write a run folder with these records. Return it."""
    folder.mkdir()
    (folder / "trace.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in records))
    (folder / "results.json").write_text("{}")
    return folder


def faults(folder: Path, found: Answer) -> list[str]:
    """Return the clauses of an answer that the trace of a run folder does not support."""
    return Verifier(folder).faults(json.loads(msgspec.json.encode(found)))


def run_of_deeds(deeds: Iterable[tuple[str, str]]) -> RunView:
    """Return a run with a deed each second, given as agent and call; it has no vocabulary and no phrases."""
    return RunView(
        None,
        History(
            TraceRecord(stamp=n * SECOND, id=f"{source}-{n}", source=source, kind="action", what=what)
            for n, (source, what) in enumerate(deeds)
        ),
        None,
    )
