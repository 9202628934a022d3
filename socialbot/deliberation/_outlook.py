"""Outlook of a running plan: conditions of later steps that do not hold and that none of its steps makes true."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from socialbot.deliberation._execution import PlanTask
from socialbot.planning.pddl.domain import PddlDomain
from socialbot.planning.pddl.formulas import (
    Add,
    ConditionalEffect,
    Delete,
    Effect,
    Fluent,
    Formula,
    Key,
    Not,
    NumericEffect,
    PddlWorld,
    Predicate,
    UniversalEffect,
    conjuncts,
)
from socialbot.planning.pddl.semantics import atoms, holds

_COUNTED = {"waiting": 0, "over": 1}
"""Phases of a step in which its conditions matter, and in which its effects have happened."""

Doubt = tuple[str, Formula]
"""Call of a step, and a condition of it."""


class PlanOutlook:
    """Watches the conditions that only the present facts can satisfy.

    Args:
        tasks: Steps of the plan.
    """

    def __init__(self, tasks: tuple[PlanTask, ...], domain: PddlDomain) -> None:
        self._tasks = tasks
        self._domain = domain
        self._phases: tuple[int | None, ...] = ()
        self._needs: dict[str, list[Doubt]] = {}
        """Conditions by the names of the predicates and functions that they read."""
        self._all: set[Doubt] = set()
        self._changed: set[str] = set()
        self._unmet: dict[Doubt, int] = {}
        self._raised: set[Doubt] = set()
        self._proved: set[Doubt] = set()

    def note(self, name: str) -> None:
        """Note a change of a predicate or function."""
        self._changed.add(name)

    def unmet(self, world: PddlWorld, now: int) -> Iterator[tuple[Doubt, int]]:
        """Yield the conditions that do not hold, with the time (ns) since when, except those raised before."""
        phases = tuple(map(_COUNTED.get, (task.phase for task in self._tasks)))
        if phases != self._phases:
            self._phases, self._needs = phases, self._needed(world)
            self._changed.update(self._needs)
            self._unmet = {doubt: since for doubt, since in self._unmet.items() if doubt in self._all}
        for name in self._changed:
            for doubt in self._needs.get(name, ()):
                if holds(doubt[1], world):
                    self._unmet.pop(doubt, None)
                    self._raised.discard(doubt)
                    self._proved.discard(doubt)
                else:
                    self._unmet.setdefault(doubt, now)
        self._changed.clear()
        yield from ((doubt, since) for doubt, since in self._unmet.items() if doubt not in self._raised)

    def raise_doubt(self, doubt: Doubt) -> None:
        """Do not yield a condition again before it has held."""
        self._raised.add(doubt)

    def prove(self) -> None:
        """Note that no plan can do without the conditions that were raised and do not hold."""
        self._proved = {doubt for doubt in self._unmet if doubt in self._raised}

    def hopeless(self, goal: Formula, world: PddlWorld) -> Doubt | None:
        """Return a condition, proved to be necessary, without which no step that is left achieves anything."""
        if not self._proved:
            return None
        left = [task for task in self._tasks if task.phase != "over"]
        calls = {doubt[0] for doubt in self._proved}
        blocked = [task for task in left if task.phase == "waiting" and task.step.call in calls]
        if not blocked:
            return None
        wanted = set(atoms(goal, world, {}))
        lost = set(blocked)
        followers: dict[PlanTask, set[PlanTask]] = {task: set() for task in left}
        for task in left:
            for earlier, _ in task.before_start:
                followers.get(earlier, set()).add(task)
        grows = True
        while grows:
            before = len(lost)
            lost.update(*(followers[task] for task in lost))
            for task in left:
                if followers[task] and followers[task] <= lost and not _achieves(task, wanted):
                    lost.add(task)
            grows = len(lost) > before
        if len(lost) < len(left):
            return None
        return next(doubt for doubt in self._proved if doubt[0] == blocked[0].step.call)

    def _needed(self, world: PddlWorld) -> dict[str, list[Doubt]]:
        added, deleted, changed = set[Predicate](), set[Predicate](), set[str]()
        for task in self._tasks:
            if task.phase != "over":
                _collect((one.effect for one in task.action.effects), added, deleted, changed)
        found: defaultdict[str, list[Doubt]] = defaultdict(list)
        self._all = set()
        for task in self._tasks:
            if task.phase != "waiting":
                continue
            for formula in (part for one in task.action.conditions for part in conjuncts(one.formula)):
                names = {atom.name for atom in atoms(formula, world, {})}
                match formula:
                    case Predicate():
                        provided = formula in added or formula.name in changed
                    case Not(Predicate() as inner):
                        provided = inner in deleted or inner.name in changed
                    case _:
                        provided = not names.isdisjoint(changed | {one.name for one in added | deleted})
                if not provided and names.isdisjoint(self._domain.derived):
                    doubt = (task.step.call, formula)
                    self._all.add(doubt)
                    for name in names:
                        found[name].append(doubt)
        return dict(found)


def _achieves(task: PlanTask, wanted: set[Key]) -> bool:
    """Return whether a task changes a predicate or function of the goal."""
    added, deleted, changed = set[Predicate](), set[Predicate](), set[str]()
    _collect((one.effect for one in task.action.effects), added, deleted, changed)
    return not wanted.isdisjoint(added | deleted) or any(key.name in changed for key in wanted)


def _collect(effects: Iterable[Effect], added: set[Predicate], deleted: set[Predicate], changed: set[str]) -> None:
    """Collect ground predicates that effects change, and the names of functions and of quantified predicates."""
    for effect in effects:
        match effect:
            case Add(predicate):
                added.add(predicate)
            case Delete(predicate):
                deleted.add(predicate)
            case NumericEffect(_, Fluent(name)):
                changed.add(name)
            case ConditionalEffect(_, inside):
                _collect(inside, added, deleted, changed)
            case UniversalEffect(_, inside):
                some: set[Predicate] = set()
                _collect(inside, some, some, changed)
                changed.update(predicate.name for predicate in some)
