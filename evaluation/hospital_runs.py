"""Missions of the hospital's experiments in simulated time: their graphs, and what came of each.

What takes simulated time is acting alone. Thinking and planning take none of it, and are measured as the processor time
of the nodes, all of them one after the other; communication is that of the runner, which hands messages on in one
thread and without a codec.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from evaluation.hospital_record import Configuration, MissionRecord, Share
from socialbot.agents.hospital.coordinator import MISSIONS, HospitalCoordinator
from socialbot.agents.hospital.demo import WORLD, hospital
from socialbot.agents.hospital.messages import COORDINATOR, TOPIC, AclMessage, Missions, MissionView, Problem
from socialbot.agents.hospital.scripted import ScriptedCoordinator, scripted
from socialbot.agents.hospital.ward.messages import COMMANDS, RESULTS, ActionResult
from socialbot.agents.hospital.ward.ward import drawn_problems, paper_ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

NOISE = 0.02
"""By how much durations differ at most from what they should be, by the seed: real ones are never quite the same."""
LIMIT_S = 60.0
"""A mission that goes on for longer is not completed."""
CHECK_S = 0.2


def graph_for(configuration: Configuration, rate: float, seed: int) -> Graph:
    """The paper's ward in one configuration. Its coordinator reacts: it knows of rooms only what agents tell."""
    recovers = configuration == "bdi+recovery"
    coordinator = {"policy": "auto" if recovers else "none", "proactive": False}
    graph = hospital(rate=rate, seed=seed, world={"noise": NOISE}, coordinator=coordinator)
    if configuration == "plain":
        return scripted(graph)
    agents = [member.name for member in paper_ward().members]
    return graph.with_parameters({agent: {"recovers": recovers} for agent in agents})


def is_drawn(rate: float, seed: int) -> bool:
    """Whether chance puts a problem in the way of the mission."""
    return bool(drawn_problems(paper_ward(), seed, rate))


def play(configuration: Configuration, rate: float, seed: int) -> MissionRecord:
    """Plays one mission to its end, or for `LIMIT_S` of simulated time."""
    return Run(configuration, rate, seed).play()


def hush() -> None:
    """What goes wrong on purpose is no news."""
    logging.disable(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Moment:
    """The processor time (s) at a moment, and how much of it nodes had used until then (s)."""

    time_s: float = 0.0
    reasoning_s: float = 0.0
    planning_s: float = 0.0
    world_s: float = 0.0

    def until(self, later: Moment, acting_s: float) -> Share:
        """Where the time between two moments went."""
        reasoning_s = later.reasoning_s - self.reasoning_s
        planning_s = later.planning_s - self.planning_s
        computed_s = reasoning_s + planning_s + later.world_s - self.world_s
        return Share(
            reasoning_s=reasoning_s,
            planning_s=planning_s,
            communication_s=max(later.time_s - self.time_s - computed_s, 0.0),
            acting_s=acting_s,
        )


class TimedRunner(InlineRunner):
    """An inline runner that knows the processor time of its nodes.

    A turn of the coordinator in which it makes a plan is planning: with the plan's translation, and sending it.
    """

    def __init__(self, graph: Graph) -> None:
        self.reasoning_s = self.planning_s = self.world_s = 0.0
        super().__init__(graph)

    def attempt(self, context: Any, callback: Callable[..., None], *arguments: Any, calls: int = 0) -> None:
        plans, begin = self.plans, time.thread_time()
        super().attempt(context, callback, *arguments, calls=calls)
        seconds = time.thread_time() - begin
        if context.name == WORLD:
            self.world_s += seconds
        elif self.plans > plans:
            self.planning_s += seconds
        else:
            self.reasoning_s += seconds

    def now(self) -> Moment:
        """This moment."""
        return Moment(time.thread_time(), self.reasoning_s, self.planning_s, self.world_s)

    @property
    def plans(self) -> int:
        """How many plans the coordinator has made."""
        match self.nodes[COORDINATOR]:
            case HospitalCoordinator(coordinator=coordinator) | (ScriptedCoordinator() as coordinator):
                return len(coordinator.planning_s)
            case _:
                return 0


@dataclass(frozen=True, slots=True)
class _Failure:
    """When an action failed, and how many plans there had been until then; ``at`` is simulated time (ns)."""

    moment: Moment
    at: int
    plans: int


class Run:
    """One mission as it goes on."""

    def __init__(self, configuration: Configuration, rate: float, seed: int) -> None:
        self._begun_s = time.perf_counter()
        self.configuration: Configuration = configuration
        self.rate = rate
        self.seed = seed
        self.runner = TimedRunner(graph_for(configuration, rate, seed))
        self.view: MissionView | None = None
        """The mission as it was last told of."""
        self.ended: tuple[int, Moment] | None = None
        self._met = False
        self._failure: _Failure | None = None
        self._recovered: list[Share] = []
        self.runner.tap(MISSIONS, self._on_missions)
        self.runner.tap(TOPIC, self._on_said)
        self.runner.tap(RESULTS, self._on_result)
        self.runner.tap(COMMANDS, self._on_command)

    def play(self) -> MissionRecord:
        """Plays it to its end. Raises RuntimeError where a node raised something: then there is nothing to record."""
        runner = self.runner
        begun = runner.now()
        runner.start()
        while self.ended is None and runner.clock.now() < nanoseconds(LIMIT_S):
            runner.advance(runner.clock.now() + nanoseconds(CHECK_S))
        end, moment = self.ended or (runner.clock.now(), runner.now())
        runner.close()
        if failed := {name: faults.first for name, faults in runner.faults.items() if faults.failures}:
            raise RuntimeError(f"{self.configuration}, {self.rate:g} %, seed {self.seed}: {failed}")
        view = self.view
        mission_s = end / SECOND
        return MissionRecord(
            configuration=self.configuration,
            rate=self.rate,
            seed=self.seed,
            runner="inline",
            drawn=is_drawn(self.rate, self.seed),
            met=self._met,
            completed=view is not None and view.status == "finished" and self._is_disinfected(view.room),
            recoveries=view.recoveries if view else 0,
            plans=runner.plans,
            actions=sum(action.status != "planned" for action in view.actions) if view else 0,
            mission_s=mission_s,
            wall_s=time.perf_counter() - self._begun_s,
            share=begun.until(moment, mission_s),
            recovered=tuple(self._recovered),
        )

    def _is_disinfected(self, room: str) -> bool:
        node = self.runner.nodes[WORLD]
        assert isinstance(node, HospitalWorld)
        return node.world.room_state(room).disinfected

    def _on_missions(self, topic: str, message: Message) -> None:
        assert isinstance(message, Missions)
        for view in message.missions:
            if self.ended is None:
                self.view = view
                if view.status in ("finished", "failed"):
                    self.ended = message.stamp, self.runner.now()

    def _on_said(self, topic: str, message: Message) -> None:
        assert isinstance(message, AclMessage)
        self._met = self._met or isinstance(message.content, Problem)

    def _on_result(self, topic: str, message: Message) -> None:
        assert isinstance(message, ActionResult)
        if message.outcome == "failure" and self._failure is None:
            self._failure = _Failure(self.runner.now(), message.stamp, self.runner.plans)

    def _on_command(self, topic: str, message: Message) -> None:
        failure = self._failure
        if failure is not None and self.runner.plans > failure.plans:
            acting_s = (message.stamp - failure.at) / SECOND
            self._recovered.append(failure.moment.until(self.runner.now(), acting_s))
            self._failure = None
