"""The plans of agents at one time, as trees of tasks with what is done."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.planning.pddl.domain import PlanStep, parse_plan
from socialbot.runs.history import History
from socialbot.runs.names import Wording
from socialbot.runs.report_trees import Branch, branches


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
    ends: dict[_Plan, TraceRecord] = {}
    marks: dict[_Plan, _Marks] = defaultdict(_Marks)
    for record in history.part(0, history.until(stamp)):
        if record.kind == "plan_start":
            plans[record.source, record.what] = record
            ends.pop((record.source, record.detail.get("plan")), None)
            marks.pop((record.source, record.detail.get("plan", 0)), None)
        elif record.kind == "plan_end":
            ends[record.source, record.detail.get("plan")] = record
        elif record.kind == "step":
            marks[_plan(history, record)].begin(record.what)
        elif record.kind == "step_end":
            step = history.find(record.cause) or record
            marks[_plan(history, step)].end(step.what, _mark(record))
    return tuple(
        _tree(
            plan,
            ends.get((plan.source, plan.detail.get("plan"))),
            marks[plan.source, plan.detail.get("plan", 0)],
            wording,
        )
        for plan in plans.values()
    )


_Plan = tuple[str, object]
"""The agent whose plan it is, and its number."""


class _Marks:
    """How far the steps of a plan have come. Of equal ones the next is begun only when the one before is done."""

    def __init__(self) -> None:
        self._calls: dict[str, list[str]] = {}

    def begin(self, call: str) -> None:
        begun = self._calls.setdefault(call, [])
        if not begun or begun[-1] == "done":
            begun.append("running")
        else:
            begun[-1] = "running"  # tried again

    def end(self, call: str, mark: str) -> None:
        begun = self._calls.setdefault(call, [""])
        begun[-1] = mark

    def of(self, call: str, number: int) -> str:
        """The mark of the step of this ``call`` and ``number`` among the equal ones."""
        begun = self._calls.get(call, [])
        return begun[number] if 0 <= number < len(begun) else ""


def _tree(plan: TraceRecord, end: TraceRecord | None, marks: _Marks, wording: Wording) -> Tree:
    number = plan.detail.get("plan", 0)
    made = str(plan.detail.get("tree", ""))
    drawing = (end.detail.get("tree") if end else None) or made
    if drawing:
        lines = tuple(_lines_drawn(branches(drawing), branches(made), marks))
    else:
        lines = tuple(_lines(parse_plan("\n".join(plan.detail.get("steps", ()))).steps, marks, wording))
    outcome = str(end.detail.get("outcome", "")) if end else ""
    return Tree(plan.id, plan.source, f"plan {number} for {plan.what}", outcome, lines)


def _lines(steps: Sequence[PlanStep], marks: _Marks, wording: Wording) -> Iterator[Line]:
    equal: Counter[str] = Counter()
    for step in steps:
        yield Line(0, wording.call(step.action, step.args), mark=marks.of(step.call, equal[step.call]))
        equal[step.call] += 1


def _lines_drawn(drawn: Sequence[Branch], made: Sequence[Branch], marks: _Marks) -> Iterator[Line]:
    """The lines of a tree as ``drawn`` last; what was done when it was ``made`` belongs to an earlier plan."""
    equal: Counter[str] = Counter()
    for branch in made:
        if _is_action(branch) and branch.mark:
            equal[branch.text] -= 1
    for branch in drawn:
        mark: str = branch.mark
        if _is_action(branch):
            mark = mark or marks.of(_call(branch.text), equal[branch.text])
            equal[branch.text] += 1
        yield Line(branch.depth, branch.text, branch.method, mark, branch.former)


def _is_action(branch: Branch) -> bool:
    return not (branch.method or branch.former)


def _plan(history: History, step: TraceRecord) -> _Plan:
    """The plan that a step belongs to."""
    agent, number = str(step.detail.get("directed_by", step.source)), step.detail.get("plan")
    if number is None:
        plan = next((each for each in history.before(step) if each.kind == "plan_start"), None)
        number = plan.detail.get("plan", 0) if plan else 0
    return agent, number


def _call(text: str) -> str:
    """``go(a, b)`` as plans write it: ``(go a b)``."""
    name, _, args = text.rstrip(")").partition("(")
    return f"({' '.join((name, *filter(None, args.split(', '))))})"


def _mark(end: TraceRecord) -> str:
    return {"successful": "done", "failed": "failed"}.get(str(end.detail.get("outcome")), "")
