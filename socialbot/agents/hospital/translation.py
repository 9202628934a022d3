"""From a plan for a team to plans in AgentSpeak, a list for each agent.

Milestone *i* is believed by those who do action *i*, when its turn has come. Who has done it goes on to action *i* + 1,
and tells those who are new there: the milestone, and a trigger. So the agents do the plan in order, with nobody who
directs them::

    +success_a_patrol_room(SpotRobot, Room) : start(Nurse, Room, SpotRobot, UvdRobot) & milestone5 <-
        -milestone5; +milestone6;
        .send(UvdRobot, tell, milestone6); .send(UvdRobot, tell, trigger_a_authorize_disinfect(UvdRobot, SpotRobot));
        !a_authorize_disinfect(UvdRobot, SpotRobot).

If nobody goes on, one of those who did the action tells the others. A trigger that comes again in the same plan is
forgotten when it is followed, as it would be no event the second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import ANYTHING, Change, Event, Structure, literal, source
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Achieve, Do, Step, Update
from socialbot.bdi.terms import Atom, Conjunction, Variable, conjunction
from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item

TELL = Atom("tell")
END = literal("end")


@dataclass(frozen=True, slots=True)
class Stage:
    """One action of a plan, and those who do it, in the order of the team."""

    action: str
    args: tuple[str, ...]
    agents: tuple[str, ...]


def stages(items: Iterable[Item], team: Sequence[str], joint: Iterable[str]) -> tuple[Stage, ...]:
    """The actions with those who do them: the agents that a ``joint`` action names, or else the first one named.

    Raises PlanningError for an action that nobody of the team is to do.
    """
    together = frozenset(joint)
    found: list[Stage] = []
    for name, *given in items:
        args = tuple(map(str, given))
        named = [agent for agent in team if agent in args]
        if not named:
            raise PlanningError(f"{name}({', '.join(args)}) names nobody of {', '.join(team)}")
        if name not in together:
            named = [min(named, key=args.index)]
        found.append(Stage(name, args, tuple(named)))
    return tuple(found)


def initial_triggers(plan: Sequence[Stage]) -> dict[str, str]:
    """For each agent of the first action the literal that has it begin."""
    first = plan[0]
    trigger = literal(f"initial_trigger_{first.action}", tuple(map(Atom, first.args)))
    return {agent: agentspeak(trigger) for agent in first.agents}


def translate(plan: Sequence[Stage], context: Mapping[str, str], label: str) -> dict[str, tuple[str, ...]]:
    """The plans in AgentSpeak for each agent with something to do.

    ``context`` gives the variables that stand for constants, in the order of the arguments of ``start(...)``. The
    plans are labelled ``label_0``, ``label_1`` and so on. Raises PlanningError for a variable that is none.
    """
    return {agent: tuple(map(agentspeak, found)) for agent, found in plans_of(plan, context, label).items()}


def plans_of(plan: Sequence[Stage], context: Mapping[str, str], label: str) -> dict[str, list[Plan]]:
    """As `translate`, before it becomes text."""
    for name in context:
        if not name.isidentifier() or not name[0].isupper():
            raise PlanningError(f"{name!r} is no variable", remedy="write a name that begins with a capital letter")
    translation = _Translation(plan, context)
    agents = dict.fromkeys(agent for stage in plan for agent in stage.agents)
    return {agent: _labelled(translation.plans(agent), label) for agent in agents}


def _labelled(plans: Iterable[Plan], label: str) -> list[Plan]:
    found = list(plans)
    for number, plan in enumerate(found):
        plan.label = f"{label}_{number}"
    return found


class _Translation:
    def __init__(self, plan: Sequence[Stage], context: Mapping[str, str]) -> None:
        self.plan = plan
        self.variables = {constant: Variable(name) for name, constant in reversed(list(context.items()))}
        self.start = literal("start", tuple(map(self.term, context.values())))

    def term(self, constant: str) -> Variable | Atom:
        return self.variables.get(constant) or Atom(constant)

    def named(self, prefix: str, stage: Stage) -> Structure:
        return literal(prefix + stage.action, tuple(map(self.term, stage.args)))

    def plans(self, agent: str) -> list[Plan]:
        mine = [index for index, stage in enumerate(self.plan) if agent in stage.agents]
        begins = [index for index in mine if index == 0 or agent not in self.plan[index - 1].agents]
        triggered = [self.plan[index] for index in begins if index > 0]
        plans: list[Plan] = []
        last: list[Plan] = []
        triggers: set[Stage] = set()
        for index in mine:
            stage = self.plan[index]
            if index == 0:
                plans.append(self.rule(Change.ADDED, "initial_trigger_", stage, self.start, [self.goal(stage)]))
                # Its context holds later on, too, when the same action may come again.
                act = [Update("+", _milestone(0)), Do(self.named("", stage))]
                last.append(self.rule(Change.WANTED, "", stage, self.start, act))
            else:
                if index in begins and stage not in triggers:
                    triggers.add(stage)
                    again = triggered.count(stage) > 1
                    steps = [Update("-", self.named("trigger_", stage)[source(ANYTHING)])] if again else []
                    plans.append(self.rule(Change.ADDED, "trigger_", stage, self.start, [*steps, self.goal(stage)]))
                plans.append(self.rule(Change.WANTED, "", stage, _milestone(index), [Do(self.named("", stage))]))
            plans.append(self.success(agent, index, told=index in begins and index > 0, ends=index == mine[-1]))
        return plans + last

    def success(self, agent: str, index: int, *, told: bool, ends: bool) -> Plan:
        stage = self.plan[index]
        # What others told would stay without their name, and be in the way of the same action later on.
        steps: list[Step] = [Update("-", _milestone(index)[source(ANYTHING)] if told else _milestone(index))]
        context = _milestone(index)
        if index + 1 < len(self.plan):
            after = self.plan[index + 1]
            goes_on = agent in after.agents
            if goes_on:
                steps.append(Update("+", _milestone(index + 1)))
            if agent == next((each for each in stage.agents if each in after.agents), stage.agents[0]):
                for other in after.agents:
                    if other not in stage.agents:
                        steps += self.told(other, index + 1)
            if goes_on:
                steps.append(self.goal(after))
            if goes_on or len(steps) > 1:
                context = self.start & context
        if ends:
            steps.append(Do(END))
        return self.rule(Change.ADDED, "success_", stage, context, steps)

    def told(self, other: str, index: int) -> list[Step]:
        trigger = self.named("trigger_", self.plan[index])
        return [Do(literal(".send", (self.term(other), TELL, what))) for what in (Atom(f"milestone{index}"), trigger)]

    def goal(self, stage: Stage) -> Step:
        return Achieve(self.named("", stage))

    def rule(
        self, change: Change, prefix: str, stage: Stage, context: Structure | Conjunction, steps: list[Step]
    ) -> Plan:
        return Plan(Event(change, self.named(prefix, stage)), conjunction(context), tuple(steps))


def _milestone(index: int) -> Structure:
    return literal(f"milestone{index}")
