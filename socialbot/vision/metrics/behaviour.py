"""Score Waldo's greetings and offers of help, given the detections of a pipeline.

Waldo's node runs on the detections in simulated time. It also runs on the ground truth of all people who count; its
actions then are **due**.

A person is present if a quarter of them is visible within Waldo's ``range_m``. A *visit* lasts from the first to the
last frame of presence, including absences shorter than ``vanish_s``.

A due greeting is ``in time`` up to `GREET_S` after the start of the visit, then ``late`` until its end, or ``missed``.
Other greetings go to ``nobody`` if no person was in the image in the last second. They are ``from afar`` if all people
were beyond ``range_m`` plus `RANGE_SLACK_M`, and else repeated (``again``).

An offer of help is ``too early`` if no person was present for ``help_after_s`` less `HELP_SLACK_S`, and goes to
``nobody`` as above. A due offer is ``in time`` up to `OFFER_S` after that, then ``late``, or ``missed``. Any other one
is repeated (``again``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import ActionRequest, Message, PersonDetection, PersonDetections
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.pipeline import FoundFrame

__all__ = ["OUTCOMES", "Act", "Behaviour", "PersonVisit", "behaviour", "single_node", "visits"]

GREET_S = 1.0
OFFER_S = 1.5
HELP_SLACK_S = 1.0
RANGE_SLACK_M = 1.0
RECENT_S = 1.0

DETECTIONS = "/humans/bodies/detections"
ACTIONS = "/waldo/actions"

Deed = Literal["greeting", "offer"]

OUTCOMES: Mapping[Deed, tuple[str, ...]] = {
    "greeting": ("in time", "late", "missed", "nobody", "from afar", "again"),
    "offer": ("in time", "late", "missed", "too early", "nobody", "again"),
}
"""Outcomes of greetings and offers, in the order of the tables."""


@dataclass(frozen=True)
class PersonVisit:
    """Presence of a person from ``begin`` to ``end`` (ns)."""

    person: str
    begin: int
    end: int


@dataclass(frozen=True)
class Act:
    """Action of Waldo, or a missed one, at ``time`` (ns), with its delay if it was due."""

    deed: Deed
    outcome: str
    time: int
    delay_s: float | None = None


@dataclass(frozen=True)
class Behaviour:
    """Actions of Waldo in a recording in order of time, and the visits."""

    acts: tuple[Act, ...]
    visits: tuple[PersonVisit, ...]

    def count(self, deed: Deed) -> dict[str, int]:
        """Number of actions by outcome."""
        counts = Counter(act.outcome for act in self.acts if act.deed == deed)
        return {outcome: counts[outcome] for outcome in OUTCOMES[deed]}


@dataclass(frozen=True)
class _WaldoParameters:
    """Waldo's parameters that the rules need."""

    range_m: float
    vanish_s: float
    help_after_s: float

    @classmethod
    def of(cls, graph: Graph) -> _WaldoParameters:
        node = graph.placements[0]
        declared = node.type.parameters()
        values = (float(node.parameters.get(name, declared[name].default)) for name in cls.__dataclass_fields__)  # type: ignore[arg-type]
        return cls(*values)


@dataclass(frozen=True)
class _Due:
    """Due action: at ``time`` on the ground truth, in time until ``until``, valid from ``begin`` to ``end``."""

    time: int
    onset: int
    begin: int
    until: int
    end: int


def single_node(graph: Graph, name: str) -> Graph:
    """A graph of the node called ``name`` alone, fed with detections."""
    return Graph(name, (graph.placement(name),), inputs=frozenset({DETECTIONS}))


def behaviour(graph: Graph, frames: Sequence[LabelledFrame], found: Iterable[FoundFrame]) -> Behaviour:
    """Score the actions of Waldo's node, the only one of ``graph``, on detections by the ground truth ``frames``."""
    parameters = _WaldoParameters.of(graph)
    seen = _acts(graph, (_message(each.stamp, each.width, each.height, each.persons) for each in found))
    due = _acts(graph, (_message(each.stamp, 1, 1, _ideal(each)) for each in frames))
    there = visits(frames, parameters.range_m, parameters.vanish_s)
    near = visits(frames, parameters.range_m + RANGE_SLACK_M, parameters.vanish_s)
    acts = [
        *_greetings(seen["greeting"], _due_greetings(due["greeting"], there, near), near, frames),
        *_offers(seen["offer"], _due_offers(due["offer"], there), near, frames, parameters),
    ]
    return Behaviour(tuple(sorted(acts, key=lambda act: (act.time, act.deed))), tuple(there))


def visits(frames: Iterable[LabelledFrame], range_m: float, gap_s: float) -> list[PersonVisit]:
    """Visits within ``range_m``; absences shorter than ``gap_s`` do not end one."""
    ended: list[PersonVisit] = []
    going: dict[str, PersonVisit] = {}
    for frame in frames:
        for person in frame.persons:
            if not person.counts or (person.distance_m is not None and person.distance_m > range_m):
                continue
            visit = going.get(person.id)
            if visit is not None and frame.stamp - visit.end >= nanoseconds(gap_s):
                ended.append(visit)
                visit = None
            begin = frame.stamp if visit is None else visit.begin
            going[person.id] = PersonVisit(person.id, begin, frame.stamp)
    return sorted([*ended, *going.values()], key=lambda visit: (visit.begin, visit.end, visit.person))


def _acts(graph: Graph, messages: Iterable[PersonDetections]) -> dict[Deed, list[int]]:
    """Times of Waldo's greetings and offers."""
    times: dict[Deed, list[int]] = {"greeting": [], "offer": []}

    def note(topic: str, message: Message) -> None:
        if isinstance(message, ActionRequest) and message.name == "speak":
            deed: Deed = "offer" if str(message.arguments[0]).startswith("offer") else "greeting"
            times[deed].append(message.stamp)

    stream = iter(messages)
    first = next(stream, None)
    if first is None:
        return times
    runner = InlineRunner(graph, start=first.stamp)
    runner.tap(ACTIONS, note)
    runner.start()
    runner.feed(DETECTIONS, first)
    for message in stream:
        runner.feed(DETECTIONS, message)
    runner.close()
    return times


def _message(stamp: int, width: int, height: int, persons: tuple[PersonDetection, ...]) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="camera", width=width, height=height, persons=persons)


def _ideal(frame: LabelledFrame) -> tuple[PersonDetection, ...]:
    """Detections of a perfect detector."""
    return tuple(
        PersonDetection(
            x=person.box[0],
            y=person.box[1],
            w=person.box[2],
            h=person.box[3],
            score=1.0,
            track_id=person.id,
            distance_m=person.distance_m,
        )
        for person in frame.persons
        if person.counts
    )


def _due_greetings(times: Sequence[int], there: Sequence[PersonVisit], near: Sequence[PersonVisit]) -> list[_Due]:
    result: list[_Due] = []
    previous = -1
    for time in times:
        begun = [visit for visit in there if visit.begin <= time]
        # The visit that a greeting is for began after the last greeting, if any did.
        fresh = [visit for visit in begun if visit.begin > previous]
        onset = min(fresh, key=lambda visit: visit.begin) if fresh else max(begun, key=lambda visit: visit.begin)
        approach = [visit.begin for visit in near if visit.person == onset.person and visit.begin <= onset.begin]
        end = max([time, *(visit.end for visit in begun)])
        result.append(
            _Due(time, onset.begin, max(approach, default=onset.begin), onset.begin + nanoseconds(GREET_S), end)
        )
        previous = time
    return result


def _due_offers(times: Sequence[int], there: Sequence[PersonVisit]) -> list[_Due]:
    result = []
    for time in times:
        end = max([time, *(visit.end for visit in there if visit.begin <= time)])
        result.append(_Due(time, time, time - nanoseconds(HELP_SLACK_S), time + nanoseconds(OFFER_S), end))
    return result


def _greetings(
    times: Sequence[int], due: Sequence[_Due], near: Sequence[PersonVisit], frames: Sequence[LabelledFrame]
) -> Iterable[Act]:
    matched, rest = _matched("greeting", times, due)
    yield from matched
    for time in rest:
        if not _anybody(frames, time):
            outcome = "nobody"
        else:
            close = any(visit.begin <= time <= visit.end + nanoseconds(RECENT_S) for visit in near)
            outcome = "again" if close else "from afar"
        yield Act("greeting", outcome, time)


def _offers(
    times: Sequence[int],
    due: Sequence[_Due],
    near: Sequence[PersonVisit],
    frames: Sequence[LabelledFrame],
    parameters: _WaldoParameters,
) -> Iterable[Act]:
    enough = nanoseconds(parameters.help_after_s - HELP_SLACK_S)
    wrong: dict[int, str] = {}
    for time in times:
        stayed = [time - visit.begin for visit in near if visit.begin <= time <= visit.end + nanoseconds(RECENT_S)]
        if not _anybody(frames, time):
            wrong[time] = "nobody"
        elif max(stayed, default=0) < enough:
            wrong[time] = "too early"
    matched, rest = _matched("offer", [time for time in times if time not in wrong], due)
    yield from matched
    yield from (Act("offer", "again", time) for time in rest)
    yield from (Act("offer", outcome, time) for time, outcome in wrong.items())


def _matched(deed: Deed, times: Sequence[int], due: Sequence[_Due]) -> tuple[list[Act], list[int]]:
    """Match actions with due ones; returns the results and the times of unmatched actions."""
    rest = list(times)
    acts = []
    for number, item in enumerate(due):
        end = min([item.end, *(later.begin - 1 for later in due[number + 1 : number + 2])])
        time = next((time for time in rest if item.begin <= time <= max(end, item.until)), None)
        if time is None:
            acts.append(Act(deed, "missed", item.time))
        else:
            rest.remove(time)
            outcome = "in time" if time <= item.until else "late"
            acts.append(Act(deed, outcome, time, (time - item.onset) / SECOND))
    return acts, rest


def _anybody(frames: Sequence[LabelledFrame], time: int) -> bool:
    """Whether a person was in the image, however little visible, in the second before ``time``."""
    return any(frame.persons for frame in frames if time - nanoseconds(RECENT_S) <= frame.stamp <= time)
