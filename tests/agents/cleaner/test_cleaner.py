from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from socialbot.agents.cleaner.cleaner import Sweeper
from socialbot.deliberation.files import load_beliefs, load_desires
from socialbot.deliberation.messages import FLUENT, Desire, DesireItem, Fact
from socialbot.deliberation.sensing import predicate
from tests.agents.brief import believing, domain_of, plan_for, settled
from tests.agents.cleaner.watching import Watched

ROOMS = ("bathroom", "bedroom", "dock", "kitchen")


def test_cleans_all_rooms_in_time():
    watched = Watched("cleaner")
    watched.until(60)
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
    watched.until(60)
    begun, ended = watched.told("step"), watched.told("step_end")
    assert [what for _, what in begun] == [what for _, what in ended]
    assert {round(end - begin, 3) for (begin, _), (end, _) in zip(begun, ended, strict=True)} == {4.0}
    assert watched.names("step").count("(recharge cleaner dock)") == 1


def test_running_plan_causes_no_precondition_desire():
    watched = Watched("cleaner")
    watched.until(60)
    assert watched.names("desire") == [
        "clean_rooms",
        "clean_rooms_fulfill_precondition0",
        "clean_rooms_fulfill_precondition1",
        "go_recharge",
    ]


def test_preemption_charges_first_and_cleans_afterwards():
    watched = Watched("cleaner", cleaner={"reschedule_policy": "PREEMPT"})
    watched.until(20)
    # Given up on its way to the kitchen, it knows no longer where it is.
    assert "(movetoward cleaner undefined_wp dock)" in watched.names("step")
    watched.until(120)
    fulfilled = watched.names("desire_fulfilled")
    assert fulfilled.index("go_recharge") < fulfilled.index("clean_rooms")
    assert not [what for what in watched.facts("cleaner") if "undefined_wp" in what and what.startswith("(in")]
    assert watched.names("desire_dropped").count("clean_rooms") == 0


def test_fulfils_a_desire_received_by_topic():
    watched = Watched("cleaner")
    watched.until(2)
    rest = Desire(name="rest", value=(predicate("rested", "cleaner"),), priority=0.3, deadline=10.0)
    watched.send("/cleaner/add_desire", DesireItem(stamp=watched.clock.now(), desire=rest))
    watched.until(60)
    assert watched.names("desire_fulfilled")[-2:] == ["clean_rooms", "rest"]


@pytest.mark.parametrize("parameter", ["init_bset", "init_dset", "init_reactive_rules_set", "pddl_file"])
def test_missing_file_is_named_in_the_error(parameter):
    with pytest.raises(Exception, match=r"nowhere\.yaml"):
        Watched("cleaner", cleaner={parameter: "nowhere.yaml"})


def test_sweeper_sweeps_before_cleaner_cleans():
    watched = Watched("cleaner-sweeper")
    watched.until(60)
    assert watched.told("desire_fulfilled", "sweeper") == [(10.0, "sweep_kitchen"), (20.0, "sweep_bedroom")]
    assert watched.told("desire_fulfilled") == [(36.0, "clean_rooms")]
    swept = {what: time for time, what in watched.told("step_end", "sweeper")}
    for room in ("kitchen", "bedroom"):
        cleaned = next(time for time, what in watched.told("step") if what == f"(doclean cleaner {room})")
        assert cleaned >= swept[f"(dosweep sweeper {room})"]


def test_requested_priority_is_within_the_limit():
    watched = Watched("cleaner-sweeper", sweeper={"desire_pr": "0.25"})
    watched.until(1)
    assert [wish.desire.priority for wish in watched.agent("sweeper").deliberator.desires] == [0.25, 0.25]


def test_refusal_of_sweeper_fails_the_action_with_its_reason():
    deaf: dict[str, object] = {"desire_w": "", "desire_pr": ""}
    watched = Watched("cleaner-sweeper", sweeper=deaf, cleaner={"exec_plan_tries": 3})
    watched.until(60)
    assert watched.names("step", "sweeper") == []
    (dropped,) = [record for record in watched.records if record.kind == "desire_dropped"]
    assert dropped.what == "clean_rooms"
    assert "group 'cleaners' may not add desires" in dropped.detail["reason"]


def test_missing_reply_of_sweeper_fails_the_action(monkeypatch):
    monkeypatch.setattr(Sweeper, "on_request", lambda node, message: None)
    watched = Watched("cleaner-sweeper", cleaner={"exec_plan_tries": 2})
    watched.until(60)
    assert "sweeper: timeout" in watched.names("reply")
    (dropped,) = [record for record in watched.records if record.kind == "desire_dropped"]
    assert "no answer from sweeper in 2 s" in dropped.detail["reason"]


def test_cancelled_request_withdraws_its_desire():
    watched = Watched("cleaner-sweeper")
    watched.until(5)
    assert [wish.name for wish in watched.agent("sweeper").deliberator.desires] == ["sweep_kitchen", "sweep_bedroom"]
    given_up = Desire(name="clean_rooms", value=(predicate("cleaned", "kitchen"),))
    watched.send("/cleaner/del_desire", DesireItem(stamp=watched.clock.now(), desire=given_up))
    watched.until(10)
    assert len(watched.agent("sweeper").deliberator.desires) == 0
    assert watched.names("desire_dropped", "sweeper") == ["sweep_kitchen", "sweep_bedroom"]


FOLDER = Path(str(files("socialbot.agents.cleaner")))


def agent(name: str, domain: str):
    path = FOLDER / f"{domain}.pddl"
    return believing(path, load_beliefs(FOLDER / f"{name}_beliefs.yaml", domain_of(path)))


def test_plan_cleans_all_rooms_and_recharges():
    facts = agent("cleaner", "cleaner")
    (desire,) = load_desires(FOLDER / "cleaner_desires.yaml", facts.domain)
    assert not facts.satisfied(desire.precondition)
    facts.remove(Fact(name="in", params=("cleaner", "*")))
    facts.add(Fact(name="in", params=("cleaner", "bedroom")))
    assert facts.satisfied(desire.precondition)
    actions = [step.action for step in plan_for(facts, desire).steps]
    assert actions.count("doclean") == 4
    assert "recharge" in actions
    assert plan_for(facts, desire).makespan_s <= desire.deadline


def test_low_battery_causes_desire_to_recharge():
    facts = agent("cleaner", "cleaner")
    facts.add(Fact(name="fullcharged", params=("cleaner",)))
    assert settled(facts, FOLDER / "cleaner_rules.yaml") == ["DEL belief (fullcharged cleaner)"]
    facts.add(Fact(name="battery_charge", pddl_type=FLUENT, params=("cleaner",), value=30.0))
    assert "ADD desire go_recharge" in settled(facts, FOLDER / "cleaner_rules.yaml")
    go = Desire(name="go", value=(Fact(name="fullcharged", params=("cleaner",)),))
    facts.remove(Fact(name="in", params=("cleaner", "*")))
    facts.add(Fact(name="in", params=("cleaner", "kitchen")))
    assert [step.action for step in plan_for(facts, go).steps] == ["movetoward", "recharge"]


def test_dirt_causes_desire_to_clean():
    facts = agent("cleaner", "cleaner")
    facts.add(Fact(name="cleaned", params=("kitchen",)))
    facts.add(Fact(name="dirty", params=("kitchen",)))
    followed = settled(facts, FOLDER / "cleaner_rules.yaml")
    assert "ADD desire clean_kitchen" in followed
    assert "DEL belief (cleaned kitchen)" in followed


def test_plan_requests_both_rooms_at_once():
    facts = agent("team_cleaner", "team_cleaner")
    (desire,) = load_desires(FOLDER / "team_cleaner_desires.yaml", facts.domain)
    plan = plan_for(facts, desire)
    asked = [step for step in plan.steps if step.action == "asksweeping"]
    cleaned = [step for step in plan.steps if step.action == "doclean"]
    assert [step.start_s for step in asked] == [0.0, 0.0]
    assert min(step.start_s for step in cleaned) >= 20.0
    assert plan.makespan_s <= desire.deadline


def test_plan_of_sweeper_meets_the_deadline_of_the_cleaner():
    facts = agent("sweeper", "sweeper")
    rooms = Desire(name="both", value=tuple(Fact(name="swept", params=(room,)) for room in ("kitchen", "bedroom")))
    assert plan_for(facts, rooms).makespan_s <= 20.1
