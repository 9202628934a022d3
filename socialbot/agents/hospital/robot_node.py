"""Nodes of the robots and nurses of a hospital."""

from __future__ import annotations

from typing import ClassVar

from socialbot.agents.hospital.robots import ACTIONS, PROGRAMS, Senses
from socialbot.agents.hospital.ward.messages import CANCELS, COMMANDS, MESSAGES, RESULTS, STATE, WardState
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS
from socialbot.agents.teams import messages as acl
from socialbot.agents.teams.agent import TeamAgent, TeamMember
from socialbot.agents.teams.messages import AclMessage, ActionCancel, ActionCommand, ActionResult
from socialbot.bdi import Engine
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Variable
from socialbot.graph.ports import Delivery, Input, Output

_X = Variable("X")


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
    program: ClassVar = PROGRAMS / "spot.asl"


class Uvd(HospitalRobot):
    """A robot that disinfects rooms."""

    kind = "uvd"
    program: ClassVar = PROGRAMS / "uvd.asl"


class Nurse(HospitalAgent):
    """The screen of a nurse in her room."""

    kind = "nurse"
    program: ClassVar = PROGRAMS / "nurse.asl"
