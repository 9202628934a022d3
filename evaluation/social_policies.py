"""Baselines of `evaluation.social`: greet on sight, act at random, and a behaviour tree with Waldo's actions."""

from __future__ import annotations

import importlib
import math
import random
from collections.abc import Callable, Mapping
from typing import Any

from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command
from socialbot.core.messages import HeadCommand, PersonDetection, PersonDetections, Utterance
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Input, Output, Parameter

RANGE_M, STAYS_S, GONE_S = 6.0, 8.0, 2.5
"""Waldo's range, time until help is offered, and time until a person counts as gone."""
FACES_RAD, NEAR_M, PRESENT_S = 1.0, 4.5, 0.5


def load_py_trees() -> Any:
    """Import py_trees. Raises InstallationError."""
    try:
        return importlib.import_module("py_trees")
    except ImportError as error:
        raise InstallationError(f"py_trees is not installed ({error})", remedy=extra_command("bench")) from error


class Policy(Node):
    """Base of the baselines: people by track, and Waldo's actions.

    A policy that leaves the direction of the head to the node `head` sees the same as all other such policies, and
    meets people in the same run as they do. A policy with ``turns_head`` has a run of its own.
    """

    turns_head = False

    detections = Input(PersonDetections, "/humans/bodies/detections")
    say = Output(Utterance, "/speech/say")
    head = Output(HeadCommand, "/head/command")

    seed = Parameter(0, "random seed", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.since: dict[str, float] = {}
        self.seen: dict[str, float] = {}
        self.greeted: set[str] = set()
        self.offered: set[str] = set()
        self.people: dict[str, PersonDetection] = {}
        self.now = 0.0
        self._said = 0
        self._mode = ""
        self.prepare()

    def prepare(self) -> None:
        """Make what the policy needs."""

    @detections
    def on_detections(self, message: PersonDetections) -> None:
        self.now = message.stamp / SECOND
        near = [p for p in message.persons if p.distance_m is not None and p.distance_m <= RANGE_M]
        self.people = {person.track_id: person for person in near}
        for track in self.people:
            if self.now - self.seen.get(track, -math.inf) > GONE_S:
                self.since[track] = self.now
            self.seen[track] = self.now
        self.act()

    def act(self) -> None:
        """Decide, after each image."""
        raise NotImplementedError

    def present_s(self, track: str) -> float:
        """How long a person has been present."""
        return self.now - self.since[track]

    def speak(self, key: str) -> None:
        """Say the sentence for a situation, and follow people with the head."""
        self._said += 1
        text = {"greeting": "Hello! Nice to see you.", "offer": "Can I help you with anything?"}[key]
        now = self.clock.now()
        self.say.publish(Utterance(stamp=now, id=f"{self.name}-{self._said}", text=text, key=key))
        self.look("track")

    def look(self, mode: str, pan: float = 0.0) -> None:
        """Command the head, if that changes anything."""
        if mode == self._mode != "look":
            return
        if mode == "look" and not self.turns_head:
            raise ValueError(f"{type(self).__name__} turns the head without 'turns_head'")
        self._mode = mode
        self.head.publish(HeadCommand(stamp=self.clock.now(), mode=mode, pan_rad=pan))  # type: ignore[arg-type]


class GreetOnSight(Policy):
    """Greets each new track at once, offers help to each that stays, and follows the nearest person."""

    def act(self) -> None:
        self.look("track" if self.people else "centre")
        new = [track for track in self.people if track not in self.greeted]
        if new:
            self.greeted.update(new)
            self.speak("greeting")
            return
        stays = [one for one in self.people if one not in self.offered and self.present_s(one) >= STAYS_S]
        if stays:
            self.offered.update(self.people)
            self.speak("offer")


class Random(Policy):
    """Speaks and turns the head at random while people are in view."""

    turns_head = True

    def prepare(self) -> None:
        self._rng = random.Random(self.seed)
        self._last = 0.0

    def act(self) -> None:
        step, self._last = min(self.now - self._last, 1.0), self.now
        if not self.people:
            return
        if self._rng.random() < step / 8.0:
            self.speak(self._rng.choice(("greeting", "offer")))
        elif self._rng.random() < step / 4.0:
            self.look("look", self._rng.uniform(-0.8, 0.8))


class BehaviourTree(Policy):
    """The same actions from a behaviour tree of py_trees: offer, else greet, else follow, else idle."""

    def prepare(self) -> None:
        trees = load_py_trees()
        sequence, selector = trees.composites.Sequence, trees.composites.Selector

        def leaf(name: str, works: Callable[[], bool]) -> Any:
            class Leaf(trees.behaviour.Behaviour):
                def update(self) -> Any:
                    return trees.common.Status.SUCCESS if works() else trees.common.Status.FAILURE

            return Leaf(name)

        def branch(name: str, condition: Callable[[], bool], action: Callable[[], bool]) -> Any:
            return sequence(name, memory=False, children=[leaf(f"{name}?", condition), leaf(name, action)])

        self._root = selector(
            "robot",
            memory=False,
            children=[
                branch("offer", lambda: bool(self._waiting()), self._offer),
                branch("greet", lambda: bool(self._new()), self._greet),
                branch("follow", lambda: bool(self.people), self._follow),
                leaf("idle", self._idle),
            ],
        )

    def act(self) -> None:
        self._root.tick_once()

    def _engaged(self, track: str) -> bool:
        person = self.people[track]
        faces = person.facing_rad is not None and person.facing_rad <= FACES_RAD
        near = (person.distance_m or math.inf) <= NEAR_M
        return faces and near and self.present_s(track) >= PRESENT_S

    def _new(self) -> list[str]:
        return [track for track in self.people if track not in self.greeted and self._engaged(track)]

    def _waiting(self) -> list[str]:
        return [
            track
            for track in self.people
            if track in self.greeted - self.offered and self._engaged(track) and self.present_s(track) >= STAYS_S
        ]

    def _greet(self) -> bool:
        self.greeted.update(self._new())
        self.speak("greeting")
        return True

    def _offer(self) -> bool:
        self.offered.update(self._waiting())
        self.speak("offer")
        return True

    def _follow(self) -> bool:
        self.look("track")
        return True

    def _idle(self) -> bool:
        self.look("centre")
        return True


POLICIES: dict[str, type[Policy] | None] = {
    "Waldo": None,
    "greet on sight": GreetOnSight,
    "random": Random,
    "behaviour tree": BehaviourTree,
}
"""The policies to compare; None stands for Waldo's nodes."""


def parties() -> list[tuple[str, ...]]:
    """Return the policies that meet people in one run, for each run of a schedule."""
    together = tuple(name for name, kind in POLICIES.items() if kind is None or not kind.turns_head)
    return [together, *((name,) for name in POLICIES if name not in together)]
