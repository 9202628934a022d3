"""Waiting intentions of an agent: they are indexed by the events and beliefs that they wait for."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import ATOMIC, Literal
from socialbot.bdi.unification import closed

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.belief_base import Annotations, Args, BeliefBase
    from socialbot.bdi.intentions import ConditionPause, EventPause, QueuedPlan
    from socialbot.bdi.library import Library

Place = tuple[dict[Any, Any], Any]
"""Dictionary with a bucket of waiters, and the key of the bucket."""


_OPEN = object()
"""Key of a term with unbound variables, or that cannot be hashed."""


def _key(term: Any) -> Any:
    """Key that is equal for two terms that unify, or `_OPEN`."""
    if term.__class__ in ATOMIC:
        return term
    if not closed(term):
        return _OPEN
    key = _shape(term)
    try:
        hash(key)
    except TypeError:
        return _OPEN
    return key


def _shape(term: Any) -> Any:
    """Term without annotations: a pattern without them matches a literal that has some."""
    if term.__class__ is tuple:
        return tuple(map(_shape, term))
    if isinstance(term, Literal):
        return (Literal, term.functor, term.negated, *map(_shape, term.args))
    return term


class WaitIndex:
    """Waiters by the first known argument of the pattern that each waits for."""

    __slots__ = ("_by", "_open")

    def __init__(self) -> None:
        self._by: dict[int, dict[Any, dict[Any, None]]] = {}
        self._open: dict[Any, dict[Any, None]] = {}

    def __bool__(self) -> bool:
        return bool(self._open or any(self._by.values()))

    def add(self, waiter: Any, pattern: Args | None) -> Place:
        """Add a waiter for a pattern; None matches any arguments. Return the place for `remove`."""
        for position, term in enumerate(pattern or ()):
            key = _key(term)
            if key is not _OPEN:
                table = self._by.setdefault(position, {})
                break
        else:
            table, key = self._open, None
        table.setdefault(key, {})[waiter] = None
        return table, key

    @staticmethod
    def remove(waiter: Any, place: Place) -> None:
        table, key = place
        bucket = table.get(key, {})
        bucket.pop(waiter, None)
        if not bucket:
            table.pop(key, None)

    def waiters(self) -> list[Any]:
        """All waiters, in any order."""
        return [waiter for table in (self._open, *self._by.values()) for bucket in table.values() for waiter in bucket]

    def matching(self, args: Args) -> list[Any]:
        """Waiters whose pattern may match the arguments."""
        found = [waiter for bucket in self._open.values() for waiter in bucket]
        for position, table in self._by.items():
            key = _key(args[position])
            for bucket in table.values() if key is _OPEN else (table.get(key, ()),):
                found += bucket
        return found


class EventIndex(WaitIndex):
    """Waiters for events of one key.

    Waiters whose pattern consists of values without parts are in ``exact``, by this pattern: each alone, or several in
    a dictionary. ``only_exact`` is true as long as there were no others.
    """

    __slots__ = ("exact", "only_exact")

    def __init__(self) -> None:
        super().__init__()
        self.exact: dict[Args, Any] = {}
        self.only_exact = True

    def __bool__(self) -> bool:
        return bool(self.exact) or super().__bool__()

    def add(self, waiter: Any, pattern: Args | None) -> Place:
        if pattern is None:
            self.only_exact = False
            return super().add(waiter, pattern)
        for term in pattern:
            if term.__class__ not in ATOMIC:
                self.only_exact = False
                return super().add(waiter, pattern)
        known = self.exact.setdefault(pattern, waiter)
        if known is not waiter:
            if known.__class__ is not dict:
                known = self.exact[pattern] = {known: None}
            known[waiter] = None
        return self.exact, pattern

    def take_out(self, waiter: Any, place: Place) -> None:
        """Remove a waiter."""
        table, key = place
        if table is not self.exact or table.get(key).__class__ is dict:
            self.remove(waiter, place)
        elif table.get(key) is waiter:
            del table[key]

    def waiters(self) -> list[Any]:
        found = super().waiters()
        for waiters in self.exact.values():
            found += waiters if waiters.__class__ is dict else (waiters,)
        return found

    def matching(self, args: Args) -> list[Any]:
        if not closed(args):
            return self.waiters()
        try:
            waiters = self.exact.get(args, ())
        except TypeError:
            waiters = ()  # Arguments that cannot be hashed differ from those without parts.
        found = list(waiters) if waiters.__class__ in (dict, tuple) else [waiters]
        if self._by or self._open:
            found += super().matching(args)
        return found


class ChangeIndex(WaitIndex):
    """Conditions that name beliefs of one relation; they are due after a change of a belief that may matter."""

    __slots__ = ("_due",)

    def __init__(self, due: dict[Any, None]) -> None:
        super().__init__()
        self._due = due

    def enter(self, args: Args) -> None:
        """Mark the conditions that name this belief."""
        self._due.update(dict.fromkeys(self.matching(args)))

    leave = touch = enter

    def clear(self) -> None:
        """Mark all conditions: every belief was removed."""
        self._due.update(dict.fromkeys(self.waiters()))


class Waits:
    """Intentions of one agent that wait for events or conditions, in the order in which they began to wait.

    Attributes:
        events: Indexes of the pauses until an event, by the key of the event.
        conditions: Pauses until a condition holds.
        due: Those of the conditions whose truth may have changed since the last `recheck`.
    """

    __slots__ = ("_indexes", "_interpreter", "_numbers", "conditions", "due", "events")

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._numbers = itertools.count()
        self.events: dict[str, EventIndex] = {}
        self._indexes: dict[str, EventIndex] = {}  # also those without a pause
        self.conditions: dict[ConditionPause, None] = {}
        self.due: dict[ConditionPause, None] = {}

    # Events

    def await_event(self, pause: EventPause) -> None:
        index = self.events.get(pause.key)
        if index is None:
            index = self._indexes.get(pause.key)
            if index is None:
                index = self._indexes[pause.key] = EventIndex()
                self._interpreter.beliefs.listen(pause.key)
            self.events[pause.key] = index
        pause.number = next(self._numbers)
        pause.place = index.add(pause, pause.args)

    def rest(self, queued: QueuedPlan, pause: EventPause) -> None:
        """Let a queued plan wait for an event; it becomes an `Intention` only when it is looked at."""
        self._interpreter.intentions.running = None
        pause.interpreter = self._interpreter
        pause.intention = queued
        index = self.events.get(pause.key)
        if index is None or not index.only_exact:
            self.await_event(pause)
            return
        for term in pause.args:
            if term.__class__ not in ATOMIC:
                break
        else:
            # The most frequent case: no other intention waits for just these arguments.
            if index.exact.setdefault(pause.args, pause) is pause:
                pause.number = next(self._numbers)
                pause.place = index.exact, pause.args
                return
        self.await_event(pause)

    def queued(self) -> list[EventPause]:
        """Pauses of queued plans."""
        pauses = [pause for index in self.events.values() for pause in index.waiters()]
        return [pause for pause in pauses if pause.intention.__class__ is tuple]

    def forget_event(self, pause: EventPause) -> None:
        index = self.events.get(pause.key)
        if index is not None and pause.place is not None:
            index.take_out(pause, pause.place)
            if not index:
                del self.events[pause.key]

    def notify(self, key: str, args: Args, notes: Annotations, outside: bool = True) -> None:
        """Continue the intentions that wait for this event; ``outside`` is false for one of the body of a plan."""
        index = self.events.get(key)
        if index is None:
            return
        if index.only_exact:
            # The most frequent case: one intention waits for just these arguments.
            try:
                pause = index.exact.get(args)
            except TypeError:
                pause = None
            if pause is not None and pause.__class__ is not dict and not pause.notes:
                del index.exact[args]
                if not index.exact:
                    del self.events[key]
                queued = pause.intention
                if queued.__class__ is tuple and self._interpreter.intentions.goal_states is None:
                    pause.intention = None
                    self._interpreter.ready.append(queued)
                else:
                    pause.end()
                return
        found = index.matching(args)
        if len(found) > 1:
            found.sort(key=_number)
        for pause in found:
            if (outside or not pause.outside) and pause.matches(args, notes):
                self.forget_event(pause)
                pause.end()

    def listen(self, beliefs: BeliefBase) -> None:
        """Queue the awaited events, after a change of the library."""
        for key in self._indexes:
            beliefs.listen(key)

    # Conditions

    def await_condition(self, pause: ConditionPause) -> None:
        pause.number = next(self._numbers)
        self.conditions[pause] = None
        self._watch(pause)

    def forget_condition(self, pause: ConditionPause) -> None:
        self.conditions.pop(pause, None)
        self.due.pop(pause, None)
        for index, place in pause.places or ():
            index.remove(pause, place)

    def recheck(self) -> None:
        """Continue the intentions whose condition holds now."""
        last = -1
        while due := sorted((pause for pause in self.due if pause.number > last), key=_number):
            for pause in due:
                last = pause.number
                if pause not in self.due:
                    continue
                if pause.places is not None:
                    del self.due[pause]
                try:
                    holds, problem = pause.check(), None
                except Exception as error:  # noqa: BLE001 - a condition is user code
                    holds, problem = True, error
                if holds:
                    self.forget_condition(pause)
                    pause.end(problem)
                if problem is not None:
                    break  # A failure plan may have changed beliefs.

    def relearn(self) -> None:
        """Find again on which beliefs the conditions depend, after a change of the inferences."""
        for pause in self.conditions:
            for index, place in pause.places or ():
                index.remove(pause, place)
            self._watch(pause)
            self.due[pause] = None

    def _watch(self, pause: ConditionPause) -> None:
        """Index a condition by the beliefs on which it depends; check it in every turn if these are unknown."""
        beliefs = self._interpreter.beliefs
        named = None if pause.may_be_bound() else premises(pause.beliefs, self._interpreter.library)
        if named is None:
            pause.places = None
            self.due[pause] = None
            return
        pause.places = []
        for key, pattern in named:
            relation = beliefs.relation(key)
            index = relation.indexes.get(())
            if not isinstance(index, ChangeIndex):
                index = ChangeIndex(self.due)
                relation.observe((), index)
            pause.places.append((index, index.add(pause, pattern)))


def _number(pause: Any) -> int:
    return pause.number


Named = Iterable[tuple[str, "Args | None"]]
"""Keys of beliefs, each with a pattern of arguments; None stands for any."""


def premises(named: Named | None, library: Library) -> list[tuple[str, Args | None]] | None:
    """Return the beliefs on which others depend: these and, of inferred ones, those of the inferences.

    The result is None if it also depends on other things, such as computed beliefs.
    """
    if named is None:
        return None
    found: list[tuple[str, Args | None]] = []
    inferred: set[str] = set()
    todo = list(named)
    while todo:
        key, pattern = todo.pop()
        if library.computes(key) is not None:
            return None
        found.append((key, pattern))
        if key in inferred:
            continue
        inferred.add(key)
        for rule in library.inferences.get(key, ()):
            if rule.beliefs is None:
                return None
            todo += [(key, None) for key in rule.beliefs]
    return found
