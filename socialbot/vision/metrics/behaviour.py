"""Behaviour: what Waldo does with what a detector sees, and whether it was the right thing to do.

Waldo's own node runs on the detections in simulated time. It also runs on the truth, as if a detector saw everybody who
counts, and nobody else: what it does then is what is **due**.

*There* is who is visible to a quarter and within Waldo's ``range_m``. A *visit* lasts from the first such frame of a
person to the last, absences shorter than Waldo's ``vanish_s`` included, because who is hidden has not gone.

Greetings that are due are ``in time`` up to `GREET_S` after the visit began, then ``late`` until the visit ends; one
that never comes is ``missed``. A greeting that is not due goes to ``nobody`` when no person was in the picture in the
last second, is ``from afar`` when they were farther away than ``range_m`` and `RANGE_SLACK_M`, else it is said
``again``.

An offer of help comes ``too early`` when nobody had been there for ``help_after_s`` less `HELP_SLACK_S`, and to
``nobody`` as above. Offers that are due are ``in time`` up to `OFFER_S` after that moment, then ``late``, or
``missed``; any other is made ``again``.
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
"""What can become of a greeting and of an offer, in the order of tables."""


@dataclass(frozen=True)
class PersonVisit:
    """A person is there from ``begin`` to ``end`` (ns)."""

    person: str
    begin: int
    end: int


@dataclass(frozen=True)
class Act:
    """Something that Waldo did or should have done (``outcome`` "missed") at ``time`` (ns); ``delay_s`` where it was
    due.
    """

    deed: Deed
    outcome: str
    time: int
    delay_s: float | None = None


@dataclass(frozen=True)
class Behaviour:
    """What Waldo did in a recording, in the order of time, and the visits that there were."""

    acts: tuple[Act, ...]
    visits: tuple[PersonVisit, ...]

    def count(self, deed: Deed) -> dict[str, int]:
        """How often each outcome came about."""
        counts = Counter(act.outcome for act in self.acts if act.deed == deed)
        return {outcome: counts[outcome] for outcome in OUTCOMES[deed]}


@dataclass(frozen=True)
class _WaldoParameters:
    """What of Waldo's parameters is judged by."""

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
    """An act that is due: at ``time`` when the truth is known; in time until ``until``, allowed from ``begin`` to
    ``end``.
    """

    time: int
    onset: int
    begin: int
    until: int
    end: int


def single_node(graph: Graph, name: str) -> Graph:
    """A graph of the node called ``name`` alone, fed with detections."""
    return Graph(name, (graph.placement(name),), inputs=frozenset({DETECTIONS}))


def behaviour(graph: Graph, frames: Sequence[LabelledFrame], found: Iterable[FoundFrame]) -> Behaviour:
    """Judge what Waldo's node, the only one of ``graph``, does with detections, by the truth in ``frames``."""
    manners = _WaldoParameters.of(graph)
    seen = _acts(graph, (_message(each.stamp, each.width, each.height, each.persons) for each in found))
    due = _acts(graph, (_message(each.stamp, 1, 1, _ideal(each)) for each in frames))
    there = visits(frames, manners.range_m, manners.vanish_s)
    near = visits(frames, manners.range_m + RANGE_SLACK_M, manners.vanish_s)
    acts = [
        *_greetings(seen["greeting"], _due_greetings(due["greeting"], there, near), near, frames),
        *_offers(seen["offer"], _due_offers(due["offer"], there), near, frames, manners),
    ]
    return Behaviour(tuple(sorted(acts, key=lambda act: (act.time, act.deed))), tuple(there))


def visits(frames: Iterable[LabelledFrame], range_m: float, gap_s: float) -> list[PersonVisit]:
    """Who was there, within ``range_m``, from when to when; absences shorter than ``gap_s`` are passed over."""
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
    """When Waldo greets and offers help."""
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
    """What a detector without fault would see."""
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
    manners: _WaldoParameters,
) -> Iterable[Act]:
    enough = nanoseconds(manners.help_after_s - HELP_SLACK_S)
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
    """What became of the acts that were ``due``, and the ``times`` of those that were not."""
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
    """Whether the truth has a person in the picture, however little is visible, in the second before ``time``."""
    return any(frame.persons for frame in frames if time - nanoseconds(RECENT_S) <= frame.stamp <= time)
