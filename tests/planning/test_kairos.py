from __future__ import annotations

import os
import random
import resource
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from socialbot.agents.warehouse.scenario import GRIPPER_DOMAIN, gripper_beliefs, gripper_desires, scenario_of
from socialbot.core.errors import InstallationError, PlanningError
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
from socialbot.planning.pddl.formulas import And, Fluent, Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.validation import validate_plan
from socialbot.planning.planners import engines as kairos_module
from socialbot.planning.planners.planner import PlannerAnswer, PlannerLimits, PlannerVerdict
from tests.planning import busy
from tests.planning.moving import DOMAIN, PROBLEM, domain, hard, plan_of, problem
from tests.planning.texts import mutated

Kairos = kairos_module.Kairos

try:
    Kairos()
except InstallationError:
    pytest.skip("kairos-planner is not installed", allow_module_level=True)

pytestmark = busy.in_turn

LONG = PlannerLimits(timeout_s=60.0)


@pytest.fixture
def planner(tmp_path, monkeypatch) -> Kairos:
    """A planner that must leave nothing in the folder for temporary files."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return Kairos()


def solve(asked: PddlProblem, limits: PlannerLimits = LONG) -> PlannerAnswer:
    return Kairos().solve(domain(), asked, limits)


def speaking(folder: Path, script: str) -> Kairos:
    """A planner with a program in place of Kairos."""
    program = folder / "program"
    program.write_text(f"#!/bin/sh\n{script}\n", "utf-8")
    program.chmod(0o755)
    planner = Kairos()
    planner.command = str(program)
    return planner


def children() -> set[int]:
    """The processes that this one has started and not buried."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(parent) == os.getpid() and state != "Z":
            found.add(int(stat.parent.name))
    return found


def children_worked() -> float:
    """Return the processor time (s) of ended children."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


# Plans


def test_a_plan_reaches_the_goal(planner, tmp_path):
    answer = planner.solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.SOLVED
    assert [step.action for step in plan_of(answer).steps] == ["go", "take", "go", "put"]
    assert validate_plan(domain(), problem(), plan_of(answer)) == ()
    assert 0.0 < answer.seconds < LONG.timeout_s
    assert list(tmp_path.iterdir()) == []


def test_where_the_goal_holds_already_the_plan_is_empty():
    for goal in ("(and)", "(lies cup kitchen)"):
        assert solve(problem(goal)).plan == PddlPlan()


def test_the_same_problem_gets_the_same_plan_from_many_threads_at_once():
    planner = Kairos()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: planner.solve(domain(), problem(), LONG).plan, range(16)))
    assert answers == [answers[0]] * 16
    assert answers[0] is not None


def test_a_goal_that_cannot_be_reached_is_proved_impossible():
    answer = solve(problem("(and (lies cup hall) (has rob cup) (not (at rob hall)) (= (carried rob) 7))"))
    assert answer.verdict is PlannerVerdict.IMPOSSIBLE
    assert answer.plan is None


@pytest.mark.parametrize(
    "change",
    [
        {"goal": None},
        {"goal": Predicate("lies", ("mug", "hall"))},
        {"goal": Predicate("hot", ("cup",))},
        {"facts": frozenset({Predicate("at", ("rob", "hall")), Predicate("hot", ("cup",))})},
    ],
)
def test_a_problem_that_kairos_would_die_of_or_only_warn_about_is_refused(change):
    assert solve(replace(problem(), **change)).verdict is PlannerVerdict.REFUSED


def test_input_that_kairos_rejects_is_refused_with_its_message():
    broken = replace(domain(), text=DOMAIN.replace("(has ?r - robot ?t - thing)", "(has ?r - robot ?t - thang)"))
    answer = Kairos().solve(broken, problem(), LONG)
    assert answer.verdict is PlannerVerdict.REFUSED
    assert "thang" in answer.message


# How long plans last


def warehouse(boxes: int, carriers: int) -> tuple[PddlDomain, PddlProblem, float]:
    """The warehouse of the demonstration, or a larger one, and the deadline of its goal, s."""
    cast = scenario_of(boxes, carriers)
    known = read_domain(GRIPPER_DOMAIN.read_text("utf-8"), where=str(GRIPPER_DOMAIN))
    believed, (desire,) = gripper_beliefs(cast), gripper_desires(cast)
    asked = PddlProblem(
        "sort",
        known.name,
        {fact.name: (fact.type,) for fact in believed if fact.pddl_type == 1},
        frozenset(Predicate(fact.name, fact.params) for fact in believed if fact.pddl_type == 2),
        {Fluent(fact.name, fact.params): fact.value for fact in believed if fact.pddl_type == 3},
        And(tuple(Predicate(fact.name, fact.params) for fact in desire.value)),
    )
    return known, asked, desire.deadline


@pytest.mark.parametrize(("boxes", "carriers"), [(6, 3), (12, 3), (24, 6)])
def test_the_warehouse_gets_a_plan_within_its_deadline_and_a_second_of_work(boxes, carriers):
    known, asked, deadline = warehouse(boxes, carriers)
    worked = children_worked()
    answer = Kairos().solve(known, asked, replace(LONG, makespan_s=deadline))
    assert answer.verdict is PlannerVerdict.SOLVED
    assert plan_of(answer).makespan_s <= deadline
    assert validate_plan(known, asked, plan_of(answer)) == ()
    assert children_worked() - worked < 1.0


def test_when_no_plan_is_short_enough_the_first_found_is_named():
    known, asked, _ = warehouse(6, 3)
    worked = children_worked()
    answer = Kairos().solve(known, asked, PlannerLimits(timeout_s=1.0, makespan_s=100.0))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    told = "the plan found first lasts 142.013 s, longer than the 100 s there are; none was found that is short enough"
    assert answer.message == told
    assert 0.9 < children_worked() - worked < 1.5


def test_a_plan_may_take_exactly_the_time_there_is():
    assert solve(problem(), replace(LONG, makespan_s=14.0)).verdict is PlannerVerdict.SOLVED


def test_separations_do_not_make_a_plan_late(tmp_path):
    steps = ["(go rob hall kitchen)", "(take rob cup kitchen)", "(go rob kitchen hall)", "(put rob cup hall)"]
    times = [0.001, 5.002, 7.003, 12.004]
    timed = ",".join(
        f'{{"time": {start}, "duration": {5 if "go" in step else 2}, "action": "{step}"}}'
        for start, step in zip(times, steps, strict=True)
    )
    planner = speaking(tmp_path, f"""case $1 in solve) echo '{{"steps": [{timed}]}}';; esac""")
    answer = planner.solve(domain(), problem(), PlannerLimits(makespan_s=14.0))
    assert answer.verdict is PlannerVerdict.SOLVED
    assert plan_of(answer).makespan_s == 14.004


@pytest.mark.slow
@busy.can_be_made
def test_the_plan_does_not_hang_on_how_busy_the_machine_is():
    known, asked, deadline = warehouse(6, 3)
    limits = PlannerLimits(timeout_s=1.0, makespan_s=deadline)
    alone = Kairos().solve(known, asked, limits)
    among_others = alone
    for others in (12, 24, 48):
        if among_others.seconds <= limits.timeout_s:  # nobody was in its way
            with busy.busy_machine(others):
                among_others = Kairos().solve(known, asked, limits)
    assert among_others.seconds > limits.timeout_s
    assert (among_others.verdict, among_others.plan) == (PlannerVerdict.SOLVED, alone.plan)


# Limits


def test_a_hard_problem_is_given_up_when_its_time_is_over(planner, tmp_path):
    worked = children_worked()
    answer = planner.solve(*hard(), PlannerLimits(timeout_s=0.2))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    assert answer.message == "kairos found no plan in 0.2 s"
    assert children_worked() - worked < 1.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_hard_problem_is_given_up_when_its_memory_is_used(planner):
    answer = planner.solve(*hard(), replace(LONG, memory_mb=60))
    assert answer.verdict is PlannerVerdict.GAVE_UP
    assert answer.message == "kairos found no plan in 60 MB"


def test_a_cancelled_call_ends_long_before_the_timeout(planner, tmp_path):
    cancelled, began, others = threading.Event(), time.monotonic(), children()
    threading.Timer(0.3, cancelled.set).start()
    assert planner.solve(*hard(), LONG, cancelled).verdict is PlannerVerdict.CANCELLED
    assert time.monotonic() - began < LONG.timeout_s / 4
    assert children() <= others
    assert list(tmp_path.iterdir()) == []


def test_a_call_cancelled_before_its_start_ends_at_once(planner):
    cancelled = threading.Event()
    cancelled.set()
    assert planner.solve(*hard(), LONG, cancelled).verdict is PlannerVerdict.CANCELLED


# Processes that go wrong


def test_a_killed_child_is_a_failure_and_no_exception(planner):
    others = children()
    found: list[PlannerAnswer] = []
    asking = threading.Thread(target=lambda: found.append(planner.solve(*hard(), LONG)))
    asking.start()
    end = time.monotonic() + LONG.timeout_s
    while not (begun := children() - others) and time.monotonic() < end:
        time.sleep(0.001)
    for child in begun:
        os.kill(child, signal.SIGKILL)
    asking.join()
    assert found[0].verdict is PlannerVerdict.FAILED
    assert found[0].message == "kairos was killed by SIGKILL"


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo no luck >&2; kill -SEGV $$", "kairos was killed by SIGSEGV: no luck"),
        ("echo no luck >&2; exit 1", "kairos ended with code 1: no luck"),
        ("echo nothing", "kairos ended with code 0"),
    ],
)
def test_a_crashed_child_is_a_failure_with_its_error_output(tmp_path, script, message):
    answer = speaking(tmp_path, script).solve(domain(), problem(), LONG)
    assert (answer.verdict, answer.message) == (PlannerVerdict.FAILED, message)


@pytest.mark.parametrize("said", ["{nonsense}", '{"steps": 3}', '{"steps": [{"time": "x"}]}', "{}", '{"steps": [3]}'])
def test_a_child_that_talks_nonsense_is_a_failure(tmp_path, said):
    assert speaking(tmp_path, f"echo '{said}'").solve(domain(), problem(), LONG).verdict is PlannerVerdict.FAILED


def test_a_plan_that_misses_the_goal_is_invalid(tmp_path):
    plan = '{"steps": [{"time": 0, "duration": 5, "action": "(go rob hall kitchen)"}]}'
    answer = speaking(tmp_path, f"""[ $1 = validate ] || echo '{plan}'""").solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.INVALID
    assert answer.plan is None


def test_a_plan_that_kairos_itself_does_not_validate_is_invalid(tmp_path):
    script = """if [ $1 = validate ]; then echo 'plan.txt:1: error: too early [validate.x]' >&2; exit 1; fi
        echo '{"steps": []}'"""
    answer = speaking(tmp_path, script).solve(domain(), problem("(and)"), LONG)
    assert answer.verdict is PlannerVerdict.INVALID
    assert answer.message == "kairos does not validate its own plan: plan.txt:1: error: too early"


def test_a_program_that_is_gone_is_a_failure(tmp_path):
    planner = Kairos()
    planner.command = str(tmp_path / "gone")
    answer = planner.solve(domain(), problem(), LONG)
    assert answer.verdict is PlannerVerdict.FAILED
    assert "gone" in answer.message


def test_without_kairos_the_error_has_a_remedy(monkeypatch):
    monkeypatch.setattr(kairos_module, "files", lambda _: None)
    monkeypatch.setenv("PATH", "")
    kairos_module._command.cache_clear()
    try:
        with pytest.raises(InstallationError, match="install 'kairos-planner"):
            Kairos()
    finally:
        kairos_module._command.cache_clear()


# Whatever it is given


WORDS = [*(DOMAIN + PROBLEM).replace("(", " ( ").replace(")", " ) ").split(), "-1", "1e400", "?z", "forall", "when"]


def check_mutations(seed: int) -> None:
    """Neither texts that our reader takes nor ones that it never sees have the planner raise or hang."""
    limits = PlannerLimits(timeout_s=1.0)
    begin = time.monotonic()
    answer = Kairos().solve(replace(domain(), text=mutated(DOMAIN, seed, WORDS)), problem(), limits)
    assert isinstance(answer.verdict, PlannerVerdict)
    try:
        known = read_domain(mutated(DOMAIN, seed + 1, WORDS)) if seed % 2 else domain()
        asked = read_problem(mutated(PROBLEM, seed + 2, WORDS), known)
    except PlanningError:
        return
    answer = Kairos().solve(known, asked, limits)
    assert answer.verdict not in (PlannerVerdict.FAILED, PlannerVerdict.INVALID), answer.message
    assert time.monotonic() - begin < 120.0  # both limits are processor time


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 1 << 30))
def test_mutated_texts_neither_hang_nor_raise(seed):
    check_mutations(seed)


@pytest.mark.slow
@settings(max_examples=400, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 1 << 30))
def test_many_mutated_texts_neither_hang_nor_raise(seed):
    check_mutations(seed)


PATROL = """(define (domain patrol) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (seen ?p - place) (free ?r - robot) (open))
  (:functions (distance ?a ?b - place) (speed ?r - robot) (total-cost))
  (:durative-action go :parameters (?r - robot ?a ?b - place)
    :duration (= ?duration (/ (distance ?a ?b) (speed ?r)))
    :condition (and (at start (at ?r ?a)) (at start (free ?r)))
    :effect (and (at start (not (at ?r ?a))) (at start (not (free ?r)))
      (at end (at ?r ?b)) (at end (free ?r)) (at end (increase (total-cost) (distance ?a ?b)))))
  (:durative-action look :parameters (?r - robot ?p - place) :duration (= ?duration 0.7)
    :condition (and (over all (at ?r ?p)) (over all (open))) :effect (at end (seen ?p))))"""


def patrol(chance: random.Random, init: str) -> tuple[PddlDomain, PddlProblem]:
    places = [f"p{number}" for number in range(5)]
    distances = (f"(= (distance {a} {b}) {chance.uniform(1, 9):.2f})" for a in places for b in places if a != b)
    speeds = (f"(= (speed {r}) {chance.uniform(0.3, 0.7):.3f}) (at {r} p0) (free {r})" for r in ("r1", "r2"))
    goal = " ".join(f"(seen {place})" for place in places)
    domain = read_domain(PATROL)
    text = f"""(define (problem p) (:domain patrol) (:objects {" ".join(places)} - place r1 r2 - robot)
      (:init {" ".join(distances)} {" ".join(speeds)} {init}) (:goal (and {goal})))"""
    return domain, read_problem(text, domain)


@pytest.mark.parametrize("seed", range(12))
def test_plans_with_durations_of_many_digits_are_accepted(seed):
    found = Kairos().solve(*patrol(random.Random(seed), "(open)"), LONG)
    assert (found.verdict, found.message) == (PlannerVerdict.SOLVED, "")


ONE_LIGHT = """(define (domain workshop)
  (:requirements :typing :durative-actions :fluents :duration-inequalities :negative-preconditions)
  (:types job)
  (:predicates (done ?j - job) (lit))
  (:functions (hands) (parts) (longest ?j - job))
  (:durative-action burn
    :parameters () :duration (= ?duration 7)
    :condition (at start (not (lit))) :effect (and (at start (lit)) (at end (not (lit)))))
  (:durative-action work
    :parameters (?j - job) :duration (and (>= ?duration 2) (<= ?duration (longest ?j)))
    :condition (and (at start (>= (hands) 1)) (over all (lit)) (over all (>= (parts) 0)))
    :effect (and (at start (decrease (hands) 1)) (at end (increase (hands) 1)) (at end (done ?j))
      (at end (decrease (parts) 1)))))"""


@pytest.mark.parametrize("hands", [1, 2, 3])
def test_a_search_that_ends_without_a_plan_or_a_proof_leaves_its_time_to_another_one(hands):
    workshop = read_domain(ONE_LIGHT)
    jobs = read_problem(
        f"""(define (problem evening) (:domain workshop) (:objects a b c - job)
        (:init (= (hands) {hands}) (= (parts) 5) (= (longest a) 3) (= (longest b) 4) (= (longest c) 5))
        (:goal (and (done a) (done b) (done c))))""",
        workshop,
    )
    answer = kairos_module.make_planner("kairos").solve(workshop, jobs, PlannerLimits(5.0))
    assert answer.verdict is PlannerVerdict.SOLVED, answer.message


def test_plans_wait_for_timed_initial_literals():
    domain, problem = patrol(random.Random(1), "(at 40 (open)) (at 400 (not (open)))")
    found = Kairos().solve(domain, problem, LONG)
    assert found.plan is not None, found.message
    looks = [step for step in found.plan.steps if step.action == "look"]
    assert len(looks) == 5
    assert min(step.start_s for step in looks) >= 40.0


@pytest.mark.parametrize("number", [".5", "5.", "-.5", "+5.0e-1", "1E2", "1e-400"])
def test_a_planner_gets_numbers_as_the_standard_writes_them(number: str):
    text = f"""(define (domain n) (:requirements :fluents) (:predicates (done)) (:functions (level))
      (:action a :parameters () :precondition (>= (level) {number}) :effect (done)) ; {number} or 1e999
    )"""
    own = read_domain(text)
    wanted = read_problem(f"(define (problem p) (:domain n) (:init (= (level) {number})) (:goal (done)))", own)
    answer = Kairos().solve(own, wanted, LONG)
    assert answer.plan is not None, answer.message
