"""People of simulated places: bodies, motion, schedules and scripts."""

from __future__ import annotations

import itertools
import math
import random
import time

import numpy as np
import pytest

from socialbot.core.errors import ParameterError
from socialbot.robots.simulation.figure import ANKLE_Z, SEGMENTS, Looks, figure, random_looks
from socialbot.robots.simulation.people import Crowd, Motion, Schedule, nearest_approach, read_script
from socialbot.robots.simulation.place import load_place, place_names, read_place
from socialbot.robots.simulation.posture import SEAT_M, Stance, pose

SCRIPT = """
place: foyer
people:
  - id: ada
    enter: entrance
    legs:
      - {walk: chat_1, speed: 1.0}
      - {talk: 6, to: ben}
      - {walk: robot_1, face: robot, aim: visit}
      - {stand: 4, face: robot, aim: visit}
      - {walk: corridor}
  - id: ben
    enter: office
    start: 1.5
    legs:
      - {walk: [4.6, -3.3]}
      - {talk: 8, to: ada}
      - {sit: bench_1, seconds: 5}
      - {walk: entrance}
"""


def crowd(text: str = SCRIPT) -> Crowd:
    script = read_script(text, where="script")
    return Crowd(script, load_place(script.place))


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("talk: 6", "talk: 1.0e9"), "script:8: 'talk'"),
        (("seconds: 5", "seconds: -1"), "script:18: 'seconds'"),
        (("start: 1.5", "start: 1.0e308"), "script:14: 'start'"),
        (("place: foyer", "place: foyer\nduration: 1.0e308"), "script:3: 'duration'"),
        (("[4.6, -3.3]", "[1.0e300, 0]"), "ben.*hours together"),
        (("talk: 6", "talk: 50001"), "ada.*hours together"),
        (("seconds: 5", "seconds: 50001"), "ben.*hours together"),
    ],
)
def test_people_who_stay_without_end_are_refused_at_once(change, fault):
    text = SCRIPT.replace(*change)
    begin = time.process_time()
    with pytest.raises(ParameterError, match=fault):
        crowd(text)
    assert time.process_time() - begin < 1.5


@pytest.mark.slow
def test_people_who_together_stay_without_end_are_refused():
    with pytest.raises(ParameterError, match=r"ben.*hours together"):
        crowd(SCRIPT.replace("talk: ", "talk: 3000"))


@pytest.mark.parametrize("seed", range(6))
def test_a_standing_body_is_as_tall_as_its_looks_say_and_stands_on_the_floor(seed):
    body = figure(random_looks(random.Random(seed)))
    frames = pose(body, Stance(1.0, 2.0, 0.3, 0.3))
    points = np.vstack([body.outline[name] @ frames[name][0].T + frames[name][1] for name in SEGMENTS])
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.01)
    assert points[:, 2].max() == pytest.approx(body.looks.height_m, abs=0.06)


def test_feet_of_walkers_stay_on_the_floor_and_knees_only_bend_backwards():
    body = figure(Looks())
    for step in range(60):
        frames = pose(body, Stance(0, 0, 0, 0, speed_mps=1.2, walked_m=step * 0.03))
        ankles = [frames[name][1][2] for name in ("foot_l", "foot_r")]
        assert min(ankles) < ANKLE_Z + 0.06
        for side in ("l", "r"):
            hip, knee, ankle = (frames[f"{part}_{side}"][1] for part in ("thigh", "shin", "foot"))
            along = (knee - hip)[[0, 2]]
            across = along[1] * (ankle - knee)[0] - along[0] * (ankle - knee)[2]
            assert across >= -0.012, step


def test_seated_people_sit_on_the_seat():
    body = figure(Looks())
    frames = pose(body, Stance(0, 0, 0, 0, seated=1.0))
    assert frames["pelvis"][1][2] == pytest.approx(SEAT_M + 0.115, abs=0.02)
    assert abs(frames["shin_l"][1][2] - frames["thigh_l"][1][2]) < 0.12


@pytest.mark.parametrize("seated", [0.0, 1.0])
@pytest.mark.parametrize("phase", [0, 1, 5])
def test_people_who_stay_sway_as_much_as_real_ones_and_keep_their_feet_and_seats(seated, phase):
    body = figure(Looks())

    def places(name: str, speed_mps: float = 0.0) -> np.ndarray:
        stances = [Stance(0, 0, 0, 0, speed_mps, seated=seated, time_s=time) for time in np.arange(0, 120, 0.2)]
        return np.array([pose(body, each, phase)[name][1] for each in stances])

    head, rest = places("head"), places("pelvis" if seated else "foot_l")
    forward, sideways, _ = head.std(axis=0)
    assert 0.003 < forward < 0.015
    assert 0.004 < sideways < 0.03
    assert abs(np.diff(head, axis=0)).max() < 0.2 * 0.06  # at most 6 cm/s
    assert np.ptp(rest, axis=0).max() < 0.006
    if not seated:
        walking = places("head", speed_mps=1.2)
        assert walking[:, :2].std(axis=0).max() < 0.01  # of the gait


def test_people_of_a_script_walk_talk_sit_and_leave():
    people = crowd()
    ada, ben = people.motions["ada"], people.motions["ben"]
    talk = next(one for one in ada.episodes if one.activity == "talk")
    middle = (talk.begin + talk.end) / 2 + 0.5
    first, second = ada.stance(middle), ben.stance(middle)
    assert first is not None
    assert second is not None
    towards = math.atan2(second.y - first.y, second.x - first.x)
    assert math.remainder(first.gaze_rad - towards, math.tau) == pytest.approx(0.0, abs=0.05)
    assert first.talking > 0.9
    visit = ada.episodes[3]
    stance = ada.stance(visit.end - 0.5)
    assert stance is not None
    assert math.hypot(stance.x, stance.y) == pytest.approx(1.9, abs=0.1)
    assert math.remainder(stance.gaze_rad - math.atan2(-stance.y, -stance.x), math.tau) == pytest.approx(0, abs=0.05)
    seat = next(one for one in ben.episodes if one.activity == "sit")
    assert ben.stance((seat.begin + seat.end) / 2).seated == pytest.approx(1.0)  # type: ignore[union-attr]
    assert ada.stance(ada.end + 0.1) is None


def test_nobody_jumps():
    for motion in crowd().motions.values():
        assert np.hypot(np.diff(motion.x), np.diff(motion.y)).max() < 2.0 * 0.05
        assert np.abs(np.diff(motion.heading)).max() < 6.0 * 0.05 * 2


@pytest.mark.parametrize("place", place_names())
def test_schedules_depend_on_the_seed_alone_and_keep_people_apart(place):
    room = load_place(place)
    scripts = [Schedule(place, room, people=8, duration_s=60, seed=seed).script() for seed in (1, 1, 2)]
    assert scripts[0] == scripts[1] != scripts[2]
    motions = [Motion(actor, room) for actor in scripts[0].people]
    assert min(nearest_approach(*pair) for pair in itertools.combinations(motions, 2)) >= 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("place: foyer", "place: attic"), "script:2: there is no place 'attic'"),
        (("walk: robot_1", "walk: nowhere"), "there is no spot 'nowhere'"),
        (("sit: bench_1", "sit: throne"), "there is no seat 'throne'"),
        (("enter: office", "enter: window"), "there is no door 'window'"),
        (("to: ben", "to: zoe"), "'to' must be a person of the script"),
        (("id: ben", "id: ada"), "ids of people must differ"),
        (("talk: 6", "shout: 6"), "unknown key 'shout'"),
        (("stand: 4,", "stand: 4, sit: bench_1,"), "needs one of walk, stand, talk and sit"),
    ],
)
def test_mistakes_in_scripts_are_named(change, message):
    with pytest.raises(ParameterError, match=message):
        crowd(SCRIPT.replace(*change))


def test_mistakes_in_places_are_named():
    with pytest.raises(ParameterError, match="there is no place 'moon'"):
        load_place("moon")
    with pytest.raises(ParameterError, match="x:1: 'size' must be a list of 4 numbers, got 3"):
        read_place("size: 3", where="x")
