from __future__ import annotations

import pytest

from socialbot.deliberation.messages import Desire, DesireItem
from socialbot.deliberation.sensing import predicate
from tests.agents.cleaner.watching import Watched

ROOMS = ("bathroom", "bedroom", "dock", "kitchen")


def test_cleans_all_rooms_in_time():
    watched = Watched("cleaner")
    watched.run(60)
    assert watched.told("desire_fulfilled") == [
        (4.0, "clean_rooms_fulfill_precondition0"),
        (24.0, "go_recharge"),
        (40.0, "clean_rooms"),
    ]
    facts = watched.facts("cleaner")
    assert {f"(cleaned {room})" for room in ROOMS} <= set(facts)
    assert "(in cleaner dock)" in facts


def test_actions_have_the_durations_of_the_domain():
    watched = Watched("cleaner")
    watched.run(60)
    begun, ended = watched.told("step"), watched.told("step_end")
    assert [what for _, what in begun] == [what for _, what in ended]
    assert {round(end - begin, 3) for (begin, _), (end, _) in zip(begun, ended, strict=True)} == {4.0}
    assert watched.names("step").count("(recharge cleaner dock)") == 1


def test_running_plan_causes_no_precondition_desire():
    watched = Watched("cleaner")
    watched.run(60)
    assert watched.names("desire") == [
        "clean_rooms",
        "clean_rooms_fulfill_precondition0",
        "clean_rooms_fulfill_precondition1",
        "go_recharge",
    ]


def test_preemption_charges_first_and_cleans_afterwards():
    watched = Watched("cleaner", cleaner={"reschedule_policy": "PREEMPT"})
    watched.run(20)
    # Given up on its way to the kitchen, it knows no longer where it is.
    assert "(movetoward cleaner undefined_wp dock)" in watched.names("step")
    watched.run(120)
    fulfilled = watched.names("desire_fulfilled")
    assert fulfilled.index("go_recharge") < fulfilled.index("clean_rooms")
    assert not [what for what in watched.facts("cleaner") if "undefined_wp" in what and what.startswith("(in")]
    assert watched.names("desire_dropped").count("clean_rooms") == 0


def test_fulfils_a_desire_received_by_topic():
    watched = Watched("cleaner")
    watched.run(2)
    rest = Desire(name="rest", value=(predicate("rested", "cleaner"),), priority=0.3, deadline=10.0)
    watched.runner.feed("/cleaner/add_desire", DesireItem(stamp=watched.runner.clock.now(), desire=rest))
    watched.run(60)
    assert watched.names("desire_fulfilled")[-2:] == ["clean_rooms", "rest"]


@pytest.mark.parametrize("parameter", ["init_bset", "init_dset", "init_reactive_rules_set", "pddl_file"])
def test_missing_file_is_named_in_the_error(parameter):
    with pytest.raises(Exception, match=r"nowhere\.yaml"):
        Watched("cleaner", cleaner={parameter: "nowhere.yaml"})
