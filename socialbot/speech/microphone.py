"""Sound sources: the microphone of this machine by miniaudio, or a WAV file, and the node that publishes the sound."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import DeviceError, InstallationError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData
from socialbot.graph.node import Node, Timer
from socialbot.graph.ports import Output, Parameter
from socialbot.speech.audio import MAX_RATE_HZ, MIN_RATE_HZ, WavFile
from socialbot.speech.playback import SOUND_DEVICES, usual_backends

if TYPE_CHECKING:
    import miniaudio

DEFAULT = "default"
"""Source that stands for the default microphone."""

_RETRY_S = 2.0
_RETRIED = f"retried every {_RETRY_S:g} s"
_PATIENCE_S = 1.0  # A working device delivers sound more often.
_SUFFIX = ".wav"


class SoundDevice(Protocol):
    """Interface of an open microphone."""

    def close(self) -> None:
        """Stop, and release the device."""
        ...


OnSound = Callable[[bytes], None]


class Capture:
    """The microphone ``source`` by name, open. It calls ``on_sound`` in a thread of its own with 16-bit samples.

    Raises:
        InstallationError: miniaudio is missing.
        DeviceError: There is no such microphone, or it cannot be opened.
    """

    def __init__(
        self,
        source: str,
        sample_rate: int,
        channels: int,
        chunk_s: float,
        on_sound: OnSound,
        *,
        backends: Sequence[miniaudio.Backend] = (),
    ) -> None:
        try:
            import miniaudio
        except (ImportError, OSError) as error:
            raise InstallationError(f"miniaudio is not installed ({error})", remedy=extra_command("hear")) from error
        self._on_sound = on_sound
        usable = list(backends or usual_backends("c"))
        try:
            device_id = None if source == DEFAULT else _find(source, usable)
            self._device = miniaudio.CaptureDevice(
                miniaudio.SampleFormat.SIGNED16,
                nchannels=channels,
                sample_rate=sample_rate,
                buffersize_msec=max(1, round(chunk_s * 1000)),
                device_id=device_id,
                backends=usable,
                app_name="socialbot",
            )
            receiver = self._receive()
            next(receiver)
            self._device.start(receiver)
        except miniaudio.MiniaudioError as error:
            reason = error.args[0] if error.args else error  # the text, without the number of the error
            raise DeviceError(f"no microphone ({reason})", where=source, remedy=_remedy()) from error

    def _receive(self) -> Generator[None, Any, None]:
        while True:
            self._on_sound(bytes((yield)))

    def close(self) -> None:
        self._device.close()


def _remedy() -> str:
    """What to do about a microphone that cannot be opened."""
    cards = list(SOUND_DEVICES.glob("pcm*c"))
    if cards and not any(os.access(card, os.R_OK | os.W_OK) for card in cards):
        return f"permission for {cards[0]} is refused: add the user to the group 'audio', and log in again"
    return "plug one in and check that no other program uses it; or set source to a .wav file"


def _find(source: str, backends: Sequence[miniaudio.Backend]) -> object:
    import miniaudio

    found = miniaudio.Devices(list(backends)).get_captures()
    for device in found:
        if source.lower() in device["name"].lower():
            return device["id"]
    names = ", ".join(device["name"] for device in found) or "no microphone"
    raise DeviceError("no such microphone", where=source, remedy=f"choose one: {names}; or '{DEFAULT}'")


class Microphone(Node):
    """Publishes the sound of a microphone, or of a WAV file in real time.

    A microphone that is missing or unplugged is reported once and retried every two seconds. A file has its own sample
    rate and channels; it stops at its end, or restarts with ``loop``.
    """

    sound = Output(AudioData, "/audio")

    source = Parameter(DEFAULT, "default, a part of a microphone's name, or a .wav file", fixed=True)
    sample_rate = Parameter(
        16000, "samples per second of a microphone, Hz", minimum=MIN_RATE_HZ, maximum=MAX_RATE_HZ, fixed=True
    )
    channels = Parameter(1, "channels of a microphone", minimum=1, maximum=16, fixed=True)
    chunk_s = Parameter(0.05, "duration of one message, s", minimum=0.01, maximum=1.0, fixed=True)
    loop = Parameter(False, "restart a file at its end")

    @classmethod
    def expect_available(cls, parameters: Mapping[str, object]) -> None:
        """Raise DeviceError for an unreadable file; a microphone may be plugged in later."""
        source = str(parameters.get("source", cls.source.default))
        if is_file(source):
            WavFile(source).close()

    _device: SoundDevice | None = None
    _file: WavFile | None = None
    _timer: Timer | None = None
    _due = _last_sound = 0
    _end: int | None = None
    """End (ns) of the last sound of the microphone."""
    _reported = False

    def start(self) -> None:
        """Open the source.

        Raises:
            DeviceError: The file cannot be read.
            InstallationError: miniaudio is missing.
            ParameterError: The file is outside the folders that the user allows.
        """
        self._due = self.clock.now()
        if is_file(self.source):
            self._file = WavFile(paths.in_workspace(self.source, where=f"{self.name}.source"))
            self._schedule(self._due, self._tick)
        else:
            self._open()

    def stop(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._close()

    def open_device(self, on_sound: OnSound) -> SoundDevice:
        """Return the open microphone; subclasses may override it. Raises DeviceError and InstallationError."""
        return Capture(self.source, self.sample_rate, self.channels, self.chunk_s, on_sound)

    def _schedule(self, due: int, callback: Callable[[], None]) -> None:
        self._timer = self.context.call_at(due, callback)

    def _close(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            device.close()
        if self._file is not None:
            self._file.close()
            self._file = None

    def _tick(self) -> None:
        """Publish the sound of a file up to now. The schedule has no drift."""
        file = self._file
        if file is None:
            return
        data = file.read(round(self.chunk_s * file.sample_rate))
        if not data and self.loop and file.frames:
            file.close()
            file = self._file = WavFile(paths.in_workspace(self.source, where=f"{self.name}.source"))
            data = file.read(round(self.chunk_s * file.sample_rate))
        if not data:
            self._close()
            self.log.info("%s has ended", self.source)
            self.report_health("waiting", f"{self.source} has ended")
            return
        message = AudioData(stamp=self._due, samples=data, sample_rate=file.sample_rate, channels=file.channels)
        # Its last sample is recorded now.
        self._due += len(data) // (2 * file.channels) * SECOND // file.sample_rate
        self._schedule(self._due, partial(self._send, message))

    def _send(self, message: AudioData) -> None:
        self.sound.publish(message)
        now = self.clock.now()
        if self._due < now - SECOND:
            self._due = now  # The machine was suspended.
        self._tick()

    def _open(self) -> None:
        """Open the microphone; if that fails, report it once and try again later."""
        try:
            self._device = self.open_device(lambda data: self.context.call_soon(partial(self._on_sound, data)))
        except DeviceError as error:
            self._schedule(self.clock.now() + nanoseconds(_RETRY_S), self._open)
            self._report_once(f"{error.where}: {error.what}; {error.remedy}; {_RETRIED}")
            return
        self._end, self._last_sound = None, self.clock.now()
        self._schedule(self._last_sound + nanoseconds(_PATIENCE_S), self._watch)

    def _watch(self) -> None:
        """Reopen a microphone that delivers no more sound."""
        now = self.clock.now()
        if self._device is None:
            return
        if now - self._last_sound < nanoseconds(_PATIENCE_S):
            self._schedule(self._last_sound + nanoseconds(_PATIENCE_S), self._watch)
            return
        self._close()
        self._report_once(f"{self.source}: no more sound; check the connection; {_RETRIED}")
        self._schedule(now + nanoseconds(_RETRY_S), self._open)

    def _report_once(self, problem: str) -> None:
        if not self._reported:
            self._reported = True
            self.report_health("failed", problem)
            self.log.warning(problem)

    def _on_sound(self, data: bytes) -> None:
        if self._device is None or not data:
            return
        now = self.clock.now()
        if self._reported:
            self._reported = False
            self.log.info("microphone %s is back", self.source)
            self.report_health("ok")
        self._last_sound = now
        duration = len(data) // (2 * self.channels) * SECOND // self.sample_rate
        # Messages arrive in bursts: their sound follows the one before, unless some was lost.
        stamp = now - duration if self._end is None else self._end
        if abs(now - duration - stamp) > SECOND // 5:
            stamp = now - duration
        self._end = stamp + duration
        self.sound.publish(AudioData(stamp=stamp, samples=data, sample_rate=self.sample_rate, channels=self.channels))


def is_file(source: str) -> bool:
    """Whether ``source`` names a WAV file."""
    return source.lower().endswith(_SUFFIX)
