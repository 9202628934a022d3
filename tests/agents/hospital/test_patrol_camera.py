"""The example of a patrol that sees: a room camera, the person detector, and a robot that believes what it sees."""

from __future__ import annotations

import functools
import importlib
import logging
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.hospital.coordinator import MISSIONS
from socialbot.agents.hospital.messages import TOPIC, AclMessage, Belief, Missions, Plan, Problem, Start
from socialbot.agents.hospital.ward.messages import (
    CANCELS,
    COMMANDS,
    PERSON_IN_ROOM,
    RESULTS,
    STATE,
    ActionCancel,
    ActionCommand,
    ActionResult,
    AgentState,
    WardState,
)
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Image, PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.files import load_graph, with_changes
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.vision.metrics.truth import load_truth
from tests.agents.hospital.listings import NURSE, ROOM, SPOT, UVD

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)
logging.getLogger("socialbot.bdi").setLevel(logging.ERROR)

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "hospital_patrol" / "graph.yaml"
GRAPH = load_graph(str(EXAMPLE))
room_camera = importlib.import_module("room_camera")
seeing_spot = importlib.import_module("seeing_spot")

SEEN = "/humans/bodies/detections"
IMAGES = "/camera/image_color"


@dataclass
class Shift:
    """A run of the example, and what happened in it."""

    runner: InlineRunner
    results: list[ActionResult] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)
    states: list[WardState] = field(default_factory=list)
    trace: dict[str, TraceRecord] = field(default_factory=dict)
    detections: list[PersonDetections] = field(default_factory=list)
    missions: Missions | None = None

    def take(self, topic: str, message) -> None:
        match message:
            case ActionResult():
                self.results.append(message)
            case AclMessage(content=Problem() as problem):
                self.problems.append(problem)
            case AclMessage(content=Plan() as plan, receiver=receiver) if receiver == NURSE:
                self.plans.append(plan)
            case WardState():
                self.states.append(message)
            case TraceRecord():
                self.trace[message.id] = message
            case PersonDetections():
                self.detections.append(message)
            case Missions():
                self.missions = message

    def times(self, action: str) -> set[int]:
        """When somebody was at that action."""
        return {state.stamp for state in self.states for agent in state.agents if agent.busy.startswith(action)}

    @property
    def disinfected(self) -> bool:
        room = self.states[-1].room(ROOM)
        return room is not None and room.disinfected


def shift(*changes: str, seconds: float, without: str = "") -> Shift:
    found = Shift(InlineRunner(with_changes(GRAPH, ["room_camera.rate_hz=1.0", *changes]), start=SECOND))
    for topic in (RESULTS, TOPIC, STATE, SEEN, MISSIONS, f"/{SPOT}/trace"):
        found.runner.tap(topic, found.take)
    if without:
        found.runner.kill(without)
    found.runner.start()
    found.runner.advance(nanoseconds(seconds))
    assert not [faults.first for faults in found.runner.faults.values() if faults.failures]
    return found


@pytest.fixture(scope="module")
def whole() -> Shift:
    return shift(seconds=520.0)


@functools.cache
def truth_of(clip: str) -> dict[int, int]:
    """How many people there are in each picture of a clip, by its stamp."""
    truth = load_truth(room_camera.CLIPS / f"{clip}.truth.json")
    return {frame.stamp: len(frame.persons) for frame in truth.frames}


def people(run: Shift, time: int) -> int:
    """How many there really are in the room, by the truth of the clip that is shown."""
    camera = run.runner.nodes["room_camera"]
    return truth_of(camera.scene_at(time).clip)[camera.picture_at(time).stamp]  # type: ignore[attr-defined]


def test_the_lamp_is_never_on_while_somebody_is_in_view(whole):
    lit = sorted(whole.times("a_disinfect_room"))
    assert whole.disinfected
    assert (lit[-1] - lit[0]) / SECOND > 290.0
    assert {people(whole, time) for time in lit} == {0}


def test_who_is_seen_is_there_and_who_is_not_seen_is_not(whole):
    sights = [record for record in whole.trace.values() if record.kind == "sees"]
    assert [record.what for record in sights] == [f"somebody in {ROOM}"] * 4 + [f"nobody in {ROOM}"]
    assert [people(whole, record.stamp) > 0 for record in sights] == [True] * 4 + [False]
    for record in sights[:-1]:
        assert record.detail["score"] > 0.5
        assert 1.0 < record.detail["distance_m"] < 15.0


def test_a_coat_on_a_stand_is_taken_for_somebody_in_the_first_picture_only(whole):
    first, second = whole.detections[:2]
    assert len(first.persons) == people(whole, first.stamp) + 1
    assert len(second.persons) == people(whole, second.stamp)


def test_somebody_is_a_problem_that_changes_the_plan_until_the_room_is_empty(whole):
    assert {(problem.kind, problem.action) for problem in whole.problems} == {(PERSON_IN_ROOM, "a_patrol_room")}
    assert len(whole.problems) == 2
    adapts = ["a_adapt_room" in " ".join(plan.plans) for plan in whole.plans]
    assert adapts == [False, True, True]
    assert whole.missions is not None
    (mission,) = whole.missions.missions
    assert (mission.status, mission.recoveries) == ("finished", 2)


def test_the_trace_leads_from_what_is_broken_off_back_to_the_picture(whole):
    causes = []
    record = next(each for each in whole.trace.values() if each.what.startswith("break_off"))
    while record.cause in whole.trace:
        record = whole.trace[record.cause]
        causes.append(record.what)
    assert f"somebody({ROOM})" in " ".join(causes)
    assert causes[-1] == f"somebody in {ROOM}"
    assert record.cause in {found.id for found in whole.detections}


def test_a_room_that_nobody_looks_at_is_not_disinfected():
    run = shift(seconds=300.0, without="person_detector")
    assert {problem.kind for problem in run.problems} == {seeing_spot.NOT_SEEN}
    assert len(run.problems) > 2
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
def test_no_patrol_passes_with_somebody_in_view(scenes):
    run = shift(f"room_camera.scenes={scenes}", "room_camera.rate_hz=2.0", seconds=600.0)
    done = [result for result in run.results if (result.action, result.outcome) == ("a_patrol_room", "success")]
    assert run.disinfected
    assert len(done) == 1
    seen = [time for time in run.times("a_patrol_room") if time >= done[0].stamp - 20 * SECOND]
    assert {people(run, time) for time in [*seen, *run.times("a_disinfect_room")]} == {0}


# The robot alone

PATROL = (
    "+initial_trigger_a_patrol_room(S, R) : start(N, R, S, U) <- !a_patrol_room(S, R).",
    "+!a_patrol_room(S, R) : start(N, R, S, U) <- a_patrol_room(S, R).",
)


class Patrol:
    """A robot on patrol; the test plays everybody else."""

    def __init__(self, **parameters) -> None:
        placement = NodeConfig(SPOT, seeing_spot.SeeingSpot, {"recovers": False, **parameters})
        topics = frozenset({TOPIC, RESULTS, STATE, SEEN})
        self.runner = InlineRunner(Graph("alone", (placement,), inputs=topics), start=SECOND)
        self.problems: list[str] = []
        self.commands: list[ActionCommand] = []
        self.cancelled: list[str] = []
        self.runner.tap(TOPIC, self._hear)
        self.runner.tap(COMMANDS, lambda _, message: self.commands.append(message))  # type: ignore[arg-type]
        self.runner.tap(CANCELS, self._cancel)
        self.runner.start()
        self._say(Plan("mission_1_1", tuple(f"@mission_1_1_{at} {text}" for at, text in enumerate(PATROL))))
        self._say(Start((NURSE, ROOM, SPOT, UVD)))
        self._say(Belief(f"initial_trigger_a_patrol_room({SPOT}, {ROOM})"))
        assert [command.action for command in self.commands] == ["a_patrol_room"]

    def _hear(self, topic: str, message) -> None:
        if isinstance(message.content, Problem):
            self.problems.append(message.content.kind)

    def _cancel(self, topic: str, message) -> None:
        assert isinstance(message, ActionCancel)
        self.cancelled.append(message.id)

    def _say(self, content) -> None:
        now = self.runner.clock.now()
        message = AclMessage(
            stamp=now, id=f"m{now}", sender="coordinator", receiver=SPOT, content=content, mission="mission_1_1",
            performative="request" if isinstance(content, Start) else "inform",
        )  # fmt: skip
        self.runner.feed(TOPIC, message)

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
        """The time of the patrol is over, and the world knows of nothing that was wrong."""
        self.runner.advance(self.runner.clock.now() + nanoseconds(after_s))
        last = self.commands[-1]
        result = ActionResult(
            stamp=self.runner.clock.now(), id=last.id, robot=SPOT, action=last.action, args=last.args, outcome="success"
        )
        self.runner.feed(RESULTS, result)
        assert not self.runner.faults[SPOT].failures, self.runner.faults[SPOT].first
        return self


def test_an_empty_room_passes():
    assert Patrol().look(0, 0, 0, 0).end().problems == []


def test_somebody_ends_the_patrol_at_once_and_the_world_is_told():
    patrol = Patrol().look(0, 2, 1)
    assert patrol.problems == [PERSON_IN_ROOM]
    assert patrol.cancelled == [patrol.commands[0].id]
    assert patrol.end().problems == [PERSON_IN_ROOM]


def test_one_glimpse_is_nobody():
    assert Patrol().look(0, 1, 0, 0, 1, 0).end().problems == []


def test_a_glimpse_at_the_very_end_is_looked_into():
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
def test_a_room_that_was_not_seen_does_not_pass(looks):
    patrol = looks(Patrol())
    if not patrol.problems:
        patrol.end()
    assert patrol.problems == [seeing_spot.NOT_SEEN]


# The camera


def watched(busy: str, *, scenes: str = "0 scene2_tune 0-3") -> list[Image]:
    """The pictures that a camera at 2 Hz takes while a robot is so busy for 2 s, and for 2 s afterwards."""
    placement = NodeConfig("room_camera", room_camera.RoomCamera, {"scenes": scenes})
    runner = InlineRunner(Graph("camera", (placement,), inputs=frozenset({STATE})), start=SECOND)
    pictures: list[Image] = []
    runner.tap(IMAGES, lambda _, message: pictures.append(message))  # type: ignore[arg-type]
    runner.start()
    for second, doing in ((1, ""), (3, busy), (4, busy), (5, "")):
        spot = AgentState(name=SPOT, kind="spotrobot", home="room4", place=ROOM, inside=True, x=0.0, y=0.0, busy=doing)
        runner.feed(STATE, WardState(stamp=second * SECOND, rooms=(), agents=(spot,)))
    runner.advance(7 * SECOND)
    return pictures


def test_the_camera_is_on_while_its_room_is_patrolled():
    pictures = watched(f"a_patrol_room({SPOT}, {ROOM})")
    assert [picture.stamp / SECOND for picture in pictures] == [3.0, 3.5, 4.0, 4.5, 5.0]
    assert {picture.frame_id for picture in pictures} == {"room1_camera"}
    assert (pictures[0].bgr() != pictures[1].bgr()).any()


@pytest.mark.parametrize("busy", [f"a_patrol_room({SPOT}, room2)", f"a_navigate_to({SPOT}, {ROOM})"])
def test_the_camera_is_off_otherwise(busy):
    assert watched(busy) == []


@given(
    begin=st.floats(0.0, 40.0), length=st.floats(0.0, 40.0), start=st.floats(0.0, 100.0), after=st.floats(0.0, 1000.0)
)
def test_a_scene_goes_to_and_fro_without_a_leap(begin, length, start, after):
    scene = room_camera.Scene(start, "x", begin, begin + length)
    here, there = scene.moment_s(start + after), scene.moment_s(start + after + 0.1)
    assert begin - 1e-9 <= here <= begin + length + 1e-9
    assert abs(there - here) <= 0.1 + 1e-6


@pytest.mark.parametrize("text", ["", "5 scene1_tune 0-2", "0 scene1_tune 3-2", "0 scene1_tune", "now scene1_tune 0-2"])
def test_scenes_that_cannot_be_are_refused(text):
    with pytest.raises(ParameterError, match="scenes"):
        room_camera.parse_scenes(text)


def test_scenes_are_sorted_by_their_beginning():
    scenes = room_camera.parse_scenes("20 b 1-2; 0 a 0-3.5;")
    assert [(scene.start_s, scene.clip, scene.end_s) for scene in scenes] == [(0.0, "a", 3.5), (20.0, "b", 2.0)]
