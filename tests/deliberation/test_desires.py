from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.deliberation.desires import DesireBase
from socialbot.deliberation.messages import Desire, Fact, FactCondition
from tests.deliberation.domains import dnf, i


def desire(name: str, priority: float = 0.5, deadline: float = 60.0, **more) -> Desire:
    return Desire(name=name, value=(Fact(name="clean", params=(name,)),), priority=priority, deadline=deadline, **more)


@pytest.fixture
def desires() -> DesireBase:
    return DesireBase()


def names(desires: DesireBase) -> list[str]:
    return [state.name for state in desires]


def about(desires: DesireBase, fact: Fact) -> list[str]:
    return list(dict.fromkeys(state.name for state in desires.about(fact)))


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
def test_whatever_comes_and_goes_the_order_stays(moves):
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
