"""Memory: beliefs and how they change, the events that this makes, and what is due when."""

from __future__ import annotations

import functools
import heapq
import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from socialbot.bdi.beliefs import Args, BeliefBase, Fact, Relation, Relations, Watcher, is_source, literal_of
from socialbot.bdi.compiler.runtime import EVENT
from socialbot.bdi.library import Library, Ready, Trigger
from socialbot.bdi.literals import ANYTHING, Computed, Literal, Reactor, ground, source
from socialbot.bdi.log import log
from socialbot.bdi.trace import Record, Sink
from socialbot.bdi.unification import Trail, Var, closed, resolve, undo, unify
from socialbot.core.clock import Clock, nanoseconds
from socialbot.core.errors import RuleError

Notes = tuple[Any, ...]


FEW_TIMERS = 64
"""With so many it does not pay to look which of them are over."""


class Memory:
    """What an agent believes. The methods that generated code calls take relations and tuples instead of literals."""

    __slots__ = (
        "_most_timers", "_now", "_records", "_sequence", "_sink_failed", "_timers", "base", "beliefs", "clock",
        "events", "library", "name", "relations", "sink", "stage", "triggers",
    )  # fmt: skip

    def __init__(self, name: str, clock: Clock, sink: Sink | None, library: Library) -> None:
        self.name = name
        self.clock = clock
        self.sink = sink
        self.library = library
        library.users += 1
        self.triggers = library.triggers
        self.relations = Relations(self._equip)
        self.base = self.relations.made
        self.beliefs = BeliefBase(self.relations)
        self.stage: str | None = None
        self.events: deque[tuple[Trigger, Args, Notes, Any]] = deque()
        self._now = clock.now
        self._timers: list[tuple[int, int, Callable[[], object]]] = []
        self._most_timers = FEW_TIMERS
        self._records = itertools.count(1)
        self._sequence = itertools.count()
        self._sink_failed = False

    # Changes

    def add(self, relation: Relation, args: Args, notes: Notes, cause: Any, since: int | None = None) -> None:
        """Holds a belief from now on; what is held already from this source is no event."""
        event = self.hold(relation, args, notes, cause, since)
        if event is not None:
            self.events.append(event)

    def hold(self, relation: Relation, args: Args, notes: Notes, cause: Any, since: int | None = None) -> Any:
        """Holds a belief from now on; returns the event that this is, if anybody reacts to it."""
        facts = relation.facts
        if args in facts or relation.special:
            return self._hold_special(relation, args, notes, cause, since)
        if self.sink is not None:
            cause = self.record("belief", self.text(relation, args), cause, source=_sources(notes))
        fact = facts[args] = (self._now() if since is None else since, notes, cause)
        if relation.indexes:
            relation.enter(args)
        if relation.held is not None:
            self._watch(relation, args, fact)
        added = relation.added
        return None if added is None else (added, args, notes, cause)

    def add_here(self, relation: Relation, args: Args, notes: Notes, cause: Any) -> Any:
        """Like `add`, but returns the request to carry out a plan for the event, or None."""
        event = self.hold(relation, args, notes, cause)
        return None if event is None else (EVENT, *event)

    def remove_known(self, relation: Relation, args: Args, notes: Notes, cause: Any, here: bool) -> Any:
        """Like `remove`, for arguments without variables."""
        fact = relation.facts.get(args)
        if fact is None:
            return None
        if not relation.quiet or self.sink is not None or fact[1] != notes:
            return self.remove(relation, args, notes, cause, here)
        del relation.facts[args]
        return None

    def remove_any(self, relation: Relation, args: Args, cause: Any, here: bool) -> Any:
        """``-b[source(_)]`` for arguments without variables: takes one source off, whoever it is."""
        fact = relation.facts.get(args)
        if fact is None:
            return None
        if not relation.quiet or self.sink is not None or len(fact[1]) > 1:
            return self.remove(relation, args, (source(Var()),), cause, here)
        del relation.facts[args]
        return None

    def remove(self, relation: Relation, args: Args, notes: Notes, cause: Any, here: bool) -> Any:
        """Takes the sources among ``notes`` off the first belief that matches; without any it is held no longer."""
        found = next(relation.match(args, notes, []), None)
        if found is None:
            return None
        taken = resolve(notes)
        left = tuple(note for note in relation.facts[found][1] if note not in taken)
        if any(map(is_source, left)):
            since, _, begin = relation.facts[found]
            relation.facts[found] = (since, left, begin)
        else:
            del relation.facts[found]
            relation.lives.pop(found, None)
            if relation.indexes:
                relation.leave(found)
        if self.sink is not None:
            others = {"left": _sources(left)} if found in relation.facts else {}
            cause = self.record("unbelief", self.text(relation, found), cause, **others)
        if relation.watchers and found not in relation.facts:
            self._tell(relation, found, False, cause)
        if relation.removed is None:
            return None
        if here:
            return (EVENT, relation.removed, found, taken, cause)
        self.events.append((relation.removed, found, taken, cause))
        return None

    def replace(self, relation: Relation, args: Args, notes: Notes, cause: Any) -> Any:
        """``-+b``: removes the first belief of the name with this source, whatever its arguments, and adds another."""
        anything = tuple(Var() for _ in args)
        before = next(relation.match(anything, notes, []), None)
        if before is not None:
            self.remove(relation, before, notes, cause, here=False)
            self._changed(relation, args, before, notes, cause)
        return self.add_here(relation, args, notes, cause)

    def _changed(self, relation: Relation, args: Args, before: Args, notes: Notes, cause: Any) -> None:
        """Announces that a belief takes the place of another one."""
        trigger = self.triggers.get(f"changed {relation.key}")
        if trigger is not None and args != before:
            self.events.append((trigger, args + before, notes, cause))

    def forget_one(self, relation: Relation, args: Args, cause: Any) -> None:
        """Removes a belief, whoever said it."""
        fact = relation.facts.pop(args, None)
        if fact is None:
            return
        relation.lives.pop(args, None)
        if relation.indexes:
            relation.leave(args)
        if self.sink is not None:
            cause = self.record("unbelief", self.text(relation, args), cause)
        if relation.watchers:
            self._tell(relation, args, False, cause)
        if relation.removed is not None:
            self.events.append((relation.removed, args, fact[1], cause))

    def forget_all(self, relation: Relation, args: Args, notes: Notes, cause: Any) -> None:
        """Removes every belief that matches, whoever said it."""
        for found in list(relation.match(args, notes, [])):
            self.forget_one(relation, found, cause)

    def _hold_special(self, relation: Relation, args: Args, notes: Notes, cause: Any, since: int | None) -> Any:
        if relation.kind is None:
            self._equip(relation)  # Its class may have become known only now, by a step of a plan.
        kind = relation.kind
        if kind is not None and issubclass(kind, Reactor):
            if self.sink is not None:
                cause = self.record("event", self.text(relation, args), cause)
            return None if relation.added is None else (relation.added, args, notes, cause)
        if kind is not None and issubclass(kind, Computed):
            raise RuleError(f"{self.text(relation, args)} is computed", remedy="it cannot be added")
        if args in relation.facts:
            return self._merge(relation, args, notes, cause)
        if kind is not None and kind.singleton:
            self._displace(relation, kind, args, notes, cause)
        relation.special = False
        event = self.hold(relation, args, notes, cause, since)
        relation.special = True
        if relation.watchers:
            self._tell(relation, args, True, relation.facts[args][2])
        return event

    def _displace(self, relation: Relation, kind: type[Literal], args: Args, notes: Notes, cause: Any) -> None:
        """Removes what a belief takes the place of, of which there is one at most."""
        before = next(iter(relation.facts), None)
        for other in list(self.base.values()):
            if other.kind is kind:
                for found in list(other.facts):
                    self.forget_one(other, found, cause)
        if before is not None:
            self._changed(relation, args, before, notes, cause)

    def watch(self, key: str, watcher: Watcher) -> None:
        """Has ``watcher`` called, at once, whenever a belief with this key, such as ``at/2``, begins or ends.

        It may change beliefs; an exception of it goes on the trace.
        """
        relation = self.relations[key]
        relation.watchers = (*relation.watchers, watcher)
        self._equip(relation)

    def _tell(self, relation: Relation, args: Args, held: bool, cause: Any) -> None:
        for watcher in relation.watchers:
            try:
                watcher(args, held, cause)
            except Exception as problem:  # noqa: BLE001 - user code
                self.record_failure(f"watching {relation.key}", cause, problem)

    def _merge(self, relation: Relation, args: Args, notes: Notes, cause: Any) -> Any:
        """Adds what is new among the annotations of a belief that is held; that is an event, too."""
        since, held, begin = relation.facts[args]
        if held == notes:
            return None
        new = tuple(note for note in notes if note not in held)
        if not new:
            return None
        relation.facts[args] = (since, held + new, begin)
        if self.sink is not None:
            cause = self.record("belief", self.text(relation, args), cause, source=_sources(new))
        return None if relation.added is None else (relation.added, args, new, cause)

    # Questions

    def solve(self, key: str, args: Args, notes: Notes, trail: Trail) -> Iterator[None]:
        """The ways in which something is believed, held or derived; variables are bound until the next one."""
        for _ in self.relations[key].match(args, notes, trail):
            yield
        mark = len(trail)
        kind = self.library.computes(key)
        if kind is not None:
            for found in self._compute(kind, resolve(args)):
                if unify(args, found, trail):
                    yield
                undo(trail, mark)
        for ready in self.library.inferences.get(key, ()):
            for _ in ready.solve(self, args, trail):
                if not closed(args):
                    raise RuleError(
                        f"{ready.inference.head} follows with a variable that has no value",
                        where=str(ready.inference.origin or ready.inference),
                        remedy="give every variable of the head a value in the condition, or in the question",
                    )
                yield
            undo(trail, mark)

    def _compute(self, kind: type[Computed], args: Args) -> Iterable[Args]:
        computed = self.library.computed.get(kind.functor) or self.library.computed.setdefault(kind.functor, kind())
        found = computed.solutions(*(arg if closed(arg) else ANYTHING for arg in args))
        if isinstance(found, bool):
            return [args] if found else []
        return list(found)

    # Time

    def at(self, time: int, callback: Callable[[], object]) -> None:
        """Has ``callback`` called at ``time`` (ns)."""
        heapq.heappush(self._timers, (time, next(self._sequence), callback))
        if len(self._timers) > self._most_timers:
            self._purge()

    def at_in(self, seconds: float, callback: Callable[[], object]) -> None:
        """Has ``callback`` called in ``seconds``."""
        self.at(self._now() + nanoseconds(seconds), callback)

    def not_at(self, callback: Callable[[], object]) -> None:
        """Has ``callback`` called no more; other timers stay."""
        timers = self._timers
        timers[:] = [timer for timer in timers if timer[2] is not callback]
        heapq.heapify(timers)

    def _purge(self) -> None:
        """Takes out timers that nobody waits for any more: limits that were kept, beliefs that have gone."""
        timers = self._timers
        timers[:] = [timer for timer in timers if not self._over(timer[2])]
        heapq.heapify(timers)
        self._most_timers = max(FEW_TIMERS, 2 * len(timers))

    def _over(self, callback: Any) -> bool:
        if isinstance(callback, functools.partial) and callback.func == self._on_held:
            relation, args, fact, *_ = callback.args
            return relation.lives.get(args) is not fact
        over = getattr(callback, "over", None)
        return over is not None and over()

    def _watch(self, relation: Relation, args: Args, fact: Fact) -> None:
        """Sees to it that plans hear of it when a belief has been held long enough."""
        assert relation.held is not None
        # Later its annotations may change; what it was at first tells this time from others when it is held.
        relation.live(args, fact)
        for ready in relation.held.candidates(args):
            self._watch_for(relation, args, fact, ready)

    def _watch_for(self, relation: Relation, args: Args, fact: Fact, ready: Ready) -> None:
        event = ready.plan.event
        if not _may_fit(event.literal.args, args):
            return
        try:
            duration = event.seconds() if callable(event.seconds) else event.seconds
            due = fact[0] + nanoseconds(duration)
        except Exception as problem:  # noqa: BLE001 - user code
            self.record_failure(str(ready.plan), fact[2], problem)
            return
        self.at(due, functools.partial(self._on_held, relation, args, fact, ready, duration))

    def _on_held(self, relation: Relation, args: Args, fact: Fact, ready: Ready, duration: float) -> None:
        if relation.lives.get(args) is fact:
            cause = fact[2]
            if self.sink is not None:
                cause = self.record("held", self.text(relation, args), cause, seconds=duration)
            self.events.append((Trigger(ready.plan.event.key, (ready,)), args, relation.facts[args][1], cause))

    # The plan library

    def own_library(self) -> Library:
        """The library, which from now on is this agent's alone."""
        if self.library.users > 1:
            self.library.users -= 1
            self.library = self.library.copy()
            self.library.users = 1
            self.triggers = self.library.triggers
            for relation in self.base.values():
                self._equip(relation)
        return self.library

    def listen(self, key: str) -> None:
        """Has the events of a key announced, now that somebody reacts to them."""
        self.triggers[key]
        name = key[5:] if key.startswith("held ") else key[1:]
        if name in self.base:
            self._equip(self.relations[name])

    def equip(self, kind: type[Literal]) -> None:
        """Has beliefs of a class treated as it asks for: held, one at a time, or only an event."""
        for relation in list(self.base.values()):
            if relation.key.startswith(f"{kind.functor}/"):
                self._equip(relation)

    def _equip(self, relation: Relation) -> None:
        key, triggers = relation.key, self.triggers
        relation.added = triggers.get(f"+{key}")
        relation.removed = triggers.get(f"-{key}")
        relation.held = triggers.get(f"held {key}")
        watched = bool(relation.watchers)
        relation.quiet = relation.removed is None and relation.held is None and not relation.indexes and not watched
        relation.kind = kind = self.library.kinds.get(key.rpartition("/")[0])
        relation.special = watched or (kind is not None and (kind.singleton or issubclass(kind, (Reactor, Computed))))
        relation.care = relation.special or relation.held is not None

    # The trace

    def text(self, relation: Relation, args: Args) -> str:
        """A belief as the trace shows it."""
        return str(relation.literal(args)) if closed(args) else str(literal_of(relation.key, args))

    def record(self, kind: str, what: str, cause: Any, **detail: object) -> str:
        """Gives a record to the trace; returns its id."""
        record_id = f"{self.name}-{next(self._records)}"
        if self.sink is not None:
            try:
                self.sink(Record(record_id, self._now(), kind, what, str(cause), detail))
            except Exception:  # noqa: BLE001 - whatever the trace goes to is user code
                if not self._sink_failed:
                    log().exception("%s: the trace is lost from here on, or has gaps", self.name)
                self._sink_failed = True
        return record_id

    def record_failure(self, what: str, cause: Any, problem: Exception) -> str:
        """Puts an exception of user code on record."""
        log().warning("%s: %s: %s", self.name, what, problem)
        return self.record("failure", what, cause, reason=type(problem).__name__, message=str(problem))


def _sources(notes: Notes) -> str:
    return ",".join(str(note.args[0]) for note in notes if is_source(note))


def _may_fit(pattern: tuple[object, ...], args: Args) -> bool:
    """Whether the constants of a pattern are those of the arguments."""
    return all(not ground(part) or part == arg for part, arg in zip(pattern, args, strict=True))
