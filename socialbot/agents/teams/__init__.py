"""Teams: a coordinator that forms teams of agents, plans their missions, and recovers from problems."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports
from socialbot.core.registry import AgentPackage

if TYPE_CHECKING:
    from socialbot.agents.teams.actions import WorldAction, names_of
    from socialbot.agents.teams.agent import TeamAgent, TeamMember
    from socialbot.agents.teams.coordinator import Coordinator, TeamCoordinator
    from socialbot.agents.teams.domain import MemberState, Role, TeamDomain
    from socialbot.agents.teams.event_log import MissionResults
    from socialbot.agents.teams.messages import (
        MISSIONS,
        STATE,
        AclMessage,
        ActionCancel,
        ActionCommand,
        ActionResult,
        Missions,
        MissionView,
        Problem,
    )
    from socialbot.agents.teams.missions import CoordinatorOptions, Mission
    from socialbot.agents.teams.planning import HtnMissionPlanner, MissionPlanner, PddlMissionPlanner
    from socialbot.agents.teams.translation import initial_triggers, stages, translate
    from socialbot.agents.teams.world import TeamMemberState, TeamState, TeamWorld

AGENT = AgentPackage(
    name="teams",
    module="socialbot.agents.teams",
    messages=(
        "socialbot.agents.teams.messages:MISSION_MESSAGES",
        "socialbot.agents.teams.messages:WORLD_MESSAGES",
        "socialbot.agents.teams.world:TEAM_WORLD_MESSAGES",
    ),
    recorded=("socialbot.agents.teams.messages:MISSION_MESSAGES",),
    event_log="socialbot.agents.teams.event_log:event_log",
)

__all__ = [
    "AGENT", "MISSIONS", "STATE", "AclMessage", "ActionCancel", "ActionCommand", "ActionResult", "Coordinator",
    "CoordinatorOptions", "HtnMissionPlanner", "MemberState", "Mission", "MissionPlanner", "MissionResults",
    "MissionView", "Missions", "PddlMissionPlanner", "Problem", "Role", "TeamAgent", "TeamCoordinator",
    "TeamDomain", "TeamMember", "TeamMemberState", "TeamState", "TeamWorld", "WorldAction", "initial_triggers",
    "names_of", "stages", "translate",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)
