"""Missions of teams: their states, agents and progress."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any, Literal

import msgspec

from socialbot.agents.teams.domain import MemberState, Role, TeamDomain
from socialbot.agents.teams.messages import MissionStatus, MissionView, PlannedAction
from socialbot.agents.teams.translation import stages
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import progressed
from socialbot.planning.htn.tree import TaskNode, TaskTree

_NUMBERED = re.compile(r"(.*?)(\d*)")


@lru_cache(maxsize=10_000)
def by_number(name: str) -> tuple[str, int]:
    """Sort key of a name: its kind, then its number."""
    found = _NUMBERED.fullmatch(name)
    return (found[1], int(found[2] or 0)) if found else (name, 0)


FOREVER = 2**62


class RegisteredAgent(msgspec.Struct):
    """A registered agent with the number of its mission (0: none), and that of its latest one.

    It gets no mission until ``aside_until`` (ns). That is `FOREVER` for an agent that does not answer; any message ends
    it. ``strikes`` counts how often it was set aside since it finished a mission.
    """

    name: str
    kind: str
    capabilities: frozenset[str]
    mission: int = 0
    latest: int = 0
    aside_until: int = 0
    strikes: int = 0


class Mission(msgspec.Struct):
    """State of a mission.

    ``team`` maps roles to agents, ``active`` are the agents that have not finished. ``past`` are actions of abandoned
    plans. Times in ns: ``touched`` of the latest news, ``ended`` of the last agent, ``rests_until`` of the next try.
    ``failed_tries`` counts the teams that could not do it.
    ``found`` are findings of agents with their times. ``failures`` counts the failures of this team. ``lacks`` says
    which roles nobody can play now. ``asked_at`` is when its silent team was asked to answer (0: not asked).
    """

    id: int
    kind: str
    target: str = msgspec.field(name="room")
    priority: int = 0
    status: MissionStatus = "waiting"
    team: dict[str, str] = {}
    active: list[str] = []
    revision: int = 0
    past: list[PlannedAction] = []
    recoveries: int = 0
    revisions: int = 0
    problem: str = ""
    touched: int = 0
    ended: int = 0
    rests_until: int = 0
    failed_tries: int = 0
    found: dict[str, int] = {}
    failures: dict[str, int] = {}
    lacks: str = ""
    asked_at: int = 0

    @property
    def label(self) -> str:
        """Label of its present plans."""
        return f"mission_{self.id}_{self.revision}"


Policy = Literal["auto", "replan", "repair", "none"]


class CoordinatorOptions(msgspec.Struct):
    """Options of the coordinator; see the parameters of `TeamCoordinator`.

    ``policy`` is the reaction to a problem: a new plan for the whole mission (``replan``), a repaired tree
    (``repair``), ``replan`` if more than half of the actions are joint, else ``repair`` (``auto``), or the end of the
    mission (``none``). A ``proactive`` coordinator uses what the world shows, and acts before a problem. Others
    use only reports of agents.
    """

    policy: Policy = "auto"
    proactive: bool = True
    triggers: bool = True
    patience_s: float = 120.0
    rest_s: float = 5.0


class CoordinatorMemory(msgspec.Struct):
    """Persistent state of a coordinator."""

    members: dict[str, RegisteredAgent] = {}
    missions: dict[int, Mission] = {}
    last: int = 0


class CapableAgents:
    """The agents that have all actions of a role, by its variable and their name."""

    def __init__(self, roles: Iterable[Role], members: Iterable[RegisteredAgent]) -> None:
        self._roles = tuple(roles)
        self.by_role: dict[str, dict[str, RegisteredAgent]] = {role.variable: {} for role in self._roles}
        for member in members:
            self.note(member)

    def note(self, member: RegisteredAgent) -> None:
        """Process a new agent, or new capabilities of one."""
        for role in self._roles:
            if role.needs <= member.capabilities:
                self.by_role[role.variable][member.name] = member
            else:
                self.by_role[role.variable].pop(member.name, None)


class AgentHomes:
    """Names of registered agents by their home in the world."""

    def __init__(self, domain: TeamDomain[Any], members: Iterable[str], world: Any) -> None:
        self.names: defaultdict[str, set[str]] = defaultdict(set)
        self._home_of: dict[str, str] = {}
        for name in members:
            self.note(name, domain.member(world, name))

    def note(self, name: str, state: MemberState | None) -> None:
        """Process the state of an agent; None if the world does not show it."""
        old = self._home_of.pop(name, None)
        if old is not None:
            self.names[old].discard(name)
        if state is not None:
            self._home_of[name] = state.home
            self.names[state.home].add(name)


class AgentPool:
    """Registered agents that are present in a state of the world, and not set aside at a time (ns).

    ``capable`` are the agents that have all actions of a role, by its variable; ``homes`` are names of agents by home.
    Without them they are searched.
    """

    def __init__(
        self,
        domain: TeamDomain[Any],
        members: Mapping[str, RegisteredAgent],
        world: Any,
        now: int = 0,
        capable: CapableAgents | None = None,
        homes: Mapping[str, Collection[str]] | None = None,
    ) -> None:
        self._domain = domain
        self._members = members
        self._world = world
        self._now = now
        self._capable = (capable or CapableAgents(domain.roles, members.values())).by_role
        self._homes = AgentHomes(domain, members, world).names if homes is None else homes
        self._able: dict[tuple[str, str], list[RegisteredAgent]] = {}

    def able(self, role: Role, target: str) -> list[RegisteredAgent]:
        """Agents for a role of a mission for ``target``, free or not: by rank, then by number."""
        key = role.variable, target if role.is_local else ""
        if key not in self._able:
            able = [
                ((state.rank, by_number(member.name)), member)
                for member in self._candidates(role, target)
                if member.aside_until <= self._now and (state := self._state(member)) is not None and state.is_present
            ]
            self._able[key] = [member for _, member in sorted(able, key=itemgetter(0))]
        return self._able[key]

    def _candidates(self, role: Role, target: str) -> Collection[RegisteredAgent]:
        if not role.is_local:
            return self._capable[role.variable].values()
        at_home = [self._members[name] for name in self._homes.get(target, ()) if name in self._members]
        return [member for member in at_home if role.needs <= member.capabilities]

    def _state(self, member: RegisteredAgent) -> MemberState | None:
        return self._domain.member(self._world, member.name)

    def team(self, mission: Mission) -> dict[str, str] | None:
        """A free agent for each role, by variable; None if there is no such team."""
        free = [
            [each.name for each in self.able(role, mission.target) if not each.mission] for role in self._domain.roles
        ]
        names = next(_teams(free), None) if all(free) else None
        return None if names is None else dict(zip((role.variable for role in self._domain.roles), names, strict=True))

    def is_short(self) -> bool:
        """Whether a role that is not local has no free agent."""
        return any(
            all(each.mission for each in self.able(role, "")) for role in self._domain.roles if not role.is_local
        )

    def lacking(self, mission: Mission) -> str:
        """Roles of a mission that nobody can play, free or not, with the reason; an empty string if there are none."""
        found = []
        for role in self._domain.roles:
            if self.able(role, mission.target):
                continue
            capable = list(self._capable[role.variable].values())
            if role.is_local:
                states = {each.name: self._state(each) for each in capable}
                capable = [
                    each for each in capable if (state := states[each.name]) is None or state.home == mission.target
                ]
            reasons = [self._absence(each) for each in sorted(capable, key=lambda each: by_number(each.name))]
            found.append(f"nobody for {role.variable} ({'; '.join(reasons) or 'no such agent is registered'})")
        return ", ".join(found)

    def _absence(self, member: RegisteredAgent) -> str:
        if member.aside_until == FOREVER:
            return f"{member.name} does not answer"
        if member.aside_until > self._now:
            return f"{member.name} is set aside after a failure"
        return f"{member.name} is away" if self._state(member) is not None else f"nothing is known of {member.name}"

    def yielding(self, mission: Mission, missions: Mapping[int, Mission]) -> list[Mission]:
        """Missions of lower priority that must yield to give this one a team, latest first; empty if impossible."""
        chosen: dict[int, Mission] = {}
        taken: set[str] = set()
        for role in self._domain.roles:
            able = [each for each in self.able(role, mission.target) if each.name not in taken]
            free = next((each for each in able if not each.mission or each.mission in chosen), None)
            if free is None:
                lower = [each for each in able if missions[each.mission].priority < mission.priority]
                if not lower:
                    return []
                free = min(lower, key=lambda each: (missions[each.mission].priority, -each.mission))
                chosen[free.mission] = missions[free.mission]
            taken.add(free.name)
        return list(chosen.values())


def _teams(free: Sequence[Sequence[str]], taken: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """All teams with a different agent in each role, the first agents of the roles first."""
    if len(taken) == len(free):
        yield taken
        return
    for name in free[len(taken)]:
        if name not in taken:
            yield from _teams(free, (*taken, name))


class PlanProgress:
    """Progress of the plan of a task tree for a team.

    Attributes:
        agenda: Actions as nodes of the tree.
        stages: The same actions with their agents.
        position: Number of finished actions.
        revised_for: Position and state of the latest revision.
        doubted_since: Time (ns) of the first doubt about the plan.
    """

    def __init__(self, tree: TaskTree, team: Iterable[str], joint: Iterable[str]) -> None:
        self.tree = tree
        self.agenda = tree.plan
        self.stages = stages([node.item for node in self.agenda], tuple(team), joint)
        self.position = 0
        self.revised_for: tuple[int, TaskState] | None = None
        self.doubted_since: int | None = None
        self.busy_since: dict[str, tuple[str, int]] = {}
        """Action that each agent is busy with, as the world shows it, and since when (ns)."""
        self.seen: dict[str, tuple[Any, ...]] = {}
        """Latest progress of each agent, as the world shows it."""
        self.moved_at = 0
        """Time (ns) of the latest progress of an agent of the team."""
        self._reached: dict[str, int] = {}
        """Number of finished actions, by agent."""

    @property
    def next(self) -> TaskNode | None:
        """The action in progress, or the next one."""
        return self.agenda[self.position] if self.position < len(self.agenda) else None

    @property
    def acting(self) -> tuple[str, ...]:
        """Agents of the action in progress, or of the next one."""
        return self.stages[self.position].agents if self.position < len(self.stages) else ()

    @property
    def left(self) -> list[Item]:
        """The actions that are not known to be done."""
        return [node.item for node in self.agenda[self.position :]]

    @property
    def joint_share(self) -> float:
        """Share of joint actions, 0 to 1."""
        return sum(len(stage.agents) > 1 for stage in self.stages) / max(len(self.stages), 1)

    def find(self, agent: str, item: Item) -> int | None:
        """Index of an action among those that the agent is not known to have done."""
        ahead = range(self._reached.get(agent, 0), len(self.agenda))
        return next((index for index in ahead if self.agenda[index].item == item), None)

    def advance(self, agent: str, item: Item) -> bool:
        """Record that an agent has done an action; returns whether the plan advances.

        All partners report a joint action, and the same action may occur twice.
        """
        index = self.find(agent, item)
        if index is None:
            return False
        self._reached[agent] = index + 1
        if index < self.position:
            return False
        self.position = index + 1
        return True

    def fail(self, agent: str, item: Item) -> TaskNode | None:
        """Set the position to the failed action of an agent, if the plan has it; returns the next action."""
        index = self.find(agent, item)
        if index is not None:
            self.position = index
        return self.next

    def drawing(self) -> str:
        """The task tree with its progress."""
        if not self.agenda:
            return str(self.tree)
        upcoming, status = (self.next, "planned") if self.next else (self.agenda[-1], "done")
        return str(progressed(self.tree, upcoming, status))

    def executed(self, *, failed: bool = False) -> list[PlannedAction]:
        """The finished actions, and with ``failed`` the present one, which has failed."""
        done = [msgspec.structs.replace(stage, status="done") for stage in self.stages[: self.position]]
        present = self.stages[self.position : self.position + 1] if failed else ()
        return done + [msgspec.structs.replace(stage, status="failed") for stage in present]

    def actions(self) -> list[PlannedAction]:
        """The actions with their status."""
        return [*self.executed(), *self.stages[self.position :]]


def view(mission: Mission, progress: PlanProgress | None) -> MissionView:
    """The published state of a mission."""
    return MissionView(
        id=mission.id,
        kind=mission.kind,
        target=mission.target,
        priority=mission.priority,
        status=mission.status,
        team=tuple(mission.team.values()),
        label=mission.label,
        actions=(*mission.past, *(progress.actions() if progress else ())),
        tree=progress.drawing() if progress else "",
        recoveries=mission.recoveries,
        revisions=mission.revisions,
        problem=mission.lacks or mission.problem,
    )
