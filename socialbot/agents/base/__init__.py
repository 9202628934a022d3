"""Base classes of agent nodes: messages in, actions out."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="base",
    module="socialbot.agents.base",
    nodes={"foreign_node": "socialbot.agents.base.foreign_node:ForeignNode"},
    messages=("socialbot.deliberation.messages:AGENT_MESSAGES", "socialbot.agents.base.foreign_node:MESSAGES"),
)
