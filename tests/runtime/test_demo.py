from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from socialbot.agents.warehouse.demo import KINDS, scenario_with, warehouse
from socialbot.bags.reader import open_bag
from socialbot.cli.new import write_project
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Health, Message, State, TraceRecord
from socialbot.deliberation.messages import Desire, DesireSet, LifecycleStatus
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from socialbot.runs.record import NOTHING_SHOWN, MessageObserver, RunRecord
from socialbot.runs.report import RunReport, write_report
from socialbot.runtime.run import RunResult, run
from socialbot.runtime.simulated_source import (
    QUIET_S,
    DesiresDone,
    SimulatedSource,
    SimulatorsDone,
    clock_step_s,
    completion_check,
    replay_topics,
    simulation_topics,
)

pytest.importorskip("kairos", reason="kairos-planner is not installed")


def desires(seconds: float, agent: str, *names: str) -> DesireSet:
    wanted = tuple(Desire(name=name) for name in names)
    return DesireSet(stamp=nanoseconds(seconds), agent_id=agent, value=wanted)


def over(check: DesiresDone, seconds: float) -> bool:
    return check.are_over(nanoseconds(seconds))


def test_a_run_ends_after_a_time_without_desires():
    check = DesiresDone()
    check.observe(desires(0.0, "a"))
    assert not over(check, 100.0), "nobody has begun yet"
    check.observe(desires(1.0, "a", "tea"))
    check.observe(desires(2.0, "b", "rest"))
    check.observe(desires(3.0, "a"))
    assert not over(check, 100.0)
    check.observe(desires(4.0, "b"))
    assert not over(check, 3.9 + QUIET_S)
    assert over(check, 4.0 + QUIET_S)


def test_a_new_desire_continues_the_run():
    check = DesiresDone()
    for seconds, names in ((0.0, ("tea",)), (1.0, ()), (2.0, ("more",)), (3.0, ())):
        check.observe(desires(seconds, "a", *names))
    assert not over(check, 5.0)
    assert over(check, 6.0)


@pytest.mark.parametrize(
    ("status", "reason"),
    [("SCHEDULING", "carrier_a with boxes"), ("ABORTING", ""), ("PAUSED", "sensor of boxes is silent")],
)
def test_a_run_goes_on_while_an_agent_without_desires_is_at_work(status: Any, reason: str):
    check = DesiresDone()
    check.observe(desires(1.0, "a", "tea"))
    check.observe(LifecycleStatus(stamp=nanoseconds(2.0), agent_id="a", status=status, reason=reason))
    check.observe(desires(3.0, "a"))
    assert not over(check, 100.0)
    check.observe(LifecycleStatus(stamp=nanoseconds(100.0), agent_id="a", status="SCHEDULING"))
    assert not over(check, 99.9 + QUIET_S)
    assert over(check, 100.0 + QUIET_S)


def health(seconds: float, node: str, state: State) -> Health:
    return Health(stamp=nanoseconds(seconds), node=node, state=state)


def test_a_run_ends_after_all_simulators():
    check = SimulatorsDone(frozenset({"room", "visitors"}))
    for told in (health(1.0, "room", "ok"), health(2.0, "room", "ended"), health(3.0, "mind", "ended")):
        check.observe(told)
    assert not check.are_over(nanoseconds(100.0))
    check.observe(health(4.0, "visitors", "ended"))
    check.observe(health(5.0, "room", "ended"))
    assert not check.are_over(nanoseconds(3.9 + QUIET_S))
    assert check.are_over(nanoseconds(4.0 + QUIET_S))


def test_agents_without_desires_run_until_their_simulator_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    project = write_project("robot_of_the_demo", "python", tmp_path)
    graph, seen = load_graph(str(project / "graph.yaml")), []
    assert isinstance(completion_check(graph), SimulatorsDone)
    ran = simulated(graph, tmp_path / "run", lambda topic, message: seen.append((topic, message)))
    assert ran.ended == NOTHING_SHOWN
    assert ran.seconds == pytest.approx(15.0)
    assert {"/humans/bodies/detections", "/agent/trace", "/speech/status"} <= {topic for topic, _ in seen}
    assert list((tmp_path / "run" / "speech").glob("*.wav"))


def simulated(
    graph: Graph, folder: Path, observe: MessageObserver = lambda topic, message: None, **source: Any
) -> RunResult:
    with RunRecord(folder) as record:
        return run(graph, SimulatedSource(**source), record, observe)


@pytest.fixture(scope="module")
def cleaned(tmp_path_factory: pytest.TempPathFactory):
    """The cleaner and the sweeper at work: what came of it, and the messages."""
    folder = tmp_path_factory.mktemp("run")
    graph = load_graph("cleaner-sweeper")
    report, seen = RunReport(graph), []

    def observe(topic: str, message: Message) -> None:
        report.observe(topic, message)
        seen.append((topic, message))

    with RunRecord(folder) as record:
        source = SimulatedSource(bag=folder / "bag")
        ran = run(graph, source, record, observe, summarize=lambda: report.story().results())
    return graph, ran, report, seen, folder


def test_agents_run_until_their_desires_are_fulfilled(cleaned):
    _, ran, report, _, _ = cleaned
    story = report.story()
    assert story.reached
    assert story.results()["requests_for_desires"] == 2
    assert ran.ended == "nobody wants anything more"
    assert ran.seconds == pytest.approx(story.duration_s + QUIET_S, abs=0.2)
    assert all(fate.failures == 0 for fate in ran.nodes.values())


def test_observes_the_topics_of_a_simulation(cleaned):
    graph, _, _, seen, _ = cleaned
    assert {topic for topic, _ in seen} <= set(simulation_topics(graph))
    assert any(isinstance(message, TraceRecord) for _, message in seen)


def test_a_bag_has_traces_requests_and_the_graph(cleaned):
    graph, _, _, seen, folder = cleaned
    expected = sum(topic in replay_topics(graph) for topic, _ in seen)
    with open_bag(folder / "bag") as bag:
        assert sum(topic.count for topic in bag.topics) == expected
        assert {"/cleaner/trace", "/sweeper/trace", "/agents/requests"} <= {topic.name for topic in bag.topics}
    assert load_graph(str(folder / "bag" / "graph.yaml")) == graph


def test_the_page_of_a_run_without_a_floor_is_written(cleaned):
    folder = cleaned[-1]
    page = write_report(folder, "Cleaning")
    assert "<title>Cleaning" in page.read_text("utf-8")
    assert not (folder / "floor.svg").exists()


def test_a_run_ends_when_its_time_is_up(tmp_path: Path):
    report = RunReport(graph := load_graph("cleaner-sweeper"))
    ran = simulated(graph, tmp_path, report.observe, limit_s=7.0)
    assert (ran.ended, ran.seconds) == ("the time was up", 7.0)
    assert not report.story().reached


def test_a_run_can_be_paced(tmp_path: Path):
    ran = simulated(load_graph("cleaner"), tmp_path, rate=20.0, limit_s=8.0)
    assert ran.wall_s >= 0.35


def test_results_describe_the_run(cleaned):
    results = cleaned[1].results
    assert results["graph"] == "cleaner-sweeper"
    assert results["reached"] is True
    assert results["agents"]["cleaner"] == {"plans": 1, "given_up": 0, "steps": 7, "requests": 2}
    assert {desire["how"] for desire in results["desires"]} == {"fulfilled"}
    assert results["parameters"]["cleaner"]["planner"] == "kairos"


@pytest.mark.parametrize("boxes", sorted(KINDS))
def test_the_warehouse_has_a_graph_for_each_size(boxes):
    graph = warehouse(boxes, run=2, seed=7, faults="30 slips")
    cast = scenario_with(boxes)
    names = [config.name for config in graph.nodes]
    assert names == ["world", *cast.carriers, "gripper_a"]
    assert graph.node("world").parameters == {"seed": 7, "faults": "30 slips"}
    hasty = [name for name in names if "init_reactive_rules_set" in graph.node(name).parameters]
    assert hasty == [cast.carriers[-1]]


def test_six_boxes_are_the_built_in_graph():
    ours, theirs = warehouse(), load_graph("warehouse")
    assert [(p.name, p.type) for p in ours.nodes] == [(p.name, p.type) for p in theirs.nodes]
    assert ours.node("gripper_a").parameters == theirs.node("gripper_a").parameters


def test_records_the_simulator_and_its_commands():
    topics = replay_topics(load_graph("warehouse"))
    assert {"/warehouse/boxes", "/carrier_a/cmd_target", "/gripper_a/trace", "/agents/replies"} <= set(topics)
    assert "/gripper_a/belief_set" not in topics


def test_the_time_of_a_run_begins_at_one_second(cleaned):
    # Zero means to ROS that there is no time yet, and bags are replayed over ROS, too.
    _, _, _, seen, _ = cleaned
    assert min(message.stamp for _, message in seen) == SECOND


@pytest.mark.parametrize(
    ("graph", "changes", "step_s"),
    [
        ("warehouse", {}, 0.1),
        ("warehouse", {"world": {"period_s": 0.05}}, 0.05),
        ("hospital", {"world": {"period_s": 5.0}}, 0.1),
        ("foyer", {"place": {"rate_hz": 20.0}}, 0.05),
    ],
)
def test_no_simulator_acts_twice_in_a_step_of_the_clock(graph, changes, step_s):
    assert clock_step_s(load_graph(graph).with_parameters(changes)) == step_s
