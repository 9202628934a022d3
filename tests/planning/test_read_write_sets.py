from __future__ import annotations

import pytest

from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.semantics import ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import ReadWriteAnalysis

DOMAIN = """(define (domain d) (:types box) (:constants a b - box)
  (:predicates (p ?x - box) (q ?x - box) (next ?x ?y - box)) (:functions (n) (m))
  (:action none)
  (:action reads :parameters (?x - box) :precondition (and (p ?x) (not (q ?x))))
  (:action compares :precondition (< (n) (m)))
  (:action all :parameters (?x - box) :precondition (forall (?y - box) (imply (next ?x ?y) (p ?y))))
  (:action any :precondition (exists (?y - box) (and (p ?y) (q ?y))))
  (:action adds :parameters (?x - box) :effect (p ?x))
  (:action deletes :parameters (?x - box) :effect (not (p ?x)))
  (:action marks :parameters (?x - box) :effect (q ?x))
  (:action sums :effect (increase (n) 1))
  (:action assigns :effect (assign (n) 1))
  (:action copies :effect (assign (m) (n)))
  (:action perhaps :parameters (?x - box) :effect (when (q ?x) (p ?x)))
  (:action both :parameters (?x - box) :effect (and (p ?x) (not (p ?x)))))"""


@pytest.mark.parametrize(
    ("one", "other", "clash"),
    [
        ("reads a", "adds a", "(p a)"),
        ("reads a", "adds b", None),
        ("reads a", "marks a", "(q a)"),
        ("reads a", "reads a", None),
        ("adds a", "adds a", None),
        ("adds a", "deletes a", "(p a)"),
        ("both a", "adds a", "(p a)"),
        ("compares", "sums", "(n)"),
        ("compares", "copies", "(m)"),
        ("sums", "sums", None),
        ("sums", "assigns", "(n)"),
        ("assigns", "assigns", "(n)"),
        ("copies", "sums", "(n)"),
        ("perhaps a", "marks a", "(q a)"),
        ("perhaps a", "deletes a", None),  # q a is false, so nothing is added
        ("all a", "adds b", "(p b)"),
        ("all a", "adds a", None),  # a is not next to itself, and nothing can change that
        ("any", "deletes b", "(p b)"),
        ("none", "deletes b", None),
    ],
)
def test_interfering_events_cannot_be_simultaneous(one, other, clash):
    domain = read_domain(DOMAIN)
    state = PddlState.of(read_problem("(define (problem x) (:domain d) (:init (next a b) (= (n) 1)))", domain), domain)
    footprints = ReadWriteAnalysis(domain)
    first, second = (
        footprints.of(ground(domain.actions[name], args), "start", state)
        for name, *args in (one.split(), other.split())
    )
    assert first.clash(second) == clash
    assert second.clash(first) == clash
