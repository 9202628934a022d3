"""Waldo, an agent that greets people and offers help unasked.

The module follows the six steps of Algorithm 1 in the paper, with its names of beliefs, desires and intentions.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean, median_low

from socialbot.agents.waldo.encounters import (
    PATH_S,
    Conversations,
    Frame,
    attention,
    in_base,
    is_undecided,
    may_join,
    newest_path,
    path_of,
    place_of,
    strides_of,
    telling,
    view_of,
)

# 1. Import the parts of an agent
from socialbot.bdi import (
    Action,
    Belief,
    Engine,
    Goal,
    Reactor,
    Sensed,
    Sensor,
    SingletonBelief,
    atomic,
    for_each,
    variables,
    when,
)
from socialbot.bdi.literals import Event
from socialbot.core.clock import SECOND, Clock, nanoseconds
from socialbot.core.messages import PersonDetections


# 2. Define beliefs and goals
class personDetected(SingletonBelief):
    """Presence of people: "Yes", "No", "Next" (a person stays) or "Unknown" (no detections arrive)."""


class present(Belief):
    """A person is present; the argument is their track id, or `SOMEBODY`."""


class stays(Belief):
    """This person has been present for at least ``help_after_s``."""


class engages(Belief):
    """This person is present and faces the robot, walks up to it, or stands before it; who only passes does not."""


class comes(Belief):
    """This person engages by walking up to the robot, and has not arrived yet."""


class converses(Belief):
    """This person stands with another one, and they face each other: Waldo leaves them alone."""


class greeted(Belief):
    """This person has been greeted."""


class hello(SingletonBelief):
    """Waldo is greeting somebody: people who appear meanwhile hear it."""


class hears(Belief):
    """This person was present at a greeting, less than ``together_s`` ago: if they join now, they have heard it."""


class offered(Belief):
    """This person has been offered help."""


class people(SingletonBelief):
    """Number of people in view when the first of them arrived."""


class gone(Belief):
    """This person has left, less than ``forget_after_s`` ago."""


class ungreeted(Belief):
    """This person engages and has not been greeted."""


class unoffered(Belief):
    """This person stays, engages, and has not been offered help."""


class delayed(Belief):
    """This person walks up while Waldo attends to others or others talk: the greeting waits for the arrival."""


class several(Belief):
    """More than one person waits for a greeting."""


class forgotten(Reactor):
    """This person left so long ago that they are greeted anew."""


class returned(Reactor):
    """A person arrived after a loss of detections or where this one vanished, and counts as the same."""


class silent(SingletonBelief):
    """Source of missing detections: a silent node, an external camera topic, or the link to a machine."""


class DoNothing(Goal):
    """Stay idle."""


class GreetPeople(Goal):
    """Greet the people who engage and have not been greeted."""


class OfferHelp(Goal):
    """Offer help to the people who stay and have had no offer."""


@dataclass
class WaldoConfig:
    """Configuration that may change at run time: distances in m, durations in s (see docs/waldo.md)."""

    range_m: float = 6.0
    engage_m: float = 50.0
    appear_s: float = 0.5
    vanish_s: float = 2.5
    help_after_s: float = 8.0
    together_s: float = 2.0
    regreet_after_s: float = 5.0
    forget_after_s: float = 60.0


# 3. Define actions (and the sensor of people)
class speak(Action):
    """Speak the sentence for a situation."""

    def execute(self, situation: str) -> None:
        robot = self.engine.robot
        robot.act(self, situation, robot.sentence(situation))


class SilentAction(Action):
    """Action of the body alone."""

    def execute(self) -> None:
        self.engine.robot.act(self)


class stayIdle(SilentAction):
    """Say nothing and centre the head."""


class attend(SilentAction):
    """Say nothing and follow people with the head."""


OVERTAKEN_S = 1.0
"""Tolerance of stamps: frames older by no more are late or duplicate; older ones mean that the clock was reset."""

SOMEBODY = "somebody"  # track id of all people without one

_RENAMED_S, _RENAMED_M = 4.0, 0.9  # a track that begins so soon and so near where another one ended goes on with it
_UNSEEN_S = 8.0  # a person outside of the view of a camera that turns counts as present for this long
_GAP_S = 0.7  # after so long out of view, only new frames of a person count
_GREETING_S = 1.0  # duration of a greeting
_DECIDE_S = 1.0  # after so long in view, a person can engage without a measured path


class PersonSensor(Sensor):
    """Sensor of arrivals, departures and attention, which filters flickering detections.

    A person arrives when at least half of the frames of the last ``appear_s`` show them within ``range_m``. A person
    leaves when fewer than a quarter of the frames of the last ``vanish_s`` do. If ``appear_s`` is shorter, half of its
    frames show that the person is back and does not leave. A person present for ``help_after_s`` stays.
    A person engages from the moment in which they are attentive in at least half of the last frames, until
    fewer than a quarter of them.
    """

    def __init__(self, config: WaldoConfig) -> None:
        self._config = config
        self._frames: deque[Frame] = deque()
        self._there: dict[str, int | None] = {}  # time (ns) from which a person counts as staying; None if they stay
        self._changed: dict[str, int] = {}  # time (ns) of the last arrival or departure
        self._engaged: set[str] = set()
        self._coming: set[str] = set()
        self._came: set[str] = set()  # those who engage, and have walked up to the robot
        self._in_view: dict[str, int] = {}  # time (ns) from which each of them has been in view without a gap
        # Whether faces are detected, so that one may be waited for; None until the detector or the first person tells.
        self._sees_faces: bool | None = None
        self._conversations = Conversations()
        self._seen_at: dict[str, int] = {}  # time (ns) of the last frame that shows each of them
        self._bearings: dict[str, float | None] = {}  # where each of them was last, from the robot's base,
        self._places: dict[str, tuple[float, float]] = {}  # and in m,
        self._strides: dict[str, tuple[float, float]] = {}  # and how they walked when they were lost from sight (m/s)
        self._gone: dict[str, int] = {}  # time (ns) at which each of them left
        self._lost: tuple[str, ...] = ()  # those present at the last loss of detections
        self._alone: bool | None = None  # None at first, and after a loss of detections
        self._lost_at = 0

    def sense(self, percept: PersonDetections | None) -> Sensed:
        """Return the belief changes of these detections; None means that no more arrive."""
        if percept is None:
            return self._lose_sight()
        if self._frames and 0 <= self._frames[-1].stamp - percept.stamp <= nanoseconds(OVERTAKEN_S):
            return None
        if self._alone is None and not self._frames:  # The loss is no absence; rules say how long it may last.
            self._gone |= {one: percept.stamp for one in self._lost if self._gone.get(one) == self._lost_at}
        self._look(percept)
        changes = [*self._leave(percept.stamp), *self._forget(percept.stamp), *self._come(percept.stamp)]
        if self._there and self._alone is not False:
            number = self._company()
            counted = f"a median of {number} in range in the frames of the last {self._config.appear_s:g} s with people"
            somebody = f"{', '.join(self._there)} {'is' if len(self._there) == 1 else 'are'} present"
            changes += [(+people(number)).because(counted), (+personDetected("Yes")).because(somebody)]
            self._alone = False
        elif not self._there and (
            self._alone is False or (self._alone is None and self._share(self._config.vanish_s) < 0.25)
        ):
            changes += [(+personDetected("No")).because(f"nobody is present: {self._shown('', self._config.vanish_s)}")]
            self._alone = True
            self._frames = deque([self._frames[-1]])  # a new arrival needs new frames
        changes += [*self._converse(), *self._attend(), *self._stay(percept.stamp)]
        return changes or None

    def recall(self, engine: Engine) -> None:
        """Restore present and staying people from the beliefs of an earlier run."""
        self._lost_at = engine.clock.now()
        since = {
            kind: {str(one.belief.args[0]): one.since for one in engine.beliefs if isinstance(one.belief, kind)}
            for kind in (present, stays, engages, comes, gone)
        }
        self._engaged, self._coming, self._gone = set(since[engages]), set(since[comes]), since[gone]
        for person, begin in since[present].items():
            due = begin + nanoseconds(self._config.help_after_s)
            self._there[person] = None if person in since[stays] else due
            self._changed[person] = self._lost_at
        if self._there:
            self._alone = False
        elif personDetected("No") in [one.belief for one in engine.beliefs]:
            self._alone = True

    def _lose_sight(self) -> Sensed:
        """Reset the sensor. People who are present afterwards count as the same."""
        if self._frames:
            self._lost_at = self._frames[-1].stamp
        somebody = self._alone is False
        if somebody:
            self._alone = None
        self._lost = tuple(self._there) or self._lost
        self._gone |= dict.fromkeys(self._there, self._lost_at)
        changes = [(+gone(person)).because("no more detections arrive") for person in self._there]
        for memory in (
            self._frames,
            self._there,
            self._changed,
            self._engaged,
            self._coming,
            self._came,
            self._in_view,
            self._conversations,
            self._bearings,
            self._places,
            self._strides,
            self._seen_at,
        ):
            memory.clear()
        return [*changes, (+personDetected("Unknown")).because("no more detections arrive")] if somebody else None

    def _leave(self, now: int) -> Iterator[Event]:
        for person in [person for person in self._there if self._has_left(person)]:
            why = self._shown(person, self._config.vanish_s)
            if self._there.pop(person) is None:
                yield (-stays(person)).because(why)
            for belief, people_of in ((engages, self._engaged), (comes, self._coming)):
                if person in people_of:
                    people_of.remove(person)
                    yield (-belief(person)).because(why)
            if self._conversations.forget(person):
                yield (-converses(person)).because(why)
            self._changed[person] = self._gone[person] = now
            yield from ((-present(person)).because(why), (+gone(person)).because(why))

    def _stay(self, now: int) -> Iterator[Event]:
        for person, due in self._there.items():
            if due is not None and now >= due and self._share(self._config.appear_s, person) > 0:
                self._there[person] = None
                yield (+stays(person)).because(f"{person} has been present for {self._config.help_after_s:g} s")

    def _forget(self, now: int) -> Iterator[Event]:
        for person, left in list(self._gone.items()):
            # Without ids nobody can be recognized, so a shorter absence counts.
            absence_s = self._config.regreet_after_s if person == SOMEBODY else self._config.forget_after_s
            if not 0 <= now - left < nanoseconds(absence_s):
                del self._gone[person]
                why = f"{person} left at least {absence_s:g} s ago"
                yield from ((-gone(person)).because(why), (+forgotten(person)).because(why))

    def _come(self, now: int) -> Iterator[Event]:
        lost = [one for one in self._lost if one in self._gone] if self._alone is None else []
        for person in dict.fromkeys(person for frame in self._frames for person in frame.near):
            if person not in self._there and self._share(self._config.appear_s, person) >= 0.5:
                other = None if person in self._gone else self._same_place(person, now)
                stays_at = now + nanoseconds(self._config.help_after_s)
                if other is not None:  # The same person under another id: the stay goes on.
                    stays_at = self._there.get(other, stays_at) or now
                self._there[person] = stays_at
                why = self._shown(person, self._config.appear_s)
                self._changed[person] = now
                yield (+present(person)).because(why)
                if self._gone.pop(person, None) is not None:
                    yield (-gone(person)).because(why)
                elif other is not None:
                    where = f"{person} is where {other} was seen {(now - self._seen_at[other]) / SECOND:.1f} s before"
                    yield (+returned(person, other)).because(where)
                else:
                    same = f"{person} is the first in sight since detections arrive again; {{}} was there before"
                    yield from ((+returned(person, one)).because(same.format(one)) for one in lost)

    def _has_left(self, person: str) -> bool:
        is_back = self._share(min(self._config.appear_s, self._config.vanish_s), person) >= 0.5
        return self._share(self._config.vanish_s, person) < 0.25 and not is_back

    def _same_place(self, person: str, now: int) -> str | None:
        """Return who vanished a moment ago where ``person`` has appeared, or on the way there, if there is one."""
        here = self._places.get(person)
        if here is None:
            return None
        near = []
        for other, (x, y) in self._places.items():
            if (
                other != person
                and other not in self._frames[-1].near
                and 0 < now - self._seen_at[other] < nanoseconds(_RENAMED_S)
            ):
                seconds = (now - self._seen_at[other]) / SECOND
                vx, vy = self._strides.get(other, (0.0, 0.0))
                near.append((math.dist(here, (x + vx * seconds, y + vy * seconds)), other))
        distance, other = min(near, default=(math.inf, None))
        return other if distance < _RENAMED_M else None

    def _converse(self) -> Iterator[Event]:
        self._came &= self._engaged
        visitors = self._came if self._sees_faces is False else ()
        for person, why, begins in self._conversations.look(self._frames, self._there, visitors):
            yield ((+converses(person)) if begins else (-converses(person))).because(why)

    def _attend(self) -> Iterator[Event]:
        frames, now = self._recent(max(self._config.appear_s, PATH_S)), self._frames[-1].stamp
        for person in self._there:
            looks = [look for frame in frames if (look := frame.near.get(person))]
            if not looks:
                continue
            engaged, placed = person in self._engaged, place_of(looks[-1]) is not None
            path = newest_path(path_of(frames, person), path_of(self._recent(_DECIDE_S), person), before=engaged)
            in_view = self._in_view.get(person, 0)
            is_new = now - max(self._changed.get(person, 0), in_view) < nanoseconds(_DECIDE_S)
            could_show = now - in_view < nanoseconds(_DECIDE_S)  # a face, for the first time
            faces = could_show if self._sees_faces is None else self._sees_faces
            hidden = placed and not engaged and person not in frames[-1].near
            if hidden or (is_new and is_undecided(looks[-1], path, faces=faces)):
                continue
            if placed and not faces:
                self._sees_faces = False
            stands = path is not None and not path.is_walk
            joins = stands and not faces and may_join(looks[-1], self._bystanders(person))
            if joins and not engaged:
                continue
            looks = telling(looks)
            judged = [attention(look, path, self._config.engage_m, faces=faces, before=engaged) for look in looks]
            share = fmean(attentive for attentive, _ in judged)
            shown = f"{share:.0%} of {len(looks)} frames".replace("%", " %")
            why = f"{person} {judged[-1][1]} ({shown})"
            if not engaged and share >= 0.5:
                self._engaged.add(person)
                if path.is_walk if path is not None else is_new and placed:
                    self._coming.add(person)
                    self._came.add(person)
                    yield (+comes(person)).because(why)
                yield (+engages(person)).because(why)
            elif engaged and (share < 0.25 or (joins and person in self._coming)):
                self._engaged.remove(person)
                yield (-engages(person)).because(why)
                yield from self._arrive(person, why)
            elif not path.is_walk if path is not None else not is_new:
                yield from self._arrive(person, why)

    def _bystanders(self, person: str) -> Iterator[tuple[float, float]]:
        """Places of other present people who do not attend to the robot and were in view a moment ago."""
        since = self._frames[-1].stamp - nanoseconds(_RENAMED_S)
        for other, place in self._places.items():
            if other in self._there and other not in {person, *self._engaged} and self._seen_at[other] > since:
                yield place

    def _arrive(self, person: str, why: str) -> Iterator[Event]:
        """Believe that a person has stopped walking up, or was not coming."""
        if person in self._coming:
            self._coming.remove(person)
            yield (-comes(person)).because(why)

    def _look(self, percept: PersonDetections) -> None:
        if self._frames and percept.stamp < self._frames[-1].stamp:
            # The clock was reset: another recording, or a changed system time.
            self._frames.clear()
            self._changed.clear()
            due = percept.stamp + nanoseconds(self._config.help_after_s)
            self._there = {person: until and due for person, until in self._there.items()}
        persons = [in_base(person, percept.camera_yaw_rad) for person in percept.known]
        near = [p for p in persons if p.distance_m is None or p.distance_m <= self._config.range_m]
        near.sort(key=lambda p: p.distance_m or math.inf, reverse=True)
        if percept.faces is False:
            self._sees_faces = False
        elif any(person.facing_rad is not None for person in persons):
            self._sees_faces = True
        by_id = {p.track_id or SOMEBODY: p for p in near}
        self._frames.append(Frame(percept.stamp, by_id, len(near), view_of(percept)))
        self._bearings |= {p.track_id or SOMEBODY: p.bearing_rad for p in near}
        self._places |= {p.track_id: place for p in near if p.track_id and (place := place_of(p))}
        before = self._frames[-2].near if len(self._frames) > 1 else {}
        self._strides |= {p: strides_of(self._recent(_DECIDE_S), p) for p in before if p not in by_id}
        for person in self._frames[-1].near:
            if person not in before and percept.stamp - self._seen_at.get(person, -math.inf) > nanoseconds(_GAP_S):
                self._in_view[person] = percept.stamp
        self._seen_at |= dict.fromkeys(self._frames[-1].near, percept.stamp)
        oldest = percept.stamp - nanoseconds(max(self._config.vanish_s, self._config.appear_s))
        while len(self._frames) > 1 and self._frames[1].stamp <= oldest:
            self._frames.popleft()
        self._changed = {person: at for person, at in self._changed.items() if person in self._there or at >= oldest}
        unseen = percept.stamp - nanoseconds(_UNSEEN_S)
        for person in [person for person, at in self._seen_at.items() if at < unseen and person not in self._there]:
            del self._seen_at[person], self._bearings[person]
            self._in_view.pop(person, None)
            self._places.pop(person, None)
            self._strides.pop(person, None)

    def _recent(self, seconds: float) -> list[Frame]:
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        return [frame for frame in self._frames if frame.stamp >= begin]

    def _share(self, seconds: float, person: str = "") -> float:
        """The share of frames of the last ``seconds`` that show ``person`` (or anybody).

        NaN until the frames cover that time since ``person`` arrived or left.
        """
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        if max(self._frames[0].stamp, self._changed.get(person, begin)) > begin:
            return math.nan
        frames = self._showing(seconds, person)
        # Of a person outside of the view of a camera that turns, nothing is known for a while.
        return fmean(person in frame.near if person else bool(frame.near) for frame in frames) if frames else math.nan

    def _showing(self, seconds: float, person: str) -> list[Frame]:
        """The frames of the last ``seconds`` that show ``person``, or would if the person were still there."""
        frames, now = self._recent(seconds), self._frames[-1].stamp
        if not person or now - self._seen_at.get(person, 0) >= nanoseconds(_UNSEEN_S):
            return frames
        bearing = self._bearings.get(person)
        return [frame for frame in frames if person in frame.near or frame.could_show(bearing)]

    def _shown(self, person: str, seconds: float) -> str:
        """Describe the share of frames of the last ``seconds`` that show ``person`` (or anybody) within range."""
        recent = self._showing(seconds, person)
        count = sum(person in frame.near if person else bool(frame.near) for frame in recent)
        shown = f"{count} of {len(recent)} frames of the last {seconds:g} s"
        return f"{person or 'somebody'} was within {self._config.range_m:g} m in {shown}"

    def _company(self) -> int:
        """Return the median number of people in the recent frames with people."""
        return median_low(frame.persons for frame in self._recent(self._config.appear_s) if frame.persons)


def waldo(name: str, clock: Clock, config: WaldoConfig, **connections: object) -> Engine:
    """Return the engine of Waldo; ``connections`` are its robot, trace sink and wake-up (see `Engine`)."""
    # 4. Start the engine
    engine = Engine(name, clock, **connections)  # type: ignore[arg-type]

    # 5. Define rules: event / condition >> [steps]
    Who, Other, N, _ = variables("Who Other N _")  # noqa: N806
    engine.add_rules(
        # Beliefs cause desires ...
        +personDetected("No") >> [DoNothing()],
        atomic(
            +engages(Who) / (ungreeted(Who) & hears(Who)) >> [+greeted(Who)],
            +engages(Who) / (ungreeted(Who) & delayed(Who)) >> [],
            +engages(Who) / ungreeted(Who) >> [GreetPeople(), when(unoffered(Who), [OfferHelp()])],
            +engages(Who) / unoffered(Who) >> [OfferHelp()],
            -comes(Who) / ungreeted(Who) >> [GreetPeople(), when(unoffered(Who), [OfferHelp()])],
            +stays(Who) / (personDetected("Next") & unoffered(Who)) >> [OfferHelp()],
            +stays(Who) / personDetected("Yes") >> [+personDetected("Next")],
            +personDetected("Next") / unoffered(_) >> [OfferHelp()],
            -engages(Other) / (ungreeted(Who) & ~delayed(Who)) >> [GreetPeople()],
            -converses(Who) / ungreeted(Who) >> [GreetPeople(), when(unoffered(Who), [OfferHelp()])],
            -converses(Who) / unoffered(Who) >> [OfferHelp()],
        ),
        # People who talk to each other are not interrupted.
        ungreeted(Who) << (engages(Who) & ~converses(Who) & ~greeted(Who)),
        unoffered(Who) << (engages(Who) & ~converses(Who) & stays(Who) & ~offered(Who)),
        # While Waldo attends to others, or others talk, those who walk up are greeted when they arrive: they may pass.
        delayed(Who) << (comes(Who) & engages(Other) & greeted(Other)),
        delayed(Who) << (comes(Who) & converses(_)),
        several() << (ungreeted(Who) & ungreeted(Other) & (Who != Other)),
        several() << (ungreeted(SOMEBODY) & people(N) & (N > 1)),
        # ... desires cause intentions ...
        DoNothing() >> [stayIdle()],
        GreetPeople() / several() >> [speak("greeting_several"), for_each(ungreeted(Who), [+greeted(Who)])],
        GreetPeople() >> [speak("greeting"), for_each(ungreeted(Who), [+greeted(Who)])],
        # People hear a greeting if they are present, or if they appear while it is said.
        +greeted(Who) / ((Who != SOMEBODY) & ~hears(Who))
        >> [+hello("said"), for_each(present(Other), [+hears(Other)])],
        +present(Who) / ((Who != SOMEBODY) & hello("said")) >> [+hears(Who)],
        +hello("said").held_for(_GREETING_S) >> [-hello("said")],
        +hears(Who).held_for(lambda: config.together_s) >> [-hears(Who)],
        OfferHelp() >> [speak("offer"), for_each(engages(Who) & ~offered(Who), [+offered(Who)])],
        # ... and a failed intention is not retried.
        -GreetPeople() >> [stayIdle()],
        -OfferHelp() >> [stayIdle()],
        # People who return after a while are greeted again.
        atomic(+forgotten(Who) >> [-greeted(Who), -offered(Who)]),
        # After a loss of detections Waldo waits. People present afterwards count as those present before.
        +personDetected("Unknown")
        >> [-stays(_), -engages(_), -comes(_), -converses(_), -present(_), -people(_), DoNothing()],
        atomic(+returned(Who, Other) >> [when(greeted(Other), [+greeted(Who)]), when(offered(Other), [+offered(Who)])]),
        personDetected("Yes").changed("Unknown") / greeted(_) >> [attend()],
        +personDetected("Unknown").held_for(lambda: config.forget_after_s) >> [-gone(_), -greeted(_), -offered(_)],
    )
    return engine


# 6. Run the engine: `nodes.WaldoNode` does in a graph, `engine.run()` in a separate program.
