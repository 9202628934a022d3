"""Waldo, who greets people and offers help without being asked.

The six steps of the paper's Algorithm 1, from top to bottom. Beliefs, desires and intentions have
the paper's names.
"""
# ruff: noqa: N801 - beliefs, goals and actions are written as the paper writes them

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean, median_low
from typing import NamedTuple

# 1. Import what agents are made of
from socialbot.bdi import Action, Belief, Engine, Goal, Sensed, Sensor, SingletonBelief, variables
from socialbot.bdi.literals import Event
from socialbot.core.clock import Clock, nanoseconds
from socialbot.core.messages import PersonDetections


# 2. Define beliefs and goals
class personDetected(SingletonBelief):
    """Whether somebody is there: "Yes", "No" (nobody for a while), "Next" (still there, what next?) or "Unknown".

    It is "Unknown" when Waldo has lost sight of people, until he sees again.
    """


class present(Belief):
    """One person is there: the id of their track, or `SOMEBODY`."""


class stays(Belief):
    """This person has been there for ``help_after_s``, and still is."""


class people(SingletonBelief):
    """How many came together."""


class greeted(Belief):
    """Those who are there have been greeted."""


class late(Belief):
    """This person came after help had been offered to those who were there."""


class silent(SingletonBelief):
    """Waldo does not see because this node is silent, or the topic of a camera outside, or the link to its machine."""


class DoNothing(Goal):
    """Leave the world in peace."""


class GreetPeople(Goal):
    """Greet those who have come."""


class OfferHelp(Goal):
    """Offer help to those who stay."""


@dataclass
class WaldoConfig:
    """What can be tuned while Waldo runs: distances in m, durations in s (see docs/waldo.md)."""

    range_m: float = 6.0
    appear_s: float = 0.5
    vanish_s: float = 2.5
    help_after_s: float = 8.0
    regreet_after_s: float = 5.0
    forget_after_s: float = 60.0


# 3. Define actions (and the sensor that perceives people)
class speak(Action):
    """Says the sentence for a situation."""

    def execute(self, situation: str) -> None:
        robot = self.engine.robot
        robot.act(self, situation, robot.sentence(situation))


class stayIdle(Action):
    """Says nothing and looks straight on."""

    def execute(self) -> None:
        self.engine.robot.act(self)


class attend(Action):
    """Says nothing, and follows people with the head."""

    def execute(self) -> None:
        self.engine.robot.act(self)


OVERTAKEN_S = 1.0
"""Frames that are older than the last one by no more come twice, or late; by more, time has begun anew."""

SOMEBODY = "somebody"
"""Where nobody tracks people, all of them together are one to Waldo."""


class Frame(NamedTuple):
    """One look at the world: when (ns), and an id for each person within range."""

    stamp: int
    near: tuple[str, ...]


class PersonSensor(Sensor):
    """Turns detections, which flicker, into the coming and going of people.

    A person is there when at least half of the frames of the last ``appear_s`` show them within
    ``range_m``, and gone when less than a quarter of the frames of the last ``vanish_s`` do. Who is seen
    after ``help_after_s`` stays.
    """

    def __init__(self, manners: WaldoConfig) -> None:
        self._manners = manners
        self._frames: deque[Frame] = deque()
        self._there: dict[str, int | None] = {}  # until when they must be there to stay; None when they do
        self._changed: dict[str, int] = {}  # when somebody came or left
        self._alone: bool | None = None  # not known at first, nor after Waldo has lost sight of people
        self._lost_at = 0
        self._asked = False

    def sense(self, percept: PersonDetections | None) -> Sensed:
        """What changes with these detections, or when there are no more (None)."""
        if percept is None:
            return self._lose_sight()
        if self._frames and 0 <= self._frames[-1].stamp - percept.stamp <= nanoseconds(OVERTAKEN_S):
            return None
        self._look(percept)
        told = [*self._leave(percept.stamp), *self._stay(percept.stamp), *self._come(percept.stamp)]
        if self._there and self._alone is not False:
            told += [+people(self._company()), +personDetected("Yes")]
            self._alone = False
        elif not self._there and (
            self._alone is False or (self._alone is None and self._share(self._manners.vanish_s) < 0.25)
        ):
            told += [+personDetected("No")]
            self._alone = True
            self._frames = deque([self._frames[-1]])  # who comes now has not been seen before
        return told or None

    def recall(self, engine: Engine) -> None:
        """Goes on from what was believed when the process ended: who is there, and who stays."""
        self._lost_at = engine.clock.now()
        staying = {one.belief.args[0] for one in engine.beliefs if isinstance(one.belief, stays)}
        for one in engine.beliefs:
            if isinstance(one.belief, present):
                who = str(one.belief.args[0])
                due = one.since + nanoseconds(self._manners.help_after_s)
                self._there[who] = None if who in staying else due
                self._changed[who] = self._lost_at
        if self._there:
            self._alone = False
        elif personDetected("No") in [one.belief for one in engine.beliefs]:
            self._alone = True

    def _lose_sight(self) -> Sensed:
        """Those who are there again when Waldo sees again are taken for the same, and are not asked twice."""
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
        return self._alone is None and self._asked and now < self._lost_at + nanoseconds(self._manners.forget_after_s)

    def _leave(self, now: int) -> Iterator[Event]:
        for who in [who for who in self._there if self._share(self._manners.vanish_s, who) < 0.25]:
            if self._there.pop(who) is None:
                yield -stays(who)
            self._changed[who] = now
            yield -present(who)

    def _stay(self, now: int) -> Iterator[Event]:
        for who, due in self._there.items():
            if due is not None and now >= due and self._share(self._manners.appear_s, who) > 0:
                self._there[who] = None
                yield +stays(who)

    def _come(self, now: int) -> Iterator[Event]:
        for who in dict.fromkeys(who for frame in self._frames for who in frame.near):
            if who not in self._there and self._share(self._manners.appear_s, who) >= 0.5:
                asked = self._asked_before(now)
                self._there[who] = None if asked else now + nanoseconds(self._manners.help_after_s)
                self._changed[who] = now
                yield +present(who)

    def _look(self, percept: PersonDetections) -> None:
        if self._frames and percept.stamp < self._frames[-1].stamp:
            # Time has begun anew: another recording, or a clock that was set.
            self._frames.clear()
            self._changed.clear()
            due = percept.stamp + nanoseconds(self._manners.help_after_s)
            self._there = {who: until and due for who, until in self._there.items()}
        near = [p for p in percept.persons if p.distance_m is None or p.distance_m <= self._manners.range_m]
        self._frames.append(Frame(percept.stamp, tuple(p.track_id or SOMEBODY for p in near)))
        oldest = percept.stamp - nanoseconds(max(self._manners.vanish_s, self._manners.appear_s))
        while len(self._frames) > 1 and self._frames[1].stamp <= oldest:
            self._frames.popleft()
        self._changed = {who: at for who, at in self._changed.items() if who in self._there or at >= oldest}

    def _recent(self, seconds: float) -> list[Frame]:
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        return [frame for frame in self._frames if frame.stamp >= begin]

    def _share(self, seconds: float, who: str = "") -> float:
        """The share of the frames of the last ``seconds`` that show ``who`` (or anybody).

        It is not a number as long as there are not so many frames since ``who`` came or left.
        """
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        if max(self._frames[0].stamp, self._changed.get(who, begin)) > begin:
            return math.nan
        return fmean(who in frame.near if who else bool(frame.near) for frame in self._recent(seconds))

    def _company(self) -> int:
        """How many people the frames show that show any."""
        return median_low(len(frame.near) for frame in self._recent(self._manners.appear_s) if frame.near)


def waldo(name: str, clock: Clock, manners: WaldoConfig, **connections: object) -> Engine:
    """Waldo's engine; ``connections`` are its robot, trace sink and wake-up (see `Engine`)."""
    # 4. Start the engine
    engine = Engine(name, clock, **connections)  # type: ignore[arg-type]

    # 5. Define rules: event / condition >> [steps]
    N, Who, _ = variables("N Who _")  # noqa: N806
    engine.add_rules(
        # Beliefs make desires ...
        +personDetected("No") >> [DoNothing()],
        +personDetected("Yes") >> [GreetPeople()],
        +stays(Who) / late(Who) >> [-late(_), OfferHelp()],
        +stays(Who) >> [+personDetected("Next")],
        +personDetected("Next") >> [OfferHelp()],
        # ... desires make intentions ...
        DoNothing() >> [stayIdle()],
        GreetPeople() / greeted() >> [],
        GreetPeople() / (people(N) & (N > 1)) >> [speak("greeting_several"), +greeted()],
        GreetPeople() >> [speak("greeting"), +greeted()],
        OfferHelp() >> [speak("offer")],
        # ... and when one cannot be carried out, Waldo does not insist.
        -GreetPeople() >> [stayIdle()],
        -OfferHelp() >> [stayIdle()],
        # Who has not heard the offer may need help as well.
        +present(Who) / personDetected("Next") >> [+late(Who)],
        -present(Who) / late(Who) >> [-late(Who)],
        # Who comes back after a while is greeted anew.
        +personDetected("No").held_for(lambda: manners.regreet_after_s) / greeted() >> [-greeted()],
        # Whom Waldo has lost sight of he leaves in peace; who is there when he sees again has stayed, as far as he can
        # know, and was greeted. But not for ever.
        +personDetected("Unknown") >> [-late(_), -stays(_), -present(_), -people(_), DoNothing()],
        personDetected("Yes").changed("Unknown") / greeted() >> [attend()],
        +personDetected("Unknown").held_for(lambda: manners.forget_after_s) / greeted() >> [-greeted()],
    )
    return engine


# 6. Run the engine: `waldo_node.WaldoNode` does, in a graph; `engine.run()` does in a program of its own.
