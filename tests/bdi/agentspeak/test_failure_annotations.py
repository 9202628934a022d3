"""A failure plan learns what failed, why and where."""

from __future__ import annotations

from tests.bdi.mas import said

HANDLER = '-!go[error(E), code(C), code_src(S), code_line(L)] <- .print(E, " ", C, " ", S, " ", L).'


def test_of_a_failed_step():
    assert said(f"!go.\n+!go <-\n  true;\n  .fail.\n{HANDLER}") == ["ia_failed .fail file:me.asl 4"]


def test_of_a_goal_without_plans():
    assert said(f"!go.\n+!go\n  <- true;\n  !none(1).\n{HANDLER}") == [
        "no_relevant none(1)[source(self)] file:me.asl 4"
    ]


def test_of_a_step_far_below():
    assert said(f"!go.\n+!go <- !a.\n+!a <- !b;\n  .print(no).\n+!b <- true;\n  ?c(1).\n{HANDLER}") == [
        "test_goal_failed c(1) file:me.asl 6"
    ]


def test_a_failure_without_a_message_has_an_empty_one():
    assert said('!go. +!go <- .fail. -!go[error_msg(M)] <- .print("<", M, ">").') == ["<>"]
    assert said('!go. +!go <- .fail(error_msg(no)). -!go[error_msg(M)] <- .print("<", M, ">").') == ["<no>"]


def test_the_failed_step_is_a_term_with_its_values():
    handler = "-!go[code(C)] <- if (C = p(X)) { .print(X) } else { .print(C) }."
    assert said(f"!go. +!go <- X = 3; ?p(X). {handler}") == ["3"]
    assert said(f"!go. +!go <- X = 3; X > 4. {handler}") == ["(3 > 4)"]
    assert said(f"!go. +!go <- X = 3; act(X, f(X)). {handler}") == ["act(3,f(3))"]
    assert said(f"!go. +!go <- X = 3; .wait({{+b(X)}}, 10). {handler}") == [".wait({ +b(3) },10)"]
    assert said(f"!go. +!go <- if (true) {{ !p(7) }}. +!p(X) : no. {handler}") == ["7"]


def test_a_failed_plan_gives_no_values():
    plans = "+!h(X, f(Y)) <- X = 5; !m(Y); .fail. +!m(4)."
    handler = "-!h(X, f(Y)) <- if (.ground(X)) { .print(known) } else { X = 6; Y = 7 }."
    assert said(f"!go. +!go <- !h(X, f(Y)); .print(X, Y). {plans} {handler}") == ["67"]
