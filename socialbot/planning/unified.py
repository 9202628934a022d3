"""The engines of unified-planning, each asked in a process of its own."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from importlib.util import find_spec

from socialbot.errors import InstallationError
from socialbot.planning.child import Ended, guarded, run
from socialbot.planning.child_planner import DOMAIN_FILE, PROBLEM_FILE, ChildPlanner, Search
from socialbot.planning.plan import Plan, Step
from socialbot.planning.planner import Answer, Verdict

ANSWER_FILE = "answer.json"
GRACE_S = 0.5
LIBRARIES_MB = 4000
"""Address space that the library and what it brings may take beside the memory of the engine; most is never used."""


class Unified(ChildPlanner):
    """The engine that unified-planning knows by the name ``engine``. Raises InstallationError without the library.

    Starting it takes a second or two, within the time there is, and engines go by the clock on the wall. Its reader of
    PDDL refuses some of what ours takes. It is asked for one plan: it does not search for a shorter one.
    """

    def __init__(self, engine: str) -> None:
        if find_spec("unified_planning") is None:
            raise InstallationError(
                "unified-planning is not installed",
                where=f"planner up:{engine}",
                remedy="pip install 'socialbot[up]', or use the planner kairos",
            )
        self.engine = engine
        self.name = f"up:{engine}"

    def search(self, search: Search) -> Answer:
        if search.target_s is not None:
            return Answer(Verdict.GAVE_UP, message=f"{self.name} does not search for shorter plans")
        left_s, limits = search.left_s, search.limits
        worker = [sys.executable, "-m", "socialbot.planning.unified_worker", self.engine]
        command = guarded(
            [*worker, DOMAIN_FILE, PROBLEM_FILE, f"{left_s:.3f}", ANSWER_FILE],
            limits.memory_mb + LIBRARIES_MB,
            left_s * limits.threads + 2.0,
        )
        ended = run(command, search.folder, left_s + GRACE_S, search.cancelled)
        return replace(self._answer(ended, search), seconds=ended.seconds)

    def _answer(self, ended: Ended, search: Search) -> Answer:
        """What a search came to."""
        limits = search.limits
        if ended.how == "cancelled":
            return Answer(Verdict.CANCELLED, message="cancelled")
        if ended.how == "late":
            return Answer(Verdict.GAVE_UP, message=f"{self.name} found no plan in {limits.timeout_s:g} s")
        if "MemoryError" in ended.errors or "bad_alloc" in ended.errors:
            return Answer(Verdict.GAVE_UP, message=f"{self.name} found no plan in {limits.memory_mb} MB")
        if ended.code != 0:
            return Answer(Verdict.FAILED, message=f"{self.name} {ended.death}")
        return self._told(json.loads((search.folder / ANSWER_FILE).read_text("utf-8")))

    def _told(self, written: dict) -> Answer:
        verdict = Verdict(written["verdict"])
        if verdict is not Verdict.SOLVED:
            return Answer(verdict, message=f"{self.name}: {written['message']}")
        steps = [
            Step(round(start, 6), name.lower(), tuple(arg.lower() for arg in args), round(duration, 6))
            for start, name, args, duration in written["steps"]
        ]
        return Answer(verdict, Plan(tuple(sorted(steps, key=lambda step: step.start_s))))
