"""Random schedules of lost, stuck, late and blind team members in three worlds, and their runs in simulated time.

An independent check reads the simulated worlds: which rooms are disinfected, and which books and boxes are delivered.
What can be done follows from the schedule and the world, not from the beliefs of agents.
"""

from __future__ import annotations

import importlib.util
import random
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import ClassVar

from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.hospital.demo import large_hospital
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import MISSIONS as HOSPITAL_MISSIONS
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.agents.teams import MISSIONS, Missions, MissionView, TeamWorld
from socialbot.agents.warehouse.demo import scenario_with, warehouse
from socialbot.agents.warehouse.scenario import GRIPPER
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

KINDS = ("dies", "hangs", "joins late", "silent", "vanishes")
FOREVER_S = 100_000.0
REST_S = 200.0
"""Time at rest after which a run is over."""
STEP_S = 1.0


@dataclass(frozen=True, order=True)
class Trouble:
    """A member ``dies`` for good, ``hangs`` for good, ``joins late``, or is ``silent``; or a thing ``vanishes``."""

    time_s: float
    kind: str
    who: str
    seconds: float = 0.0

    def __str__(self) -> str:
        return f"{self.time_s:g} {self.who} {self.kind}" + (f" for {self.seconds:g} s" if self.kind == "silent" else "")


@dataclass(frozen=True)
class Schedule:
    """Troubles of one run, by time."""

    scene: str
    seed: int
    troubles: tuple[Trouble, ...]

    def __str__(self) -> str:
        return f"{self.scene} {self.seed}: {'; '.join(map(str, self.troubles))}"


@dataclass(frozen=True)
class Outcome:
    """End of a run: what was done, what could be done, and the reasons for the rest, by target."""

    schedule: Schedule
    done: frozenset[str]
    possible: frozenset[str]
    wanted: frozenset[str]
    reasons: dict[str, str]
    failures: tuple[str, ...]
    simulated_s: float
    processor_s: float

    @property
    def missed(self) -> frozenset[str]:
        """Targets that could be done but were not."""
        return self.possible - self.done

    @property
    def unexplained(self) -> frozenset[str]:
        """Targets that were not done, without a reason."""
        return frozenset(target for target in self.wanted - self.done if not self.reasons.get(target))


class Scene(ABC):
    """A world with its team.

    Attributes:
        limit_s: Time after which a run is over in any case (s).
        until_s: Latest time of a trouble (s).
        reporter: Agent that publishes the reasons. When it dies, that is the reason.
    """

    name: ClassVar[str]
    reporter: ClassVar[str] = "coordinator"
    members: tuple[str, ...]
    things: tuple[str, ...] = ()
    limit_s: ClassVar[float] = 500.0
    until_s: ClassVar[float] = 20.0

    @abstractmethod
    def graph(self, faults: str) -> Graph:
        """The graph with faults of the world."""

    @abstractmethod
    def done(self, runner: InlineRunner) -> set[str]:
        """Targets that are done in the world."""

    @abstractmethod
    def possible(self, runner: InlineRunner, working: set[str], gone: set[str]) -> set[str]:
        """Targets that can be done by the members that work, without the things that are gone."""

    @abstractmethod
    def targets(self) -> set[str]:
        """All targets."""

    @abstractmethod
    def is_stuck(self, runner: InlineRunner, member: str) -> bool:
        """Whether the world shows that a member will never finish its action."""

    def is_at_rest(self, runner: InlineRunner) -> bool:
        """Whether no member does or waits for anything, if the scene can say so."""
        return False

    @abstractmethod
    def listen(self, runner: InlineRunner, reasons: dict[str, str]) -> None:
        """Collect the reasons that the team publishes."""

    def draw(self, seed: int) -> Schedule:
        """Draw a schedule of one to five troubles, each of another member or thing."""
        chance = random.Random(f"teams {self.name} {seed}")
        found, free = [], {True: list(self.members), False: list(self.things)}
        for _ in range(chance.randint(1, 5)):
            kind = chance.choice(KINDS if self.things else KINDS[:-1])
            some = free[kind != "vanishes"]
            if some:
                who = some.pop(chance.randrange(len(some)))
                time_s = round(chance.uniform(0.5, self.until_s), 1)
                found.append(
                    Trouble(time_s, kind, who, round(chance.uniform(5.0, 40.0), 1) if kind == "silent" else 0.0)
                )
        return Schedule(self.name, seed, tuple(sorted(found)))

    def faults(self, troubles: Sequence[Trouble]) -> str:
        """The troubles that the world causes, as its parameter."""
        found = []
        for each in troubles:
            if each.kind == "hangs":
                found.append(f"{each.time_s} stalls {each.who} {FOREVER_S}")
            elif each.kind == "silent":
                found.append(f"{each.time_s} silent {each.who} {each.seconds}")
            elif each.kind == "vanishes":
                found.append(f"{each.time_s} vanishes {each.who}")
        return "; ".join(found)


def _mission_reasons(runner: InlineRunner, topic: str, reasons: dict[str, str]) -> None:
    def take(_: str, message: Message) -> None:
        assert isinstance(message, Missions)
        reasons.update((view.target, _reason(view)) for view in message.missions)

    runner.tap(topic, take)


def _reason(view: MissionView) -> str:
    return view.problem if view.status != "finished" else ""


class HospitalScene(Scene):
    """A ward of six rooms with three robots of each kind."""

    name = "hospital"

    def __init__(self, rooms: int = 6, robots: int = 3) -> None:
        self.rooms = {f"room{number}": f"{NURSE}{number}" for number in range(1, rooms + 1)}
        self.robots = {kind: {f"{kind}{number}" for number in range(1, robots + 1)} for kind in (SPOT, UVD)}
        self.members = (*sorted(self.robots[SPOT]), *sorted(self.robots[UVD]), *list(self.rooms.values())[:2])

    def graph(self, faults: str) -> Graph:
        size = len(self.robots[SPOT])
        return large_hospital(len(self.rooms), size, size, world={"faults": faults}, coordinator={"patience_s": 10.0})

    def _world(self, runner: InlineRunner) -> WardWorld:
        node = runner.nodes["world"]
        assert isinstance(node, HospitalWorld)
        return node.world

    def targets(self) -> set[str]:
        return set(self.rooms)

    def done(self, runner: InlineRunner) -> set[str]:
        world = self._world(runner)
        infected_later = {room for time_s, room in world.ward.infections if world.now < nanoseconds(time_s)}
        return {name for name, room in world.rooms.items() if room.disinfected and name in self.rooms} - infected_later

    def possible(self, runner: InlineRunner, working: set[str], gone: set[str]) -> set[str]:
        if not all(robots & working for robots in self.robots.values()):
            return set()
        return {room for room, nurse in self.rooms.items() if nurse in working}

    def is_stuck(self, runner: InlineRunner, member: str) -> bool:
        world = self._world(runner)
        activity = world.agents[member].activity
        return activity is not None and activity.due > world.now + nanoseconds(FOREVER_S / 2)

    def listen(self, runner: InlineRunner, reasons: dict[str, str]) -> None:
        _mission_reasons(runner, HOSPITAL_MISSIONS, reasons)


@cache
def library_example() -> ModuleType:
    """The module of the library example."""
    path = Path(__file__).parents[1] / "examples" / "library.py"
    spec = importlib.util.spec_from_file_location("library_example", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class LibraryScene(Scene):
    """The library with three runners and two porters."""

    name = "library"
    planner: ClassVar[str] = "htn"

    def __init__(self) -> None:
        self._example = library_example()
        self.members = (*self._example.RUNNERS, *self._example.PORTERS)
        self.things = tuple(self._example.BOOKS)

    def graph(self, faults: str) -> Graph:
        return self._example.library(self.planner, faults)

    def _world(self, runner: InlineRunner) -> TeamWorld:
        node = runner.nodes["world"]
        assert isinstance(node, TeamWorld)
        return node

    def targets(self) -> set[str]:
        return set(self.things)

    def done(self, runner: InlineRunner) -> set[str]:
        loc = self._world(runner).variables.loc
        return {book for book in self.things if loc.get(book) == self._example.DESK}

    def possible(self, runner: InlineRunner, working: set[str], gone: set[str]) -> set[str]:
        complete = working & set(self._example.RUNNERS) and working & set(self._example.PORTERS)
        return set(self.things) - gone if complete else set()

    def is_stuck(self, runner: InlineRunner, member: str) -> bool:
        return self._world(runner).busy_s(member) > FOREVER_S / 2

    def listen(self, runner: InlineRunner, reasons: dict[str, str]) -> None:
        _mission_reasons(runner, MISSIONS, reasons)


class WarehouseScene(Scene):
    """The warehouse with six boxes, a gripper and three carriers."""

    name = "warehouse"
    reporter = GRIPPER
    limit_s = 1500.0
    until_s = 100.0

    def __init__(self) -> None:
        self._scenario = scenario_with(6)
        self.members = (GRIPPER, *self._scenario.carriers)
        self.things = self._scenario.boxes
        self._carrier_of = {
            box: carrier
            for carrier, boxes in zip(self._scenario.carriers, self._scenario.loads, strict=True)
            for box in boxes
        }

    def graph(self, faults: str) -> Graph:
        return warehouse(6, faults=faults)

    def _node(self, runner: InlineRunner) -> WarehouseWorld:
        node = runner.nodes["world"]
        assert isinstance(node, WarehouseWorld)
        return node

    def targets(self) -> set[str]:
        return set(self._carrier_of)

    def done(self, runner: InlineRunner) -> set[str]:
        load = self._node(runner).world.load
        pairs = zip(self._scenario.deposits, self._scenario.loads, strict=True)
        return {box for deposit, boxes in pairs for box in boxes if box in load[deposit]}

    def possible(self, runner: InlineRunner, working: set[str], gone: set[str]) -> set[str]:
        load = self._node(runner).world.load
        return {
            box
            for box, carrier in self._carrier_of.items()
            if carrier in working and box not in gone and (GRIPPER in working or box in load[carrier])
        }

    def is_stuck(self, runner: InlineRunner, member: str) -> bool:
        world = self._node(runner).world
        return world.stands_until(member) > world.now + nanoseconds(FOREVER_S / 2)

    def is_at_rest(self, runner: InlineRunner) -> bool:
        agents = [node.deliberator for node in runner.nodes.values() if isinstance(node, Deliberating)]
        return not any(agent.is_at_work for agent in agents)

    def listen(self, runner: InlineRunner, reasons: dict[str, str]) -> None:
        """A reason names the box, or is that of the carrier on which it is."""

        def take(_: str, message: Message) -> None:
            assert isinstance(message, TraceRecord)
            named: list[str] = []
            if message.kind == "failure" and message.detail.get("reason") == "stuck":
                named = [box for box in self._carrier_of if box in message.detail["message"]]
            elif message.kind == "desire_dropped" and message.source == GRIPPER:
                named = [box for box in self._carrier_of if box in message.detail["reason"]]
            elif message.kind == "desire_dropped" and message.what == "go_unload":
                named = self._node(runner).world.load[message.source]
            why = f"{message.what}: {message.detail.get('message') or message.detail.get('reason')}"
            reasons.update(dict.fromkeys(named, why))

        for member in self.members:
            runner.tap(f"/{member}/trace", take)


class PddlLibraryScene(LibraryScene):
    """The library with missions planned in PDDL."""

    name = "library (PDDL)"
    planner = "pddl"


SCENES: dict[str, type[Scene]] = {
    scene.name: scene for scene in (HospitalScene, LibraryScene, PddlLibraryScene, WarehouseScene)
}


def schedules(count: int) -> list[Schedule]:
    """The first schedules: of five, two of the hospital, one of the library with each planner, one of the warehouse."""
    order = ("hospital", "library", "hospital", "library (PDDL)", "warehouse")
    made = {name: SCENES[name]() for name in SCENES}
    return [made[order[number % 5]].draw(number) for number in range(count)]


def play(schedule: Schedule) -> Outcome:
    """Run a schedule. The outcome is deterministic except for processor time."""
    begun = time.process_time()
    scene = SCENES[schedule.scene]()
    runner = InlineRunner(scene.graph(scene.faults(schedule.troubles)))
    reasons: dict[str, str] = {}
    scene.listen(runner, reasons)
    late = {each.who for each in schedule.troubles if each.kind == "joins late"}
    for name in late:
        runner.kill(name)
    runner.start()
    dead: set[str] = set()
    gone: set[str] = set()
    ever: set[str] = set()
    waiting = list(schedule.troubles)
    rests_since = 0
    while runner.clock.now() < nanoseconds(scene.limit_s):
        runner.advance(runner.clock.now() + nanoseconds(STEP_S))
        while waiting and nanoseconds(waiting[0].time_s) <= runner.clock.now():
            trouble = waiting.pop(0)
            if trouble.kind == "dies":
                runner.kill(trouble.who)
                dead.add(trouble.who)
            elif trouble.kind == "joins late":
                runner.restart(trouble.who)
            elif trouble.kind == "vanishes":
                gone.add(trouble.who)
        ever |= scene.done(runner)
        if waiting or not scene.is_at_rest(runner):
            rests_since = runner.clock.now()
        elif runner.clock.now() - rests_since > nanoseconds(REST_S):
            break
        if not waiting and runner.clock.now() > nanoseconds(scene.until_s) and scene.done(runner) == scene.targets():
            break
    stuck = {name for name in scene.members if name not in dead and scene.is_stuck(runner, name)}
    everybody = {config.name for config in scene.graph("").nodes}
    possible = scene.possible(runner, everybody - dead - stuck, gone)
    if scene.reporter in dead:
        reasons.update(dict.fromkeys(scene.targets() - set(reasons), f"{scene.reporter}, which plans, died"))
    failures = tuple(f"{name}: {fault.first}" for name, fault in runner.faults.items() if fault.failures)
    return Outcome(
        schedule,
        frozenset(scene.done(runner) | (ever & gone)),
        frozenset(possible),
        frozenset(scene.targets()),
        {target: reason for target, reason in reasons.items() if reason},
        failures,
        runner.clock.now() / SECOND,
        round(time.process_time() - begun, 2),
    )
