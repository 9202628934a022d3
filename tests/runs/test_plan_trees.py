"""Plans of agents as trees: parsing, news, and the state of each step."""

from __future__ import annotations

import io

from msgspec.structs import replace
from rich.console import Console

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Wording
from socialbot.runs.plan_trees import as_text, branches, trees_at, with_failure, with_news
from tests.runs.deliberating_runs import plan, plan_end, record, step, step_end

PLANNED = """m_clean(room1) by usual  #1
  m_look(room1) by at_once  #2
    + a_look(room1)  #4
  a_wipe(room1)  #3
"""
MENDED = """m_clean(room1) by usual  #1
  m_look(room1) by at_once  #2
    + a_look(room1)  #4
  (! a_wipe(room1))  #3
  a_fetch(mop)  #5
  a_wipe(room1)  #6
"""
ANEW = """m_clean(room1) by thorough  #1
  a_fetch(mop)  #2
  a_wipe(room1)  #3
"""


def made_at(seconds: float, tree: str) -> TraceRecord:
    return record(
        seconds, "boss", "plan_start", "clean", plan=seconds, steps=["0: (a_wipe room1)"], makespan_s=None, tree=tree
    )


def given_up_at(seconds: float, tree: str) -> TraceRecord:
    return record(
        seconds, "boss", "plan_end", "clean", plan=seconds - 1.0, outcome="failed", reason="no mop", tree=tree
    )


def texts(tree, what) -> list[str]:
    return [branch.text for branch in tree if what(branch)]


def test_each_line_is_a_branch_with_what_became_of_it():
    tree = branches(MENDED)
    assert [branch.depth for branch in tree] == [0, 1, 2, 1, 1, 1]
    assert [branch.method for branch in tree] == ["usual", "at_once", "", "", "", ""]
    assert [branch.mark for branch in tree] == ["", "done", "done", "failed", "", ""]
    assert texts(tree, lambda branch: branch.former) == ["a_wipe(room1)"]


def test_a_drawing_that_is_none_has_no_branches():
    assert branches("") == branches("nothing\n") == []


def test_in_a_tree_that_was_mended_what_has_a_new_number_is_new():
    tree = with_news(branches(MENDED), branches(PLANNED))
    assert [branch.id for branch in tree if branch.is_new] == [5, 6]


def test_in_one_that_was_made_anew_what_was_not_there_is_new():
    tree = with_news(branches(ANEW), branches(PLANNED))
    assert texts(tree, lambda branch: branch.is_new) == ["a_fetch(mop)"]


def test_the_next_such_action_is_the_one_that_failed():
    tree = with_failure(branches(PLANNED), "a_wipe(room1)")
    assert texts(tree, lambda branch: branch.mark == "failed") == ["a_wipe(room1)"]
    assert with_failure(branches(PLANNED), "a_sing()") == branches(PLANNED)


def test_signs_tell_all_in_a_terminal():
    out = io.StringIO()
    tree = with_news(branches(MENDED), branches(PLANNED))
    Console(file=out, width=80, color_system=None).print(as_text(tree, "  "))
    assert "    ✓ m_look(room1)  at_once\n" in out.getvalue()
    assert "    ✗ a_wipe(room1)\n" in out.getvalue()
    assert "    ✚ a_fetch(mop)\n" in out.getvalue()


LOOK, WIPE = "(look room)", "(wipe room)"


def after(first: TraceRecord, *records: TraceRecord) -> list[TraceRecord]:
    """Records that ``first`` led to; the end of a step names the last step of that call."""
    linked, steps = [first], {first.what: first}
    for each in records:
        linked.append(replace(each, cause=steps.get(each.what, first).id if each.kind == "step_end" else first.id))
        if each.kind == "step":
            steps[each.what] = linked[-1]
    return linked


def marks(records: list[TraceRecord], seconds: float) -> list[str]:
    """The marks of the lines of the only plan, at a time."""
    (tree,) = trees_at(History(records, start=100 * SECOND), nanoseconds(100 + seconds), Wording())
    return [line.mark for line in tree.tree]


TWICE = after(
    plan(0.0, "ann", "clean", 1, f"0: {LOOK} [1]", f"1: {WIPE} [1]", f"2: {LOOK} [1]"),
    step(0.0, "ann", LOOK),
    step_end(1.0, "ann", LOOK),
    step(1.0, "ann", WIPE),
    step_end(2.0, "ann", WIPE),
    step(2.0, "ann", LOOK),
    step_end(3.0, "ann", LOOK, "failed"),
    step(3.5, "ann", LOOK),
    step_end(4.0, "ann", LOOK),
)


def test_of_equal_steps_the_one_is_marked_that_runs():
    assert marks(TWICE, 0.5) == ["running", "", ""]
    assert marks(TWICE, 1.5) == ["done", "running", ""]
    assert marks(TWICE, 2.5) == ["done", "done", "running"]


def test_a_step_that_is_tried_again_is_the_same_line():
    assert marks(TWICE, 3.2) == ["done", "done", "failed"]
    assert marks(TWICE, 3.7) == ["done", "done", "running"]
    assert marks(TWICE, 4.0) == ["done", "done", "done"]


def test_a_plan_of_a_number_that_was_there_before_begins_anew():
    again = after(plan(5.0, "ann", "clean", 1, f"0: {LOOK} [1]"), step(6.0, "ann", LOOK))
    assert marks([*TWICE, *again], 5.5) == [""]
    assert marks([*TWICE, *again], 6.5) == ["running"]


REPAIRED = """clean(room) by usual  #1
  + look(room)  #2
  (! wipe(room))  #3
  look(room)  #4
  wipe(room)  #5
  look(room)  #6
"""
ENDED = REPAIRED.replace("  look(room)  #4", "  + look(room)  #4")


def drawn(seconds: float, kind: str, tree: str, outcome: str = "") -> TraceRecord:
    return record(seconds, "ann", kind, "clean", plan=2, steps=[], tree=tree, outcome=outcome)


def test_in_a_tree_that_was_mended_what_was_done_before_counts_for_itself():
    records = after(
        drawn(0.0, "plan_start", REPAIRED),
        step(1.0, "ann", LOOK),
        step_end(2.0, "ann", LOOK),
        step(3.0, "ann", WIPE),
        drawn(4.0, "plan_end", ENDED, outcome="aborted"),
    )
    assert marks(records, 0.5) == ["", "done", "failed", "", "", ""]
    assert marks(records, 1.5) == ["", "done", "failed", "running", "", ""]
    assert marks(records, 3.5) == ["", "done", "failed", "done", "running", ""]
    assert marks(records, 4.5) == ["", "done", "failed", "done", "running", ""]


def test_a_plan_that_has_ended_says_how():
    records = after(plan(0.0, "ann", "clean", 1, f"0: {LOOK} [1]"), plan_end(1.0, "ann", "clean", 1, "failed"))
    (tree,) = trees_at(History(records), nanoseconds(101.0), Wording())
    assert (tree.agent, tree.title, tree.outcome) == ("ann", "plan 1 for clean", "failed")


def test_replanned_tree_marks_new_lines():
    history = History([made_at(0.0, PLANNED), given_up_at(1.0, PLANNED), made_at(1.5, MENDED)])
    (tree,) = trees_at(history, nanoseconds(102.0), Wording())
    assert [(line.text, line.mark) for line in tree.tree if line.mark in ("new", "failed")] == [
        ("a_wipe(room1)", "failed"), ("a_fetch(mop)", "new"), ("a_wipe(room1)", "new"),
    ]  # fmt: skip
