from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.clock import SECOND
from tests.bdi.lab import Lab
from tests.bdi.programs import CLASSES, PROGRAMS, STIMULI, literal, rule_of
from tests.bdi.reference import Atom, Check, Plain, Reference, Step

FULL = 60


class Both:
    """The engine and the reference, given the same program and the same stimuli."""

    def __init__(self, program: list[Plain]) -> None:
        self.lab = Lab(*map(rule_of, program))
        self.reference = Reference(program)

    def give(self, what: str, value: Atom | int) -> None:
        if isinstance(value, Atom):
            getattr(self.lab.engine, what)(literal(value))
            getattr(self.reference, what)(value)
        elif what == "seconds":
            self.lab.clock.advance(value)
            self.reference.now += value
        else:
            self.lab.engine.run_until_idle(budget=value)
            for _ in range(value):
                self.reference.turn()

    @property
    def done(self) -> list[str]:
        return ["".join(map(str, what)) for what in self.lab.done]

    def beliefs_agree(self) -> bool:
        for name in "pqs":
            held = [h.belief.args[0] for h in self.lab.engine.beliefs if h.belief.functor == CLASSES[name].__name__]
            if held != [atom.arg for atom in self.reference.beliefs if atom.name == name]:
                return False
        return True


@settings(deadline=None, max_examples=200)
@given(PROGRAMS, STIMULI)
def test_the_engine_does_what_the_reference_does(program, stimuli):
    both = Both(program)
    for what, value in [*stimuli, ("turns", FULL), ("seconds", 2), ("turns", FULL)]:
        both.give(what, value)
        # A posted stimulus is seen with the next turn only.
        if what == "turns":
            assert both.done == both.reference.done
            assert both.beliefs_agree()


def test_the_reference_handles_failures_as_a_person_would_tell_it():
    steps = {name: Step("do", Atom(name, 0)) for name in "ab"}
    program = [
        Plain("added", Atom("p", "X"), (Check(Atom("q", "X"), False),), (Step("goal", Atom("g", "X")), steps["b"])),
        Plain("wanted", Atom("g", "X"), (), (Step("goal", Atom("h", 1)), Step("do", Atom("a", 9)))),
        Plain("failed", Atom("g", "X"), (), (steps["a"],)),
    ]
    both = Both(program)
    for stimulus in [("believe", Atom("q", 1)), ("believe", Atom("p", 0)), ("believe", Atom("p", 1)), ("turns", 30)]:
        both.give(*stimulus)
    assert both.done == both.reference.done == ["a0", "b0"]


def test_the_clocks_of_both_agree():
    both = Both([Plain("wanted", Atom("g", 0), (), (Step("wait", Atom("a", 2)), Step("do", Atom("a", 1))))])
    both.give("achieve", Atom("g", 0))
    both.give("turns", 5)
    assert both.done == []
    both.give("seconds", 2)
    both.give("turns", 5)
    assert both.done == both.reference.done == ["a1"]
    assert both.lab.clock.now() == 2 * SECOND


@settings(deadline=None, max_examples=50)
@given(PROGRAMS, STIMULI, st.integers(1, 5))
def test_thinking_in_small_portions_changes_nothing(program, stimuli, portion):
    whole, portions = Both(program), Both(program)
    for what, value in stimuli:
        if isinstance(value, Atom):
            whole.give(what, value)
            portions.give(what, value)
    whole.lab.engine.run_until_idle(budget=20 * portion)
    for _ in range(20):
        portions.lab.engine.run_until_idle(budget=portion)
    assert whole.lab.trace == portions.lab.trace
