"""Random small programs, and the same programs as rules of the engine."""

from __future__ import annotations

from hypothesis import strategies as st

from socialbot.bdi import Rule, fail, wait
from socialbot.bdi.literals import Belief, Change, Conjunction, Event, Goal, Literal, conjunction
from tests.bdi.lab import X, do, go, mood, p, ping, q, sub
from tests.bdi.reference import Atom, Check, Plain, Step

CLASSES: dict[str, type[Literal]] = {"p": p, "q": q, "s": mood, "r": ping, "g": go, "h": sub}
CHANGES = {"added": Change.ADDED, "removed": Change.REMOVED, "wanted": Change.WANTED, "failed": Change.FAILED}


def atoms(names: str, args: tuple[int | str, ...] = (0, 1, "X")) -> st.SearchStrategy[Atom]:
    return st.builds(Atom, st.sampled_from(names), st.sampled_from(args))


STEPS = st.one_of(
    st.builds(Step, st.just("do"), atoms("ab")),
    st.builds(Step, st.just("do"), atoms("ab")),
    st.builds(Step, st.just("add"), atoms("pqsr")),
    st.builds(Step, st.just("remove"), atoms("pqs")),
    st.builds(Step, st.just("goal"), atoms("gh")),
    st.builds(Step, st.just("fail"), st.just(Atom("a", 0))),
    st.builds(Step, st.just("wait"), atoms("a", (1, 2))),
)
HEADS = [
    st.tuples(st.just(kind), atoms(names, (0, "X", "X")))
    for kind, names in (
        ("added", "p"), ("added", "pqsr"), ("removed", "pqs"),
        ("wanted", "g"), ("wanted", "h"), ("wanted", "gh"), ("failed", "g"), ("failed", "gh"),
    )
]  # fmt: skip


@st.composite
def rules(draw: st.DrawFn, heads: st.SearchStrategy[tuple[str, Atom]]) -> Plain:
    kind, head = draw(heads)
    tests = tuple(draw(st.lists(st.builds(Check, atoms("pqs"), st.booleans()), max_size=2)))
    known = "X" in (head.arg, *(test.atom.arg for test in tests if not test.negated))
    steps = draw(st.lists(STEPS, max_size=4))
    # A variable without a value would be no rule at all. The first step tells which rule was chosen.
    body = [step if known or step.atom.arg != "X" else Step(step.kind, step.atom.bound(0)) for step in steps]
    if body:
        body.insert(0, Step("do", Atom(f"{kind}-{head.name}", "X" if known else 0)))
    return Plain(kind, head, tests, tuple(body))  # type: ignore[arg-type]


PROGRAMS = st.tuples(*[rules(heads) for heads in HEADS]).flatmap(st.permutations)
STIMULI = st.lists(
    st.one_of(
        st.tuples(st.just("believe"), atoms("pqsr", (0, 1))),
        st.tuples(st.just("forget"), atoms("pqs", (0, 1))),
        st.tuples(st.just("achieve"), atoms("gh", (0, 1))),
        st.tuples(st.just("turns"), st.integers(1, 9)),
        st.tuples(st.just("seconds"), st.integers(1, 2)),
    ),
    min_size=3,
    max_size=10,
)


def literal(atom: Atom) -> Literal:
    arg = X if atom.arg == "X" else atom.arg
    return CLASSES[atom.name](arg) if atom.name in CLASSES else do(atom.name, arg)


def rule_of(plain: Plain) -> Rule:
    tests: list[object] = []
    for test in plain.tests:
        belief = literal(test.atom)
        assert isinstance(belief, Belief)
        tests.append(~belief if test.negated else belief)
    condition = conjunction(*tests) if tests else Conjunction(())
    return Event(CHANGES[plain.kind], literal(plain.head)) / condition >> [step_of(step) for step in plain.body]


def step_of(step: Step) -> object:
    if step.kind == "fail":
        return fail()
    if step.kind == "wait":
        return wait(step.atom.arg)
    made = literal(step.atom)
    if isinstance(made, Belief):
        return +made if step.kind == "add" else -made
    assert isinstance(made, (do, Goal))
    return made
