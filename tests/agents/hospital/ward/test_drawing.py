from __future__ import annotations

import copy
import re
from xml.etree import ElementTree

import msgspec
import pytest

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.ward._drawing import TALLY, WardAnimation, WardDrawing
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.hospital.ward.ward import Ward, large_ward, paper_ward
from socialbot.core.clock import SECOND
from socialbot.core.registry import Film
from tests.agents.hospital.listings import NURSE, SPOT, UVD
from tests.agents.warehouse.test_drawing import shapes

SVG = "{http://www.w3.org/2000/svg}"
WARDS = [paper_ward(), large_ward(), large_ward(1, 1, 1), large_ward(120, 20, 12, 9)]


def ward_svg(ward: Ward, state: WardState, title: str = "") -> str:
    return WardDrawing(ward).draw(state, title)


def at(second: float, *faults: WorldFault, ward: Ward | None = None) -> WardState:
    world = WardWorld(ward or paper_ward(), faults=faults)
    world.advance(round(second * SECOND))
    return world.state()


def words(element: ElementTree.Element, kind: str = "text") -> list[str]:
    return [found.text or "" for found in element.iter(f"{SVG}{kind}")]


def group(picture: str, name: str) -> ElementTree.Element:
    [found] = [part for part in ElementTree.fromstring(picture).iter(f"{SVG}g") if part.get("data-name") == name]
    return found


@pytest.mark.parametrize("ward", WARDS, ids=lambda ward: f"{len(ward.rooms)} rooms")
def test_rooms_and_agents_are_named_groups_within_the_drawing(ward):
    picture = ElementTree.fromstring(ward_svg(ward, at(0.5, ward=ward)))
    named = [part.attrib["data-name"] for part in picture.iter(f"{SVG}g") if "data-name" in part.attrib]
    assert sorted(named) == sorted([TALLY, *ward.room_by_name, *ward.member_by_name])
    wide, high = float(picture.attrib["width"]), float(picture.attrib["height"])
    for part in picture.iter(f"{SVG}g"):
        if "scale" in part.get("transform", ""):
            part.attrib.pop("transform")  # signs have no rectangles
    found = list(shapes(picture))
    assert len(found) > len(ward.rooms)
    for x, y, w, h in found:
        assert min(x, y) >= 0.0
        assert x + w <= wide + 0.6
        assert y + h <= high + 0.6


def test_signs_repeat_the_meaning_of_colours():
    before, after = ward_svg(paper_ward(), at(0.5)), ward_svg(paper_ward(), at(1.0))
    assert "disinfected" in words(group(before, "room1"), "title")
    assert "to be disinfected" in words(group(after, "room1"), "title")
    assert "disinfected" in words(group(after, "room2"), "title")
    faults = (
        WorldFault(1.0, "dirty", "room2"),
        WorldFault(1.0, "enters", "room3", 9.0),
        WorldFault(1.0, "leaves", NURSE, 9.0),
        WorldFault(1.0, "closes", "room2"),
    )
    troubled = ward_svg(paper_ward(), at(2.0, *faults))
    assert "dirty" in words(group(troubled, "room2"), "title")
    assert "person inside" in words(group(troubled, "room3"), "title")
    assert "nurse absent" in words(group(troubled, "room1"), "title")
    assert "room2: door closed, dirty, disinfected" in words(group(troubled, "room2"), "title")
    assert NURSE not in troubled, "who is away is not drawn"


def test_drawing_shows_charge_and_present_action():
    world = WardWorld(paper_ward(), faults=(WorldFault(1.0, "drains", UVD),))
    world.command("a", SPOT, "a_navigate_to", (SPOT, "room1"))
    world.advance(round(0.5 * SECOND))
    spot = group(ward_svg(world.ward, world.state()), SPOT)
    assert words(spot) == ["1", "spot", "navigate to"]
    assert words(spot, "title") == ["spotrobot1: corridor, battery 100%, a_navigate_to(spotrobot1, room1)"]
    world.advance(2 * SECOND)
    picture = ward_svg(world.ward, world.state())
    assert words(group(picture, SPOT), "title") == ["spotrobot1: before room1, battery 99%"]
    assert words(group(picture, UVD), "title") == ["uvdrobot1: room4, battery 10%"]
    assert [part.attrib["class"] for part in group(picture, UVD).iter(f"{SVG}rect")][-1] == "f-red"


def test_room_with_light_is_highlighted():
    world = WardWorld(paper_ward(), start=0)
    world.change_room("room1", door_open=True)
    world.command("a", UVD, "a_navigate_to", (UVD, "room1"))
    world.advance(2 * SECOND)
    dark = ward_svg(world.ward, world.state())
    world.command("b", UVD, "a_disinfect_room", (UVD, "room1"))
    world.advance(round(2.2 * SECOND))
    light = ward_svg(world.ward, world.state())
    assert 'class="f-violet s-violet"' in light
    assert 'class="f-violet s-violet"' not in dark
    assert "1 room to be disinfected" in light
    world.advance(4 * SECOND)
    assert "all rooms disinfected" in ward_svg(world.ward, world.state())


def places(picture: str, names: list[str]) -> list[tuple[float, ...]]:
    found = [group(picture, name).attrib["transform"] for name in names]
    return [tuple(map(float, each.removeprefix("translate(").rstrip(")").split())) for each in found]


def test_agents_at_one_place_do_not_overlap():
    ward = large_ward(12, 5, 7, 1)
    world = WardWorld(ward)
    robots = list(ward.robots)
    docked = places(ward_svg(ward, world.state()), robots)
    for number, robot in enumerate(robots):
        world.command(str(number), robot, "a_navigate_to", (robot, "room1"))
    world.advance(60 * SECOND)
    waiting = places(ward_svg(ward, world.state()), robots)
    for spots in (docked, waiting):
        for number, (x, y) in enumerate(spots):
            assert all(max(abs(x - other), abs(y - there)) > 17.0 for other, there in spots[number + 1 :])


def test_unknown_rooms_are_grey_and_unknown_agents_not_drawn():
    state = at(1.0)
    known = msgspec.structs.replace(state, rooms=state.rooms[1:], agents=state.agents[1:])
    picture = ward_svg(paper_ward(), known)
    assert words(group(picture, "room1"), "title") == ["room1: unknown"]
    assert NURSE not in picture


def test_drawing_supports_dark_mode_and_escapes_title():
    picture = ward_svg(paper_ward(), at(0.0), "a < b & c")
    assert "prefers-color-scheme:dark" in picture
    assert "a < b & c" in words(ElementTree.fromstring(picture))


@pytest.fixture(scope="module")
def film() -> WardAnimation:
    """Record the first five seconds of a ward: a nurse leaves at 3 s, a robot moves to another room."""
    world = WardWorld(paper_ward(), faults=(WorldFault(3.0, "leaves", NURSE, 9.0),))
    world.command("a", SPOT, "a_navigate_to", (SPOT, "room2"))
    film = WardAnimation(world.ward)
    for tick in range(51):
        world.advance(tick * SECOND // 10)
        film.take(world.state())
    return film


def content(tracks: Film, name: str, second: float) -> str:
    number = [index for since, index in tracks.contents[name] if since <= second][-1]
    return tracks.drawings[int(number)]


def test_film_shows_past_states_of_rooms(film):
    tracks = film.film(0)
    assert "room1: door closed, tidy, disinfected" in content(tracks, "room1", 0.9)
    assert "room1: door closed, tidy, to be disinfected" in content(tracks, "room1", 1.0)
    assert "1 room to be disinfected" in content(tracks, TALLY, 2.0)


def test_film_has_track_of_moving_robot(film):
    track = film.film(0).moves[SPOT]
    assert track[0][1:] != track[-1][1:]
    assert 2 < len(track) < 30, "what lies on a straight way is left out"


def test_absent_agent_has_empty_drawing(film):
    tracks = film.film(0)
    assert content(tracks, NURSE, 2.9)
    assert content(tracks, NURSE, 3.0) == ""


def test_film_picture_has_group_for_every_agent(film):
    for second in (0, 4):
        stage = ElementTree.fromstring(film.film(second * SECOND).picture)
        named = {part.attrib["data-name"] for part in stage.iter() if "data-name" in part.attrib}
        assert named == {TALLY, *paper_ward().room_by_name, *paper_ward().member_by_name}


def test_picture_shows_state_at_its_time(film):
    assert "1 room to be disinfected" in film.picture(2 * SECOND, "at 2 s")
    assert "all rooms disinfected" in film.picture(0, "at 0 s")


def test_last_state_of_one_stamp_counts():
    world = WardWorld(paper_ward())
    film, first = WardAnimation(world.ward), world.state()
    assert not film
    film.take(first)
    world.change_room("room3", cleaned=False)
    film.take(world.state())
    film.take(WardState(stamp=-1, rooms=(), agents=()))
    assert film
    assert re.search("room3: door open, dirty", film.picture(0, ""))


def test_forget_keeps_state_and_later_changes(film):
    forgetful = copy.deepcopy(film)
    forgetful.forget(3 * SECOND)
    for tenth in range(30, 51):
        stamp = tenth * SECOND // 10
        assert forgetful.picture(stamp, "") == film.picture(stamp, "")
    assert forgetful.picture(0, "") == film.picture(3 * SECOND, "")
