"""Record of one mission in the hospital benchmark."""

from __future__ import annotations

from typing import Literal

import msgspec

Configuration = Literal["plain", "bdi", "bdi+recovery"]
CONFIGURATIONS: tuple[Configuration, ...] = ("plain", "bdi", "bdi+recovery")
"""No BDI and no recovery, BDI without recovery, BDI with recovery."""
RATES = (0, 10, 25, 50, 75, 100)
"""Problem rates of the missions, %."""
SEEDS = 30
"""Runs of each cell."""


class Share(msgspec.Struct, frozen=True):
    """Time shares of a mission or of one recovery, in s."""

    reasoning_s: float = 0.0
    """Agents, from receiving a message to their resulting output."""
    planning_s: float = 0.0
    """Coordinator: HTN planning and translation to AgentSpeak."""
    communication_s: float = 0.0
    """Message transport."""
    acting_s: float = 0.0
    """Actions in the ward."""


class MissionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one mission in the paper's ward."""

    configuration: Configuration
    rate: float
    seed: int
    runner: Literal["inline", "ros"]
    drawn: bool
    """Whether a problem was drawn for the mission."""
    met: bool
    """Whether an agent reported a problem."""
    completed: bool
    """Whether the mission ended with its room disinfected."""
    recoveries: int
    """Number of successful replannings of the coordinator."""
    plans: int
    actions: int
    """Executed or attempted actions."""
    mission_s: float
    """Time from the start of the world to the end of the mission: simulated inline, real on ROS."""
    wall_s: float
    """Real time from the start of the first process or node to the end of all."""
    share: Share
    recovered: tuple[Share, ...] = ()
    """Shares of each recovery, from the failure to the first action of the new plan."""
