"""Whole missions: world, coordinator, robots and nurses in one inline graph."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import msgspec
import pytest

from socialbot.agents.hospital.demo import hospital, large_hospital
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.ward.messages import MESSAGES, RESULTS
from socialbot.agents.teams.messages import AclMessage, InitialTrigger, Plan, Problem
from socialbot.agents.teams.missions import CoordinatorMemory
from socialbot.core.errors import ParameterError
from tests.agents.hospital.listings import LISTING_3, LISTING_4, NURSE, SPOT, UVD
from tests.agents.hospital.watched import Watched

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)
logging.getLogger("socialbot.bdi").setLevel(logging.ERROR)


def paper(rate: float, **coordinator) -> Watched:
    return Watched(hospital(rate=rate, coordinator={"proactive": False, **coordinator}))


def large(rooms: int, robots: int, *, seed: int, rate: float, coordinator: dict | None = None, **world) -> Watched:
    world = {"noise": 0.1, **world}
    return Watched(large_hospital(rooms, robots, robots, rate=rate, seed=seed, world=world, coordinator=coordinator))


def test_mission_without_problem_equals_listing_3():
    run = paper(0).until(6.0)
    assert run.history() == LISTING_3
    assert {each.status for each in run.views[1].actions} == {"done"}
    assert (run.views[1].status, run.views[1].recoveries) == ("finished", 0)
    assert run.infected() == []
    assert run.ended[1] == pytest.approx(4.2, abs=0.1)


def test_repaired_mission_equals_listing_4_and_adds_little_time():
    run = paper(100, policy="repair").until(6.0)
    assert run.history() == LISTING_4
    assert [each.status for each in run.views[1].actions] == ["done"] * 5 + ["failed"] + ["done"] * 8
    assert run.contents(Problem) == [Problem("dirty room", (SPOT, "room1"), "a_patrol_room")]
    assert run.infected() == []
    assert run.ended[1] / paper(0).until(6.0).ended[1] < 1.08


def test_replanned_mission_completes():
    run = paper(100, policy="replan").until(6.0)
    assert run.views[1].status == "finished"
    assert ("a_adapt_room", NURSE, "room1") in run.history()


def test_proactive_coordinator_avoids_the_problem():
    run = paper(100, proactive=True).until(6.0)
    assert run.contents(Problem) == []
    assert run.views[1].status == "finished"


def test_proactive_coordinator_reacts_to_changes_during_movement():
    run = Watched(hospital(world={"faults": "1.5 dirty room1"}, coordinator={"proactive": True})).until(6.0)
    assert run.contents(Problem) == []
    assert (run.views[1].status, run.views[1].revisions) == ("finished", 1)
    assert ("a_adapt_room", NURSE, "room1") in run.history()


def test_same_seed_gives_same_messages():
    assert paper(100).until(6.0).said == paper(100).until(6.0).said


@pytest.mark.parametrize(
    "second", [2.35, 3.0, *(pytest.param(second, marks=pytest.mark.slow) for second in (1.5, 2.0, 4.0))]
)
@pytest.mark.parametrize("rate", [0, 100])
def test_restarted_coordinator_completes_the_mission(tmp_path: Path, second: float, rate: int):
    run = paper(rate, memory_file=str(tmp_path / "memory.json")).until(second)
    run.runner.kill("coordinator")
    run.until(second + 2.0)
    run.runner.restart("coordinator")
    run.until(second + 9.0)
    assert run.infected() == []
    assert [view.status for view in run.views.values()] == ["finished"]


def test_memory_of_the_coordinator_is_saved_again_if_its_folder_is_removed(tmp_path: Path):
    folder = tmp_path / "minds"
    run = paper(0, memory_file=str(folder / "memory.json")).until(2.0)
    shutil.rmtree(folder)
    run.until(4.0)
    saved = msgspec.json.decode((folder / "memory.json").read_bytes(), type=CoordinatorMemory)
    node = run.runner.nodes["coordinator"]
    assert isinstance(node, HospitalCoordinator)
    kept = node.coordinator.memory
    assert (set(saved.members), set(saved.missions), saved.last) == (set(kept.members), set(kept.missions), 1)


@pytest.mark.parametrize("second", [1.5, 2.35, 3.0, 4.0])
def test_coordinator_without_memory_starts_mission_again(second: float):
    run = paper(0).until(second)
    run.runner.kill("coordinator")
    run.until(second + 0.1)
    run.runner.restart("coordinator")
    run.until(second + 9.0)
    assert run.infected() == []


@pytest.mark.parametrize("name", [SPOT, UVD, NURSE])
def test_restarted_agent_resumes_its_part(name: str):
    run = paper(0).until(2.1)
    run.runner.kill(name)
    run.until(2.3)
    run.runner.restart(name)
    run.until(20.0)
    assert run.infected() == []
    assert run.views[1].status == "finished"


@pytest.mark.parametrize("content", [b"{", b'{"missions": "\xff"}', b'{"a":' * 10_000])
def test_unreadable_memory_file_is_an_error(tmp_path: Path, content: bytes):
    (tmp_path / "memory.json").write_bytes(content)
    with pytest.raises(ParameterError, match="cannot read the memory file"):
        paper(0, memory_file=str(tmp_path / "memory.json"))


def test_urgent_room_is_served_first():
    run = large(4, 1, seed=0, rate=0).until(2.5)
    first = run.views[1].target
    urgent = next(room.name for room in run.ward.rooms if room.name not in (first, "dock"))  # type: ignore[union-attr]
    trigger = AclMessage(
        stamp=run.runner.clock.now(), id="d", sender="desk", receiver="coordinator", performative="request",
        content=InitialTrigger("urgent", (urgent,)),
    )  # fmt: skip
    run.runner.feed(MESSAGES, trigger)
    run.until(60.0)
    assert run.infected() == []
    ends = {run.views[mission].target: end for mission, end in run.ended.items()}
    assert min(ends, key=ends.__getitem__) == urgent


def test_robots_with_high_numbers_get_valid_plans():
    run = large(12, 11, seed=1, rate=0, every_s=0.0).until(60.0)
    assert run.infected() == []
    receivers = {message.receiver for message in run.said if isinstance(message.content, Plan)}
    assert {"spotrobot10", "uvdrobot11"} <= receivers


@pytest.mark.parametrize("proactive", [True, False])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
def test_every_room_is_disinfected_in_spite_of_problems(seed: int, proactive: bool):
    run = large(8, 2, seed=seed, rate=100, coordinator={"proactive": proactive})
    for second in range(10, 200, 10):
        run.until(second)
        if second > 30 and not run.infected():
            break
    assert run.infected() == []


def test_revision_does_not_interrupt_a_charge():
    run = Watched(hospital(world={"faults": "1.7 drains spotrobot1; 2.6 dirty room1"}, coordinator={"proactive": True}))
    charges: list[str] = []
    run.runner.tap(RESULTS, lambda _, result: charges.extend([result.reason] * (result.action == "a_charge")))  # type: ignore[attr-defined]
    run.until(20.0)
    assert run.views[1].status == "finished"
    assert charges == [""]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(16))
def test_no_run_of_a_large_ward_ends_in_a_deadlock(seed: int):
    run = large(50, 4, seed=seed, rate=(25, 50, 75, 100)[seed % 4], coordinator={"proactive": seed % 8 < 6})
    for second in range(60, 601, 10):
        run.until(second)
        if not run.infected():
            break
    assert run.infected() == []


def test_action_longer_than_patience_is_not_interrupted():
    run = Watched(hospital(world={"pace": "clinic"}, coordinator={"patience_s": 60.0})).until(600.0)
    assert run.views[1].status == "finished"
    assert run.views[1].recoveries == 0


def test_rooms_are_disinfected_although_a_robot_is_lost_for_good():
    run = large(6, 2, seed=0, rate=0.0, coordinator={"patience_s": 5.0})
    run.until(2.0).runner.kill("spotrobot1")
    assert run.until(80.0).infected() == []
    assert "spotrobot1 does not answer" in {view.problem for view in run.views.values()}


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("2.1 stalls spotrobot1 100000", "spotrobot1 is stuck in a_navigate_to"),
        ("3.1 stalls spotrobot1 100000", "spotrobot1 is stuck in a_approach_nurse"),
        ("4.1 stalls uvdrobot1 100000", "uvdrobot1 is stuck in a_navigate_to"),
    ],
)
def test_rooms_are_disinfected_although_a_robot_is_stuck_for_good(fault, problem):
    run = large(6, 2, seed=0, rate=0.0, faults=fault).until(80.0)
    assert run.infected() == []
    assert problem in {view.problem for view in run.views.values()}
