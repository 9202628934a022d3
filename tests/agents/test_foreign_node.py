"""Watches of nodes outside the graph, inline, with stand-ins for the nodes."""

from __future__ import annotations

from typing import Any

import pytest

from socialbot.agents.base.foreign_node import ForeignNodeState
from socialbot.bdi import Belief, Engine, Sensor
from socialbot.core.clock import ManualClock
from socialbot.core.errors import GraphError, ParameterError, SocialbotError
from socialbot.graph.files import dump_graph, parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node
from socialbot.graph.ports import Input, Parameter
from socialbot.graph.services import Service
from socialbot.testing import GraphTester, run_engine

STATE = "/lidar_driver_watch/state"
TARGETS = {1: "inactive", 2: "unconfigured", 3: "active", 4: "inactive"}


class Driver(Node):
    """Managed node that may fail to configure."""

    get_state = Service("lifecycle_msgs/srv/GetState", "/lidar/driver/get_state")
    change_state = Service("lifecycle_msgs/srv/ChangeState", "/lidar/driver/change_state")
    state = Parameter("unconfigured", "present state")
    fails = Parameter(False, "whether transitions fail")
    lies = Parameter(False, "whether the node tells of transitions to active without being active")
    requests: tuple[int, ...] = ()

    @get_state
    def on_get_state(self, request: Any, response: Any) -> Any:
        return {"current_state": {"label": self.state}}

    @change_state
    def on_change_state(self, request: Any, response: Any) -> Any:
        self.requests += (request.transition.id,)
        assert len(self.requests) < 1000
        if self.lies and request.transition.id == 3:
            self.set_parameter("state", "unconfigured")
            return {"success": True}
        if not self.fails:
            self.set_parameter("state", TARGETS[request.transition.id])
        return {"success": not self.fails}


class Reader(Node):
    """Takes the state of the driver."""

    driver = Input(ForeignNodeState, STATE)
    seen: tuple[ForeignNodeState, ...] = ()

    @driver
    def on_driver(self, message: ForeignNodeState) -> None:
        self.seen += (message,)


def graph_of(needs: str = "{state: active}", *, driver: str | None = "{}") -> Graph:
    stand_in = f"\nstand_ins: {{driver: {{type: '{__name__}:Driver', parameters: {driver}}}}}" if driver else ""
    text = (
        f"name: robot\nnodes: {{reader: {{type: '{__name__}:Reader'}}}}\nneeds: {{lidar/driver: {needs}}}{stand_in}\n"
    )
    return parse_graph(text, where="robot.yaml")


def states(test: GraphTester) -> list[tuple[str, bool]]:
    return [(each.state, each.ready) for each in test.node("reader").seen]


def run_until(test: GraphTester, seconds: float) -> None:
    test.run(seconds - test.seconds)


def test_node_that_ends_is_lost_within_a_period_and_the_time_for_an_answer():
    with GraphTester(graph_of("{state: unconfigured, period_s: 0.4, answer_s: 0.7}")) as test:
        run_until(test, 3.0)
        assert states(test) == [("unconfigured", True)]
        test.runner.kill("driver")
        run_until(test, 3.0 + 0.4 + 0.7)
        assert states(test)[1:] == [("lost", False)]
        assert test.node("reader").seen[1].reason == "/lidar/driver is not running, or has no lifecycle"
        test.runner.restart("driver")
        run_until(test, 6.0)
        assert states(test)[2:] == [("unconfigured", True)]


@pytest.mark.parametrize(
    ("needed", "present", "requests"),
    [
        ("active", "unconfigured", (1, 3)),
        ("inactive", "active", (4,)),
        ("unconfigured", "active", (4, 2)),
        ("active", "active", ()),
        ("active", "finalized", ()),
    ],
)
def test_managed_node_takes_the_transitions_to_the_needed_state(needed: str, present: str, requests: tuple[int, ...]):
    with GraphTester(graph_of(f"{{state: {needed}, manage: true}}", driver=f"{{state: {present}}}")) as test:
        test.run(2.0)
        assert test.node("driver").requests == requests
        assert states(test)[-1] == (("finalized", False) if present == "finalized" else (needed, True))


def test_failed_transition_is_repeated_after_a_while():
    with GraphTester(graph_of("{state: active, manage: true}", driver="{fails: true}")) as test:
        driver = test.node("driver")
        test.run(4.0)
        assert driver.requests == (1,)
        assert test.node("reader").seen[-1].reason == "/lidar/driver failed to configure: see its log"
        test.run(2.5)
        assert driver.requests == (1, 1)
        driver.set_parameter("fails", False)
        test.run(6.0)
        assert states(test)[-1] == ("active", True)


def test_a_node_whose_transitions_lead_nowhere_is_asked_seldom():
    """A stranger may answer in its place, as fast as it is asked."""
    with GraphTester(graph_of("{state: active, manage: true}", driver="{lies: true}")) as test:
        driver = test.node("driver")
        test.run(4.0)
        assert driver.requests == (1, 3)
        assert test.node("reader").seen[-1].reason == "/lidar/driver is unconfigured again after its transitions"
        test.run(10.0)
        assert len(driver.requests) == 6
        driver.set_parameter("lies", False)
        test.run(6.0)
        assert states(test)[-1] == ("active", True)


def test_watch_reports_its_health():
    with GraphTester(graph_of()) as test:
        context = test.runner.context_of("lidar_driver_watch")
        assert context is not None
        monitor = context.health_monitor
        test.run(1.0)
        assert (monitor.health().state, monitor.health().reason) == (
            "degraded",
            "/lidar/driver is unconfigured, not active",
        )
        test.runner.kill("driver")
        test.run(2.0)
        assert monitor.health().state == "failed"


def test_agent_believes_that_the_driver_is_lost():
    class Lost(Belief):
        """The driver does not answer."""

    class Lidar(Sensor):
        def sense(self, percept: ForeignNodeState) -> Any:
            return Lost() if percept.state == "lost" else -Lost()

    engine = Engine("guard", ManualClock())
    sensor = Lidar()
    engine.add_sensor(sensor)
    with GraphTester(graph_of("{state: unconfigured}")) as test:
        test.runner.tap(STATE, lambda _, message: sensor.push(message))
        for ends, expected in ((False, False), (True, True), (False, False)):
            (test.runner.kill if ends else test.runner.restart)("driver")
            test.run(2.0)
            run_engine(engine)
            assert bool(list(engine.beliefs)) is expected


def test_watch_is_left_out_where_no_robot_is():
    graph = graph_of(driver=None)
    assert [config.name for config in graph.nodes] == ["reader", "lidar_driver_watch"]
    for without in (graph.with_stand_ins(), graph.without_sources()):
        assert [config.name for config in without.nodes] == ["reader"]
        assert STATE in without.inputs


def test_graph_with_needs_is_written_and_read_again():
    graph = graph_of("{state: inactive, manage: true}")
    assert parse_graph(dump_graph(graph), where="again") == graph


@pytest.mark.parametrize(
    ("needs", "error", "message"),
    [
        ("{stat: active}", ParameterError, r"robot.yaml:\d: lidar_driver_watch: no parameter 'stat'"),
        ("{state: running}", ParameterError, r"lidar_driver_watch.state"),
        ("{node: /other}", GraphError, "the name of the node is its key"),
        ("active", GraphError, r"robot.yaml:\d: expected names with values, got 'active'"),
    ],
)
def test_mistakes_are_refused_with_their_place(needs: str, error: type[Exception], message: str):
    with pytest.raises(error, match=message):
        graph_of(needs)


def test_watch_without_a_node_says_how_to_declare_one():
    graph = parse_graph("name: robot\nnodes: {watch: {type: foreign_node}}\n", where="robot.yaml")
    runner = InlineRunner(graph)
    with pytest.raises(SocialbotError, match="name it under 'needs'"):
        runner.start()
    runner.close()
