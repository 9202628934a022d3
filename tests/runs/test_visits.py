"""Visits of a run: presence, engagement, sentences, and visitors that nobody addressed."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, PersonDetections, Utterance
from socialbot.runs.distances import distances_of
from socialbot.runs.folder import open_run
from socialbot.runs.history import History
from socialbot.runs.record import RunRecord
from socialbot.runs.report import report_html
from socialbot.runs.run import RunView
from socialbot.runs.visits import ADDRESS_S, Visit, visits_of
from tests.runs.expectations.traces import frame
from tests.runs.pages import read
from tests.runs.runs import greeting
from tests.system.running import socialbot_here

START = 1_700_000_000 * SECOND


def person(track: str, distance_m: float, facing_rad: float | None = None) -> PersonDetection:
    seen = PersonDetection(x=100.0, y=50.0, w=80.0, h=200.0, score=0.9, track_id=track)
    return msgspec.structs.replace(seen, distance_m=distance_m, facing_rad=facing_rad)


def recorded(folder: Path, seen: dict[int, list[PersonDetection]], said: dict[int, str], **results: object) -> Path:
    """Record a run with detections by frame (10 Hz) and sentences by frame."""
    with RunRecord(folder) as record:
        for frame in range(max((*seen, *said)) + 1):
            stamp = START + frame * SECOND // 10
            persons = tuple(seen.get(frame, ()))
            message = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=persons)
            record.observe("/humans/bodies/detections", message)
            if frame in said:
                record.observe("/speech/say", Utterance(stamp=stamp, id=f"u{frame}", text=said[frame]))
        record.write_results({"graph": "robot", "ended": "well"} | results)
    return folder


def stays(
    track: str, begin: int, end: int, distance_m: float = 2.0, facing_rad: float | None = None
) -> dict[int, list[PersonDetection]]:
    return {frame: [person(track, distance_m, facing_rad)] for frame in range(begin, end)}


def only(folder: Path, range_m: float | None = None) -> Visit:
    (visit,) = visits_of(open_run(folder), range_m)[0]
    return visit


def test_a_visit_has_its_times_frames_and_sentences(tmp_path: Path):
    seen = stays("t1", 10, 40, facing_rad=0.1) | {20: [person("t1", 1.5, 0.1)]}
    visit = only(recorded(tmp_path, seen | {80: []}, {14: "Hello!", 60: "Nobody there"}))
    assert (visit.person, visit.came_s, visit.came_frame, visit.left_s, visit.left_frame) == ("t1", 1.0, 11, 3.9, 40)
    assert (visit.nearest_m, visit.nearest_s) == (1.5, 2.0)
    assert [(said.at_s, said.text) for said in visit.said] == [(1.4, "Hello!")]
    assert (visit.engaged_s, visit.outcome, visit.delay_s) == (1.0, "in time", pytest.approx(0.4))


def test_a_visitor_may_face_the_robot_later_and_hear_the_sentence_of_an_action(tmp_path: Path):
    visits = visits_of(open_run(greeting(tmp_path, comes=5, tenths=20)), 6.0)[0]
    assert [(said.text, said.action) for said in visits[0].said] == [("Hello! Nice to see you.", 'speak("greeting")')]
    assert visits[0].faced_s is None
    seen = stays("t1", 0, 20, facing_rad=2.5) | {frame: [person("t1", 2.0, 0.3)] for frame in range(20, 40)}
    turned = only(recorded(tmp_path / "turned", seen, {}))
    assert (turned.came_s, turned.faced_s, turned.outcome) == (0.0, 2.0, "missed")


def test_the_report_lists_visits_and_who_was_missed(tmp_path: Path):
    seen = stays("t1", 10, 40, facing_rad=0.1) | stays("t2", 90, 120, facing_rad=0.1)
    words = read(report_html(open_run(recorded(tmp_path, seen, {14: "Hello!"}))))
    assert "t1 1.0 s, frame 11 2.0 m at 1.0 s 1.0 s 1.0 s 1.4 s “Hello!” 3.9 s, frame 40 in time" in words
    assert "11.9 s, frame 120 missed" in words


@pytest.mark.parametrize(
    ("said", "outcome"),
    [
        ({}, "missed"),
        ({12: "Hello!"}, "in time"),
        ({10 + int(10 * ADDRESS_S) + 2: "Hello!"}, "late"),
        ({2: "?"}, "missed"),
    ],
)
def test_an_engaged_visitor_is_due(tmp_path: Path, said: dict[int, str], outcome: str):
    assert only(recorded(tmp_path, stays("t1", 10, 60, facing_rad=0.1), said)).outcome == outcome


@pytest.mark.parametrize(
    ("said", "outcome", "delay_s"),
    [
        ({10: "To another"}, "in time", 0.0),
        ({10: "To another", 65: "Hello!"}, "in time", 0.7),
        ({10: "To another", 95: "Hello!"}, "late", 3.7),
        ({50: "Hello!", 95: "Bye!"}, "in time", 0.0),
    ],
)
def test_a_sentence_long_before_a_visitor_engages_answers_them_only_if_no_other_follows(
    tmp_path: Path, said: dict[int, str], outcome: str, delay_s: float
):
    seen = stays("t1", 0, 60, facing_rad=2.5) | stays("t1", 60, 120, facing_rad=0.1)
    visit = only(recorded(tmp_path, seen, said))
    assert (visit.engaged_s, visit.outcome) == (5.8, outcome)  # by the median of the angles
    assert visit.delay_s == pytest.approx(delay_s)


def test_a_visitor_with_the_back_turned_is_not_due(tmp_path: Path):
    visit = only(recorded(tmp_path, stays("t1", 10, 60, facing_rad=2.5), {}))
    assert (visit.engaged_s, visit.outcome) == (None, "not due")


def test_a_short_absence_does_not_end_a_visit_and_a_long_one_does(tmp_path: Path):
    seen = stays("t1", 0, 10) | stays("t1", 25, 40) | stays("t1", 80, 90)
    found, source = visits_of(open_run(recorded(tmp_path, seen, {})))
    assert [(visit.came_s, visit.left_s) for visit in found] == [(0.0, 3.9), (8.0, 8.9)]
    assert source == "tracks"


def test_the_range_is_that_of_an_agent_or_given(tmp_path: Path):
    folder = recorded(tmp_path, stays("t1", 0, 10, 4.0), {}, parameters={"bdi_engine": {"range_m": 4.5}})
    assert only(folder).nearest_m == 4.0
    assert visits_of(open_run(folder), 3.0)[0] == []


def truth_file(bag: Path, frames: int, **persons: tuple[int, int]) -> None:
    """Write the ground truth of ``bag``, with people who face the robot from and to a frame (10 Hz)."""
    about = {"x": 1, "y": 1, "w": 50, "h": 120, "distance_m": 2.0, "facing_rad": 0.0}
    content = {
        "schema": "socialbot/truth", "version": 1,
        "image_topic": "/camera/image_raw",
        "frames": [
            {
                "stamp": START + frame * SECOND // 10,
                "persons": [{"id": name, **about} for name, (begin, end) in persons.items() if begin <= frame < end],
            }
            for frame in range(frames)
        ],
    }  # fmt: skip
    bag.with_name(f"{bag.name}.truth.json").write_bytes(msgspec.json.encode(content))


@pytest.mark.parametrize(("ended", "people"), [("interrupted", ["ann"]), ("well", ["ann", "ben"])])
def test_people_of_the_bag_after_the_end_of_the_run_are_no_visitors(tmp_path: Path, ended: str, people: list[str]):
    truth_file(tmp_path / "visit", 100, ann=(0, 30), ben=(60, 90))
    bag = {"path": str(tmp_path / "visit"), "start": START, "duration_s": 10.0}
    found, _ = visits_of(open_run(recorded(tmp_path / "run", {40: []}, {}, bag=bag, ended=ended)))
    assert [visit.person for visit in found] == people


def test_ground_truth_beside_the_bag_names_the_people(tmp_path: Path):
    truth_file(tmp_path / "visit", 20, ann=(0, 20))
    bag = {"path": str(tmp_path / "visit"), "start": START, "duration_s": 2.0}
    found, source = visits_of(open_run(recorded(tmp_path / "run", {19: []}, {}, bag=bag)))
    assert ([visit.person for visit in found], source, found[0].outcome) == (["ann"], "truth", "missed")


def test_the_command_prints_a_table_or_json_and_says_if_somebody_was_missed(tmp_path: Path):
    missed = recorded(tmp_path / "a", stays("t1", 10, 60, facing_rad=0.1), {})
    done = socialbot_here("visitors", missed)
    assert done.returncode == 10
    assert "1 visit of 1 person, 1 engaged, 1 missed" in done.stdout
    met = recorded(tmp_path / "b", stays("t1", 10, 60, facing_rad=0.1), {12: "Hello!"})
    done = socialbot_here("visitors", met, "--json")
    assert (done.returncode, json.loads(done.stdout)[0]["outcome"]) == (0, "in time")


def test_a_person_who_was_out_of_view_gets_a_new_line():
    frames = [frame(at_s, t1=5.0) for at_s in (0.0, 0.1, 0.2, 0.3)] + [frame(2.0, t1=3.0), frame(2.1, t1=2.9)]
    found = distances_of(RunView(None, History(frames, start=0), None))
    assert found.tracks == {"t1": [(0.0, 5.0), (0.3, 5.0), (0.3, None), (2.0, 3.0), (2.1, 2.9)]}
