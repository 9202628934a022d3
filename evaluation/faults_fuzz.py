"""Fuzz row: a million inputs for all decoders of foreign data, by ``evaluation.fuzz``.

It runs in separate processes, as in normal use.
"""

from __future__ import annotations

import subprocess
import sys

import msgspec

from evaluation.faults_plan import Plan
from evaluation.report import UNMET_EXIT, Report
from socialbot.core.errors import NodeError

INPUTS, QUICK_INPUTS = 1_000_000, 20_000
HARM = {
    "crash": "fuzz: exceptions other than SocialbotError, and ends of the process",
    "hang": "fuzz: inputs that took more than 1 s",
    "memory": "fuzz: inputs after which memory had grown by more than 200 MB",
}


def fuzz(report: Report, plan: Plan) -> str:
    """Give all decoders their share of the inputs, and count harmful ones."""
    folder = plan.records("fuzz")
    file = folder / "fuzz.json"
    command = [sys.executable, "-m", "evaluation.fuzz", "--inputs", str(plan.of(INPUTS, QUICK_INPUTS))]
    command += ["--json", str(file), "--keep", str(folder / "found")]
    with (folder / "fuzz.log").open("wb") as log:
        code = subprocess.run(command, check=False, stdin=subprocess.DEVNULL, stdout=log, stderr=log).returncode
    if code not in (0, UNMET_EXIT) or not file.exists():
        raise NodeError(f"ended with {code}", where="evaluation.fuzz", remedy=f"see {folder / 'fuzz.log'}")
    found = msgspec.json.decode(file.read_bytes())
    report.add("fuzz_inputs", "fuzz: inputs", found["inputs"])
    report.add("fuzz_decoders", "fuzz: decoders", len(found["decoders"]))
    for how, text in HARM.items():
        report.add(f"fuzz_{how}", text, found[how], 0)
    report.tables["fuzz"] = found["decoders"]
    return (
        f"{found['inputs']} inputs for {len(found['decoders'])} decoders: {found['crash']} crashes, "
        f"{found['hang']} hangs, {found['memory']} too large"
    )
