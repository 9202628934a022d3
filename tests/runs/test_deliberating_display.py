from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message, Utterance
from socialbot.deliberation.messages import ActionExecutionInfo, Desire, PlanExecutionInfo
from socialbot.graph.node import Graph
from socialbot.runs.console import RunDisplay
from tests.runs.deliberating_runs import DETOUR, PHRASES


def shown(*messages: Message, terminal: bool = False) -> str:
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=terminal, color_system=None, highlight=False)
    with RunDisplay(console, PHRASES, Graph("g", ())) as display:
        for message in messages:
            display.show("/topic", message)
    return out.getvalue()


def info(seconds: float, agent: str, current: float, estimated: float, **more: Any) -> PlanExecutionInfo:
    return PlanExecutionInfo(
        stamp=nanoseconds(100.0 + seconds),
        agent_id=agent,
        target=Desire(name="be_home"),
        actions_exec_info=(ActionExecutionInfo(index=0, name="go", args=()),),
        current_time=current,
        estimated_deadline=estimated,
        **more,
    )


def test_each_thing_that_happens_is_a_line_with_its_time_and_agent():
    lines = shown(*DETOUR).splitlines()
    assert lines[0].split() == ["0.00", "s", "ann", "◆", "wants", "be_home", "within", "20", "s", "(desires.yaml)"]
    assert "   3.00 s  ann  ✗ gives up plan 1 for be_home" in lines
    assert "   7.00 s  ann  ✓ has reached be_home after 7.0 s" in lines
    assert len(lines) == 13


def test_on_a_terminal_a_line_below_tells_the_present():
    present = shown(*DETOUR[:9], info(3.0, "ann", 3.0, 6.0), terminal=True)
    assert "ann asks bob to help" in present
    assert "━" * 12 + "╌" * 12 in present


def test_other_messages_are_left_alone():
    assert shown(Utterance(stamp=1, id="a", text="hello")) == ""
    assert shown(info(0.0, "ann", 0.0, 5.0)) == ""
