"""Traces of small runs, written by hand."""

from __future__ import annotations

from typing import Any

import msgspec

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import parse_graph
from socialbot.graph.node import Node

PHRASES = {"go": "goes from {1} to {2}", "ask_help": "asks {1} to help"}


class Thinker(Node):
    """Agent type with phrases that does nothing."""

    deliberates = True
    phrases = PHRASES


GRAPH = parse_graph(f"name: g\nnodes:\n  ann: {{type: '{__name__}:Thinker'}}\n", where="deliberating_runs.py")


def record(
    seconds: float, source: str, kind: str, what: str, cause: str = "", id: str = "", **detail: Any
) -> TraceRecord:
    """A record at ``seconds`` after an arbitrary start."""
    stamp = nanoseconds(100.0 + seconds)
    return TraceRecord(
        stamp=stamp,
        id=id or f"{source}-{kind}-{what}-{seconds}",
        source=source,
        kind=kind,
        what=what,
        cause=cause,
        detail=detail,
    )


def desire(seconds: float, agent: str, name: str, cause: str = "desires.yaml", deadline: float = 20.0) -> TraceRecord:
    return record(seconds, agent, "desire", name, cause, priority=0.5, deadline=deadline)


def plan(seconds: float, agent: str, name: str, number: int, *steps: str, makespan_s: float = 5.0) -> TraceRecord:
    return record(seconds, agent, "plan_start", name, plan=number, steps=list(steps), makespan_s=makespan_s)


def plan_end(seconds: float, agent: str, name: str, number: int, outcome: str, reason: str = "") -> TraceRecord:
    return record(seconds, agent, "plan_end", name, plan=number, outcome=outcome, reason=reason)


def step(seconds: float, agent: str, call: str, planned: float = 0.0) -> TraceRecord:
    action, *args = call.strip("()").split()
    return record(seconds, agent, "step", call, action=action, args=args, planned_start=planned, conditions=[])


def step_end(seconds: float, agent: str, call: str, outcome: str = "successful", **more: Any) -> TraceRecord:
    return record(seconds, agent, "step_end", call, outcome=outcome, **more)


def request(seconds: float, agent: str, what: str, number: str) -> TraceRecord:
    asked = record(seconds, agent, "asked", what)
    return msgspec.structs.replace(asked, kind="request", id=f"{agent}-request-{what}-{seconds}", detail={"id": number})


HALL, YARD = "(go ann hall yard)", "(go ann yard hall)"

DETOUR = (
    desire(0.0, "ann", "be_home"),
    plan(0.0, "ann", "be_home", 1, f"0.000: {HALL} [2.000]", f"2.001: {YARD} [3.000]", makespan_s=5.0),
    step(0.0, "ann", HALL),
    step_end(2.5, "ann", HALL),
    step_end(3.0, "ann", YARD, "failed", message="the door is locked"),
    plan_end(3.0, "ann", "be_home", 1, "failed", f"{YARD}: the door is locked"),
    plan(3.0, "ann", "be_home", 2, "0.000: (ask_help ann bob) [4.000]", makespan_s=4.0),
    step(3.0, "ann", "(ask_help ann bob)"),
    request(3.0, "ann", "ann asks bob to add desire open_door", "ann-1"),
    record(3.0, "bob", "asked", "ann asks bob to add desire open_door", "ann-1"),
    desire(3.0, "bob", "open_door", "ann-1", deadline=6.0),
    plan(3.0, "bob", "open_door", 1, "0.000: (unlock bob door) [4.000]", makespan_s=4.0),
    step(3.0, "bob", "(unlock bob door)"),
    record(3.0, "ann", "reply", "bob: done", "ann-1", reason=""),
    step_end(6.5, "bob", "(unlock bob door)"),
    plan_end(6.5, "bob", "open_door", 1, "succeeded"),
    record(6.5, "bob", "desire_fulfilled", "open_door", reason=""),
    record(6.5, "ann", "reply", "bob: fulfilled", "ann-1", reason=""),
    step_end(7.0, "ann", "(ask_help ann bob)"),
    plan_end(7.0, "ann", "be_home", 2, "succeeded"),
    record(7.0, "ann", "desire_fulfilled", "be_home", reason=""),
)
"""Ann finds a door locked, gives up her plan, and has Bob open it."""
