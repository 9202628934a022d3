from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Belief, Variable
from socialbot.bdi.beliefs import BeliefBase, Held
from socialbot.bdi.literals import Conjunction, Negation, conjunction
from tests.bdi.lab import X, Y, mood, p, q

NAMES = st.sampled_from(("X", "Y", "_"))
NUMBERS = st.integers(0, 2)
GROUND = st.builds(lambda kind, args: kind(*args), st.sampled_from((p, q)), st.lists(NUMBERS, max_size=2))
PATTERN = st.builds(
    lambda kind, args: kind(*args), st.sampled_from((p, q)), st.lists(NUMBERS | NAMES.map(Variable), max_size=2)
)
CONDITION = st.lists(PATTERN | PATTERN.map(Negation), max_size=3).map(lambda terms: conjunction(*terms))
CHANGES = st.lists(st.tuples(st.booleans(), GROUND), max_size=12)


def held(belief: Belief) -> Held:
    return Held(belief, "test", 0, "r")


def base_of(*beliefs: Belief) -> BeliefBase:
    base = BeliefBase()
    for belief in beliefs:
        base.add(held(belief))
    return base


def changed(changes) -> tuple[BeliefBase, list[Belief]]:
    """The same changes made to a belief base and to a plain list."""
    base, model = BeliefBase(), []
    for add, belief in changes:
        assert (belief in base) == (belief in model)
        if add and belief not in model:
            base.add(held(belief))
            model.append(belief)
        elif not add and belief in model:
            base.remove(belief)
            model.remove(belief)
    return base, model


def matches(model: list[Belief], pattern: Belief, bindings: dict) -> list[dict]:
    """All ways in which ``pattern`` equals a belief of the list, in its order."""
    found = []
    for belief in model:
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
            answers = [answer for answer in answers if not matches(model, term.belief, answer)]
        elif isinstance(term, Belief):
            answers = [longer for answer in answers for longer in matches(model, term, answer)]
    return answers


@settings(deadline=None)
@given(CHANGES, GROUND)
def test_the_base_holds_what_was_added_and_not_removed(changes, belief):
    base, model = changed(changes)
    assert {entry.belief for entry in base} == set(model)
    assert (belief in base) == (belief in model)
    entry = base.get(belief)
    assert (entry and entry.belief) == (belief if belief in model else None)


@settings(deadline=None, max_examples=200)
@given(CHANGES, PATTERN)
def test_a_pattern_matches_as_in_a_plain_list_and_in_its_order(changes, pattern):
    base, model = changed(changes)
    assert [bindings for _, bindings in base.match(pattern, {})] == matches(model, pattern, {})


@settings(deadline=None, max_examples=300)
@given(CHANGES, CONDITION)
def test_a_condition_is_solved_as_in_a_plain_list_and_in_its_order(changes, condition):
    base, model = changed(changes)
    assert list(base.solve(condition, {})) == solutions(model, condition)


def test_a_query_sees_the_beliefs_as_they_were_when_it_was_asked():
    base = base_of(p(1), p(2), p(3))
    seen = []
    for entry, _ in base.match(p(X), {}):
        seen.append(entry.belief)
        base.add(held(p(len(seen) + 10)))
        if p(2) in base:
            base.remove(p(2))
    assert seen == [p(1), p(2), p(3)]
    assert {entry.belief for entry in base} == {p(1), p(3), p(11), p(12), p(13)}


def test_beliefs_may_change_while_they_are_looked_through():
    base = base_of(p(1), p(2), q(1))
    for entry in base:
        base.remove(entry.belief)
    assert not list(base)


def test_the_number_of_arguments_is_part_of_what_is_believed():
    base = base_of(p(), p(1))
    assert p() in base
    assert p(1, 2) not in base
    assert [entry.belief for entry, _ in base.match(p(X), {})] == [p(1)]


def test_the_others_of_a_name_are_those_with_other_arguments():
    base = base_of(mood("glad"), mood("glad", 3), p("sad"))
    assert [entry.belief for entry in base.others(mood("sad"))] == [mood("glad"), mood("glad", 3)]
    assert [entry.belief for entry in base.others(mood("glad"))] == [mood("glad", 3)]


def test_a_join_follows_the_values_of_its_variables():
    base = base_of(p(1, 2), p(2, 3), p(3, 1), p(2, 5))
    joined = p(X, Y) & p(Y, Variable("Z"))
    assert [tuple(answer[name] for name in "XYZ") for answer in base.solve(joined, {})] == [
        (1, 2, 3), (1, 2, 5), (2, 3, 1), (3, 1, 2),
    ]  # fmt: skip


def test_a_belief_that_is_no_number_is_found_again():
    nan = float("nan")
    assert [entry.belief for entry, _ in base_of(p(nan)).match(p(X), {})] == [p(nan)]
