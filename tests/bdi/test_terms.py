"""Terms, and how they unify at run time."""

import operator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Atom, Engine, Variable, source
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Comparison, Cons, conjunction, order, show, variables
from socialbot.bdi.unification import Var, closed, cons, free, resolve, undo, unify
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import X, Y, _

VALUES = st.sampled_from((0, 1, "a", Atom("a"), None))
SHAPES = st.recursive(
    VALUES | st.sampled_from("XYZ").map(lambda name: ("var", name)),
    lambda inner: st.one_of(
        st.tuples(st.just("list"), st.lists(inner, max_size=2)),
        st.tuples(st.just("cons"), st.lists(inner, min_size=1, max_size=2), st.sampled_from("XYZ")),
        st.tuples(st.just("literal"), st.sampled_from("fg"), st.lists(inner, max_size=2)),
    ),
    max_leaves=6,
)


def made(shape, cells):
    """The term of a shape; ``cells`` are its variables by name."""
    if not isinstance(shape, tuple):
        return shape
    kind, *parts = shape
    if kind == "var":
        return cells.setdefault(parts[0], Var(parts[0]))
    if kind == "literal":
        return literal(parts[0], tuple(made(part, cells) for part in parts[1]))
    items = tuple(made(part, cells) for part in parts[0])
    return items if kind == "list" else Cons(items, cells.setdefault(parts[1], Var(parts[1])))


def names(shape):
    if not isinstance(shape, tuple):
        return set()
    if shape[0] == "var":
        return {shape[1]}
    found = set().union(*map(names, shape[2] if shape[0] == "literal" else shape[1]))
    return found | {shape[2]} if shape[0] == "cons" else found


def apart(left, right):
    """Whether no variable is in both, so that no term is put into itself. Lists end in lists."""
    return not names(left) & names(right) and _once(left) and _once(right)


def _once(shape):
    """Whether no variable comes twice."""
    seen = []

    def walk(part):
        if isinstance(part, tuple):
            if part[0] == "var":
                seen.append(part[1])
            elif part[0] == "cons":
                seen.append(part[2])
            for item in part[2] if part[0] == "literal" else part[1] if part[0] != "var" else ():
                walk(item)

    walk(shape)
    return len(seen) == len(set(seen))


@settings(deadline=None, max_examples=300)
@given(SHAPES, SHAPES)
def test_unification_is_symmetric(left, right):
    if not apart(left, right):
        return
    here, there = {}, {}
    one, other = made(left, here), made(right, here)
    assert unify(one, other, []) == unify(made(right, there), made(left, there), [])


@settings(deadline=None, max_examples=300)
@given(SHAPES, SHAPES)
def test_unified_terms_are_equal_and_unify_again_without_a_binding(left, right):
    cells, trail = {}, []
    one, other = made(left, cells), made(right, cells)
    if apart(left, right) and unify(one, other, trail):
        bound = len(trail)
        assert show(resolve(one)) == show(resolve(other))
        assert unify(one, other, trail)
        assert len(trail) == bound


@settings(deadline=None, max_examples=300)
@given(SHAPES, SHAPES)
def test_undo_takes_back_whatever_was_bound(left, right):
    if not apart(left, right):
        return
    cells, trail = {}, []
    one, other = made(left, cells), made(right, cells)
    before = show(one), show(other)
    unify(one, other, trail)
    undo(trail, 0)
    assert trail == []
    assert (show(one), show(other)) == before
    assert all(cell.value is cell for cell in cells.values())


@settings(deadline=None)
@given(SHAPES, st.fixed_dictionaries(dict.fromkeys("XYZ", st.lists(VALUES, max_size=2).map(tuple))))
def test_a_term_unifies_with_its_own_instance(shape, values):
    cells = {}
    term = made(shape, cells)
    instance = resolve(made(shape, {name: filled(value) for name, value in values.items()}))
    assert closed(instance)
    assert unify(term, instance, [])
    assert {name: resolve(cell) for name, cell in cells.items()} == {name: values[name] for name in names(shape)}
    assert resolve(term) == instance
    free(term)
    assert all(cell.value is cell for cell in cells.values())


def filled(value):
    cell = Var()
    cell.value = value
    return cell


@given(st.lists(VALUES, max_size=4).map(tuple), st.lists(VALUES, max_size=4).map(tuple))
def test_a_list_is_its_items_before_its_tail(items, tail):
    assert cons(items, tail) == items + tail
    rest = Var()
    assert unify(Cons(items, rest), items + tail, [])
    assert resolve(rest) == tail
    with pytest.raises(TypeError, match="not a list"):
        cons(items, 3)


def test_different_numbers_of_arguments_never_unify():
    assert not unify((Var(),), (), [])
    assert not unify((), (1,), [])
    assert unify((), (), [])


def test_a_repeated_variable_stands_for_one_value():
    cell = Var()
    assert unify((cell, cell), (1, 1), [])
    assert not unify((Var(), cell), (1, 2), [])
    again = Var()
    assert not unify((again, again), (1, 2), [])


def test_annotations_have_to_be_among_those_of_the_other_literal():
    plain, noted = literal("f", (1,)), literal("f", (1,), (Atom("n"),))
    assert unify(plain, noted, [])
    assert not unify(noted, plain, [])


def solved(condition):
    return list(Engine("terms", ManualClock()).query(condition))


def value_of(term, **values):
    """The value of a term, as a plan computes it."""
    given_values = [Comparison("=", Variable(name), value) for name, value in values.items()]
    (found,) = solved(conjunction(*given_values, Comparison("=", Variable("Result"), term)))
    return found["Result"]


@pytest.mark.parametrize("symbol", ["+", "-", "*", "/"])
@settings(deadline=None, max_examples=20)
@given(st.integers(-9, 9), st.integers(1, 9))
def test_arithmetic_on_variables_is_that_of_python(symbol, left, right):
    apply = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}[symbol]
    assert value_of(apply(X, Y), X=left, Y=right) == apply(left, right)
    assert value_of(apply(X, right), X=left) == apply(left, right)
    assert str(apply(X, Y)) == f"X {symbol} Y"


@pytest.mark.parametrize("symbol", ["+", "-", "*", "/"])
def test_a_number_may_stand_on_the_left(symbol):
    apply = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}[symbol]
    assert value_of(apply(8, X), X=2) == apply(8, 2)


@pytest.mark.parametrize("name", ["gt", "ge", "lt", "le", "eq", "ne"])
@settings(deadline=None, max_examples=20)
@given(st.integers(-2, 2), st.integers(-2, 2))
def test_comparisons_of_variables_are_those_of_python(name, left, right):
    compare = getattr(operator, name)
    values = conjunction(Comparison("=", X, left), Comparison("=", Y, right))
    assert bool(solved(values & compare(X, Y))) == compare(left, right)
    assert bool(solved(values & compare(left, Y))) == compare(left, right)


@pytest.mark.parametrize("name", ["gt", "ge", "lt", "le"])
@pytest.mark.parametrize(
    "other", [literal("p", (2,)), literal("p", (1,)), literal("p", (3,)), literal("q"), Atom("p"), "p", 4], ids=show
)
def test_comparisons_of_a_literal_are_those_of_the_order_of_terms(name, other):
    compare, one = getattr(operator, name), literal("p", (2,))
    assert compare(one, other) == compare(order(one), order(other))


def test_a_comparison_keeps_its_text():
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
    with pytest.raises(RuleError, match="is not a variable name"):
        Variable("3 D")


def test_terms_know_their_variables():
    assert (X + Y * 2).names() == {"X", "Y"}
    assert (X > Y + 1).names() == {"X", "Y"}
    assert _.names() == {"_"}


def test_strings_are_shown_in_quotes():
    assert show('say "a\\b"') == r'"say \"a\\b\""'
    assert show(3) == "3"


def test_resolved_term_has_no_bound_variables():
    who, trail = Var("Who"), []
    pattern = (source(who), (literal("at", (who, 1)),))
    assert unify(who, Atom("bob"), trail)
    assert resolve(pattern) == (source(Atom("bob")), (literal("at", (Atom("bob"), 1)),))


def test_resolving_keeps_a_term_without_bound_variables():
    term = (1, (source(Atom("bob")),), literal("at", (Var("X"),)))
    assert resolve(term) is term
