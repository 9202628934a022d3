"""Nodes as ROS 2 lifecycle nodes, seen by a client that knows nothing of socialbot."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from socialbot.core.messages import Utterance
from socialbot.graph.node import Delivery, Graph, Input, Node, NodeConfig, Output, Parameter
from tests.system.running import eventually

pytestmark = pytest.mark.ros


class Parrot(Node):
    """Notes what it hears, and what becomes of it."""

    lives: ClassVar[list[Parrot]] = []

    said = Input(Utterance, "/said")
    wisdom = Input(Utterance, "/wisdom", Delivery.LATCHED)
    repeated = Output(Utterance, "/repeated")
    volume = Parameter(0.5, "how loud it is", minimum=0.0, maximum=1.0)
    colour = Parameter("green", "of its feathers")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        if self.colour == "invisible":
            raise ValueError("no such parrot")
        self.did: list[str] = []
        self.lives.append(self)

    def start(self) -> None:
        self.did.append("start")

    def stop(self) -> None:
        self.did.append("stop")

    def on_parameter(self, name: str) -> None:
        self.did.append(f"{name} {self.parameter_values[name]}")

    @said
    def on_said(self, message: Utterance) -> None:
        self.did.append(message.text)

    @wisdom
    def on_wisdom(self, message: Utterance) -> None:
        self.did.append(message.text)


class Sage(Node):
    """Says something wise, once; and whatever is asked for."""

    said = Output(Utterance, "/said")
    wisdom = Output(Utterance, "/wisdom", Delivery.LATCHED)

    def start(self) -> None:
        self.wisdom.publish(Utterance(stamp=1, id="wisdom", text="wise"))


GRAPH = Graph("birds", (NodeConfig("parrot", Parrot), NodeConfig("sage", Sage)))


@dataclass
class Bird:
    """The hosted parrot, and a client for it."""

    host: Any
    sage: Any
    client: Any

    def ask(self, kind: Any, service: str, **request: Any) -> Any:
        client = self.client.create_client(kind, f"/parrot/{service}")
        assert client.wait_for_service(10.0)
        future = client.call_async(kind.Request(**request))
        assert eventually(future.done)
        return future.result()

    def change(self, label: str) -> bool:
        """Asks for the transition called so."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        number = getattr(Transition, f"TRANSITION_{label.upper()}")
        return bool(self.ask(ChangeState, "change_state", transition=Transition(id=number)).success)

    @property
    def state(self) -> str:
        from lifecycle_msgs.srv import GetState

        return str(self.ask(GetState, "get_state").current_state.label)

    def says(self, text: str) -> None:
        self.sage.said.publish(Utterance(stamp=2, id=text, text=text))


@contextmanager
def birds(*settings: str) -> Iterator[Bird]:
    """A parrot whose parameters are those ``settings``, and a sage who starts by himself."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context, spinning_node

    Parrot.lives.clear()
    arguments = [part for setting in settings for part in ("-p", f"parrot:{setting}")]
    with spinning_node("client") as client, ros_context(["--ros-args", *arguments] if settings else []) as context:
        hosts = [NodeHost(GRAPH, one, ros_context=context, sim_time=False) for one in GRAPH.placements]
        executor = SingleThreadedExecutor(context=context)
        for host in hosts:
            executor.add_node(host.ros_node)
            host.start()
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            yield Bird(hosts[0], hosts[1].node, client)
        finally:
            executor.shutdown()
            thread.join(2.0)
            for host in hosts:
                host.stop()


def test_a_node_that_nobody_manages_becomes_active_by_itself() -> None:
    with birds() as bird:
        assert bird.state == "active"
        assert eventually(lambda: Parrot.lives[0].did == ["start", "wise"])
        bird.says("hello")
        assert eventually(lambda: Parrot.lives[0].did[-1] == "hello")


def test_a_managed_node_is_built_started_and_stopped_when_it_is_told_to() -> None:
    from lifecycle_msgs.msg import TransitionEvent

    events: list[str] = []
    with birds("autostart:=false") as bird:
        bird.client.create_subscription(
            TransitionEvent, "/parrot/transition_event", lambda event: events.append(event.goal_state.label), 10
        )
        assert bird.state == "unconfigured"
        assert not Parrot.lives
        assert bird.change("configure")
        assert bird.state == "inactive"
        assert Parrot.lives[0].did == []
        assert bird.change("activate")
        assert eventually(lambda: Parrot.lives[0].did == ["start", "wise"])
        assert bird.change("deactivate")
        assert Parrot.lives[0].did == ["start", "wise", "stop"]
        assert bird.change("cleanup")
        assert bird.state == "unconfigured"
        assert bird.change("configure")
        assert bird.change("activate")
        assert eventually(lambda: len(Parrot.lives) == 2 and Parrot.lives[1].did == ["start", "wise"])
        assert eventually(lambda: events[-1:] == ["active"])
        there = ["inactive", "active", "inactive", "unconfigured", "inactive", "active"]
        assert [label for label in events if label in ("inactive", "active", "unconfigured")][-6:] == there


def test_who_is_activated_again_hears_what_is_latched_but_no_old_commands() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.lives[0].did == ["start", "wise"])
        assert bird.change("deactivate")
        bird.says("too early")
        assert bird.change("activate")
        assert eventually(lambda: len(Parrot.lives) == 2 and Parrot.lives[1].did == ["start", "wise"])
        bird.says("hello")
        assert eventually(lambda: Parrot.lives[1].did == ["start", "wise", "hello"])


def test_who_waits_to_be_started_hears_what_was_said_meanwhile() -> None:
    with birds("autostart:=false") as bird:
        assert bird.change("configure")
        assert eventually(lambda: bird.host.statistics is not None and bird.sage is not None)
        bird.says("early")
        assert eventually(lambda: bool(bird.host._early))
        assert bird.change("activate")
        assert eventually(lambda: "early" in Parrot.lives[0].did)


def test_a_transition_that_does_not_fit_the_state_is_refused_and_the_node_goes_on() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.lives[0].did == ["start", "wise"])
        assert not bird.change("configure")
        assert not bird.change("cleanup")
        assert bird.state == "active"
        bird.says("hello")
        assert eventually(lambda: Parrot.lives[0].did[-1] == "hello")


def test_a_node_that_cannot_be_built_stays_unconfigured_until_it_can() -> None:
    from rcl_interfaces.msg import Parameter as RosParameter
    from rcl_interfaces.msg import ParameterValue
    from rcl_interfaces.srv import SetParameters

    with birds("autostart:=false", "colour:=invisible") as bird:
        assert not bird.change("configure")
        assert bird.state == "unconfigured"
        green = RosParameter(name="colour", value=ParameterValue(type=4, string_value="green"))
        assert bird.ask(SetParameters, "set_parameters", parameters=[green]).results[0].successful
        assert bird.change("configure")
        loud = RosParameter(name="volume", value=ParameterValue(type=3, double_value=1.0))
        assert bird.ask(SetParameters, "set_parameters", parameters=[loud]).results[0].successful
        assert Parrot.lives[0].did == ["volume 1.0"]
        assert bird.change("activate")
        assert eventually(lambda: "start" in Parrot.lives[0].did)


def test_a_node_that_is_shut_down_has_ended() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.lives[0].did == ["start", "wise"])
        assert not bird.host.ended
        assert bird.change("active_shutdown")
        assert Parrot.lives[0].did == ["start", "wise", "stop"]
        assert bird.host.ended
        assert bird.host.failure is None


def test_states_and_transitions_can_be_listed() -> None:
    from lifecycle_msgs.srv import GetAvailableStates, GetAvailableTransitions

    with birds() as bird:
        states = {state.label for state in bird.ask(GetAvailableStates, "get_available_states").available_states}
        assert {"unconfigured", "inactive", "active", "finalized"} <= states
        now = bird.ask(GetAvailableTransitions, "get_available_transitions").available_transitions
        assert {one.transition.label for one in now} == {"deactivate", "shutdown"}
        whole = bird.ask(GetAvailableTransitions, "get_transition_graph").available_transitions
        assert len(whole) > len(now)
