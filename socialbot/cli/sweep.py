"""``socialbot sweep``: replay bags with many settings, and compare the decisions."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from socialbot.cli import _options as options
from socialbot.cli._console import Console, print_line
from socialbot.core.errors import ParameterError
from socialbot.core.paths import expect_inside, replace_file, temporary_folder
from socialbot.core.terminal import escaped_json

if TYPE_CHECKING:
    from socialbot.runs.difference import Difference
    from socialbot.runs.sweeps import Sweep, SweepCell
    from socialbot.runtime.sweeps import SweepPlan

PANEL = "Test behaviours"
EXAMPLES = (
    "socialbot sweep data/synthetic/corridor --set waldo.help_after_s=2:12:1 --set waldo.range_m=3,6,9",
    "socialbot sweep data/synthetic/corridor --set waldo.help_after_s=2:12 --method bisect",
)
MAX_ROWS = 40  # rows of the table in the terminal
PAGE_WIDTH = 150  # width of the tables if the output is not a terminal


def sweep(
    context: typer.Context,
    bags: Annotated[list[Path], typer.Argument(metavar="BAG...", help="Bags to replay with each setting.")],
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NODE.PARAMETER=VALUES",
            help="Change a parameter: 3,6,9, LOW:HIGH:STEP or LOW:HIGH; repeatable.",
        ),
    ] = None,
    expect: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Python file with expectations, or an agent package, such as waldo, for its own."
        ),
    ] = None,
    graph: options.BagGraphOption = None,
    method: Annotated[
        Literal["grid", "random", "sobol", "bisect"],
        typer.Option(help="grid: all combinations; random, sobol: samples; bisect: the threshold of the range."),
    ] = "grid",
    samples: Annotated[int, typer.Option(min=1, help="Number of samples (random, sobol).")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the samples.")] = 0,
    compare: Annotated[
        str | None, typer.Option(metavar="A,B", help="Cells to compare; default: two neighbours that differ.")
    ] = None,
    pareto: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="Measures of the Pareto front; default: two that vary.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the sweep; an interrupted one continues; default: sweeps/TIME.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Parallel processes; default: cores.")] = options.CORES,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster.")] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Replay bags with many settings; show the decisions of each, and where the outcome flips.

    After Ctrl-C, the same command with --out continues.
    """
    import msgspec

    from socialbot.runs.sweep_page import default_objectives, sweep_page
    from socialbot.runs.sweeps import MEASURES
    from socialbot.runtime.run import new_run_folder
    from socialbot.runtime.sweeps import SweepPlan, SweepRunner, parse_variation

    if method not in ("random", "sobol"):
        options.expect_effect(context, ("samples", "seed"), f"with --method {method}")
    if scheduler is not None:
        options.expect_effect(context, ("jobs",), "with --scheduler")
    if not changes:
        raise ParameterError("nothing to vary", where="--set", remedy="write --set NODE.PARAMETER=LOW:HIGH:STEP")
    variations = [parse_variation(change) for change in changes]
    objectives = _names(pareto, MEASURES, 2, "--pareto")
    numbers = _names(compare, None, 2, "--compare")
    plan = SweepPlan(bags, variations, graph, expect, method, samples, seed, jobs, scheduler)
    folder = out or new_run_folder(Path("sweeps"))
    console = Console()
    logging.getLogger("socialbot").setLevel(logging.ERROR)
    try:
        with options.bar("", "runs") as show:

            def progress(done: int, total: int) -> None:
                show(done, f"replaying {options.many(len(bags), 'bag')}", total)

            runner = SweepRunner(plan, folder, progress)
            found = runner.run()
    except SystemExit:
        Console(stderr=True).print(f"stopped; the same command with --out {folder} continues", soft_wrap=True)
        raise
    chosen = objectives or default_objectives(found)
    pair = _pair(found, numbers)
    compared = None if pair is None else _compared(plan, found, *pair)
    page = sweep_page(found, chosen, compared).write(expect_inside(folder, folder / "index.html"))
    text = msgspec.json.format(msgspec.json.encode(found), indent=2) + b"\n"
    replace_file(expect_inside(folder, folder / "sweep.json"), text)
    if as_json:
        print_line(escaped_json(text.decode()), nl=False)
        return
    _print(console if console.is_terminal else Console(width=PAGE_WIDTH), found, chosen, compared)
    reused = f", {runner.reused} of them from before" if runner.reused else ""
    runs = len(found.cells) * len(bags)
    console.print_plain(f"{len(found.cells)} settings, {runs} runs{reused}; page: {page}")


def _names(text: str | None, known: object, count: int, where: str) -> tuple[str, ...]:
    """Parse a list of names."""
    if text is None:
        return ()
    names = tuple(text.split(","))
    allowed = list(known) if isinstance(known, dict) else None
    if len(names) != count or (allowed is not None and not set(names) <= set(allowed)):
        remedy = f"give {count} of {', '.join(allowed)}" if allowed else "give the numbers of two cells, such as 3,7"
        raise ParameterError(f"cannot read {text!r}", where=where, remedy=remedy)
    return names


def _pair(found: Sweep, numbers: Sequence[str]) -> tuple[SweepCell, SweepCell] | None:
    if not numbers:
        return found.pair()
    cells = {str(cell.number): cell for cell in found.cells}
    for number in numbers:
        if number not in cells:
            raise ParameterError(
                f"no cell {number!r}", where="--compare", remedy=f"they have the numbers 1 to {len(cells)}"
            )
    return cells[numbers[0]], cells[numbers[1]]


def _compared(
    plan: SweepPlan, found: Sweep, one: SweepCell, other: SweepCell
) -> tuple[SweepCell, SweepCell, str, Difference]:
    """Run two cells again on the first bag that they differ on, and compare the runs."""
    from socialbot.runs.difference import difference
    from socialbot.runs.folder import open_run
    from socialbot.runtime.bag_source import replay
    from socialbot.runtime.sweeps import graph_for

    pairs = enumerate(zip(one.digests, other.digests, strict=True))
    number = next((number for number, pair in pairs if pair[0] != pair[1]), 0)
    bag, name = plan.bags[number], found.bags[number]
    with temporary_folder("socialbot-sweep-") as folder:
        runs = []
        for cell in (one, other):
            place = Path(folder) / f"cell {cell.number}"
            replay(bag, graph_for(bag, plan.graph, found.changes(cell)), place)
            runs.append(open_run(place))
        return one, other, name, difference(runs[0], runs[1], (f"cell {one.number}", f"cell {other.number}"))


def _print(
    console: Console,
    found: Sweep,
    objectives: Sequence[str],
    compared: tuple[SweepCell, SweepCell, str, Difference] | None,
) -> None:
    from socialbot.runs.sweep_page import cell_table, describe_pair, front_table, threshold_table

    if found.thresholds:
        console.print(threshold_table(found).terminal(MAX_ROWS))
    console.print(cell_table(found).terminal(MAX_ROWS))
    if objectives and (front := front_table(found, objectives)).rows:
        console.print(f"\nPareto front of {' and '.join(objectives)}:", markup=False)
        console.print(front.terminal(MAX_ROWS))
    if compared is not None:
        one, other, bag, difference = compared
        console.print_plain(f"\n{describe_pair(found, one, other)}, {bag}:")
        for line in difference.text():
            console.print_plain(line)
