"""Waldo, an agent that greets people and offers help unasked.

The module follows the six steps of Algorithm 1 in the paper, with its names of beliefs, desires and intentions.
"""
# ruff: noqa: N801 - beliefs, goals and actions have the names of the paper

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean, median_low
from typing import NamedTuple

# 1. Import the parts of an agent
from socialbot.bdi import Action, Belief, Engine, Goal, Sensed, Sensor, SingletonBelief, variables
from socialbot.bdi.literals import Event
from socialbot.core.clock import Clock, nanoseconds
from socialbot.core.messages import PersonDetections


# 2. Define beliefs and goals
class personDetected(SingletonBelief):
    """Presence of people: "Yes", "No", "Next" (a person stays) or "Unknown" (no detections arrive)."""


class present(Belief):
    """A person is present; the argument is their track id, or `SOMEBODY`."""


class stays(Belief):
    """This person has been present for at least ``help_after_s``."""


class people(SingletonBelief):
    """Number of people who arrived together."""


class greeted(Belief):
    """The people present have been greeted."""


class late(Belief):
    """This person arrived after help was offered to the others."""


class silent(SingletonBelief):
    """Source of missing detections: a silent node, an external camera topic, or the link to a machine."""


class DoNothing(Goal):
    """Stay idle."""


class GreetPeople(Goal):
    """Greet the people who arrived."""


class OfferHelp(Goal):
    """Offer help to the people who stay."""


@dataclass
class WaldoConfig:
    """Configuration that may change at run time: distances in m, durations in s (see docs/waldo.md)."""

    range_m: float = 6.0
    appear_s: float = 0.5
    vanish_s: float = 2.5
    help_after_s: float = 8.0
    regreet_after_s: float = 5.0
    forget_after_s: float = 60.0


# 3. Define actions (and the sensor of people)
class speak(Action):
    """Say the sentence for a situation."""

    def execute(self, situation: str) -> None:
        robot = self.engine.robot
        robot.act(self, situation, robot.sentence(situation))


class stayIdle(Action):
    """Say nothing and centre the head."""

    def execute(self) -> None:
        self.engine.robot.act(self)


class attend(Action):
    """Say nothing and follow people with the head."""

    def execute(self) -> None:
        self.engine.robot.act(self)


OVERTAKEN_S = 1.0
"""Tolerance of stamps: frames older by no more are late or duplicate; older ones mean that the clock was reset."""

SOMEBODY = "somebody"  # track id of all people without one


class Frame(NamedTuple):
    """Track ids of the persons within range in one frame, with its stamp (ns)."""

    stamp: int
    near: tuple[str, ...]


class PersonSensor(Sensor):
    """Sensor of arrivals and departures, which filters flickering detections.

    A person arrives when at least half of the frames of the last ``appear_s`` show them within ``range_m``. A person
    leaves when fewer than a quarter of the frames of the last ``vanish_s`` do. A person present for ``help_after_s``
    stays.
    """

    def __init__(self, config: WaldoConfig) -> None:
        self._config = config
        self._frames: deque[Frame] = deque()
        self._there: dict[str, int | None] = {}  # time (ns) from which a person counts as staying; None if they stay
        self._changed: dict[str, int] = {}  # time (ns) of the last arrival or departure
        self._alone: bool | None = None  # None at first, and after a loss of detections
        self._lost_at = 0
        self._asked = False

    def sense(self, percept: PersonDetections | None) -> Sensed:
        """Return the belief changes of these detections; None means that no more arrive."""
        if percept is None:
            return self._lose_sight()
        if self._frames and 0 <= self._frames[-1].stamp - percept.stamp <= nanoseconds(OVERTAKEN_S):
            return None
        self._look(percept)
        changes = [*self._leave(percept.stamp), *self._stay(percept.stamp), *self._come(percept.stamp)]
        if self._there and self._alone is not False:
            changes += [+people(self._company()), +personDetected("Yes")]
            self._alone = False
        elif not self._there and (
            self._alone is False or (self._alone is None and self._share(self._config.vanish_s) < 0.25)
        ):
            changes += [+personDetected("No")]
            self._alone = True
            self._frames = deque([self._frames[-1]])  # a new arrival needs new frames
        return changes or None

    def recall(self, engine: Engine) -> None:
        """Restore present and staying people from the beliefs of an earlier run."""
        self._lost_at = engine.clock.now()
        staying = {one.belief.args[0] for one in engine.beliefs if isinstance(one.belief, stays)}
        for one in engine.beliefs:
            if isinstance(one.belief, present):
                person = str(one.belief.args[0])
                due = one.since + nanoseconds(self._config.help_after_s)
                self._there[person] = None if person in staying else due
                self._changed[person] = self._lost_at
        if self._there:
            self._alone = False
        elif personDetected("No") in [one.belief for one in engine.beliefs]:
            self._alone = True

    def _lose_sight(self) -> Sensed:
        """Reset the sensor. People who are present afterwards count as the same, and get no second offer."""
        if self._frames:
            self._lost_at = self._frames[-1].stamp
        if self._there:
            self._asked = None in self._there.values()
        somebody = self._alone is False
        if somebody:
            self._alone = None
        for known in (self._frames, self._there, self._changed):
            known.clear()
        return +personDetected("Unknown") if somebody else None

    def _asked_before(self, now: int) -> bool:
        return self._alone is None and self._asked and now < self._lost_at + nanoseconds(self._config.forget_after_s)

    def _leave(self, now: int) -> Iterator[Event]:
        for person in [person for person in self._there if self._share(self._config.vanish_s, person) < 0.25]:
            if self._there.pop(person) is None:
                yield -stays(person)
            self._changed[person] = now
            yield -present(person)

    def _stay(self, now: int) -> Iterator[Event]:
        for person, due in self._there.items():
            if due is not None and now >= due and self._share(self._config.appear_s, person) > 0:
                self._there[person] = None
                yield +stays(person)

    def _come(self, now: int) -> Iterator[Event]:
        for person in dict.fromkeys(person for frame in self._frames for person in frame.near):
            if person not in self._there and self._share(self._config.appear_s, person) >= 0.5:
                asked = self._asked_before(now)
                self._there[person] = None if asked else now + nanoseconds(self._config.help_after_s)
                self._changed[person] = now
                yield +present(person)

    def _look(self, percept: PersonDetections) -> None:
        if self._frames and percept.stamp < self._frames[-1].stamp:
            # The clock was reset: another recording, or a changed system time.
            self._frames.clear()
            self._changed.clear()
            due = percept.stamp + nanoseconds(self._config.help_after_s)
            self._there = {person: until and due for person, until in self._there.items()}
        near = [p for p in percept.persons if p.distance_m is None or p.distance_m <= self._config.range_m]
        self._frames.append(Frame(percept.stamp, tuple(p.track_id or SOMEBODY for p in near)))
        oldest = percept.stamp - nanoseconds(max(self._config.vanish_s, self._config.appear_s))
        while len(self._frames) > 1 and self._frames[1].stamp <= oldest:
            self._frames.popleft()
        self._changed = {person: at for person, at in self._changed.items() if person in self._there or at >= oldest}

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
        return fmean(person in frame.near if person else bool(frame.near) for frame in self._recent(seconds))

    def _company(self) -> int:
        """Median number of people in the recent frames with people."""
        return median_low(len(frame.near) for frame in self._recent(self._config.appear_s) if frame.near)


def waldo(name: str, clock: Clock, config: WaldoConfig, **connections: object) -> Engine:
    """Return the engine of Waldo; ``connections`` are its robot, trace sink and wake-up (see `Engine`)."""
    # 4. Start the engine
    engine = Engine(name, clock, **connections)  # type: ignore[arg-type]

    # 5. Define rules: event / condition >> [steps]
    N, Who, _ = variables("N Who _")  # noqa: N806
    engine.add_rules(
        # Beliefs cause desires ...
        +personDetected("No") >> [DoNothing()],
        +personDetected("Yes") >> [GreetPeople()],
        +stays(Who) / late(Who) >> [-late(_), OfferHelp()],
        +stays(Who) >> [+personDetected("Next")],
        +personDetected("Next") >> [OfferHelp()],
        # ... desires cause intentions ...
        DoNothing() >> [stayIdle()],
        GreetPeople() / greeted() >> [],
        GreetPeople() / (people(N) & (N > 1)) >> [speak("greeting_several"), +greeted()],
        GreetPeople() >> [speak("greeting"), +greeted()],
        OfferHelp() >> [speak("offer")],
        # ... and a failed intention is not retried.
        -GreetPeople() >> [stayIdle()],
        -OfferHelp() >> [stayIdle()],
        # People who missed the offer may need help too.
        +present(Who) / personDetected("Next") >> [+late(Who)],
        -present(Who) / late(Who) >> [-late(Who)],
        # People who return after a while are greeted again.
        +personDetected("No").held_for(lambda: config.regreet_after_s) / greeted() >> [-greeted()],
        # After a loss of detections Waldo waits. People present afterwards count as those greeted before, unless
        # ``forget_after_s`` has passed.
        +personDetected("Unknown") >> [-late(_), -stays(_), -present(_), -people(_), DoNothing()],
        personDetected("Yes").changed("Unknown") / greeted() >> [attend()],
        +personDetected("Unknown").held_for(lambda: config.forget_after_s) / greeted() >> [-greeted()],
    )
    return engine


# 6. Run the engine: `nodes.WaldoNode` does in a graph, `engine.run()` in a separate program.
