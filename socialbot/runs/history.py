"""The records of a run in time order, and the cause of each."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord

if TYPE_CHECKING:
    pass  # merged


OF_TOPICS = frozenset({"detection", "utterance", "speech", "head", "motion"})
"""Kinds of records whose source is a topic; that of all others is an agent."""

LONGEST_CHAIN = 1000
"""So many links of a chain of causes are followed at most: who goes on from what it did last may do so for days."""


REMEMBERED_CHAIN = 20
"""So many links of it are kept of what still goes on when what was long ago is forgotten, and actions of a plan."""


class History:
    """The records of a run by time, those of the same stamp in the order in which they came. It may grow.

    ``start`` is the stamp (ns) that times in seconds are counted from; by default that of the first record.
    """

    def __init__(self, records: Iterable[TraceRecord] = (), *, start: int | None = None) -> None:
        self._start = start
        self._records: list[TraceRecord] = []
        self._stamps: list[int] = []
        self._by_id: dict[str, list[TraceRecord]] = {}
        self._by_cause: dict[str, list[TraceRecord]] = {}
        self._agents: dict[str, None] = {}
        self._hints = Hints(self)
        self._late: list[int] = []
        self._forgotten = 0
        self._since = 0
        for record in records:
            self.append(record)

    def append(self, record: TraceRecord) -> None:
        """Takes one more record: the next one, or one that comes late."""
        if self._start is None:
            self._start = record.stamp
        if not self._stamps or record.stamp >= self._stamps[-1]:
            self._records.append(record)
            self._stamps.append(record.stamp)
        else:
            place = bisect_right(self._stamps, record.stamp)
            self._records.insert(place, record)
            self._stamps.insert(place, record.stamp)
            self._late.append(place)
        self._refer(record)
        if record.kind not in OF_TOPICS:
            self._agents[record.source] = None

    def forget(self, count: int, still: Iterable[str] = ()) -> None:
        """Forgets the first ``count`` records, and which ones came late. Agents and the start of time stay known.

        Of what is ``still`` so, by the ids of its records, it remains known what led to it and what it has come to.
        """
        roots = [record for record in map(self.find, still) if record is not None]
        kept = {id(record): record for root in roots for record in (*self._nearest(root), *self._newest(root))}
        del self._records[:count]
        del self._stamps[:count]
        self._late.clear()
        self._forgotten += count
        self.hide(self._stamps[0] if self._stamps else self.start)
        self._by_id, self._by_cause = {}, {}
        for each in self._records:
            kept.pop(id(each), None)
        for each in (*sorted(kept.values(), key=lambda record: record.stamp), *self._records):
            self._refer(each)

    def hide(self, stamp: int) -> None:
        """From now on what was before ``stamp`` (ns) is not told of, though some of its records may still be there."""
        if self._start is not None:
            self._since = max(self._since, stamp)

    def _nearest(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """A record and the first links of what led to it."""
        return islice((record, *self.before(record)), REMEMBERED_CHAIN)

    def _newest(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """What a record has come to: of its effects the newest, of the effects of that the newest and so on.

        Of a plan these are several, as its actions may go on side by side.
        """
        for _ in range(REMEMBERED_CHAIN):
            effects = [effect for effect in self.effects(record) if effect.kind not in OF_TOPICS]
            if not effects:
                return
            yield from effects[-REMEMBERED_CHAIN if record.kind == "plan" else -1 :]
            record = effects[-1]

    def _refer(self, record: TraceRecord) -> None:
        for name in names_of(record):
            self._by_id.setdefault(name, []).append(record)
        self._by_cause.setdefault(record.cause, []).append(record)

    def __len__(self) -> int:
        return len(self._records)

    def __iter__(self) -> Iterator[TraceRecord]:
        return iter(self._records)

    def __getitem__(self, place: int) -> TraceRecord:
        return self._records[place]

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents, in the order in which they appear."""
        return tuple(self._agents)

    @property
    def start(self) -> int:
        """The stamp (ns) at which time begins."""
        return self._start or 0

    @property
    def forgotten(self) -> int:
        """How many records are forgotten."""
        return self._forgotten

    @property
    def since(self) -> int:
        """The stamp (ns) since when all is known: the start, as long as nothing is forgotten."""
        return max(self._since, self.start)

    @property
    def end(self) -> int:
        """The stamp (ns) of the last record."""
        return self._stamps[-1] if self._stamps else self.start

    @property
    def duration_s(self) -> float:
        """From the start to the last record (s)."""
        return self.seconds(self.end)

    def seconds(self, stamp: int) -> float:
        """A stamp (ns) as s from the start, to the microsecond."""
        return round((stamp - self.start) / SECOND, 6)

    def stamp(self, seconds: float) -> int:
        """A time in s from the start as a stamp (ns)."""
        return self.start + nanoseconds(seconds)

    def until(self, stamp: int) -> int:
        """How many records are not later than ``stamp`` (ns)."""
        return bisect_right(self._stamps, stamp)

    def between(self, begin: int, end: int) -> Sequence[TraceRecord]:
        """The records from ``begin`` to ``end`` (ns), both included."""
        return self._records[bisect_left(self._stamps, begin) : bisect_right(self._stamps, end)]

    def back(self, begin: int, end: int) -> Iterator[TraceRecord]:
        """The records from ``end`` back to ``begin`` (ns), both included, one by one."""
        first = bisect_left(self._stamps, begin)
        return (self._records[place] for place in range(bisect_right(self._stamps, end) - 1, first - 1, -1))

    def part(self, begin: int, end: int) -> Sequence[TraceRecord]:
        """The records from one place to another, which is not included."""
        return self._records[begin:end]

    def late(self, since: int) -> Sequence[int]:
        """The places at which records came late, but for the first ``since`` of those."""
        return self._late[since:]

    def find(self, id: str) -> TraceRecord | None:
        """The record with this id; the last one of several; None when there is none."""
        found = self._by_id.get(id)
        return found[-1] if found else None

    def cause(self, record: TraceRecord) -> TraceRecord | None:
        """The record that led to ``record``; None when that is no record.

        Where the record does not name it, what can be told from the others counts (`Hints`).
        """
        hint = self._hints.cause(record)
        if hint is not None:
            return hint
        found = self._by_id.get(record.cause, ()) if record.cause else ()
        return next((each for each in reversed(found) if each.stamp <= record.stamp and each is not record), None)

    def chain(self, record: TraceRecord) -> list[TraceRecord]:
        """``record``, what led to it, what led to that and so on, as far as `before` goes. None of them comes twice."""
        return [record, *self.before(record)]

    def before(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """What led to ``record``, what led to that and so on, one by one: `LONGEST_CHAIN` of them at most."""
        seen = {id(record)}
        cause = self.cause(record)
        while cause is not None and id(cause) not in seen and len(seen) <= LONGEST_CHAIN:
            yield cause
            seen.add(id(cause))
            cause = self.cause(cause)

    def effects(self, record: TraceRecord) -> list[TraceRecord]:
        """The records that name ``record`` as what led to them."""
        named = (effect for name in names_of(record) for effect in self._by_cause.get(name, ()))
        return [effect for effect in named if self.cause(effect) is record]


def names_of(record: TraceRecord) -> tuple[str, ...]:
    """The ids by which others refer to a record; a request has a second one, by which its receiver knows it."""
    if record.kind == "request" and isinstance(record.detail.get("id"), str):
        return record.id, record.detail["id"]
    return (record.id,)


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
