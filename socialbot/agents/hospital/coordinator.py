"""Coordinator of the hospital: tracks agents and the ward, runs missions; and its node."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Iterator, Mapping
from typing import cast

import msgspec

from socialbot.agents.hospital._mission_manager import MissionManager, Recovery, Send
from socialbot.agents.hospital.messages import (
    COORDINATOR,
    EVERYBODY,
    TOPIC,
    AclMessage,
    AclSender,
    Finished,
    InitialTrigger,
    Missions,
    MissionView,
    Problem,
    Refusal,
    Register,
    Report,
    protocol_error,
)
from socialbot.agents.hospital.missions import (
    DISINFECT,
    KINDS,
    CoordinatorMemory,
    CoordinatorOptions,
    Mission,
    PlanProgress,
    Policy,
    RegisteredAgent,
)
from socialbot.agents.hospital.ward.messages import STATE, WardState
from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Context, Delivery, Input, Node, Output, Parameter

log = logging.getLogger("socialbot.coordinator")


class Coordinator:
    """Directs registered agents. Times are ns."""

    def __init__(
        self, send: Send, options: CoordinatorOptions | None = None, memory: CoordinatorMemory | None = None
    ) -> None:
        self.manager = MissionManager(send, options or CoordinatorOptions(), memory or CoordinatorMemory())
        self.recovery = Recovery(self.manager)

    def begin(self) -> None:
        """Ask all agents to register: early ones, and those in the memory."""
        self.manager.send(EVERYBODY, "query", Register(), "", "")

    # Messages

    def receive(self, message: AclMessage, now: int) -> None:
        """Process a message. Refuse one with an unknown receiver, or an invalid one."""
        self.manager.now = now
        if message.sender == COORDINATOR:
            return
        if message.receiver != COORDINATOR:
            if message.receiver != EVERYBODY and message.receiver not in self.memory.members:
                self._refuse(message, f"there is no {message.receiver}")
            return
        if wrong := protocol_error(message):
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
        self.manager.form_teams()

    def _register(self, message: AclMessage, content: Register) -> None:
        members = self.memory.members
        known = members.get(message.sender)
        member = RegisteredAgent(
            message.sender, content.kind, frozenset(content.capabilities), known.mission if known else 0
        )
        members[message.sender] = member
        self.manager.await_team()
        self.changed = True
        self.manager.send(message.sender, "agree", content, "", message.id)
        mission = self.memory.missions.get(member.mission)
        if mission is not None and not message.in_reply_to:
            self.recovery.recover(mission, f"{message.sender} has begun anew")

    def _request(self, message: AclMessage, content: InitialTrigger) -> None:
        ward = self.manager.ward
        room = content.args[0] if len(content.args) == 1 else ""
        if content.mission_kind not in KINDS or not room:
            self._refuse(message, f"a mission is one of {', '.join(KINDS)}, and has one argument, a room")
        elif ward is None or ward.room(room) is None:
            self._refuse(message, f"there is no room {room!r}")
        else:
            mission = self.manager.open_in(room) or self.manager.begin(content.mission_kind, room)
            if KINDS[content.mission_kind].priority > mission.priority:
                mission.kind = content.mission_kind
                self.manager.await_team(mission)
            self.manager.send(message.sender, "agree", content, mission.label, message.id)

    def _take_news(self, message: AclMessage) -> None:
        mission = self._mission_of(message)
        if mission is None or mission.status != "running":
            return
        mission.touched = self.manager.now
        self.manager.view_cache.redraw(mission)
        match message.content:
            case Report(outcome="success", action=action, args=args):
                progress = self.progress_of.get(mission.id)
                if progress is not None and progress.advance(message.sender, (action, *args)):
                    mission.apply_effects((action, *args))
            case Problem() as problem:
                mission.add_finding(problem, message.sender, self.manager.now)
                self.recovery.recover(mission, problem.kind, message.sender, (problem.action, *problem.args))
            case Finished():
                self.manager.release(mission, message.sender)
                if not mission.active:
                    mission.ended = self.manager.now
                    self._conclude(mission)

    def _mission_of(self, message: AclMessage) -> Mission | None:
        """The mission of a message, if its plans are current."""
        member = self.memory.members.get(message.sender)
        mission = self.memory.missions.get(member.mission) if member else None
        return mission if mission is not None and mission.label == message.mission else None

    def _refuse(self, message: AclMessage, reason: str) -> None:
        if message.performative in ("refuse", "failure"):
            return
        log.warning("refused what %s says: %s", message.sender, reason)
        self.manager.send(message.sender, "refuse", Refusal(reason), message.mission, message.id)

    # Ward

    def observe(self, ward: WardState, now: int) -> None:
        """Process the state of the ward: start and end missions, and act before problems."""
        manager = self.manager
        manager.now, manager.ward = now, ward
        if self.options.triggers:
            served = {mission.room for mission in self.memory.missions.values()} | self.recovery.given_up
            for room in ward.rooms:
                if room.infected and room.name not in served:
                    manager.begin(DISINFECT.name, room.name)
        for mission in list(self.memory.missions.values()):
            if mission.status == "waiting":
                state = ward.room(mission.room)
                if state is not None and not state.infected:
                    manager.finish(mission)
            else:
                self._follow(mission)
        manager.await_team()
        manager.form_teams()

    def _follow(self, mission: Mission) -> None:
        """Check the progress of a running mission."""
        ward = self.manager.ward
        if ward is not None and any((agent := ward.agent(name)) and agent.busy for name in mission.active):
            # An agent at work may take long.
            mission.touched = max(mission.touched, ward.stamp)
        if mission.id not in self.progress_of:
            self._recall(mission)
        elif not mission.active:
            self._conclude(mission)
        elif self.manager.now - mission.touched > nanoseconds(self.options.patience_s):
            self.recovery.recover(mission, "no news")
        elif self.options.proactive and self.options.policy != "none":
            self.recovery.look_ahead(mission)

    def _recall(self, mission: Mission) -> None:
        """Continue a mission that was running at the end of an earlier coordinator; its progress is unknown."""
        room = self.manager.ward.room(mission.room) if self.manager.ward else None
        if room is not None and not room.infected:
            self.manager.finish(mission)
        else:
            self.recovery.recover(mission, "the coordinator has begun anew")

    def _conclude(self, mission: Mission) -> None:
        """End a mission after its last agent, if the ward shows the room as disinfected."""
        ward = self.manager.ward
        room = ward.room(mission.room) if ward else None
        if ward is None or room is None:
            return
        if room.disinfected:
            self.manager.finish(mission)
        elif ward.stamp > mission.ended:
            self.recovery.recover(mission, "the room is not disinfected")

    # State

    @property
    def options(self) -> CoordinatorOptions:
        return self.manager.options

    @property
    def memory(self) -> CoordinatorMemory:
        return self.manager.memory

    @property
    def progress_of(self) -> dict[int, PlanProgress]:
        """Progress of the running missions, by number."""
        return self.manager.progress_of

    @property
    def planning_s(self) -> deque[float]:
        """Durations of the latest plannings."""
        return self.manager.planning_s

    @property
    def changed(self) -> bool:
        """Whether a mission changed since this was set to False."""
        return self.manager.view_cache.changed

    @changed.setter
    def changed(self, changed: bool) -> None:
        self.manager.view_cache.changed = changed

    def views(self) -> Iterator[MissionView]:
        return self.manager.view_cache.views(self.memory.missions.values(), self.progress_of)


MISSIONS = "/hospital/missions"


class HospitalCoordinator(Node):
    """Directs the robots and nurses of a hospital. With a ``memory_file`` it continues after a restart."""

    deliberates = True

    heard = Input(AclMessage, TOPIC)
    state = Input(WardState, STATE, Delivery.LATCHED)
    said = Output(AclMessage, TOPIC)
    missions = Output(Missions, MISSIONS, Delivery.LATCHED)

    policy = Parameter(
        "auto",
        "reaction to a problem: choice by joint actions, new plan, repaired plan, or end of the mission",
        choices=("auto", "replan", "repair", "none"),
    )
    proactive = Parameter(True, "whether it observes rooms and batteries, and acts before a problem")
    triggers = Parameter(True, "whether it starts a mission for each infected room")
    patience_s = Parameter(120.0, "time without news of a mission before a new plan (s)", minimum=1.0, maximum=1e5)
    rest_s = Parameter(5.0, "time before a blocked mission is tried again (s)", minimum=0.0, maximum=1e4)
    memory_file = Parameter("", "file for missions and agents; empty: none", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for an invalid ``memory_file``."""
        super().__init__(name, context, parameters)
        self._memory_file = (
            paths.in_workspace(self.memory_file, where=f"{name}.memory_file") if self.memory_file else None
        )
        acl = AclSender(COORDINATOR, self.clock, self.said.publish)
        self.coordinator = Coordinator(acl.send, CoordinatorOptions(), self._recall())
        self._saved = b""
        for parameter in ("policy", "proactive", "triggers", "patience_s", "rest_s"):
            self.on_parameter(parameter)

    def start(self) -> None:
        self.coordinator.begin()

    @heard
    def on_heard(self, message: AclMessage) -> None:
        self.coordinator.receive(message, self.clock.now())
        self._publish()

    @state
    def on_state(self, message: WardState) -> None:
        self.coordinator.observe(message, self.clock.now())
        self._publish()

    def on_parameter(self, name: str) -> None:
        options, value = self.coordinator.options, self.parameter_values[name]
        if name == "policy":
            options.policy = cast(Policy, value)
        elif name != "memory_file":
            setattr(options, name, value)

    def _publish(self) -> None:
        """Publish and save changes."""
        if not self.coordinator.changed:
            return
        self.coordinator.changed = False
        self.missions.publish(Missions(stamp=self.clock.now(), missions=tuple(self.coordinator.views())))
        self._save()

    def _save(self) -> None:
        path = self._memory_file
        if path is None:
            return
        data = msgspec.json.encode(self.coordinator.memory)
        if data == self._saved:
            return
        new = path.with_name(f"{path.name}.new")
        try:
            new.write_bytes(data)
            os.replace(new, path)
        except OSError as error:
            self.log.warning("cannot write the memory file: %s", error)
            return
        self._saved = data

    def _recall(self) -> CoordinatorMemory:
        path = self._memory_file
        if path is None or not path.exists():
            return CoordinatorMemory()
        try:
            return msgspec.json.decode(path.read_bytes(), type=CoordinatorMemory)
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ParameterError(
                f"cannot read the memory file: {error}", where=str(path), remedy="delete the file"
            ) from error
