"""Trees of tasks as they were drawn, told to people: what is done, what failed, what was given up, what is new."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Literal

from rich.text import Text

from socialbot.runs.story import DesireTold, PlanTold, Story

SHOWN = 4
"""So many desires have their trees on a page, at most."""

_LINE = re.compile(r"( *)(.+?)  #(\d+)")

Mark = Literal["", "done", "failed"]
SIGNS = {"done": "✓", "failed": "✗", "": "·"}
STYLES = {"done": "green", "failed": "bold red", "": ""}


@dataclass(frozen=True)
class Branch:
    """A line of a tree: a task with its ``method``, or an action without one.

    A ``former`` one belongs to a way that was given up, one that ``is_new`` was not in the plan before.
    """

    depth: int
    id: int
    text: str
    method: str
    mark: Mark
    former: bool
    is_new: bool = False


def branches(drawing: str) -> list[Branch]:
    """The lines of a drawing of `socialbot.planning.htn.tree.TaskTree`; what is none is left out."""
    found = filter(None, map(_LINE.fullmatch, drawing.splitlines()))
    return _with_tasks_marked([_branch(len(line[1]) // 2, line[2], int(line[3])) for line in found])


def _branch(depth: int, text: str, id: int) -> Branch:
    former = text.startswith("(")
    text = text[1:-1] if former else text
    mark: Mark = "done" if text.startswith("+ ") else "failed" if text.startswith("! ") else ""
    call, _, method = text.removeprefix("+ ").removeprefix("! ").partition(" by ")
    return Branch(depth, id, call, method, mark, former)


def _with_tasks_marked(tree: list[Branch]) -> list[Branch]:
    """Tasks are done when all actions below them are."""
    marked = list(tree)
    for number, branch in enumerate(tree):
        if branch.method:
            below = [leaf.mark for leaf in _below(tree, number) if not leaf.method and leaf.former == branch.former]
            marked[number] = replace(branch, mark="done" if below and set(below) == {"done"} else "")
    return marked


def _below(tree: Sequence[Branch], number: int) -> Iterator[Branch]:
    for branch in tree[number + 1 :]:
        if branch.depth <= tree[number].depth:
            return
        yield branch


def with_news(tree: Sequence[Branch], before: Sequence[Branch]) -> list[Branch]:
    """``tree`` with what is new in it marked.

    One that was mended keeps what was done of the one ``before``, and the numbers of what stays: all others are new.
    In one that was made anew what the other one has not is new.
    """
    is_mended = any(branch.former for branch in tree)
    known = {(branch.id, branch.text) if is_mended else branch.text for branch in before}
    return [
        replace(branch, is_new=((branch.id, branch.text) if is_mended else branch.text) not in known) for branch in tree
    ]


def with_failure(tree: Sequence[Branch], call: str) -> list[Branch]:
    """``tree`` with the next action called ``call`` marked as failed."""
    found = next((number for number, branch in enumerate(tree) if not branch.mark and branch.text == call), None)
    return [replace(branch, mark="failed") if number == found else branch for number, branch in enumerate(tree)]


def given_up(story: Story, plan: PlanTold) -> list[Branch]:
    """The tree of a plan that was given up, with what failed."""
    failed = (step for step in story.steps if step.plan is plan and step.outcome == "failed")
    step = next((step for step in failed if step.ended == plan.ended), None)
    tree = branches(plan.last_tree)
    return tree if step is None else with_failure(tree, f"{step.action}({', '.join(step.args)})")


def as_text(tree: Sequence[Branch], indent: str = "") -> Text:
    """The tree for a terminal, a line a branch."""
    text = Text()
    for branch in tree:
        style = "dim strike" if branch.former else "bold cyan" if branch.is_new else STYLES[branch.mark]
        sign = "✚" if branch.is_new and not branch.mark else SIGNS[branch.mark]
        text.append(f"{indent}{'  ' * branch.depth}{sign} ", STYLES[branch.mark])
        text.append(branch.text, style)
        text.append(f"  {branch.method}\n" if branch.method else "\n", "dim italic")
    return text


def trees_html(story: Story) -> str:
    """The plans of those desires whose plans had to change, or of the first one; empty where plans have no trees."""
    plans = {
        id(desire): [plan for plan in story.plans if (plan.agent, plan.desire) == (desire.agent, desire.name)]
        for desire in story.desires
    }
    drawn = [desire for desire in story.desires if any(plan.tree for plan in plans[id(desire)])]
    changed = [desire for desire in drawn if len(plans[id(desire)]) > 1]
    parts = [_desire_html(story, desire, plans[id(desire)]) for desire in (changed or drawn[:1])[:SHOWN]]
    more = len(changed) - SHOWN
    if more > 0:
        parts.append(f'<p class="note">{more} more had to change their plans.</p>')
    return "".join(parts)


def _desire_html(story: Story, desire: DesireTold, plans: Sequence[PlanTold]) -> str:
    columns = []
    before: list[Branch] = []
    for number, plan in enumerate(plans):
        made = branches(plan.tree)
        at_end = given_up(story, plan) if plan.given_up else branches(plan.last_tree) or made
        if number:
            columns.append(_column(f"{_at(story, plan.began)}: plan {plan.number} is made", with_news(made, before)))
        if number == 0 or plan.given_up:
            columns.append(_column(_end(story, plan), at_end))
        before = made
    return f'<h3>{escape(desire.name)}</h3><div class="trees">{"".join(columns)}</div>'


def _end(story: Story, plan: PlanTold) -> str:
    if plan.ended is None:
        return f"plan {plan.number} goes on"
    how = f"is given up: {plan.reason}" if plan.given_up else "is done"
    return f"{_at(story, plan.ended)}: plan {plan.number} {how}"


def _at(story: Story, stamp: int) -> str:
    return f"{story.seconds(stamp):.{story.digits}f} s"


def _column(title: str, tree: Sequence[Branch]) -> str:
    return f'<div><h4>{escape(title)}</h4><ul class="tree">{"".join(map(_line, tree))}</ul></div>'


def _line(branch: Branch) -> str:
    kinds = [branch.mark or "planned", *(["former"] if branch.former else []), *(["new"] if branch.is_new else [])]
    kinds += ["task"] if branch.method else []
    sign = "✚" if branch.is_new and not branch.mark else SIGNS[branch.mark]
    method = f"<i>{escape(branch.method)}</i>" if branch.method else ""
    return (
        f'<li class="{" ".join(kinds)}" style="--depth:{branch.depth}"><b>{sign}</b>'
        f"<span>{escape(branch.text)} {method}</span></li>"
    )
