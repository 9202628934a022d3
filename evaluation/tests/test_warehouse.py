from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from rich.console import Console

from evaluation.report import Report, run_kinds
from evaluation.warehouse import (
    HASTY,
    LARGE,
    NOMINAL,
    QUICK,
    TROUBLED,
    Scale,
    add_runs,
    stories,
    tell_what_went_wrong,
)
from evaluation.warehouse_planning import decisions, first_question, plan_by_turns, second_question
from evaluation.warehouse_runs import Kill, Result, Story, play, troubled
from socialbot.agents.warehouse.scenario import GRIPPER
from socialbot.planning.planners.planner import PlannerLimits

GOOD = Result(
    story=Story(3),
    end="fulfilled",
    ended_s=120.5,
    over=True,
    first_steps=28,
    first_makespan_s=107.006,
    plans=1,
    aborts=0,
    requests=3,
    steps=37,
    boxes_right=True,
    unloads=3,
    violations=(),
    failures=(),
    processor_s=1.0,
)
REPLANNED = replace(GOOD, story=Story(3, run=2), plans=2, aborts=1, requests=4)
ALL_WELL = {NOMINAL: [GOOD], HASTY: [REPLANNED], TROUBLED: [GOOD], LARGE: [GOOD]}


def unmet(**kinds: Result) -> list[str]:
    report = Report("warehouse", quick=True)
    add_runs(report, {**ALL_WELL, **{kind.replace("_", " "): [result] for kind, result in kinds.items()}})
    return report.unmet


def test_nothing_is_missed_when_all_is_well():
    assert unmet() == []


@pytest.mark.parametrize(
    ("kind", "changes", "missed"),
    [
        ("run_1", {"first_steps": 29}, "run1_steps"),
        ("run_1", {"first_makespan_s": 107.2}, "run1_makespan_s"),
        ("run_1", {"boxes_right": False}, "run1_missed"),
        ("run_1", {"end": "dropped: too late"}, "run1_missed"),
        ("run_1", {"aborts": 1}, "run1_aborts"),
        ("run_1", {"unloads": 2}, "run1_not_unloaded"),
        ("run_2", {"aborts": 0, "plans": 1}, "run2_without_replan"),
        ("run_2", {"requests": 3}, "run2_other_requests"),
        ("faults", {"over": False}, "faults_unsettled"),
        ("faults", {"end": "dropped"}, "faults_unsettled"),
        ("faults", {"boxes_right": False}, "faults_unsettled"),
        ("faults", {"violations": ("x",)}, "violations"),
        ("faults", {"failures": ("x",)}, "failures"),
    ],
)
def test_whatever_is_not_as_required_is_named(kind, changes, missed):
    before = REPLANNED if kind == "run_2" else GOOD
    assert unmet(**{kind: replace(before, **changes)}) == [missed]


def test_a_desire_that_is_dropped_for_a_reason_is_as_good_when_things_go_wrong():
    assert unmet(faults=replace(GOOD, end="dropped: no plan after 16 tries", boxes_right=False)) == []


def test_failed_runs_are_reported_with_the_command_to_repeat_them():
    story = Story(7, faults="30 leaves carrier_a", kills=(Kill(4.5, GRIPPER, 2.0),))
    console = Console(record=True, width=200)
    wrong = replace(GOOD, story=story, end="", over=False, violations=("v1", "v2"))
    tell_what_went_wrong({**ALL_WELL, TROUBLED: [GOOD, wrong]}, console)
    assert console.export_text().splitlines() == [
        "faults, run 1, 6 boxes, seed 7: 30 leaves carrier_a; 4.5 killed gripper_a 2: no end; v1; v2"
    ]


def test_every_story_is_different_and_most_have_kills_in_them():
    found = stories(Scale())
    assert [len(some) for some in found.values()] == [50, 50, 100, 5]
    assert len({str(story) for story in found[TROUBLED]}) == 100
    assert 50 < sum(bool(story.kills) for story in found[TROUBLED]) < 95
    assert {kill.who for story in found[TROUBLED] for kill in story.kills} == {
        GRIPPER, "carrier_a", "carrier_b", "carrier_c",
    }  # fmt: skip
    assert troubled(11) == troubled(11)
    assert [len(some) for some in stories(QUICK).values()] == [3, 3, 4, 1]


def test_no_process_is_killed_while_another_is_down():
    for seed in range(300):
        kills = troubled(seed).kills
        for one, other in itertools.pairwise(kills):
            assert other.time_s > one.time_s + one.down_s


@pytest.mark.slow
def test_runs_side_by_side_come_to_the_same_as_one_after_the_other():
    kinds = {"short": [Story(seed, limit_s=12.0, faults="5 leaves carrier_a") for seed in (1, 2)]}
    side_by_side = run_kinds(play, kinds, jobs=2)["short"]
    one_by_one = [play(story) for story in kinds["short"]]
    assert [replace(one, processor_s=0) for one in side_by_side] == [replace(one, processor_s=0) for one in one_by_one]
    assert not any(one.over for one in one_by_one)


@pytest.mark.slow
def test_plans_are_made_for_all_sizes_and_for_the_second_run():
    questions = {"6": first_question(6), "24": first_question(24), "again": second_question()}
    found = plan_by_turns(questions, 2)
    assert found["6"].steps == 28
    assert found["24"].makespan_s > 400
    assert 7 <= found["again"].steps < 28
    assert all(one.median_s >= one.best_s > 0 < one.processor_s for one in found.values())
    assert all(len(one.walls) == 2 for one in found.values())


def test_a_question_without_an_answer_is_an_error():
    question = replace(first_question(6), limits=PlannerLimits(makespan_s=10.0, timeout_s=0.5))
    with pytest.raises(ValueError, match="no plan for much too short"):
        plan_by_turns({"much too short": question}, 1)


def test_deciding_is_measured_for_few_and_for_many_desires_that_a_change_concerns():
    found = decisions(60, 9)
    assert 0 < found["one"].median_ms < found["all"].median_ms
    assert found["all"].worst_ms >= found["all"].median_ms
