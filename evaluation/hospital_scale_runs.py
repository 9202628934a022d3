"""Runs of large wards in simulated time: what can be different from one to the next, and what came of each."""

from __future__ import annotations

import itertools
import resource
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from evaluation.hospital_check import violations
from socialbot.agents.hospital.coordinator import MISSIONS, Coordinator, HospitalCoordinator
from socialbot.agents.hospital.demo import WORLD, large_hospital
from socialbot.agents.hospital.messages import COORDINATOR, TOPIC, AclMessage, Missions, Plan, Problem
from socialbot.agents.hospital.missions import Policy
from socialbot.agents.hospital.ward.messages import COMMANDS, RESULTS, STATE, ActionCommand, ActionResult, WardState
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

STILL_S = 60.0
"""A run in which nothing is done for so long while a room waits stands still: nobody rests, charges or is away so long.
"""
CHECK_S = 1.0


@dataclass(frozen=True)
class Kill:
    """The process of the coordinator is killed at ``time_s`` (s), and started anew ``down_s`` later."""

    time_s: float
    down_s: float

    def __str__(self) -> str:
        return f"{self.time_s:g} killed {self.down_s:g}"


@dataclass(frozen=True)
class Story:
    """A run: how large the ward is, chance by its ``seed``, the % of missions that meet a problem.

    ``faults`` go wrong besides, as ``7 silent uvdrobot1 5``. States of the ward come ``pause_s`` (s) apart or more.
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
        """How many robots and nurses there are."""
        return self.rooms + self.spots + self.uvds

    def graph(self, memory_file: Path) -> Graph:
        """The graph of it; the coordinator remembers in ``memory_file`` if it is to be killed."""
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
    """What came of a run.

    ``drawn`` are faults that chance drew, ``met`` the reasons for which actions failed, ``problems`` those of them that
    agents could not mend by themselves. ``lost`` are rooms that never were disinfected, ``stood_still`` is whether for
    so long nothing was done about them. ``interrupted`` are missions that were running when the coordinator was killed.
    ``violations`` are what the independent check found, ``failures`` the exceptions of nodes. ``planning_s`` is what
    each plan took.
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
        """The share of rooms disinfected of those that came to need it, in %."""
        return 100.0 * (1 - len(self.lost) / max(self.infections, 1))

    @property
    def fine(self) -> bool:
        """Whether all is as it should be."""
        return not (self.lost or self.open or self.stood_still or self.violations or self.failures)


class Run:
    """One run as it goes on."""

    def __init__(self, story: Story, folder: Path) -> None:
        self.story = story
        self.commands: list[ActionCommand] = []
        self.results: list[ActionResult] = []
        self.messages: Counter[str] = Counter()
        self.met: Counter[str] = Counter()
        self.problems = 0
        self.plans = 0
        self.finished: dict[int, tuple[int, int]] = {}
        """Missions that are finished, with their recoveries and revisions."""
        self.open = 0
        self.interrupted = 0
        self.planning_s: list[float] = []
        self.done_at = 0
        """When something was last done (ns)."""
        self.runner = InlineRunner(story.graph(folder / "memory.json"))
        taps = {STATE: self._see, TOPIC: self._hear, MISSIONS: self._count, COMMANDS: self._told, RESULTS: self._done}
        for topic, tap in taps.items():
            self.runner.tap(topic, tap)

    @property
    def world(self) -> HospitalWorld:
        """The ward as it really is."""
        node = self.runner.nodes[WORLD]
        assert isinstance(node, HospitalWorld)
        return node

    def play(self) -> Result:
        """Plays it until all is done, or nothing is done any more."""
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
            if now > nanoseconds(last_s) and not kills:
                if not self._infected() and not self.open:
                    break
                stood_still = now - max(self.done_at, nanoseconds(last_s)) > nanoseconds(STILL_S)
                if stood_still:
                    break
        self.planning_s += self.coordinator.planning_s
        return self._result(stood_still, time.process_time() - processor, time.perf_counter() - wall)

    @property
    def coordinator(self) -> Coordinator:
        """The one that is alive."""
        node = self.runner.nodes[COORDINATOR]
        assert isinstance(node, HospitalCoordinator)
        return node.coordinator

    def _kill(self, down: int) -> None:
        self.planning_s += self.coordinator.planning_s
        self.interrupted += len(self.coordinator.progress_of)
        self.runner.kill(COORDINATOR)
        self.runner.advance(self.runner.clock.now() + down)
        self.runner.restart(COORDINATOR)

    def _infected(self) -> list[str]:
        return [name for name, room in self.world.world.rooms.items() if not room.disinfected]

    # What is said and shown

    def _see(self, topic: str, message: Message) -> None:
        assert isinstance(message, WardState)
        self.messages[topic] += 1

    def _hear(self, topic: str, message: Message) -> None:
        assert isinstance(message, AclMessage)
        self.messages[topic] += 1
        self.plans += isinstance(message.content, Plan)
        self.problems += isinstance(message.content, Problem)

    def _count(self, topic: str, message: Message) -> None:
        assert isinstance(message, Missions)
        self.messages[topic] += 1
        # Those that are over come first.
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
            said=self.messages[TOPIC],
            messages=sum(self.messages.values()),
            actions=len(self.results),
            violations=tuple(violations(homes, self.commands, self.results)),
            failures=tuple(f"{name}: {fault.first}" for name, fault in self.runner.faults.items() if fault.failures),
            processor_s=round(processor_s, 2),
            wall_s=round(wall_s, 2),
            memory_mb=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        )


def play(story: Story) -> Result:
    """Plays a story; the same story comes to the same result, but for the times it takes and the memory."""
    paths.allow(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix="socialbot-hospital-") as folder:
        return Run(story, Path(folder)).play()
