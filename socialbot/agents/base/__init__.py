"""Base classes of agent nodes: messages in, actions out."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="base",
    module="socialbot.agents.base",
    messages=("socialbot.deliberation.messages:AGENT_MESSAGES",),
)
