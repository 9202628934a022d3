"""Benchmark of the BDI engine against a minimal hand-written loop and other engines.

``python -m evaluation.engine`` measures by turns, in one process, in processor time. Each figure is the best of several
passes; requirements apply to ratios, which depend little on the machine. Other engines (``make bench``)
run the same workloads if installed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console

from evaluation.engine_bodies import BODIES
from evaluation.engine_host import host, latency
from evaluation.engine_loaded import LOADED
from evaluation.engine_peers import Workload, peers
from evaluation.engine_rows import Line, Row, measurement, ratio_line, row_lines
from evaluation.engine_workloads import QUICK, WORKLOADS, Figures, Scale
from evaluation.report import JsonOption, Machine, QuickOption, run, setting, write
from socialbot.core.errors import SocialbotError
from socialbot.runs.pages import Cell, Page, Section, Table

OnlyOption = Annotated[
    str | None, typer.Option("--only", metavar="W1,bursts", help="Only these workloads, by the names in the table.")
]

ROWS: dict[str, tuple[Row, ...]] = {**BODIES, **LOADED}
"""Rows of the workloads that look like programs."""

MEASURES: dict[str, Callable[[Scale], Figures]] = {
    **WORKLOADS,
    **{name: measurement(rows) for name, rows in ROWS.items()},
    "W6": host,
    "latency": latency,
}
"""Measurements by their names on the command line."""

PAGE_WIDTH = 150

NOTE = (
    "Rates are per second of processor time, each the best of several passes; a ratio is the engine's rate by that of "
    "the loop written by hand. An aim is what is hoped for beyond what is required."
)
UNMET = frozenset({"below", "above"})


def lines(scale: Scale) -> list[Line]:
    """Return the lines of the table."""
    shallow, deep = scale.depths
    few, many = scale.plans[0], scale.plans[-1]
    less, more = scale.facts[0], scale.facts[-1]
    return [
        Line("W1", "ratio", "event, condition, change, action", 0.45, 0.7, rate="engine_rate", hand="hand_rate"),
        Line("W1", "agentspeak_ratio", "the same, plan in AgentSpeak", rate="agentspeak_rate", hand="hand_rate"),
        Line("W1", "fresh_ratio", "the same, each belief a new object", rate="fresh_rate", hand="fresh_hand_rate"),
        Line("W1", "hook_cost", "share that the trace's hook costs, trace off", 0.05, at_most=True),
        Line("W1", "traced_cost_ns", "what a trace costs more for each, ns", rate="traced_rate"),
        ratio_line("W2a", f"{few} plans for one kind of event", few),
        ratio_line("W2a", f"{many} plans for one kind of event", many, 0.40, 0.6),
        Line("W2a", "of_few", f"rate with {many} plans as a share of that with {few}", 0.8),
        ratio_line("W2b", f"join over {less} facts", less),
        ratio_line("W2b", f"join over {more} facts", more, 0.6, 1.0),
        Line("W2b", "slower_than_few", f"times slower with {more} facts than with {less}", 2.0, at_most=True),
        ratio_line("W3", f"goals {shallow} deep, each the last step", shallow),
        ratio_line("W3", f"goals {deep} deep, each the last step", deep, 0.45, 0.7),
        *(
            Line(
                "W3", f"{name}_ratio_{deep}", text, rate=f"{name}_rate_{deep}", hand=f"hand_rate_{deep}",
            )
            for name, text in (
                ("agentspeak", "the same, plans in AgentSpeak"),
                ("stacked", f"goals {deep} deep, a step after each"),
                ("agentspeak_stacked", "the same, plans in AgentSpeak"),
            )
        ),
        Line("W3", "growth_kib", f"memory that {shallow} goals take more than 1000, KiB", 1.0, at_most=True),
        *(
            ratio_line("W4", f"{size} agents in a ring, tokens: {tokens}", f"{size}_{tokens}", *limits)
            for size, tokens in scale.rings
            for limits in [(0.25, 0.4) if (size, tokens) == (1_000, 1) else ()]
        ),
        Line("W4", "agentspeak_ratio", "1000, 1 token, plan in AgentSpeak", rate="agentspeak_rate", hand="hand_rate"),
        Line("W5", "engine_rate", "plans a second read and added", 15_000, 30_000, rate="engine_rate"),
        Line("W5", "eager_rate", "the same, compiled at once", rate="eager_rate"),
        *(line for name, rows in ROWS.items() for line in row_lines(name, rows)),
        Line("W6", "kib_per_agent", "memory an agent, KiB", 5.0, at_most=True),
        Line("W6", "import_ms", "processor time of the import, ms", 30.0, at_most=True),
        Line("W6", "asyncio_ms", "for comparison: that of the import of asyncio, ms"),
        Line("W6", "idle_share", "share of a processor with nothing to do", 0.0, at_most=True),
        Line("latency", "p50_us", "post to action, p50, µs"),
        Line("latency", "p99_us", "post to action, p99, µs"),
        Line("latency", "thread_p50_us", "the same from another thread, p50, µs", 15.0, at_most=True),
        Line("latency", "thread_p99_us", "the same from another thread, p99, µs"),
        Line("latency", "wake_p50_us", "of which the system's, to wake a thread, p50, µs"),
    ]  # fmt: skip


@dataclass
class Findings:
    """All figures: ``figures`` by workload and key, ``others`` by peer, workload and key."""

    scale: Scale
    quick: bool
    machine: Machine = field(default_factory=Machine.here)
    figures: dict[str, Figures] = field(default_factory=dict)
    others: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)

    def measured(self) -> list[tuple[Line, Any]]:
        """Lines with available figures, and their compared figure."""
        return [
            (line, self.figures[line.workload][line.key])
            for line in lines(self.scale)
            if line.key in self.figures.get(line.workload, {})
        ]

    def unmet(self) -> list[str]:
        return [f"{line.workload}.{line.key}" for line, value in self.measured() if line.verdict(value) in UNMET]

    def content(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "evaluation": "engine",
            "quick": self.quick,
            "machine": msgspec.to_builtins(self.machine),
            "unmet": self.unmet(),
        }
        for workload, figures in self.figures.items():
            limited = [line for line, _ in self.measured() if line.workload == workload and line.required is not None]
            found[workload] = {
                **figures,
                "required": {line.key: line.required for line in limited},
                "aim": {line.key: line.aim for line in limited if line.aim is not None},
                "peers": {name: rates[workload] for name, rates in self.others.items() if workload in rates},
            }
        return found

    def best_peer(self, line: Line) -> float | None:
        own = self.figures[line.workload].get(line.rate or line.key)
        found = [rates for name in self.others if (rates := self.peer(name, line)) is not None]
        if not found or not isinstance(own, (int, float)) or not own:
            return None
        return min(found) / own if line.at_most else own / max(found)

    def peer(self, name: str, line: Line) -> float | None:
        rates = self.others[name].get(line.workload, {})
        if line.at_most or line.rate is None:
            return rates.get(line.key)
        return rates.get(line.rate, rates.get("engine_rate") if line.rate.startswith("engine_rate") else None)

    def page(self) -> Page:
        judged = [line for line, value in self.measured() if line.verdict(value)]
        unmet = self.unmet()
        missed = f"; not met: {', '.join(unmet)}" if unmet else ""
        return Page(
            title=f"engine{' (quick)' if self.quick else ''}",
            lead=f"{len(judged) - len(unmet)} of {len(judged)} requirements are met{missed}." if judged else "",
            verdict="" if not judged else "requirements not met" if unmet else "requirements met",
            good=not unmet,
            sections=[Section("Workloads", self._table().html(), NOTE), setting(self.machine)],
        )

    def show(self, console: Console) -> None:
        console.print(f"[bold]engine[/]{' (quick)' if self.quick else ''}: rates per second of processor time")
        self.machine.show(console)
        console.print(self._table().terminal())
        unmet = self.unmet()
        console.print(f"not met: {', '.join(unmet)}" if unmet else "All requirements are met.")

    def _table(self) -> Table:
        rows: list[list[Cell]] = []
        before = ""
        for line, value in self.measured():
            figures, sign = self.figures[line.workload], "≤ " if line.at_most else ""
            verdict = line.verdict(value)
            row: list[Cell] = [
                line.workload if line.workload != before else "",
                line.text,
                (_text(figures.get(line.hand)) if line.hand else "", "r"),
                (_text(figures.get(line.rate) if line.rate else None), "r"),
                (_text(value) if line.key != line.rate else "", "r"),
                (f"{sign}{_text(line.required)}" if line.required is not None else "", "r"),
                (_text(line.aim), "r"),
                (verdict, "bad" if verdict in UNMET else "good"),
                *((_text(self.peer(name, line)), "r") for name in self.others),
                (_times(self.best_peer(line)), "r"),
            ]
            rows.append(row)
            before = line.workload
        return Table(("", "", "by hand", "engine", "ratio", "required", "aim", "", *self.others, "times best"), rows)


def measure(names: list[str], scale: Scale, *, quick: bool = False) -> Findings:
    """Measure workloads on the engine and on the installed peers."""
    findings = Findings(scale, quick)
    rivals: dict[str, dict[str, Workload]] = peers()
    for name in names:
        print(f"{name}: engine", file=sys.stderr)
        findings.figures[name] = MEASURES[name](scale)
        for peer, workloads in rivals.items():
            if name in workloads:
                print(f"{name}: {peer}", file=sys.stderr)
                findings.others.setdefault(peer, {})[name] = workloads[name](scale)
    return findings


def chosen(only: str | None) -> list[str]:
    """Return the names in ``--only``, or all.

    Raises:
        SocialbotError: A name is unknown.
    """
    if only is None:
        return list(MEASURES)
    known = {name.lower(): name for name in MEASURES}
    names = [name.strip() for name in only.split(",") if name.strip()]
    strange = [name for name in names if name.lower() not in known]
    if strange or not names:
        what = f"there is no workload {', '.join(strange)}" if strange else "no workload is named"
        raise SocialbotError(what, where="--only", remedy=f"name some of {', '.join(MEASURES)}")
    return [known[name.lower()] for name in names]


def main(json: JsonOption = None, quick: QuickOption = False, only: OnlyOption = None) -> None:
    """Benchmark the engine against a hand-written loop and other engines."""
    findings = measure(chosen(only), QUICK if quick else Scale(), quick=quick)
    if json is not None:
        write(findings.content(), findings.page(), json)
    findings.show(Console(highlight=False, width=None if sys.stdout.isatty() else PAGE_WIDTH))


def _times(factor: float | None) -> str:
    return "" if factor is None else f"{factor:.0f}" if factor >= 10 else f"{factor:.2g}"


def _text(value: object) -> str:
    if not isinstance(value, (int, float)):
        return ""
    if abs(value) >= 1_000_000:
        return f"{value / 1e6:.2f} M"
    if abs(value) >= 10_000:
        return f"{value / 1e3:.0f} k"
    return f"{value:.0f}" if abs(value) >= 1_000 or value == 0 else f"{value:.3g}"


if __name__ == "__main__":
    run(main)
