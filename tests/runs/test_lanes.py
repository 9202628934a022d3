from __future__ import annotations

import re

from socialbot.runs.report_lanes import LEFT, WIDEST_PX, Lane, Lanes, Mark, Stripe
from tests.runs.pages import read


def drawn(*stripes: Stripe, end_s: float = 10.0, begin_s: float = 0.0, marks: tuple[Mark, ...] = ()) -> str:
    html = Lanes([Lane("people", stripes)], end_s, begin_s=begin_s, marks=marks).html("a chart")
    read(html)
    return html


def test_bars_lie_where_they_were():
    html = drawn(Stripe("t1", 2.0, 5.0, "person", "well"), Stripe("t2", 4.0, 4.0, "person"))
    x, wide = re.findall(
        r'<g class="s-person"><title>[^<]*</title><rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', html
    )[0]
    assert float(x) - LEFT == 2 * 110
    assert float(wide) == 3 * 110 - 0.5
    assert "t1\nfrom 2.00 s to 5.00 s\nwell" in html
    assert "<circle" in html
    assert "at 4.00 s" in html


def test_what_overlaps_lies_in_rows():
    html = drawn(Stripe("a", 0, 5, "goal"), Stripe("b", 1, 2, "goal"), Stripe("c", 6, 7, "goal"))
    tops = re.findall(r'class="s-goal"><title>[^<]*</title><rect x="[\d.]+" y="([\d.]+)"', html)
    assert len(set(tops)) == 2
    assert tops[0] == tops[1]


def test_a_long_run_is_not_wider_than_can_be_shown():
    width = re.search(r'width="(\d+)"', drawn(Stripe("a", 0, 90_000, "goal"), end_s=90_000.0))
    assert width is not None
    assert int(width[1]) < WIDEST_PX + 200


def test_texts_are_texts_and_marks_are_marked():
    html = drawn(Stripe("<b>&", 0, 9, "belief"), marks=(Mark(3.0, "<i>"),))
    assert "<b>" not in html
    assert "<i>" not in html
    assert 'class="marked"' in html


def test_without_bars_there_is_no_chart():
    assert Lanes([Lane("people", ())], 1.0).html("a chart") == ""
