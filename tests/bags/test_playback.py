"""Mapping of bag topics to a graph, and replay of recorded messages in response to commands."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from socialbot.agents.hospital.demo import hospital
from socialbot.agents.teams.messages import ActionCancel, ActionCommand, ActionResult
from socialbot.agents.warehouse.messages import GripperStatus, MoveCommand
from socialbot.bags.playback import (
    CommandMatcher,
    InlineStage,
    WorldScript,
    feeding,
    play,
    recorded_commands,
    takes_images,
)
from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import BagError, GraphError
from socialbot.core.messages import Message, Structured, TraceRecord, Utterance
from socialbot.core.process import Ending
from socialbot.deliberation.messages import Belief, Fact
from socialbot.graph.files import load_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output
from tests.agents.hospital.runs import carried_out

GO = ActionCommand(stamp=1, id="then-1", robot="a", action="go", args=("a", "b"))


def test_commands_match_regardless_of_id_and_time():
    matcher = CommandMatcher()
    assert not matcher.take("/c", GO)
    matcher.give("/c", ActionCommand(stamp=9, id="now-7", robot="a", action="go", args=("a", "b")))
    assert not matcher.take("/other", GO)
    assert matcher.take("/c", GO)
    assert not matcher.take("/c", GO), "each one counts once"


def test_answers_get_the_current_id_of_their_command():
    matcher = CommandMatcher()
    matcher.give("/c", ActionCommand(stamp=9, id="now-7", robot="a", action="go", args=("a", "b")))
    matcher.take("/c", GO)
    result = ActionResult(stamp=20, id="then-1", robot="a", action="go", outcome="success")
    assert matcher.as_current(result, late=5) == ActionResult(
        stamp=25, id="now-7", robot="a", action="go", outcome="success"
    )
    matcher.give("/cancels", ActionCancel(stamp=30, id="now-7"))
    assert matcher.take("/cancels", ActionCancel(stamp=22, id="then-1"))


def test_commands_without_ids_match_by_content():
    matcher = CommandMatcher()
    matcher.give("/c", MoveCommand(stamp=1, target="base"))
    assert not matcher.take("/c", MoveCommand(stamp=1, target="bay"))
    assert matcher.take("/c", MoveCommand(stamp=3, target="base"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Graph, Path, list[Message]]:
    """A mission that meets a problem: its agents, its bag, and the commands to its world."""
    graph = hospital(rate=100.0, coordinator={"proactive": False})
    path = tmp_path_factory.mktemp("recorded") / "bag"
    told = carried_out(graph, bag=path)
    return graph.without_sources(), path, [each for each in told.messages if isinstance(each, ActionCommand)]


def replayed(graph: Graph, path: Path, *, start: int = SECOND) -> tuple[WorldScript, list[ActionCommand]]:
    given: list[ActionCommand] = []
    with open_bag(path) as bag:
        runner = InlineRunner(graph, start=start)
        runner.tap("/hospital/commands", lambda _, message: given.append(message))  # type: ignore[arg-type]
        script = WorldScript(bag, feeding(bag, graph, None), graph)
        stage = InlineStage(runner, script)
        stage.begin()
        runner.start()
        play(script, stage, Ending())
        assert not any(faults.failures for faults in runner.faults.values())
    return script, given


def test_agents_repeat_their_commands(recorded):
    graph, path, then = recorded
    world, now = replayed(graph, path)
    assert now == then
    assert (world.unanswered, world.sent > 50) == (0, True)


def test_agents_may_use_other_command_ids(recorded):
    graph, path, then = recorded
    world, now = replayed(graph, path, start=SECOND // 2)
    assert world.unanswered == 0
    assert [each.id for each in now] != [each.id for each in then]
    assert [(each.robot, each.action) for each in now] == [(each.robot, each.action) for each in then]


def test_missing_commands_are_skipped(recorded):
    graph, path, then = recorded
    members = [one for one in graph.nodes if one.name != "coordinator"]
    silent = [dataclasses.replace(one, remap={"private": "/nobody"}) for one in members]
    world, now = replayed(Graph("hospital", tuple(silent), graph.inputs), path)
    assert (now, world.unanswered) == ([], len(then))


def test_agents_without_their_coordinator_follow_the_recorded_plans(recorded):
    graph, path, then = recorded
    alone = Graph("hospital", tuple(one for one in graph.nodes if one.name != "coordinator"), graph.inputs)
    world, now = replayed(alone, path)
    assert [(one.stamp, one.action, one.args) for one in now] == [(one.stamp, one.action, one.args) for one in then]
    assert world.unanswered == 0


def test_messages_between_nodes_are_no_commands(recorded):
    graph, path, _ = recorded
    with open_bag(path) as bag:
        assert set(recorded_commands(bag, graph)) == {"/hospital/commands"}


AGENTS = hospital().without_sources()
FEEDS = {"/hospital/results": "/hospital/results"}


def command(seconds: float, id: str) -> ActionCommand:
    return ActionCommand(stamp=nanoseconds(seconds), id=id, robot="a", action="go", args=("a", id[-1]))


def result(seconds: float, id: str) -> ActionResult:
    return ActionResult(stamp=nanoseconds(seconds), id=id, robot="a", action="go", outcome="success")


@contextmanager
def script_of(folder: Path, *messages: ActionCommand | ActionResult) -> Iterator[WorldScript]:
    with BagWriter(folder / "bag") as bag:
        for message in messages:
            topic = "/hospital/commands" if isinstance(message, ActionCommand) else "/hospital/results"
            bag.write(topic, message, message.stamp)
    with open_bag(folder / "bag") as opened:
        yield WorldScript(opened, FEEDS, AGENTS)


def results(messages: Iterable[tuple[str, Message]]) -> list[tuple[str, float]]:
    return [(message.id, message.stamp / SECOND) for _, message in messages if isinstance(message, ActionResult)]


def test_answer_with_an_earlier_time_waits_for_its_command(tmp_path):
    with script_of(tmp_path, result(2.95, "then-1"), command(3.0, "then-1")) as script:
        assert results(script.due_messages(nanoseconds(3.0))) == []
        script.give_command("/hospital/commands", command(3.1, "now-1"))
        assert results(script.due_messages(nanoseconds(3.1))) == [("now-1", 3.05)]
        assert (script.due, script.unanswered) == (None, 0)


def test_command_may_be_caused_by_an_answer_with_a_later_time(tmp_path):
    messages = command(2.9, "then-1"), command(3.0, "then-2"), result(3.04, "then-1"), result(3.1, "then-2")
    with script_of(tmp_path, *messages) as script:
        script.give_command("/hospital/commands", command(2.9, "now-1"))
        assert results(script.due_messages(nanoseconds(2.9))) == []
        assert results(script.due_messages(nanoseconds(3.0))) == []
        assert results(script.overdue_messages(nanoseconds(3.03))) == [("now-1", 3.04)]
        assert results(script.overdue_messages(nanoseconds(3.06))) == [], (
            "the other one answers a command that is not given"
        )
        script.give_command("/hospital/commands", command(3.06, "now-2"))
        assert results(script.due_messages(nanoseconds(3.06))) == []
        assert results(script.due_messages(nanoseconds(3.16))) == [("now-2", 3.16)]


def test_late_command_delays_later_messages(tmp_path):
    with script_of(tmp_path, command(3.0, "then-1"), result(3.5, "then-1")) as script:
        script.give_command("/hospital/commands", command(4.0, "now-1"))
        assert results(script.due_messages(nanoseconds(4.0))) == []
        assert script.due == nanoseconds(4.5)
        assert results(script.due_messages(nanoseconds(4.5))) == [("now-1", 4.5)]


def test_traces_and_states_are_no_commands(tmp_path):
    record = TraceRecord(stamp=SECOND, id="1", source="carrier_a", kind="step", what="go")
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/carrier_a/cmd_target", MoveCommand(stamp=SECOND, target="base"), SECOND)
        bag.write("/gripper_a/gripper_status", GripperStatus(stamp=SECOND, status="open"), SECOND)
        bag.write("/carrier_a/trace", record, SECOND)
    with open_bag(tmp_path / "bag") as opened:
        agents = load_graph("warehouse").without_sources()
        assert recorded_commands(opened, agents) == {"/carrier_a/cmd_target": MoveCommand}


class Heat(Structured, frozen=True, kw_only=True):
    """Message of another package."""

    celsius: float


class Stove(Node):
    """Node with two inputs and an output."""

    heat = Input(Heat, "/heat")
    wish = Input(Utterance, "/wish", Delivery.EVERY, optional=True)
    reply = Output(Utterance, "/reply")

    @heat
    def on_heat(self, message: Heat) -> None:
        """Nothing."""

    @wish
    def on_wish(self, message: Utterance) -> None:
        """Nothing."""


GRAPH = Graph("kitchen", (NodeConfig("stove", Stove),), inputs=frozenset({"/heat"}))


def bag_of(path: Path, **messages: Structured) -> Path:
    with BagWriter(path, compressed=True) as bag:
        for topic, message in messages.items():
            bag.write(f"/{topic}", message, message.stamp)
    return path


def utterance(text: str) -> Utterance:
    return Utterance(stamp=SECOND, id=text, text=text)


def test_inputs_are_fed_from_topics_of_the_same_name_and_type(tmp_path):
    heat = Heat(stamp=SECOND, celsius=80.0)
    with open_bag(bag_of(tmp_path / "bag", heat=heat, wish=utterance("tea"), reply=utterance("no"))) as bag:
        assert feeding(bag, GRAPH, None) == {"/heat": "/heat", "/wish": "/wish"}


def test_message_of_another_package_is_decoded_as_the_graph_declares(tmp_path):
    heat = Heat(stamp=SECOND, celsius=80.0)
    with open_bag(bag_of(tmp_path / "bag", heat=heat)) as bag:
        feeds = feeding(bag, GRAPH, None)
        assert list(bag.messages(feeds, GRAPH.topics())) == [("/heat", heat)]
        assert list(bag.messages(feeds)) == []
        assert bag.skipped["/heat"].count == 1


def test_bag_without_inputs_of_the_graph_is_refused(tmp_path):
    belief = Belief(stamp=SECOND, belief=Fact(name="p"))
    with open_bag(bag_of(tmp_path / "bag", belief=belief)) as bag, pytest.raises(GraphError) as caught:
        feeding(bag, GRAPH, None)
    assert "/heat" in str(caught.value)
    assert "/belief" in str(caught.value)


def test_graph_with_image_inputs_needs_images(tmp_path):
    waldo = load_graph("waldo").without_sources()
    assert takes_images(waldo)
    assert not takes_images(GRAPH)
    with (
        open_bag(bag_of(tmp_path / "bag", wish=utterance("hello"))) as bag,
        pytest.raises(BagError, match="no images"),
    ):
        feeding(bag, waldo, None)


def test_agents_of_the_warehouse_are_fed_with_its_sensors(tmp_path):
    warehouse = load_graph("warehouse")
    status = GripperStatus(stamp=SECOND, status="open")
    names = {"gripper_a/gripper_status": status, "gripper_a/cmd_gripper_status": status}
    with open_bag(bag_of(tmp_path / "bag", **names)) as bag:
        assert feeding(bag, warehouse.without_sources(), None) == {
            "/gripper_a/gripper_status": "/gripper_a/gripper_status"
        }
