"""Hospital missions on ROS in real time, with one process per node and a breakdown of the time.

All processes share one clock. Concurrent activities count once, in the order acting, planning, reasoning. Communication
lasts from publication until the receiver handles the message. The rest of a mission is overhead of the ward, which ends
actions slightly late.
"""

from __future__ import annotations

import functools
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from evaluation.hospital_record import Configuration, MissionRecord, Share
from evaluation.hospital_runs import LIMIT_S, graph_for, is_drawn
from socialbot.agents.hospital.demo import WORLD
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.robot_node import Nurse, Spot, Uvd
from socialbot.agents.hospital.scripted import ScriptedCoordinator, ScriptedNurse, ScriptedSpot, ScriptedUvd
from socialbot.agents.hospital.ward.messages import COMMANDS, MESSAGES, MISSIONS, RESULTS, STATE, WardState
from socialbot.agents.hospital.ward.ward import paper_ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.agents.teams.messages import (
    COORDINATOR,
    AclMessage,
    ActionCommand,
    ActionResult,
    Missions,
    MissionView,
    Problem,
)
from socialbot.bridge.graph_observer import LatestStatistics, expect_free_names, observe_graph
from socialbot.core.clock import SECOND, Clock, nanoseconds
from socialbot.core.errors import NodeError
from socialbot.core.messages import Message
from socialbot.graph.node import Context, Graph, Node, Timer
from socialbot.graph.ports import Output, Parameter
from socialbot.runtime.launch import Launch

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


TOPICS: Mapping[str, type[Message]] = {
    MESSAGES: AclMessage,
    MISSIONS: Missions,
    COMMANDS: ActionCommand,
    RESULTS: ActionResult,
    STATE: WardState,
}
START_S = 30.0
"""Limit (s) for the start of the processes."""
LOOK_S = 0.02

Span = tuple[int, int]
"""Begin and end, ns."""


def run_ros(configuration: Configuration, rate: float, seed: int, folder: Path) -> MissionRecord:
    """Run one mission with processes in the current ROS domain; ``folder`` takes their logs and notes.

    Raises:
        NodeError: A process fails, or nodes with these names are already running.
    """
    graph = noting(graph_for(configuration, rate, seed), folder)
    seen = Seen()
    seen.watch(graph, folder)
    notes = read_notes(graph, folder)
    start = notes[WORLD].begun
    end = seen.ended or start + nanoseconds(LIMIT_S)
    account = Account(notes, seen)
    view = seen.view
    return MissionRecord(
        configuration=configuration,
        rate=rate,
        seed=seed,
        runner="ros",
        drawn=is_drawn(rate, seed),
        met=any(isinstance(message.content, Problem) for message in seen.said),
        completed=view is not None and view.status == "finished" and seen.is_disinfected(view.target),
        recoveries=view.recoveries if view else 0,
        plans=max((work.plans for work in notes[COORDINATOR].works), default=0),
        actions=sum(action.status != "planned" for action in view.actions) if view else 0,
        mission_s=(end - start) / SECOND,
        wall_s=seen.wall_s,
        share=account.share(start, end),
        recovered=tuple(account.recoveries()),
    )


@dataclass
class Seen:
    """Observations of a mission."""

    said: list[AclMessage] = field(default_factory=list)
    commands: list[ActionCommand] = field(default_factory=list)
    results: list[ActionResult] = field(default_factory=list)
    view: MissionView | None = None
    ended: int = 0
    """End of the mission reported by the coordinator, ns; 0 before."""
    ward: WardState | None = None
    wall_s: float = 0.0

    def watch(self, graph: Graph, folder: Path) -> None:
        with observe_graph(TOPICS, self.note, LatestStatistics(graph).note) as onlooker:
            expect_free_names(onlooker.ros, graph)
            begun = time.monotonic()
            with Launch(graph, folder) as launch:
                while not self._is_over() and time.monotonic() < begun + START_S + LIMIT_S:
                    launch.check()
                    time.sleep(LOOK_S)
            self.wall_s = time.monotonic() - begun

    def note(self, topic: str, message: Message) -> None:
        match message:
            case AclMessage():
                self.said.append(message)
            case ActionCommand():
                self.commands.append(message)
            case ActionResult():
                self.results.append(message)
            case WardState():
                self.ward = message
            case Missions(missions=(view, *_)) if not self.ended:
                self.view = view
                if view.status in ("finished", "failed"):
                    self.ended = message.stamp
            case _:
                pass

    def is_disinfected(self, room: str) -> bool:
        state = self.ward.room(room) if self.ward else None
        return state is not None and state.disinfected

    def _is_over(self) -> bool:
        return self.ended > 0 and self.ward is not None and self.ward.stamp >= self.ended


class Account:
    """Time breakdown of a mission from the notes of its nodes and observations."""

    def __init__(self, notes: Mapping[str, Notes], seen: Seen) -> None:
        self._notes = notes
        self._seen = seen
        planning, other = _told_apart(notes[COORDINATOR].works)
        agents = [notes[name].works for name in notes if name not in (COORDINATOR, WORLD)]
        self._acting = union([*self._waiting(), *self._deeds()])
        self._planning = union(planning)
        self._reasoning = union([*other, *((work.begun, work.ended) for works in agents for work in works)])
        self._communication = union(self._ways())

    def share(self, begin: int, end: int) -> Share:
        return self._share(begin, end, self._communication)

    def recoveries(self) -> Iterator[Share]:
        """Yield the time shares of each recovery; idle time counts as communication."""
        planned = [begin for begin, _ in _told_apart(self._notes[COORDINATOR].works)[0]]
        taken = {work.taken: work.begun for work in self._notes[WORLD].works}
        arrivals = sorted(taken[name_of(command)] for command in self._seen.commands if name_of(command) in taken)
        until = 0
        for failed in self._failures():
            plan = next((begin for begin in planned if begin > failed), None)
            command = next((arrival for arrival in arrivals if plan is not None and arrival > plan), None)
            if command is not None and failed >= until:
                yield self._share(failed, command, [(failed, command)])
                until = command

    def _share(self, begin: int, end: int, communication: Iterable[Span]) -> Share:
        left: list[Span] = [(begin, end)]
        found: list[float] = []
        for spans in (self._acting, self._planning, self._reasoning, communication):
            rest = without(left, spans)
            found.append((length(left) - length(rest)) / SECOND)
            left = rest
        acting_s, planning_s, reasoning_s, communication_s = found
        return Share(reasoning_s, planning_s, communication_s, acting_s)

    def _waiting(self) -> Iterator[Span]:
        """Yield the time until a nurse notices the first room that needs disinfection."""
        begun = self._notes[WORLD].begun
        yield begun, begun + nanoseconds(min(time_s for time_s, _ in paper_ward().infections))

    def _deeds(self) -> Iterator[Span]:
        """Yield the interval of each action; a joint one begins with its last partner."""
        together: dict[tuple[str, tuple[str, ...], int], list[int]] = defaultdict(list)
        for result in self._seen.results:
            begin = result.stamp - nanoseconds(result.duration_s)
            together[result.action, result.args, result.stamp].append(begin)
        for (_, _, end), begins in together.items():
            yield max(begins), end

    def _failures(self) -> list[int]:
        told = {said.message: said.time for said in self._notes[WORLD].said}
        failed = [name_of(result) for result in self._seen.results if result.outcome == "failure"]
        if strange := set(failed) - told.keys():
            raise NodeError(
                f"results without a message of the ward: {', '.join(sorted(strange))}",
                where="ROS domain",
                remedy="set ROS_DOMAIN_ID to a number that no other hospital uses",
            )
        return sorted(told[result] for result in failed)

    def _ways(self) -> Iterator[Span]:
        """Yield the transit time of each message to its receiver."""
        receivers = {name_of(message): (message.receiver,) for message in self._seen.said}
        receivers |= {name_of(result): (result.robot,) for result in self._seen.results}
        begun = {(node, work.taken): work.begun for node, notes in self._notes.items() for work in notes.works}
        everybody = (COORDINATOR, WORLD)
        for notes in self._notes.values():
            for said in notes.said:
                for node in receivers.get(said.message, everybody):
                    arrival = begun.get((node, said.message))
                    if arrival is not None:
                        yield said.time, arrival


def _told_apart(works: Iterable[Work]) -> tuple[list[Span], list[Span]]:
    """Return the planning intervals of a coordinator, and the others."""
    planning: list[Span] = []
    other: list[Span] = []
    plans = 0
    for work in works:
        (planning if work.plans > plans else other).append((work.begun, work.ended))
        plans = work.plans
    return planning, other


def union(spans: Iterable[Span]) -> list[Span]:
    """Return the union as disjoint spans in order."""
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        elif begin < end:
            found.append((begin, end))
    return found


def without(spans: Iterable[Span], taken: Iterable[Span]) -> list[Span]:
    """Return ``spans`` without ``taken``; both must be disjoint and in order."""
    taken = list(taken)
    return [left for span in spans for left in functools.reduce(_cut, taken, [span])]


def _cut(spans: list[Span], taken: Span) -> list[Span]:
    begin, end = taken
    parts = (part for span in spans for part in ((span[0], min(span[1], begin)), (max(span[0], end), span[1])))
    return [(first, last) for first, last in parts if first < last]


def length(spans: Iterable[Span]) -> int:
    """Return the total length, ns."""
    return sum(end - begin for begin, end in spans)
