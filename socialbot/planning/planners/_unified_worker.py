"""Worker process for one call of an engine of unified-planning.

``python -m socialbot.planning.planners._unified_worker ENGINE DOMAIN PROBLEM TIMEOUT_S ANSWER``. It writes
the verdict, a message and the steps of the plan to the file ANSWER. Only this process imports the library.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from socialbot.core.installation import pip_command
from socialbot.planning.planners.planner import PlannerVerdict

INSTANT_S = 0.001
"""Separation of actions without duration in plans that only have an order."""

_VERDICTS = {
    "SOLVED_SATISFICING": PlannerVerdict.SOLVED,
    "SOLVED_OPTIMALLY": PlannerVerdict.SOLVED,
    "INTERMEDIATE": PlannerVerdict.SOLVED,
    "UNSOLVABLE_PROVEN": PlannerVerdict.IMPOSSIBLE,
    "UNSOLVABLE_INCOMPLETELY": PlannerVerdict.GAVE_UP,
    "TIMEOUT": PlannerVerdict.GAVE_UP,
    "MEMOUT": PlannerVerdict.GAVE_UP,
    "UNSUPPORTED_PROBLEM": PlannerVerdict.REFUSED,
}


def main() -> None:
    engine, domain, problem, timeout_s, answer = sys.argv[1:6]
    verdict, message, steps = _ask(engine, domain, problem, float(timeout_s))
    written = {"verdict": verdict.value, "message": message, "steps": steps}
    Path(answer).write_text(json.dumps(written), "utf-8")


def _ask(engine: str, domain: str, problem: str, timeout_s: float) -> tuple[PlannerVerdict, str, list]:
    shortcuts: Any = importlib.import_module("unified_planning.shortcuts")
    reading: Any = importlib.import_module("unified_planning.io")
    exceptions: Any = importlib.import_module("unified_planning.exceptions")
    environment = shortcuts.get_environment()
    environment.credits_stream = None
    with suppress(ModuleNotFoundError):
        importlib.import_module("up_kairos").register()
    if engine not in environment.factory.engines:
        remedy = pip_command("install", f"up-{engine}")
        return PlannerVerdict.FAILED, f"unified-planning has no engine {engine!r} here: {remedy}", []
    try:
        asked = reading.PDDLReader().parse_problem(domain, problem)
    except Exception as error:  # noqa: BLE001 - the reader raises whatever its grammar meets
        return PlannerVerdict.REFUSED, f"unified-planning cannot read the domain or problem: {_first_line(error)}", []
    try:
        with shortcuts.OneshotPlanner(name=engine) as planner:
            result = planner.solve(asked, timeout=timeout_s)
    except (exceptions.UPUsageError, exceptions.UPUnsupportedProblemTypeError) as error:
        return PlannerVerdict.REFUSED, _first_line(error), []
    verdict = _VERDICTS.get(result.status.name, PlannerVerdict.FAILED)
    said = result.status.name.lower().replace("_", " ")
    return verdict, said, list(_steps(result.plan)) if verdict is PlannerVerdict.SOLVED else []


def _steps(plan: Any) -> Iterator[tuple[float, str, list[str], float]]:
    """Yield start time (s), name, objects and duration (s) of each action."""
    if hasattr(plan, "timed_actions"):
        for start, action, duration in plan.timed_actions:
            yield float(start), *_call(action), float(duration or 0)
    else:
        for number, action in enumerate(plan.actions):
            yield number * INSTANT_S, *_call(action), 0.0


def _call(action: Any) -> tuple[str, list[str]]:
    return action.action.name, [str(parameter) for parameter in action.actual_parameters]


def _first_line(error: Exception) -> str:
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


if __name__ == "__main__":
    main()
