"""A link in simulated time, and what becomes of a camera's pictures that a `ImageLink` gives to it."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.graph.ports import FRESH_S
from socialbot.vision.image_transport import ALIVE_S, ImageLink, relative_size

PACKET = 1400
ASK_S = 0.022
"""How long it takes until a lost packet is asked for; the question and the packet travel besides."""

CAMERA_HZ = 30.0
PICTURE = 24_000
"""Bytes of a picture of quality 80."""


@dataclass(frozen=True)
class Phase:
    """The link from ``begin_s`` on; with 0 Mbit/s it is down."""

    begin_s: float
    mbit_s: float
    loss: float = 0.0
    delay_s: float = 0.004
    jitter_s: float = 0.0


@dataclass
class Trial:
    """A camera of 30 Hz on a link of some phases, for ``until_s``. All times in seconds."""

    phases: list[Phase]
    until_s: float
    detail: Callable[[float], float] = lambda _: 1.0
    taken: list[float] = field(default_factory=list)
    arrived: list[tuple[float, float, int]] = field(default_factory=list)
    """When taken, when arrived, and the quality of each picture."""

    def __post_init__(self) -> None:
        self._now = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._random = random.Random(4)
        self._free = self._latest = 0.0
        self._last_stamp, self._said = -1, -1.0
        self.link = ImageLink(best=80, least=30, most_hz=math.inf, now=0)
        self._at(0.0, self._take)
        self._at(0.0, self._live)
        while self._events and self._events[0][0] < self.until_s:
            self._now, _, call = heapq.heappop(self._events)
            call()

    def hz(self, begin_s: float, end_s: float) -> float:
        """Pictures a second that arrive between two times."""
        return sum(begin_s <= arrived < end_s for _, arrived, _ in self.arrived) / (end_s - begin_s)

    def age_s(self, begin_s: float, end_s: float, percent: float = 99) -> float:
        """Return a percentile of the age at arrival of the images taken between two times."""
        ages = [arrived - taken for taken, arrived, _ in self.arrived if begin_s <= taken < end_s]
        return float(np.percentile(ages, percent))

    def qualities(self, begin_s: float, end_s: float) -> list[int]:
        """The qualities of the pictures that arrive between two times."""
        return [quality for _, arrived, quality in self.arrived if begin_s <= arrived < end_s]

    def _at(self, time: float, call: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time, next(self._order), call))

    def _take(self) -> None:
        self._at(self._now + 1 / CAMERA_HZ, self._take)
        now, quality = round(self._now * SECOND), self.link.quality
        self.taken.append(self._now)
        if self.link.takes(now):
            size = round(PICTURE * relative_size(quality, 80) * self.detail(self._now))
            self.link.sent(now, size, now)
            self._carry(size, lambda taken=self._now: self._arrive(taken, quality))

    def _arrive(self, taken: float, quality: int) -> None:
        self.arrived.append((taken, self._now, quality))
        self._last_stamp = round(taken * SECOND)
        self._answer()

    def _live(self) -> None:
        self._at(self._now + ALIVE_S, self._live)
        if self._now - self._said >= ALIVE_S:
            self._answer()

    def _answer(self) -> None:
        self._said = self._now
        stamp, (up, phase) = self._last_stamp, self._next()
        self._at(up + self._way_s(phase), lambda: self.link.answered(stamp, round(self._now * SECOND)))

    def _carry(self, size: int, then: Callable[[], None]) -> None:
        """Deliver all packets in order: lost packets are resent, and later ones wait. Late images are given up."""
        up, phase = self._next()
        if max(up, self._free) - self._now > FRESH_S:
            return
        repairs = max(self._repairs(phase.loss) for _ in range(-(-size // PACKET)))
        self._free = max(up, self._free) + 8e-6 * size / phase.mbit_s
        way_s = max(self._way_s(phase) for _ in range(-(-size // PACKET)))
        self._latest = max(self._latest, self._free + repairs * (ASK_S + 2 * phase.delay_s) + way_s)
        if self._latest - self._now <= FRESH_S + 2 * phase.delay_s:
            self._at(self._latest, then)

    def _way_s(self, phase: Phase) -> float:
        return phase.delay_s + self._random.uniform(-phase.jitter_s, phase.jitter_s)

    def _repairs(self, loss: float) -> int:
        return next(count for count in itertools.count() if self._random.random() >= loss)

    def _next(self) -> tuple[float, Phase]:
        """Return the time of the next transmission, and the link state then."""
        up = [phase for phase in self.phases if phase.mbit_s]
        now = [phase for phase in self.phases if phase.begin_s <= self._now][-1]
        if now in up:
            return self._now, now
        coming = next(phase for phase in up if phase.begin_s > self._now)
        return coming.begin_s, coming
