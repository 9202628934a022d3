"""Coordinator of the hospital."""

from __future__ import annotations

from socialbot.agents.hospital.missions import Disinfection
from socialbot.agents.hospital.ward.messages import MESSAGES, MISSIONS, STATE, WardState
from socialbot.agents.hospital.ward.ward import DURATIONS
from socialbot.agents.teams.coordinator import TeamCoordinator
from socialbot.agents.teams.messages import AclMessage, Missions
from socialbot.graph.ports import Delivery, Input, Output, Parameter


class HospitalCoordinator(TeamCoordinator):
    """Directs the robots and nurses of a hospital. With a ``memory_file`` it continues after a restart."""

    heard = Input(AclMessage, MESSAGES)
    state = Input(WardState, STATE, Delivery.LATCHED)
    said = Output(AclMessage, MESSAGES)
    missions = Output(Missions, MISSIONS, Delivery.LATCHED)

    pace = Parameter("clinic", "durations of actions in the ward; a longer action is stuck", choices=tuple(DURATIONS))

    def team_domain(self) -> Disinfection:
        return Disinfection(self.pace)

    @state
    def on_state(self, message: WardState) -> None:
        self.observe(message)
