"""Hospital nodes that log their working times and published messages.

Notes stay in memory until the node stops, to minimize overhead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from socialbot.agents.hospital.coordinator import HospitalCoordinator
from socialbot.agents.hospital.robot_node import Nurse, Spot, Uvd
from socialbot.agents.hospital.scripted import ScriptedCoordinator, ScriptedNurse, ScriptedSpot, ScriptedUvd
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.core.clock import Clock
from socialbot.core.errors import NodeError
from socialbot.core.messages import Message
from socialbot.graph.node import Context, Graph, Node, Timer
from socialbot.graph.ports import Output, Parameter

R = TypeVar("R")

HANDLERS = ("on_heard", "on_state", "on_result", "on_command", "on_cancel")
"""Message handlers of the nodes."""


class Work(msgspec.Struct, frozen=True):
    """Busy interval of a node from ``begun`` to ``ended`` (ns), with its message ``taken``, if any.

    ``plans`` is the total number of plans at the end.
    """

    begun: int
    ended: int
    taken: str
    plans: int


class Said(msgspec.Struct, frozen=True):
    """Publication at a ``time`` (ns)."""

    time: int
    message: str


class Notes(msgspec.Struct):
    """Notes of a node started at ``begun`` (ns)."""

    begun: int = 0
    works: list[Work] = []
    said: list[Said] = []


def name_of(message: Message) -> str:
    """Return a unique name of a message on its topic: its type with id or stamp."""
    return f"{type(message).__name__} {getattr(message, 'id', message.stamp)}"


class _NotedContext:
    def __init__(self, context: Context, notes: Notes) -> None:
        self._context = context
        self._notes = notes
        self.plans: Callable[[], int] = lambda: 0
        """Number of plans made by the node."""

    @property
    def clock(self) -> Clock:
        return self._context.clock

    def publish(self, port: Output[Any], message: Message) -> None:
        self._notes.said.append(Said(self.clock.now(), name_of(message)))
        self._context.publish(port, message)

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        return self._context.call_at(time, lambda: self.work("", callback))

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._context.call_soon(lambda: self.work("", callback))

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        self._context.run_in_background(work, then)

    def work(self, taken: str, callback: Callable[[], None]) -> None:
        begun = self.clock.now()
        try:
            callback()
        finally:
            self._notes.works.append(Work(begun, self.clock.now(), taken, self.plans()))


class Noting:
    """Mixin for nodes that write notes to their parameter ``notes_file``."""

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self._notes = Notes()
        self._noted = _NotedContext(context, self._notes)
        super().__init__(name, self._noted, parameters)  # type: ignore[call-arg] - that of the node mixed in
        self._noted.plans = self._plans
        for handler in HANDLERS:
            if hasattr(self, handler):
                setattr(self, handler, self._noting(getattr(self, handler)))

    def _noting(self, handle: Callable[[Message], None]) -> Callable[[Message], None]:
        return lambda message: self._noted.work(name_of(message), lambda: handle(message))

    def _plans(self) -> int:
        match self:
            case HospitalCoordinator(planning_s=durations) | ScriptedCoordinator(planning_s=durations):
                return len(durations)
            case _:
                return 0

    def start(self) -> None:
        self._notes.begun = self._noted.clock.now()
        super().start()  # type: ignore[misc]

    def stop(self) -> None:
        super().stop()  # type: ignore[misc]
        Path(str(self.notes_file)).write_bytes(msgspec.json.encode(self._notes))  # type: ignore[attr-defined]


def _with_notes(kind: type[Node]) -> type[Node]:
    file = Parameter("", "the file to write the notes to when the node stops", fixed=True)
    contents = {"__doc__": kind.__doc__, "__module__": __name__, "notes_file": file}
    return type(f"Noting{kind.__name__}", (Noting, kind), contents)


NOTING: Mapping[type[Node], type[Node]] = {
    kind: _with_notes(kind)
    for kind in (
        HospitalWorld, HospitalCoordinator, Spot, Uvd, Nurse,
        ScriptedCoordinator, ScriptedSpot, ScriptedUvd, ScriptedNurse,
    )
}  # fmt: skip
"""Node types with notes, by their original types."""
globals().update({kind.__name__: kind for kind in NOTING.values()})  # for graph files


def noting(graph: Graph, folder: Path) -> Graph:
    """Return a hospital graph whose nodes write notes to ``folder``."""
    return replace(
        graph,
        nodes=tuple(
            replace(
                config,
                type=NOTING[config.type],
                parameters={**config.parameters, "notes_file": str(_file_of(config.name, folder))},
            )
            for config in graph.nodes
        ),
    )


def read_notes(graph: Graph, folder: Path) -> dict[str, Notes]:
    """Return the notes of all nodes by name.

    Raises:
        NodeError: The notes of a node are missing.
    """
    return {config.name: _read(_file_of(config.name, folder), config.name) for config in graph.nodes}


def _read(file: Path, node: str) -> Notes:
    try:
        return msgspec.json.decode(file.read_bytes(), type=Notes)
    except (OSError, msgspec.DecodeError) as error:
        raise NodeError(f"it has left no notes: {error}", where=node, remedy="see its log beside the notes") from error


def _file_of(node: str, folder: Path) -> Path:
    return folder / f"{node}.notes.json"
