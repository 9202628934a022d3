"""Goal patterns add plans for a goal; tests/conformance/jason/3-goals.txt says what they do."""

from __future__ import annotations

import pytest

from socialbot.bdi.agentspeak import AgentSpeakError, agentspeak
from socialbot.bdi.agentspeak.loading import check
from socialbot.bdi.agentspeak.programs import parse
from tests.bdi.mas import said


def plans(text: str) -> list[str]:
    return [agentspeak(plan) for plan in parse(text).plans]


def test_a_declarative_goal():
    assert plans("{ begin dg(at(X)) } +!at(X) : ok <- go(X). +!other <- b. { end } +c <- d.") == [
        "+!at(X) : at(X).",
        "+!at(X) : .intend(at(X)).",
        "+!at(X) : ok <- go(X); ?at(X).",
        "+!other <- b.",
        "+at(X) <- .succeed_goal(at(X)).",
        "+c <- d.",
    ]


def test_the_exclusive_one_tries_each_plan_once():
    assert plans("{ begin ebdg(a) } +!a : c <- go. { end }") == [
        "+!a : a.",
        "+!a : not p__f(1, a) & c <- +p__f(1, a); go; ?a.",
        "-!a <- !a.",
        "+a <- .abolish(p__f(_, a)); .succeed_goal(a).",
        "-a <- .abolish(p__f(_, a)).",
    ]


def test_a_maintained_goal_is_believed_at_first():
    program = parse("{ begin mg(a, ebdg(a)) } +!a <- go. { end }")
    assert [str(belief) for belief in program.beliefs] == ["a"]
    assert agentspeak(program.plans[-1]) == "-a <- !a."


def test_in_a_namespace():
    text = "{ begin namespace(n) } { begin dg(a) } +!a <- .print(go); +a. { end } !a. { end }"
    assert said(text) == ["go"]


def test_patterns_within_patterns():
    text = "!a. { begin bc(a) } { begin dg(b) } +!b <- .print(b); +b. { end } +!a <- !b; .print(a); +a. { end }"
    assert said(text) == ["b", "a"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{ dg(a) }", "the directive 'dg' has content"),
        ("{ begin dg(1) } { end }", "the pattern 'dg' is wrong: dg expects a goal"),
        ("{ begin smc(a) } { end }", "takes 2 to 2 arguments"),
        ("{ begin bc(a, 3) } { end }", "3 is not a goal pattern"),
        ("{ begin dg(a) } +!a <- b.", "'{ end }' of dg"),
        ("{ begin sga(a, b, c) } { end }", "sga expects a trigger and a context as strings"),
        ("{ begin bgd(a) } { end }", "did you mean 'bdg'?"),
    ],
)
def test_mistakes(text, message):
    (problem,) = check(text)
    assert isinstance(problem, AgentSpeakError)
    assert message in str(problem)
