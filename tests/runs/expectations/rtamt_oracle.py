"""Evaluates formulas with rtamt, in an environment of its own: one case as JSON per line in and out.

A case has ``text``, the formula; ``traces``, by name the values of its variables; and ``moments``, how many verdicts to
give for each trace. The answer has a 1 or a 0 for each moment of each trace.
"""

from __future__ import annotations

import json
import sys
from typing import Any


def answer(case: dict[str, Any]) -> dict[str, str]:
    import rtamt  # type: ignore[import-not-found]

    found = {}
    for name, trace in case["traces"].items():
        specification = rtamt.StlDiscreteTimeSpecification()
        for variable in trace:
            specification.declare_var(variable, "float")
        specification.spec = case["text"]
        specification.parse()
        length = len(next(iter(trace.values())))
        robustness = specification.evaluate({"time": list(range(length)), **trace})
        assert len(robustness) == length
        found[name] = "".join("01"[value > 0] for _, value in robustness[: case["moments"]])
    return found


if __name__ == "__main__":
    for line in sys.stdin:
        sys.stdout.write(json.dumps(answer(json.loads(line))) + "\n")
        sys.stdout.flush()
