"""Nodes as ROS 2 lifecycle nodes, from a plain ROS client."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from tests.bridge.hosting import node_hosts
from tests.system.running import eventually

pytestmark = pytest.mark.ros


class Parrot(Node):
    """Notes its messages and lifecycle."""

    instances: ClassVar[list[Parrot]] = []

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
        self.instances.append(self)

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
    """Publishes a latched message at the start, and others on request."""

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
        """Request the transition ``label``."""
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
    """A parrot with the parameters ``settings``, and an active sage."""
    from socialbot.bridge.environment import spinning_node

    Parrot.instances.clear()
    ros_args = [part for setting in settings for part in ("-p", f"parrot:{setting}")]
    with spinning_node("client") as client, node_hosts(GRAPH, *ros_args) as host:
        yield Bird(host("parrot"), host("sage").node, client)


def test_a_node_activates_itself() -> None:
    with birds() as bird:
        assert bird.state == "active"
        assert eventually(lambda: Parrot.instances[0].did == ["start", "wise"])
        bird.says("hello")
        assert eventually(lambda: Parrot.instances[0].did[-1] == "hello")


def test_transitions_build_start_and_stop_a_node() -> None:
    from lifecycle_msgs.msg import TransitionEvent

    events: list[str] = []
    with birds("autostart:=false") as bird:
        bird.client.create_subscription(
            TransitionEvent, "/parrot/transition_event", lambda event: events.append(event.goal_state.label), 10
        )
        assert bird.state == "unconfigured"
        assert not Parrot.instances
        assert bird.change("configure")
        assert bird.state == "inactive"
        assert Parrot.instances[0].did == []
        assert bird.change("activate")
        assert eventually(lambda: Parrot.instances[0].did == ["start", "wise"])
        assert bird.change("deactivate")
        assert Parrot.instances[0].did == ["start", "wise", "stop"]
        assert bird.change("cleanup")
        assert bird.state == "unconfigured"
        assert bird.change("configure")
        assert bird.change("activate")
        assert eventually(lambda: len(Parrot.instances) == 2 and Parrot.instances[1].did == ["start", "wise"])
        assert eventually(lambda: events[-1:] == ["active"])
        there = ["inactive", "active", "inactive", "unconfigured", "inactive", "active"]
        assert [label for label in events if label in ("inactive", "active", "unconfigured")][-6:] == there


def test_a_reactivated_node_receives_latched_messages_but_no_old_commands() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.instances[0].did == ["start", "wise"])
        assert bird.change("deactivate")
        bird.says("too early")
        assert bird.change("activate")
        assert eventually(lambda: len(Parrot.instances) == 2 and Parrot.instances[1].did == ["start", "wise"])
        bird.says("hello")
        assert eventually(lambda: Parrot.instances[1].did == ["start", "wise", "hello"])


def test_an_inactive_node_keeps_messages_until_activation() -> None:
    with birds("autostart:=false") as bird:
        assert bird.change("configure")
        assert eventually(lambda: bird.host.statistics is not None and bird.sage is not None)
        bird.says("early")
        assert eventually(lambda: bool(bird.host._early))
        assert bird.change("activate")
        assert eventually(lambda: "early" in Parrot.instances[0].did)


def test_refuses_transitions_that_do_not_fit_the_state() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.instances[0].did == ["start", "wise"])
        assert not bird.change("configure")
        assert not bird.change("cleanup")
        assert bird.state == "active"
        bird.says("hello")
        assert eventually(lambda: Parrot.instances[0].did[-1] == "hello")


def test_a_node_stays_unconfigured_until_it_can_be_built() -> None:
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
        assert Parrot.instances[0].did == ["volume 1.0"]
        assert bird.change("activate")
        assert eventually(lambda: "start" in Parrot.instances[0].did)


def test_shutdown_ends_a_node() -> None:
    with birds() as bird:
        assert eventually(lambda: Parrot.instances[0].did == ["start", "wise"])
        assert not bird.host.ended
        assert bird.change("active_shutdown")
        assert Parrot.instances[0].did == ["start", "wise", "stop"]
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
