"""Hospital: robots patrol and disinfect rooms, with the permission and help of nurses."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports
from socialbot.core.registry import AgentPackage

if TYPE_CHECKING:
    from socialbot.agents.hospital.missions import HospitalCoordinator
    from socialbot.agents.hospital.robot_node import HospitalAgent, Nurse, Spot, Uvd
    from socialbot.agents.hospital.ward.messages import PERSON_IN_ROOM, STATE, WardState
    from socialbot.agents.teams.actions import WorldAction, names_of
    from socialbot.agents.teams.messages import ActionCancel, ActionCommand, ActionResult

AGENT = AgentPackage(
    name="hospital",
    module="socialbot.agents.hospital",
    nodes={
        "hospital_coordinator": "socialbot.agents.hospital.missions:HospitalCoordinator",
        "hospital_world": "socialbot.agents.hospital.ward.world_node:HospitalWorld",
        "nurse": "socialbot.agents.hospital.robot_node:Nurse",
        "spot": "socialbot.agents.hospital.robot_node:Spot",
        "uvd": "socialbot.agents.hospital.robot_node:Uvd",
    },
    graphs={"hospital": "graph.yaml"},
    messages=("socialbot.agents.hospital.ward.messages:WARD_MESSAGES",),
    recorded=("socialbot.agents.teams.messages:MISSION_MESSAGES",),
    phrases="socialbot.agents.hospital.vocabulary:PHRASES",
    vocabulary="socialbot.agents.hospital.vocabulary:VOCABULARY",
    world_view="socialbot.agents.hospital.result:world_view",
    event_log="socialbot.agents.hospital.result:event_log",
    completion="socialbot.agents.hospital.result:completion",
    terminal_view="socialbot.agents.hospital.result:terminal_view",
    demos={"hospital": "socialbot.agents.hospital.demo:demo"},
    behaviours="behaviours.py",
)

__all__ = [
    "AGENT", "PERSON_IN_ROOM", "STATE", "ActionCancel", "ActionCommand", "ActionResult", "HospitalAgent",
    "HospitalCoordinator", "Nurse", "Spot", "Uvd", "WardState", "WorldAction", "names_of",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)
