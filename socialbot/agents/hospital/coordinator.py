"""The coordinator: hears what agents say, sees what the ward shows, and sees to it that missions go on.

It is plain logic: `Coordinator.hear` takes what is said, `Coordinator.observe` what the ward shows; what it has to say
it gives to ``say``. What it has to remember is in its `Memory`. Who works for which mission, and by which plan, is up
to its `Direction`; other ways when something goes wrong to its `Recovery`.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator

from socialbot.agents.hospital.course import Course
from socialbot.agents.hospital.direction import Direction, Say
from socialbot.agents.hospital.messages import (
    COORDINATOR,
    EVERYBODY,
    AclMessage,
    Finished,
    InitialTrigger,
    MissionView,
    Problem,
    Refusal,
    Register,
    Report,
    mistake,
)
from socialbot.agents.hospital.missions import DISINFECT, KINDS, Conduct, Member, Memory, Mission
from socialbot.agents.hospital.recovery import Recovery
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.clock import nanoseconds

log = logging.getLogger("socialbot.coordinator")


class Coordinator:
    """Directs agents that have registered; times are ns."""

    def __init__(self, say: Say, conduct: Conduct | None = None, memory: Memory | None = None) -> None:
        self.direction = Direction(say, conduct or Conduct(), memory or Memory())
        self.recovery = Recovery(self.direction)

    def begin(self) -> None:
        """Asks everybody to register: those who did so before it was there, and those whom it remembers."""
        self.direction.say(EVERYBODY, "query", Register(), "", "")

    # What is said

    def hear(self, message: AclMessage, now: int) -> None:
        """Takes a message. One that is for somebody who is not known, or makes no sense, is refused."""
        self.direction.now = now
        if message.sender == COORDINATOR:
            return
        if message.receiver != COORDINATOR:
            if message.receiver != EVERYBODY and message.receiver not in self.memory.members:
                self._refuse(message, f"there is no {message.receiver}")
            return
        if wrong := mistake(message):
            self._refuse(message, wrong)
            return
        match message.content:
            case Register() as content if message.performative == "request":
                self._register(message, content)
            case InitialTrigger() as content if message.performative == "request":
                self._request(message, content)
            case Report() | Problem() | Finished():
                self._take_news(message)
            case Refusal() as content:
                log.warning("%s refuses: %s", message.sender, content.reason)
                if message.mission and (mission := self._mission_of(message)):
                    self.recovery.recover(mission, f"{message.sender} refuses: {content.reason}")
            case other:
                if message.performative not in ("agree", "inform"):
                    self._refuse(message, f"a coordinator does nothing about {type(other).__name__}")
        self.direction.form_teams()

    def _register(self, message: AclMessage, content: Register) -> None:
        members = self.memory.members
        known = members.get(message.sender)
        member = Member(message.sender, content.kind, frozenset(content.capabilities), known.mission if known else 0)
        members[message.sender] = member
        self.direction.await_team()
        self.changed = True
        self.direction.say(message.sender, "agree", content, "", message.id)
        mission = self.memory.missions.get(member.mission)
        if mission is not None and not message.in_reply_to:
            self.recovery.recover(mission, f"{message.sender} has begun anew")

    def _request(self, message: AclMessage, content: InitialTrigger) -> None:
        ward = self.direction.ward
        room = content.args[0] if len(content.args) == 1 else ""
        if content.mission_kind not in KINDS or not room:
            self._refuse(message, f"a mission is one of {', '.join(KINDS)}, and has one argument, a room")
        elif ward is None or ward.room(room) is None:
            self._refuse(message, f"there is no room {room!r}")
        else:
            mission = self.direction.open_in(room) or self.direction.begin(content.mission_kind, room)
            if KINDS[content.mission_kind].priority > mission.priority:
                mission.kind = content.mission_kind
                self.direction.await_team(mission)
            self.direction.say(message.sender, "agree", content, mission.label, message.id)

    def _take_news(self, message: AclMessage) -> None:
        mission = self._mission_of(message)
        if mission is None or mission.status != "running":
            return
        mission.touched = self.direction.now
        self.direction.board.redraw(mission)
        match message.content:
            case Report(outcome="success", action=action, args=args):
                course = self.courses.get(mission.id)
                if course is not None and course.advance(message.sender, (action, *args)):
                    mission.is_done((action, *args))
            case Problem() as problem:
                mission.has_met(problem, message.sender, self.direction.now)
                self.recovery.recover(mission, problem.kind, message.sender, (problem.action, *problem.args))
            case Finished():
                self.direction.release(mission, message.sender)
                if not mission.active:
                    mission.ended = self.direction.now
                    self._conclude(mission)

    def _mission_of(self, message: AclMessage) -> Mission | None:
        """The mission that a message is about, if it is about its plans as they are now."""
        member = self.memory.members.get(message.sender)
        mission = self.memory.missions.get(member.mission) if member else None
        return mission if mission is not None and mission.label == message.mission else None

    def _refuse(self, message: AclMessage, reason: str) -> None:
        if message.performative in ("refuse", "failure"):
            return
        log.warning("refused what %s says: %s", message.sender, reason)
        self.direction.say(message.sender, "refuse", Refusal(reason), message.mission, message.id)

    # What the ward shows

    def observe(self, ward: WardState, now: int) -> None:
        """Takes the state of the ward: begins and ends missions, and looks ahead."""
        direction = self.direction
        direction.now, direction.ward = now, ward
        if self.conduct.triggers:
            served = {mission.room for mission in self.memory.missions.values()} | self.recovery.given_up
            for room in ward.rooms:
                if room.infected and room.name not in served:
                    direction.begin(DISINFECT.name, room.name)
        for mission in list(self.memory.missions.values()):
            if mission.status == "waiting":
                state = ward.room(mission.room)
                if state is not None and not state.infected:
                    direction.finish(mission)
            else:
                self._follow(mission)
        direction.await_team()
        direction.form_teams()

    def _follow(self, mission: Mission) -> None:
        """Sees whether a running mission goes on as it should."""
        ward = self.direction.ward
        if ward is not None and any((agent := ward.agent(name)) and agent.busy for name in mission.active):
            # Who is seen to do something may take long over it.
            mission.touched = max(mission.touched, ward.stamp)
        if mission.id not in self.courses:
            self._recall(mission)
        elif not mission.active:
            self._conclude(mission)
        elif self.direction.now - mission.touched > nanoseconds(self.conduct.patience_s):
            self.recovery.recover(mission, "no news")
        elif self.conduct.proactive and self.conduct.policy != "none":
            self.recovery.look_ahead(mission)

    def _recall(self, mission: Mission) -> None:
        """Goes on with a mission that was running when the coordinator ended: nobody knows how far it has come."""
        room = self.direction.ward.room(mission.room) if self.direction.ward else None
        if room is not None and not room.infected:
            self.direction.finish(mission)
        else:
            self.recovery.recover(mission, "the coordinator has begun anew")

    def _conclude(self, mission: Mission) -> None:
        """Ends a mission whose agents have all finished, if the ward shows that the room is as it should be."""
        ward = self.direction.ward
        room = ward.room(mission.room) if ward else None
        if ward is None or room is None:
            return
        if room.disinfected:
            self.direction.finish(mission)
        elif ward.stamp > mission.ended:
            self.recovery.recover(mission, "the room is not disinfected")

    # For others to see

    @property
    def conduct(self) -> Conduct:
        """How it goes about it."""
        return self.direction.conduct

    @property
    def memory(self) -> Memory:
        """What it has to remember."""
        return self.direction.memory

    @property
    def courses(self) -> dict[int, Course]:
        """The plans of the running missions, by number."""
        return self.direction.courses

    @property
    def planning_s(self) -> deque[float]:
        """How long each of the latest plans took to find."""
        return self.direction.planning_s

    @property
    def changed(self) -> bool:
        """Whether something is other than when this was last set to False."""
        return self.direction.board.changed

    @changed.setter
    def changed(self, changed: bool) -> None:
        self.direction.board.changed = changed

    def views(self) -> Iterator[MissionView]:
        """The latest missions that are over, in the order of their end, and all that are not, by number."""
        return self.direction.board.views(self.memory.missions.values(), self.courses)
