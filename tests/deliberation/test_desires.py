from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.deliberation.desires import DesireBase, DesireState, next_desire
from socialbot.deliberation.messages import Desire, Fact, FactCondition
from socialbot.deliberation.options import Policy
from tests.deliberation.domains import dnf, i
from tests.deliberation.office import job


def desire(name: str, priority: float = 0.5, deadline: float = 60.0, **more) -> Desire:
    return Desire(name=name, value=(Fact(name="clean", params=(name,)),), priority=priority, deadline=deadline, **more)


@pytest.fixture
def desires() -> DesireBase:
    return DesireBase()


def names(desires: DesireBase) -> list[str]:
    return [state.name for state in desires]


def about(desires: DesireBase, fact: Fact) -> list[str]:
    return list(dict.fromkeys(state.name for state, _ in desires.about(fact)))


def test_rank_is_priority_then_deadline_then_arrival(desires):
    for one in (
        desire("late", deadline=90),
        desire("first"),
        desire("urgent", priority=0.9, deadline=500),
        desire("second"),
        desire("soon", deadline=10),
    ):
        desires.add(one)
    assert names(desires) == ["urgent", "soon", "first", "second", "late"]


def test_of_one_name_there_is_one(desires):
    assert desires.add(desire("a"))
    assert desires.add(desire("a", priority=1.0)) is None
    assert [state.desire.priority for state in desires] == [0.5]


def test_a_removed_desire_can_be_added_again(desires):
    state = desires.add(desire("a"))
    assert desires.remove(state)
    assert not desires.remove(state)
    assert len(desires) == 0
    assert not about(desires, Fact(name="clean", params=("a",)))
    again = desires.add(desire("a"))
    assert not desires.remove(state), "another desire of the same name"
    assert desires.get("a") is again


def test_a_desire_is_found_by_all_that_decides_whether_it_is_fulfilled_or_pursued(desires):
    awake, dry = (dnf([("T", Fact(name=name))]) for name in ("awake", "dry"))
    wants = FactCondition(condition_to_check=Fact(name="battery", pddl_type=3, value=20), check="GR")
    desires.add(desire("a", precondition=awake, conditions=(wants,), context=dry))
    clean_a = Fact(name="clean", params=("a",))
    for changed in (clean_a, Fact(name="battery", pddl_type=3, value=7), Fact(name="awake"), Fact(name="dry")):
        assert about(desires, changed) == ["a"]
    for changed in (Fact(name="a"), Fact(name="clean", params=("b",)), Fact(name="battery"), i("a", "room")):
        assert about(desires, changed) == []


def test_only_the_facts_of_its_conditions_may_fulfil_a_desire(desires):
    dirty = FactCondition(condition_to_check=Fact(name="dirty", params=("hall",)), check="F")
    desires.add(desire("a", precondition=dnf([("T", Fact(name="awake"))]), conditions=(dirty,)))
    wanted = (Fact(name="clean", params=("a",)), Fact(name="dirty", params=("hall",)), i("hall", "room"))
    assert all(fulfils for changed in wanted for _, fulfils in desires.about(changed))
    assert [fulfils for _, fulfils in desires.about(Fact(name="awake"))] == [False]
    desires.add(desire("b", precondition=dnf([("T", Fact(name="clean", params=("b",)))])))
    assert [fulfils for _, fulfils in desires.about(Fact(name="clean", params=("b",)))] == [True], "it needs it, too"


@pytest.mark.parametrize(
    ("check", "condition", "wakes", "leaves"),
    [
        ("T", Fact(name="in", params=("box_*", "base")), Fact(name="in", params=("box_a", "x")), Fact(name="on")),
        ("T", Fact(name="carrier_*", params=("c",)), Fact(name="carrier_in", params=("d",)), i("carrier_a")),
        ("EX", i("{x}", "box"), i("anything", "box"), Fact(name="in", params=("x",))),
        ("EX", i("box_a", "box"), i("box_a", "box"), i("box_b", "box")),
        ("F", Fact(name="wet", params=("{x}",)), i("a_new_one", "box"), Fact(name="dry", params=("x",))),
        ("F", Fact(name="wet", params=("{x}",)), Fact(name="wet", params=("y",)), Fact(name="wet", pddl_type=3)),
    ],
)
def test_patterns_and_variables_wake_it_whatever_they_may_stand_for(desires, check, condition, wakes, leaves):
    desires.add(desire("a", precondition=dnf([(check, condition)])))
    assert about(desires, wakes) == ["a"]
    assert about(desires, leaves) == []


def test_a_shorter_deadline_outranks_only_if_it_is_strictly_shorter(desires):
    same, twin, soon, high = (
        desires.add(one)
        for one in (desire("same"), desire("twin"), desire("soon", deadline=59.9), desire("high", 0.6, 600.0))
    )
    assert not same.outranks(twin)
    assert not twin.outranks(same)
    assert soon.outranks(same)
    assert high.outranks(soon)
    assert not soon.outranks(high)


def test_the_preparations_of_a_desire_are_its_children(desires):
    desires.add(desire("a"))
    child = desires.add(desire("b", parent="a"))
    assert desires.children("a") == (child,)
    assert desires.children("b") == ()


@given(st.lists(st.tuples(st.sampled_from("abcdef"), st.sampled_from([0.1, 0.5]), st.sampled_from([5.0, 9.0]))))
def test_random_changes_keep_the_order(moves):
    desires, model = DesireBase(), {}
    for number, (name, priority, deadline) in enumerate(moves):
        if name in model:
            state = desires.get(name)
            assert state is not None
            desires.remove(state)
            del model[name]
        else:
            desires.add(desire(name, priority, deadline))
            model[name] = (-priority, deadline, number)
    assert names(desires) == sorted(model, key=model.__getitem__)
    assert {state.name for state in desires if about(desires, state.desire.value[0])} == set(model)


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
