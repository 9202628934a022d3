"""Plans in plans and goal conditions, as in Jason: ``+!g : c <: until <- body. { inner plans }``."""

from __future__ import annotations

import pytest

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.loading import check
from socialbot.bdi.agentspeak.parser import parse_plan
from socialbot.core.clock import ManualClock
from tests.bdi.mas import Mas, said

AROUND = """
+a(X) <- .print(outside, X).
+!g1(X) <: g1(X) <- .print(begun). {
   +a(X) : X > 2 <- .print(never).
   +a(Y) : Y > 2 <- .print(inner, Y); +g1(X); .print(too_late).
}
"""
"""Goal that ends when the belief g1 is held. The first inner plan for `a` needs the X of the goal."""


class TestGoals:
    def test_the_body_uses_inner_plans_that_others_do_not_see(self):
        text = """
        !go. !other.
        +!go <- !sub(X); .print(X). { +!sub(X) <- X = inner. }
        +!other <- !sub(X); .print(X).
        +!sub(outer).
        """
        assert said(text) == ["inner", "outer"]

    def test_an_inner_plan_knows_the_trigger_and_the_context_around_it(self):
        text = """
        price(7).
        !sell(car).
        +!sell(What) : price(P) <- !tell. { +!tell <- .print(What, " ", P). }
        """
        assert said(text) == ["car 7"]

    def test_the_first_inner_plan_that_applies_is_selected(self):
        text = """
        !go(1).
        +!go(X) <- !sub; +b. {
            +!sub : X > 1 <- .print(never).
            +!sub <- .print(first).
            +!sub <- .print(second).
            +b <- .print(one).
            +b <- .print(two).
        }
        """
        assert said(text) == ["first", "one"]

    def test_plans_further_outside_apply_if_no_inner_one_does(self):
        text = """
        !go(1).
        +!go(X) <- !mid. {
            +!mid <- !try(1); !try(2); !try(3); !try(4). {
                +!try(1) <- .print(innermost).
            }
            +!try(Y) : Y < 3 <- .print(inner).
            +!try(3) <- .print(three, X).
        }
        +!try(_) <- .print(outside).
        """
        assert said(text) == ["innermost", "inner", "three1", "outside"]

    def test_a_failed_goal_takes_the_inner_failure_plan(self):
        text = """
        !go(1).
        +!go(X) <- !sub; !sub2. { +!sub <- .fail. -!sub[error(E)] <- .print(X, E). }
        -!go(X)[error(E)] <- .print(X, E).
        """
        assert said(text) == ["1ia_failed", "1no_relevant"]

    def test_questions_and_beliefs_of_the_body_use_inner_plans(self):
        text = """
        !go(5).
        +b(_) <- .print(outside).
        +!go(X) <- ?half(Y); .print(Y); +b(1); -b(1); ++b(2). {
            +?half(Y) <- Y = X / 2.
            +b(Y) <- .print(added, X + Y).
            -b(Y) <- .print(removed, X + Y).
        }
        """
        assert said(text) == ["2.5", "added6", "removed6", "outside"]

    def test_plans_that_are_added_later_handle_known_beliefs(self):
        mas = Mas(me="b(0).").until(1)
        mas.me.add_text("!go(5). +!go(X) <- +b(1); -b(0). { +b(Y) <- .print(X + Y). -b(Y) <- .print(X - Y). }")
        assert mas.until(2).lines == ["6", "5"]

    def test_goals_in_control_structures_use_inner_plans(self):
        text = """
        n(1). n(2).
        !go.
        +!go <- for (n(X)) { !show(X) }; if (n(1)) { !show(3) } else { .print(no) }; { !show(4) } |&| { !show(5) }. {
            +!show(X) <- .print(X).
        }
        """
        assert sorted(said(text)) == ["1", "2", "3", "4", "5"]


class TestBeliefs:
    def test_an_event_from_elsewhere_runs_the_inner_plan_beside_that_outside(self):
        assert said("!go. +!go <- !!g1(5); .wait(10); ++a(1); ++a(6)." + AROUND) == [
            "begun", "outside1", "outside6", "inner6",
        ]  # fmt: skip

    def test_an_inner_plan_ends_with_the_plan_around_it(self):
        text = """
        !go.
        +!go <- !!work; .wait(10); ++a; .wait(100); ++a.
        +!work <: done <- .print(begun). { +a <- .print(reacts); .wait(20); +done; .wait(50); .print(never). }
        """
        assert said(text) == ["begun", "reacts"]

    def test_without_a_goal_condition_a_running_inner_plan_continues(self):
        text = """
        !go.
        +!go <- !!work; .wait(10); ++a; .wait(100); ++a.
        +!work <- .wait(50); .print(end). { +a <- .print(reacts); .wait(80); .print(continues). }
        """
        assert said(text) == ["reacts", "end", "continues"]

    def test_each_intention_reacts_with_its_own_values(self):
        text = """
        !go. !watch(1). !watch(2).
        +!go <- .wait(10); ++seen(1); ++seen(3).
        +!watch(X) <: false. { +seen(Y) : Y >= X <- .print(X, Y). }
        """
        assert said(text) == ["11", "13", "23"]

    @pytest.mark.parametrize(("event", "plan"), [("e(1)", "inner121"), ("e(9)", "outer19"), ("f(1)", "outer11")])
    def test_the_innermost_plan_that_applies_reacts_alone(self, event: str, plan: str):
        text = """
        !go. !a(1).
        +!go <- .wait(10); ++EVENT.
        +!a(X) <: false <- { !b(2) } |&| { .wait(100) }. {
            +!b(Y) <: false <- .wait(1). { +e(Z) : Z < 5 <- .print(inner, X, Y, Z). +g. }
            +e(Z) <- .print(outer, X, Z).
            +f(Z) <- .print(outer, X, Z).
        }
        """
        assert said(text.replace("EVENT", event)) == [plan]

    def test_an_event_of_the_body_of_another_plan_is_not_for_the_inner_plan(self):
        text = "!work. !go. +!go <- .wait(10); +a; .print(end). +!work <: false. { +a <- .print(inner). }"
        assert said(text) == ["end"]

    @pytest.mark.parametrize("head", ["e(I)", "e(J) : J == I"])
    def test_known_arguments_of_inner_plans_select_their_intentions(self, head: str):
        text = f"!go. +!go <- for (.range(I, 1, 3)) {{ !!w(I) }}; .wait(10); ++e(2); ++e(1). \
            +!w(I) <: false. {{ +{head} <- .print(I). +f(I, X). +f(7, X) <- .print(X, I). }}"
        assert said(text + " !f. +!f <- .wait(50); ++f(7, x); ++f(1, y).") == ["2", "1", "x1", "x2", "x3"]

    def test_known_arguments_select_in_nested_plans_too(self):
        text = """
        !a(1). !go.
        +!a(X) <: false <- !b(2). { +!b(Y) <: false. { +e(Y) <- .print(inner, Y). } +e(X) <- .print(outer, X). }
        +!go <- .wait(10); ++e(2); ++e(1); ++e(3).
        """
        assert said(text) == ["inner2", "outer1"]

    def test_nothing_waits_after_the_end(self):
        text = "+!work(N) <- .wait(1). { +a(M) : M > N <- .print(M). }\n+!until(N) <: a(N). { +b(N) <- .print(N). }"
        mas = Mas(me=text)
        for number in range(50):
            mas.me.add_text(f"!work({number}). !until({number}).")
        mas.until(1)
        mas.me.add_text("!go. +!go <- for (.range(I, 0, 49)) { ++a(I) }.")
        mas.until(2)
        assert mas.lines == []
        assert len(mas.me.intentions) == 0
        assert not mas.me.intentions.waits.events
        assert not mas.me.intentions.waits.conditions


class TestGoalConditions:
    def test_a_goal_whose_condition_holds_runs_no_step(self):
        assert said("ready. !g. +!g <: ready <- .print(no).") == []

    def test_a_goal_is_not_achieved_before_its_condition_holds(self):
        text = "!go. !later. +!go <- !g; .print(after). +!g <: ready <- .print(body). +!later <- .wait(50); +ready."
        assert said(text) == ["body", "after"]

    def test_the_condition_drops_the_remaining_steps(self):
        text = "!go. +!go <- !g(3); .print(after). +!g(N) <: n(N) <- for (.range(I, 1, 9)) { +n(I); .print(I) }."
        assert said(text) == ["1", "2", "after"]

    def test_a_failed_step_fails_the_goal(self):
        text = "!g. +!g <: ready <- .fail. -!g[error(E)] <- .print(E)."
        assert said(text) == ["ia_failed"]

    def test_a_false_condition_is_for_goals_that_end_by_done(self):
        text = """
        !go. !event.
        +!go <- !g(X); .print(X).
        +!g(X) <: false <- X = 1; .print(body). { +stop <- .print(stops); .done; .print(never). }
        +!event <- .wait(10); ++stop.
        """
        assert said(text) == ["body", "stops", "1"]

    def test_done_in_the_body_ends_the_plan(self):
        assert said("!go. +!go <- !g; .print(after). +!g <: false <- .print(a); .done; .print(never).") == [
            "a",
            "after",
        ]

    def test_the_plan_for_a_belief_can_have_a_goal_condition(self):
        text = """
        !go.
        +!go <- ++task(7); .wait(10); ++stop; .wait(10); ++stop.
        +task(X) <: false <- .print(begin, X). { +stop <- .print(end, X); .done. }
        """
        assert said(text) == ["begin7", "end7"]

    def test_the_goal_can_be_dropped_and_limited(self):
        text = """
        !go.
        +!go <- !!g(2); !g(3)[within(0.1)].
        -!go[error(E)] <- .print(E); .drop_intention(g(2)); ++b.
        +!g(X) <: false. { +b <- .print(X). }
        """
        assert said(text) == ["timeout"]


class TestTexts:
    PLANS = (
        "+!p(X) : X > 0 <: X > 100 <- .print(a).",
        "+!p(X) : X > 0 <: X > 100 | q <- .print(a). { +e <- x. +!sg : a <: false <- k. +!sg <- k. { +x <- l. } }",
        "+!p(X) <: false.",
    )

    @pytest.mark.parametrize("text", PLANS)
    def test_a_printed_plan_is_read_again(self, text: str):
        assert agentspeak(parse_plan(text)) == text

    def test_the_plan_is_one_plan_of_the_library(self):
        engine = Engine("me", ManualClock())
        engine.add_text("@l +!g <- !s. { @m +!s <- .print(s). +b. }")
        (plan,) = engine.library
        assert str(plan).startswith("@l +!g <- !s. {")
        engine.library.remove(plan)
        assert not list(engine.library)
        assert engine.library.labelled("m") is None

    def test_the_plans_for_an_event_are_printed_as_they_were_written(self):
        text = "!go. +!go <- .relevant_plans({+!g(_)}, [P]); .print(P). @l +!g(X) <: a(X) <- !s. { +!s <- .print(s). }"
        assert said(text) == [
            '{ @l[source(self),url("file:me.asl")] +!g(_1) <: a(_1) {\n   <- !s.\n   +!s <- .print(s).\n} }'
        ]

    def test_a_removed_label_removes_the_inner_plans(self):
        text = "!go. +!go <- !g; .remove_plan(l); !g. @l +!g <- !s. { +!s <- .print(s). } -!go[error(E)] <- .print(E)."
        assert said(text) == ["s", "no_relevant"]

    def test_the_plans_are_those_of_a_copied_library(self):
        text = "!go. +!go <- +{ +!x <- .print(x) }; !g(2); !x. +!g(X) <- !s. { +!s <- .print(X). }"
        assert said(text) == ["2", "x"]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("+!g <- a. { +!s <- b.", "an inner plan, or '}'"),
            ("+!g <- a. { +!s <- b }", "'.' or ';' after a step"),
            ("+!g <- a. { b(1). }", "the directive 'b'"),
            ("+!g <: <- a.", "a term"),
            ("+!g <- a. { +!s <- .no_such(1). }", ".no_such"),
            ("+!g <- a. { ^!s[state(failed)] <- .print(1). }", "a plan within a plan is for one goal"),
            ("+!g <- a. { +!S <- .print(1). }", "a plan within a plan is for one goal"),
        ],
    )
    def test_mistakes_are_named(self, text: str, message: str):
        problems = check(text)
        assert problems
        assert message in str(problems[0])

    def test_a_mistake_in_an_inner_plan_loads_nothing(self):
        engine = Engine("me", ManualClock())
        with pytest.raises(AgentSpeakError, match=r"no_such"):
            engine.add_text("+!h. +!g <- a. { +!s <- .no_such(1). }")
        assert not list(engine.library)
