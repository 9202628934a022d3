import math
import operator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi.terms import Term, Variable, evaluate, show, unify, variables
from socialbot.errors import RuleError
from tests.bdi.lab import X, Y, _

NAMES = ("X", "Y", "Z", "_")
VALUES = st.sampled_from((0, 1, 2, "a", "b", None))
PATTERNS = st.lists(st.sampled_from(NAMES).map(Variable) | VALUES, max_size=5).map(tuple)


def consistent(pattern, values, bindings):
    """Unification said plainly: the bindings, or None, by looking at all pairs at once."""
    found = dict(bindings)
    for part, value in zip(pattern, values, strict=True):
        name = part.name if isinstance(part, Variable) else None
        if name is None and part != value:
            return None
        if name not in (None, "_") and found.setdefault(name, value) != value:
            return None
    return found


@settings(deadline=None)
@given(PATTERNS, st.fixed_dictionaries(dict.fromkeys(NAMES, VALUES)))
def test_a_pattern_unifies_with_its_own_ground_instance(pattern, values):
    ground = tuple(evaluate(part, values) for part in pattern)
    named = {part.name for part in pattern if isinstance(part, Variable)} - {"_"}
    assert unify(pattern, ground, {}) == {name: values[name] for name in named}


@settings(deadline=None, max_examples=200)
@given(st.data(), PATTERNS, st.dictionaries(st.sampled_from(NAMES[:3]), VALUES))
def test_unify_finds_the_bindings_exactly_when_there_are_some(data, pattern, bindings):
    values = tuple(data.draw(st.lists(VALUES, min_size=len(pattern), max_size=len(pattern))))
    before = dict(bindings)
    assert unify(pattern, values, bindings) == consistent(pattern, values, bindings)
    assert bindings == before


def test_different_numbers_of_arguments_never_unify():
    assert unify((X,), (), {}) is None
    assert unify((), (1,), {}) is None
    assert unify((), (), {}) == {}


def test_a_repeated_variable_stands_for_one_value():
    assert unify((X, X), (1, 1), {}) == {"X": 1}
    assert unify((X, X), (1, 2), {}) is None
    assert unify((X, Y), (1, 2), {"X": 3}) is None


def test_underscore_matches_anything_and_binds_nothing():
    assert unify((_, _), (1, 2), {}) == {}


def test_an_expression_unifies_with_its_value():
    assert unify((X, X + 1), (1, 2), {}) == {"X": 1}
    assert unify((X, X + 1), (1, 3), {}) is None


def test_a_variable_stands_for_what_is_no_number_too():
    assert math.isnan((unify((X, X), (math.nan, math.nan), {}) or {})["X"])


@pytest.mark.parametrize("symbol", ["+", "-", "*", "/"])
@settings(deadline=None, max_examples=20)
@given(st.integers(-9, 9), st.integers(1, 9))
def test_arithmetic_on_variables_is_that_of_python(symbol, left, right):
    apply = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}[symbol]
    bindings = {"X": left, "Y": right}
    assert evaluate(apply(X, Y), bindings) == apply(left, right)
    assert evaluate(apply(X, right), bindings) == apply(left, right)
    assert str(apply(X, Y)) == f"X {symbol} Y"


@pytest.mark.parametrize("symbol", ["+", "-", "*", "/"])
def test_a_number_may_stand_on_the_left(symbol):
    apply = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}[symbol]
    assert evaluate(apply(8, X), {"X": 2}) == apply(8, 2)


@pytest.mark.parametrize("name", ["gt", "ge", "lt", "le", "eq", "ne"])
@settings(deadline=None, max_examples=20)
@given(st.integers(-2, 2), st.integers(-2, 2))
def test_comparisons_of_variables_are_those_of_python(name, left, right):
    compare = getattr(operator, name)
    bindings = {"X": left, "Y": right}
    assert compare(X, Y).holds(bindings) == compare(left, right)
    assert compare(left, Y).holds(bindings) == compare(left, right)


def test_a_comparison_is_written_as_it_is_read():
    assert str(X + 1 >= Y) == "X + 1 >= Y"
    assert str(X == "yes") == 'X == "yes"'


def test_an_expression_keeps_its_parentheses_in_writing():
    assert str((X + 1) * 2) == "(X + 1) * 2"
    assert str(X - (Y - 1)) == "X - (Y - 1)"


def test_a_comparison_has_no_truth_value_of_its_own():
    with pytest.raises(RuleError, match="parentheses"):
        bool(X > 1)
    with pytest.raises(RuleError, match="no truth value"):
        _chained = 1 < X < 3


def test_variables_have_the_names_of_variables():
    assert [str(variable) for variable in variables("X Speed _")] == ["X", "Speed", "_"]
    with pytest.raises(RuleError, match="no name for a variable"):
        Variable("3 D")


def test_terms_know_their_variables():
    assert (X + Y * 2).names() == {"X", "Y"}
    assert (X > Y + 1).names() == {"X", "Y"}
    assert _.names() == {"_"}


def test_strings_are_shown_in_quotes():
    assert show('say "a\\b"') == r'"say \"a\\b\""'
    assert show(3) == "3"


def test_a_term_of_ones_own_can_stand_in_arguments():
    class Twice(Term):
        def names(self):
            return {"X"}

        def value(self, bindings):
            return 2 * bindings["X"]

    assert unify((X, Twice()), (2, 4), {}) == {"X": 2}
