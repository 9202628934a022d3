from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from socialbot.deliberation.files import load_beliefs, load_desires
from socialbot.deliberation.messages import FLUENT, Desire, Fact
from tests.agents.brief import believing, domain_of, plan_for, settled

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
