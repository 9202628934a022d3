"""Runs of large wards in simulated time: their variations and results."""

from __future__ import annotations

import itertools
import resource
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from evaluation.hospital_check import violations
from socialbot.agents.hospital.coordinator import HospitalCoordinator
from socialbot.agents.hospital.demo import WORLD, large_hospital
from socialbot.agents.hospital.ward.messages import COMMANDS, MESSAGES, MISSIONS, RESULTS, STATE, WardState
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.agents.teams.messages import (
    COORDINATOR,
    AclMessage,
    ActionCommand,
    ActionResult,
    Missions,
    Plan,
    Problem,
)
from socialbot.agents.teams.missions import Policy
from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

STILL_S = 60.0
"""Time in which nobody acts or moves, while a room waits, after which a run is stuck; no rest or charge lasts so long.
"""
CHECK_S = 1.0


@dataclass(frozen=True)
class Kill:
    """Kill of the coordinator's process at ``time_s`` (s), with a restart ``down_s`` later."""

    time_s: float
    down_s: float

    def __str__(self) -> str:
        return f"{self.time_s:g} killed {self.down_s:g}"


@dataclass(frozen=True)
class Story:
    """Run parameters: size of the ward, random ``seed``, and % of missions with a problem.

    ``faults`` adds faults such as ``7 silent uvdrobot1 5``. ``pause_s`` (s) is the minimum interval of ward states.
    """

    seed: int
    rate: float = 0.0
    rooms: int = 50
    spots: int = 4
    uvds: int = 4
    policy: Policy = "auto"
    proactive: bool = True
    every_s: float = 3.0
    pause_s: float = 0.05
    noise: float = 0.1
    faults: str = ""
    kills: tuple[Kill, ...] = ()
    limit_s: float = 3600.0

    def __str__(self) -> str:
        ward = f"{self.rooms} rooms, {self.spots} and {self.uvds} robots, {self.rate:g} %"
        how = f"{self.policy}, {'looks ahead' if self.proactive else 'reacts'}"
        wrong = "; ".join(filter(None, [self.faults, *map(str, self.kills)]))
        return f"{ward}, {how}, seed {self.seed}" + (f": {wrong}" if wrong else "")

    @property
    def agents(self) -> int:
        return self.rooms + self.spots + self.uvds

    def graph(self, memory_file: Path) -> Graph:
        """Return the graph; a coordinator to be killed keeps its state in ``memory_file``."""
        coordinator = {
            "policy": self.policy,
            "proactive": self.proactive,
            "memory_file": str(memory_file) if self.kills else "",
        }
        world = {"noise": self.noise, "every_s": self.every_s, "pause_s": self.pause_s, "faults": self.faults}
        return large_hospital(
            self.rooms,
            self.spots,
            self.uvds,
            rate=self.rate,
            seed=self.seed,
            world=world,
            coordinator=coordinator,
        )


@dataclass(frozen=True)
class Result:
    """Result of a run.

    ``drawn`` are random faults, ``met`` the reasons of failed actions, ``problems`` those that agents could not repair
    by themselves. ``lost`` are rooms never disinfected, ``stood_still`` marks a stuck run. ``interrupted`` are missions
    running at a kill of the coordinator. ``violations`` come from the independent check, ``failures`` are exceptions of
    nodes. ``planning_s`` is the duration of each planning.
    """

    story: Story
    infections: int
    lost: tuple[str, ...]
    stood_still: bool
    ended_s: float
    drawn: Counter[str]
    met: Counter[str]
    problems: int
    missions: int
    open: int
    recoveries: int
    revisions: int
    interrupted: int
    plans: int
    planning_s: tuple[float, ...]
    said: int
    messages: int
    actions: int
    violations: tuple[str, ...]
    failures: tuple[str, ...]
    processor_s: float
    wall_s: float
    memory_mb: float

    @property
    def share(self) -> float:
        """Share of disinfected rooms among those in need, in %."""
        return 100.0 * (1 - len(self.lost) / max(self.infections, 1))

    @property
    def fine(self) -> bool:
        return not (self.lost or self.open or self.stood_still or self.violations or self.failures)


class Run:
    """Run in progress."""

    def __init__(self, story: Story, folder: Path) -> None:
        self.story = story
        self.commands: list[ActionCommand] = []
        self.results: list[ActionResult] = []
        self.messages: Counter[str] = Counter()
        self.met: Counter[str] = Counter()
        self.problems = 0
        self.plans = 0
        self.finished: dict[int, tuple[int, int]] = {}
        """Finished missions with their recoveries and revisions."""
        self.open = 0
        self.interrupted = 0
        self.planning_s: list[float] = []
        self.done_at = 0
        """Time of the last action or movement (ns)."""
        self._positions: list[object] = []
        graph = story.graph(folder / "memory.json")
        self.runner = InlineRunner(graph)
        taps = {
            **{topic: self._hear for topic, kind in graph.topics().items() if kind is AclMessage},
            STATE: self._see,
            MISSIONS: self._count,
            COMMANDS: self._told,
            RESULTS: self._done,
        }
        for topic, tap in taps.items():
            self.runner.tap(topic, tap)

    @property
    def world(self) -> HospitalWorld:
        node = self.runner.nodes[WORLD]
        assert isinstance(node, HospitalWorld)
        return node

    def play(self) -> Result:
        wall, processor = time.perf_counter(), time.process_time()
        ward = self.world.world.ward
        last_s = max((time_s for time_s, _ in ward.infections), default=0.0)
        kills = [(nanoseconds(kill.time_s), nanoseconds(kill.down_s)) for kill in self.story.kills]
        self.runner.start()
        stood_still = False
        while (now := self.runner.clock.now()) < nanoseconds(self.story.limit_s):
            if kills and now >= kills[0][0]:
                self._kill(kills.pop(0)[1])
                continue
            self.runner.advance(min([now + nanoseconds(CHECK_S), *(time for time, _ in kills[:1])]))
            self._note_movements()
            if now > nanoseconds(last_s) and not kills:
                if not self._infected() and not self.open:
                    break
                stood_still = now - max(self.done_at, nanoseconds(last_s)) > nanoseconds(STILL_S)
                if stood_still:
                    break
        self.planning_s += self.coordinator.planning_s
        return self._result(stood_still, time.process_time() - processor, time.perf_counter() - wall)

    @property
    def coordinator(self) -> HospitalCoordinator:
        """Coordinator that is alive."""
        node = self.runner.nodes[COORDINATOR]
        assert isinstance(node, HospitalCoordinator)
        return node

    def _kill(self, down: int) -> None:
        self.planning_s += self.coordinator.planning_s
        self.interrupted += len(self.coordinator.coordinator.manager.progress_of)
        self.runner.kill(COORDINATOR)
        self.runner.advance(self.runner.clock.now() + down)
        self.runner.restart(COORDINATOR)

    def _note_movements(self) -> None:
        now, world = self.runner.clock.now(), self.world.world
        positions: list[object] = [world.agents[name].at(now) for name in world.ward.robots]
        if positions != self._positions:
            self._positions, self.done_at = positions, now

    def _infected(self) -> list[str]:
        return [name for name, room in self.world.world.rooms.items() if not room.disinfected]

    # Messages

    def _see(self, topic: str, message: Message) -> None:
        assert isinstance(message, WardState)
        self.messages[topic] += 1

    def _hear(self, topic: str, message: Message) -> None:
        assert isinstance(message, AclMessage)
        self.messages[MESSAGES] += 1
        self.plans += isinstance(message.content, Plan)
        self.problems += isinstance(message.content, Problem)

    def _count(self, topic: str, message: Message) -> None:
        assert isinstance(message, Missions)
        self.messages[topic] += 1
        # Finished missions come first.
        over = list(itertools.takewhile(lambda view: view.status in ("finished", "failed"), message.missions))
        self.finished |= {view.id: (view.recoveries, view.revisions) for view in over if view.status == "finished"}
        self.open = len(message.missions) - len(over)

    def _told(self, topic: str, message: Message) -> None:
        assert isinstance(message, ActionCommand)
        self.messages[topic] += 1
        self.commands.append(message)

    def _done(self, topic: str, message: Message) -> None:
        assert isinstance(message, ActionResult)
        self.messages[topic] += 1
        self.results.append(message)
        if message.outcome == "success":
            self.done_at = message.stamp
        else:
            self.met[message.reason] += 1

    def _result(self, stood_still: bool, processor_s: float, wall_s: float) -> Result:
        world = self.world.world
        infected = self._infected()
        homes = {member.name: member.home for member in world.ward.members}
        return Result(
            story=self.story,
            infections=len(world.ward.infections),
            lost=tuple(infected),
            stood_still=stood_still,
            ended_s=self.runner.clock.now() / SECOND,
            drawn=Counter(fault.kind for fault in world.problems),
            met=self.met,
            problems=self.problems,
            missions=len(self.finished),
            open=self.open,
            recoveries=sum(recoveries for recoveries, _ in self.finished.values()),
            revisions=sum(revisions for _, revisions in self.finished.values()),
            interrupted=self.interrupted,
            plans=self.plans,
            planning_s=tuple(self.planning_s),
            said=self.messages[MESSAGES],
            messages=sum(self.messages.values()),
            actions=len(self.results),
            violations=tuple(violations(homes, self.commands, self.results)),
            failures=tuple(f"{name}: {fault.first}" for name, fault in self.runner.faults.items() if fault.failures),
            processor_s=round(processor_s, 2),
            wall_s=round(wall_s, 2),
            memory_mb=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        )


def play(story: Story) -> Result:
    """Run a story; results are deterministic except for times and memory."""
    paths.allow(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix="socialbot-hospital-") as folder:
        return Run(story, Path(folder)).play()
