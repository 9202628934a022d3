"""Nodes of the robots and nurses of a hospital: their programs, actions and senses."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from socialbot.agents.hospital.ward.messages import CANCELS, COMMANDS, MESSAGES, RESULTS, STATE, AgentState, WardState
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS
from socialbot.agents.teams import messages as acl
from socialbot.agents.teams.agent import TeamAgent, TeamMember
from socialbot.agents.teams.messages import AclMessage, ActionCancel, ActionCommand, ActionResult
from socialbot.bdi import Engine, Sensor
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Atom, Variable
from socialbot.graph.ports import Delivery, Input, Output

_PROGRAMS = Path(__file__).parent
ACTIONS = (
    "a_navigate_to", "a_open_door", "a_approach_nurse", "a_authenticate_nurse", "a_authorize_patrol", "a_patrol_room",
    "a_adapt_room", "a_authorize_disinfect", "a_disinfect_room", "a_charge",
)  # fmt: skip
_X = Variable("X")


class Senses(Sensor):
    """Sensor for the place and the battery of the agent: ``at(room1)``, ``battery_low``."""

    def __init__(self) -> None:
        super().__init__()
        self._before: tuple[str, bool] | None = None

    def is_news(self, percept: AgentState) -> bool:
        """Whether the value changed since the last call."""
        before, self._before = self._before, (percept.place, percept.low_battery)
        return before != self._before

    def sense(self, percept: AgentState) -> Any:
        low = literal("battery_low")
        place = literal("at", (Atom(percept.place),))
        return [-literal("at", (Variable("_"),)), +place, +low if percept.low_battery else -low]


class HospitalMember(TeamMember):
    """Robot or nurse of a hospital."""

    heard = Input(AclMessage, MESSAGES, addressed_by="receiver")
    results = Input(ActionResult, RESULTS, addressed_by="robot")
    said = Output(AclMessage, MESSAGES)
    commands = Output(ActionCommand, COMMANDS)
    cancels = Output(ActionCancel, CANCELS)


class HospitalAgent(HospitalMember, TeamAgent):
    """Robot or nurse that executes plans of the coordinator."""

    can = ACTIONS
    joint_actions = JOINT_ACTIONS

    def registration(self) -> acl.Register:
        # All can execute each action; whether they do is a belief of their programs.
        capable = tuple(str(found["X"]) for found in self.engine.query(literal("can", (_X,))))
        kind = next(str(found["X"]) for found in self.engine.query(literal("kind", (_X,))))
        return acl.Register(kind, capable)


class HospitalRobot(HospitalAgent):
    """Robot, which senses its place and its battery. The ward state is large, so nurses do not get it."""

    state = Input(WardState, STATE, Delivery.LATCHED)

    def build(self) -> Engine:
        engine = super().build()
        self._senses = Senses()
        engine.add_sensor(self._senses)
        return engine

    @state
    def on_state(self, message: WardState) -> None:
        found = message.agent(self.name)
        if found is not None and self._senses.is_news(found):
            self.engine.perceive(self._senses, found, cause=f"{STATE}-{message.stamp}")


class Spot(HospitalRobot):
    """A robot that patrols rooms."""

    kind = "spot"
    program: ClassVar = _PROGRAMS / "spot.asl"


class Uvd(HospitalRobot):
    """A robot that disinfects rooms."""

    kind = "uvd"
    program: ClassVar = _PROGRAMS / "uvd.asl"


class Nurse(HospitalAgent):
    """The screen of a nurse in her room."""

    kind = "nurse"
    program: ClassVar = _PROGRAMS / "nurse.asl"
