"""The picture of the packages matches the code."""

from __future__ import annotations

from pathlib import Path

from tools import house


def test_the_picture_in_the_docs_is_up_to_date():
    assert house.PICTURE.read_text() == house.house(), "run python tools/house.py"


def test_the_picture_has_at_most_14_rooms_on_9_floors():
    levels = house.floors(house.uses())
    assert len(levels) <= 9
    assert sum(map(len, levels)) <= 14


def test_no_floor_uses_a_higher_one():
    graph = house.uses()
    below: set[str] = set()
    for names in house.floors(graph):
        below |= set(names)
        assert all(graph[room] <= below for room in names)
    assert below == set(house.rooms())


def test_imports_inside_functions_count(tmp_path: Path):
    file = tmp_path / "one.py"
    file.write_text(
        "import os, socialbot.core.clock\ndef run():\n    from socialbot import bdi\n"
        "    from socialbot.graph.node import Node\n"
    )
    assert set(house.used_rooms(file)) == {"core", "bdi", "graph"}


def test_packages_that_use_each_other_share_a_floor():
    graph = {
        "high": frozenset({"left"}),
        "left": frozenset({"right", "low"}),
        "low": frozenset[str](),
        "right": frozenset({"left"}),
    }
    assert house.floors(graph) == [("low",), ("left", "right"), ("high",)]
