from __future__ import annotations

import logging

import pytest

from socialbot.agents.hospital.ward.messages import CANCELS, COMMANDS, RESULTS, STATE, AgentState, RoomState, WardState
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.agents.teams.messages import ActionCancel, ActionCommand, ActionResult
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Graph, NodeConfig
from tests.agents.hospital.listings import ROOM, SPOT
from tests.inline import InlineRun


def spot_in(state: WardState) -> AgentState:
    spot = state.agent(SPOT)
    assert spot is not None
    return spot


def room_in(state: WardState) -> RoomState:
    room = state.room(ROOM)
    assert room is not None
    return room


class House(InlineRun):
    """The world's node alone."""

    def __init__(self, start: int = 1_700_000_000 * SECOND, **parameters) -> None:
        graph = Graph("house", (NodeConfig("world", HospitalWorld, parameters),), inputs=frozenset({COMMANDS, CANCELS}))
        super().__init__(graph, start=start)

    @property
    def states(self) -> list[WardState]:
        return self.messages(STATE)

    @property
    def results(self) -> list[ActionResult]:
        return self.messages(RESULTS)

    def tell(self, second: float, id: str, robot: str, action: str, *args: str) -> None:
        stamp = self.begin + round(second * SECOND)
        self.send(COMMANDS, ActionCommand(stamp=stamp, id=id, robot=robot, action=action, args=(robot, *args)))

    def between(self, first: float, last: float) -> list[WardState]:
        return [state for state in self.states if first <= (state.stamp - self.begin) / SECOND <= last]


def test_state_is_published_five_times_a_second_and_at_changes():
    house = House()
    house.until(2.0)
    assert len(house.states) == 11, "the infection after 1 s falls on a report"
    house.tell(2.05, "a", SPOT, "a_navigate_to", ROOM)
    house.until(2.99)
    stamps = [round((state.stamp - house.begin) / SECOND, 2) for state in house.between(2.01, 2.99)]
    assert stamps == [2.05, 2.2, 2.4, 2.6, 2.8, 2.83], "begin and end of the way besides"
    assert [spot_in(state).place for state in house.between(2.8, 2.9)] == ["corridor", ROOM]


def test_changes_can_be_reported_together_after_a_pause():
    house = House(pause_s=0.15, faults="1.03 dirty room2; 1.05 dirty room3; 1.07 dirty room4; 1.25 dirty room1")
    house.until(1.5)
    stamps = [round((state.stamp - house.begin) / SECOND, 2) for state in house.between(0.9, 1.5)]
    assert stamps == [1.0, 1.15, 1.2, 1.35, 1.4]
    assert not house.between(1.3, 1.4)[0].rooms[0].cleaned


def test_result_is_published_at_its_time_followed_by_the_state():
    house = House()
    house.tell(1.03, "a", SPOT, "a_navigate_to", ROOM)
    house.until(1.8)
    assert house.results == []
    house.until(1.81)
    [result] = house.results
    assert (result.id, result.robot, result.outcome, result.reason) == ("a", SPOT, "success", "")
    assert result.stamp == house.begin + round(1.81 * SECOND)
    assert result.duration_s == 0.78
    assert house.states[-1].stamp == result.stamp
    assert spot_in(house.states[-1]).busy == ""


def test_command_can_be_cancelled():
    house = House()
    house.tell(1.0, "a", SPOT, "a_navigate_to", ROOM)
    house.runner.feed(CANCELS, ActionCancel(stamp=house.begin + round(1.5 * SECOND), id="a"))
    assert [result.reason for result in house.results] == ["cancelled"]


def test_invalid_command_is_answered_and_logged(caplog):
    house = House()
    with caplog.at_level(logging.INFO):
        house.tell(1.0, "a", "robot9", "a_charge")
    assert [result.reason for result in house.results] == ["there is no 'robot9'"]
    assert "there is no 'robot9'" in caplog.text


def test_silent_sensor_omits_its_room_or_robot_and_silent_state_publishes_nothing():
    house = House(faults="1 silent room1 1; 1 silent spotrobot1 1; 3 silent state 1")
    house.until(5.0)
    assert all(state.room(ROOM) is state.agent(SPOT) is None for state in house.between(1.01, 1.99))
    assert len(house.between(1.01, 1.99)) == 4
    assert all(state.room(ROOM) and state.agent(SPOT) for state in house.between(2.0, 2.9))
    assert house.between(3.01, 3.99) == []
    assert len(house.between(4.0, 5.0)) == 6


def test_slow_sensor_publishes_old_values():
    house = House(faults="0.9 slow room1 2.5; 6 slow state 4")
    house.until(3.2)
    infected = [room_in(state).infected for state in house.between(1.0, 3.2)]
    assert infected == [False] * 10 + [True] * 2, "looked at 0.9 s, then at 3 s after 2 s are over"
    house.until(11.0)
    stamps = [round((state.stamp - house.begin) / SECOND, 1) for state in house.between(6.1, 10.3)]
    assert stamps == [7.8, 9.8, 10.0, 10.2]


def test_paper_problem_is_visible_in_first_state():
    assert not room_in(House(rate=100.0).states[0]).cleaned
    assert room_in(House(rate=0.0).states[0]).cleaned


def test_large_ward_node_has_requested_rooms_and_robots():
    house = House(ward="large", rooms=20, spots=3, uvds=2, every_s=0.1, rate=100.0, noise=0.2)
    house.until(30.0)
    state = house.states[-1]
    assert len(state.rooms) == 21
    assert len(state.agents) == 25
    assert sum(room.infected for room in state.rooms) == 20


def test_invalid_parameters_are_rejected_at_construction():
    with pytest.raises(ParameterError, match="remedy: write faults as"):
        House(faults="30 explodes")
    with pytest.raises(ParameterError, match="set nurses to at most the number of rooms"):
        House(ward="large", rooms=3, nurses=4)
    with pytest.raises(ParameterError, match="rate"):
        House(rate=101.0)


def test_same_seed_gives_same_messages_at_any_start_time():
    def tale(start: int, seed: int) -> list:
        house = House(start=start, seed=seed, ward="large", rooms=10, rate=50.0, noise=0.1)
        for number in (1, 2, 3):
            house.tell(0.5, str(number), f"spotrobot{number}", "a_navigate_to", f"room{number}")
        house.until(30.0)
        return [(state.stamp - start, state.rooms, state.agents) for state in house.states]

    assert tale(0, 1) == tale(1_700_000_000 * SECOND, 1) != tale(0, 2)


def test_late_subscriber_gets_latest_state():
    house = House()
    house.until(1.1)
    assert house.runner.nodes["world"].outputs()["state"].delivery.value == "latched"
