"""Timers of ``held_for`` plans: one for all beliefs of a relation, so that each belief costs a few bytes."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import TYPE_CHECKING

from socialbot.bdi.library import CompiledPlan, Trigger

if TYPE_CHECKING:
    from socialbot.bdi._relations import Args, Relation
    from socialbot.bdi.belief_base import BeliefBase

FEW_BELIEFS = 64
"""Number of waiting beliefs below which those that were removed since are kept."""


class HoldTimer:
    """Timer callback of one ``held_for`` plan for beliefs of a relation, in the order in which they are due.

    It queues the event of each belief, unless the belief was removed before.

    Args:
        base: The belief base.
        relation: The relation of the beliefs.
        plan: The plan with the event.
        seconds: The duration of the event.
        length: The same in ns; a belief that began at another time before its due time has begun anew.
    """

    __slots__ = (
        "_args", "_base", "_due", "_fired", "_most", "_next", "_numbers", "_started", "length", "plan", "relation",
        "seconds",
    )  # fmt: skip

    def __init__(self, base: BeliefBase, relation: Relation, plan: CompiledPlan, seconds: float, length: int) -> None:
        self.relation = relation
        self.plan = plan
        self.seconds = seconds
        self.length = length
        self._base = base
        self._due = array("q")
        self._numbers = array("q")
        self._args: list[Args] = []
        self._next = 0
        self._most = FEW_BELIEFS
        self._fired: set[Args] | None = None
        self._started = False

    def accepts(self, due: int) -> bool:
        """Whether no belief is due later than this time (ns)."""
        return self._next == len(self._due) or self._due[-1] <= due

    def add(self, args: Args, due: int) -> None:
        """Add a belief that is due not earlier than the others."""
        if self._next == len(self._due):
            self._discard_first()
        elif len(self._args) > self._most:
            self._discard_removed()
        number = self._base.timers.number()
        self._due.append(due)
        self._numbers.append(number)
        self._args.append(args)
        if not self._started:
            self._start(due, number)

    def _start(self, due: int, number: int) -> None:
        self._started = True
        self._base.timers.at(due, self, number=number)

    def waiting(self) -> Iterator[tuple[int, int, Args]]:
        """Yield the due time, the number and the arguments of each belief that is still held."""
        for place in range(self._next, len(self._args)):
            if self._is_held(place):
                yield self._due[place], self._numbers[place], self._args[place]

    def __call__(self) -> None:
        """Queue the events that are due, as far as no other timer precedes them."""
        timers = self._base.timers
        now = timers.now()
        self._started = False
        while self._next < len(self._args):
            place = self._next
            due, number = self._due[place], self._numbers[place]
            if due > now or (timers.heap and timers.heap[0][:2] < (due, number)):
                self._start(due, number)
                return
            self._next += 1
            if self._is_held(place):
                self._fire(place)
        self._discard_first()

    def _is_held(self, place: int) -> bool:
        fact = self.relation.facts.get(self._args[place])
        return fact is not None and fact[0] + self.length == self._due[place]

    def _fire(self, place: int) -> None:
        base, args = self._base, self._args[place]
        if place and self._due[place - 1] == self._due[place]:
            # A belief that was removed and added in the same instant is there twice.
            if self._fired is None:
                first = place - 1
                while first and self._due[first - 1] == self._due[place]:
                    first -= 1
                self._fired = set(self._args[first:place])
            if args in self._fired:
                return
            self._fired.add(args)
        else:
            self._fired = None
        _, notes, cause = self.relation.facts[args]
        if base.trace.sink is not None:
            cause = base.trace.record("held", self.relation.text(args), cause, seconds=self.seconds)
        base.events.append((Trigger(self.plan.plan.event.key, (self.plan,)), args, tuple(notes), cause))

    def _discard_first(self) -> None:
        """Forget the beliefs that were due."""
        if self._next:
            del self._due[: self._next], self._numbers[: self._next], self._args[: self._next]
            self._next = 0
        self._fired = None

    def _discard_removed(self) -> None:
        """Forget the beliefs that were due or removed since."""
        kept = list(self.waiting())
        self._next = 0
        self._fired = None
        self._due = array("q", (due for due, _, _ in kept))
        self._numbers = array("q", (number for _, number, _ in kept))
        self._args = [args for _, _, args in kept]
        self._most = max(FEW_BELIEFS, 2 * len(kept))
