"""Monitor the expectations of a behaviour file on a running graph, until Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from socialbot.cli import _options as options
from socialbot.cli._console import Console
from socialbot.runs.expectations import Expectation

if TYPE_CHECKING:
    from socialbot.runs.expectations.monitor import BehaviourMonitor, Violation
    from socialbot.runs.narration import Wording

PERIOD_S = 0.5


def monitor(expectations: list[Expectation], file: str, machine: str | None, changes: Sequence[str]) -> int:
    """Monitor the graph or deployment in ``file``; print violations and publish them on /diagnostics.

    Returns:
        Exit code: 1 after a violation.
    """
    from socialbot.bridge.behaviour_diagnostics import BehaviourDiagnostics
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.core.process import Ending
    from socialbot.graph.files import with_changes
    from socialbot.runs.expectations.monitor import BehaviourMonitor
    from socialbot.runs.record import with_event_log
    from socialbot.runs.run import wording_of
    from socialbot.runtime.run import observed_topics

    console = Console(highlight=False, soft_wrap=True)
    graph, _ = options.join(file, machine)
    graph = with_changes(graph, changes)
    watched = BehaviourMonitor(expectations)
    wording = wording_of(graph)
    known = graph.topics()
    topics = observed_topics(graph) | {topic: known[topic] for topic in watched.topics if topic in known}
    with spinning_node("behaviour_monitor") as ros:
        diagnostics = BehaviourDiagnostics(ros, watched)
        observe = with_event_log(graph, watched.observe)
        with observe_graph(topics, observe, lambda *_: None, graph.wire), Ending().on_signals() as ending:
            console.print(
                f"{options.many(len(expectations), 'expectation')} on {graph.name}, until Ctrl-C", markup=False
            )
            while not ending.asked:
                now = ros.get_clock().now().nanoseconds
                for violation in watched.poll(now):
                    _print(console, violation, watched, wording)
                diagnostics.publish(now)
                time.sleep(PERIOD_S)
    violated = {name: state.violations for name, state in watched.states.items() if state.violations}
    for name, state in watched.states.items():
        word = f"violated {options.times(state.violations)}" if state.violations else "not violated"
        console.print(Text(f"  {name}: {word}"))
    return 1 if violated else 0


def _print(console: Console, violation: Violation, watched: BehaviourMonitor, wording: Wording) -> None:
    from socialbot.runs.expectations.reporting import headline
    from socialbot.runs.why import explain

    console.print(Text.assemble(("violated ", "bold red"), f"{violation.verdict.name} "))
    console.print(Text(f"  {headline(violation.verdict, violation.instance)}"))
    record = violation.instance.record
    if record is not None:
        for line in explain(watched.history, wording, record).text().splitlines():
            console.print(Text(f"  {line}"))
