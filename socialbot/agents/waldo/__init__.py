"""Waldo: greets people and offers help without being asked."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="waldo",
    module="socialbot.agents.waldo",
    nodes={
        "head": "socialbot.agents.waldo.head:Head",
        "listener": "socialbot.agents.waldo.nodes:Listener",
        "waldo": "socialbot.agents.waldo.nodes:WaldoNode",
    },
    graphs={"waldo": "graph.yaml"},
)
