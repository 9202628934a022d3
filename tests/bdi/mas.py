"""Agents in AgentSpeak, in simulated time."""

from __future__ import annotations

import functools
from typing import Any

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak
from socialbot.bdi.society import Society
from socialbot.core.clock import SECOND, ManualClock


class Mas:
    """Agents by name, each with its text; ``said`` is what they printed."""

    def __init__(self, **texts: str) -> None:
        self.clock = ManualClock()
        self.society = Society(self.clock)
        self.said: list[tuple[str, str]] = []
        self.trace: list[Any] = []
        for name, text in texts.items():
            engine = Engine(name, self.clock)
            engine.out = functools.partial(self.hear, name)
            self.society.add(engine)
            engine.add_text(text, f"{name}.asl")

    def __getattr__(self, name: str) -> Engine:
        try:
            return self.society.agents[name]
        except KeyError:
            raise AttributeError(name) from None

    def hear(self, name: str, text: str) -> None:
        self.said.append((name, text))

    @property
    def lines(self) -> list[str]:
        return [text for _, text in self.said]

    def until(self, seconds: float) -> Mas:
        """Advance the time from wakeup to wakeup."""
        end = round(seconds * SECOND)
        assert not self.society.run_until_idle()
        while (due := self.society.next_wakeup()) is not None and due <= end:
            self.clock.set(max(due, self.clock.now()))
            assert not self.society.run_until_idle()
        self.clock.set(max(end, self.clock.now()))
        return self

    def beliefs(self, name: str) -> dict[str, tuple[str, ...]]:
        """Return the beliefs of an agent with their sources."""
        return {agentspeak(held.belief): held.sources for held in self.society.agents[name].beliefs}


def said(text: str, seconds: float = 60) -> list[str]:
    """Return the output of a single agent ``me``."""
    return Mas(me=text).until(seconds).lines


def does(body: str) -> list[str]:
    """Return the output of a plan with this body; it ends with ``failed E`` after a failure."""
    return said(f'!go. +!go <- {body}. -!go[error(E), error_msg(M)] <- .print(failed, " ", E).')
