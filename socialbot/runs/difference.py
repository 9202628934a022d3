"""Comparison of two runs: their first different decision and its causes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Narrator
from socialbot.runs.run import RunView
from socialbot.runs.why import Explanation, actions, explain

_LINES = (
    ("desire", "desire_refused", "desire_fulfilled", "desire_dropped"),
    ("plan_start", "plan_end"),
    ("step",),
)
"""Kinds whose order within an agent does not depend on other agents."""

DECIDED = {kind for kinds in _LINES for kind in kinds} | {
    *("planning", "step_end", "action", "action_end", "request", "asked", "refused", "reply", "silent", "heard", "said")
}
"""Kinds of records that are decisions or their results."""

NEAR_PIXELS = 0.5
"""Smaller differences of boxes come from rounding on other machines."""

T = TypeVar("T")


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
    def text(self) -> str:
        if self.difference:
            return f"Decisions differ from the recorded ones: {self.difference}"
        if self.exact:
            return f"All {self.recorded} decisions are those that were recorded, at the same times."
        return "All desires, plans and steps are those that were recorded, in the same order."


def compare(recorded: Iterable[TraceRecord], replayed: Iterable[TraceRecord]) -> DecisionComparison:
    """Compare the decisions of two runs."""
    first, second = ([record for record in run if record.kind in DECIDED] for run in (recorded, replayed))
    agents = sorted({record.source for record in (*first, *second)})
    found = (_difference(agent, kinds, first, second) for agent in agents for kinds in _LINES)
    return DecisionComparison(len(first), len(second), first == second, next(filter(None, found), ""))


def _difference(agent: str, kinds: Sequence[str], first: list[TraceRecord], second: list[TraceRecord]) -> str:
    before, now = (
        [_line(record) for record in records if record.source == agent and record.kind in kinds]
        for records in (first, second)
    )
    number = _first_mismatch(before, now, str.__eq__)
    if number is None:
        return ""
    one, other = _item(before, number), _item(now, number)
    if one is None or other is None:
        return f"{agent}: only {'recorded' if one else 'there now'}: {one or other!r}"
    return f"{agent}, number {number + 1}: {one!r} was recorded, now it is {other!r}"


def _line(record: TraceRecord) -> str:
    more = record.detail.get("steps", record.detail.get("outcome", ""))
    return " ".join(filter(None, (record.kind, record.what, "; ".join(more) if isinstance(more, list) else more)))


def _first_mismatch(first: Sequence[T], second: Sequence[T], same: Callable[[T, T], bool]) -> int | None:
    """Return the index of the first items that differ or that one sequence lacks; None for equal sequences."""
    pairs = enumerate(zip(first, second, strict=False))
    shorter = None if len(first) == len(second) else min(len(first), len(second))
    return next((number for number, pair in pairs if not same(*pair)), shorter)


def _item(items: Sequence[T], number: int) -> T | None:
    return items[number] if number < len(items) else None


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
                sides = (first, parting.first_s, parting.first), (second, parting.second_s, parting.second)
                for run, at_s, text in sides:
                    yield f"    {run}: {'nothing' if at_s is None else f'at {at_s:.2f} s {text}'}"
        if self.settings:
            yield "\nSet differently:"
            for setting in self.settings:
                yield f"  {setting.name}: {setting.first!r} | {setting.second!r}"
        if not self.same:
            yield "\nHow many:"
            for kind, (one, other) in self.counts.items():
                yield f"  {kind}: {one} | {other}"


def difference(first: RunView, second: RunView, names: tuple[str, str] | None = None) -> Difference:
    """Compare two runs agent by agent; independent agents may act in any order. ``names`` replace their titles."""
    both = (first, second)
    runs = names or _names(first, second)
    decided = [_decisions(run.history) for run in both]
    counts = {kind: _counts(both, kind) for kind in ("detection", "belief", "desire", "plan_start")}
    counts["action"] = (len(actions(first.history)), len(actions(second.history)))
    shown = {kind: pair for kind, pair in counts.items() if any(pair)}
    settings = tuple(_settings(first.results, second.results))
    sizes = (len(decided[0]), len(decided[1]))
    found = _first_decision(both, decided)
    if found is None:
        return Difference(True, runs, sizes, shown, settings)
    agent, number, one, other = found
    sides = (_side(runs[0], first, one), _side(runs[1], second, other))
    only_time = one is not None and other is not None and _essence(one) == _essence(other)
    causes = tuple(_partings(first, second, agent))
    name = first.wording.name(agent)
    return Difference(False, runs, sizes, shown, settings, number + 1, name, sides, only_time, causes)


def decision_digest(run: RunView) -> str:
    """Return a hash that is equal for runs with the same decisions at the same times."""
    digest = hashlib.sha256()
    for record in _decisions(run.history):
        digest.update(repr((_agent(run.history, record), _time(run, record), _essence(record))).encode())
    return digest.hexdigest()


def _decisions(history: History) -> list[TraceRecord]:
    acted = {id(record) for record in actions(history)}
    decided = DECIDED - {"action", "action_end", "said"}
    return [record for record in history if id(record) in acted or record.kind in decided]


def _first_decision(
    runs: tuple[RunView, RunView], decided: Sequence[Sequence[TraceRecord]]
) -> tuple[str, int, TraceRecord | None, TraceRecord | None] | None:
    first, second = runs
    of_agents: dict[str, tuple[list[TraceRecord], list[TraceRecord]]] = {}
    for place, records in enumerate(decided):
        for record in records:
            of_agents.setdefault(_agent(runs[place].history, record), ([], []))[place].append(record)
    found = []
    for agent, (one, other) in of_agents.items():
        number = _first_mismatch(
            one, other, lambda a, b: _essence(a) == _essence(b) and _time(first, a) == _time(second, b)
        )
        if number is not None:
            pair = _item(one, number), _item(other, number)
            times = [at_s for run, record in zip(runs, pair, strict=True) if (at_s := _time(run, record)) is not None]
            found.append((min(times), (agent, number, *pair)))
    return min(found, key=lambda each: each[0])[1] if found else None


def _agent(history: History, record: TraceRecord) -> str:
    cause = history.cause(record) if record.kind == "utterance" else None
    return record.source if cause is None else cause.source


def _essence(record: TraceRecord) -> tuple[Any, ...]:
    detail = record.detail
    steps = tuple(detail.get("steps", ())) if record.kind == "plan_start" else ()
    return record.kind, record.what, str(detail.get("outcome", "")), str(detail.get("reason", "")), steps


def _side(name: str, run: RunView, record: TraceRecord | None) -> Side:
    return Side(name, _time(run, record), None if record is None else explain(run.history, run.wording, record))


def _partings(first: RunView, second: RunView, agent: str) -> Iterator[Parting]:
    ours, theirs = ([record for record in run.history if record.kind == "detection"] for run in (first, second))
    yield from _parting("detections", first, second, ours, theirs, _boxes)
    ours, theirs = (
        [record for record in run.history if record.kind in ("belief", "unbelief") and record.source == agent]
        for run in (first, second)
    )
    what = f"beliefs of {first.wording.name(agent)}"
    yield from _parting(what, first, second, ours, theirs, lambda record: (record.kind, record.what))


def _parting(
    what: str,
    first: RunView,
    second: RunView,
    ours: Sequence[TraceRecord],
    theirs: Sequence[TraceRecord],
    essence: Callable[[TraceRecord], Any],
) -> Iterator[Parting]:
    number = _first_mismatch(
        ours, theirs, lambda a, b: _time(first, a) == _time(second, b) and essence(a) == essence(b)
    )
    if number is not None:
        one, other = _item(ours, number), _item(theirs, number)
        yield Parting(what, _sentence(first, one), _sentence(second, other), _time(first, one), _time(second, other))


def _boxes(record: TraceRecord) -> Any:
    return [
        (one.get("track_id"), *(round(float(one[side]) / NEAR_PIXELS) for side in "xywh"))
        for one in record.detail.get("persons", ())
    ]


def _sentence(run: RunView, record: TraceRecord | None) -> str:
    return "" if record is None else Narrator(run.wording, run.history).clause(record).sentence()


def _time(run: RunView, record: TraceRecord | None) -> float | None:
    return None if record is None else run.history.seconds(record.stamp)


# Context


def _names(first: RunView, second: RunView) -> tuple[str, str]:
    if first.title != second.title:
        return first.title, second.title
    return f"{first.title} (1)", f"{second.title} (2)"


def _counts(runs: tuple[RunView, RunView], kind: str) -> tuple[int, int]:
    one, other = (sum(record.kind == kind for record in run.history) for run in runs)
    return one, other


SETTINGS = ("graph", "runner", "composed", "parameters", "versions")
"""Keys of results.json that describe how a run was made."""

PLACES = ("folder", "mind_file", "memory_file")


def _settings(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[Setting]:
    if not (first and second):  # a run that has not ended says nothing of its settings
        return
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
