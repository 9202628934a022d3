"""Manage missions: assign agents, send plans, end missions, and recover from failures."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable
from typing import Literal

from socialbot.agents.hospital.messages import AnyContent, Belief, End, Performative, Plan, Start, Stop
from socialbot.agents.hospital.missions import (
    NURSE,
    AgentPool,
    CoordinatorMemory,
    CoordinatorOptions,
    Mission,
    MissionViewCache,
    PlanProgress,
    state_of,
)
from socialbot.agents.hospital.plans import DISINFECT as DOMAIN
from socialbot.agents.hospital.plans import initial_triggers, translate
from socialbot.agents.hospital.ward.messages import (
    AWAY,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    WardState,
)
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskAnswer, TaskNode, TaskVerdict

log = logging.getLogger("socialbot.coordinator")

Send = Callable[[str, Performative, AnyContent, str, str], object]
"""Send a message: receiver, performative, content, label of the mission, id of the message that it answers."""


class MissionManager:
    """Missions, their teams, and the plans of running missions. Times are ns."""

    def __init__(self, send: Send, options: CoordinatorOptions, memory: CoordinatorMemory) -> None:
        self.send = send
        self.options = options
        self.memory = memory
        self.progress_of: dict[int, PlanProgress] = {}
        self.view_cache = MissionViewCache()
        self.ward: WardState | None = None
        self.now = 0
        self.planner = TaskPlanner(DOMAIN)
        self.planning_s: deque[float] = deque(maxlen=10_000)
        self._may_form = True
        """Whether an agent or mission became free since the last attempt to form teams."""

    # Missions

    def begin(self, kind: str, room: str) -> Mission:
        """Create a mission, which waits for a team."""
        self.memory.last += 1
        mission = self.memory.missions[self.memory.last] = Mission(self.memory.last, kind, room)
        self.await_team(mission)
        return mission

    def open_in(self, room: str) -> Mission | None:
        """The open mission in a room."""
        return next((mission for mission in self.memory.missions.values() if mission.room == room), None)

    def suspend(self, mission: Mission, why: str, *, rest: bool = True) -> None:
        """Make a mission wait for another team, by default after a rest; its team is free."""
        log.info("mission %d waits: %s", mission.id, why)
        self._dismiss(mission, Stop(why))
        mission.status, mission.problem = "waiting", why
        mission.rests_until = self.now + nanoseconds(self.options.rest_s) if rest else 0
        mission.authenticated = False
        mission.failures.clear()
        self.await_team(mission)

    def finish(self, mission: Mission, status: Literal["finished", "failed"] = "finished") -> None:
        """End a mission; its team is free."""
        mission.status = status
        self.view_cache.close(mission, self.progress_of.get(mission.id))
        self._dismiss(mission, End())
        self.memory.missions.pop(mission.id)

    def _dismiss(self, mission: Mission, word: Stop | End) -> None:
        for name in list(mission.active):
            self.send(name, "request", word, mission.label, "")
            self.release(mission, name)
        self.abandon_plan(mission)

    # Teams

    def await_team(self, mission: Mission | None = None) -> None:
        """Form teams at the next call of `form_teams`: an agent, or ``mission``, is free now."""
        self._may_form = True
        if mission is not None:
            self.view_cache.redraw(mission)

    def release(self, mission: Mission, name: str) -> None:
        if name in mission.active:
            mission.active.remove(name)
        member = self.memory.members.get(name)
        if member is not None and member.mission == mission.id:
            member.mission = 0
        self.await_team(mission)

    def has_team(self, mission: Mission) -> bool:
        """Whether all agents of the team are registered, and work for no other mission."""
        members = (self.memory.members.get(name) for name in mission.team.values())
        return all(member is not None and member.mission in (0, mission.id) for member in members)

    def form_teams(self) -> None:
        """Assign free agents to waiting missions, by priority."""
        if self.ward is None or not self._may_form:
            return
        self._may_form = False
        missions = self.memory.missions.values()
        waiting = [each for each in missions if each.status == "waiting" and each.rests_until <= self.now]
        pool = AgentPool(self.memory.members, self.ward)
        short: set[str] = set()
        for mission in sorted(waiting, key=lambda each: (-each.priority, each.id)):
            if mission.kind in short:
                continue
            lacks = pool.is_short(mission.kind)
            team = None if lacks else pool.team(mission)
            if team is None and self._take_from_others(mission, pool):
                team = pool.team(mission)
            if team is not None:
                mission.team = team
                mission.found.clear()
                self.go(mission, self.plan(mission))
            elif lacks:
                short.add(mission.kind)

    def _take_from_others(self, mission: Mission, pool: AgentPool) -> bool:
        """Make missions of lower priority wait if that gives this one a team; returns whether there are any."""
        missions = self.memory.missions
        if all(other.priority >= mission.priority for other in missions.values()):
            return False
        yielding = pool.yielding(mission, missions)
        for other in yielding:
            self.suspend(other, f"mission {mission.id} is more urgent", rest=False)
        return bool(yielding)

    # Plans

    def state(self, mission: Mission, *, sees_rooms: bool) -> TaskState:
        assert self.ward is not None
        return state_of(self.ward, mission, sees_rooms=sees_rooms)

    def plan(self, mission: Mission) -> TaskAnswer:
        """A plan for the whole mission from its present state."""
        return self.timed(self.planner.plan(self.state(mission, sees_rooms=self.options.proactive), mission.tasks()))

    def timed(self, answer: TaskAnswer) -> TaskAnswer:
        self.planning_s.append(answer.seconds)
        return answer

    def go(self, mission: Mission, answer: TaskAnswer) -> None:
        """Start a plan; without a plan the mission waits."""
        if answer.verdict is not TaskVerdict.PLAN or answer.tree is None:
            self.suspend(mission, answer.message)
            return
        progress = self.progress_of[mission.id] = PlanProgress.of(answer.tree, mission.team.values())
        mission.status = "running"
        mission.revision += 1
        mission.touched = self.now
        self._send(mission, progress)
        self.view_cache.redraw(mission)

    def _send(self, mission: Mission, progress: PlanProgress) -> None:
        """Send each agent its part of a plan, and release agents without one."""
        parts = translate(progress.stages, mission.context(), mission.label)
        for name in mission.team.values():
            if name not in parts and name in mission.active:
                self.send(name, "request", Stop("nothing is left to do"), mission.label, "")
                self.release(mission, name)
        mission.active = [name for name in mission.team.values() if name in parts]
        for name in mission.active:
            self.memory.members[name].mission = mission.id
            self.send(name, "inform", Plan(mission.label, parts[name]), mission.label, "")
        arguments = tuple(mission.context().values())
        for name in mission.active:
            self.send(name, "request", Start(arguments), mission.label, "")
        for name, trigger in initial_triggers(progress.stages).items():
            self.send(name, "inform", Belief(trigger), mission.label, "")

    def abandon_plan(self, mission: Mission, *, failed: bool = False) -> None:
        """Abandon the plan of a mission, and keep the status of its actions."""
        progress = self.progress_of.pop(mission.id, None)
        if progress is not None:
            mission.past += [each for each in progress.actions(failed=failed) if each.status != "planned"]


MOSTLY_JOINT = 0.5
"""Plans with a larger share of joint actions are replaced, not repaired."""
MENDED = (DIRTY_ROOM, PERSON_IN_ROOM, LOW_BATTERY, NURSE_ABSENT)
"""Problems that the task methods can solve. Any other one, such as a door, needs a new plan."""
SAME_FAILURES = 3
"""Number of repetitions of a failure after which the mission waits."""
SETTLED_NS = SECOND // 10
"""Time for which the ward must contradict a plan before a revision; it doubles with each revision."""


class Recovery:
    """Recovers missions from problems, and revises plans before problems."""

    def __init__(self, manager: MissionManager) -> None:
        self.manager = manager
        self.given_up: set[str] = set()
        """Rooms of failed missions."""

    # After a problem

    def recover(self, mission: Mission, problem: str, agent: str = "", failed: Item = ()) -> None:
        """Replan or repair a mission after a problem, or end it if that is the policy.

        ``failed`` is the action of ``agent`` that met the problem, if any.
        """
        manager = self.manager
        log.info("mission %d: %s", mission.id, problem)
        mission.problem = problem
        progress = manager.progress_of.get(mission.id)
        node = progress.fail(agent, failed) if progress and failed else None
        if manager.options.policy == "none":
            manager.abandon_plan(mission, failed=node is not None)
            self.given_up.add(mission.room)
            manager.finish(mission, "failed")
            return
        mission.recoveries += 1
        again = mission.failures.get(key := " ".join((problem, *failed)), 0)
        mission.failures[key] = again + 1
        if not self._can_go_on(mission, again):
            manager.abandon_plan(mission, failed=node is not None)
            manager.suspend(mission, problem)
            return
        mends = problem in MENDED and not again
        answer = self._repair(mission, progress, node) if progress and node and mends else None
        answer = answer or manager.plan(mission)
        manager.abandon_plan(mission, failed=node is not None)
        manager.go(mission, answer)

    def _can_go_on(self, mission: Mission, again: int) -> bool:
        """Whether the team is complete and its nurse present, and the failure is not repeated too often."""
        ward = self.manager.ward
        if ward is None or again >= SAME_FAILURES or not self.manager.has_team(mission):
            return False
        nurse = ward.agent(mission.team[NURSE])
        return nurse is None or nurse.place != AWAY

    def _repair(self, mission: Mission, progress: PlanProgress, failed: TaskNode) -> TaskAnswer | None:
        """A repaired plan, if the policy allows one and it does not start with the failed action."""
        manager, policy = self.manager, self.manager.options.policy
        if policy == "replan" or (policy == "auto" and progress.joint_share > MOSTLY_JOINT):
            return None
        state = manager.state(mission, sees_rooms=manager.options.proactive)
        answer = manager.timed(manager.planner.replan(state, progress.tree, failed.id))
        usable = answer.verdict is TaskVerdict.PLAN and answer.plan[0].item != failed.item
        return answer if usable else None

    # Before a problem

    def look_ahead(self, mission: Mission) -> None:
        """Revise a plan that the present ward contradicts. A plan with more actions than necessary stays."""
        manager = self.manager
        progress, ward = manager.progress_of[mission.id], manager.ward
        upcoming = progress.next
        if ward is None or upcoming is None or ward.stamp < mission.touched or ward.room(mission.room) is None:
            return
        if any(ward.agent(name) is None for name in mission.team.values()):
            return
        state = manager.state(mission, sees_rooms=True)
        if progress.revised_for != (progress.position, state):
            progress.revised_for, progress.doubted_since = (progress.position, state), None
        elif progress.doubted_since is None or manager.now - progress.doubted_since < SETTLED_NS << min(
            mission.revisions, 10
        ):
            return
        answer = manager.timed(manager.planner.revise(state, progress.tree, upcoming.id))
        if answer.verdict is not TaskVerdict.PLAN or _is_within([node.item for node in answer.plan], progress.left):
            return
        if progress.doubted_since is None:
            # The ward may show a finished action before its report arrives.
            progress.doubted_since = manager.now
        elif not manager.has_team(mission):
            manager.suspend(mission, "the team is needed again")
        else:
            log.info("mission %d is revised", mission.id)
            mission.revisions += 1
            manager.abandon_plan(mission)
            manager.go(mission, answer)


def _is_within(items: Iterable[Item], plan: Iterable[Item]) -> bool:
    """Whether ``items`` is a subsequence of ``plan``."""
    left = iter(plan)
    return all(item in left for item in items)
