"""Coordinator of teams: tracks agents and the world, runs missions; and its node."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from socialbot.agents.base.state_file import StateFile
from socialbot.agents.teams import messages as acl
from socialbot.agents.teams._mission_manager import MissionManager, Send
from socialbot.agents.teams.domain import TeamDomain
from socialbot.agents.teams.missions import (
    FOREVER,
    CoordinatorMemory,
    CoordinatorOptions,
    Mission,
    RegisteredAgent,
)
from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.decoding import from_builtins, from_json
from socialbot.core.errors import ParameterError
from socialbot.core.reading import read_bytes
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import NODE_NAME, Delivery, Input, Output, Parameter

log = logging.getLogger("socialbot.coordinator")


class Coordinator:
    """Directs registered agents. Times are ns."""

    def __init__(
        self, domain: TeamDomain[Any], send: Send, options: CoordinatorOptions, memory: CoordinatorMemory
    ) -> None:
        self.manager = MissionManager(domain, send, options, memory)
        self.memory = memory

    def begin(self) -> None:
        """Ask all agents to register: early ones, and those in the memory."""
        self.manager.send(acl.EVERYBODY, "query", acl.Register(), "", "")

    # Messages

    def receive(self, message: acl.AclMessage, now: int) -> None:
        """Process a message. Refuse one with an unknown receiver, or an invalid one."""
        self.manager.now = now
        if message.sender == acl.COORDINATOR:
            return
        if message.receiver != acl.COORDINATOR:
            if message.receiver != acl.EVERYBODY and message.receiver not in self.memory.members:
                self._refuse(message, f"there is no {message.receiver}")
            else:
                self._note_life(message.sender)
            return
        if violation := acl.protocol_error(message):
            self._refuse(message, violation)
            return
        self._note_life(message.sender)
        match message.content:
            case acl.Register() as content if message.performative == "request":
                self._register(message, content)
            case acl.InitialTrigger() as content if message.performative == "request":
                self._request(message, content)
            case acl.Report() | acl.Problem() | acl.Finished():
                self._update(message)
            case acl.Refusal() as content:
                log.warning("%s refuses: %s", message.sender, content.reason)
                if message.mission and (mission := self._mission_of(message)):
                    self.manager.recover(mission, f"{message.sender} refuses: {content.reason}")
            case other:
                if message.performative not in ("agree", "inform"):
                    self._refuse(message, f"the coordinator does not handle {type(other).__name__}")
        self.manager.form_teams()

    def _note_life(self, name: str) -> None:
        self.manager.heard[name] = self.manager.now
        member = self.memory.members.get(name)
        if member is not None and member.aside_until == FOREVER:
            member.aside_until = 0
            self.manager.await_team()

    def _register(self, message: acl.AclMessage, content: acl.Register) -> None:
        if not NODE_NAME.fullmatch(message.sender):
            self._refuse(message, f"{message.sender!r} is no name of a node")
            return
        name, known = message.sender, self.memory.members.get(message.sender)
        member = known or RegisteredAgent(name, content.kind, frozenset())
        member.kind, member.capabilities = content.kind, frozenset(content.capabilities)
        if not message.in_reply_to:
            member.aside_until = 0
        self.memory.members[name] = member
        self.manager.on_registered(member)
        self.manager.send(name, "agree", content, "", message.id)
        mission = self.memory.missions.get(member.mission)
        if mission is not None and not message.in_reply_to:
            self.manager.recover(mission, f"{name} restarted")

    def _request(self, message: acl.AclMessage, content: acl.InitialTrigger) -> None:
        world, domain, kind = self.manager.world, self.manager.domain, content.mission_kind
        target = content.args[0] if len(content.args) == 1 else ""
        if kind not in domain.kinds or not target:
            self._refuse(message, f"a mission is one of {', '.join(domain.kinds)}, and has one argument, its target")
        elif world is None or not domain.knows(world, target):
            self._refuse(message, f"there is no target {target!r}")
        else:
            open_missions = (mission for mission in self.memory.missions.values() if mission.target == target)
            mission = next(open_missions, None) or self.manager.begin(kind, target)
            if domain.kinds[kind] > mission.priority:
                mission.kind, mission.priority = kind, domain.kinds[kind]
                self.manager.await_team(mission)
            self.manager.send(message.sender, "agree", content, mission.label, message.id)

    def _update(self, message: acl.AclMessage) -> None:
        """Update a running mission with a report of an agent."""
        mission = self._mission_of(message)
        if mission is None or mission.status != "running":
            return
        mission.touched = self.manager.now
        self.manager.redraw(mission)
        match message.content:
            case acl.Report(outcome="success", action=action, args=args):
                progress = self.manager.progress_of.get(mission.id)
                if progress is not None and progress.advance(message.sender, (action, *args)):
                    self.manager.domain.on_done(mission, (action, *args), self.manager.now)
            case acl.Problem() as problem:
                self.manager.domain.on_problem(mission, problem, message.sender, self.manager.now)
                self.manager.recover(mission, problem.kind, message.sender, (problem.action, *problem.args))
            case acl.Finished():
                self.manager.release(mission, message.sender)
                if not mission.active:
                    mission.ended = self.manager.now
                    self._conclude(mission)

    def _mission_of(self, message: acl.AclMessage) -> Mission | None:
        """The mission of a message, if its plans are current."""
        member = self.memory.members.get(message.sender)
        mission = self.memory.missions.get(member.mission) if member else None
        return mission if mission is not None and mission.label == message.mission else None

    def _refuse(self, message: acl.AclMessage, reason: str) -> None:
        if message.performative not in ("refuse", "failure"):
            log.warning("refused a message of %s: %s", message.sender, reason)
            self.manager.send(message.sender, "refuse", acl.Refusal(reason), message.mission, message.id)

    # World

    def observe(self, world: Any, now: int) -> None:
        """Process the state of the world: start and end missions, and act before problems."""
        manager, domain = self.manager, self.manager.domain
        manager.now = now
        checked = manager.observe(world)
        if manager.options.triggers:
            needing = [target for target in domain.targets(world) if checked is None or target in checked]
            served = {each.target for each in self.memory.missions.values()} | manager.given_up if needing else set()
            for target in needing:
                if target not in served and not domain.hopeless(world, target):
                    manager.begin(next(iter(domain.kinds)), target)
        missions = self.memory.missions.values()
        followed = [each for each in missions if each.status != "waiting" or checked is None or each.target in checked]
        for mission in followed:
            if hopeless := domain.hopeless(world, mission.target):
                manager.give_up(mission, hopeless)
            elif mission.status == "waiting":
                if domain.is_done(world, mission.target):
                    manager.finish(mission)
            else:
                self._follow(mission)
        manager.await_team()
        manager.form_teams()

    def _follow(self, mission: Mission) -> None:
        """Check the progress of a running mission."""
        manager = self.manager
        if mission.id not in manager.progress_of:
            # It ran at the end of an earlier coordinator, and its progress is unknown.
            if manager.domain.is_done(manager.world, mission.target):
                manager.finish(mission)
            else:
                manager.recover(mission, "the coordinator restarted")
        elif not mission.active:
            self._conclude(mission)
        else:
            self._follow_plan(mission)

    def _follow_plan(self, mission: Mission) -> None:
        """Check whether the agents of a mission go on, and act before a problem."""
        manager, label = self.manager, mission.label
        manager.follow_busy(mission)
        if mission.label != label or mission.status != "running":
            return
        if manager.now - mission.touched > nanoseconds(manager.options.patience_s):
            manager.doubt(mission)
        elif manager.options.proactive and manager.options.policy != "none":
            manager.look_ahead(mission)

    def _conclude(self, mission: Mission) -> None:
        """End a mission after its last agent, if the world shows that it is done."""
        manager = self.manager
        if manager.world is None:
            return
        done = manager.domain.is_done(manager.world, mission.target)
        if done:
            manager.finish(mission)
        elif done is not None and manager.world.stamp > mission.ended:
            manager.recover(mission, manager.domain.undone)


class TeamCoordinator(Node):
    """Directs the agents of a team. With a ``memory_file`` it continues after a restart.

    What it sends to a member travels on the topic of that member; other members do not get it.

    A subclass returns its domain from `team_domain`, and adds an input for the state of the world that calls `observe`.
    """

    deliberates = True

    heard = Input(acl.AclMessage, acl.MESSAGES)
    said = Output(acl.AclMessage, acl.MESSAGES)
    directed = Output(acl.AclMessage, acl.PRIVATE_MESSAGES)
    missions = Output(acl.Missions, acl.MISSIONS, Delivery.LATCHED)

    policy = Parameter(
        "auto",
        "reaction to a problem: choice by joint actions, new plan, repaired plan, or end of the mission",
        choices=("auto", "replan", "repair", "none"),
    )
    proactive = Parameter(True, "whether it observes the world, and acts before a problem")
    triggers = Parameter(True, "whether it starts a mission for each target that needs one")
    patience_s = Parameter(120.0, "time without news before the team is asked (s)", minimum=1.0, maximum=1e5)
    rest_s = Parameter(5.0, "time before a blocked mission is tried again (s)", minimum=0.0, maximum=1e4)
    memory_file = Parameter("", "file for missions and agents; empty: none", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for an invalid ``memory_file``."""
        super().__init__(name, context, parameters)
        path = paths.in_workspace(self.memory_file, where=f"{name}.memory_file") if self.memory_file else None
        self._memory_kept = None if path is None else StateFile(self, path, lambda: self._save(path))
        sender = acl.AclSender(acl.COORDINATOR, self.clock, self._send)
        self.coordinator = Coordinator(self.team_domain(), sender.send, self._options(), _recall(path))
        self.planning_s = self.coordinator.manager.planning_s

    def _send(self, message: acl.AclMessage) -> None:
        (self.directed if message.receiver in self.coordinator.memory.members else self.said).publish(message)

    def team_domain(self) -> TeamDomain[Any]:
        """The missions of its world; called at the start, and after a change of a parameter."""
        raise NotImplementedError

    def start(self) -> None:
        self.coordinator.begin()

    @heard
    def on_heard(self, message: acl.AclMessage) -> None:
        self.coordinator.receive(message, self.clock.now())
        self._publish()

    def observe(self, world: Any) -> None:
        """Process the state of the world."""
        self.coordinator.observe(world, self.clock.now())
        self._publish()

    def on_parameter(self, name: str) -> None:
        self.coordinator.manager.domain = self.team_domain()
        self.coordinator.manager.unchecked = None
        self.coordinator.manager.options = self._options()

    def _options(self) -> CoordinatorOptions:
        return from_builtins(dict(self.parameter_values), CoordinatorOptions)

    def _publish(self) -> None:
        """Publish and save changes."""
        manager = self.coordinator.manager
        if manager.changed:
            manager.changed = False
            self.missions.publish(acl.Missions(stamp=self.clock.now(), missions=tuple(manager.views())))
            if self._memory_kept is not None:
                self._memory_kept.changed()
        if self._memory_kept is not None:
            self._memory_kept.look()

    def _save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        paths.replace_file(path, msgspec.json.encode(self.coordinator.memory), durable=True)


def _recall(path: Path | None) -> CoordinatorMemory:
    if path is None or not path.exists():
        return CoordinatorMemory()
    try:
        return from_json(read_bytes(path), CoordinatorMemory)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ParameterError(
            f"cannot read the memory file: {error}", where=str(path), remedy="delete the file"
        ) from error
