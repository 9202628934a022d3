"""One mission of the hospital's experiments, as it is written down."""

from __future__ import annotations

from typing import Literal

import msgspec

Configuration = Literal["plain", "bdi", "bdi+recovery"]
CONFIGURATIONS: tuple[Configuration, ...] = ("plain", "bdi", "bdi+recovery")
"""No BDI and no recovery, BDI without recovery, BDI with recovery."""
RATES = (0, 10, 25, 50, 75, 100)
"""% of the missions that meet a problem."""
SEEDS = 30
"""Runs of each cell."""


class Share(msgspec.Struct, frozen=True):
    """Where the time of a mission, or of one recovery, goes; all in s."""

    reasoning_s: float = 0.0
    """Agents think: from when they hear or see something until they say or do something because of it."""
    planning_s: float = 0.0
    """The coordinator plans: task networks, and what they become in AgentSpeak."""
    communication_s: float = 0.0
    """Messages are on their way."""
    acting_s: float = 0.0
    """Something is done in the ward."""


class MissionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one mission in the paper's ward."""

    configuration: Configuration
    rate: float
    seed: int
    runner: Literal["inline", "ros"]
    drawn: bool
    """Whether chance put a problem in the way of the mission."""
    met: bool
    """Whether an agent told of a problem."""
    completed: bool
    """Whether the mission is over and its room disinfected."""
    recoveries: int
    """How often the coordinator found another way."""
    plans: int
    """Plans that it made."""
    actions: int
    """Actions that were done, or tried."""
    mission_s: float
    """From the start of the world to the end of the mission, in the time of the run: simulated inline, real on ROS."""
    wall_s: float
    """Real time from before the first process, or node, starts until all have ended."""
    share: Share
    """Where `mission_s` went."""
    recovered: tuple[Share, ...] = ()
    """Where the time of each recovery went: from what failed to the first action of the new plan."""
