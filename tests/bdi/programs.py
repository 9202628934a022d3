"""Random small programs."""

from __future__ import annotations

import re

from hypothesis import strategies as st

from socialbot.bdi import Plan, ask, send, test
from socialbot.bdi.agentspeak import agentspeak, parse
from socialbot.bdi.literals import Change, Event, Literal, source
from socialbot.bdi.steps import Achieve, Ask, Await, Constrain, Do, For, Forget, If, Nested, Step, Update, While
from socialbot.bdi.terms import (
    NOTHING,
    Atom,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Negation,
    Pattern,
    conjunction,
)
from socialbot.core.errors import RuleError
from tests.bdi.lab import X, Y, Z, _, crash, do, go, mood, nap, p, ping, q, r, sub

VALUES = st.sampled_from((0, 1))
TERMS = st.sampled_from((0, 1, X, X, Y, Y))
LOOSE = st.sampled_from((0, 1, X, X, Y, Y, _))


def literals(*kinds: type[Literal], args: st.SearchStrategy[object]) -> st.SearchStrategy[Literal]:
    """Literals of these classes; ``q`` and ``sub`` have two arguments, the others one."""
    return st.one_of(*(st.builds(kind, *[args] * (2 if kind in (q, sub) else 1)) for kind in kinds))


def negation(belief: Literal) -> Condition:
    assert isinstance(belief, Condition)
    return Negation(belief)


BELIEFS = literals(p, q, q, mood, args=LOOSE)
COMPARISONS = st.builds(Comparison, st.sampled_from(("<", "==", "!=", "=")), TERMS, TERMS)
TESTS = st.one_of(BELIEFS, BELIEFS, BELIEFS.map(negation), COMPARISONS)
CONDITIONS = st.one_of(
    TESTS,
    TESTS,
    st.lists(TESTS, min_size=2, max_size=2).map(lambda pair: Disjunction(tuple(map(conjunction, pair)))),
    st.lists(TESTS, min_size=2, max_size=2).map(lambda pair: Negation(conjunction(*pair))),
)
SIGNS = st.sampled_from(("+", "+", "++", "-", "-", "--", "-+"))
DONE = st.builds(do, st.sampled_from("abc"), st.one_of(TERMS, TERMS, st.just(X + 1))).map(Do)
PLAIN_STEPS = st.one_of(
    DONE,
    DONE,
    st.builds(Update, SIGNS, literals(p, q, mood, args=LOOSE)),
    st.builds(Update, st.sampled_from(("+", "++")), literals(ping, args=TERMS)),
    st.builds(Forget, literals(p, q, mood, args=LOOSE)),
    st.builds(Achieve, literals(go, sub, sub, args=LOOSE)),
    st.builds(Achieve, literals(go, args=TERMS), st.just(True)),
    st.builds(ask, BELIEFS),
    TESTS.map(test),
    st.just(Do(crash())),
    st.builds(nap, st.sampled_from((1, 2))).map(Do),
)
BLOCKS = st.lists(PLAIN_STEPS, max_size=2).map(tuple)
STEPS = st.one_of(
    PLAIN_STEPS,
    PLAIN_STEPS,
    PLAIN_STEPS,
    st.builds(If, TESTS.map(conjunction), BLOCKS, BLOCKS),
    st.builds(For, CONDITIONS.map(conjunction), BLOCKS),
    st.builds(While, TESTS.map(conjunction), BLOCKS),
)
EVENTS = [
    st.builds(Event, st.just(change), literals(*kinds, args=TERMS))
    for change, kinds in (
        (Change.ADDED, (p,)), (Change.ADDED, (q, mood, ping)), (Change.REMOVED, (p, q, mood)),
        (Change.WANTED, (go,)), (Change.WANTED, (go,)), (Change.WANTED, (sub,)), (Change.WANTED, (sub,)),
        (Change.FAILED, (go, sub)), (Change.ASKED, (p, q)), (Change.UNANSWERED, (p, q)),
    )
]  # fmt: skip


@st.composite
def plans(draw: st.DrawFn, events: st.SearchStrategy[Event]) -> Plan:
    """A plan; what would make it no plan at all, such as a variable that has no value, is left out."""
    plan = Plan(draw(events), NOTHING, ())
    for condition in draw(st.lists(CONDITIONS, max_size=2)):
        assert isinstance(condition, Condition)
        plan = _extended(plan, (*plan.condition.terms, condition), plan.body)
    # The first step tells which plan was chosen.
    body: tuple[Step, ...] = (Do(do(str(plan.event))),) if draw(st.integers(0, 5)) else ()
    plan = _extended(plan, plan.condition.terms, body)
    for step in draw(st.lists(STEPS, max_size=4)):
        plan = _extended(plan, plan.condition.terms, (*plan.body, step))
    rank, atomic = draw(st.sampled_from((0, 0, 0, 1))), draw(st.sampled_from((False, False, False, True)))
    return Plan(plan.event, plan.condition, plan.body, atomic=atomic, priority=rank)


def _extended(plan: Plan, terms: tuple[Condition, ...], body: tuple[Step, ...]) -> Plan:
    try:
        return Plan(plan.event, Conjunction(terms), body).check()
    except RuleError:
        return plan


PROGRAMS = st.tuples(*[plans(events) for events in EVENTS]).flatmap(st.permutations)
POSTED = st.one_of(
    st.tuples(st.just("believe"), literals(p, q, mood, ping, args=VALUES)),
    st.tuples(st.just("forget"), literals(p, q, mood, args=VALUES)),
    st.tuples(st.just("achieve"), literals(go, go, sub, args=VALUES)),
)
STIMULI = st.lists(
    st.one_of(POSTED, POSTED, POSTED, st.tuples(st.just("seconds"), st.integers(0, 2))), min_size=3, max_size=10
)
"""What is posted, one after the other; at ``seconds`` the agent deals with it all, then so many seconds pass."""


ROOM = [r(X) << (q(X, Y) & ~p(Y)), r(X) << (p(X) & q(_, X)), r(X) << (q(X, X) | p(X)[source(Atom("bob"))])]
RULES = st.lists(st.sampled_from(ROOM), unique_by=id, max_size=2).map(tuple)
NAMED = st.sampled_from((Atom("bob"), Atom("eve"), Atom("self"), Z))
SAID = st.builds(lambda belief, name: belief[source(name)], literals(p, q, mood, args=LOOSE), NAMED)
SOCIAL_TESTS = st.one_of(BELIEFS, BELIEFS, literals(r, args=LOOSE), SAID, SAID.map(negation), COMPARISONS)
AWAITED = st.one_of(
    st.builds(Event, st.sampled_from((Change.ADDED, Change.REMOVED)), st.one_of(literals(p, q, args=LOOSE), SAID)),
    st.builds(Event, st.just(Change.WANTED), literals(go, args=LOOSE)),
    st.lists(SOCIAL_TESTS, min_size=1, max_size=2).map(lambda terms: conjunction(*terms)),
)
SOCIAL_STEPS = st.one_of(
    PLAIN_STEPS,
    PLAIN_STEPS,
    st.builds(Await, AWAITED, st.sampled_from((None, 1, 2))),
    st.builds(Await, AWAITED, st.sampled_from((None, 1, 2))),
    st.builds(lambda arg: Do(send("bob", p(arg))), TERMS),
    st.one_of(SAID, literals(r, args=LOOSE)).map(test),
)
SOCIAL_EVENTS = [
    *(event for event in EVENTS[3:7]),
    st.builds(Event, st.just(Change.ADDED), literals(p, q, args=TERMS)),
    st.builds(Event, st.just(Change.ADDED), SAID),
    st.builds(Event, st.just(Change.REMOVED), SAID),
    st.builds(Event, st.just(Change.FAILED), literals(go, sub, args=TERMS)),
]


@st.composite
def social_plans(draw: st.DrawFn, events: st.SearchStrategy[Event]) -> Plan:
    """A plan with waits, messages, derived beliefs and annotations; no plan is atomic."""
    plan = Plan(draw(events), NOTHING, ())
    for condition in draw(st.lists(SOCIAL_TESTS, max_size=2)):
        assert isinstance(condition, Condition)
        plan = _extended(plan, (*plan.condition.terms, condition), plan.body)
    plan = _extended(plan, plan.condition.terms, (Do(do(str(plan.event))),))
    for step in draw(st.lists(SOCIAL_STEPS, max_size=4)):
        plan = _extended(plan, plan.condition.terms, (*plan.body, step))
    return plan


SOCIAL_PROGRAMS = st.tuples(*[social_plans(events) for events in SOCIAL_EVENTS]).flatmap(st.permutations)
TOLD = st.one_of(
    st.tuples(st.just("tell"), literals(p, q, mood, args=VALUES)),
    st.tuples(st.just("untell"), literals(p, q, mood, args=VALUES)),
    st.tuples(st.just("achieve"), literals(go, sub, args=VALUES)),
).flatmap(lambda told: st.tuples(st.just(told[0]), st.just(told[1]), st.sampled_from(("bob", "eve"))))
SOCIAL_STIMULI = st.lists(
    st.one_of(POSTED, TOLD, TOLD, st.tuples(st.just("seconds"), st.integers(0, 2))), min_size=3, max_size=10
)
"""Like `STIMULI`, with messages from other agents."""


def steps_in(body: tuple[Step, ...]) -> list[Step]:
    """All steps, those in other steps too."""
    found: list[Step] = []
    for step in body:
        found.append(step)
        if isinstance(step, Nested):
            for part in ("then", "otherwise", "body"):
                found += steps_in(getattr(step, part, ()))
    return found


def spoken(program: list[Plan]) -> list[Plan]:
    """The same program, printed as AgentSpeak and read again."""
    return list(parse("\n".join(map(agentspeak, program))).plans)


def can_be_spoken(program: list[Plan]) -> bool:
    """Whether the text of a program means the same.

    It may add beliefs with variables, and compare variables without a value, which fails in Python. ``X = Y`` may leave
    two without one.
    """
    steps = [(plan, step) for plan in program for step in steps_in(plan.body)]
    added = [(plan, names_in(step.literal)) for plan, step in steps if isinstance(step, Update)]
    asks_openly = any(isinstance(step, Achieve) and names_in(step.goal) for _, step in steps)
    return not (
        any(re.search(r"\b[XYZ] = [XYZ]\b", agentspeak(plan)) for plan in program)
        or any(isinstance(step, Forget) for _, step in steps)
        or any(names and (asks_openly or names - names_in(plan.event)) for plan, names in added)
    )


def names_in(item: object) -> set[str]:
    return item.names() if isinstance(item, Pattern) else set()


__all__ = [
    "PROGRAMS", "RULES", "SOCIAL_PROGRAMS", "SOCIAL_STIMULI", "STIMULI", "Ask", "Constrain", "can_be_spoken", "spoken",
]  # fmt: skip
