"""Sound messages of other packages in bags, and the sound of videos."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, InstallationError, MessageError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData

AUDIO_TOPIC = "/audio"

AUDIO_TYPES = frozenset(f"audio_common_msgs/msg/{name}" for name in ("AudioData", "AudioDataStamped", "AudioStamped"))
"""ROS types with sound that are read as `AudioData`: those of two packages with the same name."""

RATE_HZ = 16000
"""Sample rate of types that do not say it: the default of audio_capture, with one channel of signed 16-bit samples."""

CHUNK_S = 0.05
_SHIFTS = {"int32_data": -16, "int16_data": 0, "int8_data": 8}
_MP3 = (b"ID3", b"\xff\xfb", b"\xff\xf3")


def is_sound(ros_message: Any) -> bool:
    """Whether a ROS message is one of `AUDIO_TYPES`."""
    data = getattr(ros_message, "data", None)
    return hasattr(ros_message, "audio") or (hasattr(data, "__len__") and not isinstance(data, str))


def sound_of(ros_message: Any, stamp: int) -> AudioData:
    """Convert a message of `AUDIO_TYPES`; one without a header ends at ``stamp`` (ns).

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
        if samples.startswith(_MP3):
            raise MessageError("the sound is compressed as mp3", remedy="record it with format:=wave")
    if rate < 1 or channels < 1 or len(samples) % (2 * channels):
        raise MessageError(f"{len(samples)} bytes of sound do not fit {channels} channels with {rate} Hz")
    if header is None:
        begin = stamp - len(samples) // (2 * channels) * SECOND // rate
    else:
        begin = header.stamp.sec * SECOND + header.stamp.nanosec or stamp
    return AudioData(stamp=begin, samples=samples, sample_rate=rate, channels=channels)


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
        with av.open(str(path)) as container:
            if not container.streams.audio:
                return
            stream = container.streams.audio[0]
            rate, channels = stream.rate, min(2, stream.channels)
            zero = _first_image_s(container)
            layout = "mono" if channels == 1 else "stereo"
            resampler = av.AudioResampler(format="s16", layout=layout, rate=rate, frame_size=round(CHUNK_S * rate))
            begin = None
            count = 0
            for frame in container.decode(stream):
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
    except FFmpegError as error:
        raise BagError(f"its sound cannot be decoded: {error}", where=str(path), remedy="use --no-sound") from error


def _first_image_s(container: Any) -> float:
    """Time (s) of the first image of a video."""
    if not container.streams.video:
        return 0.0
    stream = container.streams.video[0]
    return float(stream.start_time * stream.time_base) if stream.start_time is not None else 0.0
