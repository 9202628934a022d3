"""Waldo: an agent that greets people and offers help unasked."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports
from socialbot.core.registry import AgentPackage

if TYPE_CHECKING:
    from socialbot.agents.waldo.head import Head
    from socialbot.agents.waldo.nodes import Listener, WaldoNode
    from socialbot.agents.waldo.talking import TalkingWaldo, small_talk
    from socialbot.agents.waldo.waldo import personDetected, speak

AGENT = AgentPackage(
    name="waldo",
    module="socialbot.agents.waldo",
    nodes={
        "head": "socialbot.agents.waldo.head:Head",
        "listener": "socialbot.agents.waldo.nodes:Listener",
        "talking_waldo": "socialbot.agents.waldo.talking:TalkingWaldo",
        "waldo": "socialbot.agents.waldo.nodes:WaldoNode",
    },
    graphs={"waldo": "graph.yaml"},
    vocabulary="socialbot.agents.waldo.vocabulary:VOCABULARY",
    behaviours="behaviours.py",
)

__all__ = [
    "AGENT", "Head", "Listener", "TalkingWaldo", "WaldoNode", "personDetected", "small_talk", "speak",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)
