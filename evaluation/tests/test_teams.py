from __future__ import annotations

import pytest

from evaluation.report import Report
from evaluation.teams import add_figures
from evaluation.teams_runs import SCENES, Outcome, Schedule, Trouble, play, schedules
from socialbot.core.clock import nanoseconds
from socialbot.graph.inline import InlineRunner

TEAM_SCENES = ["hospital", "library", "library (PDDL)", "warehouse"]


def test_schedules_depend_on_seeds_only_and_have_all_worlds():
    assert schedules(10) == schedules(10)
    assert {schedule.scene for schedule in schedules(5)} == set(SCENES)
    assert len(set(schedules(50))) == 50


@pytest.mark.parametrize(
    "number", [0, 1, *(pytest.param(one, marks=pytest.mark.slow) for one in (2, 3, 19, 24, 93, 113, 119))]
)
def test_everything_that_can_be_done_is_done(number: int):
    outcome = play(schedules(number + 1)[number])
    assert outcome.missed == frozenset()
    assert outcome.unexplained == frozenset()
    assert outcome.failures == ()


@pytest.mark.parametrize("name", TEAM_SCENES)
def test_missions_of_a_dead_team_are_impossible_with_a_reason(name: str):
    scene = SCENES[name]()
    troubles = tuple(Trouble(0.5, "dies", member) for member in scene.members)
    outcome = play(Schedule(name, 0, troubles))
    assert outcome.possible <= outcome.done
    assert outcome.wanted > outcome.done
    assert outcome.unexplained == frozenset()


def test_a_stalled_gripper_can_do_nothing_but_boxes_on_carriers_can_arrive():
    scene = SCENES["warehouse"]()
    runner = InlineRunner(scene.graph("60 stalls gripper_a 100000"))
    runner.start()
    runner.advance(nanoseconds(59.0))
    assert not scene.is_stuck(runner, "gripper_a")
    runner.advance(nanoseconds(61.0))
    assert scene.is_stuck(runner, "gripper_a")
    possible = scene.possible(runner, set(scene.members) - {"gripper_a"}, set())
    assert 0 < len(possible) < len(scene.targets())
    assert possible < scene.possible(runner, set(scene.members), set())


def test_completion_is_read_from_the_world():
    scene = SCENES["hospital"]()
    runner = InlineRunner(scene.graph(""))
    assert scene.done(runner) == set(), "rooms that will be infected are not done"


def test_missed_and_unexplained_targets_are_counted():
    schedule = Schedule("library", 1, (Trouble(1.0, "dies", "runner1"),))
    all_three = frozenset({"a", "b", "c"})
    outcome = Outcome(schedule, frozenset({"a"}), frozenset({"a", "b"}), all_three, {"b": "nobody"}, (), 1.0, 0.0)
    report = Report("teams", quick=True)
    add_figures(report, [outcome])
    figures = {figure.key: figure.value for figure in report.figures}
    assert (figures["possible"], figures["missed_percent"], figures["unexplained"]) == (2, 50.0, 1)
    assert set(report.unmet) == {"missed_percent", "missed_library_percent", "unexplained"}
