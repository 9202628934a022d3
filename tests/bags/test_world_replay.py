"""Replay of the world side of a bag, in response to commands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from socialbot.agents.hospital.demo import hospital
from socialbot.agents.hospital.ward.messages import ActionCancel, ActionCommand, ActionResult
from socialbot.agents.warehouse.messages import GripperStatus, MoveCommand
from socialbot.bags.reader import open_bag
from socialbot.bags.topic_mapping import feeding
from socialbot.bags.world_replay import CommandMatcher, InlineStage, WorldScript, commands, play
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.core.process import Ending
from socialbot.graph.files import load_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from tests.agents.hospital.runs import carried_out

GO = ActionCommand(stamp=1, id="then-1", robot="a", action="go", args=("a", "b"))


def test_a_command_is_the_same_whatever_its_id_and_time():
    told = CommandMatcher()
    assert not told.take("/c", GO)
    told.give("/c", ActionCommand(stamp=9, id="now-7", robot="a", action="go", args=("a", "b")))
    assert not told.take("/other", GO)
    assert told.take("/c", GO)
    assert not told.take("/c", GO), "each one counts once"


def test_answers_have_the_id_that_the_command_has_now():
    told = CommandMatcher()
    told.give("/c", ActionCommand(stamp=9, id="now-7", robot="a", action="go", args=("a", "b")))
    told.take("/c", GO)
    result = ActionResult(stamp=20, id="then-1", robot="a", action="go", outcome="success")
    assert told.as_now(result, late=5) == ActionResult(stamp=25, id="now-7", robot="a", action="go", outcome="success")
    told.give("/cancels", ActionCancel(stamp=30, id="now-7"))
    assert told.take("/cancels", ActionCancel(stamp=22, id="then-1"))


def test_commands_without_ids_are_told_apart_by_what_they_say():
    told = CommandMatcher()
    told.give("/c", MoveCommand(stamp=1, target="base"))
    assert not told.take("/c", MoveCommand(stamp=1, target="bay"))
    assert told.take("/c", MoveCommand(stamp=3, target="base"))


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


def test_agents_do_in_the_recorded_world_what_they_did_in_the_real_one(recorded):
    graph, path, then = recorded
    world, now = replayed(graph, path)
    assert now == then
    assert (world.unanswered, world.sent > 50) == (0, True)


def test_they_do_so_though_they_call_their_commands_otherwise(recorded):
    graph, path, then = recorded
    world, now = replayed(graph, path, start=SECOND // 2)
    assert world.unanswered == 0
    assert [each.id for each in now] != [each.id for each in then]
    assert [(each.robot, each.action) for each in now] == [(each.robot, each.action) for each in then]


def test_the_world_goes_on_without_commands_that_do_not_come(recorded):
    graph, path, then = recorded
    silent = Graph("hospital", tuple(one for one in graph.placements if one.name != "coordinator"), graph.inputs)
    world, now = replayed(silent, path)
    assert (now, world.unanswered) == ([], len(then))


def test_what_nodes_hear_of_each_other_is_no_command(recorded):
    graph, path, _ = recorded
    with open_bag(path) as bag:
        assert set(commands(bag, graph)) == {"/hospital/commands"}


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


def said(messages: Iterable[tuple[str, Message]]) -> list[tuple[str, float]]:
    return [(message.id, message.stamp / SECOND) for _, message in messages if isinstance(message, ActionResult)]


def test_an_answer_that_bears_an_earlier_time_than_its_command_waits_for_it(tmp_path):
    with script_of(tmp_path, result(2.95, "then-1"), command(3.0, "then-1")) as script:
        assert said(script.say(nanoseconds(3.0))) == []
        script.hear("/hospital/commands", command(3.1, "now-1"))
        assert said(script.say(nanoseconds(3.1))) == [("now-1", 3.05)]
        assert (script.due, script.unanswered) == (None, 0)


def test_a_command_may_follow_from_an_answer_that_bears_a_later_time(tmp_path):
    messages = command(2.9, "then-1"), command(3.0, "then-2"), result(3.04, "then-1"), result(3.1, "then-2")
    with script_of(tmp_path, *messages) as script:
        script.hear("/hospital/commands", command(2.9, "now-1"))
        assert said(script.say(nanoseconds(2.9))) == []
        assert said(script.say(nanoseconds(3.0))) == []
        assert said(script.wait(nanoseconds(3.03))) == [("now-1", 3.04)]
        assert said(script.wait(nanoseconds(3.06))) == [], "the other one answers a command that is not given"
        script.hear("/hospital/commands", command(3.06, "now-2"))
        assert said(script.say(nanoseconds(3.06))) == []
        assert said(script.say(nanoseconds(3.16))) == [("now-2", 3.16)]


def test_what_comes_late_moves_all_that_follows(tmp_path):
    with script_of(tmp_path, command(3.0, "then-1"), result(3.5, "then-1")) as script:
        script.hear("/hospital/commands", command(4.0, "now-1"))
        assert said(script.say(nanoseconds(4.0))) == []
        assert script.due == nanoseconds(4.5)
        assert said(script.say(nanoseconds(4.5))) == [("now-1", 4.5)]


def test_commands_are_what_agents_told_the_world(tmp_path):
    record = TraceRecord(stamp=SECOND, id="1", source="carrier_a", kind="step", what="go")
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/carrier_a/cmd_target", MoveCommand(stamp=SECOND, target="base"), SECOND)
        bag.write("/gripper_a/gripper_status", GripperStatus(stamp=SECOND, status="open"), SECOND)
        bag.write("/carrier_a/trace", record, SECOND)
    with open_bag(tmp_path / "bag") as opened:
        agents = load_graph("warehouse").without_sources()
        assert commands(opened, agents) == {"/carrier_a/cmd_target": MoveCommand}
