"""A condition in parentheses is a term."""

from __future__ import annotations

import pytest

from tests.bdi.mas import said


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
