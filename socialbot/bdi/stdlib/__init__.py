"""The internal actions of AgentSpeak, by topic. Importing this package makes them known."""

from socialbot.bdi.stdlib import environment as messages
from socialbot.bdi.stdlib import environment as printing
from socialbot.bdi.stdlib import environment as time
from socialbot.bdi.stdlib import environment as waiting
from socialbot.bdi.stdlib import goals, plans
from socialbot.bdi.stdlib import plans as beliefs
from socialbot.bdi.stdlib import terms as lists
from socialbot.bdi.stdlib import terms as numbers
from socialbot.bdi.stdlib import terms as strings
from socialbot.bdi.stdlib import terms as types

__all__ = [
    "beliefs", "goals", "lists", "messages", "numbers", "plans", "printing", "strings", "time", "types", "waiting",
]  # fmt: skip
