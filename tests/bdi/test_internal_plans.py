"""Internal actions on plans, beliefs, time and waiting."""

from __future__ import annotations

from datetime import datetime

import pytest

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import AgentSpeakError
from socialbot.core.clock import ManualClock
from tests.bdi.mas import Mas, does, said

OWN = '[source(self),url("file:me.asl")]'
"""Annotations of the label of a plan of the agent `me`."""

PRINTED = {
    "a plan stays until its last source is gone": ("""!g.
    +!g <- .add_plan({@l +!h <- .print(h)}, bob); .add_plan({@l +!h <- .print(h)}, amy); !h;
           .remove_plan(l); !h; .remove_plan(l, bob); !h; .remove_plan(l, amy); !h.
    -!h[error(E)] <- .print(E).""", ["h", "h", "h", "no_relevant"]),
    "relevant plans are those whose event fits": ("""!g.
    +!g <- .relevant_plans({+!h(2)}, P, L); .print(L); .relevant_plans({+!h(_)}, _, M); .print(M);
           .relevant_plans({+!none}, N); .print(N); .relevant_plans("+!h(1)", Q); .length(Q, K); .print(K).
    @one +!h(1). @two +!h(2) : false. @any +!h(X).""", [
        f"[two{OWN},any{OWN}]", f"[one{OWN},two{OWN},any{OWN}]", "[]", "2",
    ]),
    "a plan without a label can be removed as it was found": (
        "!g. +!g <- .relevant_plans({+!h}, P, L); .remove_plan(L); !h. +!h <- .print(h). -!h[error(E)] <- .print(E).",
        ["no_relevant"],
    ),
    "the plan of a label": (
        "!g. @l +!g <- .plan_label(P, l); .print(P); .plan_label(Q, m). -!g <- .print(none).",
        [f"{{ @l{OWN} +!g <- .plan_label(_1,l); .print(_1); .plan_label(_2,m) }}","none"],
    ),
    "beliefs put first and last are found in that order": ("""b(1). !g. +b(X) <- .print(X).
    @g[atomic] +!g <- .asserta(b(0)); .assertz(b(2)); .findall(X, b(X), L); .print(L).""", ["1", "[0,1,2]", "0", "2"]),
    "the order holds in an index too":
        ("!g. b(x, 1). +!g <- ?b(x, _); .assertz(b(x, 2)); .findall(X, b(x, X), L); .print(L).", ["[1,2]"]),
    "what follows is not held":
        ("a(1). b(X) :- a(X). !g. +!g <- if (.belief(a(X)) & not .belief(b(_))) { .print(X) }.", ["1"]),
    "a stage is entered": (
        "!g. +!g <- !h; .enter(night); !h. @a[stage(night)] +!h <- .print(sleep). +!h <- .print(work).",
        ["work", "sleep"],
    ),
    "collectors take names without arguments": (
        "b. !g. +!g <- .count(b, N); .count(c, M); .findall(x, b, L); .setof(x, b & not c, S); .print(N, M, L, S).",
        ["10[x][x]"],
    ),
    "collectors are conditions too":
        ("b(1). b(2). !g. +!g : .count(b(_), 2) & .findall(X, b(X), [Y|_]) <- .print(Y, .count(b(_)) + 1).", ["13"]),
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_prints(name):
    text, lines = PRINTED[name]
    assert said(text) == lines


def test_a_plan_that_is_added_is_carried_out():
    assert said("!g. +!g <- .add_plan({+!h(X) <- .print(hello, X)}); !h(1).") == ["hello1"]
    assert said('!g. +!g <- .add_plan("+!h(X) <- .print(hello, X)."); !h(1).') == ["hello1"]
    assert said('!g. +!g <- .add_plan(["+!h(1) <- .print(a)", {+!h(2) <- .print(b)}]); !h(1); !h(2).') == ["a", "b"]


def test_a_plan_is_added_at_the_end_or_at_the_beginning():
    text = "!g. +!g <- .add_plan({+!h <- .print(new)}, self, WHERE); !h. +!h <- .print(old)."
    assert said(text.replace("WHERE", "end")) == ["old"]
    assert said(text.replace("WHERE", "begin")) == ["new"]


def test_a_plan_is_removed_by_its_label_or_itself():
    text = "!g. +!g <- !h; .remove_plan(WHAT); !h. @l +!h <- .print(a). +!h <- .print(b)."
    for what in ("l", '"@l"', "[l]", "{@l +!h <- .print(a)}"):
        assert said(text.replace("WHAT", what)) == ["a", "b"]


def test_removing_a_missing_plan_succeeds():
    assert does(".remove_plan(nothing); .remove_plan({+!x <- .print(1)}); .print(ok)") == ["ok"]


@pytest.mark.parametrize("plan", ['"+!h <- "', '"+!h <- .nothing(1)"', "7", '"@l +!x"'])
def test_a_plan_with_a_mistake_is_not_added(plan):
    assert said(f"!g. @l +!g <- .add_plan({plan}). -!g[error(E)] <- .print(E).") == ["wrong_arguments"]


def test_a_plan_added_by_one_agent_is_not_shared():
    from socialbot.bdi.agentspeak import parse
    from socialbot.bdi.agentspeak.loading import begin, library_of

    program = parse('!g. +!g : .my_name(a) <- .add_plan("+!h <- .print(learned)"); !h. +!g <- .wait(1); !h.')
    library, clock, lines = library_of(program), ManualClock(), []
    for engine in [Engine(name, clock, library=library) for name in ("a", "b")]:
        engine.out = lines.append
        begin(engine, program)
        engine.run_until_idle()
        clock.advance(1)
        engine.run_until_idle()
    assert lines == ["learned"]


# Beliefs


def test_abolish_removes_matching_beliefs_of_any_source():
    mas = Mas(me="b(1). b(2)[source(bob)]. c(1). !g. +!g <- .abolish(b(_)); .abolish(none). -b(X) <- .print(X).").until(
        1
    )
    assert sorted(mas.lines) == ["1", "2"]
    assert mas.beliefs("me") == {"c(1)": ("self",)}


# Time


def test_waiting_is_in_milliseconds():
    mas = Mas(me="!g. +!g <- .wait(1500); .print(a).")
    assert mas.until(1.4).lines == []
    assert mas.until(1.5).lines == ["a"]


@pytest.mark.parametrize(
    ("what", "lines"),
    [
        ("{+b(X)}, 2000); .print(X", ["1"]),
        ("{+b(X)}, 500); .print(X", ["wait_timeout"]),
        ('"+b(1)", 2000); .print(x', ["x"]),
        ('"+b(1)", 500); .print(x', ["wait_timeout"]),
        ('"+b(2)", 5000); .print(x', ["wait_timeout"]),
        ("b(X), 2000); .print(X", ["1"]),
        ("b(X) & X > 1, 2000); .print(X", ["wait_timeout"]),
        ("ready, 2000); .print(x", ["x"]),
        ("T); .print(x", ["x"]),
        ("b(X), T); .print(X", ["wait_timeout"]),
    ],
)
def test_waiting_for_something(what, lines):
    text = (
        f"t(500). !h. !g. +!h <- .wait(1000); +ready; +b(1). +!g : t(T) <- .wait({what}). -!g[error(E)] <- .print(E)."
    )
    assert said(text) == lines


@pytest.mark.parametrize("what", ['"b("', "[]"])
def test_wait_fails_for_other_terms(what):
    assert does(f".wait({what})") == ["failed wrong_arguments"]


def test_wait_with_a_third_argument_tells_the_time_and_does_not_fail():
    assert does(".wait(b, 100, T); .print(T); .wait({+b}, 50, U); .print(U)") == ["100", "50"]
    assert does("!!b; .wait({+b(X)}, 500, T); .print(X, T). +!b <- .wait(20); +b(7)") == ["720"]
    assert does("+b(7); .wait(b(X), 500, T); .print(X, T)") == ["70"]


def test_wait_with_a_third_argument_has_no_value_of_a_condition_that_never_held():
    assert does(".wait(b(X), 100, T); if (not .ground(X)) { .print(free) }") == ["free"]


def test_wait_refuses_a_fourth_argument():
    with pytest.raises(AgentSpeakError, match=r"\.wait"):
        said("+!g <- .wait(b, 100, T, 1).")


@pytest.mark.parametrize(
    ("when", "seconds"),
    [
        ("now +2 s", 2),
        ("now + 3 minutes", 180),
        ("now +1 h", 3600),
        ("now +1500", 1.5),
        ("now +20 ms", 0.02),
        ("now", 0),
    ],
)
def test_a_goal_at_a_time(when, seconds):
    mas = Mas(me=f'!g. +!g <- .at("{when}", {{+!h(1)}}); .print(set). +!h(X) <- .print(X).')
    if seconds:
        assert mas.until(seconds - 0.001).lines == ["set"]
    assert mas.until(seconds).lines == ["set", "1"]


def test_an_event_at_a_time_is_not_believed():
    mas = Mas(me='!g. +!g <- .at("now +1 s", {+b(1)}). +b(X) : not b(X) <- .print(X).')
    assert mas.until(2).lines == ["1"]


@pytest.mark.parametrize(
    "args", ['"tomorrow", {+!h}', '"now +1 parsec", {+!h}', '"now +1 s", h', '"now +1 s", {+h(X)}']
)
def test_at_fails_for_wrong_arguments(args):
    assert does(f".at({args})")[0].startswith("failed")


def test_time_and_date_use_the_clock_of_the_agent():
    text = """!g. +!g <- .wait(90250); .time(_, _, S, Ms); .date(Y, M, D); .print(S, " ", Ms, " ", Y, "-", M, "-", D);
    .print(system.time)."""
    here = datetime.fromtimestamp(90.25).astimezone()
    assert said(text, 100) == [f"30 250 {here.year}-{here.month}-{here.day}", "90250"]


def test_random_numbers_depend_on_the_seed_of_the_agent():
    def numbers(seed):
        engine, lines = Engine("me", ManualClock(), seed=seed), []
        engine.out = lines.append
        engine.add_text("!g. +!g <- .random(X); .random([a, b, c, d], Y); .print(X, Y, math.random).")
        engine.run_until_idle()
        return lines

    assert numbers(1) == numbers(1) != numbers(2)
