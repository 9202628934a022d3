"""Tasks of a disinfection, and the translation of their plans to AgentSpeak."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from socialbot.agents.hospital.messages import PlannedAction
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import ANYTHING, Change, Event, Structure, literal, source
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Achieve, Do, Step, Update
from socialbot.bdi.terms import Atom, Conjunction, Variable, conjunction
from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item, TaskDomain, TaskState

DISINFECT = TaskDomain("disinfect")


def mission(spot: str, uvd: str, nurse: str) -> Item:
    """The task to patrol the room of ``nurse`` with ``spot`` and to disinfect it with ``uvd``."""
    return ("m_patrol_and_disinfect", spot, uvd, nurse)


def ward(nurses: Mapping[str, str], robots: Iterable[str], waiting_room: str) -> TaskState:
    """Initial state: nurses in clean rooms, closed doors, and charged robots in the waiting room."""
    robots = list(robots)
    return TaskState(
        "ward",
        loc={**nurses, **dict.fromkeys(robots, waiting_room)},
        doors=dict.fromkeys(nurses.values(), False),
        cleaned=dict.fromkeys(nurses.values(), True),
        disinfected=dict.fromkeys(nurses.values(), True),
        low_battery=dict.fromkeys(robots, False),
        authenticated={},
    )


@DISINFECT.action
def a_navigate_to(state: TaskState, agent: str, room: str) -> TaskState | None:
    """Move to the room, or to its closed door, with a charged battery."""
    if state.low_battery.get(agent):
        return None
    state.loc[agent] = room
    return state


@DISINFECT.action
def a_open_door(state: TaskState, agent: str, room: str) -> TaskState:
    """Open the door."""
    state.doors[room] = True
    return state


@DISINFECT.action
def a_approach_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """Approach the nurse in the room."""
    return state


@DISINFECT.action
def a_authenticate_nurse(state: TaskState, spot: str, nurse: str) -> TaskState:
    """Robot and nurse authenticate each other."""
    state.authenticated[spot] = nurse
    return state


@DISINFECT.action
def a_authorize_patrol(state: TaskState, spot: str, nurse: str) -> TaskState:
    """The nurse permits one patrol."""
    state.authenticated.pop(spot, None)
    return state


@DISINFECT.action
def a_patrol_room(state: TaskState, spot: str, room: str) -> TaskState:
    """Check whether the room is fit for disinfection."""
    return state


@DISINFECT.action
def a_adapt_room(state: TaskState, nurse: str, room: str) -> TaskState:
    """The nurse tidies the room, and sends people out."""
    state.cleaned[room] = True
    return state


@DISINFECT.action
def a_authorize_disinfect(state: TaskState, uvd: str, spot: str) -> TaskState:
    """The patrol robot reports an empty room."""
    return state


@DISINFECT.action
def a_disinfect_room(state: TaskState, uvd: str, room: str) -> TaskState:
    """Disinfect with ultraviolet light."""
    state.disinfected[room] = True
    return state


@DISINFECT.action
def a_charge(state: TaskState, robot: str) -> TaskState:
    """Charge the battery."""
    state.low_battery[robot] = False
    return state


@DISINFECT.method("m_patrol_and_disinfect")
def infected(state: TaskState, spot: str, uvd: str, nurse: str) -> list[Item] | None:
    """For an infected room: meet the nurse, patrol, disinfect."""
    if state.disinfected[state.loc[nurse]]:
        return None
    return [
        ("m_approach_nurse", spot, nurse),
        ("m_patrol_room", spot, nurse),
        ("m_disinfect_room", uvd, spot, nurse),
    ]


@DISINFECT.method("m_approach_nurse")
def door_open(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Enter the room."""
    room = state.loc[nurse]
    if not state.doors[room]:
        return None
    return [("m_go", spot, room), ("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_approach_nurse")
def door_closed(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Open the door first."""
    room = state.loc[nurse]
    if state.doors[room]:
        return None
    return [
        ("m_go", spot, room),
        ("a_open_door", spot, room),
        ("a_approach_nurse", spot, nurse),
        ("a_authenticate_nurse", spot, nurse),
    ]


@DISINFECT.method("m_patrol_room")
def allowed_by_nurse(state: TaskState, spot: str, nurse: str) -> list[Item]:
    """The nurse tidies the room if necessary, and permits the patrol."""
    return [
        ("m_adapt_room", nurse),
        ("m_meet_nurse", spot, nurse),
        ("a_authorize_patrol", spot, nurse),
        ("a_patrol_room", spot, state.loc[nurse]),
    ]


@DISINFECT.method("m_disinfect_room")
def patrolled(state: TaskState, uvd: str, spot: str, nurse: str) -> list[Item] | None:
    """Admit the other robot to a tidy room. There is no method for a dirty one."""
    room = state.loc[nurse]
    if not state.cleaned[room]:
        return None
    return [("a_authorize_disinfect", uvd, spot), ("m_go", uvd, room), ("a_disinfect_room", uvd, room)]


@DISINFECT.method("m_adapt_room")
def untidy(state: TaskState, nurse: str) -> list[Item] | None:
    """The nurse tidies the room."""
    room = state.loc[nurse]
    return None if state.cleaned[room] else [("a_adapt_room", nurse, room)]


@DISINFECT.method("m_adapt_room")
def tidy(state: TaskState, nurse: str) -> list[Item]:
    """Nothing to tidy."""
    return []


@DISINFECT.method("m_meet_nurse")
def far_away(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Return to the nurse, with a charge if necessary."""
    if state.loc[spot] == state.loc[nurse] and not state.low_battery[spot]:
        return None
    return [("m_approach_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def unknown(state: TaskState, spot: str, nurse: str) -> list[Item] | None:
    """Authenticate again in the room."""
    if state.authenticated.get(spot) == nurse:
        return None
    return [("a_approach_nurse", spot, nurse), ("a_authenticate_nurse", spot, nurse)]


@DISINFECT.method("m_meet_nurse")
def known(state: TaskState, spot: str, nurse: str) -> list[Item]:
    """The permission is still valid."""
    return []


@DISINFECT.method("m_go")
def battery_low(state: TaskState, robot: str, room: str) -> list[Item] | None:
    """Charge first."""
    return [("a_charge", robot), ("a_navigate_to", robot, room)] if state.low_battery[robot] else None


@DISINFECT.method("m_go")
def battery_full(state: TaskState, robot: str, room: str) -> list[Item]:
    """Go at once."""
    return [("a_navigate_to", robot, room)]


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
