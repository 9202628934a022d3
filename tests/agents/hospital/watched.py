"""A hospital that runs inline, and its messages."""

from __future__ import annotations

from typing import Any, TypeVar

from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.teams.messages import AclMessage, ActionCancel, ActionCommand, Missions, MissionView
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

W = TypeVar("W", bound="Watched")


class Observer:
    """Messages of a hospital: speech acts, commands, latest missions with the times of their ends (s), latest ward."""

    def __init__(self) -> None:
        self.said: list[AclMessage] = []
        self.commands: list[ActionCommand] = []
        self.cancels: list[ActionCancel] = []
        self.views: dict[int, MissionView] = {}
        self.ended: dict[int, float] = {}
        self.ward: WardState | None = None

    def observe(self, topic: str, message: Message) -> None:
        match message:
            case AclMessage():
                self.said.append(message)
            case ActionCommand():
                self.commands.append(message)
            case ActionCancel():
                self.cancels.append(message)
            case WardState():
                self.ward = message
            case Missions():
                for view in message.missions:
                    self.views[view.id] = view
                    if view.status in ("finished", "failed"):
                        self.ended.setdefault(view.id, message.stamp / SECOND)

    def history(self, mission: int = 1) -> list[tuple[str, ...]]:
        return [(each.action, *each.args) for each in self.views[mission].actions]

    def contents(self, kind: type) -> list[Any]:
        return [message.content for message in self.said if isinstance(message.content, kind)]

    def infected(self) -> list[str]:
        assert self.ward is not None
        return [room.name for room in self.ward.rooms if room.infected]


class Watched(Observer):
    """An inline run of a graph."""

    def __init__(self, graph: Graph, start: int = 0, without: str = "") -> None:
        super().__init__()
        self.runner = InlineRunner(graph, start=start)
        for topic in graph.topics():
            self.runner.tap(topic, self.observe)
        if without:
            self.runner.kill(without)
        self.runner.start()

    def until(self: W, second: float) -> W:
        self.runner.advance(nanoseconds(second))
        assert not {name: faults.first for name, faults in self.runner.faults.items() if faults.failures}
        return self
