"""Echo of the robot's own voice: its removal, and detection of a person who interrupts."""

from __future__ import annotations

import statistics
from collections import deque
from itertools import islice

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import AudioData, SpeechStatus
from socialbot.speech.audio import RATE_HZ, Converter, level_db, samples_of

FRAME = 160
"""Samples of one step of the canceller."""
NO_ECHO_DB = -100.0
"""Rest of a frame without echo, or before the echo is known."""

_MEMORY_S = 1.0  # The canceller runs for so long after the last sound of the robot.
_REACH_S = 0.5  # Longest delay of the echo.
_LATEST_S = 30.0  # Longest delay of the microphone behind the sound of the robot.
_VARIANCE, _DECAY_PER_S = 0.1, 8.0  # Of the path at first: rooms reflect less the later.
_REST_KEPT, _PATH_KEPT, _SCALE_KEPT = 0.7, 0.9995, 0.984  # Shares that each step keeps of the averages.
_UPDATES = 2  # Of the path by each frame: it converges in half the time, and more would follow a person.

_BANDS = np.unique(np.rint(np.geomspace(300, 3550, 13) * 2 * FRAME / RATE_HZ).astype(int))
_LOUD_BANDS = 4
_SMOOTHED, _LATER = 3, 16  # Frames: of the average that is compared, and until it counts for the scale.
_LEARNT_S = 0.5  # Sound of the robot before which the scale is not known.
_MOST_OUTLIER = 4.0  # Times the expected power: what is louder counts only so much for the scale.
_LEAST_SCALE, _LEAST_POWER = 0.02, 1e-3  # The power is that of noise of -60 dB in a band.

_SPEECH_PROBABILITY, _REST_DB = 0.6, 10.0  # Least of a chunk of a person who interrupts;
_SPOKEN_CHUNKS, _WINDOW_CHUNKS = 3, 4  # so many chunks of the last ones have to count.

_LOUD_DB = 6.0  # Above the background: the sound is still there.
_LEAST_BACKGROUND_DB = -60.0
_BACKGROUND_CHUNKS, _TAILS = 60, 5  # About two seconds of sound; the newest tails.
_QUIET_S, _LONGEST_TAIL_S, _MARGIN_S = 0.2, 1.5, 0.05


class TailMeter:
    """Meter of the time for which the robot's voice stays in the sound after it has ended.

    It is the delay of the loudspeaker and the echo of the room. The sound has to fall to the background that was there
    before the utterance within `_LONGEST_TAIL_S`, and stay there for `_QUIET_S`. A person who answers at once makes a
    tail longer, so the median of the newest ones counts.
    """

    def __init__(self) -> None:
        self._background: deque[float] = deque(maxlen=_BACKGROUND_CHUNKS)
        self._tails: deque[float] = deque(maxlen=_TAILS)
        self._ended: int | None = None
        self._loud_until = 0

    @property
    def tail_s(self) -> float | None:
        """The tail with a margin (s); None before the first one was measured."""
        return None if not self._tails else statistics.median(self._tails) + _MARGIN_S

    def begin(self) -> None:
        """An utterance begins; the tail of the one before it cannot be measured any more."""
        self._ended = None

    def end(self, time: int) -> None:
        """An utterance ended at ``time`` (ns)."""
        self._ended = self._loud_until = time

    def push(self, begin: int, end: int, samples: np.ndarray, *, is_heard: bool) -> None:
        """Add a chunk of sound from ``begin`` to ``end`` (ns); ``is_heard`` tells whether it may contain the robot."""
        level = level_db(samples)
        if self._ended is None:
            if not is_heard:
                self._background.append(level)
            return
        if begin < self._ended:
            return
        if not self._background:
            self._ended = None  # nothing to compare with
            return
        background = max(_LEAST_BACKGROUND_DB, statistics.median(self._background))
        if level > background + _LOUD_DB:
            self._loud_until = end
        tail_s = (self._loud_until - self._ended) / SECOND
        if tail_s > _LONGEST_TAIL_S:
            self._ended = None
        elif end - self._loud_until >= nanoseconds(_QUIET_S):
            self._tails.append(tail_s)
            self._ended = None


class OwnVoice:
    """Times in which the robot speaks, and the sound that it plays.

    A tail is added to each utterance: the delay of the loudspeaker and the echo of the room. It is ``tail_s`` until it
    has been measured from the sound (`push`).
    """

    def __init__(self, tail_s: float, *, measures: bool = True) -> None:
        self.tail_s = tail_s
        self._meter = TailMeter() if measures else None
        self._speaking = ""
        self._from = self._until = 0
        self._pieces: deque[tuple[int, np.ndarray]] = deque()

    def on_status(self, status: SpeechStatus) -> None:
        """Process the progress of an utterance."""
        if status.state == "started":
            self._speaking, self._from = status.utterance_id, status.stamp
            if self._meter is not None:
                self._meter.begin()
        elif status.utterance_id == self._speaking and status.state in ("finished", "failed", "interrupted"):
            self._speaking, self._until = "", status.stamp + nanoseconds(self.measured_tail_s)
            if self._meter is not None and status.state == "finished":
                self._meter.end(status.stamp)
            if status.state == "interrupted":
                self._cut(status.stamp)

    @property
    def measured_tail_s(self) -> float:
        """Time (s) for which the voice stays in the sound: measured, or ``tail_s`` before the first measurement."""
        measured = None if self._meter is None else self._meter.tail_s
        return self.tail_s if measured is None else measured

    def push(self, begin: int, end: int, samples: np.ndarray) -> None:
        """Measure the tail with a chunk of the microphone's sound, from ``begin`` to ``end`` (ns)."""
        if self._meter is not None:
            self._meter.push(begin, end, samples, is_heard=self.is_heard(begin))

    def on_sound(self, sound: AudioData) -> None:
        """Add a sound that the robot plays from its stamp on."""
        self._forget(sound.stamp - nanoseconds(_LATEST_S))
        samples = samples_of(sound)
        converter = Converter(sound.sample_rate, sound.channels)
        self._pieces.append((sound.stamp, converter.push(samples)))
        # Sounds follow one another, so more than this is left only if stamps repeat or the clock was set back.
        while sum(piece.size for _, piece in islice(self._pieces, 1, len(self._pieces) - 1)) > _LATEST_S * RATE_HZ:
            self._pieces.popleft()

    def is_heard(self, time: int) -> bool:
        """Whether the robot's voice may be in the sound at ``time`` (ns)."""
        return (bool(self._speaking) and time >= self._from) or time < self._until

    @property
    def known(self) -> bool:
        """Whether the sound that the robot plays is known."""
        return bool(self._pieces)

    def played(self, time: int, count: int) -> np.ndarray | None:
        """The ``count`` samples that the robot plays from ``time`` (ns) on; None if it has been silent for a while."""
        self._forget(time - nanoseconds(_MEMORY_S))
        if not self._pieces:
            return None
        played = np.zeros(count, np.int16)
        for start, samples in self._pieces:
            at = round((start - time) * RATE_HZ / SECOND)
            first, last = max(0, at), min(count, at + samples.size)
            if first < last:
                played[first:last] = samples[first - at : last - at]
        return played

    def _forget(self, time: int) -> None:
        """Remove the pieces that ended before ``time`` (ns)."""
        while self._pieces and self._end(self._pieces[0]) < time:
            self._pieces.popleft()

    def _cut(self, time: int) -> None:
        """Remove the sound after ``time`` (ns)."""
        self._pieces = deque(
            (start, samples[: max(0, round((time - start) * RATE_HZ / SECOND))])
            for start, samples in self._pieces
            if start < time
        )

    @staticmethod
    def _end(piece: tuple[int, np.ndarray]) -> int:
        return piece[0] + piece[1].size * SECOND // RATE_HZ


class EchoCanceller:
    """Remover of the robot's own voice from the sound of a microphone.

    A Kalman filter in the frequency domain estimates the way from the loudspeaker to the microphone, `_REACH_S` long.
    It adapts little while a person speaks, because much is left of the sound then. After two to
    three seconds of the robot's speech it removes about 15 dB in simulated rooms.
    """

    def __init__(self) -> None:
        parts = round(_REACH_S * RATE_HZ / FRAME)
        self._path = np.zeros((parts, FRAME + 1), np.complex128)
        age = np.arange(parts) * FRAME / RATE_HZ
        self._variance = np.tile(_VARIANCE * np.exp(-_DECAY_PER_S * age)[:, None], FRAME + 1)
        self._spectra = np.zeros((parts, FRAME + 1), np.complex128)
        self._rest = np.zeros(FRAME + 1)
        self._last = np.zeros(FRAME)
        self._is_paused = False
        self._meter = RestMeter()

    def process(self, samples: np.ndarray, played: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Remove ``played`` from ``samples``: int16, a multiple of `FRAME`.

        Returns:
            The samples without echo, and for each of their frames how much more is left than of an echo (dB).
        """
        frames = np.stack([samples, played], axis=1).reshape(-1, FRAME, 2) / 32768
        steps = [self._step(frame[:, 0], frame[:, 1]) for frame in frames]
        clean = np.concatenate([each for each, _ in steps])
        return np.clip(np.rint(clean * 32768), -32768, 32767).astype(np.int16), np.array([rest for _, rest in steps])

    def _step(self, recorded: np.ndarray, played: np.ndarray) -> tuple[np.ndarray, float]:
        spectra = self._spectra = np.roll(self._spectra, 1, axis=0)
        spectra[0] = np.fft.rfft(np.concatenate([self._last, played]))
        self._last = played
        power = spectra.real**2 + spectra.imag**2
        if not power.any():
            self._is_paused = True
            return recorded, NO_ECHO_DB
        if self._is_paused:  # The delay of each utterance differs a little, so nothing of the path is certain.
            self._is_paused = False
            self._variance = self._variance + np.abs(self._path) ** 2
        clean, error = self._without_echo(recorded)
        expected, left = (self._variance * power).sum(axis=0), np.abs(error) ** 2
        self._rest = _REST_KEPT * self._rest + (1 - _REST_KEPT) * left
        gain = self._variance / (expected + 2 * self._rest + 1e-10)
        for update in range(_UPDATES):
            if update:
                _, error = self._without_echo(recorded)
            step = np.fft.irfft(gain * spectra.conj() * error, axis=1)
            step[:, FRAME:] = 0
            self._path += np.fft.rfft(step, axis=1)
        kept = (1 - 0.5 * gain * power) * self._variance
        self._variance = _PATH_KEPT**2 * kept + (1 - _PATH_KEPT**2) * np.abs(self._path) ** 2
        return clean, self._meter.push(left, expected)

    def _without_echo(self, recorded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a frame without the echo by the present path, and the spectrum of what is left."""
        clean = recorded - np.fft.irfft((self._path * self._spectra).sum(axis=0))[FRAME:]
        return clean, np.fft.rfft(np.concatenate([np.zeros(FRAME), clean]))


class RestMeter:
    """Meter of how much more is left of the sound than the canceller expects to be left of the echo.

    What it expects is wrong by a factor that depends on the room and the loudspeaker. So each band has a scale, learnt
    from the frames before. A person is louder than that in some bands at least: the robot's voice fills few at a time.
    """

    def __init__(self) -> None:
        bands = _BANDS.size - 1
        self._recent: deque[np.ndarray] = deque(maxlen=_LATER + 1)
        self._sums = np.full((2, bands), 1e-9)
        self._frames = 0

    def push(self, left: np.ndarray, expected: np.ndarray) -> float:
        """Add the power spectra of a frame.

        Returns:
            By how much (dB) at least `_LOUD_BANDS` bands are louder than expected, `NO_ECHO_DB` before that is known.
        """
        both = np.stack([left, expected])[:, : _BANDS[-1]]
        self._recent.append(np.add.reduceat(both, _BANDS[:-1], axis=1))
        self._frames += 1
        is_learnt = self._frames >= _LEARNT_S * RATE_HZ / FRAME
        scale = np.maximum(self._sums[0] / self._sums[1], _LEAST_SCALE)
        if len(self._recent) > _LATER:
            before = self._recent[0]
            counts = before[1] > _LEAST_POWER
            before = np.maximum(before - [[_LEAST_POWER], [0.0]], 0)
            if is_learnt:  # A person is no part of the echo.
                before[0] = np.minimum(before[0], _MOST_OUTLIER * scale * before[1])
            self._sums = np.where(counts, _SCALE_KEPT * self._sums + (1 - _SCALE_KEPT) * before, self._sums)
        if not is_learnt:
            return NO_ECHO_DB
        rest, echo = np.mean(list(islice(self._recent, len(self._recent) - _SMOOTHED, None)), axis=0)
        louder = (rest + _LEAST_POWER) / (scale * echo + _LEAST_POWER)
        return 10 * float(np.log10(np.partition(louder, -_LOUD_BANDS)[-_LOUD_BANDS]))


class BargeInDetector:
    """Detector of a person who speaks while the robot speaks.

    A chunk counts if it is speech without the echo, too, and more is left of it than of an echo.
    """

    def __init__(self) -> None:
        self._recent: deque[bool] = deque(maxlen=_WINDOW_CHUNKS)

    def push(self, rest_db: float, probability: float) -> bool:
        """Add a chunk by how much more is left of it than of an echo, and its probability of speech.

        Returns:
            Whether a person speaks.
        """
        self._recent.append(probability >= _SPEECH_PROBABILITY and rest_db >= _REST_DB)
        return sum(self._recent) >= _SPOKEN_CHUNKS

    def reset(self) -> None:
        """Forget the chunks before."""
        self._recent.clear()
