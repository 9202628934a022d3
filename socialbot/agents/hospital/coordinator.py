"""The coordinator: forms teams, plans their missions, sends each agent its part, and mends what goes wrong.

It is plain logic: `Coordinator.hear` takes what is said, `Coordinator.observe` what the ward shows; what it has to say
it gives to ``say``. What it has to remember is in its `Memory`.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Literal

from socialbot.agents.hospital.disinfect import DISINFECT as DOMAIN
from socialbot.agents.hospital.messages import (
    COORDINATOR,
    EVERYBODY,
    AclMessage,
    AnyContent,
    Belief,
    End,
    Finished,
    InitialTrigger,
    MissionView,
    Performative,
    Plan,
    Problem,
    Refusal,
    Register,
    Report,
    Start,
    Stop,
)
from socialbot.agents.hospital.missions import (
    BATTERY_LOW,
    DISINFECT,
    DOOR_CLOSED,
    KINDS,
    NURSE,
    UNFIT,
    Conduct,
    Course,
    Member,
    Memory,
    Mission,
    state_of,
    view,
)
from socialbot.agents.hospital.teams import team_for, yielding
from socialbot.agents.hospital.translation import initial_triggers, translate
from socialbot.agents.hospital.ward_messages import (
    AWAY,
    CLOSED_DOOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    WardState,
)
from socialbot.clock import SECOND, nanoseconds
from socialbot.tasks.answer import TaskAnswer, TaskVerdict
from socialbot.tasks.domain import Item
from socialbot.tasks.planner import TaskPlanner
from socialbot.tasks.tree import Node

log = logging.getLogger("socialbot.coordinator")

MOSTLY_JOINT = 0.5
"""Plans of which more is joint than this are made anew rather than mended."""
MENDED = (DIRTY_ROOM, PERSON_IN_ROOM, LOW_BATTERY, NURSE_ABSENT)
"""Problems that the tasks know a way around; who meets another one has to begin again, as with a door."""
SAME_FAILURES = 3
"""If the same goes wrong so often once more, the mission waits."""
SETTLED_NS = SECOND // 10
"""So long the ward has to show a reason to revise a plan; twice as long each time that it was revised before."""
SHOWN = 20
"""So many missions that are over are still shown."""

Say = Callable[[str, Performative, AnyContent, str, str], object]
"""Says something: the receiver, the performative, the content, the mission's label, the message it answers."""


class Coordinator:
    """Directs agents that have registered; times are ns. ``planning_s`` is how long each plan took to find."""

    def __init__(self, say: Say, conduct: Conduct | None = None, memory: Memory | None = None) -> None:
        self.say = say
        self.conduct = conduct or Conduct()
        self.memory = memory or Memory()
        self.planner = TaskPlanner(DOMAIN)
        self.courses: dict[int, Course] = {}
        self.ward: WardState | None = None
        self.now = 0
        self.changed = True
        """Whether something is other than when this was last set to False."""
        self.planning_s: deque[float] = deque(maxlen=10_000)
        self._over: deque[MissionView] = deque(maxlen=SHOWN)
        self._given_up: set[str] = set()
        """Rooms of missions that have failed."""
        self._shown: dict[int, tuple[object, MissionView]] = {}

    def begin(self) -> None:
        """Asks everybody to register: those who did so before it was there, and those whom it remembers."""
        self.say(EVERYBODY, "query", Register(), "", "")

    # What is said

    def hear(self, message: AclMessage, now: int) -> None:
        """Takes a message. One that is for somebody who is not known, or makes no sense, is refused."""
        self.now = now
        if message.sender == COORDINATOR:
            return
        if message.receiver != COORDINATOR:
            if message.receiver not in (*self.memory.members, EVERYBODY):
                self._refuse(message, f"there is no {message.receiver}")
            return
        match message.content:
            case Register() as content:
                self._register(message, content)
            case InitialTrigger() as content:
                self._request(message, content)
            case Report() | Problem() | Finished():
                self._take_news(message)
            case Refusal() as content:
                log.warning("%s refuses: %s", message.sender, content.reason)
                if message.mission and (mission := self._mission_of(message)):
                    self._recover(mission, f"{message.sender} refuses: {content.reason}")
            case other:
                if message.performative not in ("agree", "inform"):
                    self._refuse(message, f"a coordinator does nothing about {type(other).__name__}")
        self._form_teams()

    def _register(self, message: AclMessage, content: Register) -> None:
        known = self.memory.members.get(message.sender)
        member = Member(message.sender, content.kind, frozenset(content.capabilities), known.mission if known else 0)
        self.memory.members[message.sender] = member
        self.changed = True
        self.say(message.sender, "agree", content, "", message.id)
        mission = self.memory.missions.get(member.mission)
        if mission is not None and message.performative == "request" and not message.in_reply_to:
            self._recover(mission, f"{message.sender} has begun anew")

    def _request(self, message: AclMessage, content: InitialTrigger) -> None:
        room = content.args[0] if len(content.args) == 1 else ""
        if content.mission_kind not in KINDS or not room:
            self._refuse(message, f"a mission is one of {', '.join(KINDS)}, and has one argument, a room")
        elif self.ward is None or self.ward.room(room) is None:
            self._refuse(message, f"there is no room {room!r}")
        elif open_ := self._open_in(room):
            self._raise(open_, content.mission_kind)
            self.say(message.sender, "agree", content, open_.label, message.id)
        else:
            mission = self._new(content.mission_kind, room)
            self.say(message.sender, "agree", content, mission.label, message.id)

    def _raise(self, mission: Mission, kind: str) -> None:
        if KINDS[kind].priority > mission.priority:
            mission.kind = kind
            self.changed = True

    def _take_news(self, message: AclMessage) -> None:
        mission = self._mission_of(message)
        if mission is None or mission.status != "running":
            return
        mission.touched = self.now
        self.changed = True
        match message.content:
            case Report(outcome="success", action=action, args=args):
                self._progress(mission, action, args)
            case Problem() as problem:
                self._note(mission, problem, message.sender)
                self._recover(mission, problem.kind, failed=(problem.action, *problem.args))
            case Finished():
                self._release(mission, message.sender)
                if not mission.active:
                    mission.ended = self.now
                    self._conclude(mission)

    def _progress(self, mission: Mission, action: str, args: tuple[str, ...]) -> None:
        match action:
            case "a_adapt_room":
                mission.found.pop(UNFIT, None)
            case "a_open_door":
                mission.found.pop(DOOR_CLOSED, None)
            case "a_charge":
                mission.found.pop(BATTERY_LOW + args[0], None)
            case "a_authenticate_nurse":
                mission.authenticated = True
            case "a_authorize_patrol":
                mission.authenticated = False
        course = self.courses.get(mission.id)
        index = course.find((action, *args)) if course else None
        if course is not None and index is not None:
            course.position = index + 1

    def _note(self, mission: Mission, problem: Problem, sender: str) -> None:
        if problem.kind in (DIRTY_ROOM, PERSON_IN_ROOM):
            mission.found[UNFIT] = self.now
        elif problem.kind == CLOSED_DOOR:
            mission.found[DOOR_CLOSED] = self.now
        elif problem.kind == LOW_BATTERY:
            mission.found[BATTERY_LOW + sender] = self.now

    def _mission_of(self, message: AclMessage) -> Mission | None:
        """The mission that a message is about, if it is about its plans as they are now."""
        member = self.memory.members.get(message.sender)
        mission = self.memory.missions.get(member.mission) if member else None
        return mission if mission is not None and mission.label == message.mission else None

    def _refuse(self, message: AclMessage, reason: str) -> None:
        if message.performative in ("refuse", "failure"):
            return
        log.warning("refused what %s says: %s", message.sender, reason)
        self.say(message.sender, "refuse", Refusal(reason), message.mission, message.id)

    # What the ward shows

    def observe(self, ward: WardState, now: int) -> None:
        """Takes the state of the ward: begins and ends missions, and looks ahead."""
        self.now, self.ward = now, ward
        for room in ward.rooms if self.conduct.triggers else ():
            if room.infected and self._open_in(room.name) is None and room.name not in self._given_up:
                self._new(DISINFECT.name, room.name)
        for mission in list(self.memory.missions.values()):
            if mission.status == "waiting":
                state = ward.room(mission.room)
                if state is not None and not state.infected:
                    self._finish(mission)
            elif mission.id not in self.courses:
                self._recall(mission)
            elif not mission.active:
                self._conclude(mission)
            elif now - mission.touched > nanoseconds(self.conduct.patience_s):
                self._recover(mission, "no news")
            elif self.conduct.proactive and self.conduct.policy != "none":
                self._look_ahead(mission)
        self._form_teams()

    def _recall(self, mission: Mission) -> None:
        """Goes on with a mission that was running when the coordinator ended: nobody knows how far it has come."""
        room = self.ward.room(mission.room) if self.ward else None
        if room is not None and not room.infected:
            self._finish(mission)
        else:
            self._recover(mission, "the coordinator has begun anew")

    def _conclude(self, mission: Mission) -> None:
        """Ends a mission whose agents have all finished, if the ward shows that the room is as it should be."""
        room = self.ward.room(mission.room) if self.ward else None
        if self.ward is None or room is None:
            return
        if room.disinfected:
            self._finish(mission)
        elif self.ward.stamp > mission.ended:
            self._recover(mission, "the room is not disinfected")

    def _look_ahead(self, mission: Mission) -> None:
        """Revises the plan where the ward, as it is now, would stand in its way; one that does too much may stay."""
        course = self.courses[mission.id]
        comes = course.next
        if self.ward is None or comes is None or self.ward.stamp < mission.touched:
            return
        if any(self.ward.agent(name) is None for name in mission.team.values()) or not self.ward.room(mission.room):
            return
        state = state_of(self.ward, mission, sees_rooms=True)
        if course.foreseen != (course.position, state):
            course.foreseen, course.doubted = (course.position, state), None
        elif course.doubted is None or self.now - course.doubted < SETTLED_NS << min(mission.revisions, 10):
            return
        answer = self._timed(self.planner.revise(state, course.tree, comes.id))
        left = [node.item for node in course.agenda[course.position :]]
        if answer.verdict is not TaskVerdict.PLAN or _is_within([node.item for node in answer.plan], left):
            return
        if course.doubted is None:
            # What an agent has just done may show in the ward before its report is here.
            course.doubted = self.now
        elif not self._has_team(mission):
            self._retire(mission, "the team is needed again")
        else:
            mission.revisions += 1
            log.info("mission %d is revised", mission.id)
            self._leave_behind(mission)
            self._send(mission, answer)

    # Missions

    def _new(self, kind: str, room: str) -> Mission:
        self.memory.last += 1
        mission = Mission(self.memory.last, kind, room)
        self.memory.missions[mission.id] = mission
        self.changed = True
        return mission

    def _open_in(self, room: str) -> Mission | None:
        return next((mission for mission in self.memory.missions.values() if mission.room == room), None)

    def _form_teams(self) -> None:
        """Gives those who are free to the missions that wait, the most urgent first."""
        waiting = [
            mission
            for mission in self.memory.missions.values()
            if mission.status == "waiting" and mission.rests_until <= self.now
        ]
        if self.ward is None or not waiting:
            return
        members = self.memory.members
        for mission in sorted(waiting, key=lambda each: (-each.priority, each.id)):
            team = team_for(mission, members, self.ward)
            if team is None:
                for other in yielding(mission, members, self.memory.missions, self.ward):
                    self._retire(other, f"mission {mission.id} is more urgent", rest=False)
                team = team_for(mission, members, self.ward)
            if team is not None:
                mission.team = team
                mission.found.clear()
                self._plan(mission)

    def _plan(self, mission: Mission) -> None:
        assert self.ward is not None
        state = state_of(self.ward, mission, sees_rooms=self.conduct.proactive)
        answer = self._timed(self.planner.plan(state, mission.tasks()))
        if answer.verdict is not TaskVerdict.PLAN:
            self._retire(mission, answer.message)
            return
        mission.status = "running"
        self._send(mission, answer)

    def _send(self, mission: Mission, answer: TaskAnswer) -> None:
        """Splits a plan and sends each agent its part; who has none any more is free."""
        assert answer.tree is not None
        course = self.courses[mission.id] = Course.of(answer.tree, mission.team.values())
        mission.revision += 1
        mission.touched = self.now
        self.changed = True
        parts = translate(course.stages, mission.context(), mission.label)
        for name in mission.team.values():
            if name not in parts and name in mission.active:
                self.say(name, "request", Stop("nothing is left to do"), mission.label, "")
                self._release(mission, name)
        mission.active = [name for name in mission.team.values() if name in parts]
        for name in mission.active:
            self.memory.members[name].mission = mission.id
            self.say(name, "inform", Plan(mission.label, parts[name]), mission.label, "")
        arguments = tuple(mission.context().values())
        for name in mission.active:
            self.say(name, "request", Start(arguments), mission.label, "")
        for name, trigger in initial_triggers(course.stages).items():
            self.say(name, "inform", Belief(trigger), mission.label, "")

    # When something goes wrong

    def _recover(self, mission: Mission, problem: str, failed: tuple[str, ...] = ()) -> None:
        """Finds another way after a problem, or gives up where that is the policy."""
        mission.problem = problem
        self.changed = True
        log.info("mission %d: %s", mission.id, problem)
        if self.conduct.policy == "none":
            self._leave_behind(mission, failed=bool(failed))
            self._given_up.add(mission.room)
            self._finish(mission, "failed")
            return
        mission.recoveries += 1
        again = mission.failures.get(key := " ".join((problem, *failed)), 0)
        mission.failures[key] = again + 1
        if self.ward is None or not self._has_team(mission) or self._is_hopeless(mission, again):
            self._retire(mission, problem)
            return
        course = self.courses.get(mission.id)
        node = self._failed_node(course, failed) if course and failed else None
        mends = problem in MENDED and not again
        answer = self._repair(mission, course, node) if course and node and mends else None
        if answer is None:
            state = state_of(self.ward, mission, sees_rooms=self.conduct.proactive)
            answer = self._timed(self.planner.plan(state, mission.tasks()))
        self._leave_behind(mission, failed=node is not None)
        if answer.verdict is TaskVerdict.PLAN:
            self._send(mission, answer)
        else:
            self._retire(mission, answer.message)

    def _repair(self, mission: Mission, course: Course, failed: Node) -> TaskAnswer | None:
        """A plan that keeps what was done, if that is the policy, and it does not begin with what has failed."""
        assert self.ward is not None
        policy = self.conduct.policy
        if policy == "replan" or (policy == "auto" and course.joint_share > MOSTLY_JOINT):
            return None
        state = state_of(self.ward, mission, sees_rooms=self.conduct.proactive)
        answer = self._timed(self.planner.replan(state, course.tree, failed.id))
        usable = answer.verdict is TaskVerdict.PLAN and answer.plan[0].item != failed.item
        return answer if usable else None

    def _is_hopeless(self, mission: Mission, again: int) -> bool:
        """Whether the team had better do something else meanwhile."""
        nurse = self.ward.agent(mission.team[NURSE]) if self.ward else None
        return again >= SAME_FAILURES or (nurse is not None and nurse.place == AWAY)

    def _failed_node(self, course: Course, failed: tuple[str, ...]) -> Node | None:
        index = course.find(failed)
        if index is None:
            return course.next
        course.position = index
        return course.agenda[index]

    def _has_team(self, mission: Mission) -> bool:
        """Whether all of the team are there, and work for no other mission."""
        members = (self.memory.members.get(name) for name in mission.team.values())
        return all(member is not None and member.mission in (0, mission.id) for member in members)

    def _retire(self, mission: Mission, why: str, *, rest: bool = True) -> None:
        """Has a mission wait for another team, after a rest; its own is free."""
        log.info("mission %d waits: %s", mission.id, why)
        self._dismiss(mission, Stop(why))
        mission.status, mission.problem = "waiting", why
        mission.rests_until = self.now + nanoseconds(self.conduct.rest_s) if rest else 0
        mission.authenticated = False
        mission.failures.clear()
        self.changed = True

    def _finish(self, mission: Mission, status: Literal["finished", "failed"] = "finished") -> None:
        mission.status = status
        self._over.append(view(mission, self.courses.get(mission.id)))
        self._dismiss(mission, End())
        self.memory.missions.pop(mission.id)
        self._shown.pop(mission.id, None)
        self.changed = True

    def _dismiss(self, mission: Mission, word: Stop | End) -> None:
        for name in list(mission.active):
            self.say(name, "request", word, mission.label, "")
            self._release(mission, name)
        self._leave_behind(mission)

    def _leave_behind(self, mission: Mission, *, failed: bool = False) -> None:
        """Gives up the plan of a mission, and remembers what was done of it, and whether the next action failed."""
        course = self.courses.pop(mission.id, None)
        if course is not None:
            mission.past += [each for each in course.actions(failed=failed) if each.status != "planned"]

    def _release(self, mission: Mission, name: str) -> None:
        if name in mission.active:
            mission.active.remove(name)
        member = self.memory.members.get(name)
        if member is not None and member.mission == mission.id:
            member.mission = 0

    # For others to see

    def views(self) -> Iterator[MissionView]:
        """The latest missions that are over, in the order of their end, and all that are not, by number."""
        yield from self._over
        for mission in self.memory.missions.values():
            course = self.courses.get(mission.id)
            key = (mission.status, mission.kind, mission.label, mission.problem, course and course.position)
            shown = self._shown.get(mission.id)
            if shown is None or shown[0] != key:
                shown = self._shown[mission.id] = (key, view(mission, course))
            yield shown[1]

    def _timed(self, answer: TaskAnswer) -> TaskAnswer:
        self.planning_s.append(answer.seconds)
        return answer


def _is_within(items: Iterable[Item], plan: Iterable[Item]) -> bool:
    """Whether ``items`` come one after the other in ``plan``, perhaps with others between them."""
    left = iter(plan)
    return all(item in left for item in items)
