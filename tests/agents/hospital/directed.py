"""A ward that the test changes, directed by a coordinator."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import msgspec

from socialbot.agents.hospital.missions import Disinfection
from socialbot.agents.hospital.ward.messages import AgentState, RoomState, WardState
from socialbot.agents.teams.coordinator import Coordinator
from socialbot.agents.teams.messages import (
    COORDINATOR,
    AclMessage,
    Finished,
    MissionView,
    Performative,
    Problem,
    Register,
    Report,
)
from socialbot.agents.teams.missions import CoordinatorMemory, CoordinatorOptions, by_number
from socialbot.core.clock import SECOND
from tests.agents.hospital.listings import ROOM

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)

CAPABLE = {
    "spotrobot": ("a_navigate_to", "a_open_door", "a_patrol_room", "a_charge"),
    "uvdrobot": ("a_navigate_to", "a_disinfect_room", "a_charge"),
    "nurse_disinfected": ("a_authenticate_nurse", "a_authorize_patrol", "a_adapt_room"),
}


class Ward:
    """A coordinator, a ward that the test changes, and what was said."""

    def __init__(
        self, rooms: int = 1, spots: int = 1, uvds: int = 1, memory: CoordinatorMemory | None = None, **options
    ) -> None:
        self.now = 0
        self.numbers = {"spotrobot": spots, "uvdrobot": uvds, "nurse_disinfected": rooms}
        self.rooms = {
            f"room{n}": RoomState(name=f"room{n}", door_open=False, cleaned=True, disinfected=True)
            for n in range(1, rooms + 1)
        }
        self.agents = {
            f"{kind}{n}": AgentState(
                name=f"{kind}{n}", kind=kind, home=f"room{n}" if "nurse" in kind else "room0",
                place=f"room{n}" if "nurse" in kind else "room0", inside=True, x=0.0, y=0.0,
            )
            for kind, count in self.numbers.items()
            for n in range(1, count + 1)
        }  # fmt: skip
        self.said: list[tuple[str, str, object, str]] = []
        self.coordinator = self.directing(memory, **options)

    def directing(self, memory: CoordinatorMemory | None = None, **options) -> Coordinator:
        def send(receiver, performative, content, mission, in_reply_to):
            self.said.append((receiver, performative, content, mission))

        options = {"proactive": False, **options}
        domain = Disinfection(options.pop("pace", "clinic"))
        return Coordinator(domain, send, CoordinatorOptions(**options), memory or CoordinatorMemory())

    def send(
        self,
        sender: str,
        content,
        *,
        mission: str = "",
        performative: Performative = "inform",
        receiver=COORDINATOR,
        in_reply_to: str = "",
    ) -> None:
        message = AclMessage(
            stamp=self.now, id="x", sender=sender, receiver=receiver, performative=performative, content=content,
            mission=mission, in_reply_to=in_reply_to,
        )  # fmt: skip
        self.coordinator.receive(message, self.now)

    def register(self, *names: str, in_reply_to: str = "") -> None:
        for name in names or self.agents:
            kind = by_number(name)[0]
            self.send(name, Register(kind, CAPABLE[kind]), performative="request", in_reply_to=in_reply_to)

    def answer(self, *names: str) -> None:
        """Lets agents answer that they are there."""
        self.register(*names, in_reply_to="question")

    def look(self, after_s: float = 0.2) -> None:
        self.now += round(after_s * SECOND)
        state = WardState(stamp=self.now, rooms=tuple(self.rooms.values()), agents=tuple(self.agents.values()))
        self.coordinator.observe(state, self.now)

    def room(self, name: str = ROOM, **changes) -> None:
        self.rooms[name] = msgspec.structs.replace(self.rooms[name], **changes)

    def agent(self, name: str, **changes) -> None:
        self.agents[name] = msgspec.structs.replace(self.agents[name], **changes)

    def infect(self, *names: str) -> None:
        for name in names or (ROOM,):
            self.room(name, disinfected=False)
        self.look()

    def plan(self, mission: int = 1) -> list[tuple[str, ...]]:
        """Return the remaining plan of a mission."""
        progress = self.coordinator.manager.progress_of[mission]
        return [node.item for node in progress.agenda[progress.position :]]

    def label(self, mission: int = 1) -> str:
        return self.coordinator.memory.missions[mission].label

    def do(self, count: int, mission: int = 1) -> None:
        """Has the next actions reported as done."""
        for action, *args in self.plan(mission)[:count]:
            self.send(args[0], Report("success", action, tuple(args)), mission=self.label(mission))

    def fail(self, kind: str, mission: int = 1) -> None:
        action, *args = self.plan(mission)[0]
        self.send(args[0], Problem(kind, tuple(args), action), mission=self.label(mission))

    def finish(self, mission: int = 1) -> None:
        for name in list(self.coordinator.memory.missions[mission].active):
            self.send(name, Finished(), mission=self.label(mission), performative="request")

    def contents(self, kind: type, receiver: str | None = None) -> list:
        return [what for to, _, what, _ in self.said if isinstance(what, kind) and receiver in (None, to)]

    def statuses(self) -> dict[int, str]:
        return {mission.id: mission.status for mission in self.coordinator.manager.views()}

    def view(self) -> MissionView:
        return next(self.coordinator.manager.views())

    def history(self) -> list[tuple[str, ...]]:
        return [(each.action, *each.args) for each in next(self.coordinator.manager.views()).actions]

    def working(self) -> Mapping[str, int]:
        return {name: member.mission for name, member in self.coordinator.memory.members.items() if member.mission}


def started(**kwargs) -> Ward:
    ward = Ward(**kwargs)
    ward.register()
    ward.infect()
    return ward
