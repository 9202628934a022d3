"""An agent that drives: it meets visitors, makes way for them, and returns home."""

# ruff: noqa: N801 - beliefs and goals are written like literals

from __future__ import annotations

from socialbot import Engine, Goal, Input, SingletonBelief, variables
from socialbot.bdi import Belief, error
from socialbot.core.messages import PersonDetections
from socialbot.robots.navigation import MobileAgent, approach, give_way, return_home

Who, Why = variables("Who Why")


class meet(Goal): ...


class yield_to(Goal): ...


class go_home(Goal): ...


class met(Belief): ...


class failed(SingletonBelief): ...


class Usher(MobileAgent):
    """Drives to people by Nav2."""

    detections = Input(PersonDetections, "/humans/bodies/detections", optional=True)

    def build(self) -> Engine:
        engine = Engine("usher", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_rules(
            meet(Who) >> [approach(Who).within(3), +met(Who)],
            -meet(Who)[error(Why)] >> [+failed(Why)],
            yield_to(Who) >> [give_way(Who).within(3), +met(Who)],
            -yield_to(Who)[error(Why)] >> [+failed(Why)],
            go_home() >> [return_home().within(3), +met("home")],
            -go_home()[error(Why)] >> [+failed(Why)],
        )
        return engine

    @detections
    def on_detections(self, message: PersonDetections) -> None:
        self.note_people(message)
