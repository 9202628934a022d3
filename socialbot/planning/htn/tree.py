"""Task trees: how each task was decomposed and what became of it; and the result of planning."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from socialbot.planning.htn.domain import Item, item_text

TaskStatus = Literal["planned", "done", "failed"]

_MARKS = {None: "", "planned": "", "done": "+ ", "failed": "! "}


@dataclass(frozen=True, slots=True)
class TaskNode:
    """A task, with the method that does it and the nodes that this leads to; or an action, with its status.

    ``former`` are nodes of ways that were given up: what was done of them, and what failed. An action has some if no
    task is above it, and it is tried once more.
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
    """The nodes by id, and which of them are the tasks that were asked for. ``next_id`` was never used."""

    nodes: Mapping[int, TaskNode] = field(default_factory=dict)
    roots: tuple[int, ...] = ()
    next_id: int = 1

    @property
    def tasks(self) -> tuple[Item, ...]:
        """What was asked for."""
        return tuple(self.nodes[root].item for root in self.roots)

    @property
    def plan(self) -> tuple[TaskNode, ...]:
        """The actions that are still to be done, in order."""
        return tuple(node for node in self.walk() if node.status == "planned")

    @property
    def history(self) -> tuple[TaskNode, ...]:
        """The actions that were done or failed, in order."""
        return tuple(node for node in self.walk() if node.status in ("done", "failed"))

    def walk(self, *starts: int, former: bool = True) -> Iterator[TaskNode]:
        """The nodes at and below ``starts`` (the roots if there are none), in the order in which they come about."""
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
        """The node and the tasks that it is for, the nearest first."""
        path = [self.nodes[node]]
        while (parent := path[-1].parent) is not None:
            path.append(self.nodes[parent])
        return path

    def later(self, node: TaskNode) -> tuple[int, ...]:
        """The nodes beside ``node`` that come after it."""
        beside = self.roots if node.parent is None else self.nodes[node.parent].children
        return beside[beside.index(node.id) + 1 :]

    def as_data(self) -> dict[str, Any]:
        """The tree as JSON takes it, if it takes the arguments."""
        return {
            "roots": list(self.roots),
            "next_id": self.next_id,
            "nodes": [
                {name: value for name, value in asdict(node).items() if value not in (None, ())} for node in self.walk()
            ],
        }

    @staticmethod
    def from_data(data: Mapping[str, Any]) -> TaskTree:
        """The tree that `as_data` told of; lists among the arguments were tuples. Raises KeyError, TypeError."""
        nodes = (
            TaskNode(**{name: _tuple(value) if isinstance(value, list) else value for name, value in entry.items()})
            for entry in data["nodes"]
        )
        return TaskTree({node.id: node for node in nodes}, tuple(data["roots"]), data["next_id"])

    def __str__(self) -> str:
        """A drawing, a node a line: ``+`` before what was done, ``!`` before what failed, in brackets what is former.

        Behind a task stands its method.
        """
        lines, waiting = [], [(self.nodes[root], 0, False) for root in reversed(self.roots)]
        while waiting:
            node, depth, former = waiting.pop()
            text = f"{_MARKS[node.status]}{node}{f' by {node.method}' if node.method else ''}"
            lines.append(f"{'  ' * depth}{f'({text})' if former else text}  #{node.id}\n")
            below = [(id, True) for id in node.former] + [(id, former) for id in node.children]
            waiting += [(self.nodes[id], depth + 1, gone) for id, gone in reversed(below)]
        return "".join(lines)


def _tuple(value: Any) -> Any:
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


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
    """The domain, or what was asked, is wrong: see `TaskFault`."""


class TaskFault(enum.Enum):
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
    fault: TaskFault | None = None
    redone: int | None = None
    seconds: float = 0.0

    @property
    def plan(self) -> tuple[TaskNode, ...]:
        """The actions to be done, in order, each with the id of its node."""
        return self.tree.plan if self.tree else ()
