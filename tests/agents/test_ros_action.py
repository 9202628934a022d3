"""Actions of an agent that a ROS action or service executes, inline and over DDS."""

# ruff: noqa: N801 - beliefs, goals and actions are written like literals

from __future__ import annotations

from typing import Any

import pytest

from socialbot import (
    ActionClient,
    ActionServer,
    AgentNode,
    Client,
    Engine,
    Goal,
    GoalHandle,
    Graph,
    Node,
    NodeConfig,
    RosAction,
    Service,
    SingletonBelief,
    variables,
)
from socialbot.bdi import PlanFailed, drop, error
from socialbot.core.messages import TraceRecord
from socialbot.testing import GraphTester

NAVIGATE = "nav2_msgs/action/NavigateToPose"
X, Why = variables("X Why")


class distance_left(SingletonBelief): ...


class arrived(SingletonBelief): ...


class failed(SingletonBelief): ...


class hurry(SingletonBelief): ...


class visit(Goal): ...


class lit(Goal): ...


class drive_to(RosAction):
    """Drive to a position."""

    client = "navigate"

    def goal(self, x: float) -> Any:
        return {"pose": {"pose": {"position": {"x": x}}}}

    def feedback(self, feedback: Any) -> Any:
        return distance_left(feedback.distance_remaining)

    def result(self, result: Any) -> Any:
        return [arrived(result.error_code), -distance_left(X)]


class switch(RosAction):
    """Switch a light."""

    client = "light"

    def goal(self, on: bool) -> Any:
        return {"data": on}

    def result(self, result: Any) -> Any:
        if not result.success:
            raise PlanFailed(result.message)
        return None


class Rover(AgentNode):
    """Drives to places."""

    navigate = ActionClient(NAVIGATE, "/navigate_to_pose")
    light = Client("std_srvs/srv/SetBool", "/light")

    def build(self) -> Engine:
        engine = Engine("rover", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_rules(
            visit(X) >> [drive_to(X).within(6)],
            -visit(X)[error(Why)] >> [+failed(Why)],
            lit(X) >> [switch(X)],
            -lit(X)[error(Why)] >> [+failed(Why)],
            +hurry(X) >> [drop(visit(X))],
        )
        return engine


class Navigator(Node):
    """Drives one metre a second; rejects negative places, gives up beyond 10 m, and brakes for half a second."""

    navigate = ActionServer(NAVIGATE, "/navigate_to_pose")
    light = Service("std_srvs/srv/SetBool", "/light")
    stopped_at: float = 0.0

    @navigate
    def on_goal(self, goal: GoalHandle) -> None:
        x = goal.request.pose.pose.position.x
        if x < 0:
            goal.reject()
        else:
            self.drive(goal, x, x)

    def drive(self, goal: GoalHandle, x: float, left: float) -> None:
        if goal.active and not goal.cancelling:
            if left <= 0:
                goal.succeed({"error_code": 0})
            elif x > 10:
                goal.abort({"error_code": 9})
            else:
                goal.feedback({"distance_remaining": left})
                self.call_after(1.0, lambda: self.drive(goal, x, left - 1.0))

    @navigate.on_cancel
    def on_cancel(self, goal: GoalHandle) -> None:
        def stop() -> None:
            self.stopped_at = self.clock.now() / 1e9
            goal.cancelled()

        self.call_after(0.5, stop)

    @light
    def on_light(self, request: Any, response: Any) -> None:
        response.success = request.data
        response.message = "" if request.data else "the switch is stuck"


GRAPH = Graph("rover", (NodeConfig("rover", Rover), NodeConfig("navigator", Navigator)))


def beliefs(tester: GraphTester) -> list[str]:
    return sorted(str(held.belief) for held in tester.node("rover").engine.beliefs)


def record(tester: GraphTester, kind: str) -> list[TraceRecord]:
    return [each for each in tester.messages("/agent/trace") if each.kind == kind]


def test_feedback_becomes_beliefs_and_the_result_ends_the_step():
    with GraphTester(GRAPH) as tester:
        tester.node("rover").engine.achieve(visit(3))
        tester.run(1.5)
        assert beliefs(tester) == ["distance_left(2.0)"]
        tester.run(2.0)
        assert beliefs(tester) == ["arrived(0)"]
        assert tester.node("rover").engine.intentions.desires() == ()
        (action,) = record(tester, "action")
        causes = {each.what: each.cause for each in record(tester, "belief")}
        assert causes["distance_left(2.0)"] == action.id
        assert [each.detail["outcome"] for each in record(tester, "action_end")] == ["finished"]


@pytest.mark.parametrize(("x", "why"), [(-1, "rejected"), (11, "aborted")])
def test_failed_goal_fails_the_step_with_its_outcome(x, why):
    with GraphTester(GRAPH) as tester:
        tester.node("rover").engine.achieve(visit(x))
        tester.run(3.0)
        assert beliefs(tester) == [f'failed("{why}")']
        (end,) = record(tester, "action_end")
        assert end.detail["message"].startswith(f"/navigate_to_pose {why} the goal: ")


def test_time_limit_of_the_step_cancels_the_goal():
    with GraphTester(GRAPH) as tester:
        tester.node("rover").engine.achieve(visit(9))
        tester.run(9.0)
        assert tester.node("navigator").stopped_at == 6.5
        assert beliefs(tester)[-1] == 'failed("timeout")'


def test_dropped_intention_cancels_the_goal():
    with GraphTester(GRAPH) as tester:
        engine = tester.node("rover").engine
        engine.achieve(visit(5))
        tester.run(1.2)
        engine.believe(hurry(5))
        tester.run(3.0)
        assert tester.node("navigator").stopped_at == 1.7
        assert [each.detail["outcome"] for each in record(tester, "action_end")] == ["cancelled"]
        assert engine.intentions.desires() == ()


def test_service_can_execute_an_action_and_refuse_it():
    with GraphTester(GRAPH) as tester:
        for on in (True, False):
            tester.node("rover").engine.achieve(lit(on))
            tester.run(0.0)
        ends = [(each.detail["outcome"], each.detail.get("message")) for each in record(tester, "action_end")]
        assert ends == [("finished", None), ("failed", "the switch is stuck")]


def test_action_without_a_client_is_refused_by_name():
    class wander(drive_to):
        client = "legs"

    with GraphTester(GRAPH) as tester:
        engine = tester.node("rover").engine
        engine.add_rules(visit(X) >> [wander(X)], first=True)
        engine.achieve(visit(1))
        tester.run(0.0)
        message = next(each.detail["message"] for each in record(tester, "action_end"))
        assert message.startswith("action wander: the agent has no client 'legs'")


def test_two_runs_are_identical():
    def run() -> list[TraceRecord]:
        with GraphTester(GRAPH) as tester:
            for x in (2, -1, 9):
                tester.node("rover").engine.achieve(visit(x))
                tester.run(1.3)
            tester.run(9.0)
            return tester.messages("/agent/trace")

    assert run() == run()


def test_action_over_dds_becomes_beliefs_and_is_cancelled():
    pytest.importorskip("test_msgs", reason="needs the wheel ros-jazzy-test-msgs")
    from tests.bridge.hosting import node_hosts
    from tests.bridge.test_services import foreign_servers
    from tests.system.running import eventually

    class count(RosAction):
        client = "count"

        def goal(self, order: int) -> Any:
            return {"order": order}

        def feedback(self, feedback: Any) -> Any:
            return distance_left(int(feedback.sequence[-1]))

        def result(self, result: Any) -> Any:
            return arrived(len(result.sequence))

    class Counter(AgentNode):
        count = ActionClient("test_msgs/action/Fibonacci", "/count")

        def build(self) -> Engine:
            engine = Engine("counter", self.clock, robot=self, sink=self.record, wake=self.wake)
            engine.add_rules(
                visit(X) >> [count(X)],
                -visit(X)[error(Why)] >> [+failed(Why)],
                +hurry(X) >> [drop(visit(X))],
            )
            return engine

    graph = Graph("counter", (NodeConfig("counter", Counter),), services=frozenset({"/count"}))
    with foreign_servers(), node_hosts(graph) as host:
        hosted = host("counter")
        assert eventually(lambda: hosted.active_thread is not None)
        engine = hosted.node.engine

        def holds(text: str) -> bool:
            return text in [str(held.belief) for held in tuple(engine.beliefs)]

        engine.achieve(visit(3))
        assert eventually(lambda: holds("arrived(3)") and holds("distance_left(1)"))
        engine.achieve(visit(101))
        assert eventually(lambda: holds('failed("rejected")'))
        engine.achieve(visit(90))
        assert eventually(lambda: holds("distance_left(88)"))
        engine.believe(hurry(90))
        assert eventually(lambda: engine.intentions.desires() == ())
        assert not holds("arrived(90)")
