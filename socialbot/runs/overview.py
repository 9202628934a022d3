"""What a page needs to know of a run before it shows anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from socialbot.core.clock import SECOND
from socialbot.runs.commands import Office
from socialbot.runs.history import History
from socialbot.runs.names import plan_name
from socialbot.runs.run import GraphView, Run


class PlanView(msgspec.Struct, frozen=True):
    """A plan that an agent has considered for an event, and how often it was chosen."""

    label: str
    chosen: int
    rejected: int


class AgentView(msgspec.Struct, frozen=True):
    """An agent: the name in the records, what people call it, and its plans."""

    name: str
    called: str
    plans: tuple[PlanView, ...]


class Has(msgspec.Struct, frozen=True):
    """What there is to show; ``commands``: whether agents may be asked for something, and ``why_not``."""

    pictures: bool
    world: bool
    trees: bool
    commands: bool
    why_not: str


class Overview(msgspec.Struct, frozen=True):
    """A run in short. A page of its record opens at ``opens_s``, where there is something to see.

    It began at ``began_s`` (s since 1970, where its time is not simulated). Of one that has
    been live for long what was before ``since_s`` is forgotten.
    """

    title: str
    live: bool
    began_s: float
    since_s: float
    duration_s: float
    opens_s: float
    agents: tuple[AgentView, ...]
    graph: GraphView
    has: Has
    results: Mapping[str, Any]


def overview(run: Run, office: Office) -> Overview:
    """``run`` in short; ``office`` takes what people ask of agents."""
    end = run.end
    return Overview(
        title=run.title,
        live=run.live,
        began_s=run.history.start / SECOND,
        since_s=run.history.seconds(run.history.since),
        duration_s=run.history.seconds(end),
        opens_s=_opens_s(run.history),
        agents=tuple(_agents(run)),
        graph=run.graph(),
        has=Has(
            pictures=run.sees,
            world=run.world(end) is not None,
            trees=any(record.kind == "plan_start" for record in run.history),
            commands=not office.shut,
            why_not=office.shut,
        ),
        results=run.results,
    )


def _opens_s(history: History) -> float:
    """When the first word was said (s), where none was when something was done first, else the start."""
    done = (each for each in history if each.kind in ("action", "step"))
    first = next((each for each in history if each.kind == "utterance"), None) or next(done, None)
    return history.seconds(first.stamp) if first is not None else 0.0


def _agents(run: Run) -> Iterator[AgentView]:
    """Those that have done something in the order in which they did, and those of which nothing is known yet."""
    chosen: dict[tuple[str, str], int] = {}
    rejected: dict[tuple[str, str], int] = {}
    for record in run.history:
        if record.kind == "plan":
            key = (record.source, plan_name(record))
            chosen[key] = chosen.get(key, 0) + 1
        found = record.detail.get("rejected")
        for each in found if isinstance(found, (list, tuple)) else ():
            key = (record.source, str(each.get("plan", "")))
            rejected[key] = rejected.get(key, 0) + 1
    known = dict.fromkeys([*chosen, *rejected])
    silent = (node.name for node in run.graph().nodes if node.agent)
    for name in dict.fromkeys((*run.history.agents, *silent)):
        plans = (
            PlanView(label, chosen.get((agent, label), 0), rejected.get((agent, label), 0))
            for agent, label in known
            if agent == name
        )
        yield AgentView(name, run.wording.name(name), tuple(plans))
