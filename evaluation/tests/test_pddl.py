from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from evaluation.pddl import Mutant, Outcome, Task, add_figures, judge, tasks
from evaluation.report import Report
from socialbot.planning.pddl import PddlPlan

DOMAIN = """
(define (domain lamps) (:requirements :durative-actions)
  (:predicates (near ?l) (lit ?l))
  (:durative-action light :parameters (?l) :duration (= ?duration 2)
    :condition (at start (near ?l)) :effect (and (at end (lit ?l)) (at end (not (near ?l))))))
"""
PROBLEM = (
    "(define (problem p{}) (:domain lamps) (:objects a b) (:init (near a) (near b)) (:goal (and (lit a) (lit b))))"
)
TASK = Task("lamps", Path("domain.pddl"), Path("p1.pddl"))
AGREED = Mutant("none", PddlPlan(), "valid", "valid")
GOOD = Outcome(TASK, "", True, AGREED, True, "", (replace(AGREED, kind="shorten", ours="invalid", val="invalid"),))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "domain.pddl").write_text(DOMAIN)
    (tmp_path / "problems").mkdir()
    for number in range(3):
        (tmp_path / "problems" / f"p{number}.pddl").write_text(PROBLEM.format(number))
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "d.pddl").write_text(f"; a comment (define (domain other))\n{DOMAIN}")
    (tmp_path / "copy" / "p.pddl").write_text(PROBLEM.format(0))
    (tmp_path / "orphan.pddl").write_text("(define (problem p) (:domain nothing))")
    return tmp_path


def program(folder: Path, answer: str) -> Path:
    """A program that answers as VAL does."""
    path = folder / "validate"
    path.write_text(f"#!/bin/sh\necho '{answer}'\n")
    path.chmod(0o755)
    return path


def unmet(*outcomes: Outcome) -> list[str]:
    report = Report("PDDL", quick=False)
    add_figures(report, outcomes)
    return report.unmet


def test_problems_are_found_with_the_nearest_domain_of_their_name(folder: Path):
    found = tasks(folder, each=2, most=9)
    assert [(one.domain.name, one.problem.name) for one in found] == [
        ("d.pddl", "p.pddl"), ("domain.pddl", "p0.pddl"), ("domain.pddl", "p1.pddl"),
    ]  # fmt: skip
    assert len(tasks(folder, each=2, most=1)) == 1
    assert {one.side for one in found} <= {"dev", "held"}


def test_a_plan_and_its_mutants_are_judged_by_both_validators(folder: Path):
    (task,) = tasks(folder, each=1, most=1)
    outcome = judge(task, program(folder, "Plan valid"), 5.0, 1)
    assert (outcome.refusal, outcome.kairos, outcome.solved) == ("", True, True)
    assert outcome.plan is not None
    assert (outcome.plan.ours, outcome.plan.val) == ("valid", "valid")
    verdicts = {mutant.kind: mutant.ours for mutant in outcome.mutants}
    assert verdicts["drop a step"] == verdicts["shorten"] == verdicts["repeat a step"] == "invalid"
    assert verdicts["shift later"] == "valid"


@pytest.mark.parametrize(
    ("answer", "verdict"),
    [
        ("Plan failed to execute", "invalid"),
        ("Bad plan description! Failed plans: 1", "unclear"),
        ("Problem in domain definition!", "unclear"),
    ],
)
def test_answers_of_val(folder: Path, answer: str, verdict: str):
    (task,) = tasks(folder, each=1, most=1)
    outcome = judge(task, program(folder, answer), 5.0, 0)
    assert outcome.plan is not None
    assert outcome.plan.val == verdict


def test_a_refused_problem_is_still_planned_by_kairos_alone(folder: Path):
    path = folder / "problems" / "p0.pddl"
    path.write_text(PROBLEM.format(0).replace("(:goal", "(:constraints (always (near a))) (:goal"))
    (task,) = (one for one in tasks(folder, each=3, most=9) if one.problem == path)
    outcome = judge(task, program(folder, "Plan valid"), 5.0, 1)
    assert outcome.unsupported == "preferences and constraints"
    assert not outcome.solved


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({}, []),
        ({"solved": False}, ["unplanned_percent"]),
        ({"plan": replace(AGREED, ours="invalid")}, ["rejected_percent", "wrongly_rejected"]),
        ({"mutants": (replace(AGREED, val="invalid"),)}, ["wrongly_accepted"]),
        ({"mutants": (replace(AGREED, val="unclear"),)}, []),
        ({"refusal": "domain:1: not supported by socialbot: bounds", "solved": False, "plan": None}, []),
    ],
)
def test_figures_that_are_not_as_required(changes: dict[str, object], missed: list[str]):
    assert unmet(GOOD, replace(GOOD, **changes)) == missed  # type: ignore[arg-type]
