# ruff: noqa: N801, N803 - named as rules name them
from __future__ import annotations

from dataclasses import replace
from unittest import mock

import pytest
from hypothesis import given

from socialbot.bdi import literals, plans, steps, terms
from socialbot.bdi import literals as events
from socialbot.bdi import terms as conditions
from socialbot.bdi.agentspeak import agentspeak, parse_plan, rules
from socialbot.bdi.literals import Belief, Change, Event, Goal, Literal, SingletonBelief, error, source
from socialbot.bdi.plans import Inference, Plan, atomic, flat, labelled, priority, stage
from socialbot.bdi.steps import (
    Achieve,
    Action,
    Do,
    Forget,
    Update,
    apart,
    as_long_as,
    ask,
    enter,
    fail,
    first_of,
    for_each,
    together,
    wait,
    wait_for,
    when,
)
from socialbot.bdi.steps import (
    test as holds,
)
from socialbot.bdi.terms import Atom, Comparison, Variable, conjunction, variables
from tests.bdi.agentspeak.programs import INFERENCES, PLANS, SLOW
from tests.bdi.agentspeak.shape import shape

DSL = {"replace": replace, "fail": fail, "wait": wait}
for _module in (terms, conditions, literals, events, steps, plans):
    DSL.update({name: value for name, value in vars(_module).items() if name[0] != "_"})
UNCHECKED = mock.patch.object(Plan, "check", lambda plan: plan)
"""Whether a plan could run is not the matter here."""
pytestmark = pytest.mark.filterwarnings("ignore:Generating overly large repr")
X, Y, _ = variables("X Y _")


def walk(item, roles, found, role=None):
    """Collect the literals with their roles, and the variables."""
    if isinstance(item, Variable):
        found.add(item.name)
    elif isinstance(item, Literal):
        roles.setdefault(item.functor, set()).update({role} - {None})
        walk((*item.args, *item.annotations), roles, found)
    elif isinstance(item, (tuple, list)):
        for part in item:
            walk(part, roles, found, role)
    elif isinstance(item, Event):
        goal = item.change not in (Change.ADDED, Change.REMOVED, Change.HELD, Change.CHANGED)
        walk(item.literal, roles, found, Goal if goal else Belief)
    elif isinstance(item, Comparison):
        walk((item.left, item.right), roles, found)
    elif type(item).__module__.startswith("socialbot.bdi") and not isinstance(item, Atom):
        own = {Achieve: Goal, Do: Action, Inference: Belief, Update: Belief, Forget: Belief}.get(type(item), role)
        term = isinstance(item, (terms.Term, Plan))
        for name, part in vars(item).items():
            of_term = term or name == "limit_s" or isinstance(part, Variable)
            walk(part, roles, found, None if of_term and name != "condition" else own or Belief)


def evaluated(text, item):
    """Evaluate the text with the classes and variables of a program."""
    roles, found = {}, set()
    walk(item, roles, found)
    classes = {name: type(name, (*(used or {Belief}),), {}) for name, used in roles.items() if len(used) < 2}
    names = {**classes, **{name: Variable(name) for name in found}, **DSL}
    with UNCHECKED, mock.patch.object(Inference, "check", lambda inference: inference):
        return eval(text, names)


@SLOW
@given(PLANS)
def test_a_plan_in_python_notation_makes_the_same_plan(plan):
    (made,) = flat([evaluated(rules(plan), plan)])
    assert shape(made) == shape(plan)


@SLOW
@given(INFERENCES)
def test_an_inference_in_python_notation_makes_the_same_inference(inference):
    assert shape(evaluated(rules(inference), inference)) == shape(inference)


class near(Belief): ...


class at(SingletonBelief): ...


class Greet(Goal): ...


class speak(Action): ...


def close(X):
    return X < 2


with UNCHECKED:
    PYTHON = {
        "belief": +near(X) >> [speak("hi", X, True, None)],
        "goal": Greet(X) / near(X) >> [Greet(X).within(5), speak(X).within(X + 1), apart(Greet(X))],
        "failed goal": -Greet(X)[error(Atom("timeout"))] >> [fail("no"), fail()],
        "conditions": +near(X) / ((X > 3) & ~at(X, 1) & (near(_) | at(Y, 2)) & close) >> [speak(X)],
        "comparisons only": Greet(X) / conjunction(X > 3, X < 5) >> [],
        "one comparison": Greet(X) / (X + 1 >= 3) >> [],
        "functions only": Greet(X) / conjunction(close, close) >> [],
        "changes": Greet(X) >> [+near(X), -near(_), Update("-+", near(X)), Update("+", near(X)), -near(X)[source(Y)]],
        "held": +near(X).held_for(2.5) >> [wait(0.5), wait(X)],
        "stages": -near(X) >> [enter("late shift"), ask(near(X)), wait_for(+at(X, Y), 3), wait_for(at(X, 1) | (X > 1))],
        "blocks": Greet(X) >> [when(X > 1, [speak(X)], [when(near(X), [])]), as_long_as(near(X), [speak(1)])],
        "branches": Greet(X) >> [
            together([speak(1)], []), first_of([speak(2), speak(3)], [for_each(near(Y), [speak(Y)])])
        ],
        "tests": Greet(X) >> [holds(X > 1), holds(near(X)), holds(near(X) & (X > 1))],
        "modified": atomic(*priority(2, *stage("night", labelled("l", +near(X) >> []))))[0],
    }  # fmt: skip


@pytest.mark.parametrize("name", PYTHON)
def test_a_python_rule_in_python_notation_makes_the_same_rule(name):
    with UNCHECKED:
        (made,) = flat([eval(rules(PYTHON[name]), {**DSL, **globals()})])
    assert shape(made) == shape(PYTHON[name])


AS_AGENTSPEAK = {
    "belief": '+near(X) <- speak("hi", X, true, none).',
    "goal": "+!'Greet'(X) : near(X) <- !'Greet'(X)[within(5)]; speak(X)[within(X + 1)]; !!'Greet'(X).",
    "failed goal": "-!'Greet'(X)[error(timeout)] <- .fail(error_msg(\"no\")); .fail.",
    "conditions": "+near(X) : X > 3 & not at(X, 1) & (near(_) | at(Y, 2)) & .python(close, X) <- speak(X).",
    "changes": (
        "+!'Greet'(X) <- ++near(X); .abolish(near(_)); -+near(X); +near(X); "
        "for (near(X)[source(Y)]) { --near(X)[source(Y)] }."
    ),
    "held": "+near(X)[held_for(2.5)] <- .wait(500); .wait(X * 1000).",
    "stages": "-near(X) <- .enter('late shift'); ?near(X); .wait({+at(X, Y)}, 3000); .wait(at(X, 1) | X > 1).",
    "blocks": "+!'Greet'(X) <- if (X > 1) { speak(X) } elif (near(X)) { }; while (near(X)) { speak(1) }.",
    "branches": "+!'Greet'(X) <- speak(1) |&| { }; { speak(2); speak(3) } ||| { for (near(Y)) { speak(Y) } }.",
    "tests": "+!'Greet'(X) <- X > 1; ?(near(X) & true); ?(near(X) & X > 1).",
    "modified": "@l[atomic, priority(2), stage(night)] +near(X).",
}


@pytest.mark.parametrize("name", AS_AGENTSPEAK)
def test_a_python_rule_has_a_counterpart_in_agentspeak(name):
    assert agentspeak(PYTHON[name]) == AS_AGENTSPEAK[name]


@pytest.mark.parametrize("name", sorted(set(AS_AGENTSPEAK) - {"conditions"}))
def test_the_counterpart_can_be_read(name):
    assert agentspeak(parse_plan(AS_AGENTSPEAK[name])) == AS_AGENTSPEAK[name]


def test_variables_in_small_letters_stay_variables():
    x = Variable("x")
    assert agentspeak(+near(x) >> [speak(x)]) == "+near(_x) <- speak(_x)."


def test_other_objects_become_strings():
    assert agentspeak(near(frozenset({1}))) == 'near("frozenset({1})")'
    assert agentspeak(near(float("inf"))) == 'near("inf")'


def test_a_name_with_two_roles_is_spelled_out():
    plan = parse_plan("+!at(X) : not at(X) <- -+at(X).")
    assert rules(plan) == (
        'Event(Change.WANTED, literal("at", (X,))) / (~literal("at", (X,))) >> [Update("-+", literal("at", (X,)))]'
    )


def test_an_inference_of_python():
    inference = near(X) << (at(X, Y) & (Y < 2))
    assert rules(inference) == "near(X) << (at(X, Y) & (Y < 2))"
    assert agentspeak(inference) == "near(X) :- at(X, Y) & Y < 2."
