"""What happened in a run, line by line, as people say it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import msgspec

from socialbot.inspect.run import Told
from socialbot.inspect.sentences import Teller
from socialbot.messages import TraceRecord

UNTOLD = {"detection", "motion", "plan", "planning", "mail", "progress"}
"""Kinds of records that come again and again, or say what those around them say."""


class LogLine(msgspec.Struct, frozen=True):
    """A record in words; ``t`` is in s from the start, ``source`` the agent or topic, ``id`` that of the record."""

    id: str
    t: float
    kind: str
    source: str
    text: str


def told(run: Told, records: Iterable[TraceRecord]) -> list[LogLine]:
    """Those of ``records`` that are worth telling."""
    teller = Teller(run.history, run.wording)
    return [
        LogLine(each.id, run.history.seconds(each.stamp), each.kind, each.source, teller.clause(each).told())
        for each in records
        if each.kind not in UNTOLD
    ]


def told_between(run: Told, begin: int, end: int, most: int) -> list[LogLine]:
    """The last lines, at most so many, from ``begin`` to ``end`` (ns)."""
    newest = (each for each in run.history.back(begin, end) if each.kind not in UNTOLD)
    return told(run, reversed(list(islice(newest, most))))
