from __future__ import annotations

import copy
import re
from xml.etree import ElementTree

import pytest

from socialbot.agents.base.simulation import WorldFault
from socialbot.agents.hospital.ward.drawing import TALLY, WardAnimation
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, paper_ward
from socialbot.agents.hospital.ward.world import WardWorld
from socialbot.core.clock import SECOND


@pytest.fixture(scope="module")
def film() -> WardAnimation:
    """The first five seconds of a ward: a nurse is away from 3 s on, a robot goes to another room."""
    world = WardWorld(paper_ward(), faults=(WorldFault(3.0, "leaves", f"{NURSE}1", 9.0),))
    world.command("a", f"{SPOT}1", "a_navigate_to", (f"{SPOT}1", "room2"))
    film = WardAnimation(world.ward)
    for tick in range(51):
        world.advance(tick * SECOND // 10)
        film.take(world.state())
    return film


def face(tracks: dict, name: str, second: float) -> str:
    number = [face for since, face in tracks["faces"][name] if since <= second][-1]
    return tracks["drawings"][number]


def test_film_shows_past_states_of_rooms(film):
    tracks = film.film(0)
    assert "room1: door closed, tidy, disinfected" in face(tracks, "room1", 0.9)
    assert "room1: door closed, tidy, to be disinfected" in face(tracks, "room1", 1.0)
    assert "1 room to be disinfected" in face(tracks, TALLY, 2.0)


def test_film_has_track_of_moving_robot(film):
    track = film.film(0)["robots"][f"{SPOT}1"]
    assert track[0][1:] != track[-1][1:]
    assert 2 < len(track) < 30, "what lies on a straight way is left out"


def test_absent_agent_has_empty_drawing(film):
    tracks = film.film(0)
    assert face(tracks, f"{NURSE}1", 2.9)
    assert face(tracks, f"{NURSE}1", 3.0) == ""


def test_film_picture_has_group_for_every_agent(film):
    for second in (0, 4):
        stage = ElementTree.fromstring(film.film(second * SECOND)["picture"])
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
    world.rooms["room3"].cleaned = False
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
