"""The picture of the house is that of the code."""

from __future__ import annotations

from pathlib import Path

from tools import house


def test_the_picture_in_docs_is_up_to_date():
    assert house.PICTURE.read_text() == house.house(), "run python tools/house.py"


def test_no_floor_uses_what_is_above_it():
    graph = house.uses()
    below: set[str] = set()
    for rooms in house.floors(graph):
        below |= set(rooms)
        assert all(graph[room] & set(house.folders()) <= below for room in rooms)
    assert below == set(house.folders())


def test_the_ground_stands_on_itself():
    graph = house.uses()
    ground = set(house.ground(graph))
    assert all(graph[module] <= ground for module in ground)


def test_imports_inside_functions_count(tmp_path: Path):
    file = tmp_path / "one.py"
    file.write_text(
        "import os, socialbot.core.clock\ndef run():\n    from socialbot import bdi\n"
        "    from socialbot.graph.node import Node\n"
    )
    assert set(house.used_parts(file)) == {"core", "bdi", "graph"}


def test_parts_that_use_each_other_share_a_floor(monkeypatch):
    monkeypatch.setattr(house, "folders", lambda: ("high", "left", "low", "right"))
    graph = {
        "high": frozenset({"left"}),
        "left": frozenset({"right", "low"}),
        "right": frozenset({"left"}),
        "low": frozenset[str](),
    }
    assert house.floors(graph) == [("low",), ("left", "right"), ("high",)]
