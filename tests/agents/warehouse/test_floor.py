from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import pytest

from socialbot.agents.warehouse.drawing import FloorDrawing, floor_svg, world_svg
from socialbot.agents.warehouse.messages import BoxPosition, Point
from socialbot.agents.warehouse.scenario import SIX, scenario_of
from socialbot.agents.warehouse.world import Warehouse

SVG = "{http://www.w3.org/2000/svg}"


def texts(picture: str) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(picture).iter(f"{SVG}text")]


@pytest.mark.parametrize("cast", [SIX, scenario_of(24, 6)], ids=["6", "24"])
def test_drawing_names_every_place_and_box(cast):
    words = texts(world_svg(Warehouse(cast), "At the start"))
    named = [*cast.bases, *cast.bays, *cast.deposits, "start", "gripper_a", "At the start"]
    assert sorted(words) == sorted([*named, *cast.letters, *(box.removeprefix("box_") for box in cast.boxes)])


def shapes(element: ElementTree.Element, x: float = 0.0, y: float = 0.0) -> Iterator[tuple[float, float, float, float]]:
    """All rectangles with where they are in the picture, groups that stand somewhere included."""
    if moved := element.attrib.get("transform"):
        x, y = (float(word) for word in moved.removeprefix("translate(").rstrip(")").split())
    if element.tag == f"{SVG}rect":
        left, top, wide, high = (float(element.attrib[name]) for name in ("x", "y", "width", "height"))
        yield x + left, y + top, wide, high
    for child in element:
        yield from shapes(child, x, y)


@pytest.mark.parametrize("title", ["", "At the start"])
@pytest.mark.parametrize("cast", [SIX, scenario_of(24, 6)], ids=["6", "24"])
def test_all_shapes_are_within_the_drawing(cast, title):
    picture = ElementTree.fromstring(world_svg(Warehouse(cast), title))
    wide, high = float(picture.attrib["width"]), float(picture.attrib["height"])
    found = list(shapes(picture))
    assert len(found) > 20
    for x, y, w, h in found:
        assert x >= 0
        assert y >= 0
        assert x + w <= wide + 0.5
        assert y + h <= high + 0.5


def test_moving_objects_are_named_groups():
    named = {group.attrib.get("data-name") for group in ElementTree.fromstring(world_svg(Warehouse())).iter(f"{SVG}g")}
    assert named - {None} == {"bridge", "gripper_a", *SIX.carriers, *SIX.boxes}


def test_the_gripper_shows_whether_it_holds_a_box():
    held = BoxPosition(name="box_a1", position=Point(0.0, 0.0, 1.0), holder="gripper_a")
    robots = {"gripper_a": Point(0.0, 0.0, 1.5)}
    assert 'class="holding"' in floor_svg(SIX, robots, [held])
    assert 'class="holding"' not in floor_svg(SIX, robots, [])


def test_stacked_boxes_are_drawn_later_and_higher():
    picture = world_svg(Warehouse())
    assert picture.index("box_a1") < picture.index("box_c2") < picture.index("box_a2")
    floor = FloorDrawing(SIX)
    heights = {box.name: floor.box_at(box)[1] for box in Warehouse().boxes()}
    assert heights["box_a1"] > heights["box_c2"] > heights["box_a2"]


def test_drawing_supports_dark_mode():
    assert "prefers-color-scheme:dark" in world_svg(Warehouse())


def test_title_is_escaped_and_unknown_boxes_are_omitted():
    stray = BoxPosition(name="<box>", position=Point(0.0, 0.0, 0.1), holder="floor")
    assert texts(floor_svg(SIX, {}, [stray], "a < b & c"))[0] == "a < b & c"
    assert "<box>" not in texts(floor_svg(SIX, {}, [stray]))
