from __future__ import annotations

import io

from rich.console import Console

from socialbot.core.messages import TraceRecord
from socialbot.runs.report_trees import as_text, branches, given_up, trees_html, with_failure, with_news
from socialbot.runs.story import story_of
from tests.runs.deliberating_runs import desire, record, step, step_end

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


def story():
    return story_of(
        (
            desire(0, "boss", "clean"),
            made_at(0.0, PLANNED),
            step(0, "bob", "(a_wipe room1)"),
            step_end(1.0, "bob", "(a_wipe room1)", "failed", message="no mop"),
            given_up_at(1.0, PLANNED),
            made_at(1.5, MENDED),
        )
    )


def test_what_failed_is_marked_in_the_plan_that_was_given_up():
    told = story()
    told.steps[0].plan = told.plans[0]
    assert texts(given_up(told, told.plans[0]), lambda branch: branch.mark == "failed") == ["a_wipe(room1)"]


def test_a_page_shows_the_plan_before_and_after():
    html = trees_html(story())
    assert html.index("1.00 s: plan 0.0 is given up: no mop") < html.index("1.50 s: plan 1.5 is made")
    assert html.count('<ul class="tree">') == 2
    assert '<li class="planned new"' in html
    assert '<li class="failed former"' in html


def test_plans_without_trees_have_none_on_the_page():
    assert trees_html(story_of((desire(0, "boss", "clean"),))) == ""
