"""Services and actions over DDS, with plain rclpy nodes in a process of their own."""

from __future__ import annotations

import math
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from socialbot.bridge import _services
from socialbot.bridge._service_clients import MAX_FEEDBACK, ActionChannel
from socialbot.bridge.wait_sets import OneThreadExecutor
from socialbot.core.errors import MessageError, NodeError, ParameterError
from socialbot.graph import calls
from socialbot.graph.calls import CallResult, GoalHandle, PendingCall
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionClient, ActionServer, Client, Service
from tests.bridge.hosting import foreign_process, node_hosts, spinning_nodes
from tests.system.running import PATIENCE_S, eventually, next_line

COUNT = "test_msgs/action/Fibonacci"


class Caller(Node):
    """Calls the services and actions of the tests."""

    light = Client(SetBool, "/light")
    deaf = Client("std_srvs/srv/SetBool", "/deaf", deadline_s=0.5)
    results: tuple[CallResult, ...] = ()

    def on_result(self, result: CallResult) -> None:
        self.results += (result,)


class Counter(Caller):
    """Counts by an action."""

    count = ActionClient(COUNT, "/count")
    seen: tuple[int, ...] = ()

    def start_count(self, order: int, **options: Any) -> Any:
        return self.count.send_goal({"order": order}, self.on_result, feedback=self.on_feedback, **options)

    def on_feedback(self, feedback: Any) -> None:
        self.seen += (feedback.sequence[-1],)


class Lamp(Node):
    """Offers a light."""

    light = Service(SetBool, "/light", open_to_all=True)
    lit = False

    @light
    def on_light(self, request: Any, response: Any) -> None:
        self.lit = request.data
        response.message = "on" if self.lit else "off"


OUTSIDE = frozenset({"/light", "/deaf", "/count"})


def graph_of(*configs: NodeConfig) -> Graph:
    return Graph("calls", configs, services=OUTSIDE)


def foreign_servers(*mode: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """The servers in another process; they end with the block."""
    return foreign_process("tests.bridge.foreign_servers", *mode)


@pytest.fixture(scope="class")
def shared_servers() -> Iterator[subprocess.Popen[str]]:
    with foreign_servers() as process:
        yield process


@pytest.fixture
def servers(shared_servers: subprocess.Popen[str], request: pytest.FixtureRequest) -> subprocess.Popen[str]:
    """Servers that the tests of a class share, with nothing left of other tests. Their mode is a parameter."""
    assert shared_servers.stdin is not None
    print(getattr(request, "param", ""), file=shared_servers.stdin, flush=True)
    while (line := next_line(shared_servers)) != "ready\n":
        if line != "cancelled\n":
            shared_servers.kill()  # no other test waits as long
            pytest.fail("a test before has failed and still reads what the servers print")
    return shared_servers


@contextmanager
def active(node: type[Node], **options: Any) -> Iterator[Any]:
    """A hosted node that calls servers outside."""
    with node_hosts(graph_of(NodeConfig("caller", node)), **options) as host:
        hosted = host("caller")
        assert eventually(lambda: hosted.active_thread is not None)
        yield hosted


def in_thread(hosted: Any, callback: Any) -> Any:
    """Call into a node as its own callbacks do, and return the result."""
    found: list[Any] = []
    hosted.active_thread.queue.call_soon(lambda: found.append(callback(hosted.node)))
    assert eventually(lambda: bool(found))
    return found[0]


def only_result(hosted: Any) -> CallResult:
    assert eventually(lambda: bool(hosted.node.results))
    (result,) = hosted.node.results
    return result


class TestCalls:
    def test_foreign_server_answers_and_refuses(self, servers):
        with active(Caller) as hosted:
            for on in (True, True):
                in_thread(hosted, lambda node, on=on: node.light.call({"data": on}, node.on_result))
            assert eventually(lambda: len(hosted.node.results) == 2)
            assert [(each.ok, each.message.success, each.message.message) for each in hosted.node.results] == [
                (True, True, ""),
                (True, False, "it is so already"),
            ]

    def test_server_that_gives_no_answer_runs_into_the_deadline(self, servers):
        with active(Caller) as hosted:
            in_thread(hosted, lambda node: node.deaf.call(then=node.on_result, deadline_s=3.0))
            result = only_result(hosted)
            assert (result.outcome, result.message) == ("timeout", None)
            assert "/deaf gave no result within 3 s" in result.reason

    @pytest.mark.parametrize(
        "way",
        [
            "closed",
            "declared",
            *(pytest.param(way, marks=pytest.mark.slow) for way in ("closed driver", "optional", "named")),
        ],
    )
    def test_client_in_a_graph_with_keys_has_to_be_opened(self, way, tmp_path, monkeypatch, servers, other_domain):
        """Anybody in the network can answer, so the answers count only where somebody has decided so."""
        from socialbot.bridge.keys import new_key

        new_key("robot", tmp_path)
        monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path))
        if way == "named":
            monkeypatch.setenv("SOCIALBOT_OPEN_TOPICS", "/light")
        if way == "closed driver":  # the graph is open to the network, and so would be its clients of drivers
            monkeypatch.setenv("SOCIALBOT_DRIVERS", f"{other_domain}:/light")
            monkeypatch.setenv("ROS_STATIC_PEERS", "127.0.0.2")

        class Guarded(Node):
            light = Client(
                SetBool, "/light", deadline_s=30.0, optional=way == "optional", open_to_all=way == "declared"
            )
            results: tuple[CallResult, ...] = ()

            def on_result(self, result: CallResult) -> None:
                self.results += (result,)

        with node_hosts(graph_of(NodeConfig("guarded", Guarded))) as host:
            hosted = host("guarded")
            if way.startswith("closed"):
                assert isinstance(hosted.failure, ParameterError | NodeError)
                assert "the answers of /light cannot be signed, so anybody in the network could give" in str(
                    hosted.failure
                )
                return
            assert eventually(lambda: hosted.active_thread is not None)
            limit_s = 0.5 if way == "optional" else None
            in_thread(hosted, lambda node: node.light.call({"data": True}, node.on_result, deadline_s=limit_s))
            assert only_result(hosted).outcome == ("absent" if way == "optional" else "succeeded")

    def test_recording_of_a_call_answers_it_in_a_replay(self, servers, tmp_path):
        from socialbot.bags.reader import open_bag
        from socialbot.bags.recorded_services import recorded_services
        from socialbot.bridge import recorder

        counts: dict[str, int] = {}
        answered: list[bool] = []

        def stopped() -> bool:
            answered.extend([True] if hosted.node.results else [])
            return len(answered) > 50  # messages on their way have arrived

        def record() -> None:
            counts.update(recorder.record(tmp_path / "bag", stopped=stopped).counts)

        with active(Caller) as hosted:
            thread = threading.Thread(target=record)
            thread.start()
            assert eventually(lambda: hosted.ros_node.count_subscribers("/light/_service_event") == 1)
            in_thread(hosted, lambda node: node.light.call({"data": True}, node.on_result))
            assert only_result(hosted).ok
            thread.join()
        assert counts["/light/_service_event"] == 2
        with open_bag(tmp_path / "bag") as bag:
            graph = graph_of(NodeConfig("caller", Caller))
            assert sorted(recorded_services(bag, graph)) == ["/light"]


class TestServices:
    def test_absent_server_is_named(self):
        with active(Caller) as hosted:
            in_thread(hosted, lambda node: node.light.call(then=node.on_result, deadline_s=0.3))
            result = only_result(hosted)
            assert result.outcome == "absent"
            assert "/light (std_srvs/srv/SetBool) had no server within 0.3 s" in result.reason

    def test_call_waits_for_a_server_that_starts_later(self, monkeypatch):
        monkeypatch.setattr(calls, "SERVER_WAIT_S", PATIENCE_S)
        with active(Caller) as hosted:
            call = in_thread(hosted, lambda node: node.light.call({"data": True}, node.on_result))
            with foreign_servers():
                assert only_result(hosted).ok
                assert call.result.ok

    @pytest.mark.parametrize("restarts", [pytest.param(False, marks=pytest.mark.slow), True])
    def test_killed_server_is_noticed(self, restarts):
        with active(Caller) as hosted:
            with foreign_servers() as process:
                in_thread(hosted, lambda node: node.light.call(then=node.on_result))
                assert eventually(lambda: bool(hosted.node.results))
                in_thread(hosted, lambda node: node.deaf.call(then=node.on_result, deadline_s=40.0))
                sent = in_thread(hosted, lambda node: node.light.call(then=node.on_result))
                assert eventually(lambda: sent.result is not None)
                if restarts:
                    process.kill()
                else:
                    assert process.stdin is not None
                    process.stdin.close()  # it leaves the graph
                    process.wait()
            if restarts:
                with foreign_servers():
                    assert eventually(lambda: len(hosted.node.results) == 3)
            assert eventually(lambda: len(hosted.node.results) == 3)
            assert hosted.node.results[-1].outcome == "lost"
            assert "the server of /deaf went away" in hosted.node.results[-1].reason

    def test_node_knows_when_a_foreign_server_goes_away_and_returns(self):
        class Watcher(Node):
            light = Client(SetBool, "/light")
            seen: tuple[bool, ...] = ()

            def on_server(self, port: Any, *, present: bool) -> None:
                self.seen += (present,)

        with active(Watcher) as hosted:
            with foreign_servers() as process:
                assert eventually(lambda: hosted._services._absent_since.get("/light") == -math.inf)
                seen = len(hosted.node.seen)  # a server that starts slowly is absent at first
                assert hosted.node.seen == (False, True)[:seen]
                assert process.stdin is not None
                process.stdin.close()  # it leaves the graph
                assert eventually(lambda: hosted.node.seen[seen:] == (False,))
            with foreign_servers():
                assert eventually(lambda: hosted.node.seen[seen:] == (False, True))

    def test_foreign_client_gets_the_answer_of_a_node(self):
        with node_hosts(graph_of(NodeConfig("lamp", Lamp))) as host, spinning_nodes("stranger") as (stranger,):
            lamp = host("lamp")
            client = stranger.create_client(SetBool, "/light")
            assert client.wait_for_service(10.0)
            assert eventually(lambda: lamp.active_thread is not None)
            answer = client.call(SetBool.Request(data=True), timeout_sec=10.0)
            assert (answer.message, lamp.node.lit) == ("on", True)

    def test_requests_without_end_do_not_fill_the_memory(self, monkeypatch, caplog):
        """A node that is busy has some of them; it answers again when it is free."""
        monkeypatch.setattr(_services, "MAX_REQUESTS", 10)
        with node_hosts(graph_of(NodeConfig("lamp", Lamp))) as host, spinning_nodes("stranger") as (stranger,):
            lamp = host("lamp")
            client = stranger.create_client(SetBool, "/light")
            assert client.wait_for_service(10.0)
            assert eventually(lambda: lamp.active_thread is not None)
            free, service = threading.Event(), lamp._services._servers[0]._service
            taken, take = [], service.send_response
            service.send_response = lambda request, header: taken.append(take(request, header))
            lamp.active_thread.queue.call_soon(lambda: free.wait(PATIENCE_S))
            futures = []
            for count in range(1, 21):  # DDS keeps ten
                futures.append(client.call_async(SetBool.Request(data=True)))
                assert eventually(lambda count=count: len(taken) == count)
            free.set()
            assert eventually(lambda: sum(future.done() for future in futures) == 10)
            assert client.call(SetBool.Request(data=False), timeout_sec=10.0) is not None
            assert sum(future.done() for future in futures) == 10
        refusals = [record.getMessage() for record in caplog.records if "requests refused" in record.getMessage()]
        assert refusals == [f"/light: {count} requests refused, as 10 wait" for count in (1, 10)]

    def test_node_that_fails_answers_nothing_and_goes_on(self):
        class Broken(Lamp):
            light = Service(SetBool, "/light")

            @light
            def on_light(self, request: Any, response: Any) -> None:
                if request.data:
                    raise ValueError("no bulb")

        with node_hosts(graph_of(NodeConfig("lamp", Broken))) as host, spinning_nodes("stranger") as (stranger,):
            lamp = host("lamp")
            client = stranger.create_client(SetBool, "/light")
            assert client.wait_for_service(10.0)
            assert eventually(lambda: lamp.active_thread is not None)
            first = client.call_async(SetBool.Request(data=True))
            assert client.call(SetBool.Request(data=False), timeout_sec=10.0) is not None
            assert not first.done()
            assert lamp.statistics.first_failure.startswith("ValueError: no bulb (test_services.py:")

    def test_wrong_request_is_refused_before_it_is_sent(self):
        with active(Caller) as hosted:
            for wrong in (Trigger.Request(), SetBool.Response(), "on"):
                with pytest.raises(MessageError, match="not a Request of std_srvs/srv/SetBool"):
                    hosted.node.light.call(wrong)

    def test_type_that_is_not_installed_is_named(self):
        class Stranger(Node):
            go = ActionClient("nowhere_msgs/action/Go", "/go")

        graph = Graph("go", (NodeConfig("caller", Stranger),), services=frozenset({"/go"}))
        with node_hosts(graph) as host:
            hosted = host("caller")
            assert eventually(lambda: hosted.failure is not None)
            assert "the ROS type nowhere_msgs/action/Go is not installed" in str(hosted.failure)


def has_client(hosted: Any, service: str) -> bool:
    """Whether a hosted node has discovered a client of a service: an answer before that is lost."""
    return bool(hosted.ros_node.get_subscriptions_info_by_topic(f"rr{service}Reply", no_mangle=True))


class TestActions:
    @pytest.fixture(autouse=True)
    def types(self):
        pytest.importorskip("test_msgs", reason="needs the wheel ros-jazzy-test-msgs")

    def test_feedback_and_result_arrive(self, servers):
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(4))
            result = only_result(hosted)
            assert result.ok
            assert list(result.message.sequence) == [4, 3, 2, 1]
            assert hosted.node.seen == (4, 3, 2, 1)

    @pytest.mark.parametrize("servers", ["hasty"], indirect=True)
    def test_feedback_without_end_does_not_fill_the_memory(self, servers):
        """A node that is busy gets the newest feedback."""
        with active(Counter) as hosted:
            free = threading.Event()
            in_thread(hosted, lambda node: node.start_count(1000))
            assert eventually(lambda: hosted.node.seen)
            hosted.active_thread.queue.call_soon(lambda: free.wait(PATIENCE_S))
            channel = hosted._services._channels["count"]
            assert eventually(lambda: not channel._goals)  # the result has arrived
            seen = len(hosted.node.seen)
            free.set()
            assert only_result(hosted).ok
            assert 0 < len(hosted.node.seen) - seen <= MAX_FEEDBACK
            assert hosted.node.seen[-1] < 500

    @pytest.mark.parametrize(("order", "outcome"), [(101, "rejected"), (-1, "aborted")])
    def test_refusal_and_abort_are_outcomes(self, servers, order, outcome):
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(order))
            assert only_result(hosted).outcome == outcome

    @pytest.mark.parametrize("early", [True, pytest.param(False, marks=pytest.mark.slow)])
    def test_cancelled_goal_returns_what_was_done(self, servers, early):
        with active(Counter) as hosted:
            call = in_thread(hosted, lambda node: node.start_count(99))
            assert early or eventually(lambda: len(hosted.node.seen) > 2)
            in_thread(hosted, lambda node: call.cancel())
            result = only_result(hosted)
            assert result.outcome == "cancelled"
            assert result.message is None or list(result.message.sequence) == list(hosted.node.seen)

    @pytest.mark.parametrize("early", [True, pytest.param(False, marks=pytest.mark.slow)])
    def test_a_node_that_stops_cancels_its_goals(self, servers, early):
        """A robot must not drive on when the graph has ended."""
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(99))
            assert eventually(lambda: (early and hosted._services._channels["count"]._goals) or hosted.node.seen)
        assert next_line(servers) == "cancelled\n"

    def test_a_goal_can_be_cancelled_without_the_answer_that_it_is_accepted(self, servers, monkeypatch):
        """A server that starts may answer before it has discovered the client, and the answer is lost."""
        monkeypatch.setattr(ActionChannel, "_on_answer", lambda *_: None)
        with active(Counter) as hosted:
            call = in_thread(hosted, lambda node: node.start_count(99))
            assert eventually(lambda: bool(hosted.node.seen))
            in_thread(hosted, lambda node: call.cancel())
            assert next_line(servers) == "cancelled\n"
            result = only_result(hosted)
            assert (result.outcome, result.reason) == ("cancelled", "")
            assert list(result.message.sequence) == list(hosted.node.seen)

    def test_feedback_shows_that_a_goal_is_accepted(self, servers, monkeypatch):
        monkeypatch.setattr(ActionChannel, "_on_answer", lambda *_: None)
        with active(Counter) as hosted:
            # The server may find its subscriber late, and so lose the first feedback.
            call = in_thread(hosted, lambda node: node.start_count(20))
            assert list(only_result(hosted).message.sequence) == list(range(20, 0, -1))
            assert call.accepted

    def test_a_goal_is_cancelled_if_the_server_is_asked_before_it_has_the_goal(self, servers, monkeypatch):
        request, on_cancel_answer = ActionChannel._request, ActionChannel._on_cancel_answer
        waiting: list[Callable[[], None]] = []

        def ask_first(self: ActionChannel, call: Any) -> None:
            send, answer = self._client.send_goal_async, Future()

            def send_late(*message: Any, **options: Any) -> Future:
                waiting.append(
                    lambda: send(*message, **options).add_done_callback(lambda sent: answer.set_result(sent.result()))
                )
                self._ask_to_cancel(call)
                return answer

            monkeypatch.setattr(self._client, "send_goal_async", send_late)
            request(self, call)

        def send_waiting(self: ActionChannel, *answer: Any) -> None:
            on_cancel_answer(self, *answer)
            while waiting:
                waiting.pop()()

        monkeypatch.setattr(ActionChannel, "_request", ask_first)
        monkeypatch.setattr(ActionChannel, "_on_cancel_answer", send_waiting)
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(99))
            assert only_result(hosted).outcome == "cancelled"
            assert next_line(servers) == "cancelled\n"

    def test_a_node_may_cancel_a_goal_when_it_stops(self, servers):
        class Tidy(Counter):
            """Cancels its goal at the end."""

            goal: Any = None
            tidied = False

            def stop(self) -> None:
                self.goal.cancel()
                self.tidied = True

        with active(Tidy) as hosted:
            node = hosted.node
            in_thread(hosted, lambda node: setattr(node, "goal", node.start_count(99)))
            assert eventually(lambda: bool(node.seen))
        assert node.tidied
        assert next_line(servers) == "cancelled\n"

    def test_a_node_that_is_deactivated_cancels_its_goals(self, servers):
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(99))
            assert eventually(lambda: bool(hosted.node.seen))
            hosted.transition_to("inactive")
            assert next_line(servers) == "cancelled\n"

    def test_deadline_cancels_the_goal(self, servers):
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(1))
            assert only_result(hosted).ok, "the server is known from now on"
            in_thread(hosted, lambda node: node.start_count(99, deadline_s=0.4))
            assert eventually(lambda: len(hosted.node.results) == 2)
            assert hosted.node.results[1].outcome == "timeout"
            stopped: list[int] = []

            def is_quiet() -> bool:
                stopped.append(len(hosted.node.seen))
                return len(stopped) > 20 and stopped[-1] == stopped[-20]

            assert eventually(is_quiet)
            assert len(hosted.node.seen) < 50

    @pytest.mark.parametrize("servers", ["stubborn"], indirect=True)
    def test_server_may_refuse_to_cancel(self, servers):
        with active(Counter) as hosted:
            call = in_thread(hosted, lambda node: node.start_count(15))
            assert eventually(lambda: call.accepted)
            in_thread(hosted, lambda node: call.cancel())
            assert only_result(hosted).outcome == "succeeded"

    @pytest.mark.parametrize("servers", ["stubborn"], indirect=True)
    def test_the_second_answer_to_a_cancel_changes_nothing(self, servers, monkeypatch):
        """A node may cancel its goal and end, which asks the server twice."""
        answers: list[PendingCall] = []
        refused: list[PendingCall] = []
        on_cancel_answer = ActionChannel._on_cancel_answer

        def answered(self: ActionChannel, call: PendingCall, early: bool, future: Any) -> None:
            on_cancel_answer(self, call, early, future)
            answers.append(call)

        monkeypatch.setattr(ActionChannel, "_on_cancel_answer", answered)
        monkeypatch.setattr(PendingCall, "on_cancel_refused", lambda self: refused.append(self))
        with active(Counter) as hosted:
            call = in_thread(hosted, lambda node: node.start_count(15))
            assert eventually(lambda: call.accepted)
            channel = hosted._services._channels["count"]
            channel.cancel(call)
            channel.cancel(call)
            assert only_result(hosted).outcome == "succeeded"
            assert eventually(lambda: answers == [call, call])
            assert refused == [call]

    @pytest.mark.parametrize("lost", [1, pytest.param(2, marks=pytest.mark.slow)])
    def test_a_node_that_stops_asks_again_if_its_cancel_is_lost(self, servers, monkeypatch, lost):
        ask, asked = ActionChannel._ask_to_cancel, []

        def losing(self: ActionChannel, call: PendingCall) -> None:
            asked.append(call)
            if len(asked) > lost:
                ask(self, call)
            else:
                self._unwanted.add(call)

        monkeypatch.setattr(ActionChannel, "_ask_to_cancel", losing)
        monkeypatch.setattr(_services, "CANCEL_SENT_S", PATIENCE_S)
        with active(Counter) as hosted:
            in_thread(hosted, lambda node: node.start_count(99))
            assert eventually(lambda: bool(hosted.node.seen))
        assert next_line(servers) == "cancelled\n"


class TestActionServers:
    @pytest.fixture(autouse=True)
    def types(self):
        pytest.importorskip("test_msgs", reason="needs the wheel ros-jazzy-test-msgs")

    def test_a_node_that_stops_leaves_the_graph(self):
        """Its goals and actions keep nothing of DDS, which each later node would have to discover."""

        class Relay(Node):
            count = ActionClient(COUNT, "/count")
            again = ActionServer(COUNT, "/again")

            @again
            def on_goal(self, goal: GoalHandle) -> None: ...

        def threads() -> int:
            return len(list(Path("/proc/self/task").iterdir()))

        with spinning_nodes("onlooker") as (onlooker,):
            before = threads()
            with node_hosts(graph_of(NodeConfig("relay", Relay))) as host:
                host("relay")
                assert eventually(lambda: "relay" in onlooker.get_node_names())
                assert threads() > before
            assert eventually(lambda: "relay" not in onlooker.get_node_names(), 10.0)
            assert eventually(lambda: threads() <= before, 10.0)

    def test_killed_server_loses_the_goal(self):
        with active(Counter) as hosted:
            with foreign_servers() as process:
                call = in_thread(hosted, lambda node: node.start_count(99))
                assert eventually(lambda: call.accepted)
                process.kill()
            with foreign_servers():
                assert only_result(hosted).outcome == "lost"
                hosted.node.results = ()
                in_thread(hosted, lambda node: node.start_count(1))
                assert only_result(hosted).ok

    def test_foreign_client_drives_the_action_of_a_node(self):
        from action_msgs.msg import GoalStatus
        from rclpy.action.client import ActionClient as RosActionClient

        fibonacci = pytest.importorskip("test_msgs.action").Fibonacci

        class Server(Node):
            count = ActionServer(COUNT, "/count")

            @count
            def on_goal(self, goal: GoalHandle) -> None:
                if goal.request.order < 0:
                    return goal.reject()
                goal.feedback({"sequence": [goal.request.order]})
                if goal.request.order == 0:
                    return goal.succeed({"sequence": [0]})
                return self.call_after(0.1, goal.abort) and None if goal.request.order == 1 else None

        with node_hosts(graph_of(NodeConfig("server", Server))) as host, spinning_nodes("stranger") as (stranger,):
            hosted = host("server")
            client = RosActionClient(stranger, fibonacci, "/count")
            assert client.wait_for_server(10.0)
            assert eventually(lambda: hosted.active_thread is not None)
            feedback: list[Any] = []

            def send(order: int) -> Any:
                future = client.send_goal_async(fibonacci.Goal(order=order), feedback_callback=feedback.append)
                assert eventually(future.done)
                return future.result()

            def result(goal: Any) -> Any:
                future = goal.get_result_async()
                assert eventually(future.done)
                return future.result()

            assert not send(-1).accepted
            done = result(send(0))
            assert (done.status, list(done.result.sequence)) == (GoalStatus.STATUS_SUCCEEDED, [0])
            assert result(send(1)).status == GoalStatus.STATUS_ABORTED
            endless = send(5)
            cancelling = endless.cancel_goal_async()
            assert eventually(cancelling.done)
            assert len(cancelling.result().goals_canceling) == 1
            assert result(endless).status == GoalStatus.STATUS_CANCELED
            assert eventually(lambda: [each.feedback.sequence[0] for each in feedback] == [0, 1, 5])
            endless = send(7)
            hosted.transition_to("inactive")
            assert result(endless).status == GoalStatus.STATUS_ABORTED
            assert not send(0).accepted
            client.destroy()

    def test_goals_wait_for_a_busy_node_without_effort(self, monkeypatch):
        """Two goals of a stranger may have the same id."""
        from unique_identifier_msgs.msg import UUID

        fibonacci = pytest.importorskip("test_msgs.action").Fibonacci

        class Server(Node):
            count = ActionServer(COUNT, "/count")
            light = Service(SetBool, "/light")
            started: tuple[GoalHandle, ...] = ()

            @count
            def on_goal(self, goal: GoalHandle) -> None:
                self.started += (goal,)

            @light
            def on_light(self, request: Any, response: Any) -> None: ...

        with node_hosts(graph_of(NodeConfig("server", Server))) as host, spinning_nodes("stranger") as (stranger,):
            hosted = host("server")
            goals = stranger.create_client(fibonacci.Impl.SendGoalService, "/count/_action/send_goal")
            light = stranger.create_client(SetBool, "/light")
            assert goals.wait_for_service(10.0)
            assert light.wait_for_service(10.0)
            assert eventually(lambda: hosted.active_thread is not None)
            assert eventually(lambda: has_client(hosted, "/count/_action/send_goal") and has_client(hosted, "/light"))
            action = hosted._services._servers[0]
            handled, handle = [], OneThreadExecutor._handle
            monkeypatch.setattr(
                OneThreadExecutor, "_handle", lambda self, *each: handled.append(each) or handle(self, *each)
            )

            def send(identity: int) -> Any:
                request = fibonacci.Impl.SendGoalService.Request(goal_id=UUID(uuid=[identity] * 16))
                return goals.call_async(request)

            free = threading.Event()
            hosted.active_thread.queue.call_soon(lambda: free.wait(PATIENCE_S))
            sent = [send(1), send(1), send(2)]
            assert eventually(lambda: len(action._new) == 3)
            asked = light.call_async(SetBool.Request())
            handled.clear()
            time.sleep(0.5)
            assert len(handled) < 100
            free.set()
            assert eventually(lambda: all(future.done() for future in (*sent, asked)))
            assert sorted(future.result().accepted for future in sent) == [False, True, True]
            assert eventually(lambda: sum(goal.cancelling for goal in hosted.node.started) == 1)
            assert (len(action._new), len(action._goals)) == (0, 2)
            handled.clear()
            time.sleep(0.5)
            assert len(handled) < 100, "also while goals are in progress"

    def test_results_of_goals_are_forgotten(self, monkeypatch):
        """Goals of strangers without end would fill the memory in the 15 minutes of rclpy."""
        from rclpy.action.client import ActionClient as RosActionClient

        fibonacci = pytest.importorskip("test_msgs.action").Fibonacci
        monkeypatch.setattr(_services, "RESULT_S", 1)

        class Server(Node):
            count = ActionServer(COUNT, "/count")

            @count
            def on_goal(self, goal: GoalHandle) -> None:
                goal.succeed()

        with node_hosts(graph_of(NodeConfig("server", Server))) as host, spinning_nodes("stranger") as (stranger,):
            hosted = host("server")
            client = RosActionClient(stranger, fibonacci, "/count")
            assert client.wait_for_server(10.0)
            assert eventually(lambda: hosted.active_thread is not None)
            assert eventually(lambda: has_client(hosted, "/count/_action/send_goal"))
            sent = [client.send_goal_async(fibonacci.Goal(order=order)) for order in range(3)]
            assert eventually(lambda: all(future.done() for future in sent))
            kept = hosted._services._servers[0]._server._goal_handles
            assert eventually(lambda: not kept)
            client.destroy()


@pytest.mark.parametrize("open_to_all", [False, True])
def test_service_in_a_graph_with_keys_has_to_be_opened(open_to_all, tmp_path, monkeypatch):
    from socialbot.bridge.keys import new_key

    new_key("robot", tmp_path)
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path))

    class Closed(Lamp):
        light = Service(SetBool, "/light", open_to_all=open_to_all)

        @light
        def on_light(self, request: Any, response: Any) -> None:
            """Answers."""

    with node_hosts(graph_of(NodeConfig("lamp", Closed))) as host:
        lamp = host("lamp")
        if open_to_all:
            assert eventually(lambda: lamp.active_thread is not None)
        else:
            assert isinstance(lamp.failure, ParameterError | NodeError)
            assert "/light cannot be signed, so anybody in the network could call it" in str(lamp.failure)
