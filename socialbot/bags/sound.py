"""Sound messages of other packages in bags, and the sound of videos."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, InstallationError, MessageError
from socialbot.core.installation import extra_command
from socialbot.core.limits import DECODER_BYTES
from socialbot.core.memory_limit import memory_limit
from socialbot.core.messages import AudioData

AUDIO_TOPIC = "/audio"

AUDIO_TYPES = frozenset(f"audio_common_msgs/msg/{name}" for name in ("AudioData", "AudioDataStamped", "AudioStamped"))
"""ROS types with sound that are read as `AudioData`: those of two packages with the same name."""

RATE_HZ = 16000
"""Sample rate of types that do not say it: the default of audio_capture, with one channel of signed 16-bit samples."""

CHUNK_S = 0.05
_SHIFTS = {"int32_data": -16, "int16_data": 0, "int8_data": 8}
_MP3_KBPS = (
    (32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320),
    (8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160),
)
"""Bit rates of layer III by their number from 1 on: of MPEG 1, and of MPEG 2 and 2.5."""
_MP3_HZ = (44100, 48000, 32000)
_MP3_HALVINGS = {3: 0, 2: 1, 0: 2}
"""How often the sample rate is halved, by the number of the version: MPEG 1, 2 and 2.5."""


def is_sound(ros_message: Any) -> bool:
    """Whether a ROS message is one of `AUDIO_TYPES`."""
    data = getattr(ros_message, "data", None)
    return hasattr(ros_message, "audio") or (hasattr(data, "__len__") and not isinstance(data, str))


def sound_of(ros_message: Any, stamp: int) -> AudioData:
    """Convert a message of `AUDIO_TYPES`; one without the time of a header ends at ``stamp`` (ns).

    Raises:
        MessageError: Its sound is compressed, or its fields do not fit together.
    """
    audio = getattr(ros_message, "audio", ros_message)
    header = getattr(ros_message, "header", None)
    rate, channels = RATE_HZ, 1
    if hasattr(audio, "audio_data"):
        rate, channels = int(audio.info.rate), int(audio.info.channels)
        samples = _samples(audio.audio_data)
    else:
        samples = bytes(audio.data)
        if _is_mp3(samples):
            raise MessageError("the sound is compressed as mp3", remedy="record it with format:=wave")
    if rate < 1 or channels < 1 or len(samples) % (2 * channels):
        raise MessageError(f"{len(samples)} bytes of sound do not fit {channels} channels with {rate} Hz")
    begin = 0 if header is None else header.stamp.sec * SECOND + header.stamp.nanosec
    if not begin:
        begin = stamp - len(samples) // (2 * channels) * SECOND // rate
    return AudioData(stamp=begin, samples=samples, sample_rate=rate, channels=channels)


def _is_mp3(data: bytes) -> bool:
    """Whether ``data`` begin with a tag, or with a valid frame of layer III that ends them or is followed by another.

    Two bytes are not enough: loud samples have the bytes of the begin of a frame, too.
    """
    if data.startswith(b"ID3"):
        return True
    if len(data) < 4 or data[0] != 0xFF or data[1] & 0xE6 != 0xE2:
        return False
    version, bitrate, rate = data[1] >> 3 & 3, data[2] >> 4, data[2] >> 2 & 3
    if version not in _MP3_HALVINGS or bitrate in (0, 15) or rate == 3:
        return False
    halvings = _MP3_HALVINGS[version]
    kbps = _MP3_KBPS[min(1, halvings)][bitrate - 1]
    length = (72 if halvings else 144) * kbps * 1000 // (_MP3_HZ[rate] >> halvings) + (data[2] >> 1 & 1)
    return len(data) >= length and data[length : length + 2] in (b"", data[:2])


def _samples(data: Any) -> bytes:
    """Samples of one of the arrays of a message as 16-bit integers."""
    for name, shift in _SHIFTS.items():
        numbers = np.asarray(getattr(data, name, ()), np.int64)
        if numbers.size:
            return (numbers << shift if shift > 0 else numbers >> -shift).astype("<i2").tobytes()
    unsigned = np.asarray(getattr(data, "uint8_data", ()), np.int64)
    if unsigned.size:
        return ((unsigned - 128) << 8).astype("<i2").tobytes()
    floats = np.asarray(data.float32_data, np.float64)
    return np.clip(np.rint(floats * 32768), -32768, 32767).astype("<i2").tobytes()


def has_decoder() -> bool:
    """Whether the sound of videos can be read: PyAV is installed."""
    try:
        import av  # noqa: F401  # pyright: ignore[reportMissingImports] - extra hear
    except ImportError:
        return False
    return True


def video_sound(path: Path, start: int, *, until: int | None = None) -> Iterator[AudioData]:
    """Yield the sound of a video in pieces of `CHUNK_S`, with its own rate and one or two channels.

    Args:
        path: The video.
        start: Stamp (ns) of the first image.
        until: Stamp (ns) at which to end.

    Raises:
        BagError: The sound cannot be decoded.
        InstallationError: PyAV is missing.
    """
    try:
        import av  # pyright: ignore[reportMissingImports] - extra hear
        from av.error import FFmpegError  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise InstallationError(f"PyAV is not installed ({error})", remedy=extra_command("hear")) from error
    try:
        with memory_limit(DECODER_BYTES):
            opened = av.open(str(path))
        with opened as container:
            if not container.streams.audio:
                return
            stream = container.streams.audio[0]
            rate, channels = stream.rate, min(2, stream.channels)
            zero = _first_image_s(container)
            layout = "mono" if channels == 1 else "stereo"
            resampler = av.AudioResampler(format="s16", layout=layout, rate=rate, frame_size=round(CHUNK_S * rate))
            begin = None
            count = 0
            for frame in _limited(container.decode(stream)):
                if begin is None:
                    begin = start + round(((frame.time or 0.0) - zero) * SECOND)
                for piece in resampler.resample(frame):
                    stamp = begin + count * SECOND // rate
                    count += piece.samples
                    if until is not None and stamp >= until:
                        return
                    # Sound before the first image has no place in the bag.
                    if stamp >= start:
                        samples = piece.to_ndarray().astype("<i2").tobytes()
                        yield AudioData(stamp=stamp, samples=samples, sample_rate=rate, channels=channels)
    except (FFmpegError, MemoryError) as error:
        raise BagError(f"its sound cannot be decoded: {error}", where=str(path), remedy="use --no-sound") from error


def _limited(frames: Iterator[Any]) -> Iterator[Any]:
    """The frames of a decoder, which takes no more than `DECODER_BYTES` for each further one."""
    while True:
        with memory_limit(DECODER_BYTES):
            frame = next(frames, None)
        if frame is None:
            return
        yield frame


def _first_image_s(container: Any) -> float:
    """Time (s) of the first image of a video."""
    if not container.streams.video:
        return 0.0
    stream = container.streams.video[0]
    return float(stream.start_time * stream.time_base) if stream.start_time is not None else 0.0
