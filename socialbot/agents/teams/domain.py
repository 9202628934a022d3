"""`TeamDomain`: the world, roles and missions of a coordinator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from socialbot.core.clock import nanoseconds
from socialbot.planning.htn.domain import Item, TaskState

if TYPE_CHECKING:
    from socialbot.agents.teams.messages import Problem
    from socialbot.agents.teams.missions import Mission
    from socialbot.agents.teams.planning import MissionPlanner

LIMIT_FACTOR, LIMIT_EXTRA_S = 3.0, 10.0


class World(Protocol):
    """Message with the state of a world."""

    @property
    def stamp(self) -> int:
        """Time of the state (ns)."""
        ...


W = TypeVar("W", bound=World)


@dataclass(frozen=True)
class Role:
    """A role of a mission.

    Attributes:
        variable: Variable of the role in AgentSpeak plans, such as ``SpotRobot``.
        needs: Actions that an agent must be able to do.
        is_local: Whether only agents whose home is the target of the mission can play it.
    """

    variable: str
    needs: frozenset[str]
    is_local: bool = False


class MemberState(NamedTuple):
    """An agent as the world shows it.

    Attributes:
        busy: Its action, as ``a_patrol(robot1, room1)``; empty without one.
        home: Place that it belongs to, for local roles.
        is_present: Whether it can work.
        rank: Sort key among free agents; the lowest is chosen first.
        progress: Position, battery or the like: a change shows that the agent is not stuck, however long its way is.
    """

    busy: str = ""
    home: str = ""
    is_present: bool = True
    rank: tuple[Any, ...] = ()
    progress: tuple[Any, ...] = ()


class TeamDomain(ABC, Generic[W]):
    """Missions of one world: when they are needed, who takes part, how they are planned, and when they are done.

    A mission has a kind and a target, such as a room or a book. The coordinator starts one for each target that needs
    it, assigns an agent to each role, plans, and follows the plan. It knows nothing of the world itself.

    Attributes:
        roles: The roles of a mission, in the order of assignment.
        kinds: Kinds of missions with their priorities. The first is started for targets.
        planner: Planner of all missions, unless ``planners`` has one for their kind.
        planners: Planners by kind of mission.
        joint_actions: Actions of all agents in their arguments. The first argument executes any other action.
        repairable: Problems after which a plan can be repaired. After any other one it is made anew.
        blameless: Further problems that are not due to an agent; nobody is set aside for them.
        undone: Problem of a mission whose actions are done while the world shows that it is not.
    """

    roles: tuple[Role, ...]
    kinds: ClassVar[Mapping[str, int]]
    planner: MissionPlanner
    planners: ClassVar[Mapping[str, MissionPlanner]] = {}
    joint_actions: frozenset[str] = frozenset()
    repairable: frozenset[str] = frozenset()
    blameless: frozenset[str] = frozenset()
    undone: str = "the mission is not done"

    # The world

    @abstractmethod
    def targets(self, world: W) -> Iterable[str]:
        """The targets that need a mission now, in the order of their missions."""

    @abstractmethod
    def is_done(self, world: W, target: str) -> bool | None:
        """Whether the world shows that nothing is left to do for a target; None if it does not show it."""

    @abstractmethod
    def member(self, world: W, name: str) -> MemberState | None:
        """An agent as the world shows it; None if it does not."""

    def knows(self, world: W, target: str) -> bool:
        """Whether a mission for a target can be requested."""
        return self.is_done(world, target) is not None

    def hopeless(self, world: W, target: str) -> str:
        """The reason why no mission can ever be done for a target; an empty string if there is none."""
        return ""

    def changed(self, before: W, world: W) -> Collection[str] | None:
        """The targets and agents that may differ between two states; None if all may.

        The coordinator looks only at these again, so that a large world costs little at each state.
        """
        return None

    # Planning

    @abstractmethod
    def state(self, world: W, mission: Mission, *, sees: bool) -> TaskState:
        """State for the planner: the world as observed, and the findings of the agents of a mission.

        Without ``sees``, only reports of agents may tell of obstacles.
        """

    def tasks(self, mission: Mission) -> list[Item]:
        """Tasks of a mission, for planners of task networks."""
        return []

    def variables(self, mission: Mission) -> dict[str, str]:
        """Variables of the plans of a mission with their values, in the order of ``start(...)``."""
        return {**{role.variable: mission.team[role.variable] for role in self.roles}, "Target": mission.target}

    def planner_of(self, mission: Mission) -> MissionPlanner:
        """The planner of a mission."""
        return self.planners.get(mission.kind, self.planner)

    # Progress

    def on_done(self, mission: Mission, item: Item, now: int) -> None:
        """Update the findings of a mission after a finished action, at ``now`` (ns)."""

    def on_problem(self, mission: Mission, problem: Problem, agent: str, now: int) -> None:
        """Update the findings of a mission after a problem of an agent, at ``now`` (ns)."""

    def longest_s(self, action: str) -> float:
        """Longest expected duration of an action (s), with the way to it."""
        return 60.0

    def action_limit(self, action: str) -> int:
        """Time (ns) after which an agent that is busy with an action is stuck in it."""
        return nanoseconds(LIMIT_FACTOR * self.longest_s(action) + LIMIT_EXTRA_S)

    def role(self, variable: str) -> Role | None:
        """The role of a variable."""
        return next((role for role in self.roles if role.variable == variable), None)
