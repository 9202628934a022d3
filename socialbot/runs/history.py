"""Records of a run in time order, with their causes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice

import msgspec

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord

OF_TOPICS = frozenset({"detection", "hearing", "utterance", "speech", "head", "motion"})
"""Kinds of records whose source is a topic; the source of all others is an agent."""

LONGEST_CHAIN = 1000
"""Limit for chains of causes: an agent may continue from its last action for days."""

REMEMBERED_CHAIN = 20
"""Links and actions of a plan kept for current items after dropping older records."""

MOST_BYTES = 200_000_000
"""Most bytes of the records that a process keeps of a live run, each with its size as JSON."""


def size_of(record: TraceRecord) -> int:
    """Bytes of a record as JSON."""
    return len(msgspec.json.encode(record))


class History:
    """Records of a run in time order; it may grow.

    Records with the same stamp keep their order of arrival, but a cause precedes its effects: topics of a live run
    deliver in any order.

    Args:
        records: The first records.
        start: Stamp (ns) of 0 s; that of the first record by default.
    """

    def __init__(self, records: Iterable[TraceRecord] = (), *, start: int | None = None) -> None:
        self._start = start
        self._records: list[TraceRecord] = []
        self._stamps: list[int] = []
        self._by_id: dict[str, list[TraceRecord]] = {}
        self._by_cause: dict[str, list[TraceRecord]] = {}
        self._plans: dict[tuple[str, int], list[TraceRecord]] = {}
        """Starts of plans by agent and number."""
        self._agents: dict[str, None] = {}
        self._hints = Hints(self)
        self._late: list[int] = []
        self.forgotten = 0
        """Number of dropped records."""
        self._since = 0
        for record in records:
            self.append(record)

    def append(self, record: TraceRecord) -> None:
        """Add a record, which may be late."""
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
        self._put_effects_behind(record)
        self._refer(record)
        if record.kind not in OF_TOPICS:
            self._agents[record.source] = None

    def _put_effects_behind(self, record: TraceRecord) -> None:
        """Move the effects of ``record`` that arrived before it, and theirs, behind all records of the same stamp."""
        moved: set[int] = set()
        causes = [record]
        while causes:
            named = (effect for name in names_of(causes.pop()) for effect in self._by_cause.get(name, ()))
            effects = [each for each in named if each.stamp == record.stamp and id(each) not in moved]
            moved.update(map(id, effects))
            causes += effects
        if moved:
            begin, end = bisect_left(self._stamps, record.stamp), bisect_right(self._stamps, record.stamp)
            self._records[begin:end] = sorted(self._records[begin:end], key=lambda each: id(each) in moved)
            self._late.append(begin)

    def forget(self, count: int, still: Iterable[str] = ()) -> None:
        """Drop the first ``count`` records.

        Causes and latest effects of the records with the ids ``still`` are kept.
        """
        roots = [record for record in map(self.find, still) if record is not None]
        kept = {id(record): record for root in roots for record in (*self._nearest(root), *self._newest(root))}
        del self._records[:count]
        del self._stamps[:count]
        self._late.clear()
        self.forgotten += count
        self.hide(self._stamps[0] if self._stamps else self.start)
        self._by_id, self._by_cause, self._plans = {}, {}, {}
        for each in self._records:
            kept.pop(id(each), None)
        for each in (*sorted(kept.values(), key=lambda record: record.stamp), *self._records):
            self._refer(each)

    def hide(self, stamp: int) -> None:
        """Hide everything before ``stamp`` (ns), also records that are still stored."""
        if self._start is not None:
            self._since = max(self._since, stamp)

    def _nearest(self, record: TraceRecord) -> Iterator[TraceRecord]:
        return islice((record, *self.before(record)), REMEMBERED_CHAIN)

    def _newest(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """Yield the chain of latest effects; a plan with parallel actions has several."""
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
        number = record.detail.get("plan")
        if record.kind == "plan_start" and isinstance(number, int):
            self._plans.setdefault((record.source, number), []).append(record)

    def __len__(self) -> int:
        return len(self._records)

    def __iter__(self) -> Iterator[TraceRecord]:
        return iter(self._records)

    def __getitem__(self, place: int) -> TraceRecord:
        return self._records[place]

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents in order of appearance."""
        return tuple(self._agents)

    @property
    def start(self) -> int:
        """Stamp (ns) of 0 s."""
        return self._start or 0

    @property
    def since(self) -> int:
        """Stamp (ns) from which the history is complete."""
        return max(self._since, self.start)

    @property
    def end(self) -> int:
        return self._stamps[-1] if self._stamps else self.start

    @property
    def duration_s(self) -> float:
        return self.seconds(self.end)

    def seconds(self, stamp: int) -> float:
        """Convert a stamp (ns) to seconds from the start, to the microsecond."""
        return round((stamp - self.start) / SECOND, 6)

    def stamp(self, seconds: float) -> int:
        """Convert seconds from the start to a stamp (ns)."""
        if len(self) and seconds == self.seconds(self.end):
            return self.end  # which seconds may have been rounded below
        return self.start + nanoseconds(seconds)

    def until(self, stamp: int) -> int:
        """Return the number of records up to ``stamp`` (ns)."""
        return bisect_right(self._stamps, stamp)

    def between(self, begin: int, end: int) -> Sequence[TraceRecord]:
        """Return the records from ``begin`` to ``end`` (ns), inclusive."""
        return self._records[bisect_left(self._stamps, begin) : bisect_right(self._stamps, end)]

    def back(self, begin: int, end: int) -> Iterator[TraceRecord]:
        """Yield the records from ``end`` back to ``begin`` (ns), inclusive."""
        first = bisect_left(self._stamps, begin)
        return (self._records[place] for place in range(bisect_right(self._stamps, end) - 1, first - 1, -1))

    def part(self, begin: int, end: int) -> Sequence[TraceRecord]:
        """Return the records from one index up to another."""
        return self._records[begin:end]

    def late(self, since: int) -> Sequence[int]:
        """Return the indices of late records after the first ``since`` of them."""
        return self._late[since:]

    def find(self, id: str) -> TraceRecord | None:
        found = self._by_id.get(id)
        return found[-1] if found else None

    def plan(self, agent: str, number: int, stamp: int) -> TraceRecord | None:
        """Return the latest start of the plan ``number`` of an agent up to ``stamp`` (ns)."""
        begun = [each for each in self._plans.get((agent, number), ()) if each.stamp <= stamp]
        return max(reversed(begun), key=lambda each: each.stamp, default=None)

    def cause(self, record: TraceRecord) -> TraceRecord | None:
        """Return the record that caused ``record``, also if only `Hints` can derive it."""
        hint = self._hints.cause(record)
        if hint is not None:
            return hint
        found = self._by_id.get(record.cause, ()) if record.cause else ()
        return next((each for each in reversed(found) if each.stamp <= record.stamp and each is not record), None)

    def chain(self, record: TraceRecord) -> list[TraceRecord]:
        """Return ``record`` and the causes from `before`."""
        return [record, *self.before(record)]

    def before(self, record: TraceRecord) -> Iterator[TraceRecord]:
        """Yield the cause of ``record``, its cause and so on, each once, up to `LONGEST_CHAIN`."""
        seen = {id(record)}
        cause = self.cause(record)
        while cause is not None and id(cause) not in seen and len(seen) <= LONGEST_CHAIN:
            yield cause
            seen.add(id(cause))
            cause = self.cause(cause)

    def effects(self, record: TraceRecord) -> list[TraceRecord]:
        """Return the records that name ``record`` as their cause."""
        named = (effect for name in names_of(record) for effect in self._by_cause.get(name, ()))
        return [effect for effect in named if self.cause(effect) is record]


def names_of(record: TraceRecord) -> tuple[str, ...]:
    """Return the ids of a record. A request has a second id, which its receiver uses."""
    if record.kind == "request" and isinstance(record.detail.get("id"), str):
        return record.id, record.detail["id"]
    return (record.id,)


NEAR_NS = SECOND // 2
"""Largest time between records of different topics about the same thing."""

DEEDS = {"message", "failure", "action_end", "action", "plan"}
"""Kinds of records that make an agent send a message."""


class Hints:
    """Derive unrecorded causes: the action behind a step or a sentence, the plan or action behind a message."""

    def __init__(self, history: History) -> None:
        self._history = history

    def cause(self, record: TraceRecord) -> TraceRecord | None:
        """Return the cause of ``record`` if it can be derived."""
        mission = str(record.detail.get("mission" if record.kind == "said" else "label") or "")
        match record.kind:
            case "step" if not record.cause:
                call = record.what.strip("()").split()
                text = f"{call[0]}({', '.join(call[1:])})" if call else ""
                return self._latest(record, lambda each: each.kind == "action" and text in ("", each.what))
            case "utterance" if not record.cause:
                return next((each for each in self._before(record) if _quotes(each, record.what)), None)
            case "said" if not record.cause:
                return self._plan(record, mission) or self._latest(record, lambda each: each.kind in DEEDS)
            case "plan_start" if mission:
                return self._latest(record, lambda each: each.kind == "plan_end" and each.what == record.what)
            case "plan_end" if mission and record.detail.get("outcome") != "succeeded":
                return self._problem(record, mission)
        return None

    def _latest(self, record: TraceRecord, matches: Callable[[TraceRecord], bool]) -> TraceRecord | None:
        return next((each for each in self._before(record) if each.source == record.source and matches(each)), None)

    def _plan(self, record: TraceRecord, mission: str) -> TraceRecord | None:
        near = self._history.between(record.stamp - NEAR_NS, record.stamp + NEAR_NS) if mission else ()
        of_agent = (each for each in near if each.kind == "plan_start" and each.source == record.source)
        return next((each for each in of_agent if each.detail.get("label") == mission), None)

    def _problem(self, record: TraceRecord, mission: str) -> TraceRecord | None:
        for each in self._before(record):
            detail = each.detail
            if each.kind == "said" and detail.get("weight") == "problem" and detail.get("receiver") == record.source:
                return each if detail.get("mission") == mission else None
        return None

    def _before(self, record: TraceRecord) -> Iterator[TraceRecord]:
        near = self._history.back(record.stamp - NEAR_NS, record.stamp)
        return (each for each in near if each is not record)


def _quotes(record: TraceRecord, text: str) -> bool:
    """Return whether a record is an action with ``text`` as an argument."""
    return record.kind == "action" and bool(text) and f'"{text}"' in record.what
