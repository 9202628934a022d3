"""Results of missions, and the event log of a team: trace records that follow from its messages.

A mission is a desire of the coordinator, plans for a team are a plan, and a command to the world is a step. So
narration, charts and comparisons treat a team like deliberating agents.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar

from socialbot.agents.teams import messages as content
from socialbot.agents.teams.messages import (
    CANCELLED,
    COORDINATOR,
    AclMessage,
    ActionCommand,
    ActionResult,
    Missions,
    MissionView,
)
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.node import Graph


@dataclass
class MissionResult:
    """Course of a mission: its latest state, number of actions in the first plan, times (ns) and problems."""

    view: MissionView
    planned: int = 0
    began: int | None = None
    ended: int | None = None
    problems: list[str] = field(default_factory=list)

    def take(self, stamp: int, view: MissionView) -> None:
        """Update the result from the state of the mission at ``stamp`` (ns)."""
        if self.began is None and view.status == "running":
            self.began, self.planned = stamp, len(view.actions)
        has_failed = self.ended is None and view.status == "failed"
        if self.ended is None and view.status in ("finished", "failed"):
            self.ended = stamp
        if view.problem and (has_failed or view.recoveries > self.view.recoveries):
            self.problems.append(view.problem)
        self.view = view

    @property
    def finished(self) -> bool:
        return self.view.status == "finished"

    @property
    def took_s(self) -> float | None:
        """Time from the first plan to the end."""
        return None if self.began is None or self.ended is None else (self.ended - self.began) / SECOND

    def done(self, status: str = "done") -> int:
        """Number of actions with this status."""
        return sum(each.status == status for each in self.view.actions)

    def results(self) -> dict[str, Any]:
        """The result as plain data."""
        view = self.view
        return {
            "id": view.id,
            "kind": view.kind,
            "room": view.target,
            "status": view.status,
            "planned": self.planned,
            "done": self.done(),
            "failed": self.done("failed"),
            "problems": list(self.problems),
            "recoveries": view.recoveries,
            "revisions": view.revisions,
            "took_s": None if self.took_s is None else round(self.took_s, 3),
        }


@dataclass
class MissionResults:
    """Results of all missions of a run, by number."""

    missions: dict[int, MissionResult] = field(default_factory=dict)

    def take(self, message: Message) -> None:
        """Update the results from a message; ignore messages of other types."""
        if isinstance(message, Missions):
            for view in message.missions:
                self.missions.setdefault(view.id, MissionResult(view.untouched())).take(message.stamp, view)

    def sorted(self) -> list[MissionResult]:
        """The results by number."""
        return [result for _, result in sorted(self.missions.items())]


TRIGGER = "trigger_"
"""Prefix of beliefs that make a partner continue."""


@dataclass
class _Mission:
    """Latest state of a mission; ``plan`` is the number of its plan, 0 for none."""

    name: str
    view: MissionView
    plan: int = 0
    desire: str = ""


class TeamEventLog:
    """Derives trace records from the messages of a team, in their order.

    ``reason`` says why a mission is needed, with its target as {0}, and ``changed`` why a plan is revised.
    """

    kinds: ClassVar[tuple[type[Message], ...]] = (AclMessage, Missions, ActionCommand, ActionResult)

    def __init__(self, reason: str = "{0} needs it", changed: str = "the world has changed") -> None:
        self._reason, self._changed = reason, changed
        self._missions: dict[int, _Mission] = {}
        self._plans = itertools.count(1)
        self._numbers = itertools.count(1)
        self._plan_of: dict[str, int] = {}
        """Plan number by agent."""

    def take(self, message: Message) -> list[TraceRecord]:
        """The records that follow from a message."""
        match message:
            case Missions():
                return [record for view in message.missions for record in self._mission(message.stamp, view)]
            case ActionCommand(stamp=stamp, robot=robot, action=action, args=args):
                plan = self._plan_of.get(robot)
                directed = {} if plan is None else {"plan": plan, "directed_by": COORDINATOR}
                detail = {"action": action, "args": list(args), **directed}
                return [_record(stamp, message.id, robot, "step", call_of(action, args), detail=detail)]
            case ActionResult(stamp=stamp, id=id, reason=reason):
                outcome = "cancelled" if reason == CANCELLED else "failed" if reason else "successful"
                call, detail = call_of(message.action, message.args), {"outcome": outcome, "message": reason}
                return [_record(stamp, f"{id}-result", message.robot, "step_end", call, id, detail)]
            case AclMessage(stamp=stamp, id=id, sender=sender, in_reply_to=cause):
                weight, text = _sentence(message)
                detail = {
                    "receiver": message.receiver,
                    "performative": message.performative,
                    "content": type(message.content).__name__,
                    "mission": message.mission,
                    "weight": weight,
                }
                return [_record(stamp, id, sender, "said", text, cause, detail)]
        return []

    def _mission(self, stamp: int, view: MissionView) -> Iterator[TraceRecord]:
        known = self._missions.get(view.id)
        if known is None:
            known = self._missions[view.id] = _Mission(f"{view.kind} {view.target}", view.untouched())
            wanted = self._decision(
                stamp, "desire", known.name, self._reason.format(view.target), priority=view.priority
            )
            known.desire = wanted.id
            yield wanted
        before, known.view = known.view, view
        goes_on = view.status == "running" and view.label == before.label
        if known.plan and not goes_on:
            yield self._end(stamp, known, before)
        if view.status == "running" and not known.plan:
            yield self._begin(stamp, known)
        if view.status != before.status and view.status in ("finished", "failed"):
            kind, reason = ("desire_fulfilled", "") if view.status == "finished" else ("desire_dropped", view.problem)
            yield self._decision(stamp, kind, known.name, known.desire, reason=reason)

    def _begin(self, stamp: int, mission: _Mission) -> TraceRecord:
        mission.plan, view = next(self._plans), mission.view
        self._plan_of.update(dict.fromkeys(view.team, mission.plan))
        steps = [f"0.000: {call_of(each.action, each.args)}" for each in view.actions if each.status == "planned"]
        plan = {"plan": mission.plan, "steps": steps, "makespan_s": None, "beside": True}
        about = {"mission": view.id, "label": view.label, "team": list(view.team), "tree": view.tree}
        return self._decision(stamp, "plan_start", mission.name, mission.desire, **plan, **about)

    def _end(self, stamp: int, mission: _Mission, before: MissionView) -> TraceRecord:
        view, number = mission.view, mission.plan
        mission.plan = 0
        self._plan_of = {name: plan for name, plan in self._plan_of.items() if plan != number}
        if view.status == "finished":
            outcome, reason = "succeeded", ""
        elif view.status == "failed" or view.recoveries > before.recoveries:
            outcome, reason = "failed", view.problem
        else:
            outcome = "aborted"
            reason = self._changed if view.revisions > before.revisions else view.problem
        tree = view.tree if view.status == "finished" else before.tree
        end = {"plan": number, "label": before.label, "outcome": outcome, "reason": reason, "tree": tree}
        return self._decision(stamp, "plan_end", mission.name, mission.desire, **end)

    def _decision(self, stamp: int, kind: str, what: str, cause: str, **detail: Any) -> TraceRecord:
        """Record of the coordinator."""
        return _record(stamp, f"{COORDINATOR}-told-{next(self._numbers)}", COORDINATOR, kind, what, cause, detail)


def event_log(graph: Graph) -> TeamEventLog | None:
    """The event log of the team in ``graph``; None for a graph without a coordinator."""
    return TeamEventLog() if Missions in graph.topics().values() else None


def call_of(action: str, args: Iterable[str]) -> str:
    """An action as in a PDDL plan: ``(a_charge spotrobot1)``."""
    return f"({' '.join((action, *args))})"


def _record(
    stamp: int, id: str, source: str, kind: str, what: str, cause: str = "", detail: dict[str, Any] | None = None
) -> TraceRecord:
    return TraceRecord(stamp=stamp, id=id, source=source, kind=kind, what=what, cause=cause, detail=detail or {})


def _sentence(message: AclMessage) -> tuple[str, str]:
    """Weight and sentence of a speech act."""
    to = message.receiver
    match message.content:
        case content.Register(kind=kind, capabilities=able):
            if message.performative == "agree":
                return "", f"registers {to}"
            return "", f"registers as {kind}, which can {', '.join(able)}" if kind else "asks all agents to register"
        case content.Plan(label=label, plans=plans):
            return "plan", f"sends {to} {len(plans)} plans of {label}"
        case content.Belief(literal=literal):
            if literal.startswith(TRIGGER):
                return "word", f"tells {to} to start {literal.removeprefix(TRIGGER).partition('(')[0]}"
            return "", f"tells {to}: {literal}"
        case content.Start(arguments=arguments):
            return "", f"sends {to} start({', '.join(arguments)})"
        case content.Stop(reason=reason):
            return "problem", f"tells {to} to stop: {reason}"
        case content.End():
            return "", f"tells {to} that the mission is over"
        case content.Ready(action=action):
            return "", f"is ready for {action} and waits for {to}"
        case content.Done(action=action):
            return "", f"begins {action} with {to}"
        case content.Report(outcome=outcome, action=action, reason=reason):
            return "", f"reports {action}: {outcome}{f', {reason}' if reason else ''}"
        case content.Problem(kind=kind, action=action, args=args):
            return "problem", f"reports {kind}: {action}({', '.join(args)})"
        case content.Finished():
            return "", "has finished its part"
        case content.InitialTrigger(mission_kind=kind, args=args):
            return "plan", f"{'agrees to' if message.sender == COORDINATOR else 'asks for'} {kind} {' '.join(args)}"
        case content.Refusal(reason=reason):
            return "problem", f"refuses a message of {to}: {reason}"
