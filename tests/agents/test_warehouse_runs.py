"""Whole runs of the warehouse in simulated time, each looked at by a check that shares nothing with the agents."""

from __future__ import annotations

import logging

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from evaluation.warehouse_runs import Kill, Result, Run, Story, play, troubled
from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.warehouse.carrier import Carrier
from socialbot.agents.warehouse.demo import warehouse
from socialbot.agents.warehouse.gripper import gripper_of
from socialbot.agents.warehouse.scenario import GRIPPER, SIX, Scenario
from socialbot.agents.warehouse.world_node import WarehouseWorld, world_of
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.deliberation import _execution as merging
from socialbot.deliberation._action_executor import ActionExecutor
from socialbot.deliberation._plan_executor import PlanExecutor
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig


@pytest.fixture(autouse=True)
def _quiet():
    """Silence the log of injected faults."""
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def fine(result: Result) -> Result:
    assert result.violations == ()
    assert result.failures == ()
    assert result.settled, result.end
    return result


@pytest.mark.slow
def test_run_1_sorts_six_boxes_without_abort():
    result = fine(play(Story(seed=4)))
    assert result.reached
    assert (result.first_steps, result.aborts, result.requests, result.unloads) == (28, 0, 3, 3)
    assert result.first_makespan_s <= 107.1
    assert result.steps == 28 + 3 + 6  # the carriers come once, and go and unload


@pytest.mark.slow
def test_run_2_replans_after_lost_carrier():
    records: list[TraceRecord] = []
    result = fine(play(Story(seed=4, run=2), records.append))
    assert result.reached
    assert (result.aborts, result.plans, result.requests) == (1, 2, 4)
    (failed,) = [one for one in records if one.kind == "plan_end" and one.detail["outcome"] == "failed"]
    reason = str(failed.detail["reason"])
    assert "carrier_c base_c) cannot start: (carrier_in_base carrier_c base_c) does not hold" in reason
    assert not [one for one in records if one.kind == "step_end" and one.detail["outcome"] == "failed"]


def test_a_vanished_box_is_left_out_before_the_gripper_goes_there():
    records: list[TraceRecord] = []
    runner = InlineRunner(warehouse(6, faults="20 vanishes box_c1"))
    runner.tap(f"/{GRIPPER}/trace", lambda topic, message: records.append(message))  # type: ignore[arg-type]
    runner.start()
    runner.advance(nanoseconds(60.0))
    (doubt,) = [one for one in records if one.kind == "doubt"]
    assert "box_c1" in doubt.detail["reason"]
    assert nanoseconds(22.0) <= doubt.stamp < nanoseconds(23.0)
    plans = [one for one in records if one.kind == "plan_start"]
    assert len(plans) == 2
    assert not any("box_c1" in step for step in plans[1].detail["steps"])
    assert not [one for one in records if one.kind == "step_end" and one.detail["outcome"] == "failed"]


def is_all_but(run: Run, box: str) -> None:
    """Check that every box except a vanished one is in its deposit, and that the run says why that one is not."""
    stored = {box: deposit for deposit in SIX.deposits for box in run.world.load[deposit]}
    routes = zip(SIX.loads, SIX.deposits, strict=True)
    assert stored == {other: deposit for load, deposit in routes for other in load if other != box}
    assert f"nothing can make (carrier_moving carrier_{box[-2]} {box}) true" in run.end


@pytest.mark.slow
def test_the_crane_turns_to_another_stack_on_its_way_to_a_vanished_box(tmp_path):
    records: list[TraceRecord] = []
    run = Run(Story(seed=4, faults="57 vanishes box_b1"), tmp_path)
    run.runner.tap(f"/{GRIPPER}/trace", lambda topic, message: records.append(message))  # type: ignore[arg-type]
    fine(run.play())
    (stopped,) = [one for one in records if one.kind == "step_end" and one.detail["outcome"] == "cancelled"]
    assert stopped.what.startswith("(gripper_move gripper_a base_b base_2)")
    assert stopped.detail["message"] == "(gripper_move gripper_a base_b base_1) takes its place"
    assert not [one for one in records if one.kind == "step_end" and one.detail["outcome"] == "failed"]
    assert not any(run.world.load[place] for place in (*SIX.bases, *SIX.bays))
    is_all_but(run, "box_b1")


@pytest.mark.slow
@pytest.mark.parametrize("faults", ["1 vanishes box_a1", "7 vanishes box_b2", "50 vanishes box_b1"])
def test_a_vanished_box_costs_no_other_box(tmp_path, faults):
    run = Run(Story(seed=4, faults=faults), tmp_path)
    fine(run.play())
    is_all_but(run, faults.split()[-1])


@pytest.mark.slow
def test_a_sensor_that_is_silent_for_ever_costs_only_what_needs_it(tmp_path):
    run = Run(Story(seed=4, faults="2 silent carrier_a 5000"), tmp_path)
    run.play()
    assert not run.violations
    stored = {deposit: set(run.world.load[deposit]) for deposit in SIX.deposits}
    assert {"box_b1", "box_b2"} <= stored["deposit_b"], run.end
    assert {"box_c1", "box_c2"} <= stored["deposit_c"], run.end
    assert "without sensor status of carrier_a: nothing can make (carrier_moving carrier_a" in run.end


@pytest.mark.slow
def test_same_seed_gives_same_records():
    story = Story(seed=9, faults="6 leaves carrier_b; 12 slips", kills=(Kill(9.0, "carrier_a", 1.0),), limit_s=25.0)
    first: list[TraceRecord] = []
    again: list[TraceRecord] = []
    play(story, first.append)
    play(story, again.append)
    assert len(first) > 200
    assert first == again


def test_restarted_agent_continues_from_its_file():
    records: list[TraceRecord] = []
    result = fine(play(Story(seed=2, kills=(Kill(33.3, "gripper_a", 2.0),)), records.append))
    assert result.reached
    assert result.plans == 2
    plans = [one for one in records if one.kind == "plan_start" and one.source == "gripper_a"]
    assert len(plans[1].detail["steps"]) < 25  # the boxes that have gone are not sorted again


def test_faults_cause_no_invalid_step_and_no_deadlock():
    fine(play(troubled(254799633)))  # the last carrier is asked to unload after the end of the last desire


@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**32))
def test_many_seeds_cause_no_invalid_step(seed):
    fine(play(troubled(seed)))


@pytest.mark.slow
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**32), run=st.sampled_from([1, 2]))
def test_noise_alone_never_prevents_the_goal(seed, run):
    result = fine(play(Story(seed, run=run)))
    assert result.reached
    assert (result.aborts, result.requests) == (run - 1, run + 2)


@pytest.mark.slow
def test_24_boxes_go_with_6_carriers():
    assert fine(play(Story(seed=1, boxes=24))).reached


# That the check sees it when the director does what it must not


def test_a_director_that_begins_steps_without_a_look_at_their_conditions_is_caught(monkeypatch):
    monkeypatch.setattr(ActionExecutor, "_missing_at_start", lambda self, task: None)
    monkeypatch.setattr(PlanExecutor, "_look_ahead", lambda self, execution: None)
    violations = play(Story(seed=4, run=2, limit_s=100.0)).violations
    assert any("(carrier_in_base carrier_c base_c) does not hold" in one for one in violations)


def test_a_director_that_knows_no_causal_order_is_caught(monkeypatch):
    monkeypatch.setattr(merging, "_task_events", lambda numbered, tasks: ())
    assert play(Story(seed=4, limit_s=8.0)).violations


def test_a_director_that_does_not_mind_silent_sensors_is_caught(monkeypatch):
    monkeypatch.setattr(PlanExecutor, "hold", lambda self, reason: None)
    violations = play(Story(seed=4, faults="12 silent carrier_a 10", limit_s=25.0)).violations
    assert any("begins while sensor status of carrier_a is silent" in one for one in violations)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    ["72 stalls gripper_a 30", "30 leaves carrier_c; 60 leaves carrier_b"],
)
def test_boxes_are_in_their_deposits_when_the_goal_is_reached(fault):
    """A carrier that missed the report of its load, or left with one box, is sent off."""
    result = fine(play(Story(seed=4, faults=fault)))
    assert result.reached
    assert result.boxes_right


def odd_warehouse(boxes: int, carriers: int) -> InlineRunner:
    gripper, world = gripper_of(boxes, carriers, "OddGripper"), world_of(boxes, carriers, "OddWorld")
    nodes = [NodeConfig(carrier, Carrier) for carrier in gripper.scenario.carriers]
    return InlineRunner(Graph("odd", (NodeConfig("world", world), *nodes, NodeConfig(GRIPPER, gripper))))


@pytest.mark.parametrize(("boxes", "carriers"), [(5, 2), pytest.param(7, 3, marks=pytest.mark.slow)])
def test_carriers_with_one_box_are_sent_off_when_no_more_come(boxes, carriers):
    runner = odd_warehouse(boxes, carriers)
    runner.start()
    runner.advance(nanoseconds(200.0))
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    load, scenario = node.world.load, runner.nodes[GRIPPER].scenario  # type: ignore[attr-defined]
    assert [sorted(load[deposit]) for deposit in scenario.deposits] == [sorted(boxes) for boxes in scenario.loads]


def at_60_s(faults: str = "") -> InlineRunner:
    """The warehouse with six boxes after 60 s; each carrier has one box or two."""
    runner = InlineRunner(warehouse(6, faults=faults))
    runner.start()
    runner.advance(nanoseconds(60.0))
    return runner


def boxes_of(runner: InlineRunner, *holders: str) -> set[str]:
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    return {box for holder in holders for box in node.world.load[holder]}


def check_deliveries_without_gripper(runner: InlineRunner, scenario: Scenario) -> None:
    """Check that all boxes on carriers are delivered after the end of the gripper."""
    loaded = boxes_of(runner, *scenario.carriers)
    assert loaded
    runner.kill(GRIPPER)
    runner.advance(nanoseconds(300.0))
    assert boxes_of(runner, *scenario.deposits) >= loaded


def test_a_carrier_delivers_its_boxes_when_the_gripper_has_died():
    runner = odd_warehouse(2, 1)
    runner.start()
    runner.advance(nanoseconds(40.0))
    check_deliveries_without_gripper(runner, runner.nodes[GRIPPER].scenario)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_carriers_deliver_their_boxes_when_the_gripper_has_died():
    check_deliveries_without_gripper(at_60_s(), SIX)


def test_a_carrier_with_one_box_waits_for_a_gripper_that_answers():
    runner = at_60_s("60 stalls gripper_a 200")
    waiting = {carrier for carrier in SIX.carriers if len(boxes_of(runner, carrier)) == 1}
    assert waiting
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    runner.advance(nanoseconds(85.0))
    assert {node.world.status(carrier).current_name for carrier in waiting} == {"base"}


@pytest.mark.parametrize(
    ("how", "boxes"), [("dies", 2), *(pytest.param(how, 6, marks=pytest.mark.slow) for how in ("dies", "hangs"))]
)
def test_boxes_that_stay_on_a_carrier_are_reported_and_end_the_run(how: str, boxes: int):
    """A carrier that died, or hangs with its boxes, is asked ever more rarely, and then given up."""
    full = InlineRunner(warehouse(6, faults="100 stalls carrier_a 100000" if how == "hangs" else ""))
    runner = full if boxes == 6 else odd_warehouse(boxes, 1)
    records: list[TraceRecord] = []
    runner.tap(f"/{GRIPPER}/trace", lambda _, message: records.append(message))  # type: ignore[arg-type]
    runner.start()
    runner.advance(nanoseconds(100.0 if boxes == 6 else 40.0))
    if how == "dies":
        runner.kill("carrier_a")
    agents = [node.deliberator for node in runner.nodes.values() if isinstance(node, Deliberating)]
    while any(agent.is_at_work for agent in agents):
        runner.advance(runner.clock.now() + nanoseconds(5.0))
        assert runner.clock.now() < nanoseconds(900.0)
    (stuck,) = [record for record in records if record.what == "unloading of carrier_a"]
    left = boxes_of(runner, "carrier_a")
    assert left
    assert all(box in stuck.detail["message"] for box in left)
    asked = [record for record in records if record.kind == "request" and "sent_off" in record.what]
    assert 0 < len(asked) <= 7
