"""The node that speaks: one utterance at a time, the others wait their turn but not for long."""

from __future__ import annotations

import re
import unicodedata
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

from socialbot.core import paths
from socialbot.core.errors import DeviceError, InstallationError, ParameterError, SocialbotError
from socialbot.core.messages import Health, Message, SpeechStatus, Utterance
from socialbot.graph.health import BEATLESS_S, HEALTH_TOPIC
from socialbot.graph.node import Context, Input, Node, Output, Parameter, Timer
from socialbot.speech.playback import AudioPlayer, find_player
from socialbot.speech.synthesis import Sound, Synthesizer

MOST_SOUNDS = 500
"""So many of the sounds that it has made are kept as files: some 50 MB."""

State = Literal["waiting", "started", "finished", "replaced", "expired", "failed"]


class SpeechVoice(Protocol):
    """Turns text into sound."""

    def say(self, text: str) -> Sound:
        """The sound of ``text``. Raises a SocialbotError when it has none."""
        ...


@dataclass(eq=False)
class _QueuedUtterance:
    utterance: Utterance
    expiry: Timer = field(init=False)


class Speaker(Node):
    """Says utterances and reports what becomes of each.

    While one sounds the others wait, in the order of their arrival. A newer one with the same key
    takes the place in line of the waiting one it replaces, with a waiting time of its own. Without
    a sound device an utterance lasts as long as its sound would, by the node's clock; a replay has
    ``playback`` off for that reason. A change of voice, rate, pitch or volume is heard from the next
    utterance on. What waits expires when the ``engine`` falls silent, or says that something is wrong: it was meant for
    people who may be gone.
    """

    say = Input(Utterance, "/speech/say")
    health = Input(Health, HEALTH_TOPIC, optional=True, deadline_s=BEATLESS_S)
    status = Output(SpeechStatus, "/speech/status")

    voice = Parameter("en", "espeak-ng voice: a language, perhaps with a variant as in en-us+f3")
    rate_wpm = Parameter(165, "words per minute", minimum=80, maximum=450)
    pitch = Parameter(50, "pitch of the voice", minimum=0, maximum=100)
    volume = Parameter(1.0, "loudness, as a share of full amplitude", minimum=0.0, maximum=1.0)
    playback = Parameter(
        "auto",
        "auto: play where there is a sound device; off: never play; required: refuse to start without a device",
        choices=("auto", "off", "required"),
        fixed=True,
    )
    folder = Parameter(
        "", f"where the last {MOST_SOUNDS} utterances are kept as .wav files; empty: nowhere", fixed=True
    )
    max_waiting_s = Parameter(5.0, "s an utterance may wait before it expires unsaid", minimum=0.0)
    engine = Parameter("", "node that decides what is said, whose signs of life are listened to; empty: none")
    max_waiting = Parameter(8, "utterances that may wait; beyond that the oldest gives way", minimum=1)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._voice: SpeechVoice | None = None
        self._missing: InstallationError | None = None
        self._player: AudioPlayer | None = None
        self._sounding: Utterance | None = None
        self._waiting: list[_QueuedUtterance] = []
        self._spoken = 0
        self._folder: Path | None = None
        self._sounds: deque[Path] = deque()
        self._engine_fares_well = True

    def start(self) -> None:
        """Raises ParameterError for an unknown voice or unusable folder, DeviceError when a required device is missing.

        A missing speech library is no such error: the robot goes on, mute, and every utterance fails.
        """
        try:
            self._voice = self.find_voice()
        except InstallationError as error:
            self._missing = error
            self.log.warning("cannot speak: %s", _line(error))
        self._folder = self._make_folder() if self.folder else None
        self._player = None if self.playback == "off" else self.find_player()
        if self._player is None and self.playback == "required":
            raise DeviceError(
                "no sound device",
                where=self.name,
                remedy="connect one and pip install socialbot[speech], or set playback to 'auto'",
            )

    def stop(self) -> None:
        """Ends what is said, and forgets what waits."""
        if self._player is not None:
            self._player.stop()
        for waiting in self._waiting:
            waiting.expiry.cancel()
        self._waiting.clear()
        self._sounding = None

    def find_voice(self) -> SpeechVoice:
        """What speaks; a robot with a voice of its own kind overrides this.

        Raises InstallationError when a part of it is missing, ParameterError when there is no such voice.
        """
        return Synthesizer(self.voice, self.rate_wpm, self.pitch)

    def find_player(self) -> AudioPlayer | None:
        """What plays the sounds; a robot with loudspeakers of its own kind overrides this."""
        return find_player()

    def on_parameter(self, name: str) -> None:
        """Takes another voice; an unknown one leaves the present one in force. Raises ParameterError."""
        if self._voice is not None and name in ("voice", "rate_wpm", "pitch"):
            self._voice = self.find_voice()

    def deadline_s(self, port: Input[Any]) -> float:
        return port.deadline_s if self.engine else 0.0

    def counts(self, port: Input[Any], message: Message) -> bool:
        return isinstance(message, Health) and message.node == self.engine

    @health
    def on_health(self, health: Health) -> None:
        if health.node == self.engine:
            well = health.state not in ("paused", "degraded", "failed")
            if self._engine_fares_well and not well:
                self._expire_all(f"{self.engine}: {health.reason}")
            self._engine_fares_well = well

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self._expire_all(f"{self.engine} is silent")

    @say
    def on_say(self, utterance: Utterance) -> None:
        """Says an utterance, or lets it wait until the one before is over."""
        if self._sounding is None:
            self._speak(utterance)
        else:
            self._wait(utterance)

    def _wait(self, utterance: Utterance) -> None:
        entry = _QueuedUtterance(utterance)
        entry.expiry = self.call_after(self.max_waiting_s, partial(self._expire, entry))
        keys = [waiting.utterance.key for waiting in self._waiting]
        if utterance.key and utterance.key in keys:
            place = keys.index(utterance.key)
            old, self._waiting[place] = self._waiting[place], entry
            self._replace(old, f"by {utterance.id}")
        else:
            self._waiting.append(entry)
        while len(self._waiting) > self.max_waiting:
            self._replace(self._waiting.pop(0), "too many are waiting")
        self._report(utterance, "waiting")

    def _replace(self, waiting: _QueuedUtterance, why: str) -> None:
        waiting.expiry.cancel()
        self._report(waiting.utterance, "replaced", why)

    def _expire(self, waiting: _QueuedUtterance, why: str = "") -> None:
        self._waiting.remove(waiting)
        self._report(waiting.utterance, "expired", why)

    def _expire_all(self, why: str) -> None:
        for waiting in list(self._waiting):
            waiting.expiry.cancel()
            self._expire(waiting, why)

    def _speak(self, utterance: Utterance) -> None:
        try:
            sound = self._synthesize(utterance.text)
        except SocialbotError as error:
            self._report(utterance, "failed", _line(error))
            return
        self._sounding = utterance
        self._spoken += 1
        self._report(utterance, "started", self._keep(sound, utterance.text))
        if self._player is None:
            self.call_after(sound.duration_s, partial(self._ended, utterance, None))
        else:
            self._player.play(sound, partial(self._ended_elsewhere, utterance))

    def _synthesize(self, text: str) -> Sound:
        if self._voice is None:
            raise self._missing or InstallationError("the node has not been started")
        return self._voice.say(text).at_volume(self.volume)

    def _ended_elsewhere(self, utterance: Utterance, error: str | None) -> None:
        """The player's report, in a thread of its own."""
        self.context.call_soon(partial(self._ended, utterance, error))

    def _ended(self, utterance: Utterance, error: str | None) -> None:
        if utterance is not self._sounding:
            return
        self._sounding = None
        self._report(utterance, "failed" if error else "finished", error or "")
        while self._waiting and self._sounding is None:
            waiting = self._waiting.pop(0)
            waiting.expiry.cancel()
            self._speak(waiting.utterance)

    def _report(self, utterance: Utterance, state: State, detail: str = "") -> None:
        self.status.publish(
            SpeechStatus(
                stamp=self.clock.now(), utterance_id=utterance.id, state=state, text=utterance.text, detail=detail
            )
        )

    def _make_folder(self) -> Path:
        folder = paths.in_workspace(self.folder, where=f"{self.name}.folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ParameterError(
                f"no folder {self.folder!r}: {error.strerror}", where=f"{self.name}.folder", remedy="name another one"
            ) from error
        return folder

    def _keep(self, sound: Sound, text: str) -> str:
        """Writes the .wav file, if wanted, and gives its name; a full disc does not silence the robot."""
        if self._folder is None:
            return ""
        name = f"{self._spoken:03d}-{slug(text)}.wav"
        try:
            sound.write_wav(self._folder / name)
            self._sounds.append(self._folder / name)
            if len(self._sounds) > MOST_SOUNDS:
                self._sounds.popleft().unlink(missing_ok=True)
        except OSError as error:
            self.log.warning("%s is not written: %s", name, error)
            return ""
        return name


def slug(text: str) -> str:
    """``text`` as part of a file name: at most 40 small ASCII letters, digits and hyphens."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_text).strip("-")[:40].rstrip("-") or "utterance"


def _line(error: SocialbotError) -> str:
    return f"{error.what}; {error.remedy}" if error.remedy else error.what
