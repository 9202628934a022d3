"""Internal actions on goals and intentions."""

from __future__ import annotations

import pytest

from tests.bdi.mas import Mas, said


def test_dropping_an_intention_ends_it_and_what_it_does_below():
    text = """!work. !stop.
    +!work <- !inner; .print(never).
    +!inner <- .wait(100); .print(never).
    -!work <- .print(never).
    +!stop <- .wait(50); .drop_intention(work); .print(done)."""
    assert said(text) == ["done"]


def test_an_intention_that_drops_itself_does_nothing_more():
    text = "!g. +!g <- .print(one); .drop_intention(g); .print(two). -!g <- .print(three)."
    assert said(text) == ["one"]
    assert said(text.replace(".drop_intention(g)", ".drop_intention")) == ["one"]


def test_dropping_an_intention_from_a_goal_below():
    text = "!g. +!g <- !h; .print(never). +!h <- .drop_intention(g); .print(never)."
    assert said(text) == []


def test_dropping_from_a_branch_ends_all_branches():
    text = """!g.
    +!g <- { .wait(10); .drop_intention(g); .print(never) } |&| { .wait(20); .print(never) }; .print(never)."""
    mas = Mas(me=text).until(1)
    assert mas.lines == []
    assert not mas.me.intentions


def test_the_intention_at_hand_of_a_branch_is_the_whole():
    text = "!g. +!g <- { .drop_intention; .print(never) } |&| { .wait(20); .print(never) }; .print(never)."
    mas = Mas(me=text).until(1)
    assert mas.lines == []
    assert not mas.me.intentions


def test_only_intentions_whose_goal_fits_are_dropped():
    text = """!!g. !a(1). !a(2). !stop.
    +!a(X) <- .wait(10); .print(X).
    +!stop <- .drop_intention(a(1)).
    +!g."""
    assert said(text.replace("!!g. ", "")) == ["2"]


def test_nothing_to_drop_is_no_failure():
    assert said("!g. +!g <- .drop_intention(x); .drop_desire(y(_)); .succeed_goal(z); .fail_goal(z); .print(ok).") == [
        "ok"
    ]


def test_dropping_a_desire_takes_goals_back_that_wait_for_their_turn():
    text = """!g.
    @g[atomic] +!g <- !!h(1); !!h(2); .drop_event(h(1)); .print(ok).
    @i[atomic] +!i <- !!h(1); !!h(2); .drop_desire(h(_)); .print(none).
    +!h(X) <- .print(X)."""
    assert said(text) == ["ok", "2"]
    assert said(text.replace("!g.", "!i.", 1)) == ["none"]


def test_dropping_all_intentions_keeps_the_one_at_hand_and_cancels_appointments():
    text = """!a. !b.
    +!a <- .at("now +1 s", {+!c}); .wait(100); .print(never).
    +!b <- .wait(10); .drop_all_intentions; .print(b).
    +!c <- .print(never)."""
    assert said(text) == ["b"]


def test_dropping_all_desires_forgets_events():
    text = "!g. @g[atomic] +!g <- ++b; !!h; .drop_all_desires; .print(ok). +b <- .print(never). +!h <- .print(never)."
    assert said(text) == ["ok"]


@pytest.mark.parametrize("who", ["!other", "!g"])
def test_a_goal_that_succeeds_from_outside_is_achieved_and_its_caller_goes_on(who):
    text = f"""{who}. !end.
    +!other <- !g; .print(on).
    +!g <- !h; .print(never).
    +!h <- .wait(1000); .print(never).
    +!end <- .wait(10); .succeed_goal(g); .print(end)."""
    assert sorted(said(text)) == (["end", "on"] if who == "!other" else ["end"])


def test_a_goal_that_succeeds_from_within_is_achieved():
    text = "!top. +!top <- !g; .print(on). +!g <- !h; .print(never). +!h <- .succeed_goal(g); .print(never)."
    assert said(text) == ["on"]


def test_a_goal_that_fails_from_outside_has_its_plan_tried():
    text = """!top. !end.
    +!top <- !g; .print(on).
    +!g <- .wait(1000); .print(never).
    -!g[error(E)] <- .print(E).
    +!end <- .wait(10); .fail_goal(g)."""
    assert said(text) == ["cancelled", "on"]


def test_a_goal_that_fails_from_within_has_the_plan_of_the_outer_goal_tried():
    text = "!top. +!top <- !g; .print(never). -!top <- .print(failed). +!g <- .fail_goal(g); .print(never)."
    assert said(text) == ["failed"]


def test_a_goal_that_fails_without_a_plan_ends_the_intention():
    text = "!top. +!top <- !g; .print(never). +!g <- .fail_goal(g); .print(never)."
    mas = Mas(me=text).until(1)
    assert mas.lines == []
    assert not mas.me.intentions


def test_a_goal_that_waits_for_its_turn_can_fail_and_succeed():
    text = """!g.
    @g[atomic] +!g <- !!h(1); !!h(2); .fail_goal(h(1)); .succeed_goal(h(2)); .print(ok).
    +!h(X) <- .print(never). -!h(X) <- .print(failed, X)."""
    assert said(text) == ["ok", "failed1"] or said(text) == ["failed1", "ok"]


def test_failing_a_goal_of_a_fork_from_a_branch():
    text = """!g.
    +!g <- { .fail_goal(g); .print(never) } |&| { .wait(5); .print(never) }; .print(never).
    -!g <- .print(failed)."""
    assert said(text) == ["failed"]


def test_a_suspended_intention_rests_until_it_is_resumed():
    text = """!work. !boss.
    +!work <- !steps(0).
    +!steps(3).
    +!steps(N) <- .print(N); .wait(100); !steps(N + 1).
    +!boss <- .wait(50); .suspend(work); .wait(1000); .print(go); .resume(work)."""
    assert said(text) == ["0", "go", "1", "2"]


def test_an_intention_suspends_itself():
    text = "!g. !h. +!g <- .print(a); .suspend; .print(b). +!h <- .wait(10); .print(h); .resume(g)."
    assert said(text) == ["a", "h", "b"]
    assert said(text.replace(".suspend", ".suspend(g)")) == ["a", "h", "b"]


def test_what_an_intention_waits_for_may_come_while_it_is_suspended():
    text = "!g. !h. +!g <- .wait(20); .print(b). +!h <- .wait(10); .suspend(g); .wait(100); .print(h); .resume(g)."
    assert said(text) == ["h", "b"]


def test_branches_are_suspended_with_their_intention():
    text = """!g. !h.
    +!g <- { .wait(20); .print(a) } |&| { .wait(30); .print(b) }; .print(c).
    +!h <- .wait(10); .suspend(g); .wait(100); .print(h); .resume(g)."""
    assert said(text) == ["h", "a", "b", "c"]


def test_what_is_intended_desired_and_suspended_can_be_asked():
    text = """!g(1). !ask.
    +!g(X) <- .wait(100).
    +!ask <-
        .wait(10);
        .findall(X, .intend(g(X)), A); .findall(X, .desire(g(X)), B);
        .suspend(g(_));
        .findall(X, .intend(g(X)), C); .findall(X, .desire(g(X)), D);
        .suspended(g(Y), Why); .print(A, B, C, D, Y, Why);
        if (not .desire(other)) { .print(no) }."""
    assert said(text) == ["[1][1][][1]1suspended", "no"]


def test_the_goals_that_a_plan_serves_are_intended():
    text = "!g. +!g <- !h(1); .print(x). +!h(X) : .intend(g) <- .print(in); if (.intend(h(1))) { .print(yes) }."
    assert said(text) == ["in", "yes", "x"]
    assert said("!g. +!g <- .intend(g); .print(yes).") == ["yes"]


def test_the_intention_at_hand_tells_its_goals():
    text = "!g. +!g <- !h(1); .print(x). +!h(X) <- .current_intention(intention(N, Goals)); .print(N, Goals)."
    assert said(text) == ["1[h(1),g]", "x"]


def test_a_goal_that_is_pursued_by_its_last_step_counts_as_pursued():
    text = "!g. !end. +!g <- !h. +!h <- .wait(100); .print(never). +!end <- .wait(1); .drop_intention(g); .print(end)."
    assert said(text) == ["end"]
