"""Services and actions between nodes of an inline runner."""

from __future__ import annotations

from typing import Any

import pytest

from socialbot.core.errors import GraphError, MessageError
from socialbot.graph.calls import CallResult, GoalHandle
from socialbot.graph.files import dump_graph, parse_graph
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionClient, ActionServer, Client, Service
from socialbot.testing import GraphTester

SET_BOOL = "std_srvs/srv/SetBool"
NAVIGATE = "nav2_msgs/action/NavigateToPose"


class Light(Node):
    """Offers a light."""

    light = Service(SET_BOOL, "/light")
    lit = False

    @light
    def on_light(self, request: Any, response: Any) -> None:
        if request.data == self.lit:
            raise ValueError("nothing to switch")
        self.lit = request.data
        response.success = True
        response.message = f"{request.data} at {self.clock.now()}"


class Switch(Node):
    """Calls a light."""

    light = Client(SET_BOOL, "/light", deadline_s=2.0)

    def start(self) -> None:
        self.results: list[tuple[int, CallResult]] = []

    def switch(self, on: bool) -> Any:
        return self.light.call({"data": on}, self.on_result)

    def on_result(self, result: CallResult) -> None:
        self.results.append((self.clock.now(), result))


class Navigator(Node):
    """Drives one metre each second to x; refuses to go back, gives up at 10 m."""

    navigate = ActionServer(NAVIGATE, "/navigate_to_pose")

    def start(self) -> None:
        self.left = 0.0
        self.goals: list[GoalHandle] = []

    @navigate
    def on_goal(self, goal: GoalHandle) -> None:
        self.left = goal.request.pose.pose.position.x
        if self.left < 0:
            return goal.reject()
        self.goals.append(goal)
        goal.feedback({"distance_remaining": self.left})
        self.call_after(1.0, lambda: self.drive(goal))

    def drive(self, goal: GoalHandle) -> None:
        self.left -= 1.0
        if not goal.active:
            return
        if goal.request.pose.pose.position.x > 10.0:
            goal.abort({"error_code": 9})
        elif self.left <= 0:
            goal.succeed({"error_code": 0})
        else:
            goal.feedback({"distance_remaining": self.left})
            self.call_after(1.0, lambda: self.drive(goal))


class Careful(Navigator):
    """Brakes for half a second."""

    navigate = ActionServer(NAVIGATE, "/navigate_to_pose")

    @navigate.on_cancel
    def on_cancel(self, goal: GoalHandle) -> None:
        self.call_after(0.5, goal.cancelled)


class Traveller(Node):
    """Sends goals."""

    navigate = ActionClient(NAVIGATE, "/navigate_to_pose")

    def start(self) -> None:
        self.feedback: list[float] = []
        self.results: list[tuple[float, CallResult]] = []

    def go(self, x: float, **options: Any) -> Any:
        return self.navigate.send_goal(
            {"pose": {"pose": {"position": {"x": x}}}}, self.on_result, feedback=self.on_feedback, **options
        )

    def on_feedback(self, feedback: Any) -> None:
        self.feedback.append(feedback.distance_remaining)

    def on_result(self, result: CallResult) -> None:
        self.results.append((self.clock.now() / 1e9, result))


LIGHTS = Graph("lights", (NodeConfig("switch", Switch), NodeConfig("light", Light)))


def travel(navigator: type[Node] = Navigator) -> Graph:
    return Graph("travel", (NodeConfig("traveller", Traveller), NodeConfig("navigator", navigator)))


def outcomes(results: list[tuple[float, CallResult]]) -> list[tuple[float, str]]:
    return [(at, result.outcome) for at, result in results]


class TestServices:
    def test_response_arrives_at_the_time_of_the_call(self):
        with GraphTester(LIGHTS) as tester:
            tester.run(1.0)
            switch = tester.node("switch")
            call = switch.switch(True)
            assert switch.results == []
            tester.run(0.0)
            assert [(at, each.ok, each.message.message) for at, each in switch.results] == [
                (10**9, True, "True at 1000000000")
            ]
            assert call.result is switch.results[0][1]
            tester.run(5.0)
            assert len(switch.results) == 1

    def test_server_that_fails_gives_no_answer(self):
        tester = GraphTester(LIGHTS)
        tester.runner.start()
        tester.node("switch").switch(False)
        tester.run(3.0)
        ((at, result),) = tester.node("switch").results
        assert (at, result.outcome, result.message) == (2 * 10**9, "timeout", None)
        assert result.reason.startswith("/light gave no result within 2 s: see the log")
        assert tester.runner.faults["light"].first.startswith("ValueError: nothing to switch (test_services.py:")

    def test_absent_server_is_named_after_the_deadline(self):
        with GraphTester(Switch) as tester:
            tester.node().switch(True)
            tester.run(2.5)
            ((at, result),) = tester.node().results
            assert (at, result.outcome) == (2 * 10**9, "absent")
            assert "/light (std_srvs/srv/SetBool) had no server within 2 s" in result.reason

    def test_call_waits_for_a_server_that_restarts(self):
        with GraphTester(LIGHTS) as tester:
            tester.runner.kill("light")
            tester.node("switch").switch(True)
            tester.run(1.0)
            assert tester.node("switch").results == []
            tester.runner.restart("light")
            assert [(at, each.outcome) for at, each in tester.node("switch").results] == [(10**9, "succeeded")]

    def test_cancelled_call_ignores_the_answer(self):
        with GraphTester(LIGHTS) as tester:
            tester.node("switch").switch(True).cancel()
            tester.run(3.0)
            assert [each.outcome for _, each in tester.node("switch").results] == ["cancelled"]

    def test_request_is_checked_before_it_is_sent(self):
        pytest.importorskip("std_srvs")
        with GraphTester(LIGHTS) as tester:
            with pytest.raises(MessageError, match="Request of std_srvs/srv/SetBool: no field 'dat'"):
                tester.node("switch").light.call({"dat": True})
            from std_srvs.srv import SetBool

            with pytest.raises(MessageError, match="not a Request of std_srvs/srv/SetBool"):
                tester.node("switch").light.call(SetBool.Response())
            tester.node("switch").light.call(SetBool.Request(data=True))
            tester.run(0.0)
            assert tester.node("light").lit


class TestActions:
    def test_feedback_and_result_arrive_in_order(self):
        with GraphTester(travel()) as tester:
            call = tester.node("traveller").go(3.0)
            tester.run(0.0)
            assert (call.accepted, call.result) == (True, None)
            tester.run(5.0)
            traveller = tester.node("traveller")
            assert traveller.feedback == [3.0, 2.0, 1.0]
            assert [(at, each.outcome, each.message.error_code) for at, each in traveller.results] == [
                (3.0, "succeeded", 0)
            ]

    @pytest.mark.parametrize(
        ("x", "deadline_s", "expected", "reason"),
        [
            (-1.0, None, (0.0, "rejected"), "rejected the goal"),
            (11.0, None, (1.0, "aborted"), "aborted the goal"),
            (5.0, 2.5, (2.5, "timeout"), "no result within 2.5 s"),
        ],
    )
    def test_each_failure_is_an_outcome(self, x, deadline_s, expected, reason):
        with GraphTester(travel()) as tester:
            tester.node("traveller").go(x, deadline_s=deadline_s)
            tester.run(10.0)
            assert outcomes(tester.node("traveller").results) == [expected]
            assert reason in tester.node("traveller").results[0][1].reason
            assert all(not goal.active for goal in tester.node("navigator").goals)

    @pytest.mark.parametrize(("navigator", "at"), [(Navigator, 1.5), (Careful, 2.0)])
    def test_cancelled_goal_ends_when_its_server_has_stopped(self, navigator, at):
        with GraphTester(travel(navigator)) as tester:
            call = tester.node("traveller").go(5.0)
            tester.run(1.5)
            call.cancel()
            call.cancel()
            tester.run(5.0)
            assert outcomes(tester.node("traveller").results) == [(at, "cancelled")]

    def test_server_that_never_confirms_a_cancellation_is_not_waited_for(self):
        class Deaf(Navigator):
            navigate = ActionServer(NAVIGATE, "/navigate_to_pose")

            @navigate.on_cancel
            def on_cancel(self, goal: GoalHandle) -> None:
                """Goes on."""

        with GraphTester(travel(Deaf)) as tester:
            call = tester.node("traveller").go(9.0)
            tester.run(0.5)
            call.cancel()
            tester.run(9.0)
            ((at, result),) = tester.node("traveller").results
            assert (at, result.outcome) == (5.5, "cancelled")
            assert "did not confirm" in result.reason

    def test_goal_of_a_killed_server_is_lost(self):
        with GraphTester(travel()) as tester:
            tester.node("traveller").go(5.0)
            tester.run(1.5)
            tester.runner.kill("navigator")
            tester.run(0.0)
            assert outcomes(tester.node("traveller").results) == [(1.5, "lost")]

    def test_only_a_client_can_cancel(self):
        with GraphTester(travel()) as tester:
            tester.node("traveller").go(5.0)
            tester.run(0.0)
            with pytest.raises(GraphError, match="nobody asked to cancel"):
                tester.node("navigator").goals[0].cancelled()


class TestLiveness:
    def test_node_knows_when_its_server_goes_away_and_returns(self):
        class Watcher(Switch):
            seen: tuple[Any, ...] = ()

            def on_server(self, port: Any, *, present: bool) -> None:
                self.seen += ((self.clock.now() / 1e9, port.name, present),)

        graph = Graph("lights", (NodeConfig("switch", Watcher), NodeConfig("light", Light)))
        with GraphTester(graph) as tester:
            health = tester.runner.context_of("switch").health_monitor  # type: ignore[union-attr]
            tester.run(6.0)
            assert tester.node("switch").seen == ()
            tester.runner.kill("light")
            assert (health.health().state, health.health().reason) == ("degraded", "no server of /light")
            tester.run(1.0)
            tester.runner.restart("light")
            assert (health.health().state, health.health().reason) == ("ok", "")
            assert tester.node("switch").seen == ((6.0, "light", False), (7.0, "light", True))
        with GraphTester(Watcher) as tester:
            tester.run(9.0)
            assert tester.node().seen == ((5.0, "light", False),)


class TestGraphs:
    def test_service_without_a_server_is_refused_by_name(self):
        with pytest.raises(GraphError, match=r"switch\.light: nobody offers /light \(std_srvs/srv/SetBool\)"):
            Graph("lights", (NodeConfig("switch", Switch),))
        Graph("lights", (NodeConfig("switch", Switch),), services=frozenset({"/light"}))

    def test_two_servers_and_two_types_are_refused(self):
        with pytest.raises(GraphError, match="a and b both offer /light"):
            Graph("lights", (NodeConfig("a", Light), NodeConfig("b", Light)))

        class Trigger(Node):
            light = Client("std_srvs/srv/Trigger", "/light")

        with pytest.raises(GraphError, match="/light is std_srvs/srv/SetBool for a but std_srvs/srv/Trigger for b"):
            Graph("lights", (NodeConfig("a", Light), NodeConfig("b", Trigger)))

    @pytest.mark.parametrize("kind", ["SetBool", "std_srvs/msg/SetBool", int])
    def test_wrong_type_is_refused(self, kind):
        with pytest.raises(GraphError, match="is no type of a ROS service"):
            Client(kind, "/light")

    def test_class_and_name_are_the_same_type(self):
        srv = pytest.importorskip("std_srvs.srv")
        assert Client(srv.SetBool, "/light").interface == Client("std_srvs/SetBool", "/light").interface

    def test_remapped_client_finds_its_server(self):
        light = NodeConfig("light", Light, remap={"light": "/room/light"})
        switch = NodeConfig("switch", Switch, remap={"light": "/room/light"})
        with GraphTester(Graph("lights", (switch, light))) as tester:
            tester.node("switch").switch(True)
            tester.run(0.0)
            assert tester.node("light").lit

    def test_stand_in_answers_where_there_is_no_robot(self):
        text = f"""
name: travel
services: [/navigate_to_pose]
nodes:
  traveller: {{type: '{__name__}:Traveller'}}
stand_ins:
  navigator: {{type: '{__name__}:Navigator'}}
"""
        graph = parse_graph(text, where="graph.yaml")
        assert [config.name for config in graph.nodes] == ["traveller"]
        assert parse_graph(dump_graph(graph), where="again") == graph
        with GraphTester(graph) as tester:
            tester.node("traveller").go(1.0)
            tester.run(2.0)
            assert outcomes(tester.node("traveller").results) == [(1.0, "succeeded")]
        with pytest.raises(GraphError, match=r"(?s)nobody answers /navigate_to_pose .*'stand_ins', or .*/_action"):
            graph.expect_answers()
        graph.with_stand_ins().expect_answers()
        graph.expect_answers({"/navigate_to_pose"})
        assert graph.with_stand_ins({"/navigate_to_pose"}).nodes == graph.nodes

    def test_stand_in_without_a_service_is_refused(self):
        with pytest.raises(GraphError, match="the stand-in switch offers no service"):
            Graph("lights", (NodeConfig("light", Light),), stand_ins=(NodeConfig("switch", Switch),))

    def test_node_with_a_service_is_no_source(self):
        assert LIGHTS.without_sources().nodes == LIGHTS.nodes
