"""Sound playback with miniaudio, if it is installed and finds a device."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from socialbot.speech.synthesis import Sound

if TYPE_CHECKING:
    import miniaudio

log = logging.getLogger("socialbot.speech.playback")

OnEnd = Callable[[str | None], None]

SOUND_DEVICES = Path("/dev/snd")
_PERIOD_MS = 50
_TAIL_S = 0.2  # Silence after each sound, longer than the device buffers.
_PATIENCE_S = 1.0  # Longest time in which a working device requests no samples.


class AudioPlayer(Protocol):
    """Interface for the playback of one sound at a time."""

    def play(self, sound: Sound, on_end: OnEnd) -> None:
        """Start to play ``sound``, without waiting and without exceptions. This stops a previous sound.

        At the end another thread calls ``on_end`` with None or an error message. The callback must not call the player.
        """
        ...

    def stop(self) -> None:
        """Stop playback without calling ``on_end``."""
        ...


class DevicePlayer:
    """An `AudioPlayer` that opens the default device of ``backend`` for each sound."""

    def __init__(self, backend: miniaudio.Backend) -> None:
        self.backend = backend
        self._thread: threading.Thread | None = None
        self._source: _Source | None = None

    def play(self, sound: Sound, on_end: OnEnd) -> None:
        self.stop()
        self._source = source = _Source(sound)
        self._thread = threading.Thread(target=self._run, args=(source, on_end), name="socialbot-playback", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        if self._source is not None and self._thread is not None:
            self._source.cut_off()
            self._thread.join(_PATIENCE_S)

    def _run(self, source: _Source, on_end: OnEnd) -> None:
        try:
            error = self._play(source)
        except Exception as failure:  # noqa: BLE001 - drivers raise anything, and the caller waits for the end
            error = f"{type(failure).__name__}: {failure}"
        if not source.cut:
            on_end(error)

    def _play(self, source: _Source) -> str | None:
        """Play ``source`` to its end; return an error message or None."""
        with open_device(self.backend, source.sample_rate) as device:
            device.start(source.frames())
            left = -1
            # The stop callback of miniaudio comes too early, and a device closed in it may hang.
            while not source.over.wait(_PATIENCE_S):
                if source.left == left:
                    return "the sound device takes no more sound"
                left = source.left
        return None


class _Source:
    """Sample source for a device; ``over`` is set at its end or by `cut_off`."""

    def __init__(self, sound: Sound) -> None:
        self.sample_rate = sound.sample_rate
        self.cut = False
        self.over = threading.Event()
        self._samples = np.concatenate([sound.samples, np.zeros(round(_TAIL_S * sound.sample_rate), np.int16)])
        self.left = self._samples.size

    def cut_off(self) -> None:
        self.cut = True
        self.over.set()

    def frames(self) -> Generator[bytes, int, None]:
        """Return a started generator, as miniaudio requires; send() takes the number of frames."""
        frames = self._frames()
        next(frames)
        return frames

    def _frames(self) -> Generator[bytes, int, None]:
        wanted = yield b""
        while self.left:
            start = self._samples.size - self.left
            chunk = self._samples[start : start + wanted]
            self.left -= chunk.size
            wanted = yield chunk.tobytes()
        self.over.set()


def open_device(backend: miniaudio.Backend, sample_rate: int) -> miniaudio.PlaybackDevice:
    """Open the default device for mono int16 sound. Raises miniaudio.MiniaudioError if there is none."""
    import miniaudio

    return miniaudio.PlaybackDevice(
        miniaudio.SampleFormat.SIGNED16,
        nchannels=1,
        sample_rate=sample_rate,
        buffersize_msec=_PERIOD_MS,
        backends=[backend],
        app_name="socialbot",
    )


def find_player(backends: Sequence[miniaudio.Backend] = ()) -> AudioPlayer | None:
    """Return a player on the first working one of ``backends`` (default: those of this system), or None."""
    try:
        import miniaudio  # noqa: F401 - availability check
    except (ImportError, OSError) as error:
        log.info("no sound: %s", error)
        return None
    usable = next(filter(_opens, backends or usual_backends("p")), None)
    return None if usable is None else DevicePlayer(usable)


def _opens(backend: miniaudio.Backend) -> bool:
    from miniaudio import MiniaudioError

    try:
        open_device(backend, sample_rate=22050).close()
    except MiniaudioError as error:
        log.info("no sound by %s: %s", backend.name, error)
        return False
    return True


def usual_backends(direction: Literal["c", "p"]) -> list[miniaudio.Backend]:
    """Return the backends of this system to capture (c) or to play (p) sound."""
    from miniaudio import Backend

    if sys.platform == "darwin":
        return [Backend.COREAUDIO]
    if sys.platform == "win32":
        return [Backend.WASAPI, Backend.DSOUND]
    # Without a sound card ALSA prints a page of errors to stderr.
    card = any(SOUND_DEVICES.glob(f"pcm*{direction}"))
    return [Backend.PULSEAUDIO, *([Backend.ALSA] if card else []), Backend.JACK]
