"""Fault injection for a running graph: networks, processes and unauthorized senders.

``python -m evaluation.faults`` injects faults one by one with real processes and middleware, and compares the results
with the requirements in docs/fault-tests.md. ``--only lossy,outage`` selects faults. The two machines are network
namespaces, which need root; rows that need them are skipped without it.
"""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from evaluation.faults_plan import Plan, Skipped, busy_processes
from evaluation.report import DomainOption, JsonOption, Report, Value, run
from socialbot.bridge.environment import own_domain
from socialbot.core.errors import ParameterError, SocialbotError, suggestion
from socialbot.speech.synthesis import Synthesizer


@dataclass(frozen=True)
class Row:
    """Table row: a fault with its requirement. ``place`` names the function that injects it.

    The function takes the report, adds its figures, and returns the result as one line. Most rows count greetings, so
    they need a voice.
    """

    place: str
    fault: str
    required: str
    needs_voice: bool = True

    def measure(self, report: Report, plan: Plan) -> str:
        """Inject the fault.

        Raises:
            Skipped: This machine cannot run the row.
            SocialbotError: The measurement failed.
        """
        module, _, function = self.place.partition(":")
        return getattr(importlib.import_module(module), function)(report, plan)


ROWS: Mapping[str, Row] = {
    "clear": Row(
        "evaluation.faults_network:clear",
        "camera, speech, head on the robot, the rest on the workstation, 640x480 at 30 Hz, clear link",
        "all frames arrive; action within the detector's time + 40 ms (p99); robot <= 30 % of a core",
    ),
    "lossy": Row(
        "evaluation.faults_network:lossy",
        "20 Mbit/s and 5 % of packets lost",
        ">= 95 % of frames arrive, p99 <= 250 ms; no publisher blocked > 10 ms",
    ),
    "outage": Row(
        "evaluation.faults_outage:outage",
        "link down for 5 s and 30 s",
        "believed within 0.5 s, safe idle; data and behaviour back within 1 s, 3 s; no repeated greeting",
    ),
    "jitter": Row(
        "evaluation.faults_network:jitter",
        "packets travel 40 +- 30 ms and overtake each other",
        ">= 95 % of frames arrive, p99 <= 250 ms; greeted once",
    ),
    "bursts": Row(
        "evaluation.faults_network:bursts",
        "20 % of packets lost, five after one another",
        ">= 50 % of frames arrive, p99 <= 1 s; greeted once",
    ),
    "narrow": Row(
        "evaluation.faults_network:narrow",
        "1 Mbit/s for 10 s",
        ">= 3 % of frames (1 Hz) arrive, p99 <= 2 s; new again within 3 s; greeted once",
    ),
    "subnets": Row(
        "evaluation.faults_network:subnets",
        "two subnets with a router, which takes packets of 1280 bytes on one side",
        ">= 99 % of frames arrive, p99 <= 250 ms; greeted once",
    ),
    "server": Row(
        "evaluation.faults_network:server",
        "two subnets with a router; machines ask a discovery server",
        ">= 99 % of frames arrive, p99 <= 250 ms; greeted once",
    ),
    "three": Row(
        "evaluation.faults_network:three",
        "a second robot speaks, and is cut off for 5 s",
        "the others go on: >= 99 % of frames arrive, p99 <= 250 ms; it is back within 3 s; greeted once",
    ),
    "late": Row(
        "evaluation.faults_outage:late",
        "workstation starts 60 s late, or never",
        "robot stays safe and reports it; joins later",
    ),
    "kills": Row(
        "evaluation.faults_deaths:kills",
        "kill -9 of each node in turn, 20 times",
        "back within 2 s; unchanged actions apart from the gap",
    ),
    "clocks": Row(
        "evaluation.faults_clocks:clocks",
        "the computer's clock set back and forward by 2 s, an hour, a day, keys set",
        "continues; every visitor greeted once; no restarts",
    ),
    "strangers": Row(
        "evaluation.faults_strangers:strangers",
        "10 000 forged, replayed, altered or stale commands, keys set",
        "none executed, all counted",
    ),
    "packets": Row(
        "evaluation.faults_rtps:packets",
        "malformed and false RTPS packets, 5000 a second from another machine, keys set",
        "both processes go on; messages arrive again within 2 s after each attack, after packets in the name of a "
        "publisher within 15 s",
        needs_voice=False,
    ),
    "flood": Row(
        "evaluation.faults_flood:flood",
        "a stranger floods topics and discovery of a whole graph, keys set",
        "no node is restarted; decisions come as often as before within 20 s after each flood, 100 s "
        "after false participants",
    ),
    "soak": Row(
        "evaluation.faults_soak:soak",
        "4 h of bag time through the ROS graph at speed",
        "no growth of memory, threads, files, shared memory; no action lost",
        needs_voice=False,
    ),
    "fuzz": Row(
        "evaluation.faults_fuzz:fuzz",
        "1 million inputs over all decoders",
        "no crash, no hang > 1 s, no memory > 200 MB",
        needs_voice=False,
    ),
    "power": Row(
        "evaluation.faults_power:power",
        "power cut (SIGKILL of all processes) while recording",
        "bag and trace readable up to the last second",
        needs_voice=False,
    ),
}

OnlyOption = Annotated[str, typer.Option(metavar="ROW,ROW", help=f"Only these rows: {', '.join(ROWS)}.")]
LoadOption = Annotated[
    int, typer.Option("--load", min=0, max=1000, metavar="N", help="Run N busy processes beside all rows.")
]
QuickOption = Annotated[bool, typer.Option("--quick", help="Shorter runs: minutes instead of hours.")]
OutOption = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for the records; default: a new one in runs/.")
]


def chosen(only: str) -> list[str]:
    """Return the rows called ``only``, or all, in their order.

    Raises:
        ParameterError: A name is unknown.
    """
    names = [name.strip() for name in only.split(",") if name.strip()]
    for name in names:
        if name not in ROWS:
            raise ParameterError(f"no row {name!r}", where="--only", remedy=suggestion(name, ROWS))
    return [name for name in ROWS if name in names or not names]


def try_all(rows: Mapping[str, Row], report: Report, plan: Plan) -> None:
    """Run all rows and add the table to the report; a failed measurement counts as unmet."""
    table = report.tables.setdefault("faults", {})
    for name, row in rows.items():
        plan.tell(f"{name}: {row.fault}")
        begun, unmet, load = time.monotonic(), len(report.unmet), os.getloadavg()[0]
        met: Value = None
        try:
            measured = row.measure(report, plan)
            met = len(report.unmet) == unmet
        except Skipped as reason:
            measured = f"skipped: {reason}"
        except SocialbotError as error:
            measured, met = f"came to nothing: {error.where}: {error.what}", False
            report.add(f"{name}_tried", f"{name}: the fault could be tried", met, True)
        seconds = round(time.monotonic() - begun)
        table[row.fault] = {
            "required": row.required,
            "measured": measured,
            "met": met,
            "load": round(load, 1),
            "s": seconds,
        }
        plan.tell(f"{name}: {measured} ({'skipped' if met is None else 'met' if met else 'NOT met'}, {seconds} s)")


def main(
    only: OnlyOption = "",
    quick: QuickOption = False,
    domain: DomainOption = None,
    json: JsonOption = None,
    out: OutOption = None,
    load: LoadOption = 0,
) -> None:
    """Inject network faults, crashes and attacks, and compare the results with the requirements."""
    rows = {name: ROWS[name] for name in chosen(only)}
    if any(row.needs_voice for row in rows.values()):
        Synthesizer().say("hello")  # otherwise a row waits for minutes for a greeting
    folder = out or Path("runs") / f"faults-{datetime.now(timezone.utc):%Y%m%d-%H%M%S}"
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    report = Report("faults", quick)
    report.add("busy_processes", "busy processes beside the rows", load)
    with busy_processes(load), own_domain(domain) as own:
        try_all(rows, report, Plan(folder.resolve(), own, lambda line: console.print(line, markup=False), quick))
    report.finish(json)
    report.check()


if __name__ == "__main__":
    run(main)
