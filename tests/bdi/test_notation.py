# ruff: noqa: N803 - functions name the variables they look at

import functools
from contextlib import contextmanager

import pytest

from socialbot.bdi import Plan, fail, wait
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, Y, _, deep, do, go, mood, p, ping, q, sub


@contextmanager
def raises(*words):
    """Expects a RuleError that names ``words`` and says what to do about it."""
    with pytest.raises(RuleError) as caught:
        yield
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        (+p(1) >> [], "+p(1) >> []"),
        (-p(X) >> [do(X)], "-p(X) >> [do(X)]"),
        (go() / p(X) >> [do(X), sub(X)], "go() / (p(X)) >> [do(X), sub(X)]"),
        (-go(X) >> [do("sorry")], '-go(X) >> [do("sorry")]'),
        (+p(X) / (q(X, Y) & ~q(Y, X)) >> [-p(X), +q(Y)], "+p(X) / (q(X, Y) & ~q(Y, X)) >> [-p(X), +q(Y)]"),
        (+p(X) / (q(Y) & (X > Y)) >> [], "+p(X) / (q(Y) & (X > Y)) >> []"),
        (+p(X).held_for(2.5) >> [wait(1), fail()], "+p(X).held_for(2.5) >> [wait(1), fail()]"),
        (+p().held_for(lambda: 3.0) >> [], "+p().held_for(...) >> []"),
        (+p(X) / (lambda X: X > 1) >> [], "+p(X) / (<lambda>(X)) >> []"),
        (+p(X, _, "a") >> [do(X + 1)], '+p(X, _, "a") >> [do(X + 1)]'),
    ],
    ids=str,
)  # fmt: skip
def test_a_printed_rule_can_be_parsed_again(rule, text):
    assert str(rule) == text


def test_conditions_join_in_any_way():
    joined = p(1) & (q(2) & ~p(3)) & (X > 1) & (lambda: True)
    assert len(joined.terms) == 5
    assert len((~p(1) & q(1)).terms) == 2
    assert len(((lambda: True) & p(1) & (lambda: False)).terms) == 3
    assert len(((lambda: True) & ~p(1)).terms) == 2


def test_literals_are_equal_by_name_and_arguments():
    assert p(1, "a") == p(1, "a")
    assert p(1) != p(2)
    assert p(1) != q(1)
    assert len({p(1), p(1), q(1)}) == 2


def test_a_function_object_can_be_a_condition():
    lab = Lab(go() / functools.partial(lambda low, high: low < high, 1, 2) >> [do("held")])
    lab.tell(go())
    assert lab.done == ["held"]


@pytest.mark.parametrize("condition", [q(1), ~q(1), X > 1], ids=["belief", "negation", "comparison"])
def test_a_condition_without_parentheses_is_explained(condition):
    with raises("parentheses"):
        _rule = +p(X) / p(2) & condition >> [do("x")]


def test_a_condition_without_parentheses_before_a_goal_is_explained():
    with raises("is not in parentheses", "event"):
        _rule = +p(1) / p(2) & go() >> [do("x")]


def test_a_belief_without_plus_or_minus_is_no_event():
    with raises("+p(1)"):
        _rule = p(1) >> [do("x")]  # type: ignore[operator]


@pytest.mark.parametrize(
    "make",
    [
        lambda: go() >> [do(X)],
        lambda: +p(X) >> [+q(Y)],
        lambda: +p(X) >> [sub(X + Y)],
        lambda: +p(X) / (Y > 1) >> [],
        lambda: +p(X) / ((Y > 1) & q(Y)) >> [],
        lambda: +p(X) / (lambda Speed: Speed > 1) >> [],
        lambda: +p(1) / ~q(X) >> [do(X)],
    ],
)
def test_a_variable_without_a_value_is_refused_by_name(make):
    with raises("has no value in"):
        make()


@pytest.mark.parametrize(
    "make",
    [
        lambda: go() / p(X + 1) >> [],
        lambda: go() / ~p(X + 1) >> [],
        lambda: go() / p(X + 1, X) >> [],
    ],
    ids=["belief", "negation", "too late"],
)
def test_an_expression_in_a_condition_needs_its_variables_before(make):
    with raises("X has no value"):
        make()


def test_expression_uses_variables_bound_before_it():
    lab = Lab(go() / p(X, X + 1) >> [do(X)])
    lab.tell(+p(1, 3), +p(4, 5), go())
    assert lab.done == [4]


@pytest.mark.parametrize(
    "make",
    [
        lambda: go() >> [do(_)],
        lambda: go() >> [+p(_)],
        lambda: go() / (_ > 1) >> [],
    ],
    ids=["action", "belief", "comparison"],
)
def test_underscore_has_no_value(make):
    with raises("_ has no value"):
        make()


def test_underscore_in_a_goal_is_an_anonymous_variable():
    lab = Lab(go() >> [sub(_, 1), do("on")], sub(X, Y) / p(X) >> [do(X, Y)])
    lab.tell(+p(2), go())
    assert lab.done == [(2, 1), "on"]


def test_a_plan_may_forget_whatever_it_believes_of_a_name():
    lab = Lab(go() >> [-p(_, 2), do("done")])
    lab.tell(+p(1, 2), +p(2, 2), +p(1, 3), go())
    assert lab.beliefs == ["p(1, 3)"]
    assert lab.done == ["done"]


@pytest.mark.parametrize("make", [lambda: go() >> [do], lambda: go() >> [sub], lambda: +p(1) >> [do("x"), deep]])
def test_a_class_instead_of_an_instance_is_explained(make):
    with raises("is a class", "()"):
        make()


@pytest.mark.parametrize("step", [p(1), p(1).held_for(1), +p(1).held_for(1), -go(), "say", None, p])
def test_refuses_other_items_as_steps(step):
    with raises("not a step of a plan"):
        _rule = go() >> [step]


def test_a_body_that_is_no_list_is_explained():
    with raises("[do("):
        _rule = go() >> do("x")  # type: ignore[operator]


@pytest.mark.parametrize("condition", [p, go(), 3, "p", +p(1)])
def test_refuses_other_items_as_conditions(condition):
    with raises("cannot be a condition"):
        _rule = go() / condition  # type: ignore[operator]
    with raises("cannot be a condition"):
        _rule = p(1) & condition


def test_a_goal_has_no_negation():
    with raises("~sub(1) is not written", "test(~belief)"):
        _rule = go() >> [~sub(1)]  # type: ignore[operator]


def test_an_event_cannot_compute_in_its_arguments():
    with raises("+p(X + 1) computes"):
        _rule = +p(X + 1) >> []


@pytest.mark.parametrize("event", [-ping(1), +ping(1).held_for(1)])
def test_a_reactor_is_never_removed_nor_held(event):
    with raises("never happens"):
        _rule = event >> []
    assert isinstance(+ping(1) >> [], Plan)


def test_refuses_other_items_as_plans():
    with raises("is not a plan"):
        Lab(+p(1) / q(1))  # type: ignore[arg-type]


def test_only_values_are_believed():
    lab = Lab()
    with raises("p(X) has a variable"):
        lab.engine.believe(p(X))
    with raises("has a variable"):
        lab.engine.believe(mood(X + 1))


def test_only_goals_with_values_are_adopted():
    lab = Lab(go(1) >> [do("one")])
    with raises("go(X)"):
        lab.engine.achieve(go(X))


def test_only_beliefs_that_can_be_kept_are_believed():
    with raises("p([1, 2])"):
        Lab().engine.believe(p([1, 2]))
