from __future__ import annotations

import io

import pytest
from rich.console import Console

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.demo import hospital, large_hospital
from socialbot.agents.hospital.result import QUIET_S, TREES, HospitalTerminal, MissionMonitor, ward_in, ward_text
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import RoomState, WardState
from socialbot.agents.hospital.ward.ward import Ward, large_ward, paper_ward
from socialbot.agents.teams.event_log import MissionResults
from socialbot.agents.teams.messages import Missions, MissionStatus, MissionView
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.graph.files import load_graph
from tests.agents.hospital.runs import paper_run
from tests.runs.test_plan_trees import MENDED, PLANNED, given_up_at, made_at


def ward_at(seconds: float, *infected: str) -> WardState:
    rooms = tuple(
        RoomState(name=name, door_open=True, cleaned=True, disinfected=name not in infected)
        for name in paper_ward().room_by_name
    )
    return WardState(stamp=nanoseconds(seconds), rooms=rooms, agents=())


def missions_at(seconds: float, status: MissionStatus, **more) -> Missions:
    view = MissionView(id=1, kind="disinfect", target="room1", priority=0, status=status, **more)
    return Missions(stamp=nanoseconds(seconds), missions=(view,))


def over(*messages: WardState | Missions, at: float) -> bool:
    left = MissionMonitor(paper_ward())
    for message in messages:
        left.observe(message)
    return left.are_over(nanoseconds(at))


def test_run_completes_with_disinfected_rooms_and_no_open_mission():
    begin = (ward_at(5.0), ward_at(6.1, "room1"), missions_at(6.1, "running"))
    assert not over(*begin, at=100.0)
    assert not over(*begin, ward_at(9.0), at=100.0), "the mission is still open"
    assert over(*begin, ward_at(9.0), missions_at(9.0, "finished"), at=9.0 + QUIET_S)
    assert not over(*begin, ward_at(9.0), missions_at(9.0, "finished"), at=8.9 + QUIET_S)


def test_run_does_not_complete_before_last_infection():
    assert not over(ward_at(5.0), ward_at(5.9), at=100.0)
    assert over(ward_at(5.0), ward_at(6.1), at=6.2 + QUIET_S)


def test_run_completes_with_infected_rooms_of_failed_missions_only():
    begin = (ward_at(5.0), missions_at(7.0, "failed"))
    assert over(*begin, ward_at(7.1, "room1"), at=9.0)
    assert not over(*begin, ward_at(7.1, "room1", "room2"), at=9.0)


def test_impossible_ward_of_graph_is_an_error_with_remedy():
    graph = hospital(world={"ward": "large", "rooms": 3, "nurses": 5})
    with pytest.raises(ParameterError, match="set nurses to at most the number of rooms"):
        ward_in(graph)


@pytest.mark.parametrize(
    ("graph", "ward"),
    [
        (hospital(), paper_ward()),
        (load_graph("hospital"), paper_ward()),
        (large_hospital(7, 2, 1, world={"every_s": 2.0}), large_ward(7, 2, 1, every_s=2.0)),
        (load_graph("warehouse"), None),
    ],
    ids=["paper", "file", "large", "none"],
)
def test_ward_of_graph_is_found(graph, ward):
    assert ward_in(graph) == ward


def test_mission_result_has_problems_and_duration():
    missions = MissionResults()
    problem = {"problem": "dirty room", "recoveries": 1}
    for message in (
        missions_at(1.0, "waiting"),
        missions_at(2.0, "running"),
        missions_at(3.0, "running", **problem),
        missions_at(3.5, "running", **problem),
        missions_at(4.5, "finished", **problem),
    ):
        missions.take(message)
    results = missions.missions[1].results()
    assert (results["status"], results["took_s"], results["problems"]) == ("finished", 2.5, ["dirty room"])


def console() -> Console:
    return Console(file=io.StringIO(), width=120, color_system=None, highlight=False)


def printed(out: Console) -> list[str]:
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue().splitlines()


def listing(ward: Ward, *faults: WorldFault) -> list[str]:
    """The ward as it is printed after 2 s."""
    world, out = WardWorld(ward, faults=faults), console()
    world.advance(2 * SECOND)
    out.print(ward_text(world.ward, world.state()))
    return printed(out)


def shown(messages: list) -> list[str]:
    show = HospitalTerminal(out := console(), paper_ward())
    for message in messages:
        show.show(message)
    show.finish()
    return printed(out)


def test_small_ward_is_listed_room_by_room():
    printed_lines = listing(paper_ward(), WorldFault(1.0, "enters", "room2", 9.0), WorldFault(1.0, "dirty", "room1"))
    lines = [line.split() for line in printed_lines]
    assert ["room1", "closed", "dirty", "✗", "infected", "nurse1"] in lines
    assert ["room2", "open", "yes", "✓", "person1"] in lines
    assert ["room4", "open", "yes", "✓", "spot1", "100%,", "uvd1", "100%"] in lines


def test_large_ward_is_summarized_in_numbers():
    text = " ".join(listing(large_ward(), WorldFault(1.0, "drains", "uvdrobot2"), WorldFault(1.0, "dirty", "room7")))
    assert text.startswith("51 rooms: 50 disinfected, 1 infected: room")
    assert "not fit: room7" in text
    assert "battery low: uvdrobot2" in text


def test_run_is_shown_with_failures_new_plan_and_table():
    lines = shown(paper_run(100.0).messages)
    assert any("✗ a_patrol_room(spotrobot1, room1)" in line for line in lines)
    assert any("✚ a_adapt_room(nurse_disinfected1, room1)" in line for line in lines)
    mission = next(line for line in reversed(lines) if line.startswith("1 ")).split()
    assert mission == ["1", "room1", "9", "13", "1", "dirty", "room", "yes", "finished", "3.50", "s"]


def test_number_of_printed_trees_is_limited():
    records = [made_at(0.0, PLANNED)]
    for number in range(TREES):
        records += [given_up_at(1.0 + number, PLANNED), made_at(1.5 + number, MENDED)]
    lines = shown(records)
    assert sum("m_clean(room1)" in line for line in lines) == TREES
    assert sum("more trees" in line for line in lines) == 1
