"""Sound as 16-bit PCM: WAV files, checks of sound messages, and conversion to what recognition takes."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, InstallationError, MessageError
from socialbot.core.installation import extra_command
from socialbot.core.limits import DATA_BYTES
from socialbot.core.messages import AudioData
from socialbot.core.reading import open_file, read_bytes

RATE_HZ = 16000
"""Sample rate of voice activity detection and recognition."""

MIN_RATE_HZ, MAX_RATE_HZ = 8000, 96000

MAX_CHANNELS = 32
"""Most channels of sound: the header of a file may claim 65,535, and a message any number."""

_SUBTYPE_OF_FORMAT = 24  # Place of the real format in a WAV header of the extensible kind.


def samples_of(sound: AudioData) -> np.ndarray:
    """Samples of a message: int16 of shape (frames, channels).

    Raises:
        MessageError: The sample rate or number of channels is not supported, or the bytes are no whole frames.
    """
    if not MIN_RATE_HZ <= sound.sample_rate <= MAX_RATE_HZ:
        raise MessageError(
            f"sound of {sound.sample_rate} Hz is not supported",
            remedy=f"set the microphone to {MIN_RATE_HZ} to {MAX_RATE_HZ} Hz",
        )
    if sound.channels > MAX_CHANNELS:
        raise MessageError(
            f"sound of {sound.channels} channels is not supported", remedy=f"send {MAX_CHANNELS} channels or fewer"
        )
    if len(sound.samples) % (2 * sound.channels):
        what = f"{len(sound.samples)} bytes are no whole samples of {sound.channels} channels of 16 bits"
        raise MessageError(what, remedy="send signed 16-bit samples, channels interleaved")
    return np.frombuffer(sound.samples, "<i2").reshape(-1, sound.channels)


def duration_ns(sound: AudioData) -> int:
    """Duration of the sound of a message, in ns."""
    return len(sound.samples) // (2 * sound.channels) * SECOND // sound.sample_rate


def level_db(samples: np.ndarray) -> float:
    """Level of int16 samples relative to full scale, in dB; -100 for silence."""
    if not samples.size:
        return -100.0
    power = float(np.mean(np.square(samples.astype(np.float32)))) / 32768.0**2
    return max(-100.0, 10.0 * float(np.log10(power + 1e-12)))


class Converter:
    """Streaming conversion of 16-bit PCM to mono with `RATE_HZ`, for one sample rate and number of channels.

    Channels are averaged. Raises InstallationError for another rate when PyAV is missing.
    """

    def __init__(self, sample_rate: int, channels: int) -> None:
        self.sample_rate = sample_rate
        self.channels = channels
        self._resampler = None
        if sample_rate != RATE_HZ:
            try:
                import av  # pyright: ignore[reportMissingImports] - extra hear
            except ImportError as error:
                raise InstallationError(f"PyAV is not installed ({error})", remedy=extra_command("hear")) from error
            self._frame = av.AudioFrame
            self._resampler = av.AudioResampler(format="s16", layout="mono", rate=RATE_HZ)

    def push(self, samples: np.ndarray) -> np.ndarray:
        """Convert the next int16 samples of shape (frames, channels) to int16 of shape (n,)."""
        mono = samples[:, 0]
        if self.channels > 1:
            mono = np.rint(samples.mean(axis=1)).astype(np.int16)
        if self._resampler is None or not mono.size:
            return np.ascontiguousarray(mono, np.int16)
        frame = self._frame.from_ndarray(np.ascontiguousarray(mono, np.int16)[None, :], format="s16", layout="mono")
        frame.sample_rate = self.sample_rate
        return self._resample(frame)

    def flush(self) -> np.ndarray:
        """The last samples, at the end of the sound."""
        return np.zeros(0, np.int16) if self._resampler is None else self._resample(None)

    def _resample(self, frame: Any) -> np.ndarray:
        assert self._resampler is not None
        parts = [each.to_ndarray()[0] for each in self._resampler.resample(frame)]
        return np.concatenate(parts) if parts else np.zeros(0, np.int16)


class WavFile:
    """PCM WAV file with 8, 16, 24 or 32 bits, read piece by piece as 16-bit samples.

    A file that is shorter than its header says is read as far as it goes.

    Raises:
        DeviceError: There is no such file, or it has another format.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._file = _open_wav(self.path)
        except (OSError, EOFError, RuntimeError, wave.Error) as error:  # RuntimeError: a chunk beyond the end
            what = getattr(error, "strerror", None) or str(error) or "the file is truncated"
            raise DeviceError(
                f"cannot be read as sound: {what}", where=str(path), remedy="give a .wav file with PCM samples"
            ) from error
        self.sample_rate = self._file.getframerate()
        self.channels = self._file.getnchannels()
        self._width = self._file.getsampwidth()
        size = self._width * self.channels
        self.frames = min(self._file.getnframes(), self.path.stat().st_size // size)
        if not MIN_RATE_HZ <= self.sample_rate <= MAX_RATE_HZ or not 1 <= self._width <= 4:
            what = f"{8 * self._width} bits with {self.sample_rate} Hz are not supported"
            self._file.close()
            raise DeviceError(
                what, where=str(path), remedy=f"convert it to 16 bits with {MIN_RATE_HZ} to {MAX_RATE_HZ} Hz"
            )
        if self.channels > MAX_CHANNELS:
            self._file.close()
            raise DeviceError(
                f"{self.channels} channels are not supported",
                where=str(path),
                remedy=f"convert it to {MAX_CHANNELS} channels or fewer",
            )

    def read(self, frames: int) -> bytes:
        """The next ``frames`` or fewer as 16-bit little-endian samples; empty at the end."""
        data = self._file.readframes(frames)
        data = data[: len(data) - len(data) % (self._width * self.channels)]
        if self._width == 2:
            return data
        if self._width == 1:
            return ((np.frombuffer(data, np.uint8).astype(np.int16) - 128) << 8).astype("<i2").tobytes()
        # The two highest bytes of each sample.
        return np.frombuffer(data, np.uint8).reshape(-1, self._width)[:, -2:].tobytes()

    def close(self) -> None:
        self._file.close()


def _open_wav(path: Path) -> wave.Wave_read:
    try:
        open_file(path).close()  # a pipe would be waited for
        return wave.open(str(path), "rb")
    except wave.Error:
        # Python before 3.12 refuses the extensible header, which stands for PCM as well.
        data = bytearray(read_bytes(path))
        at = data.find(b"fmt ") + 8
        if at < 8 or data[at : at + 2] != b"\xfe\xff" or data[at + _SUBTYPE_OF_FORMAT :][:2] != b"\x01\x00":
            raise
        data[at : at + 2] = b"\x01\x00"
        import io

        return wave.open(io.BytesIO(bytes(data)), "rb")


def read_wav(path: str | Path) -> np.ndarray:
    """All samples of a WAV file as mono int16 with `RATE_HZ`. Raises DeviceError."""
    file = WavFile(path)
    try:
        if file.frames * 2 * file.channels > DATA_BYTES:
            raise DeviceError(
                f"more than {DATA_BYTES >> 20} MiB of sound", where=str(path), remedy="cut it into shorter files"
            )
        converter = Converter(file.sample_rate, file.channels)
        pieces = [converter.push(piece) for piece in _pieces(file)]
        pieces.append(converter.flush())
    finally:
        file.close()
    return np.concatenate(pieces)


def _pieces(file: WavFile) -> Iterator[np.ndarray]:
    while data := file.read(file.sample_rate):
        yield np.frombuffer(data, "<i2").reshape(-1, file.channels)


def chunks_of(samples: np.ndarray, *, start: int) -> list[AudioData]:
    """Messages with pieces of 0.05 s of mono int16 ``samples`` at `RATE_HZ`; the first is stamped ``start`` (ns)."""
    size = RATE_HZ // 20
    return [
        AudioData(
            stamp=start + first * SECOND // RATE_HZ,
            samples=samples[first : first + size].astype("<i2").tobytes(),
            sample_rate=RATE_HZ,
        )
        for first in range(0, len(samples), size)
    ]
