"""The planner POPF, if there is a program of that name: an older temporal planner, known from ROS."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

from socialbot.errors import InstallationError, PlanningError
from socialbot.planning.child import Ended, guarded, run
from socialbot.planning.child_planner import DOMAIN_FILE, PROBLEM_FILE, ChildPlanner, Search
from socialbot.planning.plan import Plan, parse_plan
from socialbot.planning.planner import Answer, Limits, Verdict

_SOLUTION = re.compile(r"^;+ *Solution Found", re.MULTILINE | re.IGNORECASE)
_STEP = re.compile(r"\s*[0-9.]+\s*:\s*\(")


class Popf(ChildPlanner):
    """Runs ``popf``, or the program at ``path``. Raises InstallationError when there is none.

    It knows no negative conditions and no derived predicates. That it calls a problem unsolvable is no proof:
    it says so of some that can be solved.
    """

    name = "popf"

    def __init__(self, path: str = "popf") -> None:
        found = shutil.which(path)
        if found is None:
            raise InstallationError(
                f"there is no program {path!r}",
                where="planner popf",
                remedy="put popf on the PATH, give its path as popf:/path/to/popf, or use the planner kairos",
            )
        self.command = str(Path(found).absolute())

    def search(self, search: Search) -> Answer:
        improve = [] if search.target_s is None else ["-n"]
        left_s, limits = search.left_s, search.limits
        command = guarded(
            [self.command, *improve, DOMAIN_FILE, PROBLEM_FILE],
            limits.memory_mb,
            left_s * limits.threads + 2.0,
        )
        ended = run(command, search.folder, left_s, search.cancelled)
        return replace(self._answer(ended, search.limits), seconds=ended.seconds)

    def _answer(self, ended: Ended, limits: Limits) -> Answer:
        """What a search came to."""
        if ended.how == "cancelled":
            return Answer(Verdict.CANCELLED, message="cancelled")
        plan = _last_plan(ended.output, whole=ended.how == "by itself")
        if plan is not None:
            return Answer(Verdict.SOLVED, plan)
        if ended.how == "late":
            return Answer(Verdict.GAVE_UP, message=f"popf found no plan in {limits.timeout_s:g} s")
        if "unsolvable" in ended.output.lower():
            return Answer(Verdict.GAVE_UP, message="popf says that there is no plan, which is no proof")
        if "bad_alloc" in ended.errors or "out of memory" in ended.errors.lower():
            return Answer(Verdict.GAVE_UP, message=f"popf found no plan in {limits.memory_mb} MB")
        return Answer(Verdict.FAILED, message=f"popf {ended.death}")


def _last_plan(output: str, *, whole: bool) -> Plan | None:
    """The last of the plans it wrote, which is the best; if it was cut short, the last that is surely whole."""
    parts = _SOLUTION.split(output)[1:]
    for part in reversed(parts if whole else parts[:-1]):
        lines = [line for line in part.splitlines() if _STEP.match(line)]
        try:
            return parse_plan("\n".join(lines), where="popf")
        except PlanningError:
            continue
    return None
