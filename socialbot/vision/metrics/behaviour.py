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
from typing import Any, Literal, NamedTuple

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import ActionRequest, Message, PersonDetection, PersonDetections
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.pipeline import FoundFrame
from socialbot.vision.metrics.truth import Person

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


class _Due(NamedTuple):
    """Due action: at ``time`` on the ground truth, in time until ``until``, valid from ``begin`` to ``end``."""

    time: int
    onset: int
    begin: int
    until: int
    end: int


def single_node(graph: Graph, name: str) -> Graph:
    """A graph of the node called ``name`` alone, fed with detections."""
    return Graph(name, (graph.node(name),), inputs=frozenset({DETECTIONS}))


def behaviour(graph: Graph, frames: Sequence[LabelledFrame], found: Iterable[FoundFrame]) -> Behaviour:
    """Score the actions of Waldo's node, the only one of ``graph``, on detections by the ground truth ``frames``."""
    node = graph.nodes[0]
    values: dict[str, Any] = {name: each.default for name, each in node.type.parameters().items()}
    values |= node.parameters
    range_m, vanish_s, help_after_s = (float(values[name]) for name in ("range_m", "vanish_s", "help_after_s"))
    seen = _acts(graph, (_message(each.stamp, each.width, each.height, each.persons) for each in found))
    due = _acts(
        graph,
        (_message(each.stamp, 1, 1, (_ideal(person) for person in each.persons if person.counts)) for each in frames),
    )
    there = visits(frames, range_m, vanish_s)
    near = visits(frames, range_m + RANGE_SLACK_M, vanish_s)
    slack, offer = nanoseconds(HELP_SLACK_S), nanoseconds(OFFER_S)
    due_offers = [_Due(time, time, time - slack, time + offer, _last_end(there, time)) for time in due["offer"]]
    acts = [
        *_greetings(seen["greeting"], _due_greetings(due["greeting"], there, near), near, frames),
        *_offers(seen["offer"], due_offers, near, frames, help_after_s - HELP_SLACK_S),
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

    runner = None
    for message in messages:
        if runner is None:
            runner = InlineRunner(graph, start=message.stamp)
            runner.tap(ACTIONS, note)
            runner.start()
        runner.feed(DETECTIONS, message)
    if runner is not None:
        runner.close()
    return times


def _message(stamp: int, width: int, height: int, persons: Iterable[PersonDetection]) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="camera", width=width, height=height, persons=tuple(persons))


def _ideal(person: Person) -> PersonDetection:
    box = dict(zip("xywh", person.box, strict=True))
    return PersonDetection(**box, score=1.0, track_id=person.id, distance_m=person.distance_m)


def _due_greetings(times: Sequence[int], there: Sequence[PersonVisit], near: Sequence[PersonVisit]) -> list[_Due]:
    result: list[_Due] = []
    for previous, time in zip([-1, *times], times, strict=False):
        begun = [visit for visit in there if visit.begin <= time]
        # The visit that a greeting is for began after the last greeting, if any did.
        fresh = [visit for visit in begun if visit.begin > previous]
        onset = min(fresh, key=lambda visit: visit.begin) if fresh else max(begun, key=lambda visit: visit.begin)
        approach = [visit.begin for visit in near if visit.person == onset.person and visit.begin <= onset.begin]
        until, begin = onset.begin + nanoseconds(GREET_S), max(approach, default=onset.begin)
        result.append(_Due(time, onset.begin, begin, until, _last_end(there, time)))
    return result


def _last_end(visits: Iterable[PersonVisit], time: int) -> int:
    """Latest end of the visits that have begun at ``time``."""
    return max([time, *(visit.end for visit in visits if visit.begin <= time)])


def _greetings(
    times: Sequence[int], due: Sequence[_Due], near: Sequence[PersonVisit], frames: Sequence[LabelledFrame]
) -> Iterable[Act]:
    matched, rest = _matched("greeting", times, due)
    yield from matched
    for time in rest:
        outcome = "again" if _current(near, time) else "from afar"
        yield Act("greeting", outcome if _anybody(frames, time) else "nobody", time)


def _offers(
    times: Sequence[int],
    due: Sequence[_Due],
    near: Sequence[PersonVisit],
    frames: Sequence[LabelledFrame],
    least_s: float,
) -> Iterable[Act]:
    wrong: dict[int, str] = {}
    for time in times:
        if not _anybody(frames, time):
            wrong[time] = "nobody"
        elif max((time - visit.begin for visit in _current(near, time)), default=0) < nanoseconds(least_s):
            wrong[time] = "too early"
    matched, rest = _matched("offer", [time for time in times if time not in wrong], due)
    yield from matched
    yield from (Act("offer", wrong.get(time, "again"), time) for time in (*rest, *wrong))


def _current(visits: Sequence[PersonVisit], time: int) -> list[PersonVisit]:
    return [visit for visit in visits if visit.begin <= time <= visit.end + nanoseconds(RECENT_S)]


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
