from __future__ import annotations

import pytest

from socialbot.runs.difference import difference
from socialbot.runs.folder import open_run
from socialbot.runs.report_difference import difference_page
from tests.runs.pages import headings, read
from tests.runs.runs import greeting
from tests.runs.test_run_page import Grey


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    first, second = (open_run(greeting(folder / str(comes), comes=comes), Grey()) for comes in (5, 8))
    return first, second


def test_the_decision_that_differs_is_marked_in_both_runs(runs):
    first, second = runs
    page = difference_page(first, second, difference(first, second))
    html = page.html()
    words = read(html)
    assert headings(html)[:3] == ["The decision", "What went on when", "Where they part"]
    assert not page.good
    assert "is the first that comes out the same, but at another time" in page.lead
    assert html.count('class="marked"') == 2
    assert html.count("the frame that led to it") == 4, "below each picture, and for who cannot see it"
    assert "the first decision that differs, at 0.70 s" in words
    assert "that differs, at 1.00 s" in words


def test_runs_that_are_the_same_need_no_decision(runs):
    page = difference_page(runs[0], runs[0], difference(runs[0], runs[0]))
    html = page.html()
    read(html)
    assert page.good
    assert headings(html) == ["What went on when"]
    assert 'class="marked"' not in html
