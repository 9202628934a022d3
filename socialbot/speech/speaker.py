"""Speech node with a queue of utterances that expire."""

from __future__ import annotations

import re
import unicodedata
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import DeviceError, InstallationError, ParameterError, SocialbotError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, Health, Message, SpeechStatus, StopSpeech, Utterance
from socialbot.graph.health import BEATLESS_S, HEALTH_TOPIC
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Input, Output, Parameter
from socialbot.speech.messages import SpeechMarks
from socialbot.speech.neural import PiperVoice, join, open_voice
from socialbot.speech.playback import AudioPlayer, OnEnd, find_player
from socialbot.speech.spoken_text import spoken_text
from socialbot.speech.synthesis import Sound

MOST_SOUNDS = 500  # number of sound files kept, about 50 MB
MOST_VOICES = 8  # number of voices of other languages kept; a neural one takes about 100 MB

PLAYBACK = ("auto", "off", "required")

LATE_S = 2.0
"""Age (s) of an utterance, beyond that of the engine's health, from which it is not spoken after a lost link."""
RETURN_S = 1.0
"""Time (s) after the return of the engine in which what the link held back may still arrive."""
_HEALTHS = 10  # number of health messages whose least age is the usual one

_UNHEARD = "connect one and restart this node, or set playback to 'off'"

State = Literal["waiting", "started", "finished", "replaced", "expired", "failed", "interrupted"]


class SpeechVoice(Protocol):
    """Interface of speech synthesis."""

    def say(self, text: str) -> Sound:
        """Synthesize ``text``. Raises SocialbotError if that fails.

        A slow voice may also have a method ``parts(text)``, which yields the sound in parts. A voice with an attribute
        ``language`` (ISO 639-1) leaves utterances in other languages to other voices.
        """
        ...


@dataclass(eq=False)
class _QueuedUtterance:
    utterance: Utterance
    expiry: Timer = field(init=False)


class _Performance:
    """Utterance that sounds, part by part: the next part is synthesized while one is played.

    With a file ``name`` the parts are written when the last one is known. An utterance that is cut short leaves those
    that began to sound.
    """

    def __init__(
        self, node: Speaker, utterance: Utterance, first: Sound, rest: Iterator[Sound] | None, name: str, on_end: OnEnd
    ) -> None:
        self._node, self._utterance, self._rest, self._name, self._on_end = node, utterance, rest, name, on_end
        self._played: list[Sound] = []
        self._next: Sound | SocialbotError | None = None
        self._is_ready = self._is_silent = self._is_over = False
        self._play(first)

    def _play(self, part: Sound) -> None:
        self._played.append(part)
        self._is_silent = False
        self._is_ready = self._rest is None
        self._node.play(part, self._utterance, self._part_ended)
        if not self._is_ready:
            self._node.context.run_in_background(self._synthesize, self._on_synthesized)

    def _synthesize(self) -> Sound | SocialbotError | None:
        try:
            return None if self._rest is None else next(self._rest, None)
        except SocialbotError as error:
            return error

    def _on_synthesized(self, part: Sound | SocialbotError | Exception | None) -> None:
        self._next = part if part is None or isinstance(part, (Sound, SocialbotError)) else SocialbotError(repr(part))
        self._is_ready = True
        if self._next is None:
            self._write()
        self._go_on()

    def _part_ended(self, error: str | None) -> None:
        """Handle the end of a part, in the thread of the node."""
        if error:
            self._end(error)
        else:
            self._is_silent = True
            self._go_on()

    def _go_on(self) -> None:
        if self._is_over or not (self._is_ready and self._is_silent):
            return
        if isinstance(self._next, Sound):
            self._play(self._next)
        else:
            self._end(None if self._next is None else _line(self._next))

    def _end(self, error: str | None) -> None:
        if not self._is_over:
            self.stop()
            self._on_end(error)

    def stop(self) -> None:
        """End the utterance; parts that have not begun are not played."""
        self._is_over = True
        self._write()

    def _write(self) -> None:
        """Write the file, once."""
        name, self._name = self._name, ""
        if name:
            self._node.keep(self._played, name)


class Speaker(Node):
    """Speaks utterances one at a time and publishes the status of each.

    Waiting utterances are queued in order. A newer one with the same key replaces the queued one, with its own waiting
    time. Without a sound device an utterance takes as long as its sound, by the clock of the node; a replay sets
    ``playback`` to "off" for this. Changes of voice, rate, pitch or volume apply to the next utterance. The queue
    expires if the ``engine`` times out or reports a fault, since its people may have left. What a lost link held back
    expires, too. A `StopSpeech` interrupts
    the utterance that sounds and drops those that wait.
    """

    say = Input(Utterance, "/speech/say")
    stop_speech = Input(StopSpeech, "/speech/stop", optional=True)
    health = Input(Health, HEALTH_TOPIC, optional=True, deadline_s=BEATLESS_S)
    status = Output(SpeechStatus, "/speech/status")
    sound = Output(AudioData, "/speech/audio")
    marks = Output(SpeechMarks, "/speech/marks")

    voice = Parameter(
        "en", "voice: a language of espeak-ng, optionally with a variant, as in en-us+f3; or a neural voice, piper:joe"
    )
    voices = Parameter("", "voices of utterances in other languages, as in: de=de+f3 fr=piper:/voices/fr.onnx")
    rate_wpm = Parameter(165, "words per minute", minimum=80, maximum=450)
    pitch = Parameter(50, "pitch of the voice", minimum=0, maximum=100)
    volume = Parameter(1.0, "loudness, as a share of full amplitude", minimum=0.0, maximum=1.0)
    playback = Parameter(
        "auto", "auto: play if possible; off; required: fail without a sound device", choices=PLAYBACK, fixed=True
    )
    publish_sound = Parameter(False, "publish the sound of each utterance, for the echo canceller of `hearing`")
    publish_marks = Parameter(False, "publish the words and phonemes of each utterance, for mouth or LED animation")
    folder = Parameter("", f"folder for .wav files of the last {MOST_SOUNDS} utterances; empty: none", fixed=True)
    max_waiting_s = Parameter(5.0, "longest waiting time of an utterance, s", minimum=0.0)
    engine = Parameter("", "node whose health the queue depends on; empty: none")
    max_waiting = Parameter(8, "longest queue; beyond it the oldest utterance is dropped", minimum=1)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._voice: SpeechVoice | None = None
        self._others: dict[str, SpeechVoice] = {}  # the least recently used one first
        self._performance: _Performance | None = None
        self._missing: InstallationError | None = None
        self._player: AudioPlayer | None = None
        self._sounding: Utterance | None = None
        self._waiting: list[_QueuedUtterance] = []
        self._spoken = 0
        self._folder: Path | None = None
        self._sounds: deque[Path] = deque()
        self._engine_is_ok = True
        self._is_engine_silent, self._returned_at = False, -nanoseconds(RETURN_S)
        self._health_ages: deque[int] = deque(maxlen=_HEALTHS)
        self._limits: dict[str, str] = {}
        """Reasons by language without a voice, and by "" without a sound device."""

    def start(self) -> None:
        """Load voice and player. Without the speech library the node runs, and every utterance fails.

        Raises:
            ParameterError: The voice is unknown or the folder unusable.
            DeviceError: A required sound device is missing.
        """
        _read_voices(self.voices, where=f"{self.name}.voices")
        try:
            self._voice = self.find_voice()
        except InstallationError as error:
            self._missing = error
            self.log.warning("cannot speak: %s", _line(error))
            self.report_health("failed", f"cannot speak: {_line(error)}")
        self._folder = self._make_folder() if self.folder else None
        self._player = None if self.playback == "off" else self.find_player()
        if self._player is None and self.playback == "required":
            remedy = f"connect one and {extra_command('speech')}, or set playback to 'auto'"
            raise DeviceError("no sound device", where=self.name, remedy=remedy)

    def stop(self) -> None:
        if self._sounding is not None:
            self.hush()
        for waiting in self._waiting:
            waiting.expiry.cancel()
        self._waiting.clear()
        self._sounding = None

    def find_voice(self) -> SpeechVoice:
        """Return the synthesizer; subclasses may override it.

        Raises:
            InstallationError: A package is missing.
            ParameterError: The voice is unknown.
        """
        return open_voice(self.voice, self.rate_wpm, self.pitch)

    def voice_for(self, language: str) -> SpeechVoice:
        """Return the voice for a language; subclasses may override it.

        The voices of the `MOST_VOICES` other languages that were spoken last are kept; others are opened again.

        Raises:
            InstallationError: The node has no voice.
        """
        if self._voice is None:
            raise self._missing or InstallationError("the node has not been started")
        own = getattr(self._voice, "language", "")
        code = language.replace("_", "-").partition("-")[0].lower()
        if not language or not own or own in (language, code):
            return self._voice
        if language in self._others:
            voice = self._others.pop(language)
        else:
            voice = self._open_voice(language, code) or self._voice
        self._others[language] = voice
        if len(self._others) > MOST_VOICES:
            oldest = next(iter(self._others))
            del self._others[oldest]
            self._limits.pop(oldest, None)
        return voice

    def _open_voice(self, language: str, code: str) -> SpeechVoice | None:
        """Open the voice for a language such as "de-AT", else for its ``code``, "de"; warns if there is none."""
        listed = _read_voices(self.voices, where=f"{self.name}.voices")
        why = ""
        for wanted in dict.fromkeys((listed.get(language) or listed.get(code, language), code)):
            try:
                return open_voice(wanted, self.rate_wpm, self.pitch)
            except (InstallationError, ParameterError) as error:
                why = why or _line(error)
        own = getattr(self._voice, "language", "")
        limit = f"no voice for the language {language!r}, so that of {own!r} speaks"
        self.log.warning("%s: %s", limit, why)
        self._report_limit(language, limit)
        return None

    def _report_limit(self, name: str, reason: str) -> None:
        self._limits[name] = reason
        self.report_health("ok", "; ".join(self._limits.values()))

    def find_player(self) -> AudioPlayer | None:
        """Return the player, and report if there is none; subclasses may override it."""
        player = find_player()
        if player is None and self._missing is None:
            self._report_limit("", f"no sound device, so nobody hears the speech; {_UNHEARD}")
        return player

    def perform(self, utterance: Utterance, on_end: OnEnd) -> str:
        """Start to speak, and return a detail of it; subclasses may override it.

        ``on_end`` gets None or an error message at the end, from any thread.

        Raises:
            SocialbotError: The utterance cannot be spoken.
        """
        voice = self.voice_for(utterance.language)
        text = spoken_text(utterance.text, getattr(voice, "language", ""))
        name = f"{self._spoken + 1:03d}-{slug(utterance.text)}.wav" if self._folder else ""
        if isinstance(voice, PiperVoice):
            rest = voice.parts(text)
            first = next(rest)
            detail = name
        else:
            first, rest = voice.say(text), None
            detail, name = self.keep([first], name), ""
        self._spoken += 1
        self._performance = _Performance(self, utterance, first, rest, name, on_end)
        return detail

    def play(self, part: Sound, utterance: Utterance, on_end: OnEnd) -> None:
        """Play a part of an utterance, and publish its sound and marks. ``on_end`` is called in the node's thread."""
        part = part.at_volume(self.volume)
        now = self.clock.now()
        if self.publish_sound:
            samples = part.samples.astype("<i2").tobytes()
            self.sound.publish(AudioData(stamp=now, samples=samples, sample_rate=part.sample_rate))
        if self.publish_marks:
            self.marks.publish(SpeechMarks(stamp=now, utterance_id=utterance.id, marks=part.marks))
        if self._player is None:
            self.call_after(part.duration_s, partial(on_end, None))
        else:
            self._player.play(part, lambda error: self.context.call_soon(partial(on_end, error)))

    def hush(self) -> None:
        """Stop speaking; subclasses that override `perform` override it, too."""
        if self._performance is not None:
            self._performance.stop()
        if self._player is not None:
            self._player.stop()

    def on_parameter(self, name: str) -> None:
        """Change the voice. Raises ParameterError for an unknown one, which keeps the current voice."""
        if name == "voices":
            _read_voices(self.voices, where=f"{self.name}.voices")
        if name in ("voice", "voices", "rate_wpm", "pitch"):
            self._others.clear()
            if any(self._limits):
                self._limits = {name: reason for name, reason in self._limits.items() if not name}
                self.report_health("ok", "; ".join(self._limits.values()))
        if self._voice is not None and name in ("voice", "rate_wpm", "pitch"):
            self._voice = self.find_voice()

    def deadline_s(self, port: Input[Any]) -> float:
        return port.deadline_s if self.engine else 0.0

    def counts(self, port: Input[Any], message: Message) -> bool:
        return isinstance(message, Health) and message.node == self.engine

    @health
    def on_health(self, health: Health) -> None:
        if health.node == self.engine:
            self._health_ages.append(self.clock.now() - health.stamp)
            well = health.state not in ("paused", "degraded", "failed")
            if self._engine_is_ok and not well:
                self._expire_all(f"{self.engine}: {health.reason}")
            self._engine_is_ok = well

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self._is_engine_silent = True
        self._expire_all(f"{self.engine} is silent")

    def on_return(self, port: Input[Any]) -> None:
        self._is_engine_silent, self._returned_at = False, self.clock.now()

    @say
    def on_say(self, utterance: Utterance) -> None:
        late_s = self._late_s(utterance)
        if late_s > LATE_S:
            self._report(utterance, "expired", f"it comes {late_s:.0f} s late")
        elif self._sounding is None:
            self._speak(utterance)
        else:
            self._wait(utterance)

    @stop_speech
    def on_stop_speech(self, request: StopSpeech) -> None:
        """Stop the utterance that sounds, and drop those that wait."""
        for waiting in self._waiting:
            waiting.expiry.cancel()
            self._report(waiting.utterance, "interrupted", request.reason)
        self._waiting.clear()
        utterance, self._sounding = self._sounding, None
        if utterance is not None:
            self.hush()
            self._report(utterance, "interrupted", request.reason)

    def _late_s(self, utterance: Utterance) -> float:
        """For how long (s) a lost link has held ``utterance`` back; 0 unless the engine is silent, or was just now.

        Its age is compared with those of the engine's health, because clocks of machines differ.
        """
        now = self.clock.now()
        if not self._health_ages or not (self._is_engine_silent or now - self._returned_at < nanoseconds(RETURN_S)):
            return 0.0
        return (now - utterance.stamp - min(self._health_ages)) / SECOND

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
        self._sounding = utterance
        try:
            # The end comes from the thread of the player.
            ended = partial(self._ended, utterance)
            detail = self.perform(utterance, lambda error: self.context.call_soon(partial(ended, error)))
        except SocialbotError as error:
            self._sounding = None
            self._report(utterance, "failed", _line(error))
            return
        self._report(utterance, "started", detail)

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
        stamp, about = self.clock.now(), {"utterance_id": utterance.id, "text": utterance.text}
        self.status.publish(SpeechStatus(stamp=stamp, state=state, detail=detail, **about))

    def _make_folder(self) -> Path:
        folder = paths.in_workspace(self.folder, where=f"{self.name}.folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            what = f"cannot make the folder {self.folder!r}: {error.strerror}"
            raise ParameterError(what, where=f"{self.name}.folder", remedy="name another one") from error
        return folder

    def keep(self, parts: Sequence[Sound], name: str) -> str:
        """Write the .wav file of an utterance, if configured; return its name. A full disk does not stop speech."""
        if self._folder is None:
            return ""
        try:
            join(parts).at_volume(self.volume).write_wav(self._folder / name)
            self._sounds.append(self._folder / name)
            if len(self._sounds) > MOST_SOUNDS:
                self._sounds.popleft().unlink(missing_ok=True)
        except OSError as error:
            self.log.warning("%s is not written: %s", name, error)
            return ""
        return name


def _read_voices(text: str, *, where: str) -> dict[str, str]:
    """Read voices by language, as in ``de=de+f3 fr=fr``. Raises ParameterError."""
    pairs = [part.partition("=") for part in text.split()]
    for language, _, voice in pairs:
        if len(language) != 2 or not voice:
            raise ParameterError(f"{text!r} names no voices by language", where=where, remedy="write: de=de+f3 fr=fr")
    return {language: voice for language, _, voice in pairs}


def slug(text: str) -> str:
    """Convert ``text`` to at most 40 lower-case ASCII letters, digits and hyphens for a file name."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_text).strip("-")[:40].rstrip("-") or "utterance"


def _line(error: SocialbotError) -> str:
    return f"{error.what}; {error.remedy}" if error.remedy else error.what
