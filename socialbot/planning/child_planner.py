"""What planners in processes of their own have in common: what they ask, how often, and whom they believe."""

from __future__ import annotations

import logging
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.planning.domain import Domain, Problem
from socialbot.planning.plan import Plan, in_time
from socialbot.planning.planner import Answer, Limits, Verdict
from socialbot.planning.refusal import refusal
from socialbot.planning.validation import faults
from socialbot.planning.writer import problem_text

log = logging.getLogger(__name__)

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "problem.pddl"


@dataclass(frozen=True, slots=True)
class Search:
    """What a planner is to do: the domain and the problem lie in ``folder``; it has ``left_s`` (s) for that.

    ``target_s`` is the makespan that ends a search for ever shorter plans; None asks for the first plan.
    """

    folder: Path
    left_s: float
    limits: Limits
    cancelled: threading.Event
    target_s: float | None = None

    @property
    def half(self) -> Search:
        """The same with half of the time."""
        return replace(self, left_s=self.left_s / 2)

    def after(self, answer: Answer) -> Search:
        """The same with the time that a search left that came to ``answer``."""
        return replace(self, left_s=max(0.0, self.left_s - answer.seconds))

    def good(self, answer: Answer) -> bool:
        """Whether a plan is there that ends in time."""
        return answer.plan is not None and (self.target_s is None or in_time(answer.plan, self.target_s))


class ChildPlanner(ABC):
    """A planner that is asked by files and answers with plans; see `socialbot.planning.planner.Planner`.

    Its first plan is taken if it lasts no longer than it may. Else the planner searches on for a shorter one.
    """

    name = ""

    def solve(
        self, domain: Domain, problem: Problem, limits: Limits, cancelled: threading.Event | None = None
    ) -> Answer:
        """Blocks until there is an answer; setting ``cancelled`` (from another thread) ends that within 0.1 s."""
        begin = time.monotonic()
        try:
            answer = self._solve(domain, problem, limits, cancelled or threading.Event())
        except Exception as error:
            log.exception("%s failed", self.name)
            answer = Answer(Verdict.FAILED, message=f"{self.name}: {type(error).__name__}: {error}")
        return replace(answer, seconds=time.monotonic() - begin)

    @abstractmethod
    def search(self, search: Search) -> Answer:
        """Runs the planner. `Verdict.SOLVED` means here that it says so; nothing is validated or compared yet.

        The seconds of the answer are those that were used of what was left.
        """

    def _solve(self, domain: Domain, problem: Problem, limits: Limits, cancelled: threading.Event) -> Answer:
        reason = refusal(domain, problem)
        if reason is not None:
            return Answer(Verdict.REFUSED, message=reason)
        with tempfile.TemporaryDirectory(prefix="socialbot-plan-") as name:
            folder = Path(name)
            (folder / DOMAIN_FILE).write_text(domain.text, "utf-8")
            (folder / PROBLEM_FILE).write_text(problem_text(problem, domain.constants), "utf-8")
            search = Search(folder, limits.timeout_s, limits, cancelled)
            answer = self._validated(self.search(search), domain, problem)
            aimed = replace(search.after(answer), target_s=limits.makespan_s)
            if answer.plan is None or aimed.good(answer):
                return answer
            # What is minimized now is the makespan, whatever the problem says.
            text = problem_text(replace(problem, metric=None), domain.constants)
            (folder / PROBLEM_FILE).write_text(text, "utf-8")
            return _shorter(answer.plan, self._validated(self.search(aimed), domain, problem), aimed)

    def _validated(self, answer: Answer, domain: Domain, problem: Problem) -> Answer:
        """``answer``, or that its plan is invalid, by our own judgement."""
        if answer.plan is None:
            return answer
        found = faults(domain, problem, answer.plan)
        return Answer(Verdict.INVALID, message=f"{self.name}: {found[0]}") if found else answer


def _shorter(late: Plan, answer: Answer, search: Search) -> Answer:
    """What the search for a plan shorter than ``late`` came to.

    It says of no other plan how long it lasts: how far a search came in its time is not the same twice.
    """
    if search.good(answer) or answer.verdict in (Verdict.CANCELLED, Verdict.FAILED):
        return answer
    found = f"the plan found first lasts {late.makespan_s:g} s, longer than the {search.target_s:g} s there are"
    return Answer(Verdict.GAVE_UP, message=f"{found}; none was found that is short enough")
