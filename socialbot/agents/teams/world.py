"""Simulated world for teams: executes the actions of a task domain, with durations and faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import msgspec

from socialbot.agents.base._simulation import SimulatedWorld, WorldFault, parse_world_faults
from socialbot.agents.teams.messages import (
    CANCELLED,
    CANCELS,
    COMMANDS,
    PARTNER_ABSENT,
    RESULTS,
    STATE,
    ActionCancel,
    ActionCommand,
    ActionResult,
)
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Structured
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.planning.htn.domain import TaskDomain, TaskState

ALL_SENSORS = "state"
"""Name that stands for all sensors of a world."""
PARTNER_WAIT_S = 10.0
"""Longest wait of a joint action for the other agents."""


class TeamMemberState(msgspec.Struct, frozen=True):
    """An agent of a team: ``busy`` is its action, as ``a_take(runner1, book1)``, or empty."""

    name: str
    home: str = ""
    busy: str = ""


class TeamState(Structured, frozen=True, kw_only=True, dict=True):
    """State of a simulated world by its sensors: the variables of its task domain, and the agents that it shows."""

    variables: dict[str, Any]
    agents: tuple[TeamMemberState, ...]

    def agent(self, name: str) -> TeamMemberState | None:
        """An agent; None if no sensor shows it."""
        return self._agent_by_name.get(name)

    @cached_property
    def _agent_by_name(self) -> dict[str, TeamMemberState]:
        return {agent.name: agent for agent in self.agents}


TEAM_WORLD_MESSAGES: tuple[type[Structured], ...] = (TeamState,)


@dataclass
class Activity:
    """An action in progress, or one that waits for partners; ``ids`` are its commands with their times, by agent."""

    action: str
    args: tuple[str, ...]
    ids: dict[str, tuple[str, int]] = field(default_factory=dict)
    due: int = -1
    over: bool = False

    def __str__(self) -> str:
        return f"{self.action}({', '.join(self.args)})"

    def results(self, now: int, reason: str) -> Iterator[ActionResult]:
        """The results of its commands at ``now`` (ns); an empty reason means success."""
        outcome = "failure" if reason else "success"
        for robot, (id, begun) in self.ids.items():
            yield ActionResult(
                stamp=now, id=id, robot=robot, action=self.action, args=self.args, outcome=outcome, reason=reason,
                duration_s=(now - begun) / SECOND,
            )  # fmt: skip


class TeamWorld(Node):
    """Simulated world of a team. A subclass says with what it begins, and how long its actions take.

    An action of the domain that returns no state fails when it is due. Faults: an agent ``stalls`` for a duration; the
    sensor of an agent, or `ALL_SENSORS`, is ``silent`` for one; an object ``vanishes`` from all variables.
    """

    is_simulator = True
    domain: ClassVar[TaskDomain]
    seconds: ClassVar[Mapping[str, float]] = {}
    """Durations of actions (s); 1 s for others."""
    joint_actions: ClassVar[frozenset[str]] = frozenset()

    commands = Input(ActionCommand, COMMANDS)
    cancels = Input(ActionCancel, CANCELS)
    results = Output(ActionResult, RESULTS)
    state = Output(TeamState, STATE, Delivery.LATCHED)

    faults = Parameter("", "faults: 5 stalls runner1 1000; 7 vanishes book2; 9 silent porter1 20", fixed=True)
    period_s = Parameter(0.5, "period of the sensors (s)", minimum=0.01, maximum=10.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for unknown faults."""
        super().__init__(name, context, parameters)
        self.variables = self.initial()
        self.homes = dict(self.members())
        self._activities: dict[str, Activity] = {}
        self._silent_until: dict[str, int] = {}
        self._time = SimulatedWorld(self.clock.now())
        self._timer: Timer | None = None
        self._faults = self._parse_faults()

    def initial(self) -> TaskState:
        """The state at the start."""
        raise NotImplementedError

    def members(self) -> Mapping[str, str]:
        """The agents with their homes."""
        raise NotImplementedError

    def busy_s(self, member: str) -> float:
        """Time until a member finishes its action (s); 0 if it is idle or waits for a partner."""
        activity = self._activities.get(member)
        return 0.0 if activity is None or activity.due < 0 else (activity.due - self._time.now) / SECOND

    def start(self) -> None:
        self._time = SimulatedWorld(self.clock.now())
        for fault in self._faults:
            self._time.after(fault.time_s, lambda fault=fault: self._apply_fault(fault))
        self._report()

    def _parse_faults(self) -> tuple[WorldFault, ...]:
        objects = {key for each in self.variables.variables().values() if isinstance(each, dict) for key in each}
        targets = {"stalls": self.homes, "silent": {*self.homes, ALL_SENSORS}, "vanishes": objects - set(self.homes)}
        return parse_world_faults(self.faults, targets, ("stalls", "silent"), type(self).faults.doc)

    def _apply_fault(self, fault: WorldFault) -> None:
        until = self._time.now + nanoseconds(fault.duration_s or 0.0)
        match fault.kind:
            case "stalls":
                self._stall(fault.target, until - self._time.now)
            case "silent":
                self._silent_until[fault.target] = until
            case _:
                for variable in self.variables.variables().values():
                    if isinstance(variable, dict):
                        variable.pop(fault.target, None)

    def _stall(self, agent: str, pause: int) -> None:
        activity = self._activities.get(agent)
        if activity is None:
            self._time.after(0.1, lambda: self._stall(agent, pause))
        elif activity.due >= 0:
            activity.due += pause
            self._time.at(activity.due, lambda: self._finish(activity))

    # Commands

    @commands
    def on_command(self, command: ActionCommand) -> None:
        self._time.advance(self.clock.now())
        if refusal := self._refusal(command):
            ids = {command.robot: (command.id, self._time.now)}
            self._publish_results(Activity(command.action, command.args, ids), refusal)
            return
        key = (command.action, command.args)
        same = (each for each in self._activities.values() if (each.action, each.args) == key and each.due < 0)
        activity = next(same, None) or Activity(*key)
        self._activities[command.robot] = activity
        activity.ids[command.robot] = (command.id, self._time.now)
        if command.action in self.joint_actions and not {*command.args}.intersection(self.homes) <= activity.ids.keys():
            self._time.after(PARTNER_WAIT_S, lambda: self._end(activity, PARTNER_ABSENT) if activity.due < 0 else None)
        else:
            activity.due = self._time.now + nanoseconds(self.seconds.get(command.action, 1.0))
            self._time.at(activity.due, lambda: self._finish(activity))
        self._publish()

    def _refusal(self, command: ActionCommand) -> str:
        if command.robot not in self.homes:
            return f"there is no {command.robot!r}"
        if command.action not in self.domain.actions:
            return f"there is no action {command.action!r}"
        if not self.domain.actions[command.action].takes(len(command.args)):
            return f"{command.action} has other arguments"
        busy = self._activities.get(command.robot)
        return f"{command.robot} is busy with {busy}" if busy else ""

    @cancels
    def on_cancel(self, cancel: ActionCancel) -> None:
        self._time.advance(self.clock.now())
        for activity in list(self._activities.values()):
            if not activity.over and any(id == cancel.id for id, _ in activity.ids.values()):
                self._end(activity, CANCELLED)
        self._publish()

    def _finish(self, activity: Activity) -> None:
        if activity.over or activity.due > self._time.now:
            return
        operator = self.domain.actions[activity.action]
        try:
            after = operator.function(self.variables.copy(), *activity.args)
        except KeyError as missing:
            self._end(activity, f"there is no {missing.args[0]}")
            return
        if isinstance(after, TaskState):
            self.variables = after
        self._end(activity, "" if isinstance(after, TaskState) else f"{activity.action} is not possible")

    def _end(self, activity: Activity, reason: str) -> None:
        if activity.over:
            return
        activity.over = True
        for name in activity.ids:
            del self._activities[name]
        self._publish_results(activity, reason)

    def _publish_results(self, activity: Activity, reason: str) -> None:
        for result in activity.results(self._time.now, reason):
            self.results.publish(result)

    # Sensors

    def _report(self) -> None:
        self._time.advance(self.clock.now())
        self._publish()
        self.context.call_at(self.clock.now() + nanoseconds(self.period_s), self._report)

    def _on_event(self) -> None:
        self._timer = None
        self._time.advance(self.clock.now())
        self._publish()

    def _publish(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due = self._time.next_event
        self._timer = None if due is None else self.context.call_at(due, self._on_event)
        if not self._is_silent(ALL_SENSORS):
            agents = tuple(
                TeamMemberState(name, home, str(self._activities.get(name, "")))
                for name, home in self.homes.items()
                if not self._is_silent(name)
            )
            seen = self.variables.copy().variables()
            self.state.publish(TeamState(stamp=self.clock.now(), variables=seen, agents=agents))

    def _is_silent(self, sensor: str) -> bool:
        return self._time.now < self._silent_until.get(sensor, 0)
