"""The example `hospital_patrol`: a room camera, the person detector, and a robot that uses the detections."""

from __future__ import annotations

import functools
import importlib
import logging
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.hospital.ward.messages import PERSON_IN_ROOM, STATE, AgentState, WardState
from socialbot.agents.teams.messages import ActionResult, Belief, Plan, Problem
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Image, PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.files import load_graph, with_changes
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.vision.metrics.truth import load_truth
from tests.agents.hospital.alone import Alone
from tests.agents.hospital.listings import NURSE, ROOM, SPOT
from tests.agents.hospital.watched import Watched

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)
logging.getLogger("socialbot.bdi").setLevel(logging.ERROR)

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "hospital_patrol" / "graph.yaml"
GRAPH = load_graph(str(EXAMPLE))
room_camera = importlib.import_module("room_camera")
seeing_spot = importlib.import_module("seeing_spot")

SEEN = "/humans/bodies/detections"
IMAGES = "/camera/image_color"


class Shift(Watched):
    """A run of the example, and its messages."""

    def __init__(self, graph: Graph, without: str) -> None:
        self.results: list[ActionResult] = []
        self.states: list[WardState] = []
        self.trace: dict[str, TraceRecord] = {}
        self.detections: list[PersonDetections] = []
        super().__init__(graph, start=SECOND, without=without)

    def observe(self, topic: str, message) -> None:
        super().observe(topic, message)
        match message:
            case ActionResult():
                self.results.append(message)
            case WardState():
                self.states.append(message)
            case TraceRecord(source=source) if source == SPOT:
                self.trace[message.id] = message
            case PersonDetections():
                self.detections.append(message)

    def times(self, action: str) -> set[int]:
        """Stamps of the states with an agent at that action."""
        return {state.stamp for state in self.states for agent in state.agents if agent.busy.startswith(action)}


def shift(*changes: str, seconds: float, without: str = "") -> Shift:
    found = Shift(with_changes(GRAPH, ["room_camera.rate_hz=1.0", *changes]), without)
    return found.until(seconds)


@pytest.fixture(scope="module")
def whole() -> Shift:
    return shift(seconds=520.0)


@functools.cache
def truth_of(clip: str) -> dict[int, int]:
    """Return the number of people in each image of a clip, by stamp."""
    truth = load_truth(room_camera.CLIPS / f"{clip}.truth.json")
    return {frame.stamp: len(frame.persons) for frame in truth.frames}


def people(run: Shift, time: int) -> int:
    """Return the true number of people in the room, from the ground truth of the current clip."""
    camera = run.runner.nodes["room_camera"]
    return truth_of(camera.scene_at(time).clip)[camera.picture_at(time).stamp]  # type: ignore[attr-defined]


def test_light_is_off_while_a_person_is_in_view(whole):
    lit = sorted(whole.times("a_disinfect_room"))
    assert ROOM not in whole.infected()
    assert (lit[-1] - lit[0]) / SECOND > 290.0
    assert {people(whole, time) for time in lit} == {0}


def test_records_of_sight_match_the_ground_truth(whole):
    sights = [record for record in whole.trace.values() if record.kind == "sees"]
    assert [record.what for record in sights] == [f"somebody in {ROOM}"] * 4 + [f"nobody in {ROOM}"]
    assert [people(whole, record.stamp) > 0 for record in sights] == [True] * 4 + [False]
    for record in sights[:-1]:
        assert record.detail["score"] > 0.5
        assert 1.0 < record.detail["distance_m"] < 15.0


def test_coat_on_a_stand_is_a_false_positive_in_the_first_image_only(whole):
    first, second = whole.detections[:2]
    assert len(first.persons) == people(whole, first.stamp) + 1
    assert len(second.persons) == people(whole, second.stamp)


def test_person_in_the_room_leads_to_new_plans(whole):
    problems = whole.contents(Problem)
    assert [(problem.kind, problem.action) for problem in problems] == [(PERSON_IN_ROOM, "a_patrol_room")] * 2
    plans = [message.content for message in whole.said if message.receiver == NURSE]
    adapts = ["a_adapt_room" in " ".join(plan.plans) for plan in plans if isinstance(plan, Plan)]
    assert adapts == [False, True, True]
    assert [(mission.status, mission.recoveries) for mission in whole.views.values()] == [("finished", 2)]


def test_trace_leads_from_the_cancelled_action_to_the_image(whole):
    causes = []
    record = next(each for each in whole.trace.values() if each.what.startswith("break_off"))
    while record.cause in whole.trace:
        record = whole.trace[record.cause]
        causes.append(record.what)
    assert f"somebody({ROOM})" in " ".join(causes)
    assert causes[-1] == f"somebody in {ROOM}"
    assert record.cause in {found.id for found in whole.detections}


def test_room_without_detections_is_not_disinfected():
    run = shift(seconds=300.0, without="person_detector")
    assert {problem.kind for problem in run.contents(Problem)} == {seeing_spot.NOT_SEEN}
    assert len(run.contents(Problem)) > 2
    assert not run.times("a_disinfect_room")


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenes",
    [
        pytest.param("0 scene1_tune 5-27; 90 scene1_tune 0-2.8", id="a group that goes"),
        pytest.param("0 scene1_tune 0-2.8; 35 scene1_tune 3.5-20; 150 scene2_tune 0-3.4", id="who comes later"),
        pytest.param("0 scene1_tune 38-43; 120 scene1_tune 27.8-29.9", id="one near the camera"),
        pytest.param("0 scene2_tune 30-41; 34 scene2_tune 0-3.4", id="somebody for a moment"),
    ],
)
def test_no_patrol_succeeds_with_a_person_in_view(scenes):
    run = shift(f"room_camera.scenes={scenes}", "room_camera.rate_hz=2.0", seconds=600.0)
    done = [result for result in run.results if (result.action, result.outcome) == ("a_patrol_room", "success")]
    assert ROOM not in run.infected()
    assert len(done) == 1
    seen = [time for time in run.times("a_patrol_room") if time >= done[0].stamp - 20 * SECOND]
    assert {people(run, time) for time in [*seen, *run.times("a_disinfect_room")]} == {0}


# The robot alone

PATROL = (
    "+initial_trigger_a_patrol_room(S, R) : start(N, R, S, U) <- !a_patrol_room(S, R).",
    "+!a_patrol_room(S, R) : start(N, R, S, U) <- a_patrol_room(S, R).",
)


class Patrol(Alone):
    """A robot on patrol; the test plays the others."""

    def __init__(self) -> None:
        super().__init__(seeing_spot.SeeingSpot, topics=(SEEN,), start=SECOND, recovers=False)
        self.take_on(*PATROL)
        self.tell(Belief(f"initial_trigger_a_patrol_room({SPOT}, {ROOM})"))
        assert self.done() == ["a_patrol_room"]

    @property
    def problems(self) -> list[str]:
        return [problem.kind for problem in self.contents(Problem)]

    def look(self, *pictures: int, room: str = ROOM, every_s: float = 0.5, age_s: float = 0.0) -> Patrol:
        """Shows it how many people there are in each picture."""
        person = PersonDetection(x=0.0, y=0.0, w=50.0, h=150.0, score=0.8, distance_m=4.0)
        for count in pictures:
            now = self.runner.clock.now() + nanoseconds(every_s)
            found = PersonDetections(
                stamp=now - nanoseconds(age_s),
                frame_id=f"{room}_camera",
                width=640,
                height=480,
                persons=(person,) * count,
            )
            self.runner.feed(SEEN, found, time=now)
        return self

    def end(self, after_s: float = 0.0) -> Patrol:
        """End the patrol with success, as the world reports it."""
        self.runner.advance(self.runner.clock.now() + nanoseconds(after_s))
        self.answer("success")
        assert not self.runner.faults[SPOT].failures, self.runner.faults[SPOT].first
        return self


def test_empty_room_passes():
    assert Patrol().look(0, 0, 0, 0).end().problems == []


def test_person_ends_the_patrol_at_once_and_cancels_its_command():
    patrol = Patrol().look(0, 2, 1)
    assert patrol.problems == [PERSON_IN_ROOM]
    assert [cancel.id for cancel in patrol.cancels] == [patrol.commands[0].id]
    assert patrol.end().problems == [PERSON_IN_ROOM]


def test_single_detections_are_ignored():
    assert Patrol().look(0, 1, 0, 0, 1, 0).end().problems == []


def test_detection_at_the_end_fails_the_patrol():
    patrol = Patrol().look(0, 0, 0, 1)
    assert not patrol.problems
    assert patrol.end().problems == [PERSON_IN_ROOM]


@pytest.mark.parametrize(
    "looks",
    [
        pytest.param(lambda patrol: patrol, id="no picture"),
        pytest.param(lambda patrol: patrol.look(0, 0, room="room2"), id="another room"),
        pytest.param(lambda patrol: patrol.look(0, 0, age_s=5.0), id="from before"),
        pytest.param(lambda patrol: patrol.look(0, 0).look(0, every_s=3.0), id="a gap"),
        pytest.param(lambda patrol: patrol.look(0, 0).end(3.0), id="none at the end"),
    ],
)
def test_room_without_enough_images_does_not_pass(looks):
    patrol = looks(Patrol())
    if not patrol.problems:
        patrol.end()
    assert patrol.problems == [seeing_spot.NOT_SEEN]


# The camera


def watched(busy: str, **parameters: object) -> list[Image]:
    """The pictures that a camera at 2 Hz takes while a robot is so busy for 2 s, and for 2 s afterwards."""
    config = NodeConfig("room_camera", room_camera.RoomCamera, {"scenes": "0 scene2_tune 0-3", **parameters})
    runner = InlineRunner(Graph("camera", (config,), inputs=frozenset({STATE})), start=SECOND)
    pictures: list[Image] = []
    runner.tap(IMAGES, lambda _, message: pictures.append(message))  # type: ignore[arg-type]
    runner.start()
    for second, doing in ((1, ""), (3, busy), (4, busy), (5, "")):
        spot = AgentState(name=SPOT, kind="spotrobot", home="room4", place=ROOM, inside=True, x=0.0, y=0.0, busy=doing)
        runner.feed(STATE, WardState(stamp=second * SECOND, rooms=(), agents=(spot,)))
    runner.advance(7 * SECOND)
    return pictures


def test_camera_is_on_during_a_patrol_of_its_room():
    pictures = watched(f"a_patrol_room({SPOT}, {ROOM})")
    assert [picture.stamp / SECOND for picture in pictures] == [3.0, 3.5, 4.0, 4.5, 5.0]
    assert {picture.frame_id for picture in pictures} == {"room1_camera"}
    assert (pictures[0].bgr() != pictures[1].bgr()).any()


@pytest.mark.parametrize("busy", [f"a_patrol_room({SPOT}, room2)", f"a_navigate_to({SPOT}, {ROOM})"])
def test_camera_is_off_otherwise(busy):
    assert watched(busy) == []


def test_camera_shows_the_room_at_first():
    assert [picture.stamp / SECOND for picture in watched("", learn_s=2.0)] == [1.0, 1.5, 2.0, 2.5, 3.0]


@given(
    begin=st.floats(0.0, 40.0), length=st.floats(0.0, 40.0), start=st.floats(0.0, 100.0), after=st.floats(0.0, 1000.0)
)
def test_scene_plays_forwards_and_backwards_without_jumps(begin, length, start, after):
    scene = room_camera.Scene(start, "x", begin, begin + length)
    here, there = scene.moment_s(start + after), scene.moment_s(start + after + 0.1)
    assert begin - 1e-9 <= here <= begin + length + 1e-9
    assert abs(there - here) <= 0.1 + 1e-6


@pytest.mark.parametrize("text", ["", "5 scene1_tune 0-2", "0 scene1_tune 3-2", "0 scene1_tune", "now scene1_tune 0-2"])
def test_invalid_scenes_are_refused(text):
    with pytest.raises(ParameterError, match="scenes"):
        room_camera.parse_scenes(text)


def test_scenes_are_sorted_by_their_begin():
    scenes = room_camera.parse_scenes("20 b 1-2; 0 a 0-3.5;")
    assert [(scene.start_s, scene.clip, scene.end_s) for scene in scenes] == [(0.0, "a", 3.5), (20.0, "b", 2.0)]
