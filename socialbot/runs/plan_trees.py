"""Plans of agents at a time, as trees of tasks with the state of each step."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
from rich.text import Text

from socialbot.core.errors import PlanningError
from socialbot.core.messages import TraceRecord
from socialbot.planning.pddl.domain import parse_plan
from socialbot.runs.history import History
from socialbot.runs.narration import Wording

Mark = Literal["", "done", "failed"]

_LINE = re.compile(r"( *)(\S.*?)  #(\d+)")
_SIGNS = {"done": "✓", "failed": "✗", "": "·"}
_STYLES = {"done": "green", "failed": "bold red", "": ""}
_Plan = tuple[str, object]
_Marks = dict[str, list[str]]
"""States of the steps of a plan by call; repeated calls run one after the other."""


@dataclass(frozen=True)
class TreeBranch:
    """Line of a task tree: a task with its ``method``, or an action without one.

    ``former`` lines belong to an abandoned decomposition; ``is_new`` lines were not in the plan before.
    """

    depth: int
    id: int
    text: str
    method: str
    mark: Mark
    former: bool
    is_new: bool = False


def branches(drawing: str) -> list[TreeBranch]:
    """Parse a drawing of `socialbot.planning.htn.tree.TaskTree`; other lines are ignored."""
    found = filter(None, map(_LINE.fullmatch, drawing.splitlines()))
    tree = [_branch(len(line[1]) // 2, line[2], int(line[3])) for line in found]
    for number, branch in enumerate(tree):  # a task is done when all actions below it are
        if branch.method:
            below = {leaf.mark for leaf in _below(tree, number) if not leaf.method and leaf.former == branch.former}
            tree[number] = replace(branch, mark="done" if below == {"done"} else "")
    return tree


def with_news(tree: Sequence[TreeBranch], before: Sequence[TreeBranch]) -> list[TreeBranch]:
    """Mark the branches that the tree ``before`` lacks.

    A repaired tree keeps the ids of its branches; a new one is compared by text.
    """
    is_repaired = any(branch.former for branch in tree)
    known = {(branch.id, branch.text) if is_repaired else branch.text for branch in before}
    return [
        replace(branch, is_new=((branch.id, branch.text) if is_repaired else branch.text) not in known)
        for branch in tree
    ]


def with_failure(tree: Sequence[TreeBranch], call: str) -> list[TreeBranch]:
    """Mark the next open action named ``call`` as failed."""
    found = next((number for number, branch in enumerate(tree) if not branch.mark and branch.text == call), None)
    return [replace(branch, mark="failed") if number == found else branch for number, branch in enumerate(tree)]


def as_text(tree: Sequence[TreeBranch], indent: str = "") -> Text:
    """Return the tree for a terminal, one line per branch."""
    text = Text()
    for branch in tree:
        style = "dim strike" if branch.former else "bold cyan" if branch.is_new else _STYLES[branch.mark]
        sign = "✚" if branch.is_new and not branch.mark else _SIGNS[branch.mark]
        text.append(f"{indent}{'  ' * branch.depth}{sign} ", _STYLES[branch.mark])
        text.append(branch.text, style)
        text.append(f"  {branch.method}\n" if branch.method else "\n", "dim italic")
    return text


class TreeLine(msgspec.Struct, frozen=True):
    """Line of a plan in the page. ``mark``: done, running, failed, new or empty."""

    depth: int
    text: str
    method: str = ""
    mark: str = ""
    former: bool = False


class PlanTree(msgspec.Struct, frozen=True):
    """Plan of an agent; ``id`` is that of its record, ``outcome`` is empty while the plan is executed."""

    id: str
    agent: str
    title: str
    outcome: str
    tree: tuple[TreeLine, ...]


class PlanTrees:
    """Newest plan for each desire of each agent, updated record by record."""

    def __init__(self, history: History, wording: Wording) -> None:
        self._history = history
        self._wording = wording
        self._plans: dict[tuple[str, str], TraceRecord] = {}
        self._before: dict[tuple[str, str], str] = {}
        self._ends: dict[_Plan, TraceRecord] = {}
        self._marks: dict[_Plan, _Marks] = defaultdict(lambda: defaultdict(list))
        self._built: dict[tuple[str, str], PlanTree] = {}

    def take(self, record: TraceRecord) -> bool:
        """Process the next record and return whether a plan has changed."""
        match record.kind:
            case "plan_start":
                desire, plan = (record.source, record.what), (record.source, record.detail.get("plan", 0))
                if desire in self._plans:
                    self._before[desire] = str(self._plans[desire].detail.get("tree", ""))
                self._plans[desire] = record
                self._ends.pop(plan, None)
                self._marks.pop(plan, None)
            case "plan_end":
                plan = (record.source, record.detail.get("plan", 0))
                self._ends[plan] = record
            case "step":
                plan = self._plan(record)
                marks = self._marks[plan][record.what]
                if not marks or marks[-1] == "done":
                    marks.append("")
                marks[-1] = "running"
            case "step_end":
                step = self._history.find(record.cause) or record
                plan = self._plan(step)
                mark = {"successful": "done", "failed": "failed"}.get(str(record.detail.get("outcome")), "")
                self._marks[plan][step.what][-1:] = [mark]
            case _:
                return False
        for desire, start in self._plans.items():
            if (start.source, start.detail.get("plan", 0)) == plan:
                self._built.pop(desire, None)
        return True

    def trees(self) -> dict[tuple[str, str], PlanTree]:
        """Return the plans by agent and desire."""
        for desire, plan in self._plans.items():
            if desire not in self._built:
                self._built[desire] = self._build(plan)
        return {desire: self._built[desire] for desire in self._plans}

    def _build(self, plan: TraceRecord) -> PlanTree:
        number, made = plan.detail.get("plan", 0), str(plan.detail.get("tree", ""))
        end = self._ends.get((plan.source, number))
        marks = self._marks[plan.source, number]
        if drawing := (end.detail.get("tree") if end else None) or made:
            before = self._before.get((plan.source, plan.what), "")
            lines = _drawn_lines(branches(drawing), branches(made), branches(before), marks)
        else:
            lines = _step_lines(plan, marks, self._wording)
        outcome = str(end.detail.get("outcome", "")) if end else ""
        return PlanTree(plan.id, plan.source, f"plan {number} for {plan.what}", outcome, tuple(lines))

    def _plan(self, step: TraceRecord) -> _Plan:
        agent, number = str(step.detail.get("directed_by", step.source)), step.detail.get("plan")
        if number is None:
            plan = next((each for each in self._history.before(step) if each.kind == "plan_start"), None)
            number = plan.detail.get("plan", 0) if plan else 0
        return agent, number


def trees_at(history: History, stamp: int, wording: Wording) -> tuple[PlanTree, ...]:
    """Return the newest plan for each desire of each agent at ``stamp`` (ns)."""
    trees = PlanTrees(history, wording)
    for record in history.part(0, history.until(stamp)):
        trees.take(record)
    return tuple(trees.trees().values())


def _mark(marks: _Marks, call: str, number: int) -> str:
    states = marks.get(call, ())
    return states[number] if 0 <= number < len(states) else ""


def _step_lines(plan: TraceRecord, marks: _Marks, wording: Wording) -> Iterator[TreeLine]:
    equal: Counter[str] = Counter()
    lines = plan.detail.get("steps", ())
    try:
        steps = parse_plan("\n".join(lines)).steps
    except PlanningError:  # of an agent with another notation
        yield from (TreeLine(0, line) for line in lines)
        return
    for step in steps:
        yield TreeLine(0, wording.call(step.action, step.args), mark=_mark(marks, step.call, equal[step.call]))
        equal[step.call] += 1


def _drawn_lines(
    drawn: Sequence[TreeBranch], made: Sequence[TreeBranch], before: Sequence[TreeBranch], marks: _Marks
) -> Iterator[TreeLine]:
    """Yield the lines of the last drawing; steps done before planning belong to an earlier plan."""
    equal: Counter[str] = Counter()
    for branch in made:
        if not (branch.method or branch.former) and branch.mark:
            equal[branch.text] -= 1
    for branch in with_news(drawn, before) if before else drawn:
        mark: str = branch.mark
        if not (branch.method or branch.former):
            mark = mark or _mark(marks, _call(branch.text), equal[branch.text])
            equal[branch.text] += 1
        if branch.is_new and not branch.former:
            mark = mark or "new"
        yield TreeLine(branch.depth, branch.text, branch.method, mark, branch.former)


def _branch(depth: int, text: str, id: int) -> TreeBranch:
    former = text.startswith("(")
    text = text[1:-1] if former else text
    mark: Mark = "done" if text.startswith("+ ") else "failed" if text.startswith("! ") else ""
    call, _, method = text.removeprefix("+ ").removeprefix("! ").partition(" by ")
    return TreeBranch(depth, id, call, method, mark, former)


def _below(tree: Sequence[TreeBranch], number: int) -> Iterator[TreeBranch]:
    for branch in tree[number + 1 :]:
        if branch.depth <= tree[number].depth:
            return
        yield branch


def _call(text: str) -> str:
    name, _, args = text.rstrip(")").partition("(")
    return f"({' '.join((name, *filter(None, args.split(', '))))})"
