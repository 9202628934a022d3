"""Translation of the plan of a team to AgentSpeak plans of its agents."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from socialbot.agents.teams.messages import PlannedAction
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import ANYTHING, Change, Event, Structure, literal, source
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Achieve, Do, Step, Update
from socialbot.bdi.terms import Atom, Conjunction, Variable, conjunction
from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item

TELL = Atom("tell")
END = literal("end")


def stages(items: Iterable[Item], team: Sequence[str], joint: Iterable[str]) -> tuple[PlannedAction, ...]:
    """The actions of a plan with their agents: for a ``joint`` action those in its arguments, else the first of them.

    Raises PlanningError for an action without an agent of the team.
    """
    together = frozenset(joint)
    found: list[PlannedAction] = []
    for name, *given in items:
        args = tuple(map(str, given))
        named = [agent for agent in team if agent in args]
        if not named:
            raise PlanningError(f"{name}({', '.join(args)}) has no agent of the team {', '.join(team)}")
        if name not in together:
            named = [min(named, key=args.index)]
        found.append(PlannedAction(name, args, tuple(named)))
    return tuple(found)


def initial_triggers(plan: Sequence[PlannedAction]) -> dict[str, str]:
    """The literals that start the plan, by agent of the first action."""
    first = plan[0]
    trigger = literal(f"initial_trigger_{first.action}", tuple(map(Atom, first.args)))
    return {agent: agentspeak(trigger) for agent in first.agents}


def translate(plan: Sequence[PlannedAction], context: Mapping[str, str], label: str) -> dict[str, tuple[str, ...]]:
    """The AgentSpeak plans of each agent.

    Args:
        plan: Actions with their agents.
        context: Values of variables, in the order of the arguments of ``start(...)``.
        label: Prefix of the labels of plans: ``label_0``, ``label_1``, ...

    Raises PlanningError for an invalid variable.
    """
    for name in context:
        if not name.isidentifier() or not name[0].isupper():
            raise PlanningError(f"{name!r} is no variable", remedy="write a name that begins with a capital letter")
    translation, texts = _Translation(plan, context), {}
    for agent in dict.fromkeys(agent for stage in plan for agent in stage.agents):
        plans = translation.plans(agent)
        for number, each in enumerate(plans):
            each.label = f"{label}_{number}"
        texts[agent] = tuple(map(agentspeak, plans))
    return texts


class _Translation:
    def __init__(self, plan: Sequence[PlannedAction], context: Mapping[str, str]) -> None:
        self.plan = plan
        self.variables = {constant: Variable(name) for name, constant in reversed(list(context.items()))}
        self.start = literal("start", tuple(map(self.term, context.values())))

    def term(self, constant: str) -> Variable | Atom:
        return self.variables.get(constant, Atom(constant))

    def named(self, prefix: str, stage: PlannedAction) -> Structure:
        return literal(prefix + stage.action, tuple(map(self.term, stage.args)))

    def plans(self, agent: str) -> list[Plan]:
        mine = [index for index, stage in enumerate(self.plan) if agent in stage.agents]
        begins = [index for index in mine if index == 0 or agent not in self.plan[index - 1].agents]
        triggered = [self.plan[index] for index in begins if index > 0]
        plans: list[Plan] = []
        last: list[Plan] = []
        triggers: set[PlannedAction] = set()
        for index in mine:
            stage = self.plan[index]
            if index == 0:
                plans.append(self.rule(Change.ADDED, "initial_trigger_", stage, self.start, [self.goal(stage)]))
                # This context also holds later, when the same action may occur again.
                act = [Update("+", _milestone(0)), Do(self.named("", stage))]
                last.append(self.rule(Change.WANTED, "", stage, self.start, act))
            else:
                if index in begins and stage not in triggers:
                    triggers.add(stage)
                    again = triggered.count(stage) > 1
                    steps = [Update("-", self.named("trigger_", stage)[source(ANYTHING)])] if again else []
                    plans.append(self.rule(Change.ADDED, "trigger_", stage, self.start, [*steps, self.goal(stage)]))
                plans.append(self.rule(Change.WANTED, "", stage, _milestone(index), [Do(self.named("", stage))]))
            plans.append(self.success(agent, index, from_other=index in begins and index > 0, ends=index == mine[-1]))
        return plans + last

    def success(self, agent: str, index: int, *, from_other: bool, ends: bool) -> Plan:
        stage = self.plan[index]
        # A belief from another agent that stays would hide the same action later on.
        steps: list[Step] = [Update("-", _milestone(index)[source(ANYTHING)] if from_other else _milestone(index))]
        context = _milestone(index)
        if index + 1 < len(self.plan):
            after = self.plan[index + 1]
            goes_on = agent in after.agents
            if goes_on:
                steps.append(Update("+", _milestone(index + 1)))
            if agent == next((each for each in stage.agents if each in after.agents), stage.agents[0]):
                for other in after.agents:
                    if other not in stage.agents:
                        steps += self.tell_steps(other, index + 1)
            if goes_on:
                steps.append(self.goal(after))
            if goes_on or len(steps) > 1:
                context = self.start & context
        if ends:
            steps.append(Do(END))
        return self.rule(Change.ADDED, "success_", stage, context, steps)

    def tell_steps(self, other: str, index: int) -> list[Step]:
        trigger = self.named("trigger_", self.plan[index])
        return [Do(literal(".send", (self.term(other), TELL, what))) for what in (Atom(f"milestone{index}"), trigger)]

    def goal(self, stage: PlannedAction) -> Step:
        return Achieve(self.named("", stage))

    def rule(
        self, change: Change, prefix: str, stage: PlannedAction, context: Structure | Conjunction, steps: list[Step]
    ) -> Plan:
        return Plan(Event(change, self.named(prefix, stage)), conjunction(context), tuple(steps))


def _milestone(index: int) -> Structure:
    return literal(f"milestone{index}")
