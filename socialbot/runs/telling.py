"""Agents that leave no trace of all that they decide: what their messages tell becomes records of the trace."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.core.messages import Message
from socialbot.core.registry import event_log_of
from socialbot.graph.node import Graph

Observer = Callable[[str, Message], None]

TOLD_TOPIC = "told"
"""Where such records come from: no topic of the graph."""


def told_topics(graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``graph`` whose messages tell what was decided."""
    log = event_log_of(graph)
    return {} if log is None else {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, log.kinds)}


def telling(graph: Graph, observe: Observer) -> Observer:
    """``observe``, which also gets as records what the messages tell that it gets."""
    log = event_log_of(graph)
    if log is None:
        return observe

    def tell(topic: str, message: Message) -> None:
        observe(topic, message)
        for record in log.take(message):
            observe(TOLD_TOPIC, record)

    return tell
