"""Cleaning robots: one that works alone, and a cleaner that asks a sweeper to sweep first."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from socialbot.agents.base.deliberating import Deliberating
from socialbot.core.clock import SECOND
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import Desire
from socialbot.deliberation.sensing import predicate
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from socialbot.graph.ports import Parameter

FOLDER = Path(__file__).parent


class Chore(PlanAction):
    """Action that takes ``lasts_s`` and always succeeds."""

    rate_hz = 1.0
    lasts_s: ClassVar[float] = 4.0

    def begin(self, *args: str) -> None:
        self.begun = self.engine.clock.now()

    def advance(self) -> float:
        return (self.engine.clock.now() - self.begun) / SECOND / self.lasts_s


class movetoward(Chore):
    """Go to another place."""


class doclean(Chore):
    """Clean the current room."""


class recharge(Chore):
    """Charge the battery at the dock."""


class do_nothing(Chore):
    """Do nothing."""


PHRASES = {
    "movetoward": "goes from {1} to {2}",
    "doclean": "cleans {1}",
    "recharge": "fills its battery at {1}",
    "do_nothing": "rests",
    "asksweeping": "has {1} sweep {2}",
    "dosweep": "sweeps {1}",
}


class Cleaner(Deliberating):
    """Cleaner of ROS2-BDI's quick start. It accepts beliefs and desires by topic, but no requests of agents.

    It cleans only in the bedroom or the bathroom, and adopts the desire to be there first (``autosub_prec``).
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


SWEEP_PRIORITY, SWEEP_DEADLINE_S = 0.6, 20.0
PATIENCE_S = 60.0  # time limit for the sweeper


class asksweeping(PlanAction):
    """Ask the sweeper to sweep a room, and wait for it."""

    rate_hz = 1.0

    def begin(self, cleaner: str, sweeper: str, room: str) -> None:
        self.desire = Desire(
            name=f"sweep_{room}",
            value=(predicate("swept", room),),
            priority=SWEEP_PRIORITY,
            deadline=SWEEP_DEADLINE_S,
        )
        self.asked = self.agent.ask(sweeper, "add", desire=self.desire, monitor=True, cause=self.id)
        self.begun = self.engine.clock.now()

    def advance(self) -> float:
        match self.asked.state:
            case "fulfilled":
                return 1.0
            case "refused" | "timeout" | "dropped":
                self.fail(f"{self.args[1]} does not sweep: {self.asked.reason or self.asked.state}")
        seconds = (self.engine.clock.now() - self.begun) / SECOND
        if seconds >= PATIENCE_S:
            self.fail(f"{self.args[1]} has not swept in {PATIENCE_S:g} s")
        return min(seconds / SWEEP_DEADLINE_S, 0.95)

    def stop(self) -> None:
        self.agent.request_client.forget(self.asked)
        self.agent.ask(self.args[1], "del", desire=self.desire, cause=self.id)
        self.stopped()


class dosweep(Chore):
    """Sweep the current room."""

    lasts_s = 6.0


class TeamCleaner(Deliberating):
    """Cleaner of the pair."""

    folder = FOLDER
    actions_known = (movetoward, asksweeping, doclean)
    phrases = PHRASES

    pddl_file = Parameter("team_cleaner.pddl", "the domain, PDDL 2.1", fixed=True)
    init_bset = Parameter("team_cleaner_beliefs.yaml", "what it believes at first (YAML)", fixed=True)
    init_dset = Parameter("team_cleaner_desires.yaml", "what it desires at first (YAML)", fixed=True)
    agent_group = Parameter("cleaners", "the group it belongs to", fixed=True)


class Sweeper(Deliberating):
    """Sweeper of the pair; it sweeps at the request of cleaners."""

    folder = FOLDER
    actions_known = (movetoward, dosweep)
    phrases = PHRASES

    pddl_file = Parameter("sweeper.pddl", "the domain, PDDL 2.1", fixed=True)
    init_bset = Parameter("sweeper_beliefs.yaml", "what it believes at first (YAML)", fixed=True)
    agent_group = Parameter("sweepers", "the group it belongs to", fixed=True)
    belief_ck = Parameter("cleaners", "groups that may check its beliefs, separated by commas", fixed=True)
    desire_ck = Parameter("cleaners", "groups that may check its desires", fixed=True)
    desire_w = Parameter("cleaners", "groups that may change its desires", fixed=True)
    desire_pr = Parameter("0.6", "the highest priority that each group of desire_w may give", fixed=True)


def cleaner() -> tuple[str, Graph]:
    """A robot cleans rooms, and recharges when its battery runs low."""
    return "The cleaner", load_graph("cleaner")


def cleaner_sweeper() -> tuple[str, Graph]:
    """A robot cleans rooms that another one sweeps at its request."""
    return "Cleaner and sweeper", load_graph("cleaner-sweeper")
