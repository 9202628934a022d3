"""Room with a loudspeaker, a microphone and a person, simulated for a robot that speaks and hears."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import AudioData, SpeechStatus, Utterance
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Input, Output, Parameter
from socialbot.speech.audio import RATE_HZ, Converter, samples_of
from tests.speech.sounds import room, spoken

TEXT = "Hello, nice to see you. Can I help you with anything today? I know all rooms in this house."
QUESTION = "Stop please, where is the exit?"


class SpeakingRoom(Node):
    """Simulator of a room: asks the robot to speak twice, and lets a person speak meanwhile."""

    is_simulator = True

    status = Input(SpeechStatus, "/speech/status")
    own_voice = Input(AudioData, "/speech/audio")
    say = Output(Utterance, "/speech/say")
    audio = Output(AudioData, "/audio")

    period_s = Parameter(0.05, "length of a piece of sound, s", minimum=0.01, fixed=True)
    person_s = Parameter(11.0, "time at which the person begins to speak, s; 0: nobody does", minimum=0.0, fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._size = round(self.period_s * RATE_HZ)
        self._response = room(3, gain=0.5, reverberation_s=0.35)
        self._played = np.zeros(self._response.size + self._size)
        self._coming: deque[np.ndarray] = deque()
        self._random = np.random.default_rng(7)
        self._person: deque[np.ndarray] = deque()
        self._begin = self._recorded = 0

    def start(self) -> None:
        self._begin = self._recorded = self.clock.now()
        self.context.call_at(self._begin + nanoseconds(self.period_s), self._record)

    @status
    def on_status(self, status: SpeechStatus) -> None:
        if status.state == "interrupted":
            self._coming.clear()

    @own_voice
    def on_own_voice(self, sound: AudioData) -> None:
        samples = Converter(sound.sample_rate, 1).push(samples_of(sound))
        late = round(max(0, sound.stamp - self._recorded) / SECOND * RATE_HZ)
        padded = np.concatenate([np.zeros(late), samples])
        self._coming.extend(np.concatenate([padded, np.zeros(-padded.size % self._size)]).reshape(-1, self._size))

    def _record(self) -> None:
        now = self.clock.now()
        passed_s = (self._recorded - self._begin) / SECOND
        if any(abs(passed_s - each) < self.period_s / 2 for each in (1.0, 9.0)):
            self.say.publish(Utterance(stamp=now, id=f"said-{round(passed_s)}", text=TEXT))
        if self.person_s and abs(passed_s - self.person_s) < self.period_s / 2:
            speech = 0.5 * spoken(QUESTION, "en-us+f3")
            self._person.extend(speech[: speech.size // self._size * self._size].reshape(-1, self._size))
        played = self._coming.popleft() if self._coming else np.zeros(self._size)
        self._played = np.concatenate([self._played, played])[-self._response.size - self._size + 1 :]
        sound = np.convolve(self._played, self._response, mode="valid")[-self._size :]
        sound += self._random.normal(0, 60.0, self._size)
        if self._person:
            sound += self._person.popleft()
        samples = np.clip(sound, -32768, 32767).astype("<i2").tobytes()
        self.audio.publish(AudioData(stamp=self._recorded, samples=samples, sample_rate=RATE_HZ))
        self._recorded = now
        self.context.call_at(now + nanoseconds(self.period_s), self._record)
