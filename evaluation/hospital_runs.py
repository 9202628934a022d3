"""Hospital missions in simulated time: graphs and results.

Only actions take simulated time. Reasoning and planning are measured as processor time of the nodes in sequence.
Communication is the overhead of the runner, which delivers messages in one thread without a codec.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from evaluation.hospital_record import Configuration, MissionRecord, Share
from socialbot.agents.hospital.demo import WORLD, hospital
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.scripted import ScriptedCoordinator, scripted
from socialbot.agents.hospital.ward.messages import COMMANDS, MESSAGES, MISSIONS, RESULTS
from socialbot.agents.hospital.ward.ward import drawn_problems, paper_ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.agents.teams.messages import COORDINATOR, AclMessage, ActionResult, Missions, MissionView, Problem
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

NOISE = 0.02
"""Maximum relative deviation of durations, drawn by seed to imitate real ones."""
LIMIT_S = 60.0
"""Time limit of a mission, after which it counts as not completed."""
CHECK_S = 0.2


def graph_for(configuration: Configuration, rate: float, seed: int) -> Graph:
    """Return the paper's ward in one configuration; its coordinator knows rooms only from agents' reports."""
    recovers = configuration == "bdi+recovery"
    coordinator = {"policy": "auto" if recovers else "none", "proactive": False}
    graph = hospital(rate=rate, seed=seed, world={"noise": NOISE}, coordinator=coordinator)
    if configuration == "plain":
        return scripted(graph)
    agents = [member.name for member in paper_ward().members]
    return graph.with_parameters({agent: {"recovers": recovers} for agent in agents})


def is_drawn(rate: float, seed: int) -> bool:
    """Return whether a problem is drawn for the mission."""
    return bool(drawn_problems(paper_ward(), seed, rate))


def play(configuration: Configuration, rate: float, seed: int) -> MissionRecord:
    """Run one mission to its end, or for `LIMIT_S` of simulated time."""
    return Run(configuration, rate, seed).play()


@dataclass(frozen=True, slots=True)
class Moment:
    """Processor time (s) at some point, and the part used by nodes (s)."""

    time_s: float = 0.0
    reasoning_s: float = 0.0
    planning_s: float = 0.0
    world_s: float = 0.0

    def until(self, later: Moment, acting_s: float) -> Share:
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
    """Inline runner that measures the processor time of its nodes.

    A turn of the coordinator that makes a plan counts as planning, including its translation and sending.
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
        return Moment(time.thread_time(), self.reasoning_s, self.planning_s, self.world_s)

    @property
    def plans(self) -> int:
        match self.nodes[COORDINATOR]:
            case HospitalCoordinator(planning_s=durations) | ScriptedCoordinator(planning_s=durations):
                return len(durations)
            case _:
                return 0


@dataclass(frozen=True, slots=True)
class _Failure:
    """Failed action with the number of plans until then; ``at`` is simulated time (ns)."""

    moment: Moment
    at: int
    plans: int


class Run:
    """Running mission."""

    def __init__(self, configuration: Configuration, rate: float, seed: int) -> None:
        self._begun_s = time.perf_counter()
        self.configuration: Configuration = configuration
        self.rate = rate
        self.seed = seed
        self.runner = TimedRunner(graph_for(configuration, rate, seed))
        self.view: MissionView | None = None
        """Last published state of the mission."""
        self.ended: tuple[int, Moment] | None = None
        self._met = False
        self._failure: _Failure | None = None
        self._recovered: list[Share] = []
        self.runner.tap(MISSIONS, self._on_missions)
        self.runner.tap(MESSAGES, self._on_said)
        self.runner.tap(RESULTS, self._on_result)
        self.runner.tap(COMMANDS, self._on_command)

    def play(self) -> MissionRecord:
        """Run the mission to its end.

        Raises:
            RuntimeError: A node raised an exception.
        """
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
            completed=view is not None and view.status == "finished" and self._is_disinfected(view.target),
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
        return node.world.rooms[room].disinfected

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
