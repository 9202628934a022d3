from __future__ import annotations

import threading
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command, pip_command
from socialbot.planning.pddl.validation import validate_plan
from socialbot.planning.planners import engines as unified_module
from socialbot.planning.planners.engines import Unified
from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict
from tests.planning.moving import domain, plan_of, problem

INSTALL_MISSING = pip_command("install", "up-missing")
LONG = PlannerLimits(timeout_s=60.0)

STAND_IN = """
import os, sys, time
from fractions import Fraction
from types import SimpleNamespace as Some


def action(name, *objects):
    return Some(action=Some(name=name), actual_parameters=objects)


PLAN = [
    (Fraction(0), action("go", "rob", "hall", "kitchen"), Fraction(5)),
    (Fraction(5001, 1000), action("take", "rob", "cup", "kitchen"), Fraction(2)),
    (Fraction(7002, 1000), action("go", "rob", "kitchen", "hall"), Fraction(5)),
    (Fraction(12003, 1000), action("put", "rob", "cup", "hall"), Fraction(2)),
]


class Engine:
    def __init__(self, name):
        self.name = name

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        pass

    def solve(self, problem, timeout):
        print("an engine that talks")
        if self.name == "sleeper":
            time.sleep(1000)
        if self.name == "crasher":
            os.abort()
        if self.name == "eater":
            raise MemoryError
        if self.name == "picky":
            from unified_planning.exceptions import UPUsageError

            raise UPUsageError("picky cannot handle this kind of problem!\\nbecause")
        if self.name == "ordered":
            return Some(status=Some(name="SOLVED_SATISFICING"), plan=Some(actions=[step[1] for step in PLAN]))
        return Some(status=Some(name=self.name), plan=Some(timed_actions=PLAN))


NAMES = "sleeper crasher eater picky ordered SOLVED_OPTIMALLY UNSOLVABLE_PROVEN UNSOLVABLE_INCOMPLETELY INTERNAL_ERROR"
ENVIRONMENT = Some(credits_stream=sys.stdout, factory=Some(engines=NAMES.split()))


def get_environment():
    return ENVIRONMENT


def OneshotPlanner(name):
    assert ENVIRONMENT.credits_stream is None
    return Engine(name)
"""
READER = """
class PDDLReader:
    def parse_problem(self, domain, problem):
        if "unreadable" in open(domain).read():
            raise AssertionError("no grammar for this")
"""
ERRORS = """
class UPUsageError(Exception):
    pass


class UPUnsupportedProblemTypeError(Exception):
    pass
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> None:
    """A library in place of unified-planning whose engines behave as they are called."""
    package = tmp_path / "unified_planning"
    package.mkdir()
    for name, text in {"__init__": "", "shortcuts": STAND_IN, "io": READER, "exceptions": ERRORS}.items():
        (package / f"{name}.py").write_text(text, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    root = Path(unified_module.__file__).parents[3]
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{root}")


def test_a_plan_of_an_engine_is_read_and_validated(stand_in):
    answer = Unified("SOLVED_OPTIMALLY").solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.SOLVED
    assert plan_of(answer).makespan_s == 14.003
    assert plan_of(answer).steps[1].args == ("rob", "cup", "kitchen")


def test_a_plan_that_does_not_do_it_is_invalid(stand_in):
    assert Unified("ordered").solve(domain(), problem(), LONG).verdict is PlannerVerdict.INVALID


@pytest.mark.parametrize(
    ("engine", "verdict", "message"),
    [
        ("UNSOLVABLE_PROVEN", PlannerVerdict.IMPOSSIBLE, "unsolvable proven"),
        ("UNSOLVABLE_INCOMPLETELY", PlannerVerdict.GAVE_UP, "unsolvable incompletely"),
        ("INTERNAL_ERROR", PlannerVerdict.FAILED, "internal error"),
        ("picky", PlannerVerdict.REFUSED, "picky cannot handle this kind of problem!"),
        (
            "missing",
            PlannerVerdict.FAILED,
            f"unified-planning has no engine 'missing' here: {INSTALL_MISSING}",
        ),
    ],
)
def test_engine_statuses_become_verdicts(stand_in, engine, verdict, message):
    answer = Unified(engine).solve(domain(), problem(), LONG)
    assert (answer.verdict, answer.message) == (verdict, f"up:{engine}: {message}")


def test_input_that_its_reader_rejects_is_refused(stand_in):
    known = domain()
    answer = Unified("SOLVED_OPTIMALLY").solve(replace(known, text=f"{known.text}; unreadable"), problem(), LONG)
    assert answer.verdict is PlannerVerdict.REFUSED
    assert answer.message.endswith("unified-planning cannot read the domain or problem: no grammar for this")


def test_an_engine_that_crashes_or_eats_the_memory_costs_no_more_than_the_plan(stand_in):
    crashed = Unified("crasher").solve(domain(), problem(), LONG)
    assert crashed.verdict is PlannerVerdict.FAILED
    assert "was killed by SIGABRT" in crashed.message
    assert Unified("eater").solve(domain(), problem(), LONG).message == "up:eater found no plan in 512 MB"


def test_an_engine_that_takes_too_long_is_killed(stand_in):
    answer = Unified("sleeper").solve(domain(), problem(), PlannerLimits(timeout_s=1.0))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    assert answer.message == "up:sleeper found no plan in 1 s"


def test_it_ends_when_cancelled(stand_in):
    cancelled = threading.Event()
    threading.Timer(0.5, cancelled.set).start()
    assert Unified("sleeper").solve(domain(), problem(), LONG, cancelled).verdict is PlannerVerdict.CANCELLED


def test_a_plan_that_is_too_long_is_all_there_is(stand_in):
    answer = Unified("SOLVED_OPTIMALLY").solve(domain(), problem(), PlannerLimits(timeout_s=60.0, makespan_s=10.0))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    told = "the plan found first lasts 14.003 s, longer than the 10 s there are; none was found that is short enough"
    assert answer.message == told


def test_without_the_library_the_error_has_a_remedy(monkeypatch):
    monkeypatch.setattr(unified_module, "find_spec", lambda _: None)
    with pytest.raises(InstallationError) as caught:
        Unified("aries")
    assert caught.value.remedy == f"{extra_command('up')}, or use the planner kairos"


@pytest.mark.skipif(
    find_spec("unified_planning") is None or find_spec("up_kairos") is None, reason="the extra up is not installed"
)
def test_the_real_library_with_an_engine():
    answer = Unified("kairos").solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.SOLVED
    assert validate_plan(domain(), problem(), plan_of(answer)) == ()
    assert Unified("nothing").solve(domain(), problem(), LONG).verdict is PlannerVerdict.FAILED
