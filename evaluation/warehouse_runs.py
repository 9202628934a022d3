"""Runs of the warehouse in simulated time: their variations and results."""

from __future__ import annotations

import random
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from evaluation.trace_check import TraceCheck
from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.warehouse.demo import scenario_with, warehouse
from socialbot.agents.warehouse.scenario import CARRIER_DOMAIN, GRIPPER, GRIPPER_DOMAIN, Scenario, random_faults
from socialbot.agents.warehouse.world import Warehouse
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

SORT = "sort_boxes"
"""Desire of the gripper."""
LIMIT_S = 1500.0
"""Time after which a run counts as hanging. Sorting six boxes is aborted and restarted after 232 s."""
QUIET_S = 3.0
"""Time for messages on their way, after which the run is over if no agent is at work."""
CHECK_S = 0.5


@dataclass(frozen=True, order=True)
class Kill:
    """Kill of an agent's process at ``time_s`` (s), with a restart ``down_s`` later."""

    time_s: float
    who: str
    down_s: float

    def __str__(self) -> str:
        return f"{self.time_s:g} killed {self.who} {self.down_s:g}"


@dataclass(frozen=True)
class Story:
    """Run parameters: size, demonstration scenario, random ``seed``, and faults."""

    seed: int = 0
    boxes: int = 6
    run: Literal[1, 2] = 1
    faults: str = ""
    kills: tuple[Kill, ...] = ()
    limit_s: float = LIMIT_S

    @property
    def cast(self) -> Scenario:
        return scenario_with(self.boxes)

    def __str__(self) -> str:
        wrong = "; ".join(filter(None, [self.faults, *map(str, self.kills)]))
        return f"run {self.run}, {self.boxes} boxes, seed {self.seed}" + (f": {wrong}" if wrong else "")

    def graph(self, folder: Path | None = None) -> Graph:
        """Return the graph; agents keep their minds in ``folder``, if given."""
        graph = warehouse(self.boxes, run=self.run, seed=self.seed, faults=self.faults)
        agents = (GRIPPER, *self.cast.carriers) if folder is not None else ()
        return graph.with_parameters({agent: {"mind_file": f"{folder}/{agent}.json"} for agent in agents})


def troubled(seed: int) -> Story:
    """Return a story with one to four random faults, and up to two kills with restarts."""
    story = Story(seed)
    chance = random.Random(f"kills {seed}")
    agents = (GRIPPER, *story.cast.carriers)
    kills = [
        Kill(round(chance.uniform(2.0, 140.0), 1), chance.choice(agents), round(chance.uniform(0.5, 6.0), 1))
        for _ in range(chance.choice((0, 1, 1, 2)))
    ]
    faults = "; ".join(map(str, random_faults(seed, story.cast)))
    return replace(story, faults=faults, kills=_apart(kills))


def _apart(kills: list[Kill]) -> tuple[Kill, ...]:
    """Return the kills that begin after the end of the one before."""
    found: list[Kill] = []
    for kill in sorted(kills):
        if not found or kill.time_s > found[-1].time_s + found[-1].down_s:
            found.append(kill)
    return tuple(found)


@dataclass(frozen=True)
class Result:
    """Result of a run. ``ended_s`` is the end of the gripper's desire; ``end`` its result, with the reason if dropped.

    ``boxes_right`` is whether each box is in its deposit in the simulated world. ``violations``
    come from the independent check, ``failures`` are exceptions of nodes.
    """

    story: Story
    end: str
    ended_s: float
    over: bool
    first_steps: int
    first_makespan_s: float
    plans: int
    aborts: int
    requests: int
    steps: int
    boxes_right: bool
    unloads: int
    violations: tuple[str, ...]
    failures: tuple[str, ...]
    processor_s: float

    @property
    def reached(self) -> bool:
        """Whether the goal was reached, both in the gripper's beliefs and in the world."""
        return self.end == "fulfilled" and self.boxes_right

    @property
    def settled(self) -> bool:
        """Whether the run ended properly: goal reached, or dropped for a reason; nothing hangs."""
        return self.over and (self.reached or self.end.startswith("dropped: "))


class Run:
    """Run in progress. ``tell`` receives each record of each agent."""

    def __init__(self, story: Story, folder: Path, tell: Callable[[TraceRecord], object] = lambda record: None) -> None:
        self.story = story
        self.kinds: Counter[str] = Counter()
        self.end = ""
        self.ended_s = 0.0
        self.first: TraceRecord | None = None
        self.plan_ends: list[TraceRecord] = []
        self.requests = 0
        self.unloads: set[str] = set()
        self.violations: list[str] = []
        self._steps = 0
        self._tell = tell
        self.agents = (GRIPPER, *story.cast.carriers)
        self.runner = InlineRunner(story.graph(folder if story.kills else None))
        self._checks = {agent: self._new_check(agent) for agent in self.agents}
        for agent in self.agents:
            self.runner.tap(f"/{agent}/trace", self._take)

    def _new_check(self, agent: str) -> TraceCheck:
        path = GRIPPER_DOMAIN if agent == GRIPPER else CARRIER_DOMAIN
        return TraceCheck(path.read_text("utf-8"))

    @property
    def now_s(self) -> float:
        return self.runner.clock.now() / SECOND

    @property
    def world(self) -> Warehouse:
        node = self.runner.nodes["world"]
        assert isinstance(node, WarehouseWorld)
        return node.world

    def play(self) -> Result:
        begun = time.process_time()
        self.runner.start()
        for kill in self.story.kills:
            self._until(nanoseconds(kill.time_s))
            if self._is_over():
                break
            self.runner.kill(kill.who)
            self._forget(kill.who)
            self._until(nanoseconds(kill.time_s + kill.down_s))
            self.runner.restart(kill.who)
        over = self._until_over()
        self.runner.close()
        for agent in self.agents:
            self._forget(agent, over=over)
        return self._result(over, time.process_time() - begun)

    def _until(self, time: int) -> None:
        while (now := self.runner.clock.now()) < time and not self._is_over():
            self.runner.advance(min(now + nanoseconds(CHECK_S), time))

    def _until_over(self) -> bool:
        """Run until all agents are idle; return False on timeout."""
        quiet_since = self.now_s
        while self.now_s < self.story.limit_s:
            self.runner.advance(self.runner.clock.now() + nanoseconds(CHECK_S))
            if not self._is_over():
                quiet_since = self.now_s
            elif self.now_s - quiet_since >= QUIET_S:
                return True
        return False

    def _is_over(self) -> bool:
        nodes = self.runner.nodes.values()
        agents = [node.deliberator for node in nodes if isinstance(node, Deliberating)]
        return bool(self.end) and not any(agent.is_at_work for agent in agents)

    def _take(self, topic: str, message: Message) -> None:
        assert isinstance(message, TraceRecord)
        self._tell(message)
        self._checks[message.source].take(message)
        if message.kind == "desire_fulfilled" and message.what == "go_unload":
            self.unloads.add(message.source)
        if message.source != GRIPPER:
            return
        self.kinds[message.kind] += 1
        match message.kind:
            case "plan_start" if self.first is None:
                self.first = message
            case "plan_end":
                self.plan_ends.append(message)
            case "request" if " desire " in message.what:
                self.requests += 1
            case "desire_fulfilled" | "desire_dropped" if message.what == SORT:
                how, reason = message.kind.removeprefix("desire_"), message.detail.get("reason")
                self.end, self.ended_s = f"{how}: {reason}" if reason else how, self.now_s

    def _forget(self, agent: str, *, over: bool = False) -> None:
        """End the trace check of an agent's process."""
        found = self._checks[agent]
        self._checks[agent] = self._new_check(agent)
        self._steps += found.steps
        self.violations += (f"{agent}: {violation}" for violation in found.violations)
        if over:
            self.violations += (f"{agent}: {step} never ends" for step in found.running)

    def _result(self, over: bool, processor_s: float) -> Result:
        detail = self.first.detail if self.first is not None else {"steps": [], "makespan_s": 0.0}
        return Result(
            story=self.story,
            end=self.end,
            ended_s=round(self.ended_s, 3),
            over=over,
            first_steps=len(detail["steps"]),
            first_makespan_s=detail["makespan_s"],
            plans=self.kinds["plan_start"],
            aborts=sum(record.detail["outcome"] != "succeeded" for record in self.plan_ends),
            requests=self.requests,
            steps=self._steps,
            boxes_right=self._boxes_are_right(),
            unloads=len(self.unloads),
            violations=tuple(self.violations),
            failures=tuple(f"{name}: {fault.first}" for name, fault in self.runner.faults.items() if fault.failures),
            processor_s=round(processor_s, 2),
        )

    def _boxes_are_right(self) -> bool:
        cast, load = self.story.cast, self.world.load
        return all(set(boxes) <= set(load[deposit]) for deposit, boxes in zip(cast.deposits, cast.loads, strict=True))


def play(story: Story, tell: Callable[[TraceRecord], object] = lambda record: None) -> Result:
    """Run a story; results are deterministic except for processor time."""
    paths.allow(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix="socialbot-warehouse-") as folder:
        return Run(story, Path(folder), tell).play()
