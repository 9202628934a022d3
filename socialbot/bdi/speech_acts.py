"""Speech acts: what agents say to each other."""

from __future__ import annotations

from typing import Any

from socialbot.bdi.actions import Action
from socialbot.bdi.literals import Reactor


class send(Action):  # noqa: N801 - reads as a step of a plan
    """Says something to another agent: ``send(to, belief)`` tells it, ``send(to, goal, "achieve")`` asks for it.

    The third argument is the performative (see `socialbot.bdi.mail.PERFORMATIVES`).
    """

    def execute(self, receiver: Any, content: Any, performative: str = "tell") -> Any:
        """Sends the message; it has this action as its cause."""
        return self.engine.send(receiver, performative, content, cause=self.id)


class message(Reactor):  # noqa: N801 - written like a belief
    """``+message(Sender, Performative, Content)``: the event that something was said to the agent, whatever follows."""
