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
        seconds,
        "boss",
        "plan_start",
        "clean",
        plan=round(seconds),
        steps=["0: (a_wipe room1)"],
        makespan_s=None,
        tree=tree,
    )


def given_up_at(seconds: float, tree: str) -> TraceRecord:
    return record(
        seconds, "boss", "plan_end", "clean", plan=round(seconds) - 1, outcome="failed", reason="no mop", tree=tree
    )


def texts(tree, what) -> list[str]:
    return [branch.text for branch in tree if what(branch)]


def test_branches_have_depth_method_and_mark():
    tree = branches(MENDED)
    assert [branch.depth for branch in tree] == [0, 1, 2, 1, 1, 1]
    assert [branch.method for branch in tree] == ["usual", "at_once", "", "", "", ""]
    assert [branch.mark for branch in tree] == ["", "done", "done", "failed", "", ""]
    assert texts(tree, lambda branch: branch.former) == ["a_wipe(room1)"]


def test_other_text_has_no_branches():
    assert branches("") == branches("nothing\n") == []


def test_new_branches_of_a_repaired_tree_have_new_ids():
    tree = with_news(branches(MENDED), branches(PLANNED))
    assert [branch.id for branch in tree if branch.is_new] == [5, 6]


def test_new_branches_of_a_new_tree_have_new_texts():
    tree = with_news(branches(ANEW), branches(PLANNED))
    assert texts(tree, lambda branch: branch.is_new) == ["a_fetch(mop)"]


def test_next_open_action_is_marked_as_failed():
    tree = with_failure(branches(PLANNED), "a_wipe(room1)")
    assert texts(tree, lambda branch: branch.mark == "failed") == ["a_wipe(room1)"]
    assert with_failure(branches(PLANNED), "a_sing()") == branches(PLANNED)


def test_terminal_signs():
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


def test_running_step_of_equal_steps_is_marked():
    assert marks(TWICE, 0.5) == ["running", "", ""]
    assert marks(TWICE, 1.5) == ["done", "running", ""]
    assert marks(TWICE, 2.5) == ["done", "done", "running"]


def test_repeated_step_keeps_its_line():
    assert marks(TWICE, 3.2) == ["done", "done", "failed"]
    assert marks(TWICE, 3.7) == ["done", "done", "running"]
    assert marks(TWICE, 4.0) == ["done", "done", "done"]


def test_plan_with_a_reused_number_has_no_old_marks():
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


def test_steps_done_before_a_repair_are_counted_separately():
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


def test_ended_plan_has_its_outcome():
    records = after(plan(0.0, "ann", "clean", 1, f"0: {LOOK} [1]"), plan_end(1.0, "ann", "clean", 1, "failed"))
    (tree,) = trees_at(History(records), nanoseconds(101.0), Wording())
    assert (tree.agent, tree.title, tree.outcome) == ("ann", "plan 1 for clean", "failed")


def test_replanned_tree_marks_new_lines():
    history = History([made_at(0.0, PLANNED), given_up_at(1.0, PLANNED), made_at(1.5, MENDED)])
    (tree,) = trees_at(history, nanoseconds(102.0), Wording())
    assert [(line.text, line.mark) for line in tree.tree if line.mark in ("new", "failed")] == [
        ("a_wipe(room1)", "failed"), ("a_fetch(mop)", "new"), ("a_wipe(room1)", "new"),
    ]  # fmt: skip
