from __future__ import annotations

from socialbot.runs.report_series import series_charts


def test_a_column_of_numbers_is_a_line():
    rows = {f"{n} rooms": {"seconds": 0.5 * n, "what": "x", "same": 1, "ok": True} for n in (10, 50, 200)}
    html = series_charts(rows)
    assert (html.count("<svg"), html.count("<circle")) == (1, 3)
    assert "<title>200: 100</title>" in html


def test_rows_without_numbers_or_order_are_none():
    values = [{"s": 1}, {"s": 2}, {"s": 3}]
    assert series_charts(dict(zip(("a", "b", "c"), values, strict=True))) == ""
    assert series_charts(dict(zip(("3", "1", "2"), values, strict=True))) == ""
    assert series_charts(dict(zip(("1", "2"), values, strict=False))) == ""
