from __future__ import annotations

import copy
import pickle
import sys
from random import Random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import socialbot.bdi
from socialbot.bdi import Atom, Belief, Engine, Variable, _relations, source
from socialbot.bdi._relations import Index, choices
from socialbot.bdi.literals import MOST_SOURCES, PERCEPT, SELF, SOURCES, literal, source_notes
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.terms import Conjunction, Cons, Negation, conjunction
from socialbot.bdi.unification import Var, resolve, undo, unify
from socialbot.core.clock import ManualClock
from tests.bdi.lab import Lab, X, Y, Z, _, do, mood, p, q

NAMES = st.sampled_from(("X", "Y", "_"))
NUMBERS = st.integers(0, 2)
GROUND = st.builds(lambda kind, args: kind(*args), st.sampled_from((p, q)), st.lists(NUMBERS, max_size=2))
PATTERN = st.builds(
    lambda kind, args: kind(*args), st.sampled_from((p, q)), st.lists(NUMBERS | NAMES.map(Variable), max_size=2)
)
CONDITION = st.lists(PATTERN | PATTERN.map(Negation), max_size=3).map(lambda terms: conjunction(*terms))
CHANGES = st.lists(st.tuples(st.booleans(), GROUND), max_size=12)
FACTS = st.lists(st.tuples(st.booleans(), st.tuples(NUMBERS, NUMBERS, NUMBERS)), max_size=15)


def agent(*beliefs: Belief) -> Engine:
    engine = Engine("base", ManualClock())
    for belief in beliefs:
        engine.believe(belief)
        engine.run_until_idle()
    return engine


def changed(changes) -> tuple[Engine, list[Belief]]:
    """The same changes made to the beliefs of an agent and to a plain list."""
    engine, model = agent(), []
    for add, belief in changes:
        assert (belief in engine.beliefs) == (belief in model)
        (engine.believe if add else engine.forget)(belief)
        engine.run_until_idle()
        if add and belief not in model:
            model.append(belief)
        elif not add and belief in model:
            model.remove(belief)
    return engine, model


def matches(model: list[Belief], pattern: Belief, bindings: dict) -> list[dict]:
    """All ways in which ``pattern`` equals a belief of the list, the newest first."""
    found = []
    for belief in reversed(model):
        if (belief.functor, len(belief.args)) != (pattern.functor, len(pattern.args)):
            continue
        extended: dict | None = dict(bindings)
        for part, value in zip(pattern.args, belief.args, strict=True):
            name = part.name if isinstance(part, Variable) else None
            if extended is not None and name != "_":
                wanted = part if name is None else extended.setdefault(name, value)
                extended = extended if wanted == value else None
        if extended is not None:
            found.append(extended)
    return found


def solutions(model: list[Belief], condition: Conjunction) -> list[dict]:
    answers: list[dict] = [{}]
    for term in condition.terms:
        if isinstance(term, Negation):
            answers = [answer for answer in answers if not matches(model, term.condition, answer)]  # type: ignore[arg-type]
        elif isinstance(term, Belief):
            answers = [longer for answer in answers for longer in matches(model, term, answer)]
    return answers


@settings(deadline=None)
@given(CHANGES, GROUND)
def test_belief_base_holds_added_and_not_removed_beliefs(changes, belief):
    engine, model = changed(changes)
    assert [held.belief for held in engine.beliefs if held.belief.key == belief.key] == [
        held for held in model if held.key == belief.key
    ]
    assert len(engine.beliefs) == len(model)
    assert (belief in engine.beliefs) == (belief in model)
    entry = engine.beliefs.get(belief)
    assert (entry and entry.belief) == (belief if belief in model else None)


@settings(deadline=None, max_examples=200)
@given(CHANGES, PATTERN)
def test_a_pattern_matches_as_in_a_plain_list_with_the_newest_first(changes, pattern):
    engine, model = changed(changes)
    assert list(engine.query(pattern)) == matches(model, pattern, {})


@settings(deadline=None, max_examples=300)
@given(CHANGES, CONDITION)
def test_a_condition_is_solved_as_in_a_plain_list_with_the_newest_first(changes, condition):
    engine, model = changed(changes)
    assert list(engine.query(condition)) == solutions(model, condition)


@settings(deadline=None, max_examples=200)
@given(FACTS, st.tuples(*[NUMBERS | st.none()] * 3), st.sets(st.sampled_from(((0,), (1,), (0, 2), (1, 2)))))
def test_an_index_finds_what_a_scan_finds(changes, wanted, before):
    engine, facts = agent(), []
    relation = engine.beliefs.relation("p/3")
    for positions in before:
        relation.index(positions)
    for add, args in changes:
        (engine.believe if add else engine.forget)(p(*args))
        engine.run_until_idle()
        if add and args not in facts:
            facts.append(args)
        elif not add and args in facts:
            facts.remove(args)
    pattern = tuple(Var() if part is None else part for part in wanted)
    expected = [args for args in reversed(facts) if all(w in (None, a) for w, a in zip(wanted, args, strict=True))]
    assert relation.candidates(pattern) == list(relation.match(pattern, (), [])) == expected
    for positions, index in relation.indexes.items():
        assert isinstance(index, Index)
        entered = {args: None for bucket in index.table.values() for args in bucket}
        assert sorted(entered) == sorted(facts)
        assert all(index.table.values()), f"an empty bucket is left at {positions}"


@settings(deadline=None)
@given(FACTS, st.integers(0, 14))
def test_bindings_last_until_the_next_match_and_no_longer(changes, enough):
    relation = agent(*(p(*args) for add, args in changes if add)).beliefs.relation("p/3")
    first, second, trail = Var("A"), Var("B"), []
    for count, found in enumerate(relation.match((first, 1, second), (), trail)):
        assert resolve((first, 1, second)) == found
        if count == enough:
            return
    assert trail == []
    assert first.value is first


def test_annotations_are_matched_in_all_ways_and_the_newest_belief_first():
    engine = agent(p(1), p(2))
    engine.believe(p(1), source="bob")
    engine.run_until_idle()
    says = p(X)[source(Y)]
    assert list(engine.query(says)) == [
        {"X": 2, "Y": "self"}, {"X": 1, "Y": "bob"}, {"X": 1, "Y": "self"},
    ]  # fmt: skip
    assert list(engine.query(p(X)[source(Atom("bob"))])) == [{"X": 1}]
    assert list(engine.query(p(X)[source("ann")])) == []
    (held, _) = sorted(engine.beliefs, key=lambda held: str(held.belief))
    assert held.source == "self,bob"


def test_each_choice_of_annotations_is_taken_back_before_the_next():
    first, second, trail = Var(), Var(), []
    held = (source(1), source(2))
    found = [resolve((first, second)) for _ in choices((source(first), source(second)), held, trail)]
    assert found == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert trail == []


def test_a_query_sees_the_beliefs_as_they_were_when_it_was_asked():
    engine = agent(p(1), p(2), p(3))
    seen = []
    for answer in engine.query(p(X)):
        seen.append(answer["X"])
        engine.believe(p(len(seen) + 10))
        engine.forget(p(2))
        engine.run_until_idle()
    assert seen == [3, 2, 1]
    assert {held.belief for held in engine.beliefs} == {p(1), p(3), p(11), p(12), p(13)}


def test_beliefs_may_change_while_they_are_looked_through():
    engine = agent(p(1), p(2), q(1))
    for held in engine.beliefs:
        assert isinstance(held.belief, Belief)
        engine.forget(held.belief)
        engine.run_until_idle()
    assert not list(engine.beliefs)


def test_belief_without_a_class_is_an_event_and_is_found_by_its_name():
    returned = socialbot.bdi.literal("total-returned", (X,))
    lab = Lab(+returned >> [do(X)])
    lab.tell(+socialbot.bdi.literal("total-returned", (3,)))
    assert (lab.done, list(lab.engine.query(returned))) == ([3], [{"X": 3}])


def test_arity_is_part_of_a_belief():
    engine = agent(p(), p(1))
    assert p() in engine.beliefs
    assert p(1, 2) not in engine.beliefs
    assert list(engine.query(p(X))) == [{"X": 1}]


def test_a_singleton_has_no_others_of_its_name():
    engine = agent(mood("glad"), p("sad"), mood("glad", 3))
    assert [held.belief for held in engine.beliefs] == [p("sad"), mood("glad", 3)]


def test_a_join_follows_the_values_of_its_variables():
    engine = agent(p(1, 2), p(2, 3), p(3, 1), p(2, 5))
    assert [tuple(answer[name] for name in "XYZ") for answer in engine.query(p(X, Y) & p(Y, Z))] == [
        (3, 1, 2), (2, 3, 1), (1, 2, 5), (1, 2, 3),
    ]  # fmt: skip


def test_a_belief_that_is_no_number_is_found_again():
    nan = float("nan")
    engine = agent(p(nan))
    assert [answer["X"] is nan for answer in engine.query(p(X))] == [True]
    assert p(nan) in engine.beliefs


def test_a_query_tells_the_values_of_its_variables_only():
    lab = Lab()
    lab.tell(+p(1), +q(1, 2))
    assert list(lab.engine.query(p(X) & ~q(X, 9) & (X > 0))) == [{"X": 1}]
    assert list(lab.engine.query(p(1))) == [{}]
    assert list(lab.engine.query(p(2))) == []


def test_a_belief_of_many_sources_keeps_each_once():
    lab = Lab(+p(X)[source(Y)] >> [do(Y)])
    engine, names = lab.engine, [f"s{i % 40}" for i in range(100)]
    for name in names:
        engine.believe(p(1), source=name)
        engine.run_until_idle()
    (held,) = engine.beliefs
    assert sorted(held.sources) == sorted(set(names))
    relation = engine.beliefs.relation("p/1")
    engine.beliefs.remove(relation, (1,), (source(Atom("s7")),), "", here=False)
    for name in ("s7", "s8", "s50"):
        engine.believe(p(1), source=name)
        engine.run_until_idle()
    (held,) = engine.beliefs
    assert sorted(held.sources) == sorted({*names, "s50"})
    assert [str(name) for name in lab.done] == [*dict.fromkeys(names), "s7", "s50"]
    engine.forget(p(1))
    engine.believe(p(1), source="s3")
    engine.run_until_idle()
    (held,) = engine.beliefs
    assert held.sources == ("s3",)


NOTES = ("source(a)", "source(b)", "source(c)", "source(d)", "source(e)", "source(a)[source(b)]", "x(1)", "x(2)", "y")
NOTED = st.lists(st.sampled_from(NOTES), min_size=1, max_size=3)
NOTE_CHANGES = st.lists(st.tuples(st.sampled_from("+-?"), NOTED), max_size=20)


def noted(changes: list[tuple[str, list[str]]], many: int) -> tuple[list[str], set[str]]:
    """Actions of an agent whose belief gets, loses and is asked for annotations, and its annotations at the end."""
    engine, done = Engine("base", ManualClock()), []
    engine.add_action(lambda _engine, *what: done.append(str(what)), "say")
    engine.add_text("+hot(1)[source(S)] <- say(S). -hot(1)[source(S)] <- say(no, S).")
    for number, (sign, notes) in enumerate(changes):
        belief, ask = f"hot(1)[{', '.join(notes)}]", ".findall(S, hot(1)[source(S)], L); say(L)"
        body = f"{sign}{belief}" if sign != "?" else ask
        condition = f" : {belief}" if sign == "?" else ""
        engine.add_text(f"+!step{number}{condition} <- {body}. +!step{number}. !step{number}.")
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(_relations, "MANY_ANNOTATIONS", many)
            while engine.run_until_idle():
                pass
    return done, {str(note) for _, held, _ in engine.beliefs.relation("hot/1").facts.values() for note in held}


@given(NOTE_CHANGES)
@example([("+", ["source(a)", "source(a)[source(b)]", "source(c)"]), ("-", ["source(a)"]), ("?", ["source(a)"])])
@settings(max_examples=50)
def test_a_belief_with_many_annotations_changes_as_one_with_few(changes):
    assert noted(changes, many=2) == noted(changes, many=1000)


def test_there_is_one_object_for_the_source_of_a_name():
    (bob,), (same,), (ann,) = map(source_notes, ("bob", Atom("bob"), "ann"))
    assert bob is same is copy.copy(bob) is pickle.loads(pickle.dumps(bob))
    assert bob == source("bob") == bob != ann
    assert hash(bob) == hash(source("bob"))
    nested = bob.with_(annotations=(ann,))
    assert (str(nested), str(nested.with_(annotations=()))) == ("source(bob)[source(ann)]", "source(bob)")
    assert nested != bob != nested


def test_names_of_sources_do_not_fill_the_memory():
    """Each message may come from another agent; a belief keeps its source, whose name may be forgotten meanwhile."""
    engine = Engine("base", ManualClock())
    engine.believe(literal("hot", (1,)), source="first")
    engine.run_until_idle()
    (first,) = source_notes("first")
    for number in range(MOST_SOURCES):
        source_notes(f"s{number}")
    assert len(SOURCES) <= MOST_SOURCES
    (again,) = source_notes("first")
    assert again is not first
    assert again == first
    assert hash(again) == hash(first)
    assert again != source_notes("s1")[0]
    assert source_notes("self") is SELF
    assert source_notes(Atom("percept")) is PERCEPT
    engine.believe(literal("hot", (1,)), source="first")
    engine.run_until_idle()
    ((_, held, _),) = engine.beliefs.relation("hot/1").facts.values()
    assert held == (again,)


@pytest.mark.parametrize("change", ["-hot(1)[source(s7)]", "?hot(1)[source(s7)]", "+hot(1)[source(new)]"])
def test_a_change_of_one_source_takes_as_many_calls_for_any_number_of_others(change):
    def calls(number: int) -> int:
        engine, counts = Engine("base", ManualClock()), []
        engine.add_text(f"+!change <- {change}.")
        for i in range(number):
            engine.believe(literal("hot", (1,)), source=f"s{i}")
        for _turn in range(2):  # the first time compiles the plan
            engine.believe(literal("hot", (1,)), source="s7")
            engine.run_until_idle()
            engine.achieve(literal("change"))
            counts.append(0)
            sys.setprofile(lambda *_: counts.append(counts.pop() + 1))
            try:
                engine.run_until_idle()
            finally:
                sys.setprofile(None)
        return counts[-1]

    assert calls(400) == calls(40)


def f(*args):
    return literal("f", args)


A = Atom("a")
T = Variable("T")
NESTED = [0, 1, A, f(0), f(1), f(0, 1), f(1, 1), f(f(0), 1), f(f(1), A), (), (0,), (0, 1), (1, 1, 0), (f(0), 1), f(A)]
PATTERNS = [
    X, Y, Z, 0, A, f(X), f(Y), f(0), f(X, Y), f(X, X), f(Y, 1), f(0, Y), f(f(X), Y), f(f(0), Y), f(f(Y), A), (), (X,),
    (0, Y), (X, Y), (f(Y), 1), Cons((0,), T), Cons((X,), T), Cons((X, 1), T), f(Cons((0,), T)), _, f(_), f(_, 1),
    (_, 1), Cons((f(X),), _),
]  # fmt: skip


def naive_query(facts, terms, bound):
    """Solve conditions one after the other by unification with each fact, the newest first."""
    if not terms:
        yield {name: resolve(variable) for name, variable in bound.items()}
        return
    pattern, negated = (terms[0].condition, True) if isinstance(terms[0], Negation) else (terms[0], False)
    notes, found, trail = opened(pattern.annotations, bound), False, []
    args = opened(pattern.args, bound if not negated else dict(bound))
    for fact, held in reversed(facts):
        if unify(args, fact, trail):
            for _choice in choices(notes, held, trail):
                found = True
                if not negated:
                    yield from naive_query(facts, terms[1:], bound)
        undo(trail, 0)
    if negated and not found:
        yield from naive_query(facts, terms[1:], bound)


def test_nested_terms_and_annotations_are_found_as_by_a_scan():
    sources = (SELF, (source(A),), (source(A), source(Atom("b"))))
    hits = 0
    for seed in range(400):
        random = Random(seed)
        facts = {tuple(random.choices(NESTED, k=2)): random.choice(sources) for _fact in range(30)}
        engine = agent()
        for args, notes in facts.items():
            engine.beliefs.add(engine.beliefs.relation("q/2"), args, notes, "")
        for _removal in range(3):
            gone = random.choice(list(facts))
            del facts[gone]
            engine.forget(q(*gone))
        engine.run_until_idle()
        terms: list[Any] = [q(*random.choices(PATTERNS, k=2)) for _term in range(random.choice((1, 2, 3)))]
        if random.random() < 0.3:
            terms[0] = terms[0][source(random.choice((A, Z, _)))]
        if random.random() < 0.5:
            terms[-1] = Negation(terms[-1])
        names = set().union(*(term.names() for term in terms if not isinstance(term, Negation))) - {"_"}
        expected = [
            {name: value for name, value in solution.items() if name in names}
            for solution in naive_query(list(facts.items()), terms, {})
        ]
        assert list(engine.query(conjunction(*terms))) == expected, (seed, terms)
        hits += bool(expected)
    assert hits > 100
