"""Variables for literals, conditions, steps, plans and rules. Jason 3.3 gives the same results."""

from __future__ import annotations

import pytest

from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from tests.bdi.mas import said

CASES = {
    "an internal action with a condition in a context": (
        "b(1). b(2). c(2). !go. +!go : .count(b(X) & c(X), N) & .findall(X, b(X) & X > 1, L) <- .print(N, L).",
        ["1[2]"],
    ),
    "a variable as a condition": (
        "p(1). !go. +!go <- !is(p(_)); !is(q). +!is(C) : C <- .print(yes, C). +!is(C) <- .print(no, C).",
        ["yesp(1)", "noq"],
    ),
    "an internal action as the value of a condition": (
        "!go. +!go <- !is(.member(a, [a])); !is(true); !is(false). +!is(C) : C <- .print(yes). +!is(_) <- .print(no).",
        ["yes", "yes", "no"],
    ),
    "head and tail of a list that a rule finds": (
        "p([X]) :- q(X). p([X, Y | T]) :- on(X, Y) & p([Y | T]). on(a, b). on(b, c). q(c). "
        "!go. +!go : p([H | T]) <- .print(H, T); for (p([A | B])) { .print(A, B) }; ?p([a | R]); .print(R).",
        ["c[]", "c[]", "a[b,c]", "b[c]", "[b,c]"],
    ),
    "annotations of a literal that a rule finds": (
        "lit(p(1)[a, b]). lit(q(2)[c]). has(L) :- lit(L). "
        "!go. +!go <- ?has(p(X)[A | T]); .print(X, A, T); for (has(Z[|R])) { .print(Z, R) }.",
        ["1a[b]", "p(1)[a,b]", "q(2)[c]"],
    ),
    "parts of a list in a structure that a rule finds": (
        "p(f([X | T]), T) :- .member([X | T], [[1], [2, 3]]). "
        "!go. +!go : p(f([H, K | T]), S) <- .print(H, K, T, S).",
        ["23[][3]"],
    ),
    "a negated variable as a condition": (
        "!go. +!go <- !is(p). +!is(C) : not C <- .print(no).", ["no"],
    ),
    "a variable as an action": (
        '!go. +!go <- !do(.print("x")); !do({+b(1)}); ?b(X); .print(X). +!do(A) <- A.',
        ["x", "1"],
    ),
    "steps as a term": ("!go. +!go <- !do({ .print(a); .print(b) }); .print(c). +!do(A) <- A.", ["a", "b", "c"]),
    "steps with values of the plan around them": (
        "!go. +!go <- X = 3; !do({ Y = X + 1; .print(Y) }). +!do(A) <- A.", ["4"],
    ),
    "label, event, condition and body of a plan": (
        "!go. @a[k] +!g(1) : q <- b. "
        "+!go <- .relevant_plans({+!g(_)}, [P]); P =.. [L|_]; L =.. [F, _, N]; .member(k, N); P =.. [E, C, B]; "
        ".print(F, C, B); P =.. [_, {+!g(1)}, _, _]; .print(E).",
        ["aqb", "{ +!g(1) }"],
    ),
    "a plan without condition and body": (
        "!go. +!g. +!go <- .relevant_plans({+!g}, [P]); P =.. [_, _, C, {}]; if (C) { .print(yes) }.", ["yes"],
    ),
    "steps of a plan, one by one, share its variables": (
        "b(10). !go. +!g <- ?b(X); Y = X + 1; .print(X, Y). +!run({}). +!run({H; R}) <- H; !run(R). "
        "+!go <- .relevant_plans({+!g}, [P]); P =.. [_, _, _, B]; !run(B).",
        ["1011"],
    ),
    "a condition of a plan gives its body values": (
        "b(1). b(2). !go. +!g(Y) : b(Y) & Y > 1 <- .print(Y). "
        "+!go <- .relevant_plans({+!g(_)}, [P]); P =.. [_, _, C, B]; if (C) { B }.",
        ["2"],
    ),
    "parts of a plan can be taken again": (
        "b(1). !go. +!g : b(Y) <- .print(Y). "
        "+!go <- .relevant_plans({+!g}, [P]); for (.range(I, 1, 2)) { P =.. [_, _, C, B]; if (C) { B } }.",
        ["1", "1"],
    ),
    "a failure in steps of a term": (
        "!go. +!go <- !do({ .print(a); .fail }). +!do(A) <- A. -!do(_) <- .print(failed).", ["a", "failed"],
    ),
    "a variable as a belief": (
        "!go. +!go <- !add(p(1)); !add(p(2)); !del(p(1)); .findall(X, p(X), L); .print(L). "
        "+!add(B) <- +B. +!del(B) <- -B.",
        ["[2]"],
    ),
    "a variable with annotations as a belief": (
        "!go. +!go <- !add(p(1)); ?p(X)[cost(C)]; .print(X, C). +!add(B) <- +B[cost(5)].", ["15"],
    ),
    "a variable with annotations as a term": ("!go. +!go <- L = p(5); X = L[z]; .print(X).", ["p(5)[z]"]),
    "a variable that takes annotations from its value": (
        "!go. +!go <- !t(p(7)[k(3), j]). +!t(P[k(V)]) <- .print(P, V).", ["p(7)3"],
    ),
    "a variable without the annotations of its value": ("!go. +!go : p(7)[j] = P[k(_)]. +!go <- .print(no).", ["no"]),
    "a negated variable": (
        "!go. +!go <- !t(~w(3)); !t(w(4)). +!t(~X) <- .print(neg, X). +!t(X) <- .print(pos, X).",
        ["negw(3)", "posw(4)"],
    ),
    "a goal with annotations in a variable": (
        "!go. +!go <- !ask(g(1)). +!ask(G) <- !G[mode(fast)]. +!g(X)[mode(M)] <- .print(X, M).", ["1fast"],
    ),
    "a question in a variable": ("p(4). !go. +!go <- Q = p(X); ?Q; .print(Q, X).", ["p(4)4"]),
    "the rest of annotations": (
        "p(1)[a, b(2)]. !go. +!go <- ?p(1)[a|T]; .print(T); +q[c|T]; ?q[b(X)]; .print(X).",
        ["[b(2),source(self)]", "2"],
    ),
    "any belief as a trigger": (
        "!go. +!go <- +b(1); +c; -c. +B[source(self)] <- .print(add, B). -B <- .print(del).",
        ["addb(1)", "addc", "del"],
    ),
    "any goal as a trigger comes in the order of the text": (
        "!a(1). !b. +!a(X) : X > 1 <- .print(a). +!G[source(S)] : G \\== b <- .print(any, G). +!b <- .print(b).",
        ["anya(1)", "b"],
    ),
    "any goal as a trigger with its annotations": ("!a(1). +!G <- .print(G).", ["a(1)[source(self)]"]),
    "a failure of any goal": ("!a(1). +!a(_) <- .fail. -!G[error(E)] <- .print(G, E).", ["a(1)ia_failed"]),
    "a belief with variables": ("eq(X, X). !go. +!go : eq(3, Y) & not eq(1, 2) <- .print(Y).", ["3"]),
    "an unbound variable of a belief": ("r(X, Y). !go. +!go <- ?r(3, Q); .print(Q).", ["Q<no-value>"]),
    "an unbound variable through a rule": ("r(_). s(Y) :- r(Y). !go. +!go : s(Z) & Z = 4 <- .print(Z).", ["4"]),
    "lists by beliefs with variables": (
        "app([], L, L). app([H|T], L, [H|R]) :- app(T, L, R). !go. +!go : app([1, 2], [3], L) <- .print(L).",
        ["[1,2,3]"],
    ),
    "arithmetic in the head of a rule": ("f(X + 1, X) :- n(X). n(4). !go. +!go : f(Y, 4) <- .print(Y).", ["5"]),
    "a rule that is added and removed": (
        "n(4). !go. +!go <- +{h(X) :- n(X) & X > 3}; ?h(Y); .print(Y); -{h(X) :- n(X) & X > 3}; !h. "
        "+!h : h(_) <- .print(still). +!h <- .print(gone).",
        ["4", "gone"],
    ),
    "a plan that is added with a sign": (
        "!go. +!go <- +{+!new(N) <- .print(new, N)}; !new(5); -{+!new(N) <- .print(new, N)}; !new(6). "
        "-!new(N) <- .print(none, N).",
        ["new5", "none6"],
    ),
    "a plan with a value of the plan around it": ("!go. +!go <- X = 7; +{+!new <- .print(X)}; !new.", ["7"]),
    "a plan at the end": (
        "!go. +!go <- +>{+!new <- .print(last)}; +<{+!new <- .print(first)}; !new. +!new <- .print(old).", ["first"],
    ),
    "a belief at the end": ("b(1). !go. +!go <- +<b(2); +>b(3); .findall(X, b(X), L); .print(L).", ["[2,1,3]"]),
    "an octal escape": ('!go. +!go <- .print("\\101z").', ["Az"]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_value_that_is_a_literal_condition_or_step(case):
    text, expected = CASES[case]
    assert said(text) == expected


@pytest.mark.parametrize(("limit", "reason"), [("hard_deadline(20)", "deadline_reached"), ("within(0.02)", "timeout")])
def test_a_goal_fails_at_its_deadline(limit, reason):
    clock, lines = ManualClock(), []
    engine = Engine("me", clock)
    engine.out = lines.append
    engine.add_text(f"!go. +!go <- !slow[{limit}]; .print(on). +!slow <- .wait(1000). -!slow[error(E)] <- .print(E).")
    engine.run_until_idle()
    clock.advance(30_000_000)
    engine.run_until_idle()
    assert lines == [reason, "on"]


@pytest.mark.parametrize(
    ("step", "reason"),
    [("A", "no_value"), ("A[x]", "no_value"), ("B = 1; B", "wrong_arguments"), ("+A[x]", "wrong_arguments")],
)
def test_a_variable_without_a_proper_value_fails_its_step(step, reason):
    assert said(f"!go. +!go <- {step}; .print(on). -!go[error(E)] <- .print(E).") == [reason]


def test_a_plan_for_any_goal_is_removed_by_its_label():
    text = "!go. +!go <- .remove_plan(l); !h. @l +!G <- .print(any). -!h <- .print(none)."
    assert said(text) == ["none"]


def test_agents_with_a_shared_library_keep_their_plans_for_any_goal():
    from socialbot.bdi.agentspeak import parse
    from socialbot.bdi.agentspeak.loading import begin, library_of

    program = parse("!go. @l +!G[source(S)] <- .print(any, G); .add_plan({+!x}).")
    library, lines = library_of(program), []
    for name in ("a", "b"):
        engine = Engine(name, ManualClock(), library=library)
        engine.out = lines.append
        begin(engine, program)
        engine.run_until_idle()
    assert lines == ["anygo", "anygo"]


def test_a_belief_with_a_condition_shares_the_variables_of_its_parts():
    program = "v(5). b((v(X) & not X > 10))."
    assert said(program + "!g. +!g <- ?b((B & not C)); ?B; B = v(N); .print(N, C).") == ["5(5 > 10)"]
    assert said(program + "!g. +!g <- ?b(C); ?C; .print(yes).") == ["yes"]
    assert said(program + "!g. +!g <- ?b((not C)). -!g[error(E)] <- .print(E).") == ["test_goal_failed"]


def test_a_condition_that_does_not_hold_fails_its_test_goal():
    assert said('!g. +!g <- C = (1 > 2); ?C. -!g[error(E), error_msg(M)] <- .print(E, ": ", M).') == [
        "test_goal_failed: Failed to test '(1 > 2)'"
    ]
