"""Missions as they are directed: who works for which, what they are told to do, and how it ends."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Literal

from socialbot.agents.hospital.board import Board
from socialbot.agents.hospital.course import Course
from socialbot.agents.hospital.disinfect import DISINFECT as DOMAIN
from socialbot.agents.hospital.messages import AnyContent, Belief, End, Performative, Plan, Start, Stop
from socialbot.agents.hospital.missions import Conduct, Memory, Mission, state_of
from socialbot.agents.hospital.teams import Pool
from socialbot.agents.hospital.translation import initial_triggers, translate
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.clock import nanoseconds
from socialbot.tasks.answer import TaskAnswer, TaskVerdict
from socialbot.tasks.planner import TaskPlanner
from socialbot.tasks.state import State

log = logging.getLogger("socialbot.coordinator")

Say = Callable[[str, Performative, AnyContent, str, str], object]
"""Says something: the receiver, the performative, the content, the mission's label, the message it answers."""


class Direction:
    """The missions, their teams, and the plans of those that are running. Times are ns."""

    def __init__(self, say: Say, conduct: Conduct, memory: Memory) -> None:
        self.say = say
        self.conduct = conduct
        self.memory = memory
        self.courses: dict[int, Course] = {}
        self.board = Board()
        self.ward: WardState | None = None
        """As it was seen last."""
        self.now = 0
        self.planner = TaskPlanner(DOMAIN)
        self.planning_s: deque[float] = deque(maxlen=10_000)
        self._may_form = True
        """Whether something has changed since teams could not be formed."""

    # Missions

    def begin(self, kind: str, room: str) -> Mission:
        """A new mission, which waits for a team."""
        self.memory.last += 1
        mission = self.memory.missions[self.memory.last] = Mission(self.memory.last, kind, room)
        self.await_team(mission)
        return mission

    def open_in(self, room: str) -> Mission | None:
        """The mission in a room that is not over, if there is one."""
        return next((mission for mission in self.memory.missions.values() if mission.room == room), None)

    def retire(self, mission: Mission, why: str, *, rest: bool = True) -> None:
        """Has a mission wait for another team, after a rest; its own is free."""
        log.info("mission %d waits: %s", mission.id, why)
        self._dismiss(mission, Stop(why))
        mission.status, mission.problem = "waiting", why
        mission.rests_until = self.now + nanoseconds(self.conduct.rest_s) if rest else 0
        mission.authenticated = False
        mission.failures.clear()
        self.await_team(mission)

    def finish(self, mission: Mission, status: Literal["finished", "failed"] = "finished") -> None:
        """Ends a mission; its team is free."""
        mission.status = status
        self.board.close(mission, self.courses.get(mission.id))
        self._dismiss(mission, End())
        self.memory.missions.pop(mission.id)

    def _dismiss(self, mission: Mission, word: Stop | End) -> None:
        for name in list(mission.active):
            self.say(name, "request", word, mission.label, "")
            self.release(mission, name)
        self.leave_behind(mission)

    # Teams

    def await_team(self, mission: Mission | None = None) -> None:
        """Has teams formed when `form_teams` is called next: ``mission``, or somebody, is now free for that."""
        self._may_form = True
        if mission is not None:
            self.board.redraw(mission)

    def release(self, mission: Mission, name: str) -> None:
        """Frees one of the team."""
        if name in mission.active:
            mission.active.remove(name)
        member = self.memory.members.get(name)
        if member is not None and member.mission == mission.id:
            member.mission = 0
        self.await_team(mission)

    def has_team(self, mission: Mission) -> bool:
        """Whether all of the team are known, and work for no other mission."""
        members = (self.memory.members.get(name) for name in mission.team.values())
        return all(member is not None and member.mission in (0, mission.id) for member in members)

    def form_teams(self) -> None:
        """Gives those who are free to the missions that wait, the most urgent first."""
        if self.ward is None or not self._may_form:
            return
        self._may_form = False
        missions = self.memory.missions.values()
        waiting = [each for each in missions if each.status == "waiting" and each.rests_until <= self.now]
        pool = Pool(self.memory.members, self.ward)
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

    def _take_from_others(self, mission: Mission, pool: Pool) -> bool:
        """Has less urgent missions wait if that gives this one a team; whether there are such."""
        missions = self.memory.missions
        if all(other.priority >= mission.priority for other in missions.values()):
            return False
        yielding = pool.yielding(mission, missions)
        for other in yielding:
            self.retire(other, f"mission {mission.id} is more urgent", rest=False)
        return bool(yielding)

    # Plans

    def state(self, mission: Mission, *, sees_rooms: bool) -> State:
        """The ward as the planner of tasks is told of it."""
        assert self.ward is not None
        return state_of(self.ward, mission, sees_rooms=sees_rooms)

    def plan(self, mission: Mission) -> TaskAnswer:
        """A plan for all of a mission as it stands now."""
        return self.timed(self.planner.plan(self.state(mission, sees_rooms=self.conduct.proactive), mission.tasks()))

    def timed(self, answer: TaskAnswer) -> TaskAnswer:
        """Notes how long planning took."""
        self.planning_s.append(answer.seconds)
        return answer

    def go(self, mission: Mission, answer: TaskAnswer) -> None:
        """Has a team do a plan; where there is none, the mission waits."""
        if answer.verdict is not TaskVerdict.PLAN or answer.tree is None:
            self.retire(mission, answer.message)
            return
        course = self.courses[mission.id] = Course.of(answer.tree, mission.team.values())
        mission.status = "running"
        mission.revision += 1
        mission.touched = self.now
        self._send(mission, course)
        self.board.redraw(mission)

    def _send(self, mission: Mission, course: Course) -> None:
        """Splits a plan and sends each agent its part; who has none any more is free."""
        parts = translate(course.stages, mission.context(), mission.label)
        for name in mission.team.values():
            if name not in parts and name in mission.active:
                self.say(name, "request", Stop("nothing is left to do"), mission.label, "")
                self.release(mission, name)
        mission.active = [name for name in mission.team.values() if name in parts]
        for name in mission.active:
            self.memory.members[name].mission = mission.id
            self.say(name, "inform", Plan(mission.label, parts[name]), mission.label, "")
        arguments = tuple(mission.context().values())
        for name in mission.active:
            self.say(name, "request", Start(arguments), mission.label, "")
        for name, trigger in initial_triggers(course.stages).items():
            self.say(name, "inform", Belief(trigger), mission.label, "")

    def leave_behind(self, mission: Mission, *, failed: bool = False) -> None:
        """Gives up the plan of a mission, and remembers what was done of it, and whether the next action failed."""
        course = self.courses.pop(mission.id, None)
        if course is not None:
            mission.past += [each for each in course.actions(failed=failed) if each.status != "planned"]
