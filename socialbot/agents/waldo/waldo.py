"""Waldo, who greets people and offers help without being asked.

The six steps of the paper's Algorithm 1, from top to bottom. Beliefs, desires and intentions have
the paper's names.
"""
# ruff: noqa: N801 - beliefs, goals and actions are written as the paper writes them

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median_low

# 1. Import what agents are made of
from socialbot.bdi import Action, Belief, Engine, Goal, Sensed, Sensor, SingletonBelief, variables
from socialbot.clock import Clock, nanoseconds
from socialbot.messages import PersonDetections


# 2. Define beliefs and goals
class personDetected(SingletonBelief):
    """Whether somebody is there: "Yes", "No" (nobody for a while) or "Next" (still there, what next?)."""


class people(SingletonBelief):
    """How many came together."""


class greeted(Belief):
    """Those who are there have been greeted."""


class DoNothing(Goal):
    """Leave the world in peace."""


class GreetPeople(Goal):
    """Greet those who have come."""


class OfferHelp(Goal):
    """Offer help to those who stay."""


@dataclass
class Manners:
    """What can be tuned while Waldo runs: distances in m, durations in s (see docs/waldo.md)."""

    range_m: float = 6.0
    appear_s: float = 0.5
    vanish_s: float = 2.5
    help_after_s: float = 8.0
    regreet_after_s: float = 5.0


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


class PersonSensor(Sensor):
    """Turns detections, which flicker, into the coming and going of people.

    Somebody is there when at least half of the frames of the last ``appear_s`` show a person within
    ``range_m``; nobody is there when less than a quarter of the frames of the last ``vanish_s`` do.
    """

    def __init__(self, manners: Manners) -> None:
        self._manners = manners
        self._present: bool | None = None
        self._frames: deque[tuple[int, int]] = deque()

    def sense(self, percept: PersonDetections) -> Sensed:
        near = [p for p in percept.persons if p.distance_m is None or p.distance_m <= self._manners.range_m]
        if self._frames and percept.stamp < self._frames[-1][0]:
            self._frames.clear()  # Time has begun anew: another recording, or a clock that was set.
        self._frames.append((percept.stamp, len(near)))
        self._forget(max(self._manners.vanish_s, self._manners.appear_s))
        recent = self._last(self._manners.appear_s)
        if not self._present and any(recent) and 2 * seen(recent) >= len(recent):
            self._present = True
            self._forget(0.0)
            return [people(median_low(filter(None, recent))), personDetected("Yes")]
        recent = self._last(self._manners.vanish_s)
        if self._present is not False and recent and 4 * seen(recent) < len(recent):
            self._present = False
            self._forget(0.0)
            return personDetected("No")
        return None

    def _last(self, seconds: float) -> list[int]:
        """How many people each frame of the last ``seconds`` showed; nothing as long as there are not so many."""
        newest, oldest = self._frames[-1][0], self._frames[0][0]
        if newest - oldest < nanoseconds(seconds):
            return []
        return [count for stamp, count in self._frames if stamp >= newest - nanoseconds(seconds)]

    def _forget(self, seconds: float) -> None:
        begin = self._frames[-1][0] - nanoseconds(seconds)
        while len(self._frames) > 1 and self._frames[1][0] <= begin:
            self._frames.popleft()


def seen(frames: list[int]) -> int:
    """How many of the frames show somebody."""
    return sum(count > 0 for count in frames)


def waldo(name: str, clock: Clock, manners: Manners, **connections: object) -> Engine:
    """Waldo's engine; ``connections`` are its robot, trace sink and wake-up (see `Engine`)."""
    # 4. Start the engine
    engine = Engine(name, clock, **connections)  # type: ignore[arg-type]

    # 5. Define rules: event / condition >> [steps]
    N, _ = variables("N _")  # noqa: N806
    engine.add_rules(
        # Beliefs make desires ...
        +personDetected("No") >> [DoNothing()],
        +personDetected("Yes") >> [GreetPeople()],
        +personDetected("Yes").held_for(lambda: manners.help_after_s) >> [+personDetected("Next")],
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
        # Who comes back after a while is greeted anew.
        +personDetected("No").held_for(lambda: manners.regreet_after_s) / greeted() >> [-greeted()],
    )
    return engine


# 6. Run the engine: `waldo_node.WaldoNode` does, in a graph; `engine.run()` does in a program of its own.
