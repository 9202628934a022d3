"""Interruption of a robot that speaks in simulated rooms, for ``python -m evaluation.hearing --parts barge_in``.

Each room is a box with a microphone, a loudspeaker and a person at random places. Its echoes are computed by the image
source method. The real speaker and hearing nodes run in simulated time. The sound stops when the speaker stops it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from evaluation.hearing import Scenery, percentile
from evaluation.hearing import speak as speak_once
from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech, Message, SpeechStatus, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.audio import RATE_HZ, Converter, chunks_of, samples_of
from socialbot.speech.speaker import Speaker
from tests.speech.sounds import VoiceOnly

UTTERANCES = (
    "Good afternoon, and welcome to our house. My name is Waldo, and I can show you the way to every office.",
    "Your appointment is in room three hundred and twelve. Please take the stairs on the right hand side.",
    "I am sorry, the cafeteria is closed today. There is a small kitchen at the end of this corridor.",
    "Thank you for waiting. The doctor will see you in a few minutes, so please have a seat over there.",
)
INTERRUPTIONS = (
    "Hold on, I have another question.",
    "No, that is not what I meant.",
    "Sorry, could you repeat the number?",
    "Thanks, that is enough.",
    "Where is the lift?",
    "Please stop talking now.",
)
ROBOT_VOICES = ("piper:joe", "en-us", "en-gb-x-rp", "en-us+f3")
PERSON_VOICES = ("en-us+f4", "en-gb-scotland", "piper:joe", "en-us+m3", "en-us+f3", "en-gb-x-rp")
LEVELS_DB = (12.0, 6.0, 0.0, -6.0, -12.0)
"""Levels of the person relative to the echo, both at the microphone."""
NOISES = ("white", "pink", "babble")

speak = cache(speak_once)

_CHUNK = 800
_LEVEL = 3000.0  # Root mean square of speech before its level at the microphone is set.
_SOUND_M_S = 343.0
_RESPONSE_S, _ORDER = 0.6, 14
_BEFORE_S, _PAUSE_S = 1.0, 1.5
_ONSETS_S = (0.7, 2.5)  # Of the person, from the beginning of the utterance.
PROMPT_S = 0.3
"""Longest time in which a person should stop the robot."""
_WAIT_S = 1.5  # Longest time in which an interruption counts.


class TalkingRoom:
    """A speaking and hearing robot in a room: what it plays reaches its microphone until it is interrupted.

    Args:
        response: Impulse response from the loudspeaker to the microphone.
        noise: int16 noise of the microphone, repeated.
        voice: Voice of the robot.
        drive: Distortion of the loudspeaker: soft clipping of samples of 3000 / drive; 0 for none.
    """

    def __init__(self, response: np.ndarray, noise: np.ndarray, voice: str = "en-us", drive: float = 0.0) -> None:
        nodes = (
            NodeConfig("hearing", VoiceOnly, {}),
            NodeConfig("speech", Speaker, {"playback": "off", "publish_sound": True, "voice": voice}),
        )
        self.runner = InlineRunner(Graph("room", nodes, inputs=frozenset({"/audio", "/speech/say"})), start=SECOND)
        self.statuses: list[SpeechStatus] = []
        self.heard: list[HeardSpeech] = []
        self._response, self._noise, self._drive = response, noise, drive
        self._time = SECOND
        self._coming = np.zeros(0)
        self._played = np.zeros(response.size)
        for topic in ("/speech/status", "/speech/audio", "/humans/voices/speech"):
            self.runner.tap(topic, self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        match message:
            case AudioData():
                samples = Converter(message.sample_rate, 1).push(samples_of(message))
                at = max(0, round((message.stamp - self._time) / SECOND * RATE_HZ))
                missing = at + samples.size - self._coming.size
                self._coming = np.concatenate([self._coming, np.zeros(max(0, missing))])
                self._coming[at : at + samples.size] += samples
            case SpeechStatus():
                self.statuses.append(message)
                if message.state == "interrupted":
                    self._coming = np.zeros(0)
            case HeardSpeech():
                self.heard.append(message)

    @property
    def now_s(self) -> float:
        return self._time / SECOND

    @property
    def states(self) -> list[str]:
        return [status.state for status in self.statuses]

    def say(self, text: str) -> None:
        self.runner.feed("/speech/say", Utterance(stamp=self._time, id=f"said-{self._time}", text=text))

    def finish(self, most_s: float = 20.0) -> None:
        """Let the robot finish what it says."""
        end = self.now_s + most_s
        while self.states[-1:] == ["started"] and self.now_s < end:
            self.pass_time(_CHUNK / RATE_HZ)

    def pass_time(self, seconds: float, person: np.ndarray | None = None) -> None:
        """Let the microphone record for a time, with a person who speaks from its beginning on."""
        count = round(seconds * RATE_HZ / _CHUNK)
        speech = np.zeros(count * _CHUNK)
        if person is not None:
            speech[: person.size] = person[: speech.size]
        for each in speech.reshape(-1, _CHUNK):
            self.runner.advance(self._time + _CHUNK * SECOND // RATE_HZ)  # sounds may begin meanwhile
            played, self._coming = self._coming[:_CHUNK], self._coming[_CHUNK:]
            played = np.concatenate([played, np.zeros(_CHUNK - played.size)])
            if self._drive:
                played = np.tanh(self._drive * played / _LEVEL) / self._drive * _LEVEL
            self._played = np.concatenate([self._played, played])[-self._response.size - _CHUNK + 1 :]
            sound = convolved(self._played, self._response)[-_CHUNK:] + each + self._noise[:_CHUNK]
            self._noise = np.roll(self._noise, -_CHUNK)
            [message] = chunks_of(np.clip(np.rint(sound), -32768, 32767).astype(np.int16), start=self._time)
            self._time += _CHUNK * SECOND // RATE_HZ
            self.runner.feed("/audio", message, time=self._time)


def convolved(samples: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Convolution, as long as the samples."""
    count = 1 << (samples.size + response.size - 2).bit_length()
    spectrum = np.fft.rfft(samples, count) * np.fft.rfft(response, count)
    return np.fft.irfft(spectrum, count)[: samples.size]


def box_response(room: np.ndarray, source: np.ndarray, microphone: np.ndarray, reflection: float) -> np.ndarray:
    """Impulse response of a box by the image source method.

    Args:
        room: Length, width and height (m).
        source: Place of the loudspeaker or the person (m).
        microphone: Place of the microphone (m).
        reflection: Share of the pressure that a wall reflects.
    """
    response = np.zeros(round(_RESPONSE_S * RATE_HZ))
    cells = np.arange(-_ORDER, _ORDER + 1)
    for mirrored in np.ndindex(2, 2, 2):
        # Along each axis the distance of every image, and the number of its reflections.
        offsets = [
            (1 - 2 * m) * s - x + 2 * cells * size
            for m, s, x, size in zip(mirrored, source, microphone, room, strict=True)
        ]
        walls = [np.abs(cells - m) + np.abs(cells) for m in mirrored]
        distance = np.sqrt(sum(each**2 for each in np.meshgrid(*offsets, indexing="ij")))
        strength = reflection ** sum(np.meshgrid(*walls, indexing="ij")) / distance
        late = np.rint(distance / _SOUND_M_S * RATE_HZ).astype(int)
        near = late < response.size
        np.add.at(response, late[near], strength[near])
    return response


def _small_loudspeaker(response: np.ndarray, cutoff_hz: float) -> np.ndarray:
    """Response with the loss of low tones of a small loudspeaker."""
    ratio = 1j * np.fft.rfftfreq(2 * response.size, 1 / RATE_HZ) / cutoff_hz
    high = ratio**2 / (1 + math.sqrt(2) * ratio + ratio**2)
    return np.fft.irfft(np.fft.rfft(response, 2 * response.size) * high)[: response.size]


def _rms(samples: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(samples))))


class RoomSetup:
    """A room by seed: 3 to 9 m long, the loudspeaker 8 to 50 cm and the person 0.5 to 2 m from the microphone."""

    def __init__(self, seed: int) -> None:
        random = self.random = np.random.default_rng(seed)
        room, reflection = random.uniform([3, 3, 2.4], [9, 7, 3.4]), float(random.uniform(0.4, 0.9))
        microphone = random.uniform([1, 1, 0.6], room - [1, 1, 1])
        loudspeaker = self._near(room, microphone, float(random.uniform(0.08, 0.5)))
        person = self._near(room, microphone, float(random.uniform(0.5, 2.0)))
        delay = np.zeros(round(random.uniform(0.01, 0.2) * RATE_HZ))
        response = np.concatenate([delay, box_response(room, loudspeaker, microphone, reflection)])
        response = _small_loudspeaker(response, float(random.uniform(80, 300)))
        self.voice = ROBOT_VOICES[seed % len(ROBOT_VOICES)]
        self.drive = float(random.choice([0.0, 0.1]))
        self.echo_rms = _LEVEL * 10 ** (float(random.uniform(-14, 4)) / 20)
        heard = convolved(speak(self.voice, UTTERANCES[0]).astype(float), response)
        self.response = response * (self.echo_rms / _rms(heard))
        self._person_response = box_response(room, person, microphone, reflection)
        noise_rms = self.echo_rms * 10 ** (-float(random.uniform(20, 45)) / 20)
        self._noise = noise_rms * Scenery(seed).noise(NOISES[seed % len(NOISES)], 20 * RATE_HZ)

    def _near(self, room: np.ndarray, place: np.ndarray, distance: float) -> np.ndarray:
        """A random place in the room at a distance (m) from another one."""
        while True:
            angle, height = self.random.uniform(0, 2 * np.pi), self.random.uniform(-0.3, 0.3)
            found = place + distance * np.array([np.cos(angle), np.sin(angle), height])
            if np.all(found > 0.2) and np.all(found < room - 0.2):
                return found

    def talking(self) -> TalkingRoom:
        """The robot in this room, after a second of silence."""
        talking = TalkingRoom(self.response, self._noise, self.voice, self.drive)
        talking.pass_time(_BEFORE_S)
        return talking

    def person(self, level_db: float) -> np.ndarray:
        """A sentence of a person at the microphone, from its first sound on."""
        voice, text = self.random.choice(PERSON_VOICES), self.random.choice(INTERRUPTIONS)
        speech = speak(str(voice), str(text)).astype(float)
        heard = convolved(np.concatenate([speech, np.zeros(RATE_HZ // 4)]), self._person_response)
        heard = heard[int(np.argmax(self._person_response != 0)) :]
        return heard * (self.echo_rms * 10 ** (level_db / 20) / _rms(heard[: speech.size]))


@dataclass
class Interruptions:
    """Utterances during which nobody speaks, or a person of one level."""

    asked: int = 0
    early: int = 0
    """Utterances that the robot stopped before anybody spoke."""
    delays: list[float] = field(default_factory=list)
    """Times (s) from the first sound of the person to the end of the robot's."""

    def row(self, name: str) -> str:
        found = len(self.delays) / max(1, self.asked - self.early)
        prompt = sum(each <= PROMPT_S for each in self.delays) / max(1, self.asked - self.early)
        p50, p95 = percentile(self.delays, 0.5), percentile(self.delays, 0.95)
        return f"{name:30} {self.asked:6} {self.early:6} {found:7.0%} {prompt:7.0%} {p50:7.2f} {p95:7.2f}"


def quiet_utterances(seed: int, utterances: int = 2) -> list[bool]:
    """Whether the robot interrupts each of its utterances although nobody speaks."""
    talking = RoomSetup(seed).talking()
    interrupted = []
    for number in range(utterances):
        talking.say(UTTERANCES[(seed + number) % len(UTTERANCES)])
        talking.finish()
        interrupted.append(talking.states[-1] == "interrupted")
        talking.pass_time(_PAUSE_S)
    return interrupted


def interrupted_utterance(seed: int, level_db: float, *, before: int) -> float | None:
    """Let a person speak during the utterance after ``before`` others.

    Returns:
        The time (s) from the first sound of the person to the interruption, negative if it came before, or None.
    """
    setup = RoomSetup(seed)
    talking = setup.talking()
    for number in range(before):
        talking.say(UTTERANCES[(seed + number) % len(UTTERANCES)])
        talking.finish()
        talking.pass_time(_PAUSE_S)
    talking.say(UTTERANCES[(seed + before) % len(UTTERANCES)])
    talking.pass_time(float(setup.random.uniform(*_ONSETS_S)))
    onset_s = talking.now_s
    talking.pass_time(_WAIT_S, setup.person(level_db))
    last = talking.statuses[-1]
    return last.stamp / SECOND - onset_s if last.state == "interrupted" else None


def measured(rooms: int, seed: int, jobs: int) -> Iterator[str]:
    """Yield rows of the results: utterances without a person in all rooms from a seed on, with one in half of them."""
    yield f"{'interruptions':30} {'number':>6} {'false':>6} {'found':>7} {'<0.3 s':>7} {'p50 s':>7} {'p95 s':>7}"
    with ProcessPoolExecutor(jobs) as pool:
        quiet = list(pool.map(quiet_utterances, range(seed, seed + rooms)))
        yield Interruptions(rooms, sum(each[0] for each in quiet)).row("first utterance, nobody")
        later = [each for every in quiet for each in every[1:]]
        yield Interruptions(len(later), sum(later)).row("second utterance, nobody")
        for before, name in enumerate(("first", "second")):
            for level_db in LEVELS_DB:
                talk = partial(interrupted_utterance, level_db=level_db, before=before)
                delays = list(pool.map(talk, range(seed, seed + math.ceil(rooms / 2))))
                early = sum(each is not None and each < 0 for each in delays)
                found = [each for each in delays if each is not None and each >= 0]
                yield Interruptions(len(delays), early, found).row(f"{name} utterance, person {level_db:+.0f} dB")
