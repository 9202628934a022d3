"""Waldo distinguishes people by the tracks of the detector."""

from __future__ import annotations

import math
import random

import pytest
from msgspec.structs import replace

from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.agents.waldo.waldo import PersonSensor, WaldoConfig, comes, engages, present
from socialbot.bdi.engine import Engine
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.messages import PersonDetection, PersonDetections
from tests.agents.waldo.corridor import ANNA, BEN, CARL, FAR, GREETING, OFFER, Corridor, offers, person

DISTANT_BEN = person(FAR, "t2")
TENTATIVE = replace(person(track=""), tentative=True)


def turned(facing_rad: float) -> PersonDetection:
    """Anna, who faces the robot at 0 and shows her back at pi."""
    return replace(ANNA, facing_rad=facing_rad)


VISITS = {
    "one person": (
        [(2,), (20, ANNA), (30,)], [(1.5, "stayIdle"), (2.2, "greeting"), (10.2, "offer"), (21.2, "stayIdle")],
    ),
    "tentative detections are nobody": (
        [(2,), (10, TENTATIVE), (15, ANNA, TENTATIVE)], [(1.5, "stayIdle"), (10.2, "greeting")],
    ),
    "two people together": ([(3, ANNA, BEN)], [(0.5, "greeting_several")]),
    "each new person is greeted": (
        [(4, ANNA), (12, ANNA, BEN)], [(0.5, "greeting"), (4.2, "greeting"), (8.5, "offer")],
    ),
    "new person does not inherit the time of others": (
        [(4, ANNA), (5, ANNA, BEN), (20, BEN)], [(0.5, "greeting"), (4.2, "greeting"), (12.2, "offer")],
    ),
    "people in turns are greeted, and get no offer": (
        [(4 * n + 4, person(track=f"t{n}")) for n in range(6)],
        [(0.5, "greeting"), *((4 * n + 0.2, "greeting") for n in range(1, 6))],
    ),
    "offer counts for all people present": (
        [(5, ANNA), (30, ANNA, BEN)], [(0.5, "greeting"), (5.2, "greeting"), (8.5, "offer")],
    ),
    "late person gets an offer": (
        [(10, ANNA), (12, ANNA, BEN), (40, BEN)],
        [(0.5, "greeting"), (8.5, "offer"), (10.2, "greeting"), (18.2, "offer")],
    ),
    "late people together get one offer": (
        [(10, ANNA), (40, ANNA, BEN, CARL)],
        [(0.5, "greeting"), (8.5, "offer"), (10.2, "greeting_several"), (18.2, "offer")],
    ),
    "late person who leaves gets no offer": (
        [(10, ANNA), (15, ANNA, BEN), (40, ANNA)], [(0.5, "greeting"), (8.5, "offer"), (10.2, "greeting")],
    ),
    "distant person does not count": (
        [(9, ANNA, DISTANT_BEN), (12, person(FAR, "t1"), BEN)],
        [(0.5, "greeting"), (8.5, "offer"), (9.2, "greeting")],
    ),
    "person who returns within a minute is known": (
        [(12, ANNA), (20,), (25, BEN), (30,), (50, ANNA)],
        [(0.5, "greeting"), (8.5, "offer"), (13.2, "stayIdle"), (20.2, "greeting"), (26.2, "stayIdle")],
    ),
    "person who returns later is greeted again": (
        [(5, ANNA), (70,), (75, ANNA)],
        [(0.5, "greeting"), (6.2, "stayIdle"), (70.2, "greeting")],
    ),
    "person with the back turned is not addressed": ([(20, turned(3.0))], []),
    "person who turns to the robot is greeted then": (
        [(5, turned(3.0)), (8, turned(0.2))], [(5.2, "greeting")],
    ),
    "person who turns to the robot late is greeted and offered help": (
        [(12, turned(3.0)), (14, turned(0.2))], [(12.2, "greeting"), (12.2, "offer")],
    ),
    "greeted person who turns away and back is not greeted again": (
        [(3, ANNA), (5, turned(3.0)), (8, turned(0.2))], [(0.5, "greeting")],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("scenes", "did"), VISITS.values(), ids=list(VISITS))
def test_acts_on_each_track(scenes, did):
    corridor = Corridor()
    for until, *persons in scenes:
        corridor.until(until, *persons)
    assert corridor.did == did
    assert corridor.faults == 0


def test_short_tracks_are_ignored():
    corridor = Corridor()
    corridor.until(2)
    for number in range(100):
        corridor.see(person(track=f"t{number}"))
    assert corridor.did == [(1.5, "stayIdle")]


def walks(seconds: float, begin: tuple[float, float], speed: tuple[float, float]) -> list[tuple[float, str]]:
    """Return the actions of Waldo while a person walks: start ahead and left (m), velocity (m/s)."""
    corridor = Corridor()
    corridor.until(2)
    for tenth in range(round(10 * seconds)):
        ahead, left = (place + pace * tenth / 10 for place, pace in zip(begin, speed, strict=True))
        distance_m, bearing_rad = math.hypot(ahead, left), math.atan2(left, ahead)
        corridor.see(replace(ANNA, distance_m=distance_m, bearing_rad=bearing_rad))
    return corridor.did[1:]


@pytest.mark.parametrize(
    ("begin", "speed", "greeted"),
    [
        ((5.5, 0.0), (-1.2, 0.0), True),
        ((5.5, 0.5), (-1.2, 0.0), True),
        ((3.0, 0.5), (0.0, 0.0), True),
        ((5.0, 0.5), (0.0, 0.0), True),
        ((4.0, -3.0), (0.0, 1.3), False),
        ((2.0, 0.0), (1.0, 0.0), False),
        ((5.0, 2.0), (-1.2, 0.2), False),
    ],
    ids=[
        "walks up",
        "walks up beside",
        "stands",
        "stands far away",
        "walks across",
        "walks away",
        "passes at a distance",
    ],
)
def test_only_people_who_approach_or_stand_are_greeted(begin, speed, greeted):
    assert [what for _, what in walks(3.0, begin, speed)] == (["greeting"] if greeted else [])


def at(track: str, ahead: float, left: float, facing_rad: float | None = None) -> PersonDetection:
    """Return a person at a place before the robot (m)."""
    where = {"distance_m": math.hypot(ahead, left), "bearing_rad": math.atan2(left, ahead)}
    return replace(person(track=track), facing_rad=facing_rad, **where)


def comes_up(corridor: Corridor, *others: PersonDetection, facing_rad: float | None = None) -> list[str]:
    """Let Ben walk up to the robot beside others and stop; return what was said until he stopped, and after it."""
    said = len(corridor.said)
    corridor.until(corridor.frame / 10 + 0.1, *others)
    for tenth in range(28):
        corridor.see(*others, at("t2", 5.2 - 0.12 * tenth, -0.4, facing_rad))
    before = len(corridor.said)
    corridor.see(*others, at("t2", 1.9, -0.4, facing_rad), times=12)
    return [*corridor.said[said:before], "stops", *corridor.said[before:]]


@pytest.mark.parametrize("facing_rad", [None, 0.2], ids=["unknown", "towards the robot"])
def test_who_walks_up_while_others_are_attended_to_is_greeted_on_arrival(facing_rad):
    corridor = Corridor()
    assert comes_up(corridor, facing_rad=facing_rad) == [GREETING, "stops"]
    corridor = Corridor()
    anna = at("t1", 2.0, 0.5)
    corridor.until(4, anna)
    assert corridor.said == [GREETING]
    assert comes_up(corridor, anna, facing_rad=facing_rad) == ["stops", GREETING]


def test_who_walks_up_is_greeted_when_the_attended_person_turns_away():
    corridor = Corridor()
    corridor.until(4, at("t1", 2.0, 0.5, 0.1))
    for tenth in range(24):
        corridor.see(at("t1", 2.0, 0.5, 0.1 if tenth < 12 else 3.0), at("t2", 5.2 - 0.12 * tenth, -0.4))
        if tenth == 12:
            assert corridor.said == [GREETING]
    assert corridor.said == [GREETING] * 2


def test_who_turns_towards_the_robot_is_greeted_soon():
    """A path over the last second still leads across after the turn."""
    corridor = Corridor()
    corridor.until(2)
    for tenth in range(20):
        corridor.see(at("t1", 5.0, 2.2 - 0.11 * tenth))
    assert corridor.said == []
    for tenth in range(5):
        corridor.see(at("t1", 4.9 - 0.11 * tenth, 0.1))
    assert corridor.said == [GREETING]


@pytest.mark.parametrize(("seen_s", "greetings"), [(0.2, 1), (0.6, 1), (1.6, 2)])
def test_a_greeting_is_heard_by_people_who_are_present_while_it_is_said(seen_s, greetings):
    corridor = Corridor()
    corridor.until(0.5 + seen_s, ANNA)
    corridor.until(5, ANNA, BEN)
    assert corridor.said == [GREETING] * greetings


def test_who_passes_while_others_are_attended_to_is_not_greeted():
    corridor = Corridor()
    anna = at("t1", 2.0, 0.5)
    corridor.until(4, anna)
    for tenth in range(20):  # up to the robot, then aside
        corridor.see(anna, at("t2", 5.2 - 0.12 * tenth, -0.4))
    for tenth in range(25):
        corridor.see(anna, at("t2", 2.9, -0.4 - 0.13 * tenth))
    assert corridor.said == [GREETING]


def test_who_walks_up_to_the_robot_past_a_conversation_is_greeted_on_arrival():
    corridor = Corridor()
    pair = at("t3", 4.5, 2.0, 1.6), at("t4", 4.5, 3.0, 1.2)
    corridor.until(4, *pair)
    assert any("converses" in record.what for record in corridor.trace if record.kind == "belief")
    assert comes_up(corridor, *pair) == ["stops", GREETING]


@pytest.mark.parametrize("facing_rad", [None, 2.1], ids=["unknown", "turned away"])
def test_errors_of_distances_do_not_make_people_walk_up(facing_rad):
    corridor = Corridor()
    corridor.see(at("t9", 5.8, 1.5, 0.1))  # faces are detected
    corridor.until(2)
    for distance_m in (*[4.6] * 8, 4.5, 4.4, 4.35, 4.4, 4.5, *[4.6] * 8) * 2:
        corridor.see(at("t1", distance_m, 0.3, facing_rad))
    assert corridor.said == []


def test_a_single_look_at_a_person_who_returns_to_the_view_decides_nothing():
    corridor = Corridor()
    corridor.see(at("t9", 5.8, 1.5, 0.1))  # faces are detected
    corridor.until(2)
    back = at("t1", 4.5, 1.0, 2.1)
    corridor.until(5, back)
    corridor.see(at("t3", 4.0, -1.0, 2.1), times=9)
    corridor.see(at("t1", 4.3, 0.9), times=2)
    assert corridor.said == []


def test_a_person_whom_the_detector_misses_now_and_then_is_greeted():
    corridor = Corridor()
    corridor.see(at("t9", 5.8, 1.5, 0.1))  # faces are detected
    corridor.until(2)
    for _ in range(15):
        corridor.see(at("t1", 2.0, 0.3), times=2)
        corridor.see()
    assert corridor.said == [GREETING]


@pytest.mark.parametrize("facing_rad", [None, 3.0])
def test_who_stands_far_away_must_face_the_robot_once_faces_are_seen(facing_rad):
    corridor = Corridor()
    corridor.until(2)
    far = replace(ANNA, track_id="t2", distance_m=5.0, bearing_rad=0.1)
    other = replace(turned(3.0), facing_rad=facing_rad, distance_m=5.5, bearing_rad=-0.5)
    corridor.until(6, far, other)
    greets = [what for _, what in corridor.did if what.startswith("greeting")]
    assert bool(greets) == (facing_rad is None)


def test_slow_detector_greets_people_who_approach():
    corridor = Corridor()
    for second in range(4):
        corridor.see(replace(ANNA, distance_m=5.0 - second, bearing_rad=0.0))
        corridor.frame += 9
    assert [what for _, what in corridor.did] == ["greeting"]


def sensed(sensor: PersonSensor, tenth: int, *seen: str | PersonDetection) -> list[str]:
    """Changes of beliefs by the frame at this tenth of a second, which shows tracks or persons."""
    persons = tuple(person(track=one) if isinstance(one, str) else one for one in seen)
    changes = sensor.sense(
        PersonDetections(stamp=tenth * SECOND // 10, frame_id="c", width=9, height=9, persons=persons)
    )
    return list(map(str, changes)) if isinstance(changes, list) else []


def test_clock_reset_begins_a_new_visit():
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    changes = []
    for begin, name in ((500, "t1"), (0, "t2")):
        for tenth in range(begin, begin + 40):
            changes += sensed(sensor, tenth, name)
    assert changes == [
        '+present("t1")', "+people(1)", '+personDetected("Yes")', '+engages("t1")',
        '+present("t2")', '+engages("t2")', '-engages("t1")', '-present("t1")', '+gone("t1")',
    ]  # fmt: skip


@pytest.mark.parametrize(
    "order",
    [[0, 1, 2, 3], [0, 0, 1, 2, 2, 2, 3], [0, 2, 1, 3], [3, 0, 1, 2], [1, 0, 1, 3, 2, 0]],
    ids=["as taken", "twice", "swapped", "late by three", "all of it"],
)
def test_duplicate_and_late_frames_are_ignored(order):
    """Somebody comes after 3 s and goes after 20 s; frames come in groups of four."""
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    changes = []
    for group in range(0, 240, 4):
        for tenth in (group + each for each in order):
            changes += sensed(sensor, tenth, *(["t1"] if 30 <= tenth < 200 else []))
    assert changes == [
        '+personDetected("No")', '+present("t1")', "+people(1)", '+personDetected("Yes")', '+engages("t1")',
        '+stays("t1")', '-stays("t1")', '-engages("t1")', '-present("t1")', '+gone("t1")', '+personDetected("No")',
    ]  # fmt: skip


@pytest.mark.parametrize("seen", [[], [at("t2", 3.3, -0.4)]], ids=["vanishes", "stops"])
def test_a_person_who_walked_up_comes_no_more_after_the_walk(seen):
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    changes = [change for tenth in range(16) for change in sensed(sensor, tenth, at("t2", 5.2 - 0.12 * tenth, -0.4))]
    assert '+comes("t2")' in changes
    assert '-comes("t2")' not in changes
    assert '-comes("t2")' in [change for tenth in range(16, 40) for change in sensed(sensor, tenth, *seen)]


@pytest.mark.parametrize("left", [1.1, 1.2, 1.3])
def test_a_person_at_the_border_of_walking_past_engages_once(left):
    """Bearings have an error of some milliradians, so that the path seems to pass nearer or farther."""
    sensor, errors = PersonSensor(WaldoConfig(vanish_s=1.5)), random.Random(0)
    changes = []
    for tenth in range(45):
        ahead = 6.5 - 0.12 * tenth
        changes += sensed(sensor, tenth, at("t1", ahead, left + ahead * errors.gauss(0, 0.004)))
    assert [change for change in changes if "engages" in change] == ['+engages("t1")']


def test_a_person_who_turns_aside_engages_no_more():
    sensor = PersonSensor(WaldoConfig(vanish_s=1.5))
    changes = [change for tenth in range(16) for change in sensed(sensor, tenth, at("t1", 5.2 - 0.12 * tenth, -0.4))]
    assert '+engages("t1")' in changes
    aside = [at("t1", 3.3 - 0.06 * tenth, -0.4 - 0.1 * tenth) for tenth in range(12)]
    assert '-engages("t1")' in [
        change for tenth, seen in enumerate(aside, 16) for change in sensed(sensor, tenth, seen)
    ]


def test_a_person_who_stops_while_the_agent_restarts_comes_no_more():
    engine = Engine("waldo", ManualClock())
    for belief in (present("t2"), engages("t2"), comes("t2")):
        engine.believe(belief)
    engine.run_until_idle()
    sensor = PersonSensor(WaldoConfig())
    sensor.recall(engine)
    assert '-comes("t2")' in [change for tenth in range(20) for change in sensed(sensor, tenth, at("t2", 2.0, 0.3))]


def test_nobody_walks_up_any_more_after_a_loss_of_detections():
    corridor = Corridor()
    for tenth in range(16):
        corridor.see(at("t2", 5.2 - 0.12 * tenth, -0.4))
    assert isinstance(corridor.node, WaldoNode)
    beliefs = corridor.node.engine.beliefs
    assert [one.belief for one in beliefs if isinstance(one.belief, comes)] == [comes("t2")]
    corridor.runner.advance(20 * SECOND)
    assert [one.belief for one in beliefs if isinstance(one.belief, comes | engages)] == []


def test_a_hidden_person_begins_to_engage_only_in_view():
    corridor = Corridor()
    corridor.until(2, at("t1", 2.0, 0.3, 3.0))
    corridor.see(at("t1", 2.0, 0.3, 0.1), times=2)
    corridor.see(times=3)
    assert corridor.said == []
    corridor.see(at("t1", 2.0, 0.3, 0.1))
    assert corridor.said == [GREETING]


@pytest.mark.parametrize(
    ("begin_m", "speed_mps", "hidden_s", "appears_m", "is_same"),
    [
        (4.0, 0.0, 3.0, 4.0, True),
        (4.0, 0.0, 3.0, 5.2, False),
        (5.8, -1.0, 1.5, 2.8, True),
        (5.8, -1.0, 1.5, 4.4, False),
        (3.0, 1.2, 3.0, 5.2, False),
        (4.0, 0.3, 3.0, 4.5, True),
    ],
    ids=["stood", "stood elsewhere", "on the way", "not on the way", "walked out at the same door", "shifted"],
)
def test_a_new_track_goes_on_where_the_person_would_be(begin_m, speed_mps, hidden_s, appears_m, is_same):
    sensor = PersonSensor(WaldoConfig())
    for tenth in range(16):
        sensed(sensor, tenth, at("t1", begin_m + speed_mps * tenth / 10, 0.1))
    begin = 16 + round(10 * hidden_s)
    for tenth in range(16, begin):
        sensed(sensor, tenth)
    changes = [
        change
        for tenth in range(begin, begin + 10)
        for change in sensed(sensor, tenth, at("t2", appears_m + min(speed_mps, 0.0) * (tenth - begin) / 10, 0.1))
    ]
    assert '+present("t2")' in changes
    assert ('+returned("t2", "t1")' in changes) == is_same


def test_sensor_memory_is_bounded():
    sensor = PersonSensor(WaldoConfig())
    for tenth in range(3000):
        sensed(sensor, tenth, f"t{tenth // 10}")
    assert len(sensor._changed) < 20
    assert len(sensor._strides) < 20


@pytest.mark.parametrize(("unknown", "greets"), [(8, False), (14, True)], ids=["turned away", "faces are not detected"])
def test_the_first_person_is_waited_for_until_a_face_could_have_been_found(unknown, greets):
    corridor = Corridor()
    corridor.see(times=10)
    corridor.see(at("t1", 2.5, 0.2), times=unknown)
    corridor.see(at("t1", 2.5, 0.2, 2.5 if unknown < 10 else None), times=30)
    assert (GREETING in corridor.said) == greets


@pytest.mark.parametrize(("faces", "waits"), [(False, False), (True, True), (None, True)])
def test_a_detector_that_searches_no_faces_is_not_waited_for(faces, waits):
    corridor = Corridor()
    corridor.faces = faces
    corridor.see(times=10)
    corridor.see(at("t1", 2.5, 0.2), times=8)
    assert (GREETING not in corridor.said) == waits


def test_without_faces_the_direction_of_walkers_promises_no_face():
    corridor = Corridor()
    corridor.faces = False
    corridor.see(at("t9", 5.8, 1.5, 0.1))  # the direction that a walker faces
    corridor.see(at("t1", 4.5, 0.2), times=20)
    assert corridor.said == [GREETING]


@pytest.mark.parametrize("faces", [False, True])
def test_visitors_beside_each_other_do_not_converse_for_lack_of_faces(faces):
    corridor = Corridor()
    corridor.faces = faces
    corridor.see(times=10)
    for tenth in range(28):
        corridor.see(*(at(track, 5.2 - 0.12 * tenth, left, 0.1) for track, left in (("t1", -0.5), ("t2", 0.5))))
    corridor.until(14.0, at("t1", 1.9, -0.5), at("t2", 1.9, 0.5))
    assert (OFFER in corridor.said) != faces, "faces that are searched and not found are turned aside"


def test_people_who_stand_together_converse_without_faces():
    corridor = Corridor()
    corridor.faces = False
    corridor.see(at("t1", 3.3, 2.6), at("t2", 3.3, 1.7), times=8)
    corridor.until(14.0, at("t1", 3.3, 2.6), at("t2", 3.3, 1.7))
    assert any("converses" in record.what for record in corridor.trace if record.kind == "belief")
    assert OFFER not in corridor.said


@pytest.mark.parametrize("facing_rad", [None, 1.2])
@pytest.mark.parametrize("second", [(3.5, 1.4), (4.7, 2.6)], ids=["beside", "behind"])
def test_without_faces_people_who_stop_at_each_other_are_not_greeted(second, facing_rad):
    corridor = Corridor()
    corridor.faces = False
    corridor.see(times=10)
    ahead, left = second
    for tenth in reversed(range(30)):
        late = max(tenth - 6, 0)
        corridor.see(at("t1", 3.3, 2.6 + 0.1 * late, 1.2), at("t2", ahead, left - 0.1 * tenth, 1.2))
    corridor.see(at("t1", 3.3, 2.6, facing_rad), at("t2", ahead, left, facing_rad), times=8)
    corridor.until(12.0, at("t1", 3.3, 2.6), at("t2", ahead, left))
    assert corridor.said == []


def test_without_faces_a_person_who_walks_up_to_another_one_is_not_greeted():
    corridor = Corridor(engage_m=3.6)
    corridor.faces = False
    corridor.see(at("t1", 3.9, 0.8), times=10)
    for tenth in range(20):
        corridor.see(at("t1", 3.9, 0.8), at("t2", 5.4 - 0.1 * tenth, 0.1, 0.1))
    corridor.see(at("t1", 3.9, 0.8), at("t2", 3.4, 0.1, 0.1), times=4)  # the direction of the walk
    corridor.until(12.0, at("t1", 3.9, 0.8), at("t2", 3.4, 0.1))
    assert corridor.said == []


def test_without_faces_the_second_one_of_a_queue_is_greeted():
    corridor = Corridor()
    corridor.faces = False
    corridor.see(at("t1", 1.5, 0.1), times=40)
    for tenth in range(28):
        corridor.see(at("t1", 1.5, 0.1), at("t2", 5.2 - 0.1 * tenth, 0.1, 0.1))
    corridor.until(14.0, at("t1", 1.5, 0.1), at("t2", 2.5, 0.1))
    assert corridor.said.count(GREETING) == 2


@pytest.mark.parametrize("seconds", [5.0, 9.0], ids=["before an offer is due", "after it"])
def test_a_person_whose_track_changes_has_stayed_since_the_first_one(seconds):
    corridor = Corridor()
    corridor.until(seconds, at("t1", 2.0, 0.1, 0.1))
    corridor.see(times=5)
    corridor.until(20.0, at("t2", 2.1, 0.2, 0.1))
    assert offers(corridor) == [pytest.approx(8.5, abs=0.1)]
