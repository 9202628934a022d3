from __future__ import annotations

from collections import Counter
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.ward import (
    PROBLEMS,
    drawn_problems,
    large_ward,
    paper_ward,
    parse_faults,
)
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError

PAPER, LARGE = paper_ward(), large_ward()


def test_faults_are_parsed_in_order():
    text = (
        "2 dirty room1; 3.5 closes room2 ; 4 drains spotrobot1; 5 enters room1 10; 6 leaves nurse_disinfected1 10;"
        "7 silent uvdrobot1 5; 7 silent room1 5; 8 slow state 5; 9 stalls uvdrobot1 3;"
    )
    assert parse_faults(text, PAPER) == (
        WorldFault(2.0, "dirty", "room1"),
        WorldFault(3.5, "closes", "room2"),
        WorldFault(4.0, "drains", "spotrobot1"),
        WorldFault(5.0, "enters", "room1", 10.0),
        WorldFault(6.0, "leaves", "nurse_disinfected1", 10.0),
        WorldFault(7.0, "silent", "uvdrobot1", 5.0),
        WorldFault(7.0, "silent", "room1", 5.0),
        WorldFault(8.0, "slow", "state", 5.0),
        WorldFault(9.0, "stalls", "uvdrobot1", 3.0),
    )
    assert parse_faults("", PAPER) == ()


@pytest.mark.parametrize(
    "text",
    ["30", "dirty room1", "1 dirty room5", "1 dirty spotrobot1", "1 drains nurse_disinfected1", "1 enters room1",
     "1 leaves spotrobot1 3", "x dirty room1", "-1 dirty room1", "nan dirty room1", "1 silent moon 3",
     "1 stalls room1 3", "1 explodes", "1 stalls spotrobot1 inf"],
)  # fmt: skip
def test_invalid_fault_is_rejected_with_remedy(text):
    with pytest.raises(ParameterError, match="remedy: write faults as"):
        parse_faults(text, PAPER)


words = st.sampled_from(["dirty", "closes", "drains", "enters", "leaves", "silent", "slow", "stalls", "room1",
                         "spotrobot1", "nurse_disinfected1", "state", ";", "moon"])  # fmt: skip
texts = st.lists(words | st.floats(-1, 1e7).map(str), max_size=12).map(" ".join)


@given(texts)
def test_any_text_is_parsed_or_rejected_and_formats_back(text):
    try:
        faults = parse_faults(text, PAPER)
    except ParameterError:
        return
    assert parse_faults("; ".join(map(str, faults)), PAPER) == faults


def binomial_interval(runs: int, rate: float, outside: float = 0.01) -> range:
    """Return the interval of problem counts in ``runs`` that excludes a share ``outside``, half on each side."""
    share, found, below = rate / 100.0, [], 0.0
    for number in range(runs + 1):
        chance = comb(runs, number) * share**number * (1 - share) ** (runs - number)
        if below + chance > outside / 2 and below < 1 - outside / 2:
            found.append(number)
        below += chance
    return range(found[0], found[-1] + 1)


@pytest.mark.parametrize("rate", [0.0, 10.0, 25.0, 50.0, 75.0, 100.0])
def test_paper_problem_matches_its_rate_in_300_runs(rate):
    worlds = [WardWorld(PAPER, seed=seed, rate=rate) for seed in range(300)]
    dirty = sum(not world.rooms["room1"].cleaned for world in worlds)
    assert dirty == sum(bool(world.problems) for world in worlds)
    assert dirty in binomial_interval(300, rate)
    assert all(world.rooms[room].cleaned for world in worlds for room in ("room2", "room3", "room4"))


@pytest.mark.parametrize("rate", [10.0, 25.0, 50.0, 75.0])
def test_samples_of_30_runs_match_the_rate(rate):
    met = [bool(drawn_problems(PAPER, seed, rate)) for seed in range(300)]
    inside = [sum(met[first : first + 30]) in binomial_interval(30, rate, 0.05) for first in range(0, 300, 30)]
    assert sum(inside) >= 8


@pytest.mark.parametrize("rate", [0.0, 25.0, 100.0])
def test_problems_of_large_ward_are_spread_over_rooms_kinds_and_time(rate):
    problems = [problem for seed in range(300) for problem in drawn_problems(LARGE, seed, rate)]
    draws, share = 300 * 50, rate / 100.0
    assert abs(len(problems) - draws * share) <= 2.6 * (draws * share * (1 - share)) ** 0.5
    kinds = Counter(problem.kind for problem in problems)
    if rate:
        assert set(kinds) == set(PROBLEMS)
        assert max(kinds.values()) < 1.2 * min(kinds.values())
        times = {room: time_s for time_s, room in LARGE.infections}
        late = [problem.time_s - times[problem.target] for problem in problems if problem.kind == "dirty"]
        assert min(late) >= 0.0
        assert max(late) <= 10.0
        assert sum(late) / len(late) == pytest.approx(5.0, abs=0.5)
        assert {problem.target for problem in problems if problem.kind == "dirty"} == set(times)


def test_a_higher_rate_only_adds_problems():
    for seed in range(50):
        few, many = drawn_problems(LARGE, seed, 25.0), drawn_problems(LARGE, seed, 75.0)
        assert set(few) <= set(many)


def test_a_ward_without_robots_or_nurses_still_has_problems():
    lonely = large_ward(3, 0, 0, 1)
    assert all(problem.kind != "drains" for seed in range(50) for problem in drawn_problems(lonely, seed, 100.0))
    world = WardWorld(lonely, rate=100.0)
    world.advance(100 * SECOND)
    assert len(world.problems) == 1
