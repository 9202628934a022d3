"""Waldo without detections: alone, and in the whole graph with a scripted detector."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import (
    ActionRequest,
    Health,
    Image,
    JointTrajectory,
    Mind,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    Utterance,
)
from socialbot.graph.files import load_graph
from socialbot.graph.health import SILENT_S
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output
from tests.agents.waldo.corridor import ANNA, BEN, CARL, Corridor

CAMERA, LATE_S = "/camera/image_raw", 0.5
PIXELS = np.zeros((4, 4, 3), np.uint8)


def what(corridor: Corridor) -> list[str]:
    return [did for _, did in corridor.did]


def beliefs(corridor: Corridor) -> list[str]:
    return [belief.text for belief in corridor.minds[-1].beliefs]


def gap(corridor: Corridor, seconds: float) -> None:
    """Advance the time without detections."""
    corridor.frame += round(10 * seconds)
    corridor.runner.advance((corridor.frame - 1) * nanoseconds(0.1))


def test_stays_idle_and_forgets_people_when_detections_stop():
    corridor = Corridor()
    corridor.until(5, ANNA)
    gap(corridor, 1.0)
    (at, did) = corridor.did[-1]
    assert did == "stayIdle"
    assert at <= 4.9 + LATE_S
    assert beliefs(corridor) == [
        'personDetected("Unknown")', 'greeted("t1")', 'silent("/humans/bodies/detections")', 'gone("t1")',
    ]  # fmt: skip


def test_drops_belief_in_silence_when_detections_return():
    corridor = Corridor()
    corridor.until(5, ANNA)
    gap(corridor, 5.0)
    corridor.see(ANNA)
    assert not [belief for belief in beliefs(corridor) if belief.startswith("silent")]


@pytest.mark.parametrize("seconds", [0.7, 5.0, 30.0])
def test_follows_known_people_after_a_gap_without_greeting(seconds):
    corridor = Corridor()
    corridor.until(5, ANNA)
    gap(corridor, seconds)
    corridor.see(BEN, times=10)
    assert what(corridor) == ["greeting", "stayIdle", "attend"]
    assert corridor.did[-1][0] <= 5.0 + seconds + 0.6
    corridor.see(BEN, times=80)
    assert what(corridor)[3:] == ["offer"]


GAPS = {
    "offer not repeated; offer for a new person": (
        [(120, ANNA), 10.0, (120, BEN), (90, BEN, CARL)],
        ["greeting", "offer", "stayIdle", "attend", "greeting", "offer"],
    ),
    "greeted after the gap if not before": ([(20,), (2, ANNA), 5.0, (10, ANNA)], ["stayIdle", "greeting"]),
    "new people after a gap longer than forget_after_s": (
        [(120, ANNA), 70.0, (100, BEN)],
        ["greeting", "offer", "stayIdle", "greeting", "offer"],
    ),
    "absent after the gap": (
        [(50, ANNA), 20.0, (50,), (10, BEN), (80,), (10, BEN)],
        ["greeting", "stayIdle", "stayIdle", "greeting", "stayIdle"],
    ),
    "left before the gap": ([(50, ANNA), (30,), 10.0, (10, BEN)], ["greeting", "stayIdle", "greeting"]),
}


@pytest.mark.parametrize(("scenes", "did"), GAPS.values(), ids=list(GAPS))
def test_remembers_people_across_a_gap(scenes, did):
    corridor = Corridor(forget_after_s=60.0)
    for scene in scenes:
        if isinstance(scene, float):
            gap(corridor, scene)
        else:
            corridor.see(*scene[1:], times=scene[0])
    assert what(corridor) == did


def test_a_loss_that_is_believed_late_is_no_absence():
    """Frames have stopped for longer than people are remembered, but Waldo noticed it less than that before."""
    corridor = Corridor(forget_after_s=4.0, silent_after_s=2.0)
    corridor.until(5, ANNA)
    gap(corridor, 4.5)
    corridor.see(ANNA, times=20)
    assert what(corridor) == ["greeting", "stayIdle", "attend"]


def test_repeated_gaps_cause_no_second_greeting_or_offer():
    corridor = Corridor()
    corridor.until(12, ANNA)
    for _ in range(4):
        gap(corridor, 3.0)
        corridor.see(BEN, times=3)
        gap(corridor, 3.0)
        corridor.see(CARL, times=20)
    assert "greeting" not in what(corridor)[1:]
    assert what(corridor).count("offer") == 1


def test_slow_detector_is_not_silent():
    corridor = Corridor()
    for _ in range(40):
        corridor.see(ANNA)
        corridor.frame += 2
    assert what(corridor) == ["greeting", "offer"]


def test_timeout_is_a_parameter():
    corridor = Corridor(silent_after_s=2.0)
    corridor.until(5, ANNA)
    gap(corridor, 1.8)
    corridor.see(ANNA)
    assert what(corridor) == ["greeting"]


def test_reports_waiting_before_the_first_image():
    corridor = Corridor()
    said: list[Health] = []
    corridor.runner.tap("/health", lambda _, message: said.append(message))  # type: ignore[arg-type]
    corridor.runner.advance(10 * SECOND)
    assert corridor.did == []
    assert beliefs(corridor) == ['silent("/humans/bodies/detections")']
    assert said[-1].state == "waiting"
    assert "no message on /humans/bodies/detections yet" in said[-1].reason


# The whole graph


class Seer(Node):
    """Finds Anna in every picture."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST, deadline_s=SILENT_S)
    detections = Output(PersonDetections, "/humans/bodies/detections")

    @image
    def on_image(self, image: Image) -> None:
        anna = PersonDetection(
            x=0, y=0, w=1, h=1, score=1, track_id="t1", distance_m=2.0, bearing_rad=0.5, elevation_rad=0.0
        )
        self.detections.publish(PersonDetections(stamp=image.stamp, frame_id="", width=4, height=4, persons=(anna,)))


class Eye(Node):
    """A camera with 10 images/s that can be switched off."""

    image_raw = Output(Image, CAMERA, Delivery.NEWEST)
    awake = True

    def start(self) -> None:
        self.call_after(0.1, self.tick)

    def tick(self) -> None:
        self.call_after(0.1, self.tick)
        if self.awake:
            self.image_raw.publish(Image.from_bgr(PIXELS, stamp=self.clock.now(), frame_id="c"))


class Robot:
    """Waldo's graph, and what it does when (s)."""

    def __init__(self) -> None:
        whole = load_graph("waldo")
        stand_ins = {"camera": NodeConfig("camera", Eye), "person_detector": NodeConfig("person_detector", Seer)}
        graph = replace(whole, nodes=tuple(stand_ins.get(one.name, one) for one in whole.nodes))
        self.runner = InlineRunner(graph.with_parameters({"speech": {"playback": "off"}}), start=SECOND)
        self.did: list[tuple[float, str]] = []
        self.moves: list[tuple[float, float]] = []
        self.said: list[SpeechStatus] = []
        self.healths: dict[str, Health] = {}
        self.minds: list[Mind] = []
        self.runner.tap("/waldo/actions", self._act)  # type: ignore[arg-type]
        self.runner.tap("/head_controller/joint_trajectory", self._move)  # type: ignore[arg-type]
        self.runner.tap("/speech/status", lambda _, message: self.said.append(message))  # type: ignore[arg-type]
        self.runner.tap("/health", lambda _, message: self.healths.update({message.node: message}))  # type: ignore
        self.runner.tap("/waldo/mind", lambda _, mind: self.minds.append(mind))  # type: ignore[arg-type]
        self.runner.start()

    @property
    def now(self) -> float:
        return self.runner.clock.now() / SECOND - 1

    def _act(self, _: str, action: ActionRequest) -> None:
        self.did.append((self.now, str(action.arguments[0]) if action.arguments else action.name))

    def _move(self, _: str, move: JointTrajectory) -> None:
        self.moves.append((self.now, move.positions[0]))

    def until(self, seconds: float) -> None:
        self.runner.advance(nanoseconds(1 + seconds))

    def say(self, text: str) -> None:
        self.runner.feed("/speech/say", Utterance(stamp=self.runner.clock.now(), id=text, text=text))

    @property
    def silent(self) -> list[tuple[str, str]]:
        return [(one.text, one.source) for one in self.minds[-1].beliefs if one.text.startswith("silent")]


@pytest.fixture
def robot() -> Iterator[Robot]:
    robot = Robot()
    robot.until(5.0)
    assert [did for _, did in robot.did] == ["greeting"]
    assert robot.moves[-1][1] == 0.5
    yield robot
    assert not [fault.first for fault in robot.runner.faults.values() if fault.failures]


@pytest.mark.parametrize(
    ("killed", "source"),
    [("camera", "image_converter"), ("image_converter", "person_detector"), ("person_detector", "bdi_engine")],
)
def test_believes_which_node_is_silent_and_recovers(robot, killed, source):
    robot.runner.kill(killed)
    robot.until(5.0 + LATE_S)
    assert robot.silent == [(f'silent("{killed}")', source)]
    assert robot.did[1][1] == "stayIdle"
    assert robot.moves[-1][1] == 0.0
    engine = robot.healths["bdi_engine"]
    assert engine.state == "degraded"
    assert f"sees nothing: {killed} is silent" in engine.reason
    robot.until(35.0)
    assert len(robot.did) == 2
    robot.runner.restart(killed)
    robot.until(36.0)
    assert robot.silent == []
    ever = {one.text for mind in robot.minds for one in mind.beliefs if one.text.startswith("silent")}
    assert ever == {f'silent("{killed}")'}
    assert robot.did[2:] == [(pytest.approx(35.6, abs=0.11), "attend")]
    assert robot.moves[-1][1] == 0.5
    assert robot.healths["bdi_engine"].state == "ok"


def test_two_silent_nodes_of_one_machine_mean_a_broken_link(robot):
    for name in ("camera", "speech"):
        robot.runner.kill(name)
    robot.until(5.0 + LATE_S)
    assert robot.silent == [('silent("camera")', "image_converter")]
    robot.until(6.5)
    assert robot.silent == [('silent("link")', "image_converter")]
    for name in ("camera", "speech"):
        robot.runner.restart(name)
    robot.until(8.0)
    assert [did for _, did in robot.did] == ["greeting", "stayIdle", "attend"]


def test_running_camera_without_images_is_silent(robot):
    camera = robot.runner.nodes["camera"]
    camera.awake = False
    robot.until(10.0)
    assert robot.silent == [('silent("camera")', "image_converter")]
    camera.awake = True
    robot.until(11.0)
    assert [did for _, did in robot.did] == ["greeting", "stayIdle", "attend"]


def test_queued_speech_expires_when_detections_stop(robot):
    for text in ("This takes longer to say than the silence lasts.", "two"):
        robot.say(text)
    robot.runner.kill("camera")
    robot.until(5.0 + LATE_S)
    assert (robot.said[-1].utterance_id, robot.said[-1].state) == ("two", "expired")
    assert robot.said[-1].detail.startswith("bdi_engine: no message on /humans/bodies/detections")


def test_head_centres_and_queued_speech_expires_without_engine(robot):
    for text in ("This takes longer to say than the silence lasts.", "two"):
        robot.say(text)
    robot.runner.kill("bdi_engine")
    robot.until(5.0 + LATE_S + 0.01)
    assert robot.moves[-1][1] == 0.0
    assert [(one.state, one.detail) for one in robot.said[-1:]] == [("expired", "bdi_engine is silent")]
    assert "no message on /bdi_engine/health" in robot.healths["head"].reason
    robot.until(20.0)
    assert robot.moves[-1][1] == 0.0
    robot.runner.restart("bdi_engine")
    robot.until(21.0)
    assert robot.moves[-1][1] == 0.5


def test_speech_that_a_lost_link_held_back_expires(robot):
    """The engine has greeted a person who is gone; when it sees somebody again, it greets anew."""
    robot.until(5.0)
    robot.runner.kill("bdi_engine")
    before = len(robot.said)
    for text, said_s in (("too late", 5.2), ("late", 8.3)):
        robot.until(said_s + 0.01 if text == "late" else 8.0)
        stamp = nanoseconds(1 + said_s)
        robot.runner.feed("/speech/say", Utterance(stamp=stamp, id=text, text=text))
    robot.until(12.0)
    late, *spoken = robot.said[before:]
    assert (late.utterance_id, late.state, late.detail) == ("too late", "expired", "it comes 3 s late")
    assert [(one.utterance_id, one.state) for one in spoken] == [("late", "started"), ("late", "finished")]
    robot.runner.restart("bdi_engine")
    robot.until(14.0)
    before = len(robot.said)
    robot.runner.feed("/speech/say", Utterance(stamp=SECOND, id="old", text="old"))  # of another clock
    robot.until(20.0)
    assert "old started" in [f"{one.utterance_id} {one.state}" for one in robot.said[before:]]


def test_runs_with_a_gap_are_deterministic():
    def run() -> list[object]:
        robot = Robot()
        robot.until(5.0)
        robot.runner.kill("camera")
        robot.until(9.0)
        robot.runner.restart("camera")
        robot.until(12.0)
        return [robot.did, robot.moves, robot.minds, robot.healths]

    assert run() == run()


def test_the_end_of_a_recording_is_no_silence():
    whole = load_graph("waldo").without_sources()
    configs = tuple(NodeConfig(one.name, Seer) if one.name == "person_detector" else one for one in whole.nodes)
    runner = InlineRunner(replace(whole, nodes=configs).with_parameters({"speech": {"playback": "off"}}))
    did: list[str] = []
    spoken: list[str] = []
    runner.tap("/waldo/actions", lambda _, action: did.append(action.name))  # type: ignore[attr-defined]
    runner.tap("/speech/status", lambda _, status: spoken.append(status.state))  # type: ignore[attr-defined]
    runner.start()
    frames = [(CAMERA, Image.from_bgr(PIXELS, stamp=nanoseconds(number / 10), frame_id="c")) for number in range(40)]
    waiting = [("/speech/say", Utterance(stamp=frames[-1][1].stamp, id=text, text=text)) for text in ("One more.", "B")]
    runner.run([*frames, *waiting], tail_s=5.0)
    assert did == ["speak"]
    assert spoken == ["started", "finished", "started", "waiting", "finished", "started", "finished"]


# After a crash


def crashed(corridor: Corridor, seconds: float) -> None:
    corridor.runner.kill("waldo")
    gap(corridor, seconds)
    corridor.runner.restart("waldo")


def test_offer_is_not_repeated_after_a_crash(tmp_path):
    corridor = Corridor(mind_file=str(tmp_path / "mind.json"))
    corridor.until(12, ANNA)
    crashed(corridor, 1.0)
    corridor.see(ANNA, times=150)
    assert what(corridor) == ["greeting", "offer"]


def test_person_present_during_a_crash_is_offered_help_in_time(tmp_path):
    corridor = Corridor(mind_file=str(tmp_path / "mind.json"))
    corridor.until(5, ANNA)
    crashed(corridor, 1.0)
    corridor.until(12, ANNA)
    assert corridor.did == [(0.5, "greeting"), (8.5, "offer")]


def test_person_who_left_during_a_crash_is_gone(tmp_path):
    corridor = Corridor(mind_file=str(tmp_path / "mind.json"))
    corridor.until(12, ANNA)
    crashed(corridor, 1.0)
    corridor.see(times=30)
    assert what(corridor) == ["greeting", "offer", "stayIdle"]
    assert not [belief for belief in beliefs(corridor) if belief.startswith(("present", "stays"))]


def test_a_silence_of_before_a_crash_is_not_believed_afterwards(tmp_path):
    corridor = Corridor(mind_file=str(tmp_path / "mind.json"))
    corridor.until(5, ANNA)
    gap(corridor, 3.0)
    crashed(corridor, 1.0)
    corridor.see(ANNA, times=10)
    assert what(corridor) == ["greeting", "stayIdle", "attend"]
    assert not [belief for belief in beliefs(corridor) if belief.startswith("silent")]


def test_people_are_forgotten_without_detections_after_a_crash(tmp_path):
    corridor = Corridor(mind_file=str(tmp_path / "mind.json"))
    corridor.until(12, ANNA)
    crashed(corridor, 1.0)
    gap(corridor, 5.0)
    assert what(corridor) == ["greeting", "offer", "stayIdle"]
    corridor.see(ANNA, times=120)
    assert what(corridor) == ["greeting", "offer", "stayIdle", "attend"]
    assert corridor.faults == 0
    assert not [record for record in corridor.trace if record.kind == "failure"]
