"""A hospital that runs inline, and what was said and seen in it."""

from __future__ import annotations

from typing import Any, TypeVar

from socialbot.agents.hospital.coordinator import MISSIONS
from socialbot.agents.hospital.messages import TOPIC, AclMessage, Missions, MissionView
from socialbot.agents.hospital.ward.messages import CANCELS, COMMANDS, STATE, ActionCancel, ActionCommand, WardState
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

W = TypeVar("W", bound="Watched")


class Watched:
    """A run of a graph: what was said and asked for; the missions, their ends (s) and the ward as they were last."""

    def __init__(self, graph: Graph) -> None:
        self.runner = InlineRunner(graph)
        self.said: list[AclMessage] = []
        self.commands: list[ActionCommand] = []
        self.cancels: list[ActionCancel] = []
        self.views: dict[int, MissionView] = {}
        self.ended: dict[int, float] = {}
        self.ward: WardState | None = None
        self.runner.tap(TOPIC, lambda _, message: self.said.append(message))  # type: ignore[arg-type]
        self.runner.tap(COMMANDS, lambda _, message: self.commands.append(message))  # type: ignore[arg-type]
        self.runner.tap(CANCELS, lambda _, message: self.cancels.append(message))  # type: ignore[arg-type]
        self.runner.tap(MISSIONS, self._see)
        self.runner.tap(STATE, self._look)
        self.runner.start()

    def _see(self, topic: str, message: Message) -> None:
        assert isinstance(message, Missions)
        for view in message.missions:
            self.views[view.id] = view
            if view.status in ("finished", "failed"):
                self.ended.setdefault(view.id, message.stamp / SECOND)

    def _look(self, topic: str, message: Message) -> None:
        assert isinstance(message, WardState)
        self.ward = message

    def until(self: W, second: float) -> W:
        self.runner.advance(nanoseconds(second))
        assert not {name: faults.first for name, faults in self.runner.faults.items() if faults.failures}
        return self

    def history(self, mission: int = 1) -> list[tuple[str, ...]]:
        return [(each.action, *each.args) for each in self.views[mission].actions]

    def contents(self, kind: type) -> list[Any]:
        return [message.content for message in self.said if isinstance(message.content, kind)]

    def infected(self) -> list[str]:
        assert self.ward is not None
        return [room.name for room in self.ward.rooms if room.infected]
