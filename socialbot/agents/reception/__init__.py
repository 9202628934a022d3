"""Reception: Waldo shows the way, calls colleagues and knows the opening hours."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports
from socialbot.core.registry import AgentPackage

if TYPE_CHECKING:
    from socialbot.agents.reception.building import Building, load_building
    from socialbot.agents.reception.messages import CallStatus, ColleagueCall
    from socialbot.agents.reception.receptionist import Receptionist

AGENT = AgentPackage(
    name="reception",
    module="socialbot.agents.reception",
    nodes={"receptionist": "socialbot.agents.reception.receptionist:Receptionist"},
    graphs={"reception": "graph.yaml"},
    behaviours="behaviours.py",
    replays={"reception": "socialbot.agents.reception.demo:reception"},
    messages=("socialbot.agents.reception.messages:MESSAGES",),
)

__all__ = ["AGENT", "Building", "CallStatus", "ColleagueCall", "Receptionist", "load_building"]

__getattr__ = lazy_exports(__name__)
