"""Programs, actions and senses of the robots and nurses of a hospital."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialbot.agents.hospital.ward.messages import AgentState
from socialbot.bdi import Sensor
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Atom, Variable

PROGRAMS = Path(__file__).parent
ACTIONS = (
    "a_navigate_to", "a_open_door", "a_approach_nurse", "a_authenticate_nurse", "a_authorize_patrol", "a_patrol_room",
    "a_adapt_room", "a_authorize_disinfect", "a_disinfect_room", "a_charge",
)  # fmt: skip


def program(kind: str) -> str:
    """The AgentSpeak program of ``spot``, ``uvd`` or ``nurse``."""
    return (PROGRAMS / f"{kind}.asl").read_text("utf-8")


class Senses(Sensor):
    """Sensor for the place and the battery of the agent: ``at(room1)``, ``battery_low``."""

    def __init__(self) -> None:
        super().__init__()
        self._before: tuple[str, bool] | None = None

    def is_news(self, percept: AgentState) -> bool:
        """Whether the value changed since the last call."""
        before, self._before = self._before, (percept.place, percept.low_battery)
        return before != self._before

    def sense(self, percept: AgentState) -> Any:
        low = literal("battery_low")
        place = literal("at", (Atom(percept.place),))
        return [-literal("at", (Variable("_"),)), +place, +low if percept.low_battery else -low]
