from __future__ import annotations

import io

import pytest
from rich.console import Console

from socialbot.display import Display
from socialbot.graph_file import load_graph
from socialbot.live import display_of
from socialbot.report.display import RunDisplay
from tests.report.runs import record


@pytest.mark.parametrize(("graph", "kind"), [("waldo", Display), ("cleaner", RunDisplay), ("warehouse", RunDisplay)])
def test_agents_that_deliberate_are_shown_by_what_they_want_and_do(graph, kind):
    assert isinstance(display_of(load_graph(graph), Console(file=io.StringIO())), kind)


def test_a_desire_that_an_agent_refuses_is_shown():
    out = io.StringIO()
    with display_of(load_graph("cleaner"), Console(file=out, width=100)) as display:
        display.show("/trace", record(0.0, "cleaner", "desire_refused", "fly", "add_desire", reason="no wings"))
    assert out.getvalue().split() == ["0.00", "s", "cleaner", "✗", "does", "not", "take", "up", "fly:", "no", "wings"]
