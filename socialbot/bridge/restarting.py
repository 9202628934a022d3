"""When what has died is started again, and when it is given up."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class RestartPolicy:
    """How patient a supervisor is.

    What dies after it has lived for longer than ``longest_s`` is started again at once. When it dies sooner it is left
    alone for ``first_s``, and each time that it does so again for twice as long, up to ``longest_s``. What has died
    more than ``times`` times in ``within_s`` is given up. A node is hung, and its process is killed, when it has not
    said for ``hung_s`` that it is well; to get ready it may take ``ready_s``.
    """

    times: int = 5
    within_s: float = 60.0
    first_s: float = 0.2
    longest_s: float = 5.0
    hung_s: float = 10.0
    ready_s: float = 60.0


class Patience:
    """The patience with one process. Times are those of a clock that only goes forward, in s."""

    def __init__(self, policy: RestartPolicy) -> None:
        self._policy = policy
        self._deaths: deque[float] = deque()
        self._started = 0.0
        self._pause_s = 0.0

    def started(self, now: float) -> None:
        """Notes that it was started."""
        self._started = now

    def died(self, now: float) -> float | None:
        """Notes that it died. Returns how long (s) to wait before it is started again; None to give it up."""
        policy = self._policy
        self._deaths.append(now)
        while self._deaths[0] < now - policy.within_s:
            self._deaths.popleft()
        if len(self._deaths) > policy.times:
            return None
        lived_long = now - self._started > policy.longest_s
        self._pause_s = 0.0 if lived_long else min(max(policy.first_s, 2 * self._pause_s), policy.longest_s)
        return self._pause_s


def in_time(pause_s: float) -> str:
    """``pause_s`` in words."""
    return f"in {pause_s:.1f} s" if pause_s else "at once"
