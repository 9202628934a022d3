"""When messages of a bag were sent and received, though clocks are off, and jump."""

from __future__ import annotations

import logging

from socialbot.core.clock import SECOND, nanoseconds

log = logging.getLogger("socialbot.bags")

CLOCKS_APART_S = 1.0
LEAP_S = 3600.0
"""A bag in which nothing happens for longer than that was recorded by a clock that was set meanwhile."""


class Receptions:
    """The times of reception of a bag, which is called ``name``.

    Where they leap ahead by more than ``LEAP_S``, time goes on from there as if the clock had not been set.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._offset = 0
        self._last: int | None = None

    def next(self, time: int) -> int:
        """The time (ns) of a message said to be received at ``time``."""
        set_right = time + self._offset
        if self._last is not None and set_right - self._last > nanoseconds(LEAP_S):
            ahead = set_right - self._last
            log.warning("%s: its clock leaps ahead by %.0f s; set right", self._name, ahead / SECOND)
            self._offset -= ahead
            set_right = self._last
        self._last = set_right
        return set_right


class Stamps:
    """The stamps of one topic: those of the headers as long as they are good, on the clock of the reception.

    With ``set_right``, a sender whose clock is off by more than ``CLOCKS_APART_S`` at its first message is set
    right by that much. That is for pictures: latched messages are older when they are received.
    """

    def __init__(self, topic: str, *, set_right: bool) -> None:
        self._topic = topic
        self._set_right = set_right
        self._stamp: int | None = None
        self._offset = 0
        self._time = 0
        self._warned = False

    def next(self, header: int, time: int) -> int:
        """The stamp (ns) of a message with this ``header`` stamp, received at ``time``."""
        last = self._stamp
        if self._set_right and last is None and header > 0 and abs(time - header) > nanoseconds(CLOCKS_APART_S):
            self._offset = time - header
            log.warning("%s: the sender's clock is %.1f s off; set right", self._topic, -self._offset / SECOND)
        if header > 0:
            header += self._offset
        why = self._fault(header, time)
        if why and not self._warned:
            self._warned = True
            log.warning("%s: header stamps %s; the times of reception are used instead", self._topic, why)
        stamp = header if not why else time if last is None else last + max(time - self._time, 0)
        self._stamp, self._time = stamp, time
        return stamp

    def _fault(self, header: int, time: int) -> str:
        """What is wrong with a stamp; empty: nothing."""
        if header <= 0:
            return "are zero"
        if self._stamp is not None and header < self._stamp:
            return "go backwards"
        return "lie in the future" if header - time > nanoseconds(CLOCKS_APART_S) else ""
