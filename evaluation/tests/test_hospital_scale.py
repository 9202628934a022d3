from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from evaluation.hospital_scale import (
    KILLED,
    OTHER,
    PLAIN,
    PLAN_ROOMS,
    PLAN_S,
    QUICK,
    RATES,
    Scale,
    add_growth,
    add_planning,
    add_runs,
    grown,
    killed,
    stories,
    tell_what_went_wrong,
)
from evaluation.hospital_scale_runs import Kill, Result, Run, Story, play, violations
from evaluation.report import Report, run_kinds
from socialbot.agents.hospital.ward.ward import PROBLEMS, drawn_problems, large_ward
from socialbot.agents.teams.messages import ActionCommand, ActionResult

GOOD = Result(
    story=Story(3, 50.0),
    infections=50,
    lost=(),
    stood_still=False,
    ended_s=170.0,
    drawn=Counter(dirty=20),
    met=Counter({"dirty room": 12}),
    problems=10,
    missions=50,
    open=0,
    recoveries=9,
    revisions=8,
    interrupted=2,
    plans=70,
    planning_s=(0.001, 0.002),
    said=2000,
    messages=5000,
    actions=600,
    violations=(),
    failures=(),
    processor_s=2.0,
    wall_s=2.0,
    memory_mb=50.0,
)
SMALL = Story(1, 100.0, rooms=3, spots=1, uvds=1, every_s=0.0)


def unmet(kind: str, result: Result) -> list[str]:
    report = Report("hospital at scale", quick=True)
    add_runs(report, {PLAIN: [GOOD], OTHER: [GOOD], KILLED: [GOOD], kind: [result]})
    return report.unmet


def test_nothing_is_missed_when_all_is_well():
    assert unmet(PLAIN, GOOD) == []


@pytest.mark.parametrize(
    ("kind", "changes", "missed"),
    [
        (PLAIN, {"lost": ("room7",)}, ["ward_lost"]),
        (PLAIN, {"lost": ("room7",) * 8}, ["ward_missed_percent", "ward_worst_percent", "ward_lost"]),
        (PLAIN, {"stood_still": True}, ["ward_still"]),
        (OTHER, {"open": 1}, ["other_open"]),
        (KILLED, {"lost": ("room7",)}, ["killed_lost"]),
        (KILLED, {"interrupted": 0}, ["killed_idle"]),
        (PLAIN, {"violations": ("x",)}, ["violations"]),
        (OTHER, {"failures": ("x",)}, ["failures"]),
    ],
)
def test_whatever_is_not_as_required_is_named(kind, changes, missed):
    assert unmet(kind, replace(GOOD, **changes)) == missed


def test_runs_that_take_too_long_are_named():
    assert unmet(PLAIN, replace(GOOD, processor_s=721.0)) == ["ward_processor_s"]


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({}, []),
        ({"lost": ("room7",)}, ["growth_lost"]),
        ({"missions": 49}, ["growth_unfinished"]),
        ({"violations": ("x",)}, ["growth_violations"]),
    ],
)
def test_wards_that_grow_are_judged_too(changes, missed):
    report = Report("hospital at scale", quick=True)
    add_growth(report, [replace(GOOD, **changes)])
    assert report.unmet == missed
    assert report.tables["growth"]["50 rooms, 8 robots"]["agents"] == 58


def test_a_failed_run_is_reported_with_its_seed(capsys: pytest.CaptureFixture[str]):
    tell_what_went_wrong([GOOD, replace(GOOD, lost=("room7",))], Console(width=300))
    assert capsys.readouterr().out == "50 rooms, 4 and 4 robots, 50 %, auto, looks ahead, seed 3: lost: room7\n"


def test_the_stories_are_as_many_as_required_and_kill_at_different_moments():
    kinds = stories(Scale())
    assert len(kinds[PLAIN]) == 200
    assert {(story.rooms, story.spots, story.uvds) for story in kinds[PLAIN]} == {(50, 4, 4)}
    assert {story.rate for story in kinds[PLAIN]} == set(RATES)
    assert len({story.kills for story in kinds[KILLED]}) == 20
    assert killed(4) == killed(4)


def test_a_small_ward_is_disinfected_and_every_problem_kind_is_drawn_somewhere():
    result = play(SMALL)
    assert result.fine
    assert (result.infections, result.missions, result.share) == (3, 3, 100.0)
    assert result.drawn.total() == 3
    assert result.planning_s
    assert {fault.kind for fault in drawn_problems(large_ward(), 0, 100.0)} == set(PROBLEMS)


@pytest.mark.parametrize("time_s", [1.4, 3.3])
def test_a_coordinator_that_is_killed_completes_its_missions_when_it_is_back(time_s):
    result = play(replace(SMALL, kills=(Kill(time_s, 2.0),)))
    assert result.fine
    assert result.missions == 3
    assert result.interrupted == 1


def test_a_ward_without_possible_actions_stands_still():
    result = play(replace(SMALL, spots=0))
    assert result.stood_still
    assert not result.fine
    assert len(result.lost) == 3


@pytest.mark.slow
def test_runs_side_by_side_come_in_the_order_of_their_stories():
    kinds = {PLAIN: [SMALL], KILLED: [replace(SMALL, rate=0.0), replace(SMALL, seed=2)]}
    results = run_kinds(play, kinds, 2)
    assert [one.story for one in results[PLAIN]] == kinds[PLAIN]
    assert [one.story for one in results[KILLED]] == kinds[KILLED]


def test_planning_many_rooms_at_once_is_measured():
    report = Report("hospital at scale", quick=True)
    add_planning(report, times=1)
    content = report.content()
    assert content["plan_actions"] == 9 * PLAN_ROOMS
    assert content["required"] == {"plan_processor_s": PLAN_S}
    assert content["plan_processor_s"] > 0


def test_a_ward_that_grows_has_half_of_its_robots_of_each_kind():
    assert [(one.rooms, one.spots, one.uvds) for one in (grown(*size) for size in QUICK.sizes)] == [
        (1, 1, 1),
        (10, 1, 1),
        (10, 5, 5),
        (100, 5, 5),
    ]


HOMES = {"nurse_disinfected1": "room1", "nurse_disinfected2": "room2"}

Record = tuple[list[ActionCommand], list[ActionResult]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Record:
    run = Run(Story(0, 0.0, rooms=2, spots=2, uvds=2, every_s=0.0), tmp_path_factory.mktemp("run"))
    result = run.play()
    assert result.fine
    return run.commands, run.results


def first(results: list[ActionResult], action: str, outcome: str = "success") -> int:
    return next(i for i, one in enumerate(results) if (one.action, one.outcome) == (action, outcome))


def found(record: Record, change: Callable[[list[ActionCommand], list[ActionResult]], object]) -> list[str]:
    commands, results = list(record[0]), list(record[1])
    change(commands, results)
    return violations(HOMES, commands, results)


def replaced(action: str, **changes) -> Callable[[list[ActionCommand], list[ActionResult]], None]:
    def change(commands: list[ActionCommand], results: list[ActionResult]) -> None:
        index = first(results, action)
        results[index] = msgspec.structs.replace(results[index], **changes)

    return change


def without(action: str, count: int = 1) -> Callable[[list[ActionCommand], list[ActionResult]], None]:
    def change(commands: list[ActionCommand], results: list[ActionResult]) -> None:
        for _ in range(count):
            del results[first(results, action)]

    return change


def twice(commands: list[ActionCommand], results: list[ActionResult]) -> None:
    results.append(results[0])


def test_a_run_of_the_real_agents_breaks_no_rule(recorded: Record):
    assert violations(HOMES, *recorded) == []
    assert len(recorded[1]) > 20


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (replaced("a_patrol_room", id="x"), "was not commanded"),
        (replaced("a_patrol_room", args=("spotrobot1", "room9")), "was not commanded"),
        (twice, "has 2 results"),
        (replaced("a_patrol_room", duration_s=100.0), "was over"),
        (without("a_authenticate_nurse"), "was done alone"),
        (replaced("a_authorize_patrol", stamp=7), "was done alone"),
        (without("a_authenticate_nurse", 2), "the nurse does not know the robot"),
        (without("a_authorize_patrol", 2), "nobody has allowed it"),
        (without("a_patrol_room"), "it was not let in"),
        (without("a_authorize_disinfect", 2), "it was not let in"),
    ],
)
def test_violated_rules_are_named(recorded: Record, change, what: str):
    assert any(what in violation for violation in found(recorded, change))


def test_an_action_that_starts_at_the_end_of_another_is_not_parallel():
    commands = [ActionCommand(stamp=0, id=id, robot="r", action="a_charge", args=("r",)) for id in "ab"]
    results = [
        ActionResult(stamp=stamp, id=id, robot="r", action="a_charge", args=("r",), outcome="success", duration_s=0.1)
        for id, stamp in (("a", 100_000_000), ("b", 200_000_000))
    ]
    assert violations({}, commands, results) == []
    early = msgspec.structs.replace(results[1], stamp=199_000_000)
    assert violations({}, commands, [results[0], early]) == ["0.199 s: r: a_charge(r) began before a_charge was over"]


def test_the_same_story_comes_to_the_same_results(recorded: Record, tmp_path: Path):
    run = Run(Story(0, 0.0, rooms=2, spots=2, uvds=2, every_s=0.0), tmp_path)
    run.play()
    assert run.results == recorded[1]
