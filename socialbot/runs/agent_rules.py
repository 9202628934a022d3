"""Rules of the agents of a graph that a run never considered, with the events that would have triggered them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from socialbot.bdi.engine import Engine
from socialbot.bdi.literals import Change, Literal
from socialbot.bdi.plans import nodes_of
from socialbot.bdi.steps import Achieve
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

if TYPE_CHECKING:
    from socialbot.bdi.plans import Plan
    from socialbot.runs.history import History

_KINDS = {Change.ADDED: "belief", Change.REMOVED: "unbelief", Change.WANTED: "goal"}
"""Kinds of the records of events."""
_ABSENT = {Change.WANTED: "the goal {} was not adopted in this run"}
_GOALS = (Change.WANTED, Change.FAILED)


class NotTriggered(msgspec.Struct, frozen=True):
    """Rule that a run never considered.

    Args:
        agent: The node.
        plan: Label of the rule, or its text.
        where: Its file and line, if known.
        event: The event that would have triggered it.
        occurred_s: Times (s) of events of this name in the run.
        leads_to: The rule in question whose goal this rule adopts; empty for that rule itself.
    """

    agent: str
    plan: str
    where: str
    event: str
    occurred_s: tuple[float, ...]
    because: str
    leads_to: str = ""


def rules_of(graph: Graph) -> dict[str, tuple[Plan, ...]]:
    """Return the rules of each agent of ``graph`` as they are now, by node; no node is started.

    Raises:
        SocialbotError: An agent cannot be created.
    """
    found = {}
    for config in (config for config in graph.nodes if config.type.is_agent):
        topics = frozenset(topic for topic, _ in config.subscriptions)
        node = InlineRunner(Graph(graph.name, (config,), inputs=topics)).nodes[config.name]
        engine = getattr(node, "engine", None)
        if isinstance(engine, Engine):
            found[config.name] = tuple(engine.library)
    return found


def not_triggered(history: History, rules: dict[str, tuple[Plan, ...]], text: str) -> tuple[NotTriggered, ...]:
    """Return the rules like ``text`` that nothing triggered, followed by the rules that adopt their goals.

    Args:
        history: The records of the run.
        rules: The rules of each agent.
        text: Label of a rule, or a part of its text.
    """
    found: list[NotTriggered] = []
    for agent, plans in rules.items():
        asked = [plan for plan in plans if text.casefold() in _name(plan).casefold()]
        reached = [(plan, "") for plan in asked]
        for plan, leads_to in reached:  # grows
            found.append(_not_triggered(history, agent, plan, leads_to))
            known = [each for each, _ in reached]
            adopting = (each for each in _adopting(plans, plan) if each not in known)
            reached += [(each, _name(plan)) for each in adopting]
    return tuple(found)


def _name(plan: Plan) -> str:
    return plan.label or str(plan)


def _adopting(plans: Sequence[Plan], plan: Plan) -> Iterator[Plan]:
    """Yield the plans with a step that adopts the goal of ``plan``."""
    if plan.event.change not in _GOALS or not isinstance(plan.event.literal, Literal):
        return
    key = plan.event.literal.key
    for each in plans:
        goals = (step.goal for step in nodes_of(each) if isinstance(step, Achieve))
        if any(isinstance(goal, Literal) and goal.key == key for goal in goals):
            yield each


def _not_triggered(history: History, agent: str, plan: Plan, leads_to: str) -> NotTriggered:
    literal, kind = plan.event.literal, _KINDS.get(plan.event.change)
    named = re.compile(rf"~?{re.escape(literal.functor)}\b") if isinstance(literal, Literal) else None
    came = [
        record
        for record in history
        if named is not None and record.kind == kind and record.source == agent and named.match(record.what)
    ]
    event = str(plan.event)
    because = _ABSENT.get(plan.event.change, "{} did not occur in this run").format(event)
    if came:
        times = f"{came[0].what} at {history.seconds(came[0].stamp):.2f} s"
        more = f" and {len(came) - 1} more" if len(came) > 1 else ""
        because = f"{event} did not apply to {times}{more}: other arguments, or its condition did not hold"
    elif kind is None:
        because = f"no rule was chosen for {event} in this run"
    place = "" if plan.origin is None else f"{Path(plan.origin.file).name}:{plan.origin.line}"
    occurred_s = tuple(history.seconds(record.stamp) for record in came)
    return NotTriggered(agent, _name(plan), place, event, occurred_s, because, leads_to)
