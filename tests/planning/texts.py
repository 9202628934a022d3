"""Small domains for the tests: a crane and carriers, a cellar with matches, robots that share a battery."""

from __future__ import annotations

import random
from collections.abc import Sequence

from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.reader import read_domain, read_problem

CRANE = """
(define (domain crane)   ; a crane that puts boxes on carriers
  (:requirements :typing :fluents :durative-actions :negative-preconditions)
  (:types box base - place crane carrier)
  (:predicates (over ?g - crane ?s - base) (on ?b - box ?below - place ?s - base) (clear ?p - place)
    (holding ?g - crane ?b - box) (here ?c - carrier ?s - base) (away ?c - carrier) (loaded ?c - carrier ?b - box))
  (:functions (held ?g - crane) (load ?c - carrier))
  (:durative-action pick
    :parameters (?g - crane ?b - box ?below - place ?s - base)
    :duration (= ?duration 3)
    :condition (and (at start (on ?b ?below ?s)) (at start (clear ?b)) (at start (< (held ?g) 1))
                    (over all (over ?g ?s)))
    :effect (and (at start (increase (held ?g) 1)) (at end (holding ?g ?b)) (at end (not (clear ?b)))
                 (at end (not (on ?b ?below ?s))) (at end (clear ?below))))
  (:durative-action put
    :parameters (?g - crane ?b - box ?c - carrier ?s - base)
    :duration (= ?duration 4)
    :condition (and (at start (< (load ?c) 2)) (at start (holding ?g ?b))
                    (over all (and (over ?g ?s) (here ?c ?s))))
    :effect (and (at end (decrease (held ?g) 1)) (at end (increase (load ?c) 1))
                 (at end (not (holding ?g ?b))) (at end (loaded ?c ?b))))
  (:durative-action come
    :parameters (?c - carrier ?s - base)
    :duration (= ?duration 6)
    :condition (and (at start (away ?c)) (over all (clear ?s)))
    :effect (and (at start (not (away ?c))) (at end (not (clear ?s))) (at end (here ?c ?s))))
  (:durative-action move
    :parameters (?g - crane ?from ?to - base)
    :duration (= ?duration 5)
    :condition (at start (over ?g ?from))
    :effect (and (at start (not (over ?g ?from))) (at end (over ?g ?to)))))
"""

CRANE_PROBLEM = """
(define (problem two-boxes) (:domain crane)
  (:objects crane_a - crane box_1 box_2 - box stack bay - base carrier_a - carrier)
  (:init (over crane_a bay) (on box_1 stack stack) (on box_2 box_1 stack) (clear box_2) (clear bay)
    (away carrier_a) (= (held crane_a) 0) (= (load carrier_a) 0))
  (:goal (and (loaded carrier_a box_1) (loaded carrier_a box_2))))
"""

CRANE_PLAN = """
0.000: (come carrier_a bay) [6.000]
0.000: (move crane_a bay stack) [5.000]
5.001: (pick crane_a box_2 box_1 stack) [3.000]
8.002: (move crane_a stack bay) [5.000]
13.003: (put crane_a box_2 carrier_a bay) [4.000]
17.004: (move crane_a bay stack) [5.000]
22.005: (pick crane_a box_1 stack stack) [3.000]
25.006: (move crane_a stack bay) [5.000]
30.007: (put crane_a box_1 carrier_a bay) [4.000]
"""

CELLAR = """
(define (domain cellar)
  (:requirements :typing :durative-actions :negative-preconditions)
  (:types match fuse)
  (:predicates (light) (unused ?m - match) (mended ?f - fuse) (free))
  (:durative-action strike :parameters (?m - match) :duration (= ?duration 8)
    :condition (and (at start (unused ?m)) (at start (not (light))))
    :effect (and (at start (not (unused ?m))) (at start (light)) (at end (not (light)))))
  (:durative-action mend :parameters (?f - fuse) :duration (= ?duration 5)
    :condition (and (over all (light)) (at start (free)))
    :effect (and (at start (not (free))) (at end (mended ?f)) (at end (free)))))
"""

CELLAR_PROBLEM = """
(define (problem dark) (:domain cellar)
  (:objects m1 m2 - match f1 f2 - fuse)
  (:init (unused m1) (unused m2) (free))
  (:goal (and (mended f1) (mended f2))))
"""


def crane() -> tuple[PddlDomain, PddlProblem]:
    domain = read_domain(CRANE)
    return domain, read_problem(CRANE_PROBLEM, domain)


def cellar() -> tuple[PddlDomain, PddlProblem]:
    domain = read_domain(CELLAR)
    return domain, read_problem(CELLAR_PROBLEM, domain)


def mutated(text: str, seed: int, words: Sequence[str]) -> str:
    """Return ``text`` with a few words or characters lost, doubled, or replaced by one of ``words``."""
    chance = random.Random(seed)
    found = text.replace("(", " ( ").replace(")", " ) ").split()
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(found))
        match chance.randrange(5):
            case 0:
                del found[place]
            case 1:
                found[place] = chance.choice(words)
            case 2:
                found.insert(place, chance.choice(words))
            case 3:
                found[place] = chance.choice(found)
            case _:
                found[place] = found[place][: chance.randrange(len(found[place]) + 1)] + chance.choice(";\x00é\n\"'")
        found = found or ["("]
    return " ".join(found)
