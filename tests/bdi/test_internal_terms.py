"""Internal actions on lists, strings and other terms."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bdi import Atom, Engine
from socialbot.bdi.agentspeak import parse_term
from socialbot.bdi.agentspeak._spelling import said, spelled
from socialbot.bdi.literals import literal
from socialbot.bdi.stdlib import internals
from socialbot.bdi.stdlib.registry import detached, opened
from socialbot.bdi.terms import Cons, Variable, order
from socialbot.bdi.unification import Var, resolve
from socialbot.core.clock import ManualClock
from tests.bdi.mas import Mas, does

# What the plan prints. "failed E" says why it failed.
CASES = {
    # lists
    ".member(X, [a, b]); .print(X)": ["a"],
    "for (.member(X, [a, b, a])) { .print(X) }": ["a", "b", "a"],
    "for (.member(f(X, 1), [f(a, 1), f(b, 2), g, f(c, 1)])) { .print(X) }": ["a", "c"],
    ".member(c, [a, b])": ["failed ia_failed"],
    ".member(a, b)": ["failed wrong_arguments"],
    ".length([a, b], N); .print(N)": ["2"],
    '.length("abc", N); .print(N)': ["3"],
    ".length(7, N)": ["failed ia_failed"],
    "X = .length([a]); .print(X)": ["1"],
    ".nth(0, [a, b], X); .print(X)": ["a"],
    ".nth(2.0, [a, b, c], X); .print(X)": ["c"],
    ".nth(2, [a, b], X)": ["failed wrong_arguments"],
    "for (.nth(I, [a, b], X)) { .print(I, X) }": ["0a", "1b"],
    ".sort([c, 2, \"b\", [1], a, f(1), 1.5, b], L); .print(L)": ['[1.5,2,"b",[1],a,b,c,f(1)]'],
    ".reverse([a, b, c], L); .print(L)": ["[c,b,a]"],
    '.reverse("abc", L); .print(L)': ["cba"],
    ".concat([a], [b, c], [], L); .print(L)": ["[a,b,c]"],
    '.concat("a", b, 1, f("x"), S); .print(S)': ['ab1f("x")'],
    '.concat("a", X, S)': ["failed wrong_arguments"],
    ".max([2, 10, 3], M); .min([2, 10, 3], N); .print(M, N)": ["102"],
    ".max([], M)": ["failed ia_failed"],
    ".delete(a, [a, b, a], L); .print(L)": ["[b]"],
    ".delete(1, [a, b, c], L); .print(L)": ["[a,c]"],
    ".union([b, a], [c, a], L); .intersection([b, a], [c, a], M); .difference([b, a], [c, a], N); .print(L, M, N)":
        ["[a,b,c][a][b]"],
    ".findall(P, .prefix(P, [a, b]), L); .print(L)": ["[[a,b],[a],[]]"],
    ".findall(P, .suffix(P, [a, b]), L); .print(L)": ["[[a,b],[b],[]]"],
    ".findall(P, .sublist(P, [a, b, c]), L); .print(L)": ["[[a,b,c],[a,b],[a],[b,c],[b],[c],[]]"],
    ".empty([]); .empty(\"\"); .print(yes); .empty([a])": ["yes", "failed ia_failed"],
    ".shuffle([1, 2, 3], L); .sort(L, M); .print(M)": ["[1,2,3]"],
    # strings
    '.findall(P, .substring("a", "abbacca", P), L); .print(L)': ["[0,3,6]"],
    '.substring("a", "bbacc", 0)': ["failed ia_failed"],
    '.substring("ca", "abbacca", B, E); .print(B, " ", E)': ["5 6"],
    ".substring(a(10), b(t1, a(10)), P); .print(P)": ["5"],
    '.substring(a(10), b("t1,a(10)"), P); .print(P)': ["6"],
    '.substring("x", "abc")': ["failed ia_failed"],
    '.lower_case("AbC", S); .upper_case(S, T); .print(S, T)': ["abcABC"],
    '.term2string(f(X, "a", [1]), S); .print(S)': ['f(X,"a",[1])'],
    '.term2string(T, "f(Y, [1, b], \'Z\')"); T = f(a, [_, B], _); .print(B)': ["b"],
    '.term2string(T, "f("); .concat(T, "", S); .print(S)': ["f("],
    # numbers
    "for (.range(I, 1, 3)) { .print(I) }": ["1", "2", "3"],
    "for (.range(I, 5, 0, -2)) { .print(I) }": ["5", "3", "1"],
    ".range(2, 1, 3); .print(yes); .range(4, 1, 3)": ["yes", "failed ia_failed"],
    ".range(I, 2, 1)": ["failed ia_failed"],
    ".random(X); if (X >= 0 & X < 1) { .print(yes) }": ["yes"],
    ".count(.random(X, 5), N); .print(N)": ["5"],
    ".random([a], X); .print(X)": ["a"],
    ".random([], X)": ["failed ia_failed"],
    "X = math.max([3, 1]) + math.max(2, 1) + math.sum([1, 2]); .print(X)": ["8"],
    "X = math.average([1, 2, 3]); Y = math.std_dev([1, 2, 3]); .print(X, Y)": ["21"],
    'X = math.sqrt(-1)': ["failed wrong_arguments"],
    # kinds
    "if (.var(X)) { .print(var) }": ["var"],
    "X = f(Y); if (.var(X) | .ground(X)) { .print(no) } else { .print(open) }": ["open"],
    "for (.member(T, [1, a, \"s\", f(1), [], ~a])) { .findall(K, "
    "(.number(T) & K = n | .atom(T) & K = a | .string(T) & K = s | .list(T) & K = l | .literal(T) & K = t | "
    ".structure(T) & K = u), L); .print(L) }": ["[n]", "[a,t]", "[s]", "[t,u]", "[l,u]", "[t,u]"],
    # what fails
    ".fail": ["failed ia_failed"],
}  # fmt: skip


@pytest.mark.parametrize("body", CASES)
def test_a_body_prints(body):
    assert does(body) == CASES[body]


def test_failing_with_a_reason_and_more():
    text = """!go.
    +!go <- .fail(error(tired), error_msg("I slept badly"), since(3)).
    -!go[error(E), error_msg(M), since(S)] <- .print(E, ": ", M, ", ", S)."""
    assert Mas(me=text).until(1).lines == ["tired: I slept badly, 3"]


def test_printing_spells_terms_as_jason_does():
    body = """.print("x", 'Y z', " ", [a, "b", 'Y z', 2.0, 2.5, f(1, X)[s, b(2)], ~g], X, 4/2, "")"""
    assert does(body) == ["""x'Y z' [a,"b",'Y z',2,2.5,f(1,X)[b(2),s],~g]X<no-value>2"""]


def test_printing_a_plan_and_an_event():
    assert does(".print({+!g(X)}, {+b : c <- d})") == ["{ +!g(X) }{ +b : c <- d }"]


@pytest.mark.parametrize(
    ("term", "text"),
    [
        (True, "true"),
        (None, "none"),
        (1e20, "1.0E20"),
        (1.5e-5, "1.5E-5"),
        (1e7 + 0.5, "1.00000005E7"),
        (float("inf"), "Infinity"),
        (Cons((1,), Var("T")), "[1|T]"),
        (literal("f", (), (Atom("x"),)), "f[x]"),
    ],
)
def test_terms_of_python_are_spelled_too(term, text):
    assert spelled(term) == text


# Against Python

TERMS = st.recursive(
    st.integers(-3, 3) | st.sampled_from((0.5, "a", "b", Atom("a"), Atom("b"))),
    lambda inner: (
        st.lists(inner, max_size=3).map(tuple)
        | st.builds(lambda args: literal("f", tuple(args)), st.lists(inner, min_size=1, max_size=2))
    ),
    max_leaves=5,
)
LISTS = st.lists(TERMS, max_size=6).map(tuple)
ENGINE = Engine("tester", ManualClock())


def outcome(name, *args):
    """The values that an internal action gives to the variables among its arguments, for each solution."""
    cells = tuple(Var() if arg is None else arg for arg in args)
    result = internals()[name].function(ENGINE, cells, [])
    if isinstance(result, bool):
        result = [None] if result else []
    return [tuple(resolve(cell) for cell, arg in zip(cells, args, strict=True) if arg is None) for _ in result]


@given(LISTS)
def test_sorting_keeps_the_items_and_is_in_order(items):
    ((found,),) = outcome(".sort", items, None)
    assert sorted(map(spelled, found)) == sorted(map(spelled, items))
    assert all(order(one) <= order(other) for one, other in pairwise(found))


@given(st.lists(st.integers()))
def test_numbers_are_sorted_as_python_does(numbers):
    assert outcome(".sort", tuple(numbers), None) == [(tuple(sorted(numbers)),)]


@given(st.lists(LISTS, min_size=1, max_size=4))
def test_lists_are_joined_as_python_does(parts):
    assert outcome(".concat", *parts, None) == [(sum(parts, ()),)]


@given(LISTS)
def test_every_item_is_a_member_in_its_order_and_at_its_position(items):
    assert outcome(".member", None, items) == [(item,) for item in items]
    assert outcome(".nth", None, items, None) == list(enumerate(items))
    for position, item in enumerate(items):
        assert outcome(".nth", position, items, None) == [(item,)]


@given(TERMS, LISTS)
def test_a_term_is_a_member_as_often_as_it_is_in_the_list(term, items):
    assert len(outcome(".member", term, items)) == items.count(term)


@given(TERMS)
def test_printed_terms_are_parsed_to_equal_terms(term):
    assert opened(parse_term(spelled(term))) == term


def test_a_detached_term_shares_no_variables():
    x = Var("X")
    twin = detached(literal("f", (x, (x, 1), Cons((x,), Var("T")))))
    assert twin.args[0] is not x
    assert twin.args[1][0] is twin.args[0]
    assert twin.args[2].items[0] is twin.args[0]


def test_a_term_is_opened_with_one_variable_for_each_name():
    term = opened((Variable("X"), Variable("X"), Variable("_"), Variable("_")))
    assert term[0] is term[1]
    assert term[2] is not term[3]


def test_only_a_string_is_printed_without_quotes():
    assert said("a b") == "a b"
    assert said(Atom("a b")) == "'a b'"


def test_all_beliefs_of_a_pattern_are_found_with_and_without_a_lookup():
    program = """
    p(1, a). p(2, b). p(3, a). p(4, 4). d(5) :- p(4, _). d(6).
    !g(a).
    +!g(K) <- .count(p(_, _), All); .count(p(_, K), Known); .count(p(3, a), One); .count(p(3, b), None);
        .count(p(X, X), Same); .count(d(_), Derived); .print(All, " ", Known, One, None, Same, Derived);
        .findall(X, p(X, _), L1); .findall(X, p(X, K), L2); .findall(X, p(X, X), L3); .findall(X, d(X), L4);
        .findall(K, p(_, K), L5); .findall(f(X), p(X, K), L6); .print(L1, L2, L3, L4, L5, L6);
        .setof(Y, p(_, Y), S); .findall(Z, nothing(Z), L7); .count(nothing(_), N7); .print(S, L7, N7).
    """
    assert Mas(me=program).until(1).lines == [
        "4 21012",
        "[1,2,3,4][1,3][4][6,5][a,a][f(1),f(3)]",
        "[4,a,b][]0",
    ]


@pytest.mark.parametrize(
    ("pattern", "text", "what"),
    [
        ("(a+)+b", "a" * 40, "for ever"),
        ("(a|aa)*b", "a" * 60, "for ever"),
        ("(a?b?)*c", "a" * 60, "for ever"),
        ("(a?){30}a{30}", "a" * 30, "for ever"),
        ("a?" * 30 + "a" * 30, "a" * 30, "for ever"),
        ("(?=(a+)+b)", "a" * 40, "for ever"),
        ("a*a*b", "a" * 5000, "more than 2000 characters"),
        (".*.*.*x", "a" * 1000, "more than 500 characters"),
        ("a{2," + "3" * 5000 + "}", "a", "not a regular expression"),
    ],
)
@pytest.mark.parametrize("action", [".replace(T, P, X, R)", ".delete(P, T, R)"])
def test_a_regular_expression_that_takes_for_ever_is_refused(action, pattern, text, what):
    body = f'P = "{pattern}"; T = "{text}"; X = ""; {action}'
    lines = Mas(me=f"!go. +!go <- {body}. -!go[error_msg(M)] <- .print(M).").until(60).lines
    assert [what in line for line in lines] == [True], lines


@pytest.mark.parametrize(
    ("pattern", "text"),
    [("a*b*c", "ab" * 900), (".*x", "a" * 10_000), ("[a-z]+ [0-9]+ ?(am|pm)", "a" * 2000), ("(ab)+c", "ab" * 5000)],
)
def test_the_slowest_allowed_expressions_end_soon(pattern, text):
    begun = time.process_time()
    assert does(f'T = "{text}"; .replace(T, "{pattern}", "", R); .length(R, N); .print(N)') == [str(len(text))]
    assert time.process_time() - begun < 5
