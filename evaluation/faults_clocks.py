"""Clock row: Waldo's behaviour while the system clock is set back and forward.

``socialbot up`` runs the whole graph with keys. Its camera repeats the scene of `evaluation.faults_deaths`: in each
pass one person comes, is greeted and offered help. A preloaded library (`set_clock.c`) shifts the realtime clock for
these processes only; monotonic clocks are unchanged. The results come from the record of the run.
"""

from __future__ import annotations

import random
import shutil
import struct
import subprocess
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from evaluation.faults_deaths import GREETING, PASS_S, SCENE, SETTINGS
from evaluation.faults_plan import Plan, Skipped, await_, beside, write_pictures
from evaluation.report import Report, Value
from socialbot.bridge.keys import new_key
from socialbot.core.clock import SECOND
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import TRACE

SOURCE = Path(__file__).with_name("set_clock.c")
CLOCK_VARIABLE = "SET_CLOCK"
"""Environment variable of the library: a file with the shift (ns) of the clock."""

STEPS_S = (-2, 3600, -3600, 2, -3600, 86400)
"""Successive shifts (s) of the clock."""
QUICK_STEPS_S = (-3600, 3600)

LOST_S = 2.0
"""Longest tolerated gap (s) without detections: shorter than `WaldoConfig.vanish_s`."""


def clocks(report: Report, plan: Plan) -> str:
    """Shift the clock in the middle of passes, and compare each pass with the usual behaviour."""
    folder = plan.records("clocks")
    library = build_library(folder)
    new_key("robot", folder / "keys")
    pictures, clock = write_pictures(folder / "pictures", SCENE), folder / "clock"
    changes = [word for setting, value in SETTINGS.items() for word in ("--set", f"{setting}={value}")]
    variables = {
        "LD_PRELOAD": str(library),
        CLOCK_VARIABLE: str(clock),
        "SOCIALBOT_KEYS": str(folder / "keys"),
    }
    steps, chance, ahead_s = plan.of(STEPS_S, QUICK_STEPS_S), random.Random(9), 0
    set_clock(clock, ahead_s)
    run = folder / "run"
    with beside(plan, folder, "up", "up", "--camera", pictures, "--out", run, *changes, variables=variables):
        await_(
            lambda: (run / TRACE).exists() and b"detection" in (run / TRACE).read_bytes(), 120.0, "nothing seen", run
        )
        time.sleep(PASS_S)
        for step_s in steps:
            time.sleep(chance.uniform(0.7, 1.3) * PASS_S)
            ahead_s += step_s
            set_clock(clock, ahead_s)
            plan.tell(f"clocks: set by {step_s:+d} s")
        time.sleep(2 * PASS_S)
    told = (folder / "up.log").read_text("utf-8").count("the clock of this computer was set")
    return _report(report, open_run(run), steps, told)


def build_library(folder: Path) -> Path:
    """Build the preloaded library.

    Raises:
        Skipped: No compiler is installed.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise Skipped("there is no C compiler (cc) to build what sets the clock")
    library = folder / "set_clock.so"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
    return library


def set_clock(file: Path, ahead_s: int) -> None:
    """Set the clock shift of all processes that read ``file``."""
    with file.open("r+b" if file.exists() else "wb") as clock:
        clock.write(struct.pack("q", ahead_s * SECOND))


def _report(report: Report, run: RecordedRun, steps: Sequence[int], told: int) -> str:
    stamps = [one.stamp for one in run.history if one.kind == "detection"]
    gap_s = max(later - sooner for sooner, later in pairwise(stamps)) / SECOND
    said = [one.stamp for one in run.history if one.kind == "utterance" and one.what == GREETING]
    passes = [(begin, begin + round(PASS_S * SECOND)) for begin in _begins(stamps)]
    counts = [sum(begin <= at < end for at in said) for begin, end in passes]
    reports = (one for track in run.node_history.reports.values() for _, one in track)
    starts = max((int(one.values.get("restarts", 0)) for one in reports), default=0)
    report.add("clocks_steps", "clocks: clock changes", len(steps))
    report.add("clocks_told", "clocks: up logs each change", told == len(steps), True)
    report.add("clocks_passes", "clocks: complete passes of the scene", len(passes))
    report.add("clocks_not_greeted", "clocks: passes without a greeting", counts.count(0), 0)
    report.add("clocks_greeted_twice", "clocks: passes with a repeated greeting", sum(map(_many, counts)), 0)
    report.add("clocks_gap_s", "clocks: longest time without detections, s", round(gap_s, 2), LOST_S)
    report.add("clocks_restarts", "clocks: restarted processes", starts, 0)
    rows: dict[str, dict[str, Value]] = {
        f"{number}": {"from s": round(run.history.seconds(begin), 1), "greetings": count}
        for number, ((begin, _), count) in enumerate(zip(passes, counts, strict=True), 1)
    }
    report.tables["clocks"] = rows
    return (
        f"set {len(steps)} times; {len(passes)} passes, {counts.count(0)} not greeted, "
        f"{sum(map(_many, counts))} greeted twice; nothing seen for {gap_s:.2f} s at most"
    )


def _many(count: int) -> bool:
    return count > 1


def _begins(stamps: Sequence[int]) -> list[int]:
    length = round(PASS_S * SECOND)
    return list(range(stamps[0], stamps[-1] - length, length))
