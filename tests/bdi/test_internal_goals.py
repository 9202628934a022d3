"""Internal actions on goals and intentions."""

from __future__ import annotations

import pytest

from tests.bdi.mas import Mas, said

PRINTED = {
    "dropping an intention ends its subgoals, too": ("""!work. !stop.
    +!work <- !inner; .print(never).
    +!inner <- .wait(100); .print(never).
    -!work <- .print(never).
    +!stop <- .wait(50); .drop_intention(work); .print(done).""", ["done"]),
    "a subgoal drops its own intention":
        ("!g. +!g <- !h; .print(never). +!h <- .drop_intention(g); .print(never).", []),
    "nothing to drop is no failure":
        ("!g. +!g <- .drop_intention(x); .drop_desire(y(_)); .succeed_goal(z); .fail_goal(z); .print(ok).", ["ok"]),
    "dropping all intentions keeps the current one and cancels scheduled events": ("""!a. !b.
    +!a <- .at("now +1 s", {+!c}); .wait(100); .print(never).
    +!b <- .wait(10); .drop_all_intentions; .print(b).
    +!c <- .print(never).""", ["b"]),
    "dropping all desires forgets events": (
        "!g. @g[atomic] +!g <- ++b; !!h; .drop_all_desires; .print(ok). +b <- .print(never). +!h <- .print(never).",
        ["ok"],
    ),
    "a goal that succeeds from within is achieved":
        ("!top. +!top <- !g; .print(on). +!g <- !h; .print(never). +!h <- .succeed_goal(g); .print(never).", ["on"]),
    "the failure plan of a goal runs when another intention fails the goal": ("""!top. !end.
    +!top <- !g; .print(on).
    +!g <- .wait(1000); .print(never).
    -!g[error(E)] <- .print(E).
    +!end <- .wait(10); .fail_goal(g).""", ["cancelled", "on"]),
    "the failure plan of the parent goal runs when a goal fails itself":
        ("!top. +!top <- !g; .print(never). -!top <- .print(failed). +!g <- .fail_goal(g); .print(never).", ["failed"]),
    "failing a goal of a fork from a branch": ("""!g.
    +!g <- { .fail_goal(g); .print(never) } |&| { .wait(5); .print(never) }; .print(never).
    -!g <- .print(failed).""", ["failed"]),
    "a suspended intention continues when it is resumed": ("""!work. !boss.
    +!work <- !steps(0).
    +!steps(3).
    +!steps(N) <- .print(N); .wait(100); !steps(N + 1).
    +!boss <- .wait(50); .suspend(work); .wait(1000); .print(go); .resume(work).""", ["0", "go", "1", "2"]),
    "a wait may end while the intention is suspended": (
        "!g. !h. +!g <- .wait(20); .print(b). +!h <- .wait(10); .suspend(g); .wait(100); .print(h); .resume(g).",
        ["h", "b"],
    ),
    "branches are suspended with their intention": ("""!g. !h.
    +!g <- { .wait(20); .print(a) } |&| { .wait(30); .print(b) }; .print(c).
    +!h <- .wait(10); .suspend(g); .wait(100); .print(h); .resume(g).""", ["h", "a", "b", "c"]),
    "intended, desired and suspended goals can be queried": ("""!g(1). !ask.
    +!g(X) <- .wait(100).
    +!ask <-
        .wait(10);
        .findall(X, .intend(g(X)), A); .findall(X, .desire(g(X)), B);
        .suspend(g(_));
        .findall(X, .intend(g(X)), C); .findall(X, .desire(g(X)), D);
        .suspended(g(Y), Why); .print(A, B, C, D, Y, Why);
        if (not .desire(other)) { .print(no) }; .resume(g(_)).""", ["[1][1][][1]1wait(1)[time(100)]", "no"]),
    "the current intention lists its goals": (
        "!g. +!g <- !h(1); .print(x). +!h(X) <- .current_intention(intention(N, [im(_,{+!G},_,_)|_])); .print(N, G).",
        ["1h(1)[source(self)]", "x"],
    ),
    "a goal that continues as the goal of its last step is still pursued": (
        "!g. !end. +!g <- !h. +!h <- .wait(100); .print(never). +!end <- .wait(1); .drop_intention(g); .print(end).",
        ["end"],
    ),
    "dropping from a branch ends all branches": ("""!g.
    +!g <- { .wait(10); .drop_intention(g); .print(never) } |&| { .wait(20); .print(never) }; .print(never).""", []),
    "a branch drops its whole intention":
        ("!g. +!g <- { .drop_intention; .print(never) } |&| { .wait(20); .print(never) }; .print(never).", []),
    "only intentions with a matching goal are dropped": ("""!a(1). !a(2). !stop.
    +!a(X) <- .wait(10); .print(X).
    +!stop <- .drop_intention(a(1)).""", ["2"]),
    "a goal that fails without a plan ends the intention":
        ("!top. +!top <- !g; .print(never). +!g <- .fail_goal(g); .print(never).", []),
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_prints_and_leaves_no_intention(name):
    text, lines = PRINTED[name]
    mas = Mas(me=text).until(60)
    assert mas.lines == lines
    assert not mas.me.intentions


def test_an_intention_that_drops_itself_ends():
    text = "!g. +!g <- .print(one); .drop_intention(g); .print(two). -!g <- .print(three)."
    assert said(text) == ["one"]
    assert said(text.replace(".drop_intention(g)", ".drop_intention")) == ["one"]


def test_dropping_a_desire_removes_pending_goals():
    text = """!g.
    @g[atomic] +!g <- !!h(1); !!h(2); .drop_event(h(1)); .print(ok).
    @i[atomic] +!i <- !!h(1); !!h(2); .drop_desire(h(_)); .print(none).
    +!h(X) <- .print(X)."""
    assert said(text) == ["ok", "2"]
    assert said(text.replace("!g.", "!i.", 1)) == ["none"]


@pytest.mark.parametrize("start", ["!other", "!g"])
def test_a_goal_that_another_intention_achieves_lets_its_caller_continue(start):
    text = f"""{start}. !end.
    +!other <- !g; .print(on).
    +!g <- !h; .print(never).
    +!h <- .wait(1000); .print(never).
    +!end <- .wait(10); .succeed_goal(g); .print(end)."""
    assert sorted(said(text)) == (["end", "on"] if start == "!other" else ["end"])


def test_a_pending_goal_can_fail_and_succeed():
    text = """!g.
    @g[atomic] +!g <- !!h(1); !!h(2); .fail_goal(h(1)); .succeed_goal(h(2)); .print(ok).
    +!h(X) <- .print(never). -!h(X) <- .print(failed, X)."""
    assert said(text) == ["ok", "failed1"] or said(text) == ["failed1", "ok"]


def test_an_intention_suspends_itself():
    text = "!g. !h. +!g <- .print(a); .suspend; .print(b). +!h <- .wait(10); .print(h); .resume(g)."
    assert said(text) == ["a", "h", "b"]
    assert said(text.replace(".suspend", ".suspend(g)")) == ["a", "h", "b"]


def test_the_goals_that_a_plan_serves_are_intended():
    text = "!g. +!g <- !h(1); .print(x). +!h(X) : .intend(g) <- .print(in); if (.intend(h(1))) { .print(yes) }."
    assert said(text) == ["in", "yes", "x"]
    assert said("!g. +!g <- .intend(g); .print(yes).") == ["yes"]
