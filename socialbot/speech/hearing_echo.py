"""Echo of the robot's own voice: cancellation with WebRTC's canceller, and detection of a person who interrupts."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import InstallationError
from socialbot.core.messages import AudioData, SpeechStatus
from socialbot.speech.audio import RATE_HZ, REMEDY, Converter, level_db, samples_of

FRAME = 160
"""Samples of one step of the canceller."""

_MEMORY_S = 1.0  # The canceller runs for so long after the last sound of the robot.


class OwnVoice:
    """Times in which the robot speaks, and the sound that it plays.

    ``tail_s`` is added to each utterance: the delay of the loudspeaker and the echo of the room.
    """

    def __init__(self, tail_s: float) -> None:
        self.tail_s = tail_s
        self._speaking = ""
        self._from = self._until = 0
        self._pieces: deque[tuple[int, np.ndarray]] = deque()

    def on_status(self, status: SpeechStatus) -> None:
        """Process the progress of an utterance."""
        if status.state == "started":
            self._speaking, self._from = status.utterance_id, status.stamp
        elif status.utterance_id == self._speaking and status.state in ("finished", "failed", "interrupted"):
            self._speaking, self._until = "", status.stamp + nanoseconds(self.tail_s)
            if status.state == "interrupted":
                self._cut(status.stamp)

    def on_sound(self, sound: AudioData) -> None:
        """Add a sound that the robot plays from its stamp on."""
        samples = samples_of(sound)
        converter = Converter(sound.sample_rate, sound.channels)
        self._pieces.append((sound.stamp, converter.push(samples)))

    def is_heard(self, time: int) -> bool:
        """Whether the robot's voice may be in the sound at ``time`` (ns)."""
        return (bool(self._speaking) and time >= self._from) or time < self._until

    @property
    def known(self) -> bool:
        """Whether the sound that the robot plays is known."""
        return bool(self._pieces)

    def played(self, time: int, count: int) -> np.ndarray | None:
        """The ``count`` samples that the robot plays from ``time`` (ns) on; None if it has been silent for a while."""
        while self._pieces and self._end(self._pieces[0]) + nanoseconds(_MEMORY_S) < time:
            self._pieces.popleft()
        if not self._pieces:
            return None
        played = np.zeros(count, np.int16)
        for start, samples in self._pieces:
            at = round((start - time) * RATE_HZ / SECOND)
            first, last = max(0, at), min(count, at + samples.size)
            if first < last:
                played[first:last] = samples[first - at : last - at]
        return played

    def _cut(self, time: int) -> None:
        """Remove the sound after ``time`` (ns)."""
        self._pieces = deque(
            (start, samples[: max(0, round((time - start) * RATE_HZ / SECOND))]) for start, samples in self._pieces
        )

    @staticmethod
    def _end(piece: tuple[int, np.ndarray]) -> int:
        return piece[0] + piece[1].size * SECOND // RATE_HZ


class EchoCanceller:
    """Remover of the robot's own voice from the sound of a microphone. Raises InstallationError if it is missing."""

    def __init__(self) -> None:
        try:
            from pywebrtc_audio import EchoCanceller as Canceller  # pyright: ignore[reportMissingImports]
        except (ImportError, OSError) as error:
            raise InstallationError(f"pywebrtc-audio is not installed ({error})", remedy=REMEDY) from error
        self._canceller: Any = Canceller(sample_rate=RATE_HZ)

    def process(self, samples: np.ndarray, played: np.ndarray) -> np.ndarray:
        """Return ``samples`` without ``played``: int16, a multiple of `FRAME`."""
        return self._canceller.process(samples, played)


class BargeInDetector:
    """Detector of a person who speaks while the robot speaks.

    A chunk counts if it is speech without the echo, too, and the canceller has not removed most of it.
    ``chunks`` of the last ``window`` have to count.
    """

    def __init__(self, *, probability: float = 0.6, kept_db: float = -12.0, chunks: int = 4, window: int = 5) -> None:
        self._probability = probability
        self._kept_db = kept_db
        self._chunks = chunks
        self._recent: deque[bool] = deque(maxlen=window)

    def push(self, raw: np.ndarray, clean: np.ndarray, probability: float) -> bool:
        """Add a chunk as recorded, without echo, and its probability of speech; return whether a person speaks."""
        kept = level_db(clean) - level_db(raw)
        self._recent.append(probability >= self._probability and kept >= self._kept_db)
        return sum(self._recent) >= self._chunks

    def reset(self) -> None:
        """Forget the chunks before."""
        self._recent.clear()
