"""A robot that cleans rooms once they are swept, and the one that it asks to sweep them."""

from __future__ import annotations

from socialbot.agent_messages import Desire
from socialbot.agents.cleaner.cleaner import FOLDER, PHRASES, Chore, doclean, movetoward
from socialbot.agents.deliberating import Deliberating
from socialbot.clock import SECOND
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.sensing import predicate
from socialbot.graph import Parameter

SWEEP_PRIORITY, SWEEP_DEADLINE_S = 0.6, 20.0
PATIENCE_S = 60.0
"""How long the cleaner waits until a room is swept."""


class asksweeping(PlanAction):  # noqa: N801 - the name in the domain
    """Asks the sweeper to sweep a room, and waits until it has."""

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
        self.agent.correspondence.forget(self.asked)
        self.agent.ask(self.args[1], "del", desire=self.desire, cause=self.id)
        self.stopped()


class dosweep(Chore):  # noqa: N801
    """Sweeps the room it is in."""

    lasts_s = 6.0


class TeamCleaner(Deliberating):
    """The cleaner of the pair."""

    folder = FOLDER
    actions_known = (movetoward, asksweeping, doclean)
    phrases = PHRASES

    pddl_file = Parameter("team_cleaner.pddl", "the domain, PDDL 2.1", fixed=True)
    init_bset = Parameter("team_cleaner_beliefs.yaml", "what it believes at first (YAML)", fixed=True)
    init_dset = Parameter("team_cleaner_desires.yaml", "what it desires at first (YAML)", fixed=True)
    agent_group = Parameter("cleaners", "the group it belongs to", fixed=True)


class Sweeper(Deliberating):
    """The sweeper of the pair: it sweeps what cleaners ask it to."""

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
