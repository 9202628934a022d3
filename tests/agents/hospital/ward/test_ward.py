from __future__ import annotations

import ast
import math
from itertools import pairwise
from pathlib import Path

import pytest

from socialbot.agents.hospital.ward import ward as ward_module
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD, Position, Ward, large_ward, length, paper_ward

WARDS = [paper_ward(), large_ward(), large_ward(1, 1, 1), large_ward(200, 30, 30, 20)]


def test_paper_ward_has_four_rooms_nurse_in_first_robots_in_last():
    ward = paper_ward()
    assert [room.name for room in ward.rooms] == ["room1", "room2", "room3", "room4"]
    assert {member.name: member.home for member in ward.members} == {
        "nurse_disinfected1": "room1", "spotrobot1": "room4", "uvdrobot1": "room4",
    }  # fmt: skip
    assert (ward.closed, ward.docks) == ({"room1"}, ("room4",))


def test_large_ward_has_requested_size_and_an_infection_for_each_nurse():
    ward = large_ward(50, 4, 5)
    assert len(ward.rooms) == 51
    assert (len(ward.of_kind(SPOT)), len(ward.of_kind(UVD)), len(ward.of_kind(NURSE))) == (4, 5, 50)
    assert sorted(room for _, room in ward.infections) == sorted(room.name for room in ward.rooms[:-1])
    assert [time_s for time_s, _ in ward.infections] == [1.0 + 3.0 * number for number in range(50)]
    assert large_ward(50, 4, 5) == ward
    assert len(large_ward(50, nurses=7).infections) == 7


@pytest.mark.parametrize(
    "rooms", [999, 1000, 1001, *(pytest.param(rooms, marks=pytest.mark.slow) for rooms in (2500, 10_000))]
)
def test_every_room_of_a_large_ward_is_in_reach_of_a_dock(rooms: int):
    ward = large_ward(rooms, 5, 7)
    names = [room.name for room in ward.rooms]
    assert names == [f"room{number}" for number in range(1, rooms + 1)] + list(ward.docks)
    assert {member.home for member in ward.members if member.kind == UVD} <= set(ward.docks)
    for room in ward.rooms:
        dock, way = ward.way_to_dock(room.centre, room.name)
        assert length(way) < 650.0
        assert length(way) == min(length(ward.way(room.centre, room.name, each)) for each in ward.docks)
        assert way[-1] == ward.room_by_name[dock].entrance
    starts = [sum(member.home == dock and member.kind == UVD for member in ward.members) for dock in ward.docks]
    assert max(starts) - min(starts) <= 1


@pytest.mark.parametrize("wrong", [{"rooms": 0}, {"nurses": 51}, {"spots": -1}, {"uvds": -1}, {"every_s": -1.0}])
def test_impossible_ward_is_rejected(wrong):
    with pytest.raises(ValueError, match="cannot build a ward of"):
        large_ward(**wrong)


@pytest.mark.parametrize("ward", WARDS, ids=lambda ward: f"{len(ward.rooms)} rooms")
def test_rooms_do_not_overlap_and_lie_beside_their_corridor(ward: Ward):
    for number, room in enumerate(ward.rooms):
        assert ward.room_at(room.centre) == room.name
        assert ward.room_at(room.entrance) == ""
        assert math.dist(room.door, room.entrance) == pytest.approx(1.2)
        for other in ward.rooms[number + 1 :]:
            apart_x = abs(room.corner.x - other.corner.x) >= 4.6 - 1e-9
            assert apart_x or abs(room.corner.y - other.corner.y) >= 4.0 - 1e-9


def way_inside(ward: Ward, start: str, target: str) -> tuple[Position, ...]:
    end = ward.room_by_name[target]
    return (*ward.way(ward.room_by_name[start].centre, start, target), end.door, end.centre)


@pytest.mark.parametrize("ward", WARDS[:3], ids=lambda ward: f"{len(ward.rooms)} rooms")
def test_paths_follow_corridors_and_cross_no_other_room(ward: Ward):
    for start in ward.room_by_name:
        for target in ward.room_by_name:
            if start == target:
                continue
            way = way_inside(ward, start, target)
            assert length(way) == pytest.approx(length(way_inside(ward, target, start)))
            for here, there in pairwise(way):
                assert here.x == there.x or here.y == there.y
                middle = Position((here.x + there.x) / 2, (here.y + there.y) / 2)
                assert ward.room_at(middle) in ("", start, target)


def test_path_from_a_corridor_starts_there():
    ward = large_ward()
    room = ward.room_by_name["room1"]
    here = Position(room.entrance.x + 5.0, room.entrance.y)
    assert ward.way(here, "", "room1") == (here, room.entrance)
    assert ward.way(room.entrance, "", "room1") == (room.entrance,)
    beside = Position(room.entrance.x, room.entrance.y - 0.5)
    assert ward.way(beside, "", "room2")[1] == room.entrance
    spine = Position(ward.spine_x, 20.0)
    assert ward.way(spine, "", "room1")[1].x == ward.spine_x


def test_ward_does_not_depend_on_missions():
    for path in Path(ward_module.__file__).parent.glob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text()))
        modules = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        inside = [name for name in modules if name.startswith("socialbot.agents.hospital")]
        assert all(name.startswith("socialbot.agents.hospital.ward.") for name in inside), path
