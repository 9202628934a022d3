"""A robot that cleans rooms until its battery runs low. Its actions only take their time: there is no robot."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from socialbot.agents.deliberating import Deliberating
from socialbot.clock import SECOND
from socialbot.deliberation.actions import PlanAction
from socialbot.graph import Parameter

FOLDER = Path(__file__).parent


class Chore(PlanAction):
    """Work that lasts ``lasts_s`` and always succeeds."""

    rate_hz = 1.0
    lasts_s: ClassVar[float] = 4.0

    def begin(self, *args: str) -> None:
        self.begun = self.engine.clock.now()

    def advance(self) -> float:
        return (self.engine.clock.now() - self.begun) / SECOND / self.lasts_s


class movetoward(Chore):  # noqa: N801 - the name in the domain
    """Goes to another place."""


class doclean(Chore):  # noqa: N801
    """Cleans the room it is in."""


class recharge(Chore):  # noqa: N801
    """Fills the battery at the dock."""


class do_nothing(Chore):  # noqa: N801
    """Rests."""


PHRASES = {
    "movetoward": "goes from {1} to {2}",
    "doclean": "cleans {1}",
    "recharge": "fills its battery at {1}",
    "do_nothing": "rests",
    "asksweeping": "has {1} sweep {2}",
    "dosweep": "sweeps {1}",
}
"""How the actions of cleaners and sweepers are said."""


class Cleaner(Deliberating):
    """The cleaner of ROS2-BDI's quick start. It takes beliefs and desires of people, by topics, and of no other agent.

    It starts to clean in the bedroom or the bathroom only, and desires to be there first (``autosub_prec``).
    """

    folder = FOLDER
    actions_known = (movetoward, doclean, recharge, do_nothing)
    phrases = PHRASES

    pddl_file = Parameter("cleaner.pddl", "the domain, PDDL 2.1", fixed=True)
    init_bset = Parameter("cleaner_beliefs.yaml", "what it believes at first (YAML)", fixed=True)
    init_dset = Parameter("cleaner_desires.yaml", "what it desires at first (YAML)", fixed=True)
    init_reactive_rules_set = Parameter("cleaner_rules.yaml", "its rules (YAML)", fixed=True)
    agent_group = Parameter("cleaners", "the group it belongs to", fixed=True)
    autosub_prec = Parameter(True, "desire what the precondition of a desire lacks", fixed=True)
