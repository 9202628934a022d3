"""What a planner is: problem in, plan or the reason why there is none out."""

from __future__ import annotations

import enum
import threading
from dataclasses import dataclass
from typing import Protocol

from socialbot.planning.domain import Domain, Problem
from socialbot.planning.plan import Plan


class Verdict(enum.Enum):
    """What came of planning."""

    SOLVED = "solved"
    """There is a plan, and it was validated."""
    IMPOSSIBLE = "impossible"
    """It is proved that there is no plan."""
    GAVE_UP = "gave up"
    """No plan was found within the limits of time and memory; there may be one."""
    INVALID = "invalid"
    """The planner made a plan that does not do what is asked for."""
    REFUSED = "refused"
    """The problem cannot be asked: it has no goal, an unknown object, a predicate that the domain does not have."""
    FAILED = "failed"
    """The planner died, or said something that makes no sense."""
    CANCELLED = "cancelled"
    """Nobody wants to know any more."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How much a planner may use. ``makespan_s`` is how long the plan may last; longer ones are no use.

    ``timeout_s`` is how long it may work, all threads together, or sleep. While others have the processor no time
    passes, so that the same problem gets the same answer however busy the machine is.
    """

    timeout_s: float = 5.0
    memory_mb: int = 512
    threads: int = 1
    makespan_s: float | None = None


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of planning: the plan if it is `Verdict.SOLVED`, else why not, and the seconds it took."""

    verdict: Verdict
    plan: Plan | None = None
    message: str = ""
    seconds: float = 0.0


class Planner(Protocol):
    """Finds plans. Every plan it returns has been validated; it raises nothing: what goes wrong is in the answer."""

    name: str

    def solve(
        self, domain: Domain, problem: Problem, limits: Limits, cancelled: threading.Event | None = None
    ) -> Answer:
        """Blocks until there is an answer; setting ``cancelled`` (from another thread) ends that within 0.1 s."""
        ...
