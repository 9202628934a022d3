from __future__ import annotations

import logging
from importlib import resources

import pytest

from socialbot.agents.hospital.robot_node import Nurse, Spot, Uvd
from socialbot.agents.hospital.ward.messages import CLOSED_DOOR, DIRTY_ROOM, LOW_BATTERY, PERSON_IN_ROOM
from socialbot.agents.teams.agent import REGISTER_S
from socialbot.agents.teams.messages import (
    Belief,
    End,
    Finished,
    InitialTrigger,
    Plan,
    Problem,
    Refusal,
    Register,
    Report,
    Start,
    Stop,
)
from socialbot.bdi.agentspeak.loading import check
from socialbot.bdi.agentspeak.parser import parse_literal
from socialbot.core.clock import SECOND, nanoseconds
from tests.agents.hospital.alone import CONSTANTS, Alone
from tests.agents.hospital.listings import ROOM, SPOT, UVD

LISTING_1 = """
+success_a_patrol_room(SpotRobot, NurseDisinfectRoom)
: start(NurseDisinfect, NurseDisinfectRoom,
    SpotRobot, UvdRobot) & milestone5
<-
-milestone5;
+milestone6;
.send(UvdRobot, tell, milestone5);
.send(UvdRobot, tell, trigger_a_authorize_disinfect(
    UvdRobot, SpotRobot));
!a_authorize_disinfect(UvdRobot, SpotRobot).
"""
LISTING_2 = """
+trigger_a_authorize_disinfect(UvdRobot, SpotRobot)
: start(NurseDisinfect, NurseDisinfectRoom,
    SpotRobot, UvdRobot)
<-
!a_authorize_disinfect(UvdRobot, SpotRobot).
"""


GO = (
    "+initial_trigger_a_navigate_to(S, R) : start(N, R, S, U) <- !a_navigate_to(S, R).",
    "+!a_navigate_to(S, R) : start(N, R, S, U) <- +milestone0; a_navigate_to(S, R).",
    "+success_a_navigate_to(S, R) : milestone0 <- -milestone0; end.",
)


def going(**parameters) -> Alone:
    spot = Alone(**parameters)
    spot.take_on(*GO)
    spot.tell(Belief(f"initial_trigger_a_navigate_to({SPOT}, {ROOM})"))
    return spot


@pytest.mark.parametrize("kind", ["spot", "uvd", "nurse"])
def test_programs_pass_the_checker(kind):
    text = resources.files("socialbot.agents.hospital").joinpath(f"{kind}.asl").read_text("utf-8")
    assert check(text, f"{kind}.asl") == []


@pytest.mark.parametrize(
    ("kind", "name", "can"),
    [
        (Spot, "spotrobot", "a_patrol_room"),
        (Uvd, "uvdrobot", "a_disinfect_room"),
        (Nurse, "nurse_disinfected", "a_adapt_room"),
    ],
)  # fmt: skip
def test_agent_registers_until_confirmed(kind, name, can):
    agent = Alone(kind, f"{name}12")
    agent.runner.advance(nanoseconds(2 * REGISTER_S) + 1)
    assert len(agent.contents(Register)) == 3
    assert agent.contents(Register)[0].kind == name
    assert can in agent.contents(Register)[0].capabilities
    agent.tell(Register(), performative="agree")
    agent.runner.advance(9 * SECOND)
    assert len(agent.contents(Register)) == 3


def test_agent_with_plan_stops_registering():
    spot = going()
    registered = len(spot.contents(Register))
    spot.runner.advance(9 * SECOND)
    assert len(spot.contents(Register)) == registered


def test_listing_1_runs_as_printed():
    spot = Alone()
    spot.take_on()
    spot.engine.add_text(LISTING_1)
    spot.engine.add_text("+!a_authorize_disinfect(U, S) : milestone6 <- a_authorize_disinfect(U, S).")
    spot.engine.believe(parse_literal("milestone5"))
    spot.engine.add_text(f"+go <- a_patrol_room({SPOT}, {ROOM}).")
    spot.tell(Belief("go"))
    spot.answer("success")
    assert spot.beliefs_sent() == [
        (UVD, "milestone5"),
        (UVD, f"trigger_a_authorize_disinfect({UVD}, {SPOT})"),
    ]  # fmt: skip
    assert spot.believes("milestone6")
    assert not spot.believes("milestone5")
    assert [str(goal) for goal in spot.engine.intentions.desires()] == [f"a_authorize_disinfect({UVD}, {SPOT})"]


def test_listing_2_runs_as_printed():
    uvd = Alone(Uvd, UVD)
    uvd.take_on()
    uvd.engine.add_text(LISTING_2)
    uvd.engine.add_text("+!a_authorize_disinfect(U, S) : milestone5 <- a_authorize_disinfect(U, S).")
    uvd.tell(Belief("milestone5"), sender=SPOT)
    uvd.tell(Belief(f"trigger_a_authorize_disinfect({UVD}, {SPOT})"), sender=SPOT)
    assert [str(goal) for goal in uvd.engine.intentions.desires()] == [f"a_authorize_disinfect({UVD}, {SPOT})"]


def test_agent_executes_plans_reports_and_forgets_mission():
    spot = going()
    assert [(command.action, command.args) for command in spot.commands] == [("a_navigate_to", (SPOT, ROOM))]
    assert not spot.believes("idle")
    spot.answer("success")
    assert spot.contents(Report) == [Report("success", "a_navigate_to", (SPOT, ROOM))]
    assert len(spot.contents(Finished)) == 1
    assert spot.believes("idle")
    assert not any(str(held.belief).startswith(("start", "milestone", "initial")) for held in spot.engine.beliefs)
    assert not any(plan.label.startswith("mission") for plan in spot.engine.library if plan.label)


def test_new_plans_replace_only_old_plans_of_the_mission():
    spot = going()
    before = {plan.label for plan in spot.engine.library}
    spot.take_on("+!a_charge(S) <- a_charge(S).", label="mission_1_2")
    after = {plan.label for plan in spot.engine.library}
    assert {label for label in before - after if label} == {f"mission_1_1_{number}" for number in range(3)}
    assert after - before == {"mission_1_2_0"}
    assert "tells" in after


def test_action_in_progress_continues_with_new_plans():
    spot = going()
    spot.take_on(*GO, label="mission_1_2")
    spot.tell(Belief(f"initial_trigger_a_navigate_to({SPOT}, {ROOM})"), mission="mission_1_2")
    spot.runner.advance(spot.now + SECOND)
    assert (len(spot.commands), spot.cancels) == (1, [])
    spot.answer("success")
    assert spot.said[-1].mission == "mission_1_2"
    assert len(spot.contents(Finished)) == 1


@pytest.mark.parametrize("word", [Stop("something else"), End()])
def test_stop_aborts_the_mission(word):
    spot = going()
    spot.tell(word, performative="request")
    spot.runner.advance(spot.now + SECOND)
    assert [cancel.id for cancel in spot.cancels] == [spot.commands[0].id]
    assert spot.believes("idle")
    assert not spot.engine.intentions.desires()


def test_messages_about_other_plans_are_ignored():
    spot = going()
    spot.tell(Stop(), performative="request", mission="mission_1_0")
    spot.tell(Belief("milestone7"), sender=UVD, mission="mission_0_9")
    assert not spot.believes("milestone7")
    assert spot.runner.nodes[SPOT].label == "mission_1_1"  # type: ignore[attr-defined]


def test_message_before_plans_is_kept():
    uvd = Alone(Uvd, UVD)
    uvd.tell(Belief("milestone3"), sender=SPOT, mission="mission_4_2")
    assert not uvd.believes("milestone3")
    uvd.take_on(label="mission_4_2")
    assert uvd.believes("milestone3")


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        ("+!go <- ", "a step"),
        ("@mine +!go <- a_charge(x).", "the label of a plan"),
        ("+!go <- a_charge(x).", "the label of a plan"),
    ],
)
def test_unparsable_plans_are_refused(plan, reason, caplog):
    caplog.set_level(logging.ERROR, "socialbot")
    spot = Alone()
    spot.tell(Plan("mission_1_1", (plan,)))
    assert reason in spot.contents(Refusal)[0].reason
    assert spot.said[-1].performative == "refuse"
    assert spot.runner.nodes[SPOT].label == ""  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("+!go <- a_charge(x).", "+!go <- a_open_door(x)."),
        ("+initial_trigger_go <- .no_such_action(x).", "+!go <- true."),
    ],
)
def test_unusable_plans_are_refused_and_robot_stays_free(first, second, caplog):
    caplog.set_level(logging.CRITICAL, "socialbot")
    spot = Alone()
    label = "mission_1_1_0"
    other = label if "charge" in first else "mission_1_1_1"
    spot.tell(Plan("mission_1_1", (f"@{label} {first}", f"@{other} {second}")))
    spot.runner.advance(SECOND)
    assert len(spot.contents(Refusal)) == 1
    assert spot.said[-1].mission == "mission_1_1"
    assert spot.believes("idle")
    assert not any(plan.label.startswith("mission") for plan in spot.engine.library if plan.label)


def test_duplicate_plan_has_no_effect():
    spot = Alone()
    plans = tuple(f"@mission_1_1_{number} {text}" for number, text in enumerate(GO))
    message = spot.tell(Plan("mission_1_1", plans))
    spot.tell(Start(CONSTANTS), performative="request")
    spot.tell(Belief(f"initial_trigger_a_navigate_to({SPOT}, {ROOM})"))
    spot.receive(message)
    spot.answer("success")
    assert len(spot.contents(Finished)) == 1


@pytest.mark.parametrize(
    ("content", "performative", "sender", "mission", "reason"),
    [
        (Plan("mission_2_1", ()), "inform", UVD, "mission_2_1", "only the coordinator"),
        (Stop("mine"), "request", UVD, "mission_1_1", "only the coordinator"),
        (Start(CONSTANTS), "request", UVD, "mission_1_1", "only the coordinator"),
        (Plan("mission_2_1", ()), "request", "coordinator", "mission_2_1", "inform"),
        (Start(CONSTANTS), "inform", "coordinator", "mission_1_1", "request"),
        (Belief("milestone9"), "query", UVD, "mission_1_1", "inform"),
        (Plan("mission_2_1", ()), "inform", "coordinator", "mission_3_1", "mission_3_1"),
        (Plan("", ()), "inform", "coordinator", "", "no mission"),
        (Belief("milestone9"), "inform", "percept", "mission_1_1", "no agent can be named percept"),
    ],
)
def test_wrong_performative_is_refused_without_effect(content, performative, sender, mission, reason, caplog):
    caplog.set_level(logging.ERROR, "socialbot")
    spot = going()
    spot.tell(content, performative=performative, sender=sender, mission=mission)
    assert reason in spot.contents(Refusal)[0].reason
    assert spot.said[-1].receiver == sender
    assert not spot.believes("milestone9")
    spot.answer("success")
    assert len(spot.contents(Finished)) == 1


def test_unsupported_message_is_refused_but_refusal_is_not(caplog):
    caplog.set_level(logging.ERROR, "socialbot")
    spot = Alone()
    spot.tell(InitialTrigger("disinfect", (ROOM,)), performative="request")
    spot.tell(Refusal("no"), performative="refuse")
    assert [refusal.reason for refusal in spot.contents(Refusal)] == ["spot does not handle InitialTrigger"]


# What it mends by itself


def test_dirty_room_is_reported_at_once():
    spot = going()
    spot.answer("failure", DIRTY_ROOM)
    assert spot.contents(Problem) == [Problem(DIRTY_ROOM, (SPOT, ROOM), "a_navigate_to")]


def test_spot_opens_closed_door_and_repeats_action():
    spot = going()
    spot.see(ROOM)
    spot.answer("failure", CLOSED_DOOR)
    assert spot.done() == ["a_navigate_to", "a_open_door"]
    spot.answer("success")
    assert spot.done()[2:] == ["a_navigate_to"]
    spot.answer("success")
    assert spot.contents(Problem) == []
    assert len(spot.contents(Finished)) == 1


def test_door_that_stays_closed_is_reported():
    spot = going()
    spot.see(ROOM)
    spot.answer("failure", CLOSED_DOOR)
    spot.answer("failure", "it is stuck")
    assert spot.contents(Problem) == [Problem("it is stuck", (SPOT, ROOM), "a_open_door")]


def test_uvd_reports_closed_door():
    uvd = Alone(Uvd, UVD)
    uvd.take_on("+go <- a_navigate_to(uvdrobot1, room1).")
    uvd.tell(Belief("go"))
    uvd.answer("failure", CLOSED_DOOR)
    assert uvd.contents(Problem) == [Problem(CLOSED_DOOR, (UVD, ROOM), "a_navigate_to")]


def test_robot_with_low_battery_charges_and_continues():
    spot = going()
    spot.answer("failure", LOW_BATTERY)
    assert spot.done() == ["a_navigate_to", "a_charge"]
    spot.answer("success")
    assert spot.done()[2:] == ["a_navigate_to"]


def test_robot_waits_once_for_person_in_room():
    uvd = Alone(Uvd, UVD, patience_s=2.0)
    uvd.take_on("+go <- a_disinfect_room(uvdrobot1, room1).")
    uvd.tell(Belief("go"))
    uvd.answer("failure", PERSON_IN_ROOM)
    assert uvd.done() == ["a_disinfect_room"]
    uvd.runner.advance(uvd.now + 2 * SECOND)
    assert uvd.done() == ["a_disinfect_room"] * 2
    assert uvd.contents(Problem) == []
    uvd.answer("failure", PERSON_IN_ROOM)
    assert len(uvd.contents(Problem)) == 1


def test_without_recovery_failures_are_reported_at_once():
    spot = going(recovers=False)
    spot.see(ROOM)
    spot.answer("failure", CLOSED_DOOR)
    assert spot.done() == ["a_navigate_to"]
    assert spot.contents(Problem) == [Problem(CLOSED_DOOR, (SPOT, ROOM), "a_navigate_to")]


def test_idle_robot_charges_low_battery():
    spot = Alone()
    spot.see("room4", battery=0.1)
    assert spot.done() == ["a_charge"]
