"""Sounds and graphs for tests of hearing."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech, Message, StopSpeech, VoiceActivity
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.audio import RATE_HZ, Converter, chunks_of, level_db
from socialbot.speech.hearing import Hearing
from socialbot.speech.recognition import RecognizedText
from socialbot.speech.synthesis import Synthesizer


@functools.cache
def spoken(text: str, voice: str = "en-us") -> np.ndarray:
    """Speech of espeak-ng as the recogniser takes it. Skips the test where PyAV is missing, which converts the rate."""
    pytest.importorskip("av")
    sound = Synthesizer(voice).say(text)
    return Converter(sound.sample_rate, 1).push(sound.samples[:, None])


def silence(seconds: float) -> np.ndarray:
    return np.zeros(round(seconds * RATE_HZ), np.int16)


def tone(seconds: float, level: int = 8000, hz: float = 300.0) -> np.ndarray:
    return np.rint(level * np.sin(2 * np.pi * hz * np.arange(round(seconds * RATE_HZ)) / RATE_HZ)).astype(np.int16)


class LevelDetector:
    """Detector that takes every loud sound for speech."""

    def probability(self, chunk: np.ndarray) -> float:
        return float(level_db(chunk) > -40)

    def reset(self) -> None:
        pass


class LengthRecognizer:
    """Recogniser whose text is the duration of the sound."""

    def recognize(self, samples: np.ndarray) -> RecognizedText | None:
        return RecognizedText(f"{samples.size / RATE_HZ:.1f} s", "en", 0.9)


class LoudHearing(Hearing):
    """Hearing without networks: loud sound is speech, and its text is its duration."""

    def find_detector(self) -> LevelDetector:
        return LevelDetector()

    def find_recognizer(self) -> LengthRecognizer:
        return LengthRecognizer()


class Ear:
    """A hearing node in the inline runner, and all that it publishes."""

    def __init__(self, kind: type[Hearing] = LoudHearing, **parameters: object) -> None:
        inputs = {"/audio", "/speech/status", "/speech/audio", "/humans/bodies/detections", "/sound_localization"}
        config = NodeConfig("hearing", kind, parameters)
        self.runner = InlineRunner(Graph("test", (config,), inputs=frozenset(inputs)), start=SECOND)
        self.heard: list[HeardSpeech] = []
        self.activity: list[VoiceActivity] = []
        self.stops: list[StopSpeech] = []
        for topic in ("/humans/voices/speech", "/humans/voices/activity", "/speech/stop"):
            self.runner.tap(topic, self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        match message:
            case HeardSpeech():
                self.heard.append(message)
            case VoiceActivity():
                self.activity.append(message)
            case StopSpeech():
                self.stops.append(message)

    @property
    def node(self) -> Hearing:
        node = self.runner.nodes["hearing"]
        assert isinstance(node, Hearing)
        return node

    @property
    def first_fault(self) -> str:
        return self.runner.faults["hearing"].first

    def hear(self, *sounds: np.ndarray, at: float = 1.0, others: Mapping[float, tuple[str, Message]] | None = None):
        """Feed sounds one after the other from ``at`` (s) on, and ``others`` at their times (s)."""
        self.feed(chunks_of(np.concatenate(sounds), start=round(at * SECOND)), others)

    def feed(self, chunks: Iterable[AudioData], others: Mapping[float, tuple[str, Message]] | None = None) -> None:
        items = [(chunk.stamp, "/audio", chunk) for chunk in chunks]
        items += [(round(time * SECOND), *each) for time, each in (others or {}).items()]
        for time, topic, message in sorted(items, key=lambda item: (item[0], item[1] == "/audio")):
            self.runner.feed(topic, message, time=time)


def room(seed: int, *, gain: float, reverberation_s: float, delay_s: float = 0.08) -> np.ndarray:
    """Impulse response from the loudspeaker to the microphone: a delay, the direct sound, and a decaying echo."""
    count = round(reverberation_s * RATE_HZ)
    echo = np.random.default_rng(seed).normal(0, 1, count) * np.exp(-6.9 * np.arange(count) / count)
    echo *= 0.6 / np.linalg.norm(echo)
    return gain * np.concatenate([np.zeros(round(delay_s * RATE_HZ)), [1.0], echo])


class VoiceOnly(Hearing):
    """Hearing with the real detector of speech, and without recognition."""

    def find_recognizer(self) -> LengthRecognizer:
        return LengthRecognizer()
