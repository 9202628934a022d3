"""Meta-events: plans for changes of the states of goals."""

from __future__ import annotations

import re

import pytest

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak
from socialbot.bdi.agentspeak.loading import check
from socialbot.bdi.agentspeak.parser import parse_plan
from socialbot.core.clock import ManualClock
from tests.bdi.mas import Mas, said

TELL = '^!G[state(S)[reason(R)]] <- .print(G, " ", S, " ", R).'


def states(text: str, goal: str = "", seconds: float = 60) -> list[str]:
    """Return the states of a goal, or of all goals, in order of their events."""
    lines = [line.strip() for line in said(f"{text} {TELL}", seconds) if line.startswith(goal)]
    return [line.removeprefix(goal).strip() for line in lines]


def test_a_goal_without_variables():
    assert states("!g. +!g.", "g") == ["pending", "executing", "achieved", "finished"]


def test_the_values_of_a_goal():
    assert states("!g. +!g <- !a(1, X). +!a(N, M) <- M = N + 1.", "a") == [
        "(1,X) pending",
        "(1,X) executing",
        "(1,2) achieved",
        "(1,2) finished",
    ]


def test_a_failure_that_is_handled():
    text = "!g. +!g <- !b. +!b <- .fail. -!b."
    assert states(text, "b") == [
        "pending",
        "executing",
        "failed ia_failed",
        "executing has_failure_plan",
        "achieved",
        "finished",
    ]


def test_an_unhandled_failure_ends_all_goals():
    text = "!g. +!g <- !b. +!b <- !nope."
    assert states(text)[4:] == [
        "nope pending",
        "nope failed no_relevant_plan",
        "nope finished",
        "b failed",
        "b finished",
        "g failed",
        "g finished",
    ]


def test_no_plan_applies():
    assert "failed no_applicable_plan" in states("!g. +!g : no.", "g")


def test_a_wait():
    text = "!g. +!g <- .wait(50); .wait({+b(X)}, 20, _)."
    found = states(text, "g")
    assert [line.partition("(")[0] for line in found] == [
        "pending",
        "executing",
        "waiting wait",
        "executing",
        "waiting wait",
        "executing",
        "achieved",
        "finished",
    ]
    assert "[time(50)]" in found[2]
    assert "[b(" in found[4]


def test_suspend_and_resume():
    text = "!g. !r. +!g <- .suspend. +!r <- .wait(10); .resume(g)."
    assert states(text, "g") == [
        "pending",
        "executing",
        "suspended suspend_ia",
        "resumed resume_ia",
        "executing",
        "achieved",
        "finished",
    ]


def test_a_dropped_intention():
    text = "!g. !r. +!g <- !h. +!h <- .wait(1000). +!r <- .wait(10); .drop_intention(g)."
    found = states(text)
    assert found[found.index("h dropped") :][:4] == ["h dropped", "h finished", "g dropped", "g finished"]


def test_succeed_and_fail():
    text = "!go. +!go <- !g; !h. +!g <- .wait({+b}). +!h <- .wait({+b}). -!h."
    ends = "!r. +!r <- .wait(10); .succeed_goal(g); .wait(10); .fail_goal(h)."
    assert states(text + ends, "g ")[-2:] == ["achieved", "finished"]
    assert "executing suceed_internal_action" in states(text + ends, "go")
    assert states(text + ends, "h")[-3:] == ["failed drop_by_fail_goal", "achieved", "finished"]


def test_a_question():
    text = "!g. +!g <- ?q(X); .print(X). +?q(5). ^?q(X)[state(S)] <- .print(q(X), S)."
    assert said(text) == ["q(5)achieved", "q(5)finished", "5"]


def test_a_goal_that_replaces_itself_ends_when_the_next_has_a_plan():
    text = "!g(2). +!g(X) : X > 0 <- !g(X - 1). +!g(0)."
    assert states(text, "g") == [
        "(2) pending",
        "(2) executing",
        "(1) pending",
        "(1) executing",
        "(2) achieved",
        "(2) finished",
        "(0) pending",
        "(0) executing",
        "(1) achieved",
        "(1) finished",
        "(0) achieved",
        "(0) finished",
    ]


def test_only_the_plans_for_the_goal_and_its_annotations():
    text = "!g. +!g <- !a(1)[x]; !a(2). +!a(_). ^!a(2)[state(achieved)] <- .print(two)."
    assert said(text + " ^!a(_)[x, state(pending)] <- .print(x).") == ["x", "two"]


def test_in_an_atomic_plan_the_events_wait():
    text = "!g. @[atomic] +!g <- !a; .print(end). +!a. ^!a[state(achieved)] <- .print(told)."
    assert said(text) == ["end", "told"]


def test_a_plan_that_is_added_later():
    text = "!g. +!g <- .add_plan({^!a[state(achieved)] <- .print(told)}); !a. +!a."
    assert said(text) == ["told"]


def test_a_goal_of_an_intention_of_its_own_is_pending_while_it_is_queued():
    text = "@[atomic] +!g <- !!h; .fail_goal(h); .wait(10); .print(end). +!h. ^!h[state(S)] <- .print(S)."
    assert said(f"!g. {text}") == ["end", "pending", "failed", "finished"]


def test_goals_from_other_agents():
    mas = Mas(me="+!g. ^!g[state(achieved), source(S)] <- .print(S).", you="!go. +!go <- .send(me, achieve, g).").until(
        1
    )
    assert mas.lines == ["you"]


def test_an_agent_without_such_plans_watches_no_goals():
    engine = Engine("me", ManualClock())
    engine.add_text("!g. +!g <- !a. +!a. -!a. +b <- !g.")
    assert engine.intentions.goal_states is None
    assert not engine.library.keeps_goals


def test_the_text_of_a_plan():
    assert agentspeak(parse_plan("^!g(X)[state(S)] : p(X) <- a.")) == "^!g(X)[state(S)] : p(X) <- a."
    assert agentspeak(parse_plan("^?g <- a.")) == "^?g <- a."


@pytest.mark.parametrize("text", ["^g <- a.", "+!g <- .wait({^!h[state(achieved)]})."])
def test_mistakes(text):
    assert re.search(r"after '\^'|cannot be awaited", str(check(text)[0]))
