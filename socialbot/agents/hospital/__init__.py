"""The hospital: robots patrol and disinfect rooms, with nurses who let them and tidy up."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="hospital",
    module="socialbot.agents.hospital",
    nodes={
        "hospital_coordinator": "socialbot.agents.hospital.coordinator:HospitalCoordinator",
        "hospital_world": "socialbot.agents.hospital.ward.world_node:HospitalWorld",
        "nurse": "socialbot.agents.hospital.robot_node:Nurse",
        "spot": "socialbot.agents.hospital.robot_node:Spot",
        "uvd": "socialbot.agents.hospital.robot_node:Uvd",
    },
    graphs={"hospital": "graph.yaml"},
    messages=(
        "socialbot.agents.hospital.messages:MISSION_MESSAGES",
        "socialbot.agents.hospital.ward.messages:WARD_MESSAGES",
    ),
    recorded=("socialbot.agents.hospital.messages:MISSION_MESSAGES",),
    phrases="socialbot.agents.hospital.event_log:PHRASES",
)
