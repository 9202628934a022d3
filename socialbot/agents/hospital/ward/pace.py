"""How long things take in the ward, and what power they use."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

AT_ONCE = 0.0


@dataclass(frozen=True)
class Pace:
    """``speed`` in m/s, ``seconds`` of each action without the way to it, ``a_charge`` from empty to full.

    Batteries hold 1; they lose ``battery_per_m`` of the way and ``battery_of`` each action done.
    """

    speed: float
    seconds: Mapping[str, float] = field(default_factory=dict)
    battery_per_m: float = 0.001
    battery_of: Mapping[str, float] = field(default_factory=lambda: {"a_patrol_room": 0.01, "a_disinfect_room": 0.04})


PAPER = Pace(
    speed=10.0,
    seconds={
        "a_open_door": 0.2,
        "a_approach_nurse": 0.04,
        "a_authenticate_nurse": 0.04,
        "a_authorize_patrol": 0.04,
        "a_patrol_room": 0.06,
        "a_adapt_room": 0.1,
        "a_authorize_disinfect": 0.04,
        "a_disinfect_room": 0.6,
        "a_charge": 3.0,
        "a_infected_room": 1.0,
    },
)
"""As in the paper's simulation: its mission takes 4.2 s, of which the nurse takes the first, and 0.3 s more when the
room is dirty."""

INSTANT = Pace(speed=math.inf, seconds={"a_infected_room": 1.0})
"""As in the simulation of the paper's predecessor: only the nurse takes time."""

CLINIC = Pace(
    speed=1.0,
    seconds={
        "a_open_door": 5.0,
        "a_approach_nurse": 2.0,
        "a_authenticate_nurse": 4.0,
        "a_authorize_patrol": 3.0,
        "a_patrol_room": 20.0,
        "a_adapt_room": 60.0,
        "a_authorize_disinfect": 2.0,
        "a_disinfect_room": 300.0,
        "a_charge": 1800.0,
        "a_infected_room": 1.0,
    },
)
"""As robots that stroll and light that takes minutes would do it."""

PACES: Mapping[str, Pace] = {"paper": PAPER, "instant": INSTANT, "clinic": CLINIC}
"""The paces by name."""
