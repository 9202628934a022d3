"""Answers of services and actions in a bag."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from std_msgs.msg import Float32
from std_srvs.srv import Empty, SetBool

from socialbot.bags.reader import open_bag
from socialbot.bags.recorded_services import recorded_services
from socialbot.bags.types import deserialize, installed_definition, type_problem
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError
from socialbot.core.messages import RosMessage, ros_message
from socialbot.graph.calls import CallResult
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input
from socialbot.graph.services import ActionClient, Client, Service
from socialbot.runs.record import RunRecord
from socialbot.runtime.bag_source import BagSource
from socialbot.runtime.run import run
from tests.bags.making_bags import make_mcap

EVENT = "std_srvs/srv/SetBool_Event"
STATUS = "action_msgs/msg/GoalStatusArray"


class Switch(Node):
    """Calls a light with each command."""

    command = Input(Float32, "/command")
    light = Client(SetBool, "/light", deadline_s=3.0)

    def start(self) -> None:
        results.clear()

    @command
    def on_command(self, message: RosMessage) -> None:
        self.light.call({"data": message.data > 0}, self.on_result)

    def on_result(self, result: CallResult) -> None:
        results.append((self.clock.now() / SECOND, result))


results: list[tuple[float, CallResult]] = []


class Light(Node):
    """A light that says nothing."""

    light = Service(SetBool, "/light")

    @light
    def on_light(self, request: Any, response: Any) -> None:
        response.message = "stand-in"


GRAPH = Graph(
    "lights",
    (NodeConfig("switch", Switch),),
    inputs=frozenset({"/command"}),
    services=frozenset({"/light"}),
    stand_ins=(NodeConfig("light", Light),),
)


def event(kind: int, at: float, number: int, *, request: Any = None, response: Any = None) -> bytes:
    """Serialised event of a service, as rclpy publishes it."""
    from rclpy.serialization import serialize_message

    made = SetBool.Event()
    made.info.event_type, made.info.sequence_number = kind, number
    made.info.stamp.sec, made.info.stamp.nanosec = divmod(round(at * SECOND), SECOND)
    made.request = [] if request is None else [SetBool.Request(data=request)]
    made.response = [] if response is None else [SetBool.Response(success=True, message=response)]
    return bytes(serialize_message(made))


def empty_event() -> bytes:
    from rclpy.serialization import serialize_message

    made = Empty.Event()
    made.info.sequence_number, made.request = 7, [Empty.Request()]
    return bytes(serialize_message(made))


def commands(bag: BagWriter, *values: tuple[float, float]) -> None:
    kind = ros_message(Float32)
    for at, value in values:
        bag.write("/command", kind.of(Float32(data=value), round(at * SECOND)), round(at * SECOND))


def recorded(path: Path, *events: bytes) -> Path:
    """A bag with commands at 1, 2, 3 and 9 s and with the events of a light."""
    with BagWriter(path) as bag:
        commands(bag, (1.0, 1.0), (2.0, 0.0), (3.0, 1.0), (9.0, 0.0))
        for each in events:
            bag.write_raw("/light/_service_event", EVENT, each, 4 * SECOND)
    return path


ON = (event(0, 1.0, 1, request=True), event(3, 1.25, 1, response="lit"))
OFF = (event(0, 2.0, 2, request=False), event(3, 2.5, 2, response="dark"))
DEAF = (event(0, 3.0, 3, request=True),)


def replayed(bag: Path, tmp_path: Path, graph: Graph = GRAPH) -> list[tuple[float, str, Any]]:
    with open_bag(bag) as opened, RunRecord(tmp_path / "run") as record:
        run(graph, BagSource(opened), record)
    return [(at, each.outcome, each.message and each.message.message) for at, each in results]


def test_service_answers_from_the_bag_after_the_recorded_time(tmp_path):
    bag = recorded(tmp_path / "bag", *OFF, *ON, *DEAF)
    found = replayed(bag, tmp_path)
    assert found == [
        (1.25, "succeeded", "lit"),
        (2.5, "succeeded", "dark"),
        (6.0, "timeout", None),
        (9.0, "absent", None),
    ]
    assert "the bag holds no answer of /light to this request (0 others are left)" in results[-1][1].reason


def test_stand_in_answers_where_the_bag_does_not(tmp_path):
    assert [each[1:] for each in replayed(recorded(tmp_path / "bag"), tmp_path)] == [("succeeded", "stand-in")] * 4


def test_run_that_nobody_answers_is_refused_before_it_starts(tmp_path):
    graph = Graph("lights", GRAPH.nodes, inputs=GRAPH.inputs, services=GRAPH.services)
    with pytest.raises(GraphError, match=r"switch.light: nobody answers /light \(std_srvs/srv/SetBool\)"):
        replayed(recorded(tmp_path / "bag"), tmp_path, graph)


def test_definition_comes_from_the_installed_package():
    text = installed_definition(EVENT)
    assert text.splitlines()[:3] == [
        "service_msgs/ServiceEventInfo info",
        "std_srvs/SetBool_Request[<=1] request",
        "std_srvs/SetBool_Response[<=1] response",
    ]
    assert "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec" in text
    assert installed_definition("nowhere_msgs/msg/Thing") == ""


SRV = f"{'=' * 80}\nSRV: lamps/srv/Turn\n"
PART = f"\n{'=' * 80}\nMSG: lamps/Level\nstring message\n"


@pytest.mark.parametrize(
    "text",
    [
        "# on or off\nbool data\n---\nbool success # ---\nstring message\n",
        f"{SRV}bool data\n---\nbool success\nstring message\n",
        f"{SRV}bool data\n---\nbool success\nLevel level{PART}",
        f"{SRV}bool data\n---\nbool success\nlamps/Level level{PART}",
    ],
)
def test_event_of_a_service_that_is_not_installed_is_read_by_the_definition_of_the_service(text):
    """rosbag2 stores that instead of the one of the event, with a headline since Jazzy."""
    definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    extra = ConnectionExtRosbag2("cdr", [])
    one = Connection(1, "/light/_service_event", "lamps/srv/Turn_Event", definition, "", 1, extra, None)
    assert type_problem(one) is None
    asked, answered = deserialize(one, ON[0]), deserialize(one, ON[1])
    assert (asked.info.sequence_number, [each.data for each in asked.request], list(asked.response)) == (1, [True], [])
    (answer,) = answered.response
    assert (answer.success, getattr(answer, "level", answer).message) == (True, "lit")


@pytest.mark.parametrize("encoding", ["unknown", "ros2msg"])
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_events_in_a_bag_of_jazzy_are_read(tmp_path, storage, encoding):
    """rosbag2 of Jazzy names the language only for parts of services, and SQLite files name the service."""
    text, events = f"{SRV}bool data\n---\nbool success\nstring message\n", [ON[0], ON[1]]
    kind, topic = "lamps/srv/Turn_Event", "/light/_service_event"
    if storage == "mcap":
        path = make_mcap(tmp_path / "bag.mcap", "ros2", [(topic, kind, encoding, text.encode(), "cdr", events)])
    else:
        path = tmp_path / "bag"
        with BagWriter(path, storage=storage) as bag:
            for at, each in enumerate(events):
                bag.write_raw(topic, EVENT, each, SECOND + at)
        with sqlite3.connect(path / "bag.db3") as database:
            database.execute("UPDATE topics SET type = ?", [kind])
            database.execute(
                "UPDATE message_definitions SET topic_type = 'lamps/srv/Turn', encoding = ?, "
                "encoded_message_definition = ?",
                [encoding, text],
            )
        (path / "metadata.yaml").unlink()
    with open_bag(path) as bag:
        found = [message for _, _, message in bag.ros_messages([topic])]
    assert [[each.data for each in message.request] for message in found] == [[True], []]
    assert [[each.message for each in message.response] for message in found] == [[], ["lit"]]


def test_event_of_a_service_without_request_and_response_is_read_too():
    definition = MessageDefinition(MessageDefinitionFormat.MSG, f"{SRV}---\n")
    extra = ConnectionExtRosbag2("cdr", [])
    one = Connection(1, "/light/_service_event", "lamps/srv/Turn_Event", definition, "", 1, extra, None)
    assert deserialize(one, empty_event()).info.sequence_number == 7


class Traveller(Node):
    """Sends two goals."""

    command = Input(Float32, "/command")
    count = ActionClient("test_msgs/action/Fibonacci", "/count", optional=True)
    results: tuple[Any, ...] = ()

    @command
    def on_command(self, message: RosMessage) -> None:
        self.count.send_goal({"order": 3}, self.on_result, feedback=lambda each: self.note("feedback", each.sequence))

    def on_result(self, result: CallResult) -> None:
        self.note(result.outcome, None if result.message is None else result.message.sequence)

    def note(self, what: str, numbers: Any) -> None:
        seen.append((round(self.clock.now() / SECOND, 3), what, None if numbers is None else list(numbers)))


seen: list[tuple[float, str, Any]] = []


def test_goals_answer_from_status_and_feedback(tmp_path):
    fibonacci = pytest.importorskip("test_msgs.action", reason="needs the wheel ros-jazzy-test-msgs").Fibonacci
    from action_msgs.msg import GoalStatus, GoalStatusArray
    from rclpy.serialization import serialize_message

    def status(goal: int, state: int) -> bytes:
        one = GoalStatus(status=state)
        one.goal_info.goal_id.uuid = [goal] * 16
        return bytes(serialize_message(GoalStatusArray(status_list=[one])))

    def feedback(goal: int, *numbers: int) -> bytes:
        made = fibonacci.Impl.FeedbackMessage(feedback=fibonacci.Feedback(sequence=numbers))
        made.goal_id.uuid = [goal] * 16
        return bytes(serialize_message(made))

    with BagWriter(tmp_path / "bag") as bag:
        commands(bag, (1.0, 0.0), (9.0, 0.0), (12.0, 0.0), (20.0, 0.0))
        for at, data in ((2.0, status(7, 1)), (4.5, status(7, 4)), (5.0, status(8, 1)), (5.5, status(8, 6))):
            bag.write_raw("/count/_action/status", STATUS, data, round(at * SECOND))
        name = "test_msgs/action/Fibonacci_FeedbackMessage"
        bag.write_raw("/count/_action/feedback", name, feedback(7, 3, 2), 3 * SECOND)
    seen.clear()
    graph = Graph(
        "count", (NodeConfig("one", Traveller),), inputs=frozenset({"/command"}), services=frozenset({"/count"})
    )
    with open_bag(tmp_path / "bag") as opened, RunRecord(tmp_path / "run") as record:
        assert list(recorded_services(opened, graph)) == ["/count"]
        run(graph, BagSource(opened), record)
    assert seen == [
        (2.0, "feedback", [3, 2]),
        (3.5, "succeeded", None),
        (9.5, "aborted", None),
        (12.0, "absent", None),
        (20.0, "absent", None),
    ]
