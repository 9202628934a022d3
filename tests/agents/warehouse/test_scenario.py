from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.warehouse import scenario as cast
from socialbot.agents.warehouse.scenario import (
    SIX,
    carrier_beliefs,
    gripper_beliefs,
    gripper_desires,
    parse_faults,
    random_faults,
    scenario_of,
)
from socialbot.core.errors import ParameterError
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.files import load_beliefs, load_desires, load_rules
from socialbot.deliberation.messages import FLUENT, Desire, Fact, FactCondition
from tests.agents.brief import believing, domain_of, plan_for, settled


def test_demo_files_match_scenario_of_six_boxes():
    domain = domain_of(cast.GRIPPER_DOMAIN)
    assert load_beliefs(cast.FOLDER / "gripper_beliefs.yaml", domain) == gripper_beliefs(SIX)
    assert load_desires(cast.FOLDER / "gripper_desires.yaml", domain) == gripper_desires(SIX)
    domain = domain_of(cast.CARRIER_DOMAIN)
    for carrier in SIX.carriers:
        assert load_beliefs(cast.FOLDER / f"{carrier}_beliefs.yaml", domain) == carrier_beliefs(carrier)


def test_rule_files_and_light_desire_load():
    gripper, carrier = domain_of(cast.GRIPPER_DOMAIN), domain_of(cast.CARRIER_DOMAIN)
    assert len(load_desires(cast.FOLDER / "light_gripper_desires.yaml", gripper)) == 1
    assert [rule.name for rule in load_rules(cast.GRIPPER_RULES, gripper)] == ["free_bay", "box_in_bay"]
    for path in (cast.CARRIER_RULES, cast.HASTY_CARRIER_RULES):
        assert [rule.name for rule in load_rules(path, carrier)] == ["empty", "not_empty", "loaded", "sent_off"]


@pytest.mark.parametrize(("boxes", "carriers"), [(6, 3), (12, 3), (24, 6), (5, 2), (1, 1)])
def test_each_box_has_one_stack_and_one_carrier(boxes, carriers):
    found = scenario_of(boxes, carriers)
    assert len(found.boxes) == boxes
    assert sorted(box for load in found.loads for box in load) == list(found.boxes)
    assert max(map(len, found.stacks)) <= cast.STACK_HEIGHT
    assert found.stacks[-1] == ()
    sizes = Counter(map(len, found.loads))
    assert max(sizes) - min(sizes) <= 1
    assert found == scenario_of(boxes, carriers)


@pytest.mark.parametrize(("boxes", "carriers"), [(2, 3), (6, 0), (0, 0), (40, 27)])
def test_impossible_scenarios_are_rejected(boxes, carriers):
    with pytest.raises(ParameterError, match="1 to 26 carriers"):
        scenario_of(boxes, carriers)


def test_demo_plan_has_28_actions_and_107_s():
    plan = plan_for(believing(cast.GRIPPER_DOMAIN, gripper_beliefs(SIX)), gripper_desires(SIX)[0])
    assert Counter(step.action for step in plan.steps) == {
        "gripper_move": 13,
        "gripper_pickup": 6,
        "gripper_put_on_carrier": 6,
        "req_carrier_to_come": 3,
    }
    assert plan.makespan_s <= 107.1


@pytest.mark.parametrize(("boxes", "carriers", "trips"), [(12, 3, 3), (24, 6, 6)])
def test_carriers_return_for_more_boxes(boxes, carriers, trips):
    found = scenario_of(boxes, carriers)
    (desire,) = gripper_desires(found)
    plan = plan_for(believing(cast.GRIPPER_DOMAIN, gripper_beliefs(found)), desire)
    counts = Counter(step.action for step in plan.steps)
    assert counts["carrier_unloading"] >= trips
    assert counts["gripper_put_on_carrier"] == boxes
    assert plan.makespan_s <= desire.deadline


def test_light_desire_needs_one_carrier_and_one_putdown():
    facts = believing(cast.GRIPPER_DOMAIN, gripper_beliefs(SIX))
    (desire,) = load_desires(cast.FOLDER / "light_gripper_desires.yaml", facts.domain)
    counts = Counter(step.action for step in plan_for(facts, desire).steps)
    assert counts["req_carrier_to_come"] == counts["gripper_putdown"] == 1


def test_carriers_plan_to_come_and_to_unload():
    facts = believing(cast.CARRIER_DOMAIN, carrier_beliefs("carrier_b"))
    come = Fact(name="in", params=("carrier_b", "base"))
    plan = plan_for(facts, Desire(name="come", value=(come,)))
    assert [step.call for step in plan.steps] == ["(carrier_move carrier_b deposit base)"]
    facts.remove(Fact(name="in", params=("carrier_b", "*")))
    facts.add(come)
    for fact in boxes_of("carrier_b", 2):
        facts.add(fact)
    facts.add(Fact(name="lb_load_completed", params=("carrier_b",)))
    assert "ADD desire go_unload" in settled(facts, cast.CARRIER_RULES)
    unloaded = Fact(name="fully_unloaded", params=("carrier_b",))
    plan = plan_for(facts, Desire(name="go_unload", value=(unloaded,), deadline=16.0))
    assert [step.action for step in plan.steps] == ["carrier_move", "carrier_unload"]


def boxes_of(carrier: str, number: int) -> list[Fact]:
    return [Fact(name="moving_boxes", pddl_type=FLUENT, params=(carrier,), value=float(number))]


@pytest.mark.parametrize(("rules", "boxes", "leaves"), [
    (cast.CARRIER_RULES, 1, False), (cast.CARRIER_RULES, 2, True),
    (cast.HASTY_CARRIER_RULES, 0, False), (cast.HASTY_CARRIER_RULES, 1, True),
])  # fmt: skip
def test_carrier_leaves_with_two_boxes_or_one_if_hasty(rules, boxes, leaves):
    facts = believing(cast.CARRIER_DOMAIN, (*carrier_beliefs("carrier_c"), *boxes_of("carrier_c", boxes)))
    facts.add(Fact(name="lb_load_completed", params=("carrier_c",)))
    assert ("ADD desire go_unload" in settled(facts, rules)) is leaves
    assert holds(facts, "fully_loaded") is leaves
    assert holds(facts, "lb_load_completed") is not leaves
    assert holds(facts, "fully_unloaded") is (boxes == 0)


def holds(facts: FactBase, name: str) -> bool:
    return facts.check(FactCondition(condition_to_check=Fact(name=name, params=("carrier_c",))))


def test_bay_is_clear_without_carrier_and_box():
    facts = believing(cast.GRIPPER_DOMAIN, gripper_beliefs(SIX))
    settled(facts, cast.GRIPPER_RULES)
    facts.remove(Fact(name="clear", params=("base_?",)))
    facts.add(Fact(name="carrier_in_base", params=("carrier_a", "base_a")))
    facts.add(Fact(name="in", params=("box_b1", "base_b")))
    assert settled(facts, cast.GRIPPER_RULES) == ["ADD belief (clear base_c)"]


def test_bay_with_missed_box_is_not_clear():
    facts = believing(cast.GRIPPER_DOMAIN, gripper_beliefs(SIX))
    clear = FactCondition(condition_to_check=Fact(name="clear", params=("base_b",)))
    facts.add(Fact(name="in", params=("box_b1", "base_b")))
    assert "DEL belief (clear base_b)" in settled(facts, cast.GRIPPER_RULES)
    assert not facts.check(clear)
    facts.remove(Fact(name="in", params=("box_b1", "base_b")))
    settled(facts, cast.GRIPPER_RULES)
    assert facts.check(clear)


def test_faults_are_parsed_in_order():
    assert parse_faults("30 leaves carrier_c; 40.5 slips ; 50 silent boxes 10; 60 stalls gripper_a 3;", SIX) == (
        WorldFault(30.0, "leaves", "carrier_c"),
        WorldFault(40.5, "slips"),
        WorldFault(50.0, "silent", "boxes", 10.0),
        WorldFault(60.0, "stalls", "gripper_a", 3.0),
    )
    assert parse_faults("", SIX) == ()


@pytest.mark.parametrize(
    "text",
    ["30", "leaves carrier_c", "30 leaves carrier_d", "30 leaves gripper_a", "x slips", "-1 slips", "nan slips",
     "30 silent boxes", "30 silent box 3", "30 stalls boxes 3", "30 explodes", "30 stalls carrier_a inf"],
)  # fmt: skip
def test_invalid_fault_is_rejected_with_remedy(text):
    with pytest.raises(ParameterError, match="remedy: write faults as"):
        parse_faults(text, SIX)


@given(st.text("0123456789 ;silentcarrier_abgpoxes", max_size=40))
def test_any_text_is_parsed_or_rejected_and_formats_back(text):
    try:
        faults = parse_faults(text, SIX)
    except ParameterError:
        return
    assert parse_faults("; ".join(map(str, faults)), SIX) == faults


@pytest.mark.parametrize(
    "fault",
    [
        WorldFault(50.0, "silent", "boxes", 0.0),
        WorldFault(123456.789012, "slips"),
        WorldFault(0.1, "stalls", "carrier_a", 1e-7),
    ],
)
def test_formatted_fault_parses_to_itself(fault):
    assert parse_faults(str(fault), SIX) == (fault,)


def test_random_faults_depend_only_on_seed_and_format_back():
    kinds = set()
    for seed in range(50):
        faults = random_faults(seed, SIX)
        assert 1 <= len(faults) <= 4
        assert faults == random_faults(seed, SIX) == parse_faults("; ".join(map(str, faults)), SIX)
        assert [fault.time_s for fault in faults] == sorted(fault.time_s for fault in faults)
        kinds |= {fault.kind for fault in faults}
    assert kinds == {"leaves", "slips", "silent", "stalls"}
