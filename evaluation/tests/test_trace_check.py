from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from evaluation.trace_check import TraceCheck, check, read_actions
from socialbot.core.clock import nanoseconds

DOMAIN = """
(define (domain shop) ; a comment (with parentheses
  (:requirements :typing :durative-actions :fluents)
  (:types robot place - object)
  (:predicates (at ?r - robot ?p - place) (open ?p - place) (lit) (served ?p - place))
  (:functions (load ?r - robot) (stock))
  (:durative-action move
    :parameters (?r - robot ?a ?b - place)
    :duration (= ?duration 5)
    :condition (at start (at ?r ?a))
    :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))))
  (:durative-action serve
    :parameters (?r - robot ?p - place)
    :duration (= ?duration 2)
    :condition (and (at start (< (load ?r) 2)) (over all (and (at ?r ?p) (open ?p))) (at end (lit)))
    :effect (and (at start (increase (load ?r) 1)) (at end (served ?p)) (at end (decrease (stock) 1))))
  (:durative-action shut
    :parameters (?p - place)
    :duration (= ?duration 1)
    :condition (at start (open ?p))
    :effect (at start (not (open ?p))))
  (:action flash :parameters () :precondition (not (lit)) :effect (lit)))
"""
START = ["at(r, home)", "at(r2, shop)", "open(shop)", "lit()", "load(r, 0)", "load(r2, 0)", "stock(7)"]


@dataclass
class Line:
    stamp: int
    id: str
    kind: str
    what: str
    cause: str = ""
    detail: dict[str, object] = field(default_factory=dict)


class Diary:
    """A trace, written line by line; a step is named by its call, and its records have that as their cause."""

    def __init__(self, *beliefs: str) -> None:
        self.check = TraceCheck(DOMAIN)
        self.now = 0.0
        for belief in beliefs or START:
            self.note("belief", belief)

    def note(self, kind: str, what: str, cause: str = "", **detail: object) -> Diary:
        self.check.take(Line(nanoseconds(self.now), f"{kind} {what}", kind, what, cause, detail))
        return self

    def wait(self, seconds: float) -> Diary:
        self.now += seconds
        return self

    def begin(self, call: str) -> Diary:
        return self.note("step", call)

    def end(self, call: str, outcome: str = "successful") -> Diary:
        return self.note("step_end", call, f"step {call}", outcome=outcome)

    def add(self, belief: str, call: str = "") -> Diary:
        return self.note("belief", belief, f"step {call}" if call else "")

    def remove(self, belief: str, call: str = "") -> Diary:
        return self.note("unbelief", belief, f"step {call}" if call else "")

    @property
    def found(self) -> list[str]:
        return [f"{one.step} {one.what}" for one in self.check.violations]


MOVE, SERVE = "(move r home shop)", "(serve r2 shop)"


def moved() -> Diary:
    return Diary().begin(MOVE).remove("at(r, home)", MOVE).wait(5).add("at(r, shop)", MOVE).end(MOVE)


def served() -> Diary:
    """Valid trace: the number is replaced twice, once with the new value first."""
    diary = Diary().begin(SERVE).add("load(r2, 1)", SERVE).remove("load(r2, 0)", SERVE).wait(2)
    return diary.add("served(shop)", SERVE).remove("stock(7)", SERVE).add("stock(6)", SERVE).end(SERVE)


def test_steps_that_do_as_they_should_are_no_violations():
    assert moved().found == []
    diary = served()
    assert diary.found == []
    assert diary.check.steps == 1
    assert diary.check.running == ()


def test_a_step_against_a_condition_at_its_start_is_found():
    (found,) = Diary().begin("(move r shop home)").found
    assert found == "(move r shop home) begins though (at r shop) does not hold"
    (found,) = Diary("at(r, shop)", "open(shop)", "load(r, 2)").begin("(serve r shop)").found
    assert "(< (load r) 2) does not hold" in found
    (found,) = Diary("at(r, shop)", "open(shop)").begin("(serve r shop)").found
    assert "(< (load r) 2) does not hold" in found


@pytest.mark.parametrize(
    ("step", "fits"), [("(move r home yard)", True), ("(move r shop yard)", False), ("(serve r home)", False)]
)
def test_a_step_may_take_the_place_of_one_with_the_same_effects_at_its_start(step, fits):
    diary = Diary("at(r, home)", "open(home)", "load(r, 0)").begin(MOVE).remove("at(r, home)")
    message = f"{step} takes its place"
    diary.note("step_end", MOVE, f"step {MOVE}", outcome="cancelled", message=message)
    assert (diary.begin(step).found == []) == fits


def test_so_is_one_against_a_condition_over_all():
    (found,) = Diary().remove("open(shop)").begin(SERVE).found
    assert "(and (at r2 shop) (open shop)) does not hold" in found


def test_so_is_a_step_that_the_domain_does_not_have():
    assert Diary().begin("(dance r)").found == ["(dance r) is no action of the domain"]
    assert Diary().begin("(move r)").found == ["(move r) is no action of the domain"]


def test_a_step_that_begins_twice_at_once_is_found():
    assert "(move r home shop) begins while it runs" in Diary().begin(MOVE).begin(MOVE).found


def test_start_effects_count_before_sensors_see_them():
    (found,) = Diary().begin(MOVE).begin("(move r home yard)").found
    assert (
        found == "(move r home yard) begins though (move r home shop) has begun, after which (at r home) does not hold"
    )


def test_once_it_was_seen_others_may_change_it_back():
    diary = Diary().begin(MOVE).remove("at(r, home)").add("at(r, home)").begin("(move r home yard)")
    assert diary.found == []


def test_a_step_must_not_delete_a_condition_of_another_one():
    (found,) = Diary().begin(SERVE).begin("(shut shop)").found
    assert found == "(shut shop) begins and ends (and (at r2 shop) (open shop)), which (serve r2 shop) needs"


def test_no_step_starts_while_sensors_are_silent():
    silent = Diary().note("silent", "eye").wait(1)
    assert silent.begin(MOVE).found == ["(move r home shop) begins while sensor eye is silent"]
    assert Diary().note("silent", "eye").begin(MOVE).found == []  # at the very same moment
    assert Diary().note("silent", "eye").wait(1).note("heard", "eye").begin(MOVE).found == []


def test_effects_have_to_be_there_at_the_end():
    assert Diary().begin(MOVE).wait(5).end(MOVE).found == [
        "(move r home shop) ends well though (at r shop) is not True"
    ]
    diary = Diary().begin(SERVE).add("load(r2, 1)", SERVE).add("served(shop)").end(SERVE)
    assert diary.found == ["(serve r2 shop) ends well though (stock) is not 6.0"]


def test_numbers_may_have_gone_on_since():
    diary = Diary().begin(SERVE).add("served(shop)")
    for stock in ("stock(6)", "stock(5)"):
        diary.add(stock)
    assert diary.end(SERVE).found == []


def test_effects_take_place_once():
    again = served().found
    diary = Diary().begin(SERVE).add("load(r2, 1)", SERVE).add("served(shop)", SERVE)
    diary.add("stock(6)", SERVE).add("stock(5)", SERVE).end(SERVE)
    assert again == []
    assert diary.found == ["(serve r2 shop) changes (stock) to 5.0, which is no effect of it, or again"]
    assert Diary().begin(SERVE).add("stock(5)", SERVE).found != []
    assert Diary().begin(SERVE).remove("stock(7)", SERVE).add("stock(5)", SERVE).found != []


def test_a_step_changes_only_its_effects():
    assert len(Diary().begin(MOVE).remove("open(shop)", MOVE).found) == 1
    assert len(Diary().begin(MOVE).add("at(r2, home)", MOVE).found) == 1


def test_only_failed_steps_are_rolled_back_once():
    diary = Diary().begin(SERVE).remove("load(r2, 0)", SERVE).add("load(r2, 1)", SERVE).end(SERVE, "failed")
    undo = f"step_end {SERVE}"
    diary.note("unbelief", "load(r2, 1)", undo).note("belief", "load(r2, 0)", undo)
    assert diary.found == []
    diary.note("unbelief", "at(r2, shop)", undo)
    assert diary.found == ["(serve r2 shop) takes back (at r2 shop), which it has not changed"]
    diary.note("belief", "load(r2, -1)", undo)
    assert len(diary.found) == 2


def test_a_condition_over_all_may_flicker_but_not_be_gone_for_long():
    def with_a_gap(seconds: float) -> list[str]:
        diary = Diary().begin(SERVE).wait(1).remove("open(shop)").wait(seconds)
        return diary.add("served(shop)").add("stock(6)").end(SERVE).found

    assert with_a_gap(2.5) == []
    assert with_a_gap(3.5) == ["(serve r2 shop) ends well though (and (at r2 shop) (open shop)) had not held for 3 s"]


def test_a_condition_at_the_end_has_to_hold_at_some_time():
    diary = Diary("at(r2, shop)", "open(shop)", "load(r2, 0)", "stock(7)").begin(SERVE)
    diary.add("served(shop)").add("stock(6)").end(SERVE)
    assert diary.found == ["(serve r2 shop) ends well though (lit) did not hold"]


def test_a_step_that_could_not_begin_may_fail_but_not_end_well():
    assert Diary().end(MOVE, "failed").found == []
    assert Diary().end(MOVE).found == ["(move r home shop) ends well, and has not begun"]


def test_instantaneous_actions_happen_at_their_end():
    assert Diary("open(shop)").begin("(flash)").add("lit()").end("(flash)").found == []
    assert Diary().begin("(flash)").found == ["(flash) begins though (not (lit)) does not hold"]


def test_a_whole_trace_can_be_followed_at_once():
    lines = [Line(0, str(number), "belief", belief) for number, belief in enumerate(START)]
    assert check(DOMAIN, [*lines, Line(1, "x", "step", "(move r yard home)")]).violations != []


@pytest.mark.parametrize("effect", ["(forall (?x) (lit))", "(when (lit) (lit))"])
def test_unsupported_traces_are_an_error(effect):
    domain = f"(define (domain d) (:action a :parameters () :precondition () :effect {effect}))"
    with pytest.raises(ValueError, match="knows no"):
        TraceCheck(domain).take(Line(0, "x", "step", "(a)"))
    with pytest.raises(ValueError, match="no PDDL"):
        read_actions("nothing")
