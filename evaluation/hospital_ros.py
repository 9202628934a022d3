"""Missions of the hospital's experiments on ROS, each node a process of its own, in real time; and where it went.

All processes read the same clock. What is done in the ward comes first, then planning, then reasoning: a moment in
which there is more than one of them counts as the first. Messages are on their way from when they are published until
their receiver begins with them. What is left of a mission is the ward itself, which ends actions a little late.
"""

from __future__ import annotations

import functools
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evaluation.hospital_noted import Notes, Work, name_of, noting, read_notes
from evaluation.hospital_record import Configuration, MissionRecord, Share
from evaluation.hospital_runs import LIMIT_S, graph_for, is_drawn
from socialbot.agents.hospital.coordinator import MISSIONS
from socialbot.agents.hospital.demo import WORLD
from socialbot.agents.hospital.messages import COORDINATOR, TOPIC, AclMessage, Missions, MissionView, Problem
from socialbot.agents.hospital.ward.messages import COMMANDS, RESULTS, STATE, ActionCommand, ActionResult, WardState
from socialbot.agents.hospital.ward.ward import paper_ward
from socialbot.bridge.graph_observer import LatestStatistics, expect_free_names, observe_graph
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import NodeError
from socialbot.core.messages import Message
from socialbot.graph.node import Graph
from socialbot.runtime.launch import Launch

TOPICS: Mapping[str, type[Message]] = {
    TOPIC: AclMessage,
    MISSIONS: Missions,
    COMMANDS: ActionCommand,
    RESULTS: ActionResult,
    STATE: WardState,
}
START_S = 30.0
"""So long the processes may take to start."""
LOOK_S = 0.02

Span = tuple[int, int]
"""From when until when, ns."""


def run_ros(configuration: Configuration, rate: float, seed: int, folder: Path) -> MissionRecord:
    """Has one mission done by processes in the ROS domain that is set; ``folder`` takes their logs and notes.

    Raises NodeError when a process fails, or nodes of these names run already.
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
        completed=view is not None and view.status == "finished" and seen.is_disinfected(view.room),
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
    """What an onlooker saw of a mission."""

    said: list[AclMessage] = field(default_factory=list)
    commands: list[ActionCommand] = field(default_factory=list)
    results: list[ActionResult] = field(default_factory=list)
    view: MissionView | None = None
    ended: int = 0
    """When the coordinator told that the mission is over, ns; 0: it is not."""
    ward: WardState | None = None
    wall_s: float = 0.0
    """How long there were processes."""

    def watch(self, graph: Graph, folder: Path) -> None:
        """Brings up ``graph`` and looks on until the mission is over, or too long."""
        with observe_graph(TOPICS, self.note, LatestStatistics(graph).note) as onlooker:
            expect_free_names(onlooker.ros, graph)
            begun = time.monotonic()
            with Launch(graph, folder) as launch:
                while not self._is_over() and time.monotonic() < begun + START_S + LIMIT_S:
                    launch.check()
                    time.sleep(LOOK_S)
            self.wall_s = time.monotonic() - begun

    def note(self, topic: str, message: Message) -> None:
        """Takes a message."""
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
        """Whether the ward, when it was last seen, showed that."""
        state = self.ward.room(room) if self.ward else None
        return state is not None and state.disinfected

    def _is_over(self) -> bool:
        return self.ended > 0 and self.ward is not None and self.ward.stamp >= self.ended


class Account:
    """Where the time of a mission went, from the notes of its nodes and what was seen of it."""

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
        """Where the time between two moments (ns) went."""
        return self._share(begin, end, self._communication)

    def recoveries(self) -> Iterator[Share]:
        """Where the time of each recovery went; in one a message is always on its way when nobody does anything."""
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
        """The time until the first room comes to need disinfection, in which a nurse finds that out."""
        begun = self._notes[WORLD].begun
        yield begun, begun + nanoseconds(min(time_s for time_s, _ in paper_ward().infections))

    def _deeds(self) -> Iterator[Span]:
        """When each action was done; a joint one begins when the last partner is there."""
        together: dict[tuple[str, tuple[str, ...], int], list[int]] = defaultdict(list)
        for result in self._seen.results:
            begin = result.stamp - nanoseconds(result.duration_s)
            together[result.action, result.args, result.stamp].append(begin)
        for (_, _, end), begins in together.items():
            yield max(begins), end

    def _failures(self) -> list[int]:
        """When the ward told that an action had failed."""
        told = {said.message: said.time for said in self._notes[WORLD].said}
        failed = [name_of(result) for result in self._seen.results if result.outcome == "failure"]
        if strange := set(failed) - told.keys():
            raise NodeError(
                f"there are results that this ward did not tell: {', '.join(sorted(strange))}",
                where="ROS domain",
                remedy="set ROS_DOMAIN_ID to a number that no other hospital uses",
            )
        return sorted(told[result] for result in failed)

    def _ways(self) -> Iterator[Span]:
        """When each message was on its way to who it is for."""
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
    """When a coordinator planned, and when it did something else."""
    planning: list[Span] = []
    other: list[Span] = []
    plans = 0
    for work in works:
        (planning if work.plans > plans else other).append((work.begun, work.ended))
        plans = work.plans
    return planning, other


def union(spans: Iterable[Span]) -> list[Span]:
    """The same time in spans apart from each other, in their order."""
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        elif begin < end:
            found.append((begin, end))
    return found


def without(spans: Iterable[Span], taken: Iterable[Span]) -> list[Span]:
    """The time of ``spans`` that is not ``taken``; both are in order and apart."""
    taken = list(taken)
    return [left for span in spans for left in functools.reduce(_cut, taken, [span])]


def _cut(spans: list[Span], taken: Span) -> list[Span]:
    begin, end = taken
    parts = (part for span in spans for part in ((span[0], min(span[1], begin)), (max(span[0], end), span[1])))
    return [(first, last) for first, last in parts if first < last]


def length(spans: Iterable[Span]) -> int:
    """How long all are, ns."""
    return sum(end - begin for begin, end in spans)
