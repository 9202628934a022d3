"""Task trees with decompositions and results of actions, and the answer of the task planner."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from socialbot.planning.htn.domain import Item, item_text

TaskStatus = Literal["planned", "done", "failed"]

_MARKS = {None: "", "planned": "", "done": "+ ", "failed": "! "}


@dataclass(frozen=True, slots=True)
class TaskNode:
    """Node of a task tree: a task with its method and children, or an action with its status.

    ``former`` are nodes of abandoned decompositions with executed or failed actions. An action without a parent has
    them if it is repeated.
    """

    id: int
    item: Item
    parent: int | None = None
    method: str | None = None
    children: tuple[int, ...] = ()
    former: tuple[int, ...] = ()
    status: TaskStatus | None = None

    def __str__(self) -> str:
        return item_text(self.item)


@dataclass(frozen=True)
class TaskTree:
    """Tree of tasks by node id. The roots are the requested tasks; ``next_id`` is unused."""

    nodes: Mapping[int, TaskNode] = field(default_factory=dict)
    roots: tuple[int, ...] = ()
    next_id: int = 1

    @property
    def tasks(self) -> tuple[Item, ...]:
        return tuple(self.nodes[root].item for root in self.roots)

    @property
    def plan(self) -> tuple[TaskNode, ...]:
        """Remaining actions in order."""
        return tuple(node for node in self.walk() if node.status == "planned")

    @property
    def history(self) -> tuple[TaskNode, ...]:
        """Executed and failed actions in order."""
        return tuple(node for node in self.walk() if node.status in ("done", "failed"))

    def walk(self, *starts: int, former: bool = True) -> Iterator[TaskNode]:
        """Yield the nodes at and below ``starts`` (default: the roots) in the order of execution."""
        waiting = list(reversed(starts or self.roots))
        while waiting:
            node = self.nodes[waiting.pop()]
            if node.status is None:
                yield node
                waiting += reversed(node.former + node.children if former else node.children)
            else:
                if former:
                    yield from (self.nodes[id] for id in node.former)
                yield node

    def path(self, node: int) -> list[TaskNode]:
        """Return a node and its ancestors, the nearest first."""
        path = [self.nodes[node]]
        while (parent := path[-1].parent) is not None:
            path.append(self.nodes[parent])
        return path

    def later(self, node: TaskNode) -> tuple[int, ...]:
        """Return the later siblings of a node."""
        beside = self.roots if node.parent is None else self.nodes[node.parent].children
        return beside[beside.index(node.id) + 1 :]

    def __str__(self) -> str:
        """Return a drawing with a node per line: ``+`` executed, ``!`` failed, parentheses former."""
        lines, waiting = [], [(self.nodes[root], 0, False) for root in reversed(self.roots)]
        while waiting:
            node, depth, former = waiting.pop()
            text = f"{_MARKS[node.status]}{node}{f' by {node.method}' if node.method else ''}"
            lines.append(f"{'  ' * depth}{f'({text})' if former else text}  #{node.id}\n")
            below = [(id, True) for id in node.former] + [(id, former) for id in node.children]
            waiting += [(self.nodes[id], depth + 1, gone) for id, gone in reversed(below)]
        return "".join(lines)


class TaskVerdict(enum.Enum):
    """Result of task planning."""

    PLAN = "plan"
    """There is a plan, which may be empty."""
    IMPOSSIBLE = "impossible"
    """The search is complete: no plan exists."""
    TIMEOUT = "timeout"
    """No plan was found within the limits; there may be one."""
    CANCELLED = "cancelled"
    """The caller has cancelled the call."""
    ERROR = "error"
    """The domain or the request is wrong, see `TaskFault`."""


class TaskFault(enum.Enum):
    """Kind of error in a domain or a request."""

    UNKNOWN = "unknown"
    """Unknown action, task or node."""
    ARITY = "arity"
    """Wrong number of arguments."""
    RAISED = "raised"
    """An action or method raised an exception."""
    MALFORMED = "malformed"
    """An action did not return a state, or a method a list of tasks."""


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """Limits of task planning: processor time (s), and attempts of actions and methods, which bound the memory."""

    timeout_s: float = 5.0
    steps: int = 1_000_000


@dataclass(frozen=True, slots=True)
class TaskAnswer:
    """Answer of the task planner: the tree, or the reason for its absence, and the elapsed seconds.

    ``redone`` is the task with a new decomposition after a repair.
    """

    verdict: TaskVerdict
    tree: TaskTree | None = None
    message: str = ""
    fault: TaskFault | None = None
    redone: int | None = None
    seconds: float = 0.0

    @property
    def plan(self) -> tuple[TaskNode, ...]:
        """Remaining actions in order, each with its node id."""
        return self.tree.plan if self.tree else ()
