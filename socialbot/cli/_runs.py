"""Present live runs, results and problems of runs in the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import expect_effect
from socialbot.core.errors import SocialbotError
from socialbot.core.terminal import escaped_json

if TYPE_CHECKING:
    from socialbot.bags.reader import Bag
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.record import RunTrace
    from socialbot.runs.report import RunReport
    from socialbot.runtime.run import RunResult
    from socialbot.vision.metrics.scores import Scores

MAX_PAGE_BYTES = 20_000_000  # maximum trace size of a live run for a page; a longer trace would delay the exit
ROS_OPTIONS = ("composed", "domain", "pace")  # options of runs over DDS only


def enter_domain(
    context: typer.Context,
    console: Console,
    domain: int | None,
    runner: str,
    only_ros: Sequence[str] = ROS_OPTIONS,
    *,
    verbose: bool = False,
) -> None:
    """Enter a ROS domain until the command ends, and print it if ``verbose``.

    Raises:
        ParameterError: An option of `only_ros` is given for an inline run.
    """
    if runner != "ros":
        expect_effect(context, only_ros, "without --runner ros")
        return
    from socialbot.bridge.environment import own_domain

    entered = context.with_resource(own_domain(domain))
    if verbose:
        hint = f"in another terminal: ROS_DOMAIN_ID={entered} socialbot status"
        console.print(f"ROS domain {entered}; {hint}", style="dim", soft_wrap=True)


def print_outcome(console: Console, result: RunResult) -> None:
    """Print detection scores, the comparison of decisions, and warnings."""
    if result.scores is not None:
        console.print(scores_table(result.scores))
    if result.decisions is not None:
        console.print_plain(result.decisions.text)
    for topic, skipped in result.results.get("bag", {}).get("skipped", {}).items():
        text = f"{topic}: {skipped['count']} damaged messages skipped: {skipped['first']}"
        console.print(f"[yellow]warning[/] {escape(text)}", soft_wrap=True)
    for name, node in result.nodes.items():
        if node.failures:
            text = f"{name}: failed {node.failures} of {node.calls} times; first: {node.first_failure}"
            console.print(f"[yellow]warning[/] {escape(text)}", soft_wrap=True)


def write_page(
    console: Console, record: RunTrace, title: str, max_bytes: int | None = None, report: RunReport | None = None
) -> None:
    """Write the page of a run and print its path. Skip runs without results, and traces above ``max_bytes``."""
    from socialbot.runs.report import write_report

    if not (record.folder / "results.json").exists():
        return
    if max_bytes is not None and record.size > max_bytes:
        page = f"the run was long: socialbot report {record.folder} writes its page"
    else:
        try:
            page = f"its page: {(report.write if report else write_report)(record.folder, title)}"
        except OSError as error:
            page = f"its page cannot be written: {error.strerror}"
        except SocialbotError as error:  # its files were removed, and could not be written again
            page = f"its page cannot be written: {error}"
    console.print_plain(f"The record of this run: {record.folder}; {page}")


def print_dialogue(console: Console, folder: Path) -> None:
    """Print the sentences of people and robot in a run, and a command that asks about it, if anybody spoke to it."""
    from socialbot.runs.asking import answer
    from socialbot.runs.folder import open_run

    run = open_run(folder)
    spoken = [each for each in run.history if each.kind in ("hearing", "utterance")]
    if all(each.kind == "utterance" for each in spoken):
        return
    console.print("\nThe dialogue:", style="bold")
    for each in spoken:
        is_heard = each.kind == "hearing"
        who = str(each.detail.get("person") or "person") if is_heard else "robot"
        line = Text(f"{run.history.seconds(each.stamp):7.2f} s  {who:<8} {each.what}")
        console.print(line, style="bold cyan" if is_heard else "bold green", soft_wrap=True)
    for question in answer(run, "").examples[:1]:
        console.print_plain(f'Ask about it: socialbot ask {folder} "{question}"')


def scores_table(scores: Scores) -> Table:
    """Return precision, recall and F1 by distance band."""
    table = Table(title=f"Detections of {scores.frames} frames at IoU 0.5", title_justify="left")
    for heading in ("distance", "found", "false", "missed", "precision", "recall", "F1"):
        table.add_column(heading, justify="left" if heading == "distance" else "right")
    for name, band in scores.bands.items():
        if band.tp or band.fp or band.fn or "-" in name:
            rates = ["-" if rate is None else f"{rate:.3f}" for rate in (band.precision, band.recall, band.f1)]
            table.add_row(name, str(band.tp), str(band.fp), str(band.fn), *rates)
    return table


def opened_run(folder: Path | None) -> RecordedRun:
    """Open the run in ``folder``, by default the newest, and print its problems on stderr. Raises RunError."""
    from socialbot.runs.folder import newest_run, open_run

    run = open_run(newest_run() if folder is None else folder)
    print_problems(run)
    return run


@contextmanager
def images_of(run: RecordedRun) -> Iterator[Bag | None]:
    """Open the bag of a run; None if it is missing or has no images. Raises BagError for a damaged bag."""
    from socialbot.bags.reader import open_bag

    path = run.results.get("bag", {}).get("path")
    with open_bag(path) if path and Path(path).exists() else nullcontext() as bag:
        yield bag if bag is not None and bag.image_topics else None


def print_problems(run: RecordedRun) -> None:
    """Print on stderr why a run is not whole."""
    for problem in run.problems:
        Console(stderr=True).print_plain(f"warning: {problem}")


def print_json(found: Any) -> None:
    """Print a value, such as a data class, as JSON."""
    import msgspec

    print_line(escaped_json(msgspec.json.format(msgspec.json.encode(found), indent=2).decode()))


def print_found(found: Any, lines: Sequence[str], *, as_json: bool) -> None:
    """Print ``found`` as JSON, or its description in ``lines``."""
    if as_json:
        print_json(found)
        return
    console = Console()
    for line in lines:
        console.print(Text(line), soft_wrap=True)
