"""Score Waldo's greetings and offers of help by visitor, given the detections of a pipeline.

Waldo's node runs on the detections in simulated time. What it should do follows from the ground truth alone.

A person is present if a quarter of them is visible within Waldo's ``range_m``. A *visit* lasts from the first to the
last frame of presence, including absences shorter than ``vanish_s``. A visitor *engages* from the first `ENGAGES_S` in
which they face the robot (`FACES_RAD`), or, where the truth does not say so, stand or walk towards it. A visitor who
returns within `RETURN_S` is not new.

A greeting is due to each new visitor who engages. A greeting addresses all visitors present. The visitor is greeted
``in time`` up to `GREET_S` after the begin of engaging, then ``late`` until the end of the visit, or ``missed``. Any
other greeting goes to ``nobody`` if no person was in the image in the last second. It is ``from afar`` if all people
were beyond ``range_m`` plus `RANGE_SLACK_M`, ``passing`` if it addresses a new visitor who did not engage, and else
repeated (``again``).

An offer of help is due to each new visitor who engages and is present for ``help_after_s``. The visitor is served ``in
time`` by an offer up to `OFFER_S` after that, then ``late``, or ``missed``. Any other offer goes to ``nobody``, as
above, is ``too early`` if no person was present for ``help_after_s`` less `HELP_SLACK_S`, and else repeated
(``again``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any, Literal

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import ActionRequest, Message, PersonDetections
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.pipeline import FoundFrame
from socialbot.vision.metrics.truth import Person, TruthPerson

ENGAGES_S = 0.5
FACES_RAD = 1.05
WALKS_MPS = 0.3
PERSON_M, PERSON_ASPECT = 1.7, 2.5
RETURN_S = 60.0
GREET_S = 1.0
OFFER_S = 1.5
HELP_SLACK_S = 1.0
RANGE_SLACK_M = 1.0
RECENT_S = 1.0

DETECTIONS = "/humans/bodies/detections"

Deed = Literal["greeting", "offer"]

OUTCOMES: Mapping[Deed, tuple[str, ...]] = {
    "greeting": ("in time", "late", "missed", "nobody", "from afar", "passing", "again"),
    "offer": ("in time", "late", "missed", "too early", "nobody", "again"),
}
"""Outcomes of greetings and offers, in the order of the tables."""


@dataclass(frozen=True)
class PersonVisit:
    """Presence of a person from ``begin`` to ``end``; they engage from ``engages`` on, if at all (ns)."""

    person: str
    begin: int
    end: int
    engages: int | None = None


@dataclass(frozen=True)
class Act:
    """Action of Waldo as one visitor has it, or a missed one, at ``time`` (ns), with its delay if it was due."""

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


def single_node(graph: Graph, name: str) -> Graph:
    """A graph of the node called ``name`` alone, fed with detections."""
    return Graph(name, (graph.node(name),), inputs=frozenset({DETECTIONS}))


def behaviour(graph: Graph, frames: Sequence[LabelledFrame], found: Iterable[FoundFrame]) -> Behaviour:
    """Score the actions of Waldo's node, the only one of ``graph``, on detections by the ground truth ``frames``."""
    node = graph.nodes[0]
    values: dict[str, Any] = {name: each.default for name, each in node.type.parameters().items()}
    values |= node.parameters
    range_m, vanish_s, help_after_s = (float(values[name]) for name in ("range_m", "vanish_s", "help_after_s"))
    spoken = _acts(graph, (_message(each) for each in found))
    scene = _Scene(visits(frames, range_m, vanish_s), visits(frames, range_m + RANGE_SLACK_M, vanish_s), frames)
    acts = [*_greetings(spoken["greeting"], scene), *_offers(spoken["offer"], scene, help_after_s)]
    return Behaviour(tuple(sorted(acts, key=lambda act: (act.time, act.deed))), tuple(scene.visits))


def visits(frames: Iterable[LabelledFrame], range_m: float, gap_s: float) -> list[PersonVisit]:
    """Visits within ``range_m``; absences shorter than ``gap_s`` do not end one."""
    shown: dict[str, list[list[tuple[int, Person]]]] = {}
    for frame in frames:
        for person in frame.persons:
            if not person.counts or (person.distance_m is not None and person.distance_m > range_m):
                continue
            stays = shown.setdefault(person.id, [])
            if not stays or frame.stamp - stays[-1][-1][0] >= nanoseconds(gap_s):
                stays.append([])
            stays[-1].append((frame.stamp, person))
    result = [
        PersonVisit(name, stay[0][0], stay[-1][0], _engages(stay)) for name, stays in shown.items() for stay in stays
    ]
    return sorted(result, key=lambda visit: (visit.begin, visit.end, visit.person))


def _engages(stay: Sequence[tuple[int, Person]]) -> int | None:
    """Begin of the first `ENGAGES_S` of a stay in which the person engages."""
    first = 0
    for last, (stamp, _) in enumerate(stay):
        while stamp - stay[first + 1][0] >= nanoseconds(ENGAGES_S) if first < last else False:
            first += 1
        if stamp - stay[first][0] >= nanoseconds(ENGAGES_S) and _is_engaged(stay[first : last + 1]):
            return stay[first][0]
    return None


def _is_engaged(looks: Sequence[tuple[int, Person]]) -> bool:
    facings = [person.facing_rad for _, person in looks if isinstance(person, TruthPerson)]
    known = [facing for facing in facings if facing is not None]
    if known:
        return median(known) <= FACES_RAD
    (begin, first), (end, last) = looks[0], looks[-1]
    seconds = (end - begin) / SECOND
    metres_per_pixel = PERSON_M / max((first.h + last.h) / 2, PERSON_ASPECT * (first.w + last.w) / 2, 1.0)
    sideways_mps = abs(last.x + last.w / 2 - first.x - first.w / 2) * metres_per_pixel / seconds
    if first.distance_m is None or last.distance_m is None:
        return sideways_mps <= WALKS_MPS
    approach_mps = (first.distance_m - last.distance_m) / seconds
    return approach_mps >= sideways_mps if max(sideways_mps, approach_mps) > WALKS_MPS else approach_mps >= -WALKS_MPS


@dataclass(frozen=True)
class _Scene:
    """Visits within Waldo's range, and within a larger one; all people in ``frames``."""

    visits: Sequence[PersonVisit]
    near: Sequence[PersonVisit]
    frames: Sequence[LabelledFrame]

    @cached_property
    def new(self) -> list[PersonVisit]:
        """The visits of people who were not there within `RETURN_S` before."""
        ends: dict[str, int] = {}
        result: list[PersonVisit] = []
        for visit in self.visits:
            if visit.begin - ends.get(visit.person, visit.begin - nanoseconds(RETURN_S)) >= nanoseconds(RETURN_S):
                result.append(visit)
            ends[visit.person] = visit.end
        return result

    def approach(self, visit: PersonVisit) -> int:
        """Begin of the visit in the larger range."""
        begins = [near.begin for near in self.near if near.person == visit.person and near.begin <= visit.begin]
        return max(begins, default=visit.begin)

    def anybody(self, time: int) -> bool:
        """Whether a person was in the image, however little visible, in the second before ``time``."""
        return any(frame.persons for frame in self.frames if time - nanoseconds(RECENT_S) <= frame.stamp <= time)


def _acts(graph: Graph, messages: Iterable[PersonDetections]) -> dict[Deed, list[int]]:
    """Times of Waldo's greetings and offers."""
    times: dict[Deed, list[int]] = {"greeting": [], "offer": []}

    def note(topic: str, message: Message) -> None:
        if isinstance(message, ActionRequest) and message.name == "speak":
            deed: Deed = "offer" if str(message.arguments[0]).startswith("offer") else "greeting"
            times[deed].append(message.stamp)

    topics = [topic for topic, port in graph.nodes[0].publications if port.message_type is ActionRequest]
    runner = None
    for message in messages:
        if runner is None:
            runner = InlineRunner(graph, start=message.stamp)
            for topic in topics:
                runner.tap(topic, note)
            runner.start()
        runner.feed(DETECTIONS, message)
    if runner is not None:
        runner.close()
    return times


def _message(found: FoundFrame) -> PersonDetections:
    return PersonDetections(
        stamp=found.stamp,
        frame_id="camera",
        width=found.width,
        height=found.height,
        persons=tuple(found.persons),
        camera_yaw_rad=found.camera_yaw_rad,
        camera_hfov_rad=found.camera_hfov_rad,
        faces=found.faces,
    )


def answer_to(engages: int, heard: Sequence[int], within_s: float) -> int | None:
    """Return which of the sentences ``heard`` during a visit answers a visitor who ``engages``; None without any.

    That is the next one, or one from up to ``within_s`` before if the next one comes later than that. If there is no
    next one, it is the last one before. Times are stamps (ns).
    """
    begin, end = engages - nanoseconds(within_s), engages + nanoseconds(within_s)
    early = [time for time in heard if begin <= time < engages]
    later = min((time for time in heard if time >= engages), default=None)
    if early and (later is None or later > end):
        return early[-1]
    return max(heard, default=None) if later is None else later


def _greetings(times: Sequence[int], scene: _Scene) -> Iterable[Act]:
    useful: set[int] = set()
    for visit in scene.new:
        if visit.engages is None:
            continue
        # A greeting counts from the approach on; who arrives beside others hears theirs.
        begin, end = scene.approach(visit), visit.end + nanoseconds(RECENT_S)
        time = answer_to(visit.engages, [time for time in times if begin <= time <= end], GREET_S)
        if time is None:
            yield Act("greeting", "missed", visit.engages)
        else:
            useful.add(time)
            delay_s = max(0.0, (time - visit.engages) / SECOND)
            yield Act("greeting", "in time" if delay_s <= GREET_S else "late", time, delay_s)
    greeted: set[PersonVisit] = set()
    for time in times:
        addressed = _current(scene.near, time)
        if time not in useful:
            passing = [visit for visit in _current(scene.new, time) if visit.engages is None and visit not in greeted]
            if not scene.anybody(time):
                yield Act("greeting", "nobody", time)
            elif not addressed:
                yield Act("greeting", "from afar", time)
            else:
                yield Act("greeting", "passing" if passing else "again", time)
        greeted |= set(_current(scene.new, time))


def _offers(times: Sequence[int], scene: _Scene, help_after_s: float) -> Iterable[Act]:
    patience, least = nanoseconds(help_after_s), nanoseconds(help_after_s - HELP_SLACK_S)
    wrong: dict[int, str] = {}
    for time in times:
        if not scene.anybody(time):
            wrong[time] = "nobody"
        elif max((time - visit.begin for visit in _current(scene.near, time)), default=0) < least:
            wrong[time] = "too early"
    right = [time for time in times if time not in wrong]
    useful: set[int] = set()
    for visit in scene.new:
        onset = max(visit.begin + patience, visit.engages or 0)
        if visit.engages is None or onset > visit.end:
            continue
        time = next(
            (time for time in right if visit.begin <= time <= max(visit.end, onset + nanoseconds(OFFER_S))), None
        )
        if time is None:
            yield Act("offer", "missed", onset)
        else:
            useful.add(time)
            delay_s = max(0.0, (time - onset) / SECOND)
            yield Act("offer", "in time" if delay_s <= OFFER_S else "late", time, delay_s)
    for time in times:
        if time not in useful:
            yield Act("offer", wrong.get(time, "again"), time)


def _current(visits: Sequence[PersonVisit], time: int) -> list[PersonVisit]:
    return [visit for visit in visits if visit.begin <= time <= visit.end + nanoseconds(RECENT_S)]
