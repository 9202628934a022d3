"""What led to a record that does not name its cause, as far as the others tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from socialbot.clock import SECOND
from socialbot.messages import TraceRecord

if TYPE_CHECKING:
    from socialbot.inspect.history import History

NEAR_NS = SECOND // 2
"""What is said by another topic about the same thing is so near in time."""

DEEDS = {"message", "failure", "action_end", "action", "plan"}
"""What an agent does itself that has it say something."""


class Hints:
    """Finds causes among the records just before: commands to a world follow from actions, words from deeds."""

    def __init__(self, history: History) -> None:
        self._history = history

    def cause(self, record: TraceRecord) -> TraceRecord | None:
        """What led to ``record``; None when nothing tells more than the record itself."""
        mission = str(record.detail.get("mission" if record.kind == "said" else "label") or "")
        match record.kind:
            case "step" if not record.cause:
                call = record.what.strip("()").split()
                return self._last(record, {"action"}, f"{call[0]}({', '.join(call[1:])})" if call else "")
            case "said" if not record.cause:
                return self._plan(record, mission) or self._last(record, DEEDS)
            case "plan_start" if mission:
                return self._given_up(record)
            case "plan_end" if mission:
                return self._problem(record, mission)
        return None

    def _last(self, record: TraceRecord, kinds: set[str], what: str = "") -> TraceRecord | None:
        """The last record of the same agent, of these kinds and, where it is given, about ``what``."""
        for each in self._before(record):
            if each.source == record.source and each.kind in kinds and what in ("", each.what):
                return each
        return None

    def _plan(self, record: TraceRecord, mission: str) -> TraceRecord | None:
        """The plan of the mission in whose name its maker says something, which may be told of a moment later."""
        for each in self._history.between(record.stamp - NEAR_NS, record.stamp + NEAR_NS):
            if each.kind == "plan_start" and each.source == record.source and each.detail.get("label") == mission:
                return each if mission else None
        return None

    def _given_up(self, record: TraceRecord) -> TraceRecord | None:
        """The end of the plan in whose place this one comes."""
        for each in self._before(record):
            if each.kind == "plan_end" and (each.source, each.what) == (record.source, record.what):
                return each
        return None

    def _problem(self, record: TraceRecord, mission: str) -> TraceRecord | None:
        """The problem that the agent was told of, for which a plan was given up."""
        if record.detail.get("outcome") == "succeeded":
            return None
        for each in self._before(record):
            told = each.detail
            if each.kind == "said" and told.get("weight") == "problem" and told.get("receiver") == record.source:
                return each if told.get("mission") == mission else None
        return None

    def _before(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """The records near in time and not later, the last one first."""
        near = self._history.back(record.stamp - NEAR_NS, record.stamp)
        return (each for each in near if each is not record)
