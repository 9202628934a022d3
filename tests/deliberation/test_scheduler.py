from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from socialbot.deliberation.desires import DesireBase, DesireState, next_desire
from socialbot.deliberation.options import Policy
from tests.deliberation.office import job


def ranked(*desires, blocked=(), not_before=None) -> list[DesireState]:
    found = DesireBase()
    for desire in desires:
        state = found.add(desire)
        assert state is not None
        state.blocked = desire.name in blocked
        state.not_before = (not_before or {}).get(desire.name, 0)
    return list(found)


def turn(states: list[DesireState], pursued: str = "", policy: Policy = "NO_PREEMPT", now: int = 0) -> str | None:
    pursuing = next((state for state in states if state.name == pursued), None)
    state = next_desire(states, pursuing, policy, lambda state: state.not_before <= now)
    return None if state is None else state.name


def test_the_highest_priority_has_its_turn_first():
    assert turn(ranked(job("a", 0.4), job("b", 0.6), job("c", 0.5))) == "b"


def test_equal_priorities_are_ordered_by_deadline_then_arrival():
    assert turn(ranked(job("a", deadline=30), job("b", deadline=20), job("c", deadline=20))) == "b"


def test_blocked_and_just_failed_desires_are_skipped():
    states = ranked(job("a", 0.9), job("b", 0.8), job("c", 0.1), blocked="a", not_before={"b": 5})
    assert turn(states, now=4) == "c"
    assert turn(states, now=5) == "b"


def test_without_preemption_the_pursued_desire_continues():
    assert turn(ranked(job("a", 0.1), job("b", 1.0)), pursued="a") is None


def test_a_higher_priority_preempts():
    assert turn(ranked(job("a", 0.1, 5), job("b", 0.2, 500)), "a", "PREEMPT") == "b"


def test_an_equal_priority_preempts_only_with_a_strictly_shorter_deadline():
    states = ranked(job("a", deadline=30), job("b", deadline=30), job("c", deadline=29.9))
    assert turn(states, "a", "PREEMPT") == "c"
    assert turn(states, "c", "PREEMPT") is None
    assert turn(states[1:], "b", "PREEMPT") is None


def test_a_desire_that_may_not_preempt_leaves_its_turn_to_the_next():
    states = ranked(job("a", 0.1), job("b", 0.9), job("c", 0.5), blocked="b")
    assert turn(states, "a", "PREEMPT") == "c"


def test_a_fruitless_preemption_is_not_repeated():
    states = ranked(job("a", 0.1), job("b", 0.9), job("c", 0.5))
    best, middle, low = states
    best.never_preempts.append(low)
    assert turn(states, "a", "PREEMPT") == "c"
    assert turn(states, "c", "PREEMPT") == "b", "but others"
    assert turn(states) == "b", "and has its turn when nobody is pursued"
    assert middle.never_preempts == []


@given(
    st.lists(st.tuples(st.sampled_from([0.2, 0.5]), st.sampled_from([5.0, 9.0]), st.booleans()), max_size=6),
    st.integers(0, 5),
)
def test_the_next_desire_is_the_best_of_all_candidates(desires, number):
    names = "abcdef"
    blocked = {names[index] for index, (_, _, blocked) in enumerate(desires) if blocked}
    states = ranked(*(job(names[index], *about[:2]) for index, about in enumerate(desires)), blocked=blocked)
    pursued = next((state for state in states if state.name == names[number]), None)
    chosen = next_desire(states, pursued, "PREEMPT", lambda state: True)
    able = [state for state in states if not state.blocked and (pursued is None or state.outranks(pursued))]
    assert chosen is min(able, key=lambda state: state.rank, default=None)
