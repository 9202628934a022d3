from __future__ import annotations

import pytest

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.formulas import Add, Delete, Fluent, Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.state import Derivation, PddlState

BLOCKS = """(define (domain blocks) (:requirements :derived-predicates) (:types block crate - thing)
  (:predicates (on ?x ?y - thing) (above ?x ?y - thing) (covered ?x - thing) (clear ?x - thing) (light ?x - thing))
  (:functions (weight ?x - thing))
  (:derived (above ?x ?y - thing) (or (on ?x ?y) (exists (?z - thing) (and (on ?x ?z) (above ?z ?y)))))
  (:derived (covered ?x - thing) (exists (?y - thing) (above ?y ?x)))
  (:derived (clear ?x - thing) (not (covered ?x)))
  (:derived (light ?what - crate) (clear ?what))
  (:derived (light ?x - thing) (< (weight ?x) 1)))"""


def state() -> PddlState:
    domain = read_domain(BLOCKS)
    text = """(define (problem p) (:domain blocks) (:objects a b c - block d e - crate)
      (:init (on a b) (on b c) (on d e) (= (weight b) 0.5) (= (weight c) 5)))"""
    return PddlState.of(read_problem(text, domain), domain)


def derived(of: PddlState, name: str) -> set[tuple[str, ...]]:
    return {one.terms for one in Derivation(of.domain).derived(of) if one.name == name}


def test_it_follows_rules_through_themselves_and_through_opposites():
    blocks = state()
    assert derived(blocks, "above") == {("a", "b"), ("b", "c"), ("a", "c"), ("d", "e")}
    assert derived(blocks, "clear") == {("a",), ("d",)}
    assert blocks.holds(Predicate("clear", ("a",)))
    assert not blocks.holds(Predicate("clear", ("c",)))


def test_any_of_several_rules_will_do_each_for_its_own_types():
    assert derived(state(), "light") == {("d",), ("b",)}


def test_it_is_derived_anew_after_a_change():
    blocks = state()
    assert not blocks.holds(Predicate("clear", ("b",)))
    blocks.apply([Delete(Predicate("on", ("a", "b"))), Add(Predicate("on", ("a", "d")))])
    assert blocks.holds(Predicate("clear", ("b",)))
    assert not blocks.holds(Predicate("clear", ("d",)))


def test_the_bases_of_a_derived_predicate_are_known():
    blocks = state()
    light = blocks.derivation.bases(Predicate("light", ("b",)), blocks)
    names = ("a", "b", "c", "d", "e")
    ons = {Predicate("on", (one, other)) for one in names for other in names}
    assert light == {Fluent("weight", ("b",)), *ons}


@pytest.mark.parametrize(
    "rules",
    [
        "(:derived (p ?x) (not (p ?x)))",
        "(:derived (p ?x) (exists (?y) (q ?y)))\n(:derived (q ?x) (imply (p ?x) (r)))",
    ],
)
def test_a_predicate_cannot_follow_from_its_own_opposite(rules):
    with pytest.raises(PlanningError, match=r"domain:[23]: [pq] is derived from its own opposite"):
        read_domain(f"(define (domain d) (:predicates (p ?x) (q ?x) (r))\n{rules})")
