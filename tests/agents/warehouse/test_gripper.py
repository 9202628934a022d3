"""The gripper: what its sensors tell, what its actions do, and what it asks of carriers."""

from __future__ import annotations

from typing import Any

import pytest

from socialbot.agents.warehouse.gripper import Boxes, CarrierStatus, Whereabouts
from socialbot.agents.warehouse.messages import GripperPose, GripperStatus, MoveCommand, MoveStatus
from socialbot.agents.warehouse.scenario import SIX
from socialbot.bdi import Engine
from socialbot.core.clock import SECOND, ManualClock
from socialbot.deliberation.messages import AgentRequest, Desire, Fact, RequestState
from socialbot.deliberation.requests import RequestClient
from tests.agents.warehouse.hall import GRIPPER, Hall, Try, boxes, hall_with_gripper, status, to_be_in, told


class TestSensorsOfTheGripper:
    @pytest.mark.parametrize(
        ("place", "fact"),
        [
            ("base", "(carrier_in_base carrier_a base_a)"),
            ("deposit", "(carrier_in_deposit carrier_a deposit_a)"),
            ("moving", None),
        ],
    )
    def test_carrier_status_reports_bay_or_deposit(self, place: str, fact: str | None) -> None:
        sensor = CarrierStatus("carrier_a", "base_a", "deposit_a")
        assert told(sensor.tell(status(place, robot="carrier_a"))) == ({fact} if fact else set())

    @pytest.mark.parametrize(
        ("percept", "place"),
        [
            (status("base_1"), "base_1"),
            (status("base_a1"), "base_a"),
            (status("base_a2"), "base_a"),
            (status("moving", start="base_a", target="base_a2"), "base_a"),
            (status("moving", start="base_a1", target="base_a2"), "base_a"),
            (status("moving", start="base_a", target="base_b"), None),
            (status("moving", start="base_a1", target="base_b1"), None),
        ],
    )
    def test_slots_of_a_bay_count_as_the_bay(self, percept: MoveStatus, place: str | None) -> None:
        assert told(Whereabouts(GRIPPER, SIX.bays).tell(percept)) == ({f"(upon gripper_a {place})"} if place else set())

    def test_top_box_of_a_stack_is_clear(self) -> None:
        facts = told(Boxes(SIX).tell(boxes(box_a1="base_1", box_c2="base_1")))
        assert {
            "(on box_a1 base_1 base_1)", "(on box_c2 box_a1 base_1)", "(in box_a1 base_1)", "(in box_c2 base_1)",
            "(clear box_c2)", "(stacked base_1) = 2", "(stacked base_2) = 0", "(clear base_2)", "(clear base_3)",
            "(holding_boxes gripper_a) = 0", "(moving_boxes carrier_a) = 0",
        } <= facts  # fmt: skip
        assert not {"(clear base_1)", "(clear box_a1)"} & facts

    def test_held_box_is_in_no_stack(self) -> None:
        facts = told(Boxes(SIX).tell(boxes(box_a1=GRIPPER)))
        assert {"(holding gripper_a box_a1)", "(holding_boxes gripper_a) = 1"} <= facts
        assert not [fact for fact in facts if fact.startswith(("(on ", "(in "))]

    def test_unloaded_boxes_still_belong_to_their_carrier(self) -> None:
        facts = told(Boxes(SIX).tell(boxes(box_a1="carrier_a", box_b1="deposit_b")))
        assert {"(carrier_moving carrier_a box_a1)", "(carrier_moving carrier_b box_b1)"} <= facts
        assert {"(moving_boxes carrier_a) = 1", "(moving_boxes carrier_b) = 0"} <= facts

    def test_box_in_a_bay_can_be_taken(self) -> None:
        facts = told(Boxes(SIX).tell(boxes(box_a1="base_a")))
        assert {"(on box_a1 base_a base_a)", "(in box_a1 base_a)", "(clear box_a1)", "(stacked base_a) = 1"} <= facts
        assert not {"(clear base_a)", "(carrier_moving carrier_a box_a1)"} & facts

    def test_empty_bay_is_not_reported_as_clear(self) -> None:
        assert not {"(clear base_a)", "(clear base_b)"} & told(Boxes(SIX).tell(boxes()))

    def test_box_on_the_floor_is_not_reported(self) -> None:
        assert not [fact for fact in told(Boxes(SIX).tell(boxes(box_a1="floor"))) if "box_a1" in fact]


def at(place: str) -> Hall:
    """The crane over a stack or bay."""
    hall = hall_with_gripper()
    assert hall.finish(hall.attempt(GRIPPER, "gripper_move", GRIPPER, "start", place)) == "done"
    return hall


def carrying(place: str = "base_a") -> Hall:
    """The crane over a bay with box_a2, and carrier a there; its agent is the test."""
    hall = at("base_1")
    assert hall.finish(hall.attempt(GRIPPER, "gripper_pickup", GRIPPER, "box_a2", "box_c2", "base_1")) == "done"
    hall.send("/carrier_a/cmd_target", MoveCommand(stamp=0, target="base"))
    assert hall.finish(hall.attempt(GRIPPER, "gripper_move", GRIPPER, "base_1", place)) == "done"
    hall.after(6.0)
    assert hall.holder("box_a2") == GRIPPER
    return hall


class TestActionsOfTheGripper:
    def test_move_ends_at_the_target(self) -> None:
        hall = hall_with_gripper()
        trial = hall.attempt(GRIPPER, "gripper_move", GRIPPER, "start", "base_3")
        assert hall.of(MoveCommand)[-1].target == "base_3"
        hall.after(1.0)
        assert not trial.end
        assert hall.finish(trial) == "done"
        assert 1.5 <= hall.seconds <= 5.5
        assert hall.node(GRIPPER).is_at("base_3")

    def test_move_to_the_present_place_ends_at_once(self) -> None:
        hall = hall_with_gripper()
        assert hall.finish(hall.attempt(GRIPPER, "gripper_move", GRIPPER, "start", "start"), 1.0) == "done"

    def test_move_fails_after_another_command(self) -> None:
        hall = hall_with_gripper()
        trial = hall.attempt(GRIPPER, "gripper_move", GRIPPER, "start", "base_3")
        hall.after(1.0)
        hall.send("/gripper_a/cmd_motors_pose", MoveCommand(stamp=0, target="base_1"))
        assert hall.finish(trial) == "another command has sent gripper_a to base_1"

    def test_pickup_lowers_closes_and_lifts(self) -> None:
        hall = at("base_1")
        begun = len(hall.said)
        trial = hall.attempt(GRIPPER, "gripper_pickup", GRIPPER, "box_a2", "box_c2", "base_1")
        assert hall.finish(trial) == "done"
        commands = [
            message.pose if isinstance(message, GripperPose) else message.status
            for topic, message in hall.said[begun:]
            if topic.startswith("/gripper_a/cmd_gripper") and isinstance(message, GripperPose | GripperStatus)
        ]
        assert commands == ["low"] * 3 + ["close"] * 3 + ["high"] * 3
        assert hall.holder("box_a2") == GRIPPER

    def test_pickup_opens_closed_fingers_first(self) -> None:
        hall = at("base_1")
        hall.send("/gripper_a/cmd_gripper_status", GripperStatus(stamp=0, status="close"))
        hall.after(1.0)
        trial = hall.attempt(GRIPPER, "gripper_pickup", GRIPPER, "box_a2", "box_c2", "base_1")
        assert hall.finish(trial) == "done"
        assert hall.of(GripperStatus, "/gripper_a/cmd_gripper_status")[1].status == "open"
        assert hall.holder("box_a2") == GRIPPER

    def test_putdown_leaves_the_box_on_the_stack(self) -> None:
        hall = carrying("base_3")
        assert hall.finish(hall.attempt(GRIPPER, "gripper_putdown", GRIPPER, "box_a2", "base_3", "base_3")) == "done"
        assert hall.holder("box_a2") == "base_3"

    @pytest.mark.parametrize("number", [0, 1])
    def test_box_is_put_into_a_free_slot_of_the_carrier(self, number: int) -> None:
        hall = carrying()
        hall.node(GRIPPER).boxes_on = lambda carrier: number
        trial = hall.attempt(GRIPPER, "gripper_put_on_carrier", GRIPPER, "box_a2", "carrier_a", "base_a")
        assert hall.of(MoveCommand, "/gripper_a/cmd_motors_pose")[-1].target in ("base_a", f"base_a{number + 1}")
        self.answer_all(hall, trial)
        assert trial.end == "done"
        assert hall.node(GRIPPER).is_at(f"base_a{number + 1}")
        assert hall.holder("box_a2") == "carrier_a"

    def test_carrier_is_informed_after_the_fingers_are_lifted(self) -> None:
        hall = carrying()
        trial = hall.attempt(GRIPPER, "gripper_put_on_carrier", GRIPPER, "box_a2", "carrier_a", "base_a")
        (first,) = hall.requests()
        assert (first.operation, str(first.belief)) == ("del", "(lb_load_completed carrier_a)")
        while len(hall.requests()) < 2:
            hall.answer(hall.requests()[-1])
            hall.after(0.1)
            assert hall.seconds < 40.0
        second = hall.requests()[1]
        assert (second.operation, str(second.belief)) == ("add", "(lb_load_completed carrier_a)")
        assert hall.node(GRIPPER).status.current_pos.z > 1.4
        assert hall.node(GRIPPER).fingers == "open"
        hall.after(1.0)
        assert not trial.end, "it waits for the answer"
        hall.answer(second)
        assert hall.finish(trial, 1.0) == "done"

    @staticmethod
    def answer_all(hall: Hall, trial: Try, *answer: Any) -> None:
        answered: set[str] = set()
        while not trial.end and hall.seconds < 60.0:
            for request in hall.requests():
                if request.id not in answered:
                    answered.add(request.id)
                    hall.answer(request, *(answer if request.operation == "add" else ()))
            hall.after(0.1)

    def test_action_fails_if_the_carrier_refuses_the_report(self) -> None:
        hall = carrying()
        trial = hall.attempt(GRIPPER, "gripper_put_on_carrier", GRIPPER, "box_a2", "carrier_a", "base_a")
        self.answer_all(hall, trial, "refused", "grippers may not change beliefs")
        assert trial.end == "carrier_a does not accept the report of its load: grippers may not change beliefs"

    def test_action_fails_if_the_carrier_does_not_reply(self) -> None:
        hall = carrying()
        trial = hall.attempt(GRIPPER, "gripper_put_on_carrier", GRIPPER, "box_a2", "carrier_a", "base_a")
        assert "no answer from carrier_a in 2 s" in hall.finish(trial, 40.0)
        assert not hall.of(GripperStatus, "/gripper_a/cmd_gripper_status")[3:], "it keeps the box"
        assert hall.holder("box_a2") == GRIPPER

    @pytest.mark.parametrize("action", ["gripper_pickup", "gripper_putdown", "gripper_put_on_carrier"])
    def test_cancelled_action_lifts_the_fingers(self, action: str) -> None:
        hall = carrying()
        args = {
            "gripper_pickup": ("box_c2", "box_a1", "base_1"),
            "gripper_putdown": ("box_a2", "base_a", "base_a"),
            "gripper_put_on_carrier": ("box_a2", "carrier_a", "base_a"),
        }[action]
        trial = hall.attempt(GRIPPER, action, GRIPPER, *args)
        hall.after(1.2)
        hall.give_up(GRIPPER, trial)
        assert trial.end == "stopped"
        assert hall.of(GripperPose)[-1].pose == "high"
        hall.after(2.0)
        assert hall.of(GripperPose)[-1].pose == "high", "nothing more is told after that"
        assert hall.node(GRIPPER).status.current_pos.z == 1.5


class TestAskingACarrierToCome:
    def asked(self) -> tuple[Hall, Try, AgentRequest]:
        hall = hall_with_gripper()
        trial = hall.attempt(GRIPPER, "req_carrier_to_come", "carrier_a", "deposit_a", "base_a")
        (request,) = hall.requests()
        return hall, trial, request

    def test_sends_a_monitored_desire(self) -> None:
        _, _, request = self.asked()
        assert (request.receiver, request.group, request.operation) == ("carrier_a", "grippers", "add")
        assert request.monitor
        assert request.desire == Desire(
            name="gripper_a_cometo_base",
            value=(Fact(name="in", params=("carrier_a", "base")),),
            priority=0.6,
            deadline=6.0,
        )

    def test_ends_when_the_desire_is_fulfilled(self) -> None:
        hall, trial, request = self.asked()
        hall.answer(request)
        hall.after(4.0)
        assert not trial.end
        hall.answer(request, "fulfilled")
        assert hall.finish(trial, 1.1) == "done"

    @pytest.mark.parametrize(
        ("state", "reason", "message"),
        [
            ("refused", "not for you", "carrier_a does not come: not for you"),
            ("dropped", "no plan after 8 tries", "carrier_a does not come: no plan after 8 tries"),
        ],
    )
    def test_fails_with_the_reason_of_the_carrier(self, state: RequestState, reason: str, message: str) -> None:
        hall, trial, request = self.asked()
        hall.answer(request, state, reason)
        assert hall.finish(trial, 1.1) == message

    def test_fails_without_reply(self) -> None:
        hall, trial, request = self.asked()
        assert hall.finish(trial) == "carrier_a does not come: no answer from carrier_a in 2 s"
        assert hall.seconds < 4.0
        assert len([sent for sent in hall.of(AgentRequest) if sent.id == request.id]) == 4, "it has asked again"

    def test_fails_if_the_carrier_takes_too_long(self) -> None:
        hall, trial, request = self.asked()
        hall.answer(request)
        assert hall.finish(trial) == "Too much time waited"
        assert hall.seconds == pytest.approx(0.2 + 8.0, abs=0.11)

    def test_sends_a_new_request_after_a_restart(self) -> None:
        sent: list[AgentRequest] = []
        for time in (4, 7):
            clock = ManualClock()
            letters = RequestClient(Engine(GRIPPER, clock), "grippers", sent.append)
            clock.set(time * SECOND)
            letters.ask("carrier_a", "add", desire=to_be_in("base", 0.6))
        assert sent[0].id != sent[1].id

    def test_cancelled_action_forgets_its_request(self) -> None:
        hall, trial, request = self.asked()
        hall.give_up(GRIPPER, trial)
        assert trial.end == "stopped"
        hall.answer(request, "fulfilled")
        hall.after(5.0)
        assert trial.end == "stopped"
