"""The formulas agree with rtamt, another implementation of metric temporal logic, on random formulas and traces.

``python -m tests.runs.expectations.test_rtamt COUNT`` compares COUNT of them where ``RTAMT_PYTHON`` names a Python with
rtamt, and ``--write`` writes the reference verdicts.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests.runs.expectations.random_formulas import random_signals, random_term, rtamt_case, verdicts

REFERENCE = Path(__file__).with_name("rtamt_reference.jsonl")
ORACLE = Path(__file__).with_name("rtamt_oracle.py")
COMMITTED = 400


def cases(count: int) -> Iterator[dict[str, Any]]:
    """Random formulas and traces, some of them of a trace that goes on."""
    for number in range(count):
        rng = random.Random(f"formula {number}")
        term = random_term(rng, rng.choice((1, 2, 2, 3, 3, 4)))
        signals = random_signals(rng, rng.randrange(1, 25))
        yield {"term": term, "signals": signals, "complete": rng.random() < 0.5}


def oracle() -> str | None:
    """The Python with rtamt, if there is one."""
    given = os.environ.get("RTAMT_PYTHON")
    return given or (sys.executable if find_spec("rtamt") else None)


def answers(python: str, count: int) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """Cases with the verdicts of rtamt."""
    lines = [json.dumps(rtamt_case(**case)) for case in cases(count)]
    done = subprocess.run([python, str(ORACLE)], input="\n".join(lines), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return zip(cases(count), map(json.loads, done.stdout.splitlines()), strict=True)


def disagreements(python: str, count: int) -> list[tuple[dict[str, Any], dict[str, str], dict[str, str]]]:
    compared = ((case, expected, verdicts(**case)) for case, expected in answers(python, count))
    return [each for each in compared if each[1] != each[2]]


def test_formulas_agree_with_the_recorded_verdicts_of_rtamt() -> None:
    recorded = [json.loads(line) for line in REFERENCE.read_text("utf-8").splitlines()]
    assert len(recorded) == COMMITTED
    for case in recorded:
        expected = case.pop("rtamt")
        assert verdicts(**case) == expected, case


def test_the_recorded_verdicts_are_not_all_the_same() -> None:
    text = [json.loads(line)["rtamt"] for line in REFERENCE.read_text("utf-8").splitlines()]
    assert sum("0" in each["must"] and "1" in each["must"] for each in text) > COMMITTED // 4
    assert sum(each["must"] != each["may"] for each in text) > COMMITTED // 6


@pytest.mark.slow
@pytest.mark.skipif(oracle() is None, reason="rtamt is not installed; RTAMT_PYTHON may name a Python that has it")
def test_formulas_agree_with_rtamt() -> None:
    python = oracle()
    assert python is not None
    assert disagreements(python, 2000) == []


if __name__ == "__main__":
    python = oracle() or sys.exit("rtamt is not installed: set RTAMT_PYTHON")
    if "--write" in sys.argv:
        lines = [json.dumps({**case, "rtamt": found}) for case, found in answers(python, COMMITTED)]
        REFERENCE.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    else:
        count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
        wrong = disagreements(python, count)
        for each in wrong[:5]:
            sys.stdout.write(f"{each}\n")
        sys.stdout.write(f"{count} random formulas and traces: {len(wrong)} disagreements\n")
        sys.exit(bool(wrong))
