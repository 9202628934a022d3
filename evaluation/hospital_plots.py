"""Figures 7 to 11 of the hospital benchmark as SVG with the paper's values, for light and dark themes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from evaluation.hospital_paper import PREDECESSOR, RUNS, TABLE_3, PastCell, Recovered
from evaluation.hospital_record import CONFIGURATIONS, Configuration
from evaluation.hospital_statistics import Interval, Line, binomial, mean_interval, wilson
from evaluation.hospital_tables import WITH, WITHOUT, Cell, Experiments, paper_line, problem_line

_STYLE = """
svg{--paper:#fff;--ink:#1b1f23;--soft:#4a5560;--line:#e3e3e3;--edge:#8b949e;--band:#e9edf0;
--blue:#0b6e99;--orange:#c45500;--green:#4f7f22;--grey:#5b6670}
@media(prefers-color-scheme:dark){svg{--paper:#14181c;--ink:#e6e9ec;--soft:#aab4be;--line:#2b333b;--edge:#6b7680;
--band:#232b33;--blue:#5fb4dc;--orange:#f0964f;--green:#9ccc65;--grey:#aab4be}}
text{font:12px system-ui,sans-serif;fill:var(--soft)}
.head{font-size:14px;font-weight:600;fill:var(--ink)}
.paper{fill:var(--paper)}.band{fill:var(--band)}.frame{fill:none;stroke:var(--edge)}.grid{stroke:var(--line)}
.blue{--c:var(--blue)}.orange{--c:var(--orange)}.green{--c:var(--green)}.grey{--c:var(--grey)}
.run{fill:none;stroke:var(--c);stroke-width:1.8}.dashed{stroke-dasharray:5 4}.bar{stroke:var(--c);stroke-width:1.2}
.full{fill:var(--c);stroke:var(--paper);stroke-width:1}
.hollow{fill:var(--paper);stroke:var(--c);stroke-width:1.8}
"""
WIDTH, HEIGHT = 470, 400
_LEFT, _TOP, _RIGHT, _PLOT = 52, 34, 14, 250
_INSIDE = 12
"""Padding between the frame and the axes, pixels."""
_APART = 5.0
"""Distance of marks with intervals at the same x, pixels."""

Point = tuple[float, float]
Mark = Literal["circle", "square", "diamond", "triangle", ""]


@dataclass(frozen=True)
class Series:
    """Marks at ``points``, joined by a line unless ``loose``; those of the paper are ``hollow``.

    ``intervals`` are those of y at each point.
    """

    name: str
    colour: str
    points: Sequence[Point]
    intervals: Sequence[Interval | None] = ()
    mark: Mark = "circle"
    hollow: bool = False
    loose: bool = False


@dataclass(frozen=True)
class Axis:
    """Axis from the first to the last of its ``ticks``."""

    name: str
    ticks: Sequence[float]

    def share(self, value: float) -> float:
        return (value - self.ticks[0]) / (self.ticks[-1] - self.ticks[0])


@dataclass(frozen=True)
class Chart:
    """Series over two axes. ``band`` is the expected area of y: x, lower and upper y."""

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]
    band: Sequence[tuple[float, Interval]] = ()
    band_name: str = ""

    def at(self, point: Point) -> Point:
        x = _LEFT + _INSIDE + self.x.share(point[0]) * (WIDTH - _LEFT - _RIGHT - 2 * _INSIDE)
        return x, _TOP + _PLOT - _INSIDE - self.y.share(point[1]) * (_PLOT - 2 * _INSIDE)


def svg(chart: Chart) -> str:
    """Return the chart as an SVG file."""
    return _file(WIDTH, HEIGHT, _drawn(chart))


def sheet(charts: Sequence[Chart], columns: int = 2) -> str:
    """Return charts in ``columns`` columns as one SVG file."""
    rows = -(-len(charts) // columns)
    parts = (
        f'<g transform="translate({number % columns * WIDTH} {number // columns * HEIGHT})">{_drawn(chart)}</g>'
        for number, chart in enumerate(charts)
    )
    return _file(columns * WIDTH, rows * HEIGHT, "".join(parts))


def _file(width: int, height: int, content: str) -> str:
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    page = '<rect width="100%" height="100%" class="paper"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img"><style>{_STYLE}</style>{page}{content}</svg>\n'


def _drawn(chart: Chart) -> str:
    return "".join([*_axes(chart), *_band(chart), *_all_series(chart), *_key(chart)])


def _axes(chart: Chart) -> Iterable[str]:
    right, bottom = WIDTH - _RIGHT, _TOP + _PLOT
    yield f'<text x="{_LEFT}" y="20" class="head">{escape(chart.title)}</text>'
    for tick in chart.y.ticks:
        y = chart.at((0.0, tick))[1]
        yield f'<path d="M{_LEFT} {y:.1f}H{right}" class="grid"/>'
        yield f'<text x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>'
    for tick in chart.x.ticks:
        x = chart.at((tick, 0.0))[0]
        yield f'<path d="M{x:.1f} {bottom}v4" class="frame"/>'
        yield f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{tick:g}</text>'
    yield f'<rect x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" height="{_PLOT}" class="frame"/>'
    yield f'<text x="{(_LEFT + right) / 2}" y="{bottom + 36}" text-anchor="middle">{escape(chart.x.name)}</text>'
    turned = f'transform="translate(14 {_TOP + _PLOT / 2}) rotate(-90)"'
    yield f'<text {turned} text-anchor="middle">{escape(chart.y.name)}</text>'


def _band(chart: Chart) -> Iterable[str]:
    if chart.band:
        edge = [chart.at((x, interval.low)) for x, interval in chart.band]
        edge += [chart.at((x, interval.high)) for x, interval in reversed(chart.band)]
        yield f'<path d="{_path(edge)}z" class="band"/>'


def _all_series(chart: Chart) -> Iterable[str]:
    """Yield the series, shifted sideways where several have marks at one x."""
    beside = [series for series in chart.series if series.intervals]
    for series in chart.series:
        aside = (beside.index(series) - (len(beside) - 1) / 2) * _APART if series.intervals else 0.0
        points = [(x + aside, y) for x, y in map(chart.at, series.points)]
        yield f'<g class="{series.colour}"><title>{escape(series.name)}</title>'
        if not series.loose:
            yield f'<path d="{_path(points)}" class="run{" dashed" if series.hollow else ""}"/>'
        for (x, _), point, interval in zip(
            points, series.points, series.intervals or [None] * len(points), strict=True
        ):
            if interval is not None:
                low, high = chart.at((point[0], interval.low))[1], chart.at((point[0], interval.high))[1]
                bar = f"M{x:.1f} {low:.1f}V{high:.1f}M{x - 3:.1f} {low:.1f}h6M{x - 3:.1f} {high:.1f}h6"
                yield f'<path d="{bar}" class="bar"/>'
        yield from (_mark(series, point) for point in points)
        yield "</g>"


def _path(points: Iterable[Point]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _mark(series: Series, point: Point) -> str:
    x, y = point
    shape = "hollow" if series.hollow else "full"
    match series.mark:
        case "circle":
            return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" class="{shape}"/>'
        case "square":
            return f'<rect x="{x - 3.5:.1f}" y="{y - 3.5:.1f}" width="7" height="7" class="{shape}"/>'
        case "diamond":
            return f'<path d="M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5-5z" class="{shape}"/>'
        case "triangle":
            return f'<path d="M{x:.1f} {y - 5:.1f}l5 9h-10z" class="{shape}"/>'
        case _:
            return ""


def _key(chart: Chart) -> Iterable[str]:
    top = _TOP + _PLOT + 58
    for number, series in enumerate(chart.series):
        x, y = _key_place(number, top)
        line = (
            "" if series.loose else f'<path d="M{x - 9} {y - 4}h18" class="run{" dashed" if series.hollow else ""}"/>'
        )
        yield f'<g class="{series.colour}">{line}{_mark(series, (x, y - 4))}</g>'
        yield f'<text x="{x + 15}" y="{y}">{escape(series.name)}</text>'
    if chart.band_name:
        x, y = _key_place(len(chart.series), top)
        yield f'<rect x="{x - 6}" y="{y - 9}" width="12" height="10" class="band"/>'
        yield f'<text x="{x + 15}" y="{y}">{escape(chart.band_name)}</text>'


def _key_place(number: int, top: int) -> tuple[int, int]:
    return _LEFT + 6 + number % 2 * 215, top + number // 2 * 18


# Figures

_RATES = Axis("problems, % of the missions", (0, 10, 25, 50, 75, 100))
_SHARE = Axis("missions, %", (0, 20, 40, 60, 80, 100))


def charts(experiments: Experiments) -> Mapping[str, Chart]:
    """Return Figures 7 to 11 by name; figures without missions are left out."""
    found = {
        "figure7": _met(experiments),
        "figure8": _completed(experiments),
        "figure9": _by_configuration(experiments),
        "figure10": _times(experiments),
        "figure11": _growth(experiments),
    }
    return {name: chart for name, chart in found.items() if chart is not None}


def _met(experiments: Experiments) -> Chart | None:
    cells = experiments.of("inline", WITH)
    if not cells:
        return None
    runs = cells[0].runs
    expected = [(rate, binomial(rate / 100.0, runs)) for rate in range(101)]
    return Chart(
        "Figure 7: missions with a problem",
        _RATES,
        _SHARE,
        (
            _share_of("here, simulated time", "green", cells, "met"),
            Series(
                "paper, Table 3", "green", _paper(lambda row: 100.0 * row.problems / RUNS), mark="diamond", hollow=True
            ),
            _past("no BDI, recounted", lambda cell: 100.0 * cell.replan.problems / RUNS),
        ),
        band=[(rate, Interval(100.0 * found.low / runs, 100.0 * found.high / runs)) for rate, found in expected],
        band_name=f"95 % of {runs} draws",
    )


def _completed(experiments: Experiments) -> Chart | None:
    with_, without = experiments.of("inline", WITH), experiments.of("inline", WITHOUT)
    if not with_ or not without:
        return None
    told = [(rate, 100.0 - rate) for rate in (10.0, 25.0, 50.0, 75.0)]
    return Chart(
        "Figure 8: completed missions, with BDI",
        _RATES,
        _SHARE,
        (
            _share_of("with recovery", "green", with_, "completed"),
            _share_of("without recovery", "orange", without, "completed"),
            Series("paper, with", "green", [(rate, 100.0) for rate, _ in told], mark="diamond", hollow=True),
            Series("paper, without (about)", "orange", told, mark="diamond", hollow=True),
        ),
    )


def _by_configuration(experiments: Experiments) -> Chart | None:
    marks: tuple[Mark, ...] = ("square", "circle", "circle")
    colours = zip(CONFIGURATIONS, ("blue", "orange", "green"), marks, strict=True)
    found = [
        _share_of(_NAMES[name], colour, cells, "completed", mark)
        for name, colour, mark in colours
        if (cells := experiments.of("inline", name))
    ]
    past = _past("no BDI, recounted", lambda cell: 100.0 * cell.plain.completed / RUNS)
    return Chart("Figure 9: completed missions", _RATES, _SHARE, (*found, past)) if found else None


_NAMES = {"plain": "no BDI, no recovery", WITHOUT: "BDI, no recovery", WITH: "BDI with recovery"}


def _times(experiments: Experiments) -> Chart | None:
    series = [*_simulated_times(experiments), *_ros_times(experiments)]
    paper = Series("paper, with recovery", "green", _paper(lambda row: row.seconds), mark="diamond", hollow=True)
    past = _past("no BDI, whole processes", lambda cell: cell.replan.seconds)
    axis = Axis("mean time, s", (2, 3, 4, 5, 6))
    return Chart("Figure 10: time of a mission", _RATES, axis, (*series, paper, past)) if series else None


_RECOVERY: Sequence[tuple[Configuration, str, str]] = (
    (WITH, "with recovery", "green"),
    (WITHOUT, "without recovery", "orange"),
)


def _simulated_times(experiments: Experiments) -> Iterable[Series]:
    for configuration, name, colour in _RECOVERY:
        if cells := experiments.of("inline", configuration):
            points = [(cell.rate, cell.mean_s) for cell in cells]
            yield Series(f"simulated, {name}", colour, points, [mean_interval(cell.seconds) for cell in cells])


def _ros_times(experiments: Experiments) -> Iterable[Series]:
    for configuration, name, colour in _RECOVERY:
        times = [(rate, experiments.ros_s(configuration, rate)) for rate in experiments.rates]
        if points := [(rate, seconds) for rate, seconds in times if seconds is not None]:
            yield Series(f"ROS, {name}", colour, points, mark="square")


def _growth(experiments: Experiments) -> Chart | None:
    cells = [cell for cell in experiments.of("inline", WITH) if cell.rate > 0]
    if not cells:
        return None
    counts = [cell.met / cell.runs * RUNS for cell in cells]
    points = [(count, _more(cell.mean_s, cells[0].mean_s)) for count, cell in zip(counts, cells, strict=True)]
    series = [Series("here, simulated time", "green", points)]
    line = problem_line(experiments.records("ros", WITH))
    if line is not None:
        series.append(Series("here, ROS", "blue", _grown(line, counts), mark="square"))
    first = TABLE_3[10].seconds
    told = [(row.problems, _more(row.seconds, first)) for row in TABLE_3.values()]
    series.append(Series("paper, Table 3", "orange", told, mark="diamond", hollow=True, loose=True))
    fitted = _grown(paper_line(), [row.problems for row in TABLE_3.values()])
    series.append(Series("paper: line", "orange", fitted, mark="", hollow=True))
    return Chart(
        "Figure 11: growth of the time with recovery",
        Axis(f"problems in {RUNS} missions", (0, 5, 10, 15, 20, 25, 30)),
        Axis("time, more than at 10 %, %", (0, 5, 10, 15, 20, 25)),
        series,
    )


def _more(seconds: float, first: float) -> float:
    return 100.0 * (seconds / first - 1.0)


def _grown(line: Line, counts: Sequence[float]) -> list[Point]:
    """Return the growth of the mean time, %, by number of problems in `RUNS` missions."""
    times = [line.start + line.slope * count / RUNS for count in counts]
    return [(count, _more(seconds, times[0])) for count, seconds in zip(counts, times, strict=True)]


def _share_of(
    name: str, colour: str, cells: Sequence[Cell], what: Literal["met", "completed"], mark: Mark = "circle"
) -> Series:
    counts = [(cell, cell.met if what == "met" else cell.completed) for cell in cells]
    shares = [(cell.rate, 100.0 * count / cell.runs) for cell, count in counts]
    known = [wilson(count, cell.runs) for cell, count in counts]
    return Series(name, colour, shares, [Interval(100.0 * each.low, 100.0 * each.high) for each in known], mark)


def _paper(value: Callable[[Recovered], float]) -> list[Point]:
    return [(rate, value(row)) for rate, row in TABLE_3.items()]


def _past(name: str, value: Callable[[PastCell], float]) -> Series:
    points = [(float(rate), value(cell)) for some in PREDECESSOR for rate, cell in some.items()]
    return Series(name, "blue", points, mark="triangle", hollow=True, loose=True)
