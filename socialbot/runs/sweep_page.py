"""Page and terminal tables of a sweep: cells, heat maps, Pareto front and the first different decision."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from string import ascii_uppercase

import msgspec
from markupsafe import Markup

from socialbot.runs.difference import Difference
from socialbot.runs.pages import Cell, Chart, Page, Section, Series, Table, charts, part, settings
from socialbot.runs.sweeps import MEASURES, Sweep, SweepCell, in_order, summary_rows

MAX_MAPS = 12
HEAT_NOTE = (
    "Cells with the same letter decide the same at the same times, on every bag. The colour is the share of the "
    "expectations that hold; without expectations it stands for the letter."
)
PARETO_NOTE = (
    "Each dot is a setting. Less is better on both axes. A setting is on the front if it passes and no other passing "
    "one is at least as good in both and better in one."
)
DIFFERENCE_NOTE = "The causes of the first different decision in two neighbouring settings, on one bag."


class HeatCell(msgspec.Struct, frozen=True):
    """Cell of a heat map: its letter, the style of its background, and details for the pointer."""

    text: str
    style: str
    title: str


class HeatMap(msgspec.Struct, frozen=True):
    """Heat map of two axes; the rows are those of ``y``."""

    title: str
    x_name: str
    y_name: str
    x: tuple[str, ...]
    y: tuple[str, ...]
    rows: tuple[tuple[HeatCell | None, ...], ...]


def cell_table(sweep: Sweep) -> Table:
    """Return the table of all cells."""
    judged = bool(sweep.expectations) or any(one.error for cell in sweep.cells for one in cell.results)
    names = (sweep.axes[number].name for number in sweep.varied)
    heads = ["cell", *names, *(["outcome"] if judged else []), "decisions", *MEASURES]
    letters, rows = classes(sweep), []
    for cell, texts in summary_rows(sweep):
        count = len(sweep.varied)
        outcome: list[Cell] = [(texts[count], "good" if cell.passed else "bad")] if judged else []
        values: list[Cell] = [(text, "r") for text in texts[:count]]
        figures: list[Cell] = [(text, "r") for text in texts[count + 1 :]]
        rows.append([(str(cell.number), "r"), *values, *outcome, letters[cell.number], *figures])
    return Table(heads, rows)


def threshold_table(sweep: Sweep) -> Table:
    """Return the table of thresholds of a bisection."""
    ranged = next((number for number, one in enumerate(sweep.thresholds[0].values) if one == ""), 0)
    others = [number for number in range(len(sweep.axes)) if number != ranged]
    heads = [*(sweep.axes[number].name for number in others), sweep.axes[ranged].name, "below", "above"]
    rows: list[list[Cell]] = []
    for each in sweep.thresholds:
        at = "no flip" if each.below is None else f"{each.below} to {each.above}"
        fixed: list[Cell] = [(each.values[number], "r") for number in others]
        rows.append([*fixed, (at, "r"), each.outcome_below, each.outcome_above])
    return Table(heads, rows)


def classes(sweep: Sweep) -> dict[int, str]:
    """Letter of each cell by number; cells with equal decisions on all bags share one."""
    names = map("".join, itertools.chain(ascii_uppercase, itertools.product(ascii_uppercase, repeat=2)))
    letters: dict[tuple[str, ...], str] = {}
    found = {}
    for cell in sweep.cells:
        key = (*cell.digests, *(one.error for one in cell.results))
        if key not in letters:
            letters[key] = next(names)
        found[cell.number] = letters[key]
    return found


def heat_maps(sweep: Sweep) -> Iterator[HeatMap]:
    """Yield heat maps over the two parameters with the most values, one for each combination of the others."""
    if not sweep.varied or sweep.thresholds:
        return
    order = {number: sorted({cell.values[number] for cell in sweep.cells}, key=in_order) for number in sweep.varied}
    ranked = sorted(sweep.varied, key=lambda number: -len(order[number]))
    x, y = ranked[0], ranked[1] if len(ranked) > 1 else None
    rest = [number for number in sweep.varied if number not in (x, y)]
    letters = classes(sweep)
    kinds = list(dict.fromkeys(letters.values()))
    for fixed in itertools.islice(itertools.product(*(order[number] for number in rest)), MAX_MAPS):
        here = {
            (cell.values[x], "" if y is None else cell.values[y]): cell
            for cell in sweep.cells
            if all(cell.values[number] == value for number, value in zip(rest, fixed, strict=True))
        }
        rows = tuple(
            tuple(_heat_cell(sweep, here.get((across, down)), letters, kinds) for across in order[x])
            for down in (order[y] if y is not None else [""])
        )
        title = ", ".join(f"{sweep.axes[number].name} = {value}" for number, value in zip(rest, fixed, strict=True))
        names = sweep.axes[x].name, "" if y is None else sweep.axes[y].name
        yield HeatMap(title, *names, tuple(order[x]), tuple(order[y]) if y is not None else ("",), rows)


def _heat_cell(sweep: Sweep, cell: SweepCell | None, letters: dict[int, str], kinds: Sequence[str]) -> HeatCell | None:
    if cell is None:
        return None
    letter = letters[cell.number]
    if sweep.expectations or any(one.error for one in cell.results):
        style = f"--share:{cell.share():.3f}"
    else:
        style = f"--hue:{kinds.index(letter) * 137 % 360}"
    failed = "; ".join(cell.failures()) or "all expectations hold" if sweep.expectations else ""
    title = ". ".join(filter(None, (f"Cell {cell.number}: {sweep.label(cell)}", failed)))
    return HeatCell(letter, style, title)


def is_grid(sweep: Sweep) -> bool:
    """Whether most combinations of the values were run, as in a grid."""
    size = math.prod(len({cell.values[number] for cell in sweep.cells}) for number in sweep.varied)
    return bool(sweep.varied) and len(sweep.cells) * 2 >= size


def scatter(sweep: Sweep) -> Chart | None:
    """Return a chart of sampled settings over the first two numeric parameters; None without two."""
    numeric = [number for number in sweep.varied if all(in_order(cell.values[number])[0] == 0 for cell in sweep.cells)]
    if len(numeric) < 2:
        return None
    x, y = numeric[:2]
    sides = {
        "passes": ("good", [cell for cell in sweep.cells if cell.passed]),
        "fails": ("bad", [cell for cell in sweep.cells if not cell.passed]),
    }
    series = [
        Series(name, sorted((float(cell.values[x]), float(cell.values[y])) for cell in cells), colour, "points")
        for name, (colour, cells) in sides.items()
        if cells
    ]
    return Chart("Samples", series, x_label=sweep.axes[x].name, y_label=sweep.axes[y].name)


def default_objectives(sweep: Sweep) -> tuple[str, ...]:
    """The first two measures that differ between cells."""
    varying = [name for name in MEASURES if len({cell.measure(name) for cell in sweep.cells}) > 1]
    return tuple(varying[:2])


def pareto_chart(sweep: Sweep, objectives: Sequence[str]) -> Chart | None:
    """Return the chart of two measures with the Pareto front; None without two measures."""
    if len(objectives) != 2:
        return None
    front = {cell.number for cell in sweep.pareto(objectives)}
    groups: dict[str, list[tuple[float, float]]] = {"on the front": [], "passes": [], "fails": []}
    for cell in sweep.cells:
        x, y = (cell.measure(name) for name in objectives)
        if x is not None and y is not None:
            name = "on the front" if cell.number in front else "passes" if cell.passed else "fails"
            groups[name].append((x, y))
    looks = {"on the front": ("good", "diamonds"), "passes": (0, "points"), "fails": ("bad", "points")}
    series = [
        Series(name, sorted(set(points)), looks[name][0], looks[name][1])  # type: ignore[arg-type]
        for name, points in groups.items()
        if points
    ]
    if not series:
        return None
    across, up = objectives
    return Chart(f"{up} over {across}", series, x_label=MEASURES[across], y_label=MEASURES[up])


def front_table(sweep: Sweep, objectives: Sequence[str]) -> Table:
    """Return the cells on the Pareto front."""
    rows: list[list[Cell]] = []
    for cell in sweep.pareto(objectives):
        figures = (cell.measure(name) for name in objectives)
        texts: list[Cell] = [("-" if each is None else f"{each:g}", "r") for each in figures]
        rows.append([(str(cell.number), "r"), (sweep.label(cell), "code"), *texts])
    return Table(("cell", "setting", *objectives), rows)


def sweep_page(
    sweep: Sweep,
    objectives: Sequence[str],
    compared: tuple[SweepCell, SweepCell, str, Difference] | None = None,
) -> Page:
    """Build the page of a sweep. ``compared`` are two cells, the bag, and the difference of their runs."""
    passing = sum(cell.passed for cell in sweep.cells)
    maps = Markup("").join(part("heatmap", each) for each in heat_maps(sweep)) if is_grid(sweep) else Markup()
    samples = None if is_grid(sweep) else scatter(sweep)
    chart = pareto_chart(sweep, objectives)
    runs = len(sweep.cells) * len(sweep.bags)
    return Page(
        title=f"Sweep of {sweep.graph}",
        lead=f"{len(sweep.cells)} settings on {', '.join(sweep.bags)}: {runs} runs.",
        verdict=f"{passing} of {len(sweep.cells)} pass" if sweep.expectations else "",
        good=passing > 0,
        tiles=[
            (str(len(sweep.cells)), "settings"),
            (str(len(sweep.bags)), "bag" if len(sweep.bags) == 1 else "bags"),
            (str(len(set(classes(sweep).values()))), "different outcomes"),
        ],
        sections=[
            Section("Thresholds", threshold_table(sweep).html() if sweep.thresholds else ""),
            Section("Heat map", maps, HEAT_NOTE),
            Section("Samples", charts([samples]) if samples is not None else ""),
            Section(
                "Pareto",
                (charts([chart]) if chart is not None else Markup()) + front_table(sweep, objectives).html()
                if objectives
                else "",
                PARETO_NOTE,
            ),
            Section("First different decision", _difference(sweep, compared), DIFFERENCE_NOTE),
            Section("Settings", cell_table(sweep).html(), "; ".join(f"{k}: {v}" for k, v in MEASURES.items()) + "."),
            Section("Failures", _failures(sweep)),
            Section("Set for all", settings(sweep.fixed)),
        ],
    )


def _difference(sweep: Sweep, compared: tuple[SweepCell, SweepCell, str, Difference] | None) -> Markup:
    if compared is None:
        return Markup()
    one, other, bag, found = compared
    text = part("preformatted", "\n".join(found.text()))
    return part("captioned", f"{describe_pair(sweep, one, other)}, {bag}", text)


def describe_pair(sweep: Sweep, one: SweepCell, other: SweepCell) -> str:
    """The numbers and values of two cells."""
    return f"Cell {one.number} ({sweep.label(one)}) and cell {other.number} ({sweep.label(other)})"


def _failures(sweep: Sweep) -> Markup:
    rows: list[list[Cell]] = [
        [(str(cell.number), "r"), one.bag, verdict.name, verdict.reason]
        for cell in sweep.cells
        for one in cell.results
        for verdict in one.verdicts
        if not verdict.passed
    ]
    rows += [
        [(str(cell.number), "r"), one.bag, "error", one.error]
        for cell in sweep.cells
        for one in cell.results
        if one.error
    ]
    return Table(("cell", "bag", "expectation", "reason"), rows).html()
