from __future__ import annotations

import math
from dataclasses import replace

import pytest

from socialbot.core.errors import ParameterError
from socialbot.planning.pddl.formulas import (
    And,
    Equality,
    Fluent,
    Not,
    Number,
    NumericComparison,
    Or,
    Predicate,
    Quantified,
    TypedName,
)
from socialbot.planning.planners import engines as unified
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import unsupported_feature
from tests.planning.moving import domain, problem


def test_a_problem_that_fits_its_domain_is_not_refused():
    every = Quantified(
        "forall", (TypedName("?t", ("thing",)),), Or((Predicate("lies", ("?t", "hall")), Equality("?t", "cup")))
    )
    asked = replace(problem(), goal=And((every, NumericComparison("<", Fluent("carried", ("rob",)), Number(1.0)))))
    assert unsupported_feature(domain(), asked) is None


def test_without_a_goal_the_planner_is_not_called():
    assert unsupported_feature(domain(), replace(problem(), goal=None)) == "the problem has no goal"


def test_a_domain_without_text_cannot_be_given_to_a_planner():
    assert (
        unsupported_feature(replace(domain(), text=""), problem())
        == "the domain moving has no text to give to a planner"
    )


def test_a_problem_of_another_domain_is_refused():
    assert unsupported_feature(domain(), replace(problem(), domain="cooking")) == (
        "the problem is for the domain cooking, not moving"
    )


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        (Predicate("held", ("cup",)), "unknown predicate 'held'"),
        (Predicate("lies", ("cup",)), "lies takes 2 terms, not 1: (lies cup)"),
        (Predicate("lies", ("mug", "hall")), "unknown object 'mug'"),
        (Predicate("lies", ("rob", "hall")), "rob is a robot, but the predicate lies takes a thing"),
        (Not(Predicate("lies", ("?t", "hall"))), "unknown variable '?t'"),
        (And((Equality("cup", "mug"),)), "unknown object 'mug'"),
        (NumericComparison("=", Fluent("weight", ("cup",)), Number(1.0)), "unknown function 'weight'"),
        (
            Quantified("exists", (TypedName("?t", ("drink",)),), Predicate("lies", ("?t", "hall"))),
            "unknown type 'drink'",
        ),
    ],
)
def test_a_goal_with_names_that_do_not_fit_is_refused(goal, reason):
    assert unsupported_feature(domain(), replace(problem(), goal=goal)) == reason


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"objects": {"cup": ("mug",)}}, "unknown type 'mug'"),
        ({"facts": frozenset({Predicate("hot", ("cup",))})}, "unknown predicate 'hot'"),
        ({"facts": frozenset({Predicate("at", ("rob", "cup"))})}, "cup is a thing, but the predicate at takes a room"),
        ({"values": {Fluent("carried", ("tom",)): 1.0}}, "unknown object 'tom'"),
        ({"values": {Fluent("carried", ("rob",)): math.nan}}, "expected a number, found nan"),
    ],
)
def test_a_state_with_names_that_do_not_fit_is_refused(change, reason):
    assert unsupported_feature(domain(), replace(problem(), **change)) == reason


def test_the_default_is_kairos():
    pytest.importorskip("kairos", reason="kairos-planner is not installed")
    assert make_planner().name == make_planner("kairos").name == "kairos"


def test_popf_may_be_given_with_its_path(tmp_path):
    program = tmp_path / "anything"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert make_planner(f"popf:{program}").name == "popf"


def test_the_engines_of_unified_planning_have_names_of_their_own(monkeypatch):
    monkeypatch.setattr(unified, "find_spec", lambda _: object())
    assert make_planner("up:aries").name == "up:aries"


@pytest.mark.parametrize("name", ["", "lpg", "up", "up:", "kairos:2", "Kairos"])
def test_other_names_are_an_error_that_lists_those_there_are(name):
    with pytest.raises(ParameterError, match="there are kairos, popf, popf:PATH and up:ENGINE"):
        make_planner(name)
