"""What comes of planning tasks, and how much it may take."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from socialbot.tasks.tree import Node, TaskTree


class TaskVerdict(enum.Enum):
    """What came of planning."""

    PLAN = "plan"
    """There is a plan; it may be empty."""
    IMPOSSIBLE = "impossible"
    """Everything was tried: there is no plan."""
    TIMEOUT = "timeout"
    """No plan was found within the limits; there may be one."""
    CANCELLED = "cancelled"
    """Nobody wants to know any more."""
    ERROR = "error"
    """The domain, or what was asked, is wrong: see `Fault`."""


class Fault(enum.Enum):
    """What is wrong with a domain, or with what was asked."""

    UNKNOWN = "unknown"
    """There is no action, task or node like that."""
    ARITY = "arity"
    """It takes another number of arguments."""
    RAISED = "raised"
    """An action or method raised an exception."""
    MALFORMED = "malformed"
    """An action returned no state, or a method no list of tasks."""


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """How much planning may use: seconds of work, and attempts of actions and methods, which bound the memory."""

    timeout_s: float = 5.0
    steps: int = 1_000_000


@dataclass(frozen=True, slots=True)
class TaskAnswer:
    """What came of planning: the tree if it is `TaskVerdict.PLAN`, else why not; and the seconds it took.

    ``redone`` is the task that was done in another way, when a tree was re-entered and that was necessary.
    """

    verdict: TaskVerdict
    tree: TaskTree | None = None
    message: str = ""
    fault: Fault | None = None
    redone: int | None = None
    seconds: float = 0.0

    @property
    def plan(self) -> tuple[Node, ...]:
        """The actions to be done, in order, each with the id of its node."""
        return self.tree.plan if self.tree else ()
