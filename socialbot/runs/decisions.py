"""Whether two runs decided the same: the desires, plans, steps and requests of their agents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from socialbot.core.messages import TraceRecord

DECIDED = frozenset(
    {
        *("desire", "desire_refused", "desire_fulfilled", "desire_dropped", "planning", "plan_start", "plan_end"),
        *(
            "step",
            "step_end",
            "action",
            "action_end",
            "request",
            "asked",
            "refused",
            "reply",
            "silent",
            "heard",
            "said",
        ),
    }
)
"""Kinds of records that are decisions, or tell what came of them."""


@dataclass(frozen=True)
class Comparison:
    """Two runs: how many decisions each has, and where they differ first, in words (empty when they do not).

    They are ``exact`` when also all times and causes are the same; else every agent had the same desires and plans and
    began the same steps, each in the same order.
    """

    recorded: int
    replayed: int
    exact: bool
    difference: str

    @property
    def same(self) -> bool:
        """Whether the same was decided."""
        return not self.difference

    @property
    def told(self) -> str:
        """In a sentence."""
        if self.difference:
            return f"Decisions differ from the recorded ones: {self.difference}"
        if self.exact:
            return f"All {self.recorded} decisions are those that were recorded, at the same times."
        return "All desires, plans and steps are those that were recorded, in the same order."


def compare(recorded: Iterable[TraceRecord], replayed: Iterable[TraceRecord]) -> Comparison:
    """Compares the decisions of two runs."""
    first = [record for record in recorded if record.kind in DECIDED]
    second = [record for record in replayed if record.kind in DECIDED]
    difference = ""
    for agent in sorted({record.source for record in (*first, *second)}):
        for kinds in _LINES:
            difference = difference or _difference(agent, _line(first, agent, kinds), _line(second, agent, kinds))
    return Comparison(len(first), len(second), first == second, difference)


_LINES = (
    frozenset({"desire", "desire_refused", "desire_fulfilled", "desire_dropped"}),
    frozenset({"plan_start", "plan_end"}),
    frozenset({"step"}),
)
"""Kinds whose order within an agent is the same, whatever others do meanwhile."""


def _line(records: list[TraceRecord], agent: str, kinds: frozenset[str]) -> list[str]:
    return [_told(record) for record in records if record.source == agent and record.kind in kinds]


def _told(record: TraceRecord) -> str:
    more = record.detail.get("steps", record.detail.get("outcome", ""))
    return " ".join(filter(None, (record.kind, record.what, "; ".join(more) if isinstance(more, list) else more)))


def _difference(agent: str, first: list[str], second: list[str]) -> str:
    for number, (before, now) in enumerate(zip(first, second, strict=False), 1):
        if before != now:
            return f"{agent}, number {number}: {before!r} was recorded, now it is {now!r}"
    if len(first) != len(second):
        longer, whose = (first, "recorded") if len(first) > len(second) else (second, "there now")
        return f"{agent}: only {whose}: {longer[min(len(first), len(second))]!r}"
    return ""
