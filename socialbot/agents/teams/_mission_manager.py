"""Manage missions: assign agents, send plans, recover from problems, and end missions."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal

from socialbot.agents.teams import messages as acl
from socialbot.agents.teams.domain import TeamDomain
from socialbot.agents.teams.messages import MissionView
from socialbot.agents.teams.missions import (
    FOREVER,
    AgentHomes,
    AgentPool,
    CapableAgents,
    CoordinatorMemory,
    CoordinatorOptions,
    Mission,
    PlanProgress,
    RegisteredAgent,
    view,
)
from socialbot.agents.teams.translation import initial_triggers, translate
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.tree import TaskAnswer, TaskNode, TaskVerdict

log = logging.getLogger("socialbot.coordinator")

Send = Callable[[str, acl.Performative, acl.AnyContent, str, str], object]
"""Send a message: receiver, performative, content, label of the mission, id of the message that it answers."""

SHOWN = 20
"""Largest number of ended missions that are published."""
MOSTLY_JOINT = 0.5
"""Plans with a larger share of joint actions are replaced, not repaired."""
SAME_FAILURES = 3
"""Number of repetitions of a failure after which the mission waits."""
ANSWER_NS = 5 * SECOND
"""Time in which an agent must answer whether it is there."""
ASIDE_NS = 60 * SECOND
"""Time for which an agent that is stuck or fails is set aside; it doubles with each time in a row."""
MOST_STRIKES = 6
LACKS_EVERY_NS = SECOND // 2
"""Period of the search for roles that nobody can play; longer if more missions than `OFTEN_NOTED` wait."""
OFTEN_NOTED = 30
SETTLED_NS = SECOND // 10
"""Time for which the world must contradict a plan before a revision; it doubles with each revision."""


class MissionManager:
    """Missions, their teams, and the plans of running missions. Times are ns.

    Attributes:
        progress_of: Progress of the running missions, by number.
        heard: Time of the latest message of each agent.
        given_up: Targets of failed missions.
        world: Latest state of the world.
        planning_s: Durations of the latest plannings.
        changed: Whether a mission changed since this was set to False.
    """

    def __init__(
        self, domain: TeamDomain[Any], send: Send, options: CoordinatorOptions, memory: CoordinatorMemory
    ) -> None:
        self.domain = domain
        self.send = send
        self.options = options
        self.memory = memory
        self.progress_of: dict[int, PlanProgress] = {}
        self.heard: dict[str, int] = {}
        self.given_up: set[str] = set()
        self.planning_s: deque[float] = deque(maxlen=10_000)
        self.changed = True
        self.world: Any = None
        self.unchecked: set[str] | None = None
        """Targets whose missions began, waited again or ended since the latest state; None for all."""
        self.now = 0
        self._may_form = True
        """Whether an agent or mission became free since the last attempt to form teams."""
        self._lacks_noted_at = -LACKS_EVERY_NS
        self._lacks_every_ns = LACKS_EVERY_NS
        self._capable: CapableAgents | None = None
        self._homes: AgentHomes | None = None
        """Homes of agents in the present world."""
        self._ended: deque[MissionView] = deque(maxlen=SHOWN)
        self._views: dict[int, MissionView] = {}
        """Published states of open missions."""
        self._redrawn: dict[int, None] = dict.fromkeys(memory.missions)
        """Open missions that have changed since."""

    # Missions

    def begin(self, kind: str, target: str) -> Mission:
        """Create a mission, which waits for a team."""
        self.memory.last += 1
        mission = Mission(self.memory.last, kind, target, self.domain.kinds[kind])
        self.memory.missions[mission.id] = mission
        self._check_again(mission)
        self.await_team(mission)
        return mission

    def suspend(self, mission: Mission, why: str, *, rest: bool = True) -> None:
        """Make a mission wait for another team, by default after a rest; its team is free."""
        log.info("mission %d waits: %s", mission.id, why)
        self._dismiss(mission, acl.Stop(why))
        mission.status, mission.problem = "waiting", why
        mission.rests_until = self.now + nanoseconds(self.options.rest_s) if rest else 0
        mission.failed_tries += rest
        mission.found.clear()
        mission.failures.clear()
        self._check_again(mission)
        self.await_team(mission)

    def finish(self, mission: Mission, status: Literal["finished", "failed"] = "finished") -> None:
        """End a mission; its team is free."""
        mission.status = status
        if status == "finished":
            for name in mission.team.values():
                if name in self.memory.members:
                    self.memory.members[name].strikes = 0
        self._ended.append(view(mission, self.progress_of.get(mission.id)))
        self._dismiss(mission, acl.End())
        self._check_again(mission)
        self.redraw(self.memory.missions.pop(mission.id))

    def give_up(self, mission: Mission, problem: str) -> None:
        """End a mission that cannot be done."""
        log.warning("mission %d is given up: %s", mission.id, problem)
        mission.problem, mission.lacks = problem, ""
        self._abandon_plan(mission)
        self.finish(mission, "failed")

    def _dismiss(self, mission: Mission, content: acl.Stop | acl.End) -> None:
        for name in list(mission.active):
            self.send(name, "request", content, mission.label, "")
            self.release(mission, name)
        self._abandon_plan(mission)

    def redraw(self, mission: Mission) -> None:
        """Publish the changed state of a mission."""
        self._redrawn[mission.id] = None
        self.changed = True

    def views(self) -> Iterator[MissionView]:
        """The latest ended missions in the order of their end, then the others."""
        for number in self._redrawn:
            mission = self.memory.missions.get(number)
            if mission is None:
                self._views.pop(number, None)
            else:
                self._views[number] = view(mission, self.progress_of.get(number))
        self._redrawn.clear()
        return iter((*self._ended, *self._views.values()))

    # World

    def observe(self, world: Any) -> set[str] | None:
        """Process a state of the world; returns the targets and agents to look at, or None for all."""
        before, self.world = self.world, world
        changed = None if before is None else self.domain.changed(before, world)
        if changed is None:
            self._homes = None
        elif self._homes is not None:
            for name in changed:
                if name in self.memory.members:
                    self._homes.note(name, self.domain.member(world, name))
        checked = None if changed is None or self.unchecked is None else self.unchecked.union(changed)
        self.unchecked = set()
        return checked

    def _check_again(self, mission: Mission) -> None:
        if self.unchecked is not None:
            self.unchecked.add(mission.target)

    # Teams

    def await_team(self, mission: Mission | None = None) -> None:
        """Form teams at the next call of `form_teams`: an agent, or ``mission``, is free now."""
        self._may_form = True
        if mission is not None:
            self.redraw(mission)

    def release(self, mission: Mission, name: str) -> None:
        if name in mission.active:
            mission.active.remove(name)
        member = self.memory.members.get(name)
        if member is not None and member.mission == mission.id:
            member.mission = 0
        self.await_team(mission)

    def _has_team(self, mission: Mission) -> bool:
        """Whether all agents of the team are registered, not set aside, and work for no other mission."""
        members = (self.memory.members.get(name) for name in mission.team.values())
        return all(
            member is not None and member.mission in (0, mission.id) and member.aside_until <= self.now
            for member in members
        )

    def form_teams(self) -> None:
        """Assign free agents to waiting missions: by priority, then those that failed less often."""
        if self.world is None or not self._may_form:
            return
        self._may_form = False
        pool, least = self._pool(), min(self.domain.kinds.values())
        is_due = self.now - self._lacks_noted_at >= self._lacks_every_ns
        everything = is_due or not pool.is_short()
        waiting = [
            each
            for each in self.memory.missions.values()
            if each.status == "waiting" and each.rests_until <= self.now and (everything or each.priority > least)
        ]
        if waiting and is_due:
            self._lacks_noted_at = self.now
            self._lacks_every_ns = LACKS_EVERY_NS * max(1, len(waiting) // OFTEN_NOTED)
            for mission in waiting:
                self._note_lack(mission, pool.lacking(mission))
        for mission in sorted(waiting, key=lambda each: (-each.priority, each.failed_tries, each.id)):
            is_short = pool.is_short()
            team = None if is_short else pool.team(mission)
            if team is None and self._take_from_others(mission, pool):
                team = pool.team(mission)
            if team is not None:
                mission.team = team
                mission.found.clear()
                self._go(mission, self._plan(mission))
            elif is_short:
                break

    def on_registered(self, member: RegisteredAgent) -> None:
        """Process a new agent, or new capabilities of one."""
        if self._capable is not None:
            self._capable.note(member)
        if self._homes is not None:
            self._homes.note(member.name, self.domain.member(self.world, member.name))
        self.changed = True
        self.await_team()

    def _pool(self) -> AgentPool:
        if self._capable is None:
            self._capable = CapableAgents(self.domain.roles, self.memory.members.values())
        if self._homes is None:
            self._homes = AgentHomes(self.domain, self.memory.members, self.world)
        return AgentPool(self.domain, self.memory.members, self.world, self.now, self._capable, self._homes.names)

    def _note_lack(self, mission: Mission, lacks: str) -> None:
        if mission.lacks != lacks:
            mission.lacks = lacks
            if lacks:
                log.warning("mission %d waits: %s", mission.id, lacks)
            self.redraw(mission)

    def _take_from_others(self, mission: Mission, pool: AgentPool) -> bool:
        """Make missions of lower priority wait if that gives this one a team; returns whether there are any."""
        if mission.priority == min(self.domain.kinds.values()):
            return False
        yielding = pool.yielding(mission, self.memory.missions)
        for other in yielding:
            self.suspend(other, f"mission {mission.id} is more urgent", rest=False)
        return bool(yielding)

    # Plans

    def _state(self, mission: Mission, *, sees: bool) -> TaskState:
        return self.domain.state(self.world, mission, sees=sees)

    def _plan(self, mission: Mission) -> TaskAnswer:
        """A plan for the whole mission from its present state."""
        state, planner = self._state(mission, sees=self.options.proactive), self.domain.planner_of(mission)
        return self._timed(planner.plan(mission, state, self.domain.tasks(mission)))

    def _timed(self, answer: TaskAnswer) -> TaskAnswer:
        self.planning_s.append(answer.seconds)
        return answer

    def _go(self, mission: Mission, answer: TaskAnswer) -> None:
        """Start a plan; without a plan the mission waits."""
        if answer.verdict is not TaskVerdict.PLAN or answer.tree is None:
            self.suspend(mission, answer.message)
            return
        progress = PlanProgress(answer.tree, mission.team.values(), self.domain.joint_actions)
        if not progress.stages:
            self.suspend(mission, "the plan is empty, but the world does not show that the mission is done")
            return
        self.progress_of[mission.id] = progress
        mission.status = "running"
        mission.lacks, mission.asked_at = "", 0
        mission.revision += 1
        mission.touched = self.now
        self._send(mission, progress)
        self.redraw(mission)

    def _send(self, mission: Mission, progress: PlanProgress) -> None:
        """Send each agent its part of a plan, and release agents without one."""
        label = mission.label
        variables = self.domain.variables(mission)
        parts = translate(progress.stages, variables, label)
        for name in mission.team.values():
            if name not in parts and name in mission.active:
                self.send(name, "request", acl.Stop("nothing is left to do"), label, "")
                self.release(mission, name)
        mission.active = [name for name in mission.team.values() if name in parts]
        for name in mission.active:
            self.memory.members[name].mission = self.memory.members[name].latest = mission.id
            self.send(name, "inform", acl.Plan(label, parts[name]), label, "")
        arguments = tuple(variables.values())
        for name in mission.active:
            self.send(name, "request", acl.Start(arguments), label, "")
        for name, trigger in initial_triggers(progress.stages).items():
            self.send(name, "inform", acl.Belief(trigger), label, "")

    def _abandon_plan(self, mission: Mission, *, failed: bool = False) -> None:
        """Abandon the plan of a mission, and keep the status of its actions."""
        progress = self.progress_of.pop(mission.id, None)
        if progress is not None:
            mission.past += progress.executed(failed=failed)

    # Lost and stuck agents

    def follow_busy(self, mission: Mission) -> None:
        """Wait for agents that are busy with an action, and replace those that are busy with it for too long."""
        progress, domain, world = self.progress_of[mission.id], self.domain, self.world
        states = {name: domain.member(world, name) for name in mission.active}
        for name, agent in states.items():
            if agent is not None and progress.seen.get(name) != agent.progress:
                progress.seen[name], progress.moved_at = agent.progress, world.stamp
        for name, agent in states.items():
            if agent is None or not agent.busy:
                progress.busy_since.pop(name, None)
                continue
            busy, since = progress.busy_since.get(name, ("", 0))
            if busy != agent.busy:
                since = world.stamp
                progress.busy_since[name] = (agent.busy, since)
            action = agent.busy.partition("(")[0]
            if world.stamp - max(since, progress.moved_at) <= domain.action_limit(action):
                mission.touched = max(mission.touched, world.stamp)
                continue
            stuck = sorted(other for other, state in states.items() if state and state.busy == busy)
            self._replace(mission, stuck, f"{' and '.join(stuck)} is stuck in {action}")
            return

    def doubt(self, mission: Mission) -> None:
        """Ask a team without news whether it is there; then replace agents that do not answer, or do not go on."""
        if not mission.asked_at:
            mission.asked_at = self.now
            for name in mission.active:
                self.send(name, "query", acl.Register(), "", "")
        elif self.now - mission.asked_at >= ANSWER_NS:
            asked_at, mission.asked_at = mission.asked_at, 0
            lost = [name for name in mission.active if self.heard.get(name, 0) < asked_at]
            if lost:
                for name in lost:
                    self.memory.members[name].aside_until = FOREVER
                self.recover(mission, f"{' and '.join(lost)} does not answer")
            else:
                self._replace(mission, self.progress_of[mission.id].acting, "no news")

    def _replace(self, mission: Mission, names: Iterable[str], problem: str) -> None:
        self._set_aside(mission, names)
        self.recover(mission, problem)

    def _set_aside(self, mission: Mission, names: Iterable[str]) -> None:
        """Set aside those agents that somebody else can replace."""
        if self.world is None:
            return
        pool = self._pool()
        roles = {name: role for role, name in mission.team.items()}
        for name in names:
            role = self.domain.role(roles.get(name, ""))
            if role is not None and any(other.name != name for other in pool.able(role, mission.target)):
                member = self.memory.members[name]
                member.aside_until = self.now + (ASIDE_NS << min(member.strikes, MOST_STRIKES))
                member.strikes += 1

    # After a problem

    def recover(self, mission: Mission, problem: str, agent: str = "", failed: Item = ()) -> None:
        """Replan or repair a mission after a problem, or end it if that is the policy.

        ``failed`` is the action of ``agent`` that met the problem, if any.
        """
        log.info("mission %d: %s", mission.id, problem)
        mission.problem = problem
        progress = self.progress_of.get(mission.id)
        node = progress.fail(agent, failed) if progress and failed else None
        if self.options.policy == "none":
            self._abandon_plan(mission, failed=node is not None)
            self.given_up.add(mission.target)
            self.finish(mission, "failed")
            return
        mission.recoveries += 1
        again = mission.failures.get(key := " ".join((problem, *failed)), 0)
        mission.failures[key] = again + 1
        if again >= SAME_FAILURES and problem not in self.domain.repairable | self.domain.blameless:
            self._set_aside(mission, [agent])
        if not self._can_go_on(mission, again):
            self._abandon_plan(mission, failed=node is not None)
            self.suspend(mission, problem)
            return
        is_repairable = problem in self.domain.repairable and not again
        answer = self._repair(mission, progress, node) if progress and node and is_repairable else None
        answer = answer or self._plan(mission)
        self._abandon_plan(mission, failed=node is not None)
        self._go(mission, answer)

    def _can_go_on(self, mission: Mission, again: int) -> bool:
        """Whether the team is complete, those that nobody can replace are present, and failures are few."""
        if self.world is None or again >= SAME_FAILURES or not self._has_team(mission):
            return False
        local = [mission.team[role.variable] for role in self.domain.roles if role.is_local]
        states = [self.domain.member(self.world, name) for name in local]
        return all(state is None or state.is_present for state in states)

    def _repair(self, mission: Mission, progress: PlanProgress, failed: TaskNode) -> TaskAnswer | None:
        """A repaired plan, if the policy allows one and it does not start with the failed action.

        It must not need an agent that has worked for another mission since: what that did before does not count.
        """
        policy = self.options.policy
        if policy == "replan" or (policy == "auto" and progress.joint_share > MOSTLY_JOINT):
            return None
        state = self._state(mission, sees=self.options.proactive)
        answer = self.domain.planner_of(mission).repair(mission, state, progress.tree, failed)
        if answer is None:
            return None
        self._timed(answer)
        elsewhere = {name for name in mission.team.values() if self.memory.members[name].latest != mission.id}
        usable = (
            answer.verdict is TaskVerdict.PLAN
            and answer.plan[0].item != failed.item
            and elsewhere.isdisjoint(word for node in answer.plan for word in node.item[1:])
        )
        return answer if usable else None

    # Before a problem

    def look_ahead(self, mission: Mission) -> None:
        """Revise a plan that the present world contradicts. A plan with more actions than necessary stays."""
        progress, world, domain = self.progress_of[mission.id], self.world, self.domain
        upcoming = progress.next
        if upcoming is None or world.stamp < mission.touched or domain.is_done(world, mission.target) is None:
            return
        if any(domain.member(world, name) is None for name in mission.team.values()):
            return
        state = self._state(mission, sees=True)
        settling_ns = SETTLED_NS << min(mission.revisions, 10)
        if progress.revised_for != (progress.position, state):
            progress.revised_for, progress.doubted_since = (progress.position, state), None
        elif progress.doubted_since is None or self.now - progress.doubted_since < settling_ns:
            return
        answer = self._timed(domain.planner_of(mission).revise(mission, state, progress.tree, upcoming))
        if answer.verdict is not TaskVerdict.PLAN or _is_within([node.item for node in answer.plan], progress.left):
            return
        if progress.doubted_since is None:
            # The world may show a finished action before its report arrives.
            progress.doubted_since = self.now
        elif not self._has_team(mission):
            self.suspend(mission, "the team is needed again")
        else:
            log.info("mission %d is revised", mission.id)
            mission.revisions += 1
            self._abandon_plan(mission)
            self._go(mission, answer)


def _is_within(items: Iterable[Item], plan: Iterable[Item]) -> bool:
    """Whether ``items`` is a subsequence of ``plan``."""
    left = iter(plan)
    return all(item in left for item in items)
