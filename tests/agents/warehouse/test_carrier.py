"""A carrier: what its sensors tell, what its actions do, and what it lets others do."""

from __future__ import annotations

import pytest

from socialbot.agents.warehouse.carrier import Load, Place
from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveCommand, MoveStatus, Point, UnloadCommand
from socialbot.agents.warehouse.scenario import DECK_M
from socialbot.deliberation.messages import Belief, Fact
from tests.agents.warehouse.hall import LAYOUT, boxes, hall_with_carrier, status, to_be_in, told


class TestSensorsOfACarrier:
    def test_place_sensor_reports_bay_or_deposit(self) -> None:
        assert told(Place().tell(status("base", robot="carrier_a"))) == {"(in carrier_a base)"}
        assert told(Place().tell(status("moving", robot="carrier_a"))) == set()

    def test_load_sensor_counts_boxes_over_the_deck(self) -> None:
        sensor = Load("carrier_a")
        assert sensor.tell(boxes()) is None, "it does not know where it is"
        bay = LAYOUT.bays["base_a"]
        sensor.status = MoveStatus(
            stamp=0, robot="carrier_a", start_name="base", current_name="base", target_name="base",
            current_pos=bay, target_pos=bay, dist=0.0, progress=1.0,
        )  # fmt: skip

        def load(*positions: Point) -> set[str]:
            lying = (BoxPosition(name=f"box_{n}", position=at, holder="?") for n, at in enumerate(positions))
            return told(sensor.tell(BoxPositions(stamp=0, boxes=tuple(lying))))

        on_deck = Point(bay.x, bay.y - 0.16, DECK_M + 0.11)
        assert load(on_deck) == {"(moving_boxes carrier_a) = 1"}
        assert load(on_deck, Point(bay.x, bay.y + 0.16, DECK_M + 0.11)) == {"(moving_boxes carrier_a) = 2"}
        assert load(Point(bay.x, bay.y, 1.4), Point(bay.x + 0.5, bay.y, 0.4)) == {"(moving_boxes carrier_a) = 0"}


class TestACarrier:
    def test_moves_and_unloads(self) -> None:
        hall = hall_with_carrier()
        assert hall.finish(hall.attempt("carrier_a", "carrier_move", "carrier_a", "deposit", "base")) == "done"
        assert hall.node("carrier_a").status.current_name == "base"
        assert hall.finish(hall.attempt("carrier_a", "carrier_move", "carrier_a", "base", "deposit")) == "done"
        assert hall.finish(hall.attempt("carrier_a", "carrier_unload", "carrier_a", "deposit")) == "done"
        assert len(hall.of(UnloadCommand)) == 1

    def test_move_fails_after_another_command(self) -> None:
        hall = hall_with_carrier()
        trial = hall.attempt("carrier_a", "carrier_move", "carrier_a", "deposit", "base")
        hall.after(1.0)
        hall.send("/carrier_a/cmd_target", MoveCommand(stamp=0, target="deposit"))
        assert hall.finish(trial) == "another command has sent carrier_a to deposit"

    def test_fulfils_the_request_of_a_gripper_and_replies(self) -> None:
        hall = hall_with_carrier()
        request = hall.request("add", desire=to_be_in("base", 0.6), monitor=True)
        (reply,) = hall.replies(request)
        assert (reply.accepted, reply.state, reply.priority) == (True, "done", 0.6)
        hall.after(8.0)
        assert [reply.state for reply in hall.replies(request)] == ["done", "fulfilled"]
        assert hall.node("carrier_a").status.current_name == "base"

    def test_refuses_requests_of_other_groups(self) -> None:
        hall = hall_with_carrier()
        loaded = Fact(name="lb_load_completed", params=("carrier_a",))
        requests = [
            hall.request(operation, group="strangers", desire=desire, belief=belief)
            for operation in ("check", "add", "del")
            for desire, belief in ((to_be_in("base", 0.6), None), (None, loaded))
        ]
        for request in requests:
            (reply,) = hall.replies(request)
            assert not reply.accepted
            assert reply.state == "refused"
            assert "strangers" in reply.reason
        assert len(hall.records("refused", "carrier_a")) == len(requests)
        hall.after(8.0)
        assert hall.node("carrier_a").status.current_name == "deposit"

    def test_limits_the_priority_of_requested_desires(self) -> None:
        hall = hall_with_carrier()
        (reply,) = hall.replies(hall.request("add", desire=to_be_in("base", 0.9)))
        assert (reply.accepted, reply.priority) == (True, 0.6)
        (held,) = hall.node("carrier_a").deliberator.desires
        assert held.desire.priority == 0.6

    @pytest.mark.parametrize("policy", ["NO_PREEMPT", "PREEMPT"])
    def test_fulfils_a_less_urgent_request_afterwards(self, policy: str) -> None:
        hall = hall_with_carrier(reschedule_policy=policy)
        hall.desire("carrier_a", to_be_in("base", 0.8))
        hall.after(2.0)
        request = hall.request("add", desire=to_be_in("deposit", 0.6), monitor=True)
        hall.after(1.0)
        assert [reply.state for reply in hall.replies(request)] == ["done"]
        assert hall.node("carrier_a").status.target_name == "base"
        hall.after(12.0)
        assert [reply.state for reply in hall.replies(request)] == ["done", "fulfilled"]
        ends = [(record.what, record.detail["outcome"]) for record in hall.records("plan_end", "carrier_a")]
        assert ends == [("go_to_base", "succeeded"), ("go_to_deposit", "succeeded")]

    @pytest.mark.parametrize(("policy", "first"), [("NO_PREEMPT", "succeeded"), ("PREEMPT", "aborted")])
    def test_more_urgent_desire_aborts_a_plan_only_with_preemption(self, policy: str, first: str) -> None:
        hall = hall_with_carrier(reschedule_policy=policy)
        hall.request("add", desire=to_be_in("base", 0.6))
        hall.after(2.0)
        hall.desire("carrier_a", to_be_in("deposit", 0.8))
        hall.after(20.0)
        ends = [(record.what, record.detail["outcome"]) for record in hall.records("plan_end", "carrier_a")]
        assert ends[0] == ("go_to_base", first)
        assert ("go_to_deposit", "succeeded") in ends

    def test_permitted_agents_change_its_beliefs(self) -> None:
        hall = hall_with_carrier()
        loaded = Fact(name="lb_load_completed", params=("carrier_a",))
        assert [reply.found for reply in hall.replies(hall.request("check", belief=loaded))] == [False]
        hall.request("add", belief=loaded)
        assert [reply.found for reply in hall.replies(hall.request("check", belief=loaded))] == [True]
        hall.send("/carrier_a/del_belief", Belief(stamp=0, belief=loaded))
        assert [reply.found for reply in hall.replies(hall.request("check", belief=loaded))] == [False]
