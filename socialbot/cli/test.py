"""``socialbot test``: check the behaviour of runs, bags and simulations."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from socialbot.cli import _options as options
from socialbot.cli._console import Console

if TYPE_CHECKING:
    from socialbot.runs.expectations import Expectation
    from socialbot.runs.expectations.monitor import BehaviourMonitor, Violation
    from socialbot.runs.expectations.reporting import Checked
    from socialbot.runs.narration import Wording
    from socialbot.runtime.trials import Trial

PANEL = "Test behaviours"
EXAMPLES = (
    "socialbot test behaviours.py runs/my_run",
    "socialbot test waldo data/synthetic/corridor",
    "socialbot test behaviours.py graph.yaml bags/* --graph camera.yaml --junit results.xml",
    "socialbot test behaviours.py graph.yaml",
    "socialbot test behaviours.py --live waldo",
)
_WITHOUT_LIVE = ("graph", "runner", "domain", "limit", "cache", "out", "junit", "strict", "nearest")
PERIOD_S = 0.5
"""Time between two looks at a running graph."""
_STYLES = {"passed": "green", "failed": "bold red", "open": "yellow", "untested": "yellow"}


def test(
    context: typer.Context,
    behaviours: Annotated[
        Path, typer.Argument(help="Python file with expectations, or an agent package, such as waldo, for its own.")
    ],
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN|BAG|GRAPH...",
            help="Folder of a run, bag to replay, or graph with a simulated world.",
            autocompletion=options.run_folders,
        ),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", "-k", metavar="TEXT", help="Run only expectations with this text in their name.")
    ] = "",
    graph: Annotated[
        str | None,
        typer.Option(help="Graph for bags; default: the bag's own, or waldo.", autocompletion=options.graph_names),
    ] = None,
    runner: options.RunnerOption = "inline",
    domain: options.DomainOption = None,
    changes: options.SetOption = None,
    limit: Annotated[float, typer.Option(min=1.0, metavar="SECONDS", help="Limit of simulated time.")] = 1800.0,
    cache: Annotated[bool, typer.Option(help="Reuse cached detections of a bag, and cache new ones (inline).")] = True,
    out: Annotated[Path | None, typer.Option(help="Folder for new runs and the page; default: runs/TIME.")] = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the results as JUnit XML.")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Open and untested expectations fail, too.")] = False,
    nearest: Annotated[
        bool, typer.Option("--nearest", help="Look for the nearest change of an agent's parameter that would pass.")
    ] = False,
    live: Annotated[
        str | None,
        typer.Option(metavar="FILE|GRAPH", help="Monitor this running graph until Ctrl-C, on /diagnostics, too."),
    ] = None,
    machine: options.MachineOption = None,
    verbose: options.VerboseOption = False,
) -> None:
    """Check expectations on the behaviour of agents in recorded runs, replays, simulations, or a running graph.

    Exit code 1: an expectation failed.
    """
    from socialbot.cli._runs import enter_domain
    from socialbot.core.errors import ParameterError
    from socialbot.runs.expectations.checking import load_behaviours

    expectations = [each for each in load_behaviours(behaviours) if only in each.name]
    if not expectations:
        raise ParameterError(f"no expectation has {only!r} in its name", where="--only", remedy="leave it out")
    if live is None:
        options.expect_effect(context, ("machine",), "without --live")
    else:
        options.expect_effect(context, _WITHOUT_LIVE, "with --live")
        if sources:
            raise ParameterError("a running graph is tested alone", where="--live", remedy="leave out the others")
        raise typer.Exit(_monitor(expectations, live, machine, changes or []))
    if not sources:
        remedy = "give the folder of a run, a bag, or a graph with a simulated world"
        raise ParameterError("there is nothing to test", where="RUN|BAG|GRAPH", remedy=remedy)
    from socialbot.runtime.run import new_run_folder
    from socialbot.runtime.trials import Trial

    console = Console(soft_wrap=True)
    enter_domain(context, console, domain, runner, ("domain",), verbose=verbose)
    if cache and runner == "ros":
        options.expect_effect(context, ("cache",), "with --runner ros")
    trials = [Trial(each, None, tuple(changes or ()), runner, limit, cache) for each in sources]
    bags = [each for each in trials if each.is_bag]
    trials = [replace(each, graph=graph) if each in bags or not bags else each for each in trials]
    folder = out or new_run_folder()
    with ExitStack() as stack:
        checked = [
            _check(console, expectations, trial, folder, name, nearest, stack)
            for trial, name in zip(trials, _names(trials), strict=True)
        ]
    _finish(console, checked, behaviours, folder, junit)
    failing = {"failed", "open", "untested"} if strict else {"failed"}
    if any(verdict.outcome in failing for each in checked for verdict in each.verdicts):
        raise typer.Exit(1)


def _names(trials: Sequence[Trial]) -> list[str]:
    """Return short names of trials; those of the same name get a number."""
    names: list[str] = []
    for trial in trials:
        same = sum(each.partition("~")[0] == trial.name for each in names)
        names.append(f"{trial.name}~{same + 1}" if same else trial.name)
    return names


def _check(
    console: Console,
    expectations: Sequence[Expectation],
    trial: Trial,
    folder: Path,
    name: str,
    nearest: bool,
    stack: ExitStack,
) -> Checked:
    from socialbot.runs.expectations import evaluate
    from socialbot.runs.expectations.reporting import Checked
    from socialbot.runs.report import PAGE, write_report

    console.print(Text(f"{name}  ({trial})"))
    run = trial.obtain(folder / name)
    for problem in run.problems:
        console.print(f"  warning: {problem}", style="yellow", markup=False)
    verdicts = evaluate(expectations, run)
    failed = [each for each in verdicts if not each.passed]
    page = run.folder / PAGE
    if failed and not page.is_file():
        page = write_report(run.folder)
    found = _nearest([each.expectation for each in failed], trial) if nearest and failed else {}
    checked = Checked(name, run, page if page.is_file() else None, verdicts, found)
    _print(console, checked)
    return checked


def _nearest(expectations: Sequence[Expectation], trial: Trial) -> dict[str, str]:
    from socialbot.runtime.trials import nearest_changes

    with options.bar("looking for the nearest change", "runs") as advance:
        return nearest_changes(expectations, trial, advance)


def _print(console: Console, checked: Checked) -> None:
    from socialbot.runs.expectations.reporting import WORDS, summary, text_of

    width = max(len(each.name) for each in checked.verdicts)
    for verdict in checked.verdicts:
        word = (f"  {WORDS[verdict.outcome]:<9}", _STYLES[verdict.outcome])
        console.print(Text.assemble(word, f"{verdict.name:<{width}}  ", (summary(verdict), "dim")))
        for line in text_of(checked, verdict):
            console.print(Text(f"           {line}"))


def _finish(console: Console, checked: Sequence[Checked], behaviours: Path, folder: Path, junit: Path | None) -> None:
    from socialbot.runs.expectations.reporting import counted, write_results, write_results_page

    console.print(f"{options.many(len(checked), 'run')}: {counted(checked)}")
    if junit is not None:
        write_results(junit, checked, behaviours.stem)
    page = write_results_page(folder / "behaviours.html", checked, behaviours.stem)
    console.print(f"The page of the verdicts: {page}", markup=False)


def _monitor(expectations: list[Expectation], file: str, machine: str | None, changes: Sequence[str]) -> int:
    """Monitor the graph or deployment in ``file``; print violations and publish them on /diagnostics.

    Returns:
        Exit code: 1 after a violation.
    """
    from socialbot.bridge.diagnostics import DiagnosticsPublisher
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.core.process import Ending
    from socialbot.graph.files import with_changes
    from socialbot.runs.expectations.monitor import BehaviourMonitor
    from socialbot.runs.record import with_event_log
    from socialbot.runs.run import wording_of
    from socialbot.runtime.run import observed_topics

    console = Console(soft_wrap=True)
    graph, _ = options.join(file, machine)
    graph = with_changes(graph, changes)
    watched = BehaviourMonitor(expectations)
    wording = wording_of(graph)
    known = graph.topics()
    topics = observed_topics(graph) | {topic: known[topic] for topic in watched.topics if topic in known}
    with spinning_node("behaviour_monitor") as ros:
        diagnostics = DiagnosticsPublisher(ros)
        observe = with_event_log(graph, watched.observe)
        with observe_graph(topics, observe, lambda *_: None, graph.wire), Ending().on_signals() as ending:
            console.print_plain(f"{options.many(len(expectations), 'expectation')} on {graph.name}, until Ctrl-C")
            while not ending.asked:
                now = ros.get_clock().now().nanoseconds
                for violation in watched.poll(now):
                    _print_violation(console, violation, watched, wording)
                diagnostics.publish(_statuses(watched, now))
                time.sleep(PERIOD_S)
    violated = {name: state.violations for name, state in watched.states.items() if state.violations}
    for name, state in watched.states.items():
        word = f"violated {options.times(state.violations)}" if state.violations else "not violated"
        console.print(Text(f"  {name}: {word}"))
    return 1 if violated else 0


def _statuses(watched: BehaviourMonitor, now: int) -> list[Any]:
    """Return one status for each expectation at ``now`` (ns): ERROR for a minute after a violation, else OK."""
    from socialbot.bridge.diagnostics import status_of
    from socialbot.runs.expectations.reporting import headline

    statuses = []
    for name, state in watched.states.items():
        violated = watched.is_violated(name, now)
        text = "no violation" if not state.violations else "no violation in the last minute"
        if violated and state.verdict is not None and state.last is not None:
            text = headline(state.verdict, state.last)
        values = {
            "violations": state.violations,
            "last_violation_s": "" if state.last is None else f"{state.last.at_s:.3f}",
            "instance": "" if state.last is None else state.last.text,
            "verdict": "" if state.verdict is None else state.verdict.outcome,
        }
        statuses.append(status_of(f"behaviour: {name}", "ERROR" if violated else "OK", text, values))
    return statuses


def _print_violation(console: Console, violation: Violation, watched: BehaviourMonitor, wording: Wording) -> None:
    from socialbot.runs.expectations.reporting import headline
    from socialbot.runs.why import explain

    console.print(Text.assemble(("violated ", "bold red"), f"{violation.verdict.name} "))
    console.print(Text(f"  {headline(violation.verdict, violation.instance)}"))
    record = violation.instance.record
    if record is not None:
        for line in explain(watched.history, wording, record).text().splitlines():
            console.print(Text(f"  {line}"))
