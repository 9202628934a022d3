from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import pytest

from socialbot.agents.warehouse.drawing import BRIDGE, HOLDING, FloorDrawing, FloorView
from socialbot.agents.warehouse.messages import BoxPosition, GripperPose, GripperStatus, MoveCommand, Point
from socialbot.agents.warehouse.scenario import GRIPPER, SIX, scenario_of
from socialbot.agents.warehouse.world import Warehouse
from socialbot.core.clock import SECOND
from socialbot.core.messages import Utterance
from tests.agents.warehouse.test_world_node import Hall

SVG = "{http://www.w3.org/2000/svg}"


def world_svg(world: Warehouse, title: str = "") -> str:
    robots = {name: world.status(name).current_pos for name in (GRIPPER, *world.scenario.carriers)}
    return FloorDrawing(world.scenario).draw(robots, world.boxes(), title)


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
    assert 'class="holding"' in FloorDrawing(SIX).draw(robots, [held])
    assert 'class="holding"' not in FloorDrawing(SIX).draw(robots, [])


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
    assert texts(FloorDrawing(SIX).draw({}, [stray], "a < b & c"))[0] == "a < b & c"
    assert "<box>" not in texts(FloorDrawing(SIX).draw({}, [stray]))


START = 1_700_000_000 * SECOND


@pytest.fixture(scope="module")
def hall() -> Hall:
    """The crane takes box_a2 to base_3 while carrier_a comes: 30 s."""
    hall = Hall(noise=0.0)
    hall.tell(0.0, "/carrier_a/cmd_target", MoveCommand, target="base")
    for second, topic, kind, fields in (
        (0.0, "cmd_motors_pose", MoveCommand, {"target": "base_1"}),
        (5.0, "cmd_gripper_pose", GripperPose, {"pose": "low"}),
        (7.0, "cmd_gripper_status", GripperStatus, {"status": "close"}),
        (8.0, "cmd_gripper_pose", GripperPose, {"pose": "high"}),
        (10.0, "cmd_motors_pose", MoveCommand, {"target": "base_3"}),
        (16.0, "cmd_gripper_pose", GripperPose, {"pose": "low"}),
        (18.0, "cmd_gripper_status", GripperStatus, {"status": "open"}),
    ):
        hall.tell(second, f"/{GRIPPER}/{topic}", kind, **fields)
    hall.until(30.0)
    return hall


@pytest.fixture(scope="module")
def film(hall: Hall) -> FloorView:
    film = FloorView(SIX)
    for message in sorted((message for _, message in hall.said), key=lambda message: message.stamp):
        film.take(message)
    return film


def places(picture: str) -> dict[str, str]:
    groups = ElementTree.fromstring(picture).iter(f"{SVG}g")
    return {group.attrib["data-name"]: group.attrib["transform"] for group in groups if "data-name" in group.attrib}


def at(track: list[tuple[float, ...]], second: float) -> list[float]:
    """Return the value of a drawing track at a time."""
    before = max((n for n, moment in enumerate(track) if moment[0] <= second), default=0)
    if before + 1 == len(track):
        return list(track[-1][1:])
    (begin, *first), (end, *last) = track[before], track[before + 1]
    share = (second - begin) / (end - begin)
    return [a + (b - a) * share for a, b in zip(first, last, strict=True)]


def test_view_knows_holders_at_any_time(film):
    holders = [{box.name: box.holder for box in film.boxes(START + s * SECOND)}["box_a2"] for s in (0, 12, 29)]
    assert holders == ["base_1", GRIPPER, "base_3"]


@pytest.mark.parametrize("second", [0.0, 3.3, 5.7, 7.1, 8.5, 11.2, 12.9, 17.0, 19.0, 30.0])
def test_tracks_match_pictures(film, second):
    shown = places(film.picture(START + round(second * SECOND)))
    tracks = film.film(START)
    assert tracks.moves.keys() <= shown.keys()
    for name, track in tracks.moves.items():
        x, y = (float(word) for word in shown[name].removeprefix("translate(").rstrip(")").split())
        near = 8.0 if name in (GRIPPER, BRIDGE, "box_a2") else 4.0
        assert at(track, second)[:2] == pytest.approx([x, y], abs=near), name


def test_tracks_omit_points_on_straight_lines(film, hall):
    tracks = film.film(START)
    assert len(tracks.moves["box_b1"]) == 2
    assert len(tracks.moves[GRIPPER]) < 60


def test_film_has_holding_times(film):
    (_, before), (taken, held), (put, after) = film.film(START).classes[GRIPPER][HOLDING]
    assert (before, held, after) == (0.0, 1.0, 0.0)
    assert 7.0 <= taken < 8.0
    assert 18.0 <= put < 19.0


def test_view_without_messages_is_empty():
    film = FloorView(SIX)
    assert not film
    film.take(Utterance(stamp=1, id="a", text="a"))
    assert not film


def test_old_messages_are_ignored(film, hall):
    late = FloorView(SIX)
    for message in hall.messages("/warehouse/boxes"):
        late.take(message)
        late.take(hall.messages("/warehouse/boxes")[0])
    assert late.boxes(START + 29 * SECOND) == film.boxes(START + 29 * SECOND)


def test_forget_keeps_state_and_later_changes(hall):
    forgetful, film = FloorView(SIX), FloorView(SIX)
    for message in sorted((message for _, message in hall.said), key=lambda message: message.stamp):
        forgetful.take(message)
        film.take(message)
    forgetful.forget(START + 20 * SECOND)
    for second in (20, 21, 25, 30):
        assert places(forgetful.picture(START + second * SECOND)) == places(film.picture(START + second * SECOND))
    assert places(forgetful.picture(START + SECOND)) == places(film.picture(START + 20 * SECOND))
