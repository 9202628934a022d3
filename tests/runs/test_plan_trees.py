"""The plans of agents, and how far they have come."""

from __future__ import annotations

from msgspec.structs import replace

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.names import Wording
from socialbot.runs.plan_trees import trees_at
from tests.runs.deliberating_runs import plan, plan_end, record, step, step_end

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


MENDED = """clean(room) by usual  #1
  + look(room)  #2
  (! wipe(room))  #3
  look(room)  #4
  wipe(room)  #5
  look(room)  #6
"""
ENDED = MENDED.replace("  look(room)  #4", "  + look(room)  #4")


def drawn(seconds: float, kind: str, tree: str, outcome: str = "") -> TraceRecord:
    return record(seconds, "ann", kind, "clean", plan=2, steps=[], tree=tree, outcome=outcome)


def test_in_a_tree_that_was_mended_what_was_done_before_counts_for_itself():
    records = after(
        drawn(0.0, "plan_start", MENDED),
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
