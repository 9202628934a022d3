"""Runs of large wards in simulated time: their variations, results and an independent check."""

from __future__ import annotations

import itertools
import resource
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from socialbot.agents.hospital.demo import WORLD, large_hospital
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.ward.messages import COMMANDS, MESSAGES, MISSIONS, RESULTS, STATE, WardState
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS
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


ROUNDED_NS = 1000
"""Rounding of durations, which are reported in s."""


def violations(
    homes: Mapping[str, str], commands: Iterable[ActionCommand], results: Sequence[ActionResult]
) -> list[str]:
    """Check the commands and results of a ward independently; ``homes`` are the rooms of the nurses.

    Each command has one result, and no agent acts in parallel. Partners do joint actions together. A room may be
    disinfected only after these steps, in this order: its nurse confirms the robot and permits a patrol, the patrol
    finds the room fit, and the patrolling robot admits the other one.

    Returns:
        The violations.
    """
    done = [result for result in results if result.outcome == "success"]
    return [*_unasked(commands, results), *_at_once(results), *_alone(done), *_out_of_order(homes, done)]


def _text(result: ActionResult) -> str:
    return f"{result.stamp / SECOND:.3f} s: {result.robot}: {result.action}({', '.join(result.args)})"


def _unasked(commands: Iterable[ActionCommand], results: Sequence[ActionResult]) -> Iterator[str]:
    """Yield results without a command, and repeated results."""
    told = {command.id: (command.robot, command.action, command.args) for command in commands}
    times = Counter(result.id for result in results)
    for result in results:
        if told.get(result.id) != (result.robot, result.action, result.args):
            yield f"{_text(result)} was not commanded"
        elif times[result.id] > 1:
            yield f"{_text(result)} has {times[result.id]} results"


def _at_once(results: Iterable[ActionResult]) -> Iterator[str]:
    """Yield actions that overlap with others of the same agent; immediately refused ones do not count."""
    by_robot: dict[str, list[tuple[int, ActionResult]]] = defaultdict(list)
    for result in results:
        if result.outcome == "success" or result.duration_s > 0.0:
            by_robot[result.robot].append((result.stamp - nanoseconds(result.duration_s), result))
    for some in by_robot.values():
        some.sort(key=lambda each: (each[0], each[1].stamp))
        for (_, before), (begin, result) in pairwise(some):
            if begin < before.stamp - ROUNDED_NS:
                yield f"{_text(result)} began before {before.action} was over"


def _alone(done: Iterable[ActionResult]) -> Iterator[str]:
    """Yield joint actions that the partners did at different times."""
    for (_, _, args), some in _joint(done).items():
        if {result.robot for result in some} != set(args):
            yield f"{_text(some[0])} was done alone"


def _joint(done: Iterable[ActionResult]) -> dict[tuple[int, str, tuple[str, ...]], list[ActionResult]]:
    found: dict[tuple[int, str, tuple[str, ...]], list[ActionResult]] = defaultdict(list)
    for result in done:
        if result.action in JOINT_ACTIONS:
            found[result.stamp, result.action, result.args].append(result)
    return found


@dataclass
class _Permissions:
    known: dict[str, str] = field(default_factory=dict)
    allowed: dict[str, str] = field(default_factory=dict)
    patrolled: dict[str, str] = field(default_factory=dict)
    let_in: dict[str, str] = field(default_factory=dict)


def _out_of_order(homes: Mapping[str, str], done: Iterable[ActionResult]) -> Iterator[str]:
    may = _Permissions()
    for result in done:
        match result.action, result.args:
            case "a_authenticate_nurse", (spot, nurse):
                may.known[spot] = nurse
            case "a_authorize_patrol", (spot, nurse) if result.robot == spot:
                if may.known.pop(spot, "") != nurse:
                    yield f"{_text(result)}: the nurse does not know the robot"
                may.allowed[spot] = homes[nurse]
            case "a_patrol_room", (spot, room):
                if may.allowed.pop(spot, "") != room:
                    yield f"{_text(result)}: nobody has allowed it"
                may.patrolled[spot] = room
            case "a_authorize_disinfect", (uvd, spot):
                may.let_in[uvd] = may.patrolled.get(spot, "")
            case "a_disinfect_room", (uvd, room):
                if may.let_in.pop(uvd, "") != room:
                    yield f"{_text(result)}: it was not let in"
            case _:
                pass
