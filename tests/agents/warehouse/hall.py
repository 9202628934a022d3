"""A hall for grippers and carriers one by one: the world, and what came on the topics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from socialbot.agents.warehouse.carrier import Carrier
from socialbot.agents.warehouse.gripper import Gripper
from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveStatus, Point
from socialbot.agents.warehouse.scenario import SIX, FloorLayout
from socialbot.agents.warehouse.world_node import World
from socialbot.bdi import Atom
from socialbot.bdi.literals import literal
from socialbot.core.messages import TraceRecord
from socialbot.deliberation.messages import AgentReply, AgentRequest, Desire, DesireItem, Fact, Operation, RequestState
from socialbot.graph.node import Graph, NodeConfig
from tests.inline import InlineRun

GRIPPER = "gripper_a"
LAYOUT = FloorLayout(SIX)
NOWHERE = Point(0.0, 0.0, 0.0)


def status(current: str, *, start: str = "start", target: str = "", robot: str = GRIPPER, z: float = 1.5) -> MoveStatus:
    return MoveStatus(
        stamp=0, robot=robot, start_name=start, current_name=current, target_name=target or current,
        current_pos=Point(0.0, 0.0, z), target_pos=NOWHERE, dist=0.0, progress=0.5,
    )  # fmt: skip


def boxes(**holders: str) -> BoxPositions:
    """Boxes and what bears them; of those on one stack each stands on the one before."""
    heights: dict[str, int] = {}
    found = []
    for box, holder in holders.items():
        heights[holder] = number = heights.get(holder, 0) + 1
        found.append(BoxPosition(name=box, position=Point(0.0, 0.0, number * 0.22), holder=holder))
    return BoxPositions(stamp=0, boxes=tuple(found))


def told(facts: Iterable[Fact] | None) -> set[str]:
    return {str(fact) for fact in facts or ()}


class IdleGripper(Gripper):
    """A gripper that wants nothing, so that its actions can be tried one by one."""

    def desires_at_first(self) -> tuple[Desire, ...]:
        return ()


@dataclass
class Try:
    """An action that was asked for; ``end`` is how it ended: ``done``, or why not."""

    end: str = ""
    intention: Any = None
    log: list[str] = field(default_factory=list)


class Hall(InlineRun):
    """The world with some agents and the published messages; the test plays the missing agents."""

    def __init__(self, *agents: NodeConfig, **world: Any) -> None:
        configs = (NodeConfig("world", World, {"noise": 0.0, **world}), *agents)
        inputs = frozenset(topic for config in configs for topic, _ in config.subscriptions)
        super().__init__(Graph("hall", configs, inputs=inputs))
        self.sent = 0
        self.until(0.2)

    def after(self, seconds: float) -> None:
        self.until(self.seconds + seconds)

    def attempt(self, agent: str, name: str, *args: str) -> Try:
        """Has an agent carry out an action, without a plan."""
        engine, trial = self.node(agent).engine, Try()

        def ended(failure: Any) -> None:
            trial.end = "done" if failure is None else failure.message

        goal = literal(name, tuple(map(Atom, args)))
        engine.call(lambda: setattr(trial, "intention", engine.attempt(goal, ended)))
        self.after(0.0)
        return trial

    def finish(self, trial: Try, limit_s: float = 20.0) -> str:
        """Advance the time until an action ends; return its outcome."""
        end = self.seconds + limit_s
        while not trial.end and self.seconds < end:
            self.after(0.1)
        return trial.end

    def give_up(self, agent: str, trial: Try) -> None:
        engine = self.node(agent).engine
        engine.call(lambda: engine.intentions.drop(trial.intention, lambda: setattr(trial, "end", "stopped")))
        self.after(0.0)

    def request(
        self, operation: Operation, receiver: str = "carrier_a", *, group: str = "grippers", **about: Any
    ) -> str:
        """Asks an agent for something, as gripper_a would; returns the id."""
        self.sent += 1
        message = AgentRequest(
            stamp=0, id=f"r{self.sent}", sender=GRIPPER, group=group, receiver=receiver, operation=operation, **about
        )
        self.send("/agents/requests", message)
        self.after(0.0)
        return message.id

    def replies(self, request: str) -> list[AgentReply]:
        return [reply for reply in self.of(AgentReply) if reply.id == request]

    def answer(self, request: AgentRequest, state: RequestState = "done", reason: str = "") -> None:
        """Answers a request as its receiver would."""
        reply = AgentReply(
            stamp=0, id=request.id, sender=request.receiver, receiver=request.sender,
            accepted=state != "refused", state=state, reason=reason,
        )  # fmt: skip
        self.send("/agents/replies", reply)

    def requests(self) -> list[AgentRequest]:
        """The requests that came, each once."""
        return list({request.id: request for request in self.of(AgentRequest)}.values())

    def desire(self, agent: str, desire: Desire) -> None:
        self.send(f"/{agent}/add_desire", DesireItem(stamp=0, desire=desire))
        self.after(0.0)

    def records(self, kind: str, source: str) -> list[TraceRecord]:
        return [record for record in self.of(TraceRecord) if record.kind == kind and record.source == source]

    def holder(self, box: str) -> str:
        return next(found.holder for found in self.of(BoxPositions)[-1].boxes if found.name == box)


def hall_with_gripper(**world: Any) -> Hall:
    return Hall(NodeConfig(GRIPPER, IdleGripper), **world)


def hall_with_carrier(**parameters: Any) -> Hall:
    return Hall(NodeConfig("carrier_a", Carrier, parameters))


def to_be_in(place: str, priority: float) -> Desire:
    wanted = (Fact(name="in", params=("carrier_a", place)),)
    return Desire(name=f"go_to_{place}", value=wanted, priority=priority, deadline=20.0)
