from __future__ import annotations

import shutil
import threading
from pathlib import Path

import pytest

from socialbot.core.errors import InstallationError
from socialbot.planning.planners.engines import Popf
from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict
from tests.planning.moving import PLAN, domain, hard, plan_of, problem

LONG = PlannerLimits(timeout_s=60.0)
LATE_PLAN = """
0.000: (go rob hall kitchen)  [5.000]
9.001: (take rob cup kitchen)  [2.000]
11.002: (go rob kitchen hall)  [5.000]
16.003: (put rob cup hall)  [2.000]
"""


def solution(plan: str) -> str:
    """A plan as POPF prints it."""
    lines = ["; Plan found with metric 14.003", ";;;; Solution Found", "; States evaluated: 9", "; Cost: 14.003"]
    return "\n".join([*lines, "; Time 0.01", plan.strip()])


def popf(folder: Path, script: str) -> Popf:
    """A stand-in that does what ``script`` says; it looks into its files as POPF does."""
    program = folder / "popf"
    program.write_text(f"#!/bin/sh\necho 'Number of literals: 4'\n{script}\n", "utf-8")
    program.chmod(0o755)
    return Popf(str(program))


def saying(text: str) -> str:
    return f"cat <<'END'\n{text}\nEND"


def test_its_plan_is_read_and_validated(tmp_path):
    look = "grep -q moving domain.pddl && grep -q tea problem.pddl || exit 3\n"
    planner = popf(tmp_path, look + saying(solution(PLAN)))
    answer = planner.solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.SOLVED
    assert [str(step) for step in plan_of(answer).steps] == PLAN.split("\n")[1:-1]


def test_it_is_found_on_the_path(tmp_path, monkeypatch):
    popf(tmp_path, saying(solution(PLAN)))
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert Popf().solve(domain(), problem(), LONG).verdict is PlannerVerdict.SOLVED


def test_the_last_of_its_plans_counts(tmp_path):
    answer = popf(tmp_path, saying(solution(LATE_PLAN) + "\n" + solution(PLAN))).solve(domain(), problem(), LONG)
    assert plan_of(answer).makespan_s == 14.003


def test_a_plan_that_is_too_long_has_it_search_on(tmp_path):
    script = f"if [ $1 = -n ]; then {saying(solution(PLAN))}\nelse {saying(solution(LATE_PLAN))}\nfi"
    planner = popf(tmp_path, script)
    assert plan_of(planner.solve(domain(), problem(), LONG)).makespan_s == 18.003
    assert plan_of(planner.solve(domain(), problem(), PlannerLimits(makespan_s=15.0))).makespan_s == 14.003
    answer = planner.solve(domain(), problem(), PlannerLimits(makespan_s=13.0))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    told = "the plan found first lasts 18.003 s, longer than the 13 s there are; none was found that is short enough"
    assert answer.message == told


def test_of_a_search_that_is_cut_short_the_last_plan_that_is_whole_counts(tmp_path):
    cut = solution("0.000: (go rob hall kitchen)  [5.000]")
    text = "\n".join((solution(LATE_PLAN), solution(PLAN), cut))
    script = f"if [ $1 = -n ]; then {saying(text)}\nsleep 1000\nelse {saying(solution(LATE_PLAN))}\nfi"
    answer = popf(tmp_path, script).solve(domain(), problem(), PlannerLimits(timeout_s=1.0, makespan_s=15.0))
    assert answer.verdict is PlannerVerdict.SOLVED
    assert plan_of(answer).makespan_s == 14.003


def test_a_plan_that_does_not_do_it_is_invalid(tmp_path):
    wrong = "\n".join(PLAN.strip().splitlines()[:-1])
    assert popf(tmp_path, saying(solution(wrong))).solve(domain(), problem(), LONG).verdict is PlannerVerdict.INVALID


def test_unsolvable_of_the_planner_is_no_proof(tmp_path):
    answer = popf(tmp_path, "echo ';; Problem unsolvable!'").solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.GAVE_UP
    assert answer.message == "popf reports that there is no plan, which is no proof"


@pytest.mark.parametrize(
    ("script", "verdict", "message"),
    [
        ("sleep 1000", PlannerVerdict.GAVE_UP, "popf found no plan in 0.5 s"),
        ("echo std::bad_alloc >&2; exit 1", PlannerVerdict.GAVE_UP, "popf found no plan in 512 MB"),
        ("kill -SEGV $$", PlannerVerdict.FAILED, "popf was killed by SIGSEGV"),
        ("echo what\necho ';;;; Solution Found'\necho '1: (go'", PlannerVerdict.FAILED, "popf ended with code 0"),
    ],
)
def test_how_it_can_go_wrong(tmp_path, script, verdict, message):
    answer = popf(tmp_path, script).solve(domain(), problem(), PlannerLimits(timeout_s=0.5))
    assert (answer.verdict, answer.message) == (verdict, message)


def test_it_ends_when_cancelled(tmp_path):
    cancelled = threading.Event()
    threading.Timer(0.2, cancelled.set).start()
    answer = popf(tmp_path, "sleep 1000").solve(domain(), problem(), LONG, cancelled)
    assert answer.verdict is PlannerVerdict.CANCELLED
    assert answer.seconds < LONG.timeout_s / 2


def test_without_popf_the_error_has_a_remedy(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InstallationError, match="put popf on the PATH"):
        Popf()


@pytest.mark.skipif(shutil.which("popf") is None, reason="popf is not installed")
def test_the_real_one():
    assert Popf().solve(domain(), problem(), LONG).verdict is PlannerVerdict.SOLVED
    assert Popf().solve(*hard(), PlannerLimits(timeout_s=0.5)).verdict is PlannerVerdict.GAVE_UP
