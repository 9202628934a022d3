"""Hospital without BDI: a coordinator that plans once, and robots that execute single actions.

It is the baseline for comparisons. The coordinator requests each action as a `Plan` with one literal, and continues
when all agents have reported. The first problem ends the mission.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, NamedTuple

from socialbot.agents.hospital.missions import DISINFECT, Disinfection, HospitalCoordinator
from socialbot.agents.hospital.robot_node import HospitalMember, Nurse, Spot, Uvd
from socialbot.agents.hospital.ward.messages import MESSAGES, MISSIONS, STATE, WardState
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS, NURSE, ROBOTS, ROLES, SPOT, UVD
from socialbot.agents.teams import messages as acl
from socialbot.agents.teams.actions import as_literal, names_of
from socialbot.agents.teams.missions import AgentPool, Mission, PlanProgress, RegisteredAgent, view
from socialbot.bdi.agentspeak.parser import parse_literal
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.core.errors import SocialbotError
from socialbot.graph.node import Context, Graph, Node
from socialbot.graph.ports import Delivery, Input, Output


class _Running(NamedTuple):
    """The present mission, its plan, and the agents whose reports are missing."""

    mission: Mission
    progress: PlanProgress
    awaited: set[str]


class ScriptedCoordinator(Node):
    """Disinfects one room after the other; the rooms of failed missions stay as they are."""

    heard = Input(acl.AclMessage, MESSAGES)
    state = Input(WardState, STATE, Delivery.LATCHED)
    said = Output(acl.AclMessage, MESSAGES)
    directed = Output(acl.AclMessage, acl.PRIVATE_MESSAGES)
    missions = Output(acl.Missions, MISSIONS, Delivery.LATCHED)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._sender = acl.AclSender(name, self.clock, self._send)
        self.planning_s: list[float] = []
        """Durations of plannings, s."""
        self._domain = Disinfection()
        self._members: dict[str, RegisteredAgent] = {}
        self._ward: WardState | None = None
        self._running: _Running | None = None
        self._over: list[acl.MissionView] = []

    def start(self) -> None:
        self._sender.send(acl.EVERYBODY, "query", acl.Register())

    def _send(self, message: acl.AclMessage) -> None:
        (self.directed if message.receiver in self._members else self.said).publish(message)

    @heard
    def on_heard(self, message: acl.AclMessage) -> None:
        if message.receiver != self.name:
            return
        content = message.content
        if isinstance(content, acl.Register):
            name, capabilities = message.sender, frozenset(content.capabilities)
            self._members[name] = RegisteredAgent(name, content.kind, capabilities)
            self._sender.send(message.sender, "agree", content, in_reply_to=message.id)
            self._begin()
        elif self._running is not None and message.mission == self._running.mission.label:
            match content:
                case acl.Report(outcome="success"):
                    self._done_by(message.sender, self._running)
                case acl.Problem(kind=problem) | acl.Refusal(reason=problem):
                    self._end(self._running, "failed", problem)
                case _:
                    pass

    @state
    def on_state(self, message: WardState) -> None:
        self._ward = message
        self._conclude()
        self._begin()

    def _begin(self) -> None:
        """Plan the mission for the next room, if there is one, and a team."""
        if self._running is not None or self._ward is None:
            return
        tried = {over.target for over in self._over if over.status == "failed"}
        room = next((room.name for room in self._ward.rooms if room.infected and room.name not in tried), None)
        if room is None:
            return
        mission = Mission(len(self._over) + 1, DISINFECT, room, status="running", revision=1)
        team = AgentPool(self._domain, self._members, self._ward).team(mission)
        if team is None:
            return
        mission.team = team
        state = self._domain.state(self._ward, mission, sees=False)
        answer = self._domain.planner.plan(mission, state, self._domain.tasks(mission))
        self.planning_s.append(answer.seconds)
        if answer.tree is None:
            mission.status, mission.problem = "failed", answer.message
            self._over.append(view(mission, None))
            self._publish()
            return
        self._running = _Running(mission, PlanProgress(answer.tree, team.values(), JOINT_ACTIONS), set())
        self._request(self._running)

    def _request(self, running: _Running) -> None:
        """Request the present action from its agents."""
        mission, stage = running.mission, running.progress.stages[running.progress.position]
        running.awaited.update(stage.agents)
        action = agentspeak(as_literal(stage.action, stage.args))
        for agent in stage.agents:
            self._sender.send(agent, "request", acl.Plan(mission.label, (action,)), mission.label)
        self._publish()

    def _done_by(self, agent: str, running: _Running) -> None:
        if agent not in running.awaited:
            return
        running.awaited.remove(agent)
        if running.awaited:
            return
        running.progress.position += 1
        if running.progress.next is not None:
            self._request(running)
        else:
            running.mission.ended = self.clock.now()
            self._conclude()

    def _conclude(self) -> None:
        """End a mission without actions left, if the ward shows its effect."""
        running, ward = self._running, self._ward
        if running is None or ward is None or running.progress.next is not None:
            return
        room = ward.room(running.mission.target)
        if room is not None and room.disinfected:
            self._end(running, "finished")
        elif room is not None and ward.stamp > running.mission.ended:
            self._end(running, "failed", "the room is not disinfected")

    def _end(self, running: _Running, status: acl.MissionStatus, problem: str = "") -> None:
        mission, progress = running.mission, running.progress
        mission.status, mission.problem = status, problem
        mission.past = progress.executed(failed=status == "failed")
        self._over.append(view(mission, None))
        self._running = None
        for name in mission.team.values():
            self._sender.send(name, "request", acl.End() if status == "finished" else acl.Stop(problem), mission.label)
        self._publish()
        self._begin()

    def _publish(self) -> None:
        running = [view(self._running.mission, self._running.progress)] if self._running else []
        self.missions.publish(acl.Missions(stamp=self.clock.now(), missions=(*self._over, *running)))


class ScriptedAgent(HospitalMember):
    """Executes single actions, and reports their results."""

    kind: ClassVar[str] = ""
    """Its kind in the ward."""

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._missions: dict[str, str] = {}
        """Missions of the actions in progress, by command."""

    def start(self) -> None:
        self.register()

    def registration(self) -> acl.Register:
        return acl.Register(self.kind, actions_of(self.kind))

    @HospitalMember.heard
    @HospitalMember.private
    def on_heard(self, message: acl.AclMessage) -> None:
        if message.sender == self.name or message.receiver not in (self.name, acl.EVERYBODY):
            return
        match message.content:
            case acl.Register() if message.performative == "query":
                self.register(message.id)
            case acl.Register():
                self._registered = True
            case acl.Plan(plans=(action,)):
                self._do(action, message)
            case acl.Stop() | acl.End():
                self._give_up(message.mission)
            case _:
                pass

    def _give_up(self, mission: str) -> None:
        """Cancel the actions of a mission."""
        for id in [id for id, other in self._missions.items() if other == mission]:
            del self._missions[id]
            self.cancel(id)

    def _do(self, text: str, message: acl.AclMessage) -> None:
        try:
            action = parse_literal(text)
        except SocialbotError as error:
            self._sender.send(message.sender, "refuse", acl.Refusal(str(error)), message.mission, message.id)
            return
        id = self.next_command()
        self._missions[id] = message.mission
        self.command(id, action.functor, names_of(action.args))

    @HospitalMember.results
    def on_result(self, message: acl.ActionResult) -> None:
        mission = self._missions.pop(message.id, None)
        if mission is None:
            return
        report = acl.Report(message.outcome, message.action, message.args, message.reason)
        self._sender.send(acl.COORDINATOR, "inform", report, mission)
        if message.outcome == "failure":
            self._sender.send(
                acl.COORDINATOR, "inform", acl.Problem(message.reason, message.args, message.action), mission
            )


def actions_of(kind: str) -> tuple[str, ...]:
    """Actions that a kind of agent can execute."""
    able = {kind, "agent"} | ({"robot"} if kind in ROBOTS else set())
    return tuple(
        action for action, roles in ROLES.items() if able.intersection(roles if action in JOINT_ACTIONS else roles[:1])
    )


class ScriptedSpot(ScriptedAgent):
    """A robot that patrols rooms."""

    kind = SPOT


class ScriptedUvd(ScriptedAgent):
    """A robot that disinfects rooms."""

    kind = UVD


class ScriptedNurse(ScriptedAgent):
    """The screen of a nurse in her room."""

    kind = NURSE


SCRIPTED: Mapping[type[Node], type[Node]] = {
    HospitalCoordinator: ScriptedCoordinator,
    Spot: ScriptedSpot,
    Uvd: ScriptedUvd,
    Nurse: ScriptedNurse,
}
"""Scripted node types for those with BDI."""


def scripted(graph: Graph) -> Graph:
    """The graph with scripted nodes instead of BDI agents; the ward stays."""
    return replace(
        graph,
        nodes=tuple(
            replace(config, type=SCRIPTED[config.type], parameters={}) if config.type in SCRIPTED else config
            for config in graph.nodes
        ),
    )
