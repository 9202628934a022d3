from __future__ import annotations

from collections import Counter
from dataclasses import replace

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
    play_all,
    stories,
    tell_what_went_wrong,
)
from evaluation.hospital_scale_runs import Kill, Result, Story, play
from evaluation.report import Report
from socialbot.agents.hospital.ward.ward import PROBLEMS, drawn_problems, large_ward

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
    results = play_all(kinds, 2)
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
