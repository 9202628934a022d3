"""Intentions that wait for events and conditions, found by indexes."""

from __future__ import annotations

import time
from random import Random

import pytest

from socialbot.bdi import Belief, Computed, Library, Plan, wait_for
from socialbot.bdi._waits import Waits
from socialbot.bdi.literals import Change, Event, Literal, literal, source
from socialbot.bdi.steps import Await, Update
from socialbot.bdi.terms import NOTHING, Atom, Disjunction, Negation, conjunction
from tests.bdi.lab import Lab, X, Y, _, do, go, mood, p, q, sub
from tests.bdi.mas import Mas


class r(Belief):  # noqa: N801
    """Inferred from ``p`` and ``q``."""


class NaiveWaits(Waits):
    """Waits without indexes: every pause is tried for every event, every condition in every turn."""

    def recheck(self):
        super().recheck()
        self.due.update(self.conditions)

    def await_condition(self, pause):
        super().await_condition(pause)
        self.due[pause] = None

    def notify(self, key, args, notes, outside=True):
        index = self.events.get(key)
        if index is not None:
            for pause in sorted(index.waiters(), key=_number):
                if pause.matches(args, notes):
                    self.forget_event(pause)
                    pause.end()


def _number(pause):
    return pause.number


def naive(lab: Lab) -> Lab:
    naive_waits, waits = NaiveWaits(lab.engine.interpreter), lab.engine.intentions.waits
    naive_waits.events, naive_waits.due = waits.events, waits.due  # the interpreter keeps references to them
    lab.engine.intentions.waits = naive_waits
    return lab


def f(*args: object) -> Literal:
    return literal("f", args)


def test_intentions_that_wait_for_the_same_event_continue_in_order():
    lab = Lab(go(X) >> [wait_for(+p(1)), do(X)], sub(X, _) >> [wait_for(+p(Y)), do(X)])
    lab.tell(go(1), sub(2, 0), go(3), go(4))
    lab.tell(+p(2))
    assert lab.done == [2]
    lab.tell(sub(5, 0), +p(1))
    assert lab.done == [2, 1, 3, 4, 5]
    assert len(lab.engine.intentions) == 0
    assert not lab.engine.intentions.waits.events


RULES = [r(X) << (q(X, Y) & ~p(Y)), r(X) << (p(X) & q(_, X))]
WHAT = [
    *(+p(part) for part in (X, 0, _, Y, f(X), f(_), f(0), f(1)[source(Atom("a"))], (X, Y), (0, 1))),
    *(-p(part) for part in (X, f(X))),
    +q(X, Y), +q(_, X), +q(Y, Y), -q(f(X), _), +p(X)[source(Atom("a"))], +p(_)[source(Y)], Event(Change.WANTED, go(X)),
    p(X), p(f(X)), p((X, Y)), p(_), ~p(X), ~p(f(X)), q(X, Y) & ~p(Y), q(Y, X), q(Y, Y), p(Y) & q(Y, X), r(X), ~r(X),
    p(X)[source(Atom("a"))], ~p(X)[source(Atom("a"))], p(Y)[source(Atom("a"))] & q(Y, f(X)),
    conjunction(Disjunction((p(X), conjunction(q(X, X))))), Negation(conjunction(p(X), q(X, _))),
]  # fmt: skip
"""Events and conditions with a known X."""
VALUES = (0, 1, 1.0, f(0), f(1), f(1)[source(Atom("a"))], (0, 1), (1, 1))


def stimulus(random: Random, lab: Lab) -> str:
    """Post a random item, or let the engine run for a while; return it as text."""
    engine = lab.engine
    belief = p(random.choice(VALUES)) if random.random() < 0.5 else q(*random.choices(VALUES[:5], k=2))
    what = random.choice(
        ("wait", "wait", "believe", "believe", "believe", "tell", "forget", "forget", "go", "run", "run")
    )
    if what == "wait":
        engine.achieve(sub(random.randrange(len(WHAT)), random.choice((0, 1))))
    elif what == "go":
        engine.achieve(go(random.choice(VALUES)))
    elif what == "run":
        engine.run_until_idle(random.choice((1, 5, 50)))
        lab.clock.advance(random.random())
    elif what == "forget":
        engine.forget(belief)
    else:
        engine.believe(belief, source="self" if what == "believe" else "a")
    return f"{what} {belief}"


def test_indexed_waits_equal_waits_without_indexes():
    bodies = [(Update("+", p(1)),), (Update("-", q(0, _)),), ()]
    plans = [
        Plan(Event(Change.WANTED, sub(i, X)), NOTHING, (Await(what, 3 if i % 3 else None), *bodies[i % 3])).check()
        for i, what in enumerate(WHAT)
    ]
    library, ended = Library(*plans, *RULES), set()
    for seed in range(200):
        labs = [Lab(library=library), naive(Lab(library=library))]
        randoms = [Random(seed), Random(seed)]
        for _turn in range(40):
            texts = [stimulus(random, lab) for random, lab in zip(randoms, labs, strict=True)]
            assert texts[0] == texts[1]
        for lab in labs:
            lab.engine.run_until_idle(500)
        assert labs[0].trace == labs[1].trace, seed
        assert [str(each) for each in labs[0].engine.intentions] == [str(each) for each in labs[1].engine.intentions]
        ended |= {record.what for record in labs[0].trace if record.kind == "achieved"}
    assert ended >= {f"sub({i}, {x})" for i in range(len(WHAT)) for x in (0, 1)}


def waiting(*rules):
    """A lab in which goals wait, and what they have done."""
    lab = Lab(*rules)
    lab.tell(*(go(number) for number in range(3)))
    return lab


def test_a_condition_is_evaluated_only_after_a_change_of_a_belief_that_it_names():
    lab = waiting(go(X) >> [wait_for(q(X, Y) & ~p(X)), do(X, Y)])
    checked = []
    for pause in lab.engine.intentions.waits.conditions:
        pause.solve = lambda solve=pause.solve: checked.append(1) or solve()
    lab.tell(+mood(1), +p(7), +q(7, 7), -p(7))
    assert checked == []
    lab.tell(+p(1), +q(1, 5))
    lab.tell(-p(1))
    assert checked == [1, 1]
    assert lab.done == [(1, 5)]


def test_a_condition_with_the_time_or_a_function_is_evaluated_in_every_turn():
    now = [0]
    lab = waiting(go(X) >> [wait_for(conjunction(p(X), lambda: now[0] > 0)), do(X)])
    lab.tell(+p(1))
    assert lab.done == []
    now[0] = 1
    lab.tell(+mood(1))
    assert lab.done == [1]


def test_a_condition_that_follows_from_a_later_rule_holds():
    lab = waiting(RULES[0], go(X) >> [wait_for(r(X)), do(X)])
    lab.tell(+p(2))
    assert lab.done == []
    lab.engine.add_rules(r(X) << p(X))
    lab.tell(+mood(1))
    assert lab.done == [2]


def test_a_condition_with_a_computed_belief_is_evaluated_in_every_turn():
    values = set()

    class near(Computed):  # noqa: N801
        def solutions(self, x):
            return [(value,) for value in values]

    lab = waiting(go(X) >> [wait_for(near(X)), do(X)])
    values.add(1)
    lab.tell(+mood(1))
    assert lab.done == [1]


def test_a_new_source_of_a_belief_may_satisfy_a_condition():
    lab = waiting(go(X) >> [wait_for(p(X)[source("bob")]), do(X)])
    lab.tell(+p(1))
    assert lab.done == []
    lab.engine.believe(p(1), source="bob")
    lab.engine.run_until_idle()
    assert lab.done in ([1], [])


def test_an_awaited_event_comes_after_a_shared_library_was_copied():
    lab = waiting(go(X) >> [wait_for(+p(X)), do(X)])
    lab.engine.library.users += 1
    lab.engine.add_rules(sub(X, Y) >> [do("sub")])
    lab.tell(+p(2))
    assert lab.done == [2]


@pytest.mark.parametrize("what", [+p(X), p(X)])
def test_the_cost_of_an_event_does_not_grow_with_the_waiting_intentions(what):
    def cost(number):
        lab = Lab(go(X) >> [wait_for(what), -p(X), do(X)])
        lab.engine.trace.sink = None
        for i in range(number):
            lab.engine.achieve(go(i))
        lab.engine.run_until_idle(10 * number)
        begun = time.process_time()
        for i in range(100):
            lab.engine.believe(p(number - 1 - i))
            lab.engine.run_until_idle()
        took = time.process_time() - begun
        assert lab.done == [number - 1 - i for i in range(100)]
        return took

    few, many = (min(cost(number) for _ in range(3)) for number in (100, 2000))
    assert many < 5 * few


def test_an_event_without_a_value_continues_waits_for_a_value():
    program = "!w(1). !add. +!w(X) <- .wait({+p(X)}); .print(X). +!add <- .wait(10); +p(_)."
    assert Mas(me=program).until(1).lines == ["1"]
