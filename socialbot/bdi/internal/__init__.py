"""The internal actions of AgentSpeak, by topic. Importing this package makes them known."""

from socialbot.bdi.internal import (
    beliefs,
    goals,
    lists,
    messages,
    numbers,
    plans,
    printing,
    strings,
    time,
    types,
    waiting,
)

__all__ = [
    "beliefs", "goals", "lists", "messages", "numbers", "plans", "printing", "strings", "time", "types", "waiting",
]  # fmt: skip
