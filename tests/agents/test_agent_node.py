"""Nodes that host an engine."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.agents.base import agent_node
from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Belief, Engine, Sensor
from socialbot.bdi.intentions import Intention
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, NodeError
from socialbot.core.messages import Mind, RosMessage, ros_message
from socialbot.graph.ports import Input
from socialbot.testing import GraphTester


class Forgetful(AgentNode):
    """Builds an engine, but does not return it."""

    def build(self) -> Engine:
        Engine("forgetful", self.clock, robot=self, sink=self.record, wake=self.wake)
        return None  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("connections", "what", "remedy"),
    [
        ({"sink": print}, "has no wake: the agent would never act", "wake=self.wake"),
        ({"wake": print}, "has no sink: the agent would leave no record", "sink=self.record"),
    ],
)
def test_an_engine_without_a_connection_to_its_node_is_refused(connections: dict[str, Any], what: str, remedy: str):
    class Loose(AgentNode):
        def build(self) -> Engine:
            return Engine("loose", self.clock, **connections)

    with pytest.raises(GraphError, match=f"node: the engine of Loose.build {what}") as caught:
        GraphTester(Loose)
    assert remedy in str(caught.value.remedy)


def test_an_engine_that_build_does_not_return_is_missed():
    with pytest.raises(GraphError, match=r"node: Forgetful\.build returns None, which is no engine") as caught:
        GraphTester(Forgetful)
    assert "return engine" in str(caught.value.remedy)


class hot(Belief):  # noqa: N801
    """It is hot."""


class Thermometer(Sensor):
    """Reads a field of a ROS message."""

    def sense(self, percept: RosMessage):
        return hot() if percept.temperature > 30.0 else None


class Porter(AgentNode):
    """Has one sensor."""

    celsius = Input("sensor_msgs/msg/Temperature", "/celsius")

    def build(self) -> Engine:
        engine = Engine("porter", self.clock, robot=self, sink=self.record, wake=self.wake)
        self.thermometer = Thermometer()
        engine.add_sensor(self.thermometer)
        return engine

    @celsius
    def on_celsius(self, message: RosMessage) -> None:
        self.thermometer.push(message)


def test_a_sensor_that_understands_nothing_degrades_its_agent_until_it_does(caplog: pytest.LogCaptureFixture):
    def health(**fields: float) -> tuple[str, str]:
        kind = ros_message("sensor_msgs/msg/Temperature")
        graph.send("/celsius", kind(stamp=graph.clock.now(), ros=SimpleNamespace(**fields)))
        graph.run(0.1)
        now = graph.node().context.health_monitor.health()
        return now.state, now.reason

    with GraphTester(Porter) as graph:
        assert health(celsius=20.0) == health(celsius=20.0) == ("ok", "")
        state, reason = health(celsius=20.0)
        assert state == "degraded"
        assert reason.startswith("the sensor Thermometer fails at each percept: ")
        assert "'temperature'" in reason
        assert health(temperature=20.0) == ("ok", "")
    line = Thermometer.sense.__code__.co_firstlineno + 1
    assert f"(test_agent_node.py:{line})" in caplog.text  # the line of the user, not one of socialbot


class Endless(AgentNode):
    """Has a goal that follows itself, with or without beliefs and failures on its way."""

    plans = ""

    def build(self) -> Engine:
        engine = Engine("endless", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_text(f"!meet(0). {self.plans}")
        return engine


ENDLESS = {
    "goal": "+!meet(W) <- !meet(W).",
    "goal first": "+!meet(W) <- !meet(W); .print(W).",
    "new goal": "+!meet(W) <- !!meet(W).",
    "belief": "+!meet(W) <- -+met(W + 1). +met(W) <- -+met(W + 1).",
    "failure": "+!meet(W) <- .fail. -!meet(W) <- !meet(W).",
}


@pytest.mark.parametrize(
    "plans",
    [pytest.param(plans, id=name, marks=[pytest.mark.slow] * (name == "goal")) for name, plans in ENDLESS.items()],
)
def test_plans_without_end_are_an_error_where_time_is_simulated(plans: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("socialbot.graph.inline.MOST_AT_ONCE", 1_000)
    endless = GraphTester(type("Agent", (Endless,), {"plans": plans}))
    with pytest.raises(NodeError, match=r"messages or calls follow each other at 0\.000 s"), endless:
        endless.run(1)


def test_a_burst_of_events_shows_the_mind_when_the_agent_is_idle(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(agent_node, "TURNS", 4)
    plans = "+!meet(W) <- +met(W). +met(1000). +met(W) <- -+met(W + 1)."
    with GraphTester(type("Agent", (Endless,), {"plans": plans}), start=SECOND) as agent:
        agent.run(0)
        minds = agent.messages("/agent/mind")
    assert len(minds) <= 2
    assert isinstance(minds[-1], Mind)
    assert [belief.text for belief in minds[-1].beliefs] == ["met(1000)"]


class Waiting(AgentNode):
    """Waits for beliefs, and for a time."""

    def build(self) -> Engine:
        engine = Engine("waiting", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_text("!go. +!go <- .wait(there(_)); .wait({+light(_)}); .wait(5000); .wait(6000).")
        return engine


def test_a_call_that_changes_nothing_makes_no_texts_of_intentions(monkeypatch: pytest.MonkeyPatch):
    with GraphTester(Waiting, start=SECOND) as agent:
        agent.run(0.01)
        text, made = Intention.__str__, []
        monkeypatch.setattr(Intention, "__str__", lambda intention: made.append(intention) or text(intention))
        for _ in range(50):
            agent.node().wake()
        agent.run(0.01)
    assert made == []


def test_the_mind_is_shown_after_each_step():
    with GraphTester(Waiting, start=SECOND) as agent:
        engine: Engine = agent.node().engine
        for belief, seconds in (("", 0.01), ("there(1)", 0.01), ("light(1)", 0.01), ("", 5.0), ("", 6.0)):
            if belief:
                engine.add_text(f"{belief}.")
                agent.node().wake()
            agent.run(seconds)
            minds = agent.messages("/agent/mind")
            assert minds[-1].intentions == tuple(map(str, engine.intentions)), belief
    assert len({mind.intentions for mind in minds}) == 5
