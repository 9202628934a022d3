"""The plans of agents at one time, as trees of tasks with what is done."""

from __future__ import annotations

import msgspec

from socialbot.inspect.history import History
from socialbot.inspect.wording import Wording
from socialbot.messages import TraceRecord
from socialbot.planning.plan import parse_plan
from socialbot.report.trees import branches


class Line(msgspec.Struct, frozen=True):
    """A line of a tree, ``depth`` tasks below the first. ``method`` is how a task is done; actions have none.

    ``mark`` is done, running, failed or empty; ``former`` belongs to a way that was given up.
    """

    depth: int
    text: str
    method: str = ""
    mark: str = ""
    former: bool = False


class Tree(msgspec.Struct, frozen=True):
    """A plan of an agent; ``id`` is that of its record. ``outcome`` is empty while it goes on."""

    id: str
    agent: str
    title: str
    outcome: str
    tree: tuple[Line, ...]


def trees_at(history: History, stamp: int, wording: Wording) -> tuple[Tree, ...]:
    """The newest plan for each desire of each agent at ``stamp`` (ns)."""
    plans: dict[tuple[str, str], TraceRecord] = {}
    ends: dict[tuple[str, object], TraceRecord] = {}
    steps: dict[str, str] = {}
    for record in history.part(0, history.until(stamp)):
        if record.kind == "plan_start":
            plans[record.source, record.what] = record
            ends.pop((record.source, record.detail.get("plan")), None)
        elif record.kind == "plan_end":
            ends[record.source, record.detail.get("plan")] = record
        elif record.kind == "step":
            steps[_key(history, record)] = "running"
        elif record.kind == "step_end":
            steps[_key(history, history.find(record.cause) or record)] = _mark(record)
    return tuple(
        _tree(plan, ends.get((plan.source, plan.detail.get("plan"))), steps, wording) for plan in plans.values()
    )


def _tree(plan: TraceRecord, end: TraceRecord | None, steps: dict[str, str], wording: Wording) -> Tree:
    number = plan.detail.get("plan", 0)
    drawing = (end.detail.get("tree") if end else None) or plan.detail.get("tree", "")
    if drawing:
        lines = tuple(
            Line(
                branch.depth,
                branch.text,
                branch.method,
                branch.mark or steps.get(f"{plan.source} {number} {_call(branch.text)}", ""),
                branch.former,
            )
            for branch in branches(drawing)
        )
    else:
        found = parse_plan("\n".join(plan.detail.get("steps", ()))).steps
        lines = tuple(
            Line(0, wording.call(step.action, step.args), mark=steps.get(f"{plan.source} {number} {step.call}", ""))
            for step in found
        )
    outcome = str(end.detail.get("outcome", "")) if end else ""
    return Tree(plan.id, plan.source, f"plan {number} for {plan.what}", outcome, lines)


def _key(history: History, step: TraceRecord) -> str:
    """The plan that a step belongs to, and its call."""
    detail = step.detail
    plan = next((each for each in history.before(step) if each.kind == "plan_start"), None)
    number = detail.get("plan", plan.detail.get("plan", 0) if plan else 0)
    return f"{detail.get('directed_by', step.source)} {number} {step.what}"


def _call(text: str) -> str:
    """``go(a, b)`` as plans write it: ``(go a b)``."""
    name, _, args = text.rstrip(")").partition("(")
    return f"({' '.join((name, *filter(None, args.split(', '))))})"


def _mark(end: TraceRecord) -> str:
    return {"successful": "done", "failed": "failed"}.get(str(end.detail.get("outcome")), "")
