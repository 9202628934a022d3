"""Waldo knows who is who by the tracks of the detector."""

from __future__ import annotations

import pytest

from socialbot.agents.waldo.waldo import PersonSensor, WaldoConfig
from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetections
from tests.agents.waldo.corridor import ANNA, BEN, CARL, FAR, Corridor, offers, person


def test_with_tracks_a_visit_is_the_same():
    corridor = Corridor()
    corridor.until(2)
    corridor.until(20, ANNA)
    corridor.until(30)
    assert corridor.did == [(1.5, "stayIdle"), (2.2, "greeting"), (10.2, "offer"), (21.2, "stayIdle")]


def test_who_joins_does_not_restart_the_time_of_who_is_there():
    corridor = Corridor()
    corridor.until(4, ANNA)
    corridor.until(12, ANNA, BEN)
    assert corridor.did == [(0.5, "greeting"), (8.5, "offer")]


def test_who_joins_is_not_offered_help_for_the_time_that_another_was_there():
    corridor = Corridor()
    corridor.until(4, ANNA)
    corridor.until(5, ANNA, BEN)
    corridor.until(20, BEN)
    assert corridor.did == [(0.5, "greeting"), (12.2, "offer")]


def test_people_who_take_turns_are_offered_no_help():
    corridor = Corridor()
    for number in range(10):
        corridor.until(4 * (number + 1), person(track=f"t{number}"))
    assert corridor.did == [(0.5, "greeting")]
    assert corridor.faults == 0


def test_who_is_there_while_help_is_offered_to_another_has_heard_it():
    corridor = Corridor()
    corridor.until(5, ANNA)
    corridor.until(30, ANNA, BEN)
    assert offers(corridor) == [8.5]


def test_who_comes_after_the_offer_and_stays_is_offered_help_as_well():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(12, ANNA, BEN)
    corridor.until(40, BEN)
    assert offers(corridor) == [8.5, 18.2]


def test_those_who_come_late_together_are_offered_help_once():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(11, ANNA, BEN)
    corridor.until(40, ANNA, BEN, CARL)
    assert offers(corridor) == [8.5, 18.2]


def test_who_comes_late_and_leaves_is_not_offered_help():
    corridor = Corridor()
    corridor.until(10, ANNA)
    corridor.until(15, ANNA, BEN)
    corridor.until(40, ANNA)
    assert offers(corridor) == [8.5]


def test_who_comes_when_another_leaves_is_nobody_new_to_greet():
    corridor = Corridor()
    corridor.until(5, ANNA)
    corridor.until(12, BEN)
    assert corridor.did == [(0.5, "greeting")]
    corridor.until(14, BEN)
    assert corridor.did[1:] == [(13.2, "offer")]


def test_tracks_that_last_a_moment_are_nobody():
    corridor = Corridor()
    corridor.until(2)
    for number in range(100):
        corridor.see(person(track=f"t{number}"))
    assert corridor.did == [(1.5, "stayIdle")]


def test_people_with_tracks_are_greeted_together():
    corridor = Corridor()
    corridor.until(3, ANNA, BEN)
    assert corridor.did == [(0.5, "greeting_several")]


def test_who_is_near_is_greeted_and_who_is_far_is_not_waited_for():
    corridor = Corridor()
    corridor.until(9, ANNA, person(FAR, "t2"))
    assert corridor.did == [(0.5, "greeting"), (8.5, "offer")]
    corridor.until(12, person(FAR, "t1"), person(2.0, "t2"))
    assert len(corridor.did) == 2


def test_a_recording_that_begins_anew_is_another_visit_of_other_people():
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    told: list[str] = []
    for begin, name in ((50, "t1"), (0, "t2")):
        for tenth in range(40):
            frame = PersonDetections(
                stamp=begin * SECOND + tenth * SECOND // 10, frame_id="c", width=9, height=9,
                persons=(person(track=name),),
            )  # fmt: skip
            sensed = sensor.sense(frame)
            told += map(str, sensed if isinstance(sensed, list) else ())
    assert told == ['+present("t1")', "+people(1)", '+personDetected("Yes")', '+present("t2")', '-present("t1")']


@pytest.mark.parametrize(
    "order",
    [[0, 1, 2, 3], [0, 0, 1, 2, 2, 2, 3], [0, 2, 1, 3], [3, 0, 1, 2], [1, 0, 1, 3, 2, 0]],
    ids=["as taken", "twice", "swapped", "late by three", "all of it"],
)
def test_frames_that_come_twice_or_late_change_nothing_but_when_it_is_noticed(order):
    """Somebody comes after 3 s and goes after 20 s; frames come in groups of four."""
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    told: list[str] = []
    for group in range(0, 240, 4):
        for tenth in (group + each for each in order):
            there = (person(track="t1"),) if 30 <= tenth < 200 else ()
            sensed = sensor.sense(
                PersonDetections(stamp=tenth * SECOND // 10, frame_id="c", width=9, height=9, persons=there)
            )
            told += map(str, sensed if isinstance(sensed, list) else ())
    assert told == [
        '+personDetected("No")', '+present("t1")', "+people(1)", '+personDetected("Yes")', '+stays("t1")',
        '-stays("t1")', '-present("t1")', '+personDetected("No")',
    ]  # fmt: skip


def test_what_is_kept_of_people_does_not_pile_up():
    sensor = PersonSensor(WaldoConfig())
    for tenth in range(3000):
        frame = PersonDetections(
            stamp=tenth * SECOND // 10, frame_id="c", width=9, height=9, persons=(person(track=f"t{tenth // 10}"),)
        )
        sensor.sense(frame)
    assert len(sensor._changed) < 20
