"""What people ask of agents from the page, and what these answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from socialbot.core.messages import Command


class Answer(Protocol):
    """What became of it."""

    @property
    def accepted(self) -> bool:
        """Whether it is done."""
        ...

    @property
    def reason(self) -> str:
        """Why not."""
        ...


class Office(Protocol):
    """Takes what people ask of agents to them."""

    @property
    def shut(self) -> str:
        """Why nothing can be asked; empty when it can."""
        ...

    async def ask(self, agent: str, command: Command, text: str) -> Answer | None:
        """Asks an agent for something; None when it does not answer."""
        ...


@dataclass(frozen=True)
class Shut:
    """Where nothing can be asked."""

    shut: str

    async def ask(self, agent: str, command: Command, text: str) -> None:
        """Does nothing."""
