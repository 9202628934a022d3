"""`==` compares terms with free variables, which are the same only as themselves."""

from __future__ import annotations

import pytest

from socialbot.bdi.agentspeak import AgentSpeakError
from tests.bdi.mas import said


@pytest.mark.parametrize(
    ("body", "printed"),
    [
        ("f(X) \\== 3; X = 2; .print(X)", "2"),
        ("X == 3; .print(no)", "constraint_failed"),
        ("!give(L); L == 2; .print(L)", "2"),
        ("!give(L); L \\== 3; Y = L + 1; .print(Y)", "3"),
        (".findall(X, .member(X, [1, 2]) & X \\== Z, L); .print(L)", "[1,2]"),
        ("if ([X, 1] == [X, 1] & [X] \\== [Y]) { .print(same) }", "same"),
    ],
)
def test_in_steps_and_conditions(body, printed):
    assert said(f"!go. +!give(2). +!go <- {body}. -!go[error(E)] <- .print(E).") == [printed]


def test_in_rules():
    text = "same(A, B) :- A == B. !go. +!go <- if (not same(X, Y) & same(X, X)) { .print(ok) }."
    assert said(text) == ["ok"]


def test_a_registered_function_takes_terms_with_free_variables():
    text = '{ register_function("my.cost", 2, "cost") } cost(S, G, 7). !go. +!go <- X = my.cost(1, [J]) + 1; .print(X).'
    assert said(text) == ["8"]


def test_a_rule_has_the_annotations_of_its_head():
    text = """p(1). s(X) :- p(X). s(X)[k(7)] :- p(X). !go.
    +!go <- .findall(K, s(_)[k(K)], L); .print(L); if (not s(1)[j]) { .print(none) }; .count(s(_)[source(self)], N);
      .print(N)."""
    assert said(text) == ["[7]", "none", "2"]


def test_an_annotation_of_a_rule_has_no_variables():
    with pytest.raises(AgentSpeakError, match="an annotation of s\\(X\\)\\[k\\(X\\)\\] has a variable"):
        said("s(X)[k(X)] :- p(X).")


@pytest.mark.parametrize(
    ("body", "printed"),
    [
        ("X = (a & b); .print(X)", "(a & b)"),
        ("X = (1 < 2); if (X) { .print(ok) }", "ok"),
        ("X = (not b(7)); if (X) { .print(ok) }", "ok"),
        ("X = (1 + 2) * 3; .print(X)", "9"),
        (".findall(not c(X), b(X), L); .print(L)", "[not (c(1))]"),
    ],
)
def test_condition_term(body, printed):
    assert said(f"b(1). !go. +!go <- {body}. -!go[error(E)] <- .print(E).") == [printed]
