"""Comparison of two runs: their first different decision and its causes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Narrator
from socialbot.runs.run import RunRecords
from socialbot.runs.why import Explanation, actions, explain

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
"""Kinds of records that are decisions or their results."""


@dataclass(frozen=True)
class DecisionComparison:
    """Numbers of decisions of two runs, and their first difference in words.

    The runs are ``exact`` if all times and causes are equal, too. Otherwise each agent had the same desires, plans and
    steps in the same order.
    """

    recorded: int
    replayed: int
    exact: bool
    difference: str

    @property
    def same(self) -> bool:
        return not self.difference

    @property
    def told(self) -> str:
        """Return the comparison as a sentence."""
        if self.difference:
            return f"Decisions differ from the recorded ones: {self.difference}"
        if self.exact:
            return f"All {self.recorded} decisions are those that were recorded, at the same times."
        return "All desires, plans and steps are those that were recorded, in the same order."


def compare(recorded: Iterable[TraceRecord], replayed: Iterable[TraceRecord]) -> DecisionComparison:
    """Compare the decisions of two runs."""
    first = [record for record in recorded if record.kind in DECIDED]
    second = [record for record in replayed if record.kind in DECIDED]
    difference = ""
    for agent in sorted({record.source for record in (*first, *second)}):
        for kinds in _LINES:
            difference = difference or _difference(agent, _line(first, agent, kinds), _line(second, agent, kinds))
    return DecisionComparison(len(first), len(second), first == second, difference)


_LINES = (
    frozenset({"desire", "desire_refused", "desire_fulfilled", "desire_dropped"}),
    frozenset({"plan_start", "plan_end"}),
    frozenset({"step"}),
)
"""Kinds whose order within an agent does not depend on other agents."""


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


DECISIONS = DECIDED - {"action", "said", "action_end"} | {"action", "utterance"}
NEAR_PIXELS = 0.5
"""Smaller differences of boxes come from rounding on other machines."""


class Setting(msgspec.Struct, frozen=True):
    """Parameter or version in each of two runs; None where a run lacks it."""

    name: str
    first: Any
    second: Any


class Side(msgspec.Struct, frozen=True):
    """Decision of one of the runs with its causes; None if it decides nothing more."""

    run: str
    at_s: float | None
    why: Explanation | None


class Parting(msgspec.Struct, frozen=True):
    """First different record of a kind in each run, with its time (s); empty if there is none."""

    what: str
    first: str
    second: str
    first_s: float | None
    second_s: float | None


class Difference(msgspec.Struct, frozen=True):
    """Comparison of two runs, which are the ``same`` if all decisions and their times are equal.

    ``counts`` holds the numbers of records by kind, ``number`` that of the first different decision. ``causes`` lists
    the first differences of detections and beliefs.
    """

    same: bool
    runs: tuple[str, str]
    decisions: tuple[int, int]
    counts: dict[str, tuple[int, int]]
    settings: tuple[Setting, ...]
    number: int | None = None
    agent: str = ""
    sides: tuple[Side, Side] | None = None
    only_time: bool = False
    causes: tuple[Parting, ...] = ()

    def text(self) -> Iterator[str]:
        first, second = self.runs
        if self.same:
            yield f"Both runs decide the same, at the same times: {self.decisions[0]} decisions."
        elif self.sides is not None:
            how = "the same, but at another time" if self.only_time else "differently"
            yield f"Decision {self.number} of {self.agent} comes out {how}."
            for side in self.sides:
                yield f"\n{side.run}:"
                yield side.why.text() if side.why else "  nothing more is decided."
        if self.causes:
            yield "\nWhere they part:"
            for parting in self.causes:
                yield f"  {parting.what} differ first:"
                for run, at_s, told in (
                    (first, parting.first_s, parting.first),
                    (second, parting.second_s, parting.second),
                ):
                    yield f"    {run}: {'nothing' if at_s is None else f'at {at_s:.2f} s {told}'}"
        if self.settings:
            yield "\nSet differently:"
            for setting in self.settings:
                yield f"  {setting.name}: {setting.first!r} | {setting.second!r}"
        if not self.same:
            yield "\nHow many:"
            for kind, (one, other) in self.counts.items():
                yield f"  {kind}: {one} | {other}"


def difference(first: RunRecords, second: RunRecords) -> Difference:
    """Compare two runs agent by agent; independent agents may act in any order."""
    runs = _names(first, second)
    decided = [_decisions(run.history) for run in (first, second)]
    found = _first_decision(first.history, second.history, *decided)
    counts = {kind: _count(kind, first, second) for kind in ("detection", "belief", "desire", "plan_start")}
    counts["action"] = (len(actions(first.history)), len(actions(second.history)))
    shown = {kind: both for kind, both in counts.items() if any(both)}
    settings = tuple(_settings(first.results, second.results))
    sizes = (len(decided[0]), len(decided[1]))
    if found is None:
        return Difference(True, runs, sizes, shown, settings)
    agent, number, one, other = found
    sides = (_side(runs[0], first, one), _side(runs[1], second, other))
    only_time = one is not None and other is not None and _essence(one) == _essence(other)
    causes = tuple(_partings(first, second, agent))
    name = first.wording.name(agent)
    return Difference(False, runs, sizes, shown, settings, number, name, sides, only_time, causes)


Decision = tuple[str, int, TraceRecord | None, TraceRecord | None]


def _decisions(history: History) -> list[TraceRecord]:
    done = {id(record) for record in actions(history)}
    return [record for record in history if id(record) in done or record.kind in DECISIONS - {"action", "utterance"}]


def _first_decision(
    first: History, second: History, ours: Sequence[TraceRecord], theirs: Sequence[TraceRecord]
) -> Decision | None:
    found: list[tuple[float, Decision]] = []
    for agent in dict.fromkeys(_agent(first, each) for each in ours) | dict.fromkeys(_agent(second, e) for e in theirs):
        one = [each for each in ours if _agent(first, each) == agent]
        other = [each for each in theirs if _agent(second, each) == agent]
        at = next((n for n, pair in enumerate(zip(one, other, strict=False)) if not _alike(first, second, *pair)), None)
        if at is None and len(one) != len(other):
            at = min(len(one), len(other))
        if at is not None:
            pair = (one[at] if at < len(one) else None, other[at] if at < len(other) else None)
            times = [h.seconds(e.stamp) for h, e in zip((first, second), pair, strict=True) if e is not None]
            found.append((min(times), (agent, at + 1, *pair)))
    return min(found, key=lambda each: each[0])[1] if found else None


def _agent(history: History, record: TraceRecord) -> str:
    if record.kind != "utterance":
        return record.source
    cause = history.cause(record)
    return record.source if cause is None else cause.source


def _essence(record: TraceRecord) -> tuple[Any, ...]:
    detail = record.detail
    steps = tuple(detail.get("steps", ())) if record.kind == "plan_start" else ()
    return record.kind, record.what, str(detail.get("outcome", "")), str(detail.get("reason", "")), steps


def _alike(first: History, second: History, one: TraceRecord, other: TraceRecord) -> bool:
    return _essence(one) == _essence(other) and first.seconds(one.stamp) == second.seconds(other.stamp)


def _side(name: str, run: RunRecords, record: TraceRecord | None) -> Side:
    if record is None:
        return Side(name, None, None)
    return Side(name, run.history.seconds(record.stamp), explain(run.history, run.wording, record))


def _partings(first: RunRecords, second: RunRecords, agent: str) -> Iterator[Parting]:
    wanted: list[tuple[str, Callable[[TraceRecord], bool], Callable[[TraceRecord], Any]]] = [
        ("detections", lambda each: each.kind == "detection", _boxes),
        (
            f"beliefs of {first.wording.name(agent)}",
            lambda each: each.kind in ("belief", "unbelief") and each.source == agent,
            lambda each: (each.kind, each.what),
        ),
    ]
    for what, is_meant, essence in wanted:
        ours = [each for each in first.history if is_meant(each)]
        theirs = [each for each in second.history if is_meant(each)]
        found = _first_parting(first, second, ours, theirs, essence)
        if found is not None:
            one, other = found
            yield Parting(what, _said(first, one), _said(second, other), _time(first, one), _time(second, other))


def _first_parting(
    first: RunRecords,
    second: RunRecords,
    ours: Sequence[TraceRecord],
    theirs: Sequence[TraceRecord],
    essence: Callable[[TraceRecord], Any],
) -> tuple[TraceRecord | None, TraceRecord | None] | None:
    for one, other in zip(ours, theirs, strict=False):
        times = first.history.seconds(one.stamp), second.history.seconds(other.stamp)
        if times[0] != times[1] or essence(one) != essence(other):
            return one, other
    if len(ours) == len(theirs):
        return None
    at = min(len(ours), len(theirs))
    return (ours[at] if at < len(ours) else None), (theirs[at] if at < len(theirs) else None)


def _boxes(record: TraceRecord) -> Any:
    return [
        (one.get("track_id"), *(round(float(one[side]) / NEAR_PIXELS) for side in "xywh"))
        for one in record.detail.get("persons", ())
    ]


def _said(run: RunRecords, record: TraceRecord | None) -> str:
    return "" if record is None else Narrator(run.history, run.wording).clause(record).told()


def _time(run: RunRecords, record: TraceRecord | None) -> float | None:
    return None if record is None else run.history.seconds(record.stamp)


# Context


def _names(first: RunRecords, second: RunRecords) -> tuple[str, str]:
    if first.title != second.title:
        return first.title, second.title
    return f"{first.title} (1)", f"{second.title} (2)"


def _count(kind: str, first: RunRecords, second: RunRecords) -> tuple[int, int]:
    one, other = (sum(record.kind == kind for record in run.history) for run in (first, second))
    return one, other


SETTINGS = ("graph", "runner", "composed", "parameters", "versions")
"""Keys of results.json that describe how a run was made."""

PLACES = ("folder", "mind_file", "memory_file")
"""Parameters that name files of a run."""


def _settings(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[Setting]:
    ours, theirs = dict(_flat(first)), dict(_flat(second))
    for name in sorted(ours.keys() | theirs.keys()):
        if ours.get(name) != theirs.get(name) and name.rpartition(".")[2] not in PLACES:
            yield Setting(name, ours.get(name), theirs.get(name))


def _flat(results: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    bag = results.get("bag")
    if isinstance(bag, Mapping):
        yield "bag", bag.get("path")
    for key in SETTINGS:
        yield from _leaves(key, results.get(key))


def _leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _leaves(f"{name}.{key}".removeprefix("parameters.").removeprefix("versions."), below)
    else:
        yield name, value
