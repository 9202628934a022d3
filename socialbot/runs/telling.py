"""Agents that leave no trace of all that they decide: what their messages tell becomes records of the trace."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.agents.hospital.event_log import TOLD, Chronicle
from socialbot.core.messages import Message
from socialbot.graph.node import Graph

Observer = Callable[[str, Message], None]

TOLD_TOPIC = "told"
"""Where such records come from: no topic of the graph."""


def told_topics(graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``graph`` whose messages tell what was decided."""
    return {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, TOLD)}


def telling(graph: Graph, observe: Observer) -> Observer:
    """``observe``, which also gets as records what the messages tell that it gets."""
    if not told_topics(graph):
        return observe
    chronicle = Chronicle()

    def tell(topic: str, message: Message) -> None:
        observe(topic, message)
        for record in chronicle.take(message):
            observe(TOLD_TOPIC, record)

    return tell
