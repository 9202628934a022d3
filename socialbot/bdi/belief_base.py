"""Belief base of an agent: its beliefs with sources and times, and the events of their changes."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from socialbot.bdi._hold_timers import HoldTimer
from socialbot.bdi._relations import Annotations, AnnotationSet, Args, Fact, Relation, Watcher, is_source_of
from socialbot.bdi._rule_checks import mismatch
from socialbot.bdi.intentions import EVENT
from socialbot.bdi.library import CompiledPlan, Library
from socialbot.bdi.literals import SELF, Computed, Literal, Reactor, ground, is_source, source
from socialbot.bdi.trace import TraceWriter, log
from socialbot.bdi.unification import Var, closed, resolve
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi._timers import Timers

_NONE: dict[Any, Any] = {}
"""Shared empty dictionary of belief bases without known classes; it saves memory."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldBelief:
    """Held belief: its sources, its begin (ns), and the id of the trace record of its begin."""

    belief: Literal
    sources: tuple[str, ...]
    since: int
    record: str

    @property
    def source(self) -> str:
        return ",".join(self.sources)


class BeliefBase:
    """Beliefs of one agent; iteration yields each `HeldBelief`.

    Only the engine's thread may call the methods that change beliefs. Like compiled plans, they take a `Relation` and
    arguments. With ``here`` they return the event as a request instead of queuing it.
    """

    __slots__ = ("_fact", "_now", "events", "known", "library", "relations", "timers", "trace")

    def __init__(self, library: Library, events: deque[Any], timers: Timers, trace: TraceWriter) -> None:
        self.library = library
        self.events = events
        self.trace = trace
        self.relations: dict[str, Relation] = {}
        self.known: dict[tuple[type[Literal], int], Relation] = _NONE
        self.timers = timers
        self._now = timers.now
        self._fact: Fact = (0, (), None)

    # Reading

    def __iter__(self) -> Iterator[HeldBelief]:
        for relation in list(self.relations.values()):
            for args in list(relation.facts):
                yield _held(relation, args)

    def __len__(self) -> int:
        return sum(len(relation.facts) for relation in self.relations.values())

    def __contains__(self, belief: Literal) -> bool:
        """Whether a belief is held. Raises RuleError for a belief with variables."""
        if not ground(belief.args):
            raise RuleError(f"{belief} has a variable", remedy=f"write engine.query({belief})")
        return self.get(belief) is not None

    def get(self, belief: Literal) -> HeldBelief | None:
        """Entry of a belief, compared without its annotations; None if it is not held."""
        relation = self.relations.get(belief.key)
        return _held(relation, belief.args) if relation and belief.args in relation.facts else None

    def relation(self, key: str) -> Relation:
        """Relation of a key such as ``at/2``; a missing relation is created."""
        relation = self.relations.get(key)
        if relation is None:
            key = sys.intern(key)
            relation = Relation(key, self)
            self.equip(relation)
            relation = self.relations.setdefault(key, relation)
        return relation

    def relation_of(self, belief: Literal) -> Relation:
        """Relation of a belief from outside; a first belief that no rule can match is reported."""
        if belief.key not in self.relations and (why := mismatch(belief, self.library.patterns(belief.functor))):
            log().warning("%s: no rule matches %s: %s", self.trace.name, belief, why)
        return self.relation(belief.key)

    def know(self, kind: type[Literal], arity: int, relation: Relation) -> None:
        if self.known is _NONE:
            self.known = {}
        self.known[kind, arity] = relation

    # Adding

    def add(self, relation: Relation, args: Args, notes: Annotations, cause: Any, since: int | None = None) -> None:
        """Add a belief and queue its event; a belief already held from this source raises no event."""
        event = self.hold(relation, args, notes, cause, since)
        if event is not None:
            self.events.append(event)

    def hold(self, relation: Relation, args: Args, notes: Annotations, cause: Any, since: int | None = None) -> Any:
        """Add a belief; return its event if plans exist for it."""
        facts = relation.facts
        if args in facts or relation.special:
            return self._hold_special(relation, args, notes, cause, since)
        if self.trace.sink is not None:
            cause = self.trace.record("belief", relation.text(args), cause, source=_sources(notes))
        if since is None:
            now = self._now  # a call of the attribute itself takes longer
            since = now()
        fact = self._fact
        if fact[0] != since or fact[1] is not notes or fact[2] is not cause:
            fact = self._fact = (since, notes, cause)
        facts[args] = fact  # shared by beliefs that begin together
        if relation.indexes:
            relation.enter(args)
        if relation.held is not None:
            for plan in relation.held.candidates(args):
                self.set_hold_timer(relation, args, plan)
        added = relation.added
        return None if added is None else (added, args, notes, cause)

    def add_here(self, relation: Relation, args: Args, notes: Annotations, cause: Any) -> Any:
        """Add a belief; return the request for a plan for its event, or None."""
        event = self.hold(relation, args, notes, cause)
        return None if event is None else (EVENT, *event)

    def _hold_special(self, relation: Relation, args: Args, notes: Annotations, cause: Any, since: int | None) -> Any:
        if relation.kind is None:
            self.equip(relation)  # A step of a plan may have declared its class only now.
        kind = relation.kind
        if kind is not None and issubclass(kind, Reactor):
            if self.trace.sink is not None:
                cause = self.trace.record("event", relation.text(args), cause)
            return None if relation.added is None else (relation.added, args, notes, cause)
        if kind is not None and issubclass(kind, Computed):
            raise RuleError(f"{relation.text(args)} is computed", remedy="it cannot be added")
        if args in relation.facts:
            return self._merge(relation, args, notes, cause)
        if kind is not None and kind.singleton:
            before = next(iter(relation.facts), None)
            for other in [other for other in self.relations.values() if other.kind is kind]:
                for found in list(other.facts):
                    self.forget_one(other, found, cause)
            if before is not None:
                self._changed(relation, args, before, notes, cause)
        relation.special = False
        event = self.hold(relation, args, notes, cause, since)
        relation.special = True
        self.notify(relation, args, True, relation.facts[args][2])
        return event

    def _merge(self, relation: Relation, args: Args, notes: Annotations, cause: Any) -> Any:
        """Add new annotations to a held belief; this raises an event too."""
        new = relation.merge(args, notes)
        if not new:
            return None
        if self.trace.sink is not None:
            cause = self.trace.record("belief", relation.text(args), cause, source=_sources(new))
        return None if relation.added is None else (relation.added, args, new, cause)

    def replace(self, relation: Relation, args: Args, notes: Annotations, cause: Any) -> Any:
        """Replace the newest belief of this name and source by another (``-+b``); the result is that of `add_here`."""
        facts = relation.facts
        before = next(reversed(facts), None)
        if before is None:
            return self.add_here(relation, args, notes, cause)
        if facts[before][1] != notes:
            before = next(relation.match(tuple(Var() for _ in args), notes, []), None)
        elif relation.quiet and not relation.care and self.trace.sink is None:
            del facts[before]
            if args not in facts:
                now = self._now
                facts[args] = (now(), notes, cause)
                return None if relation.added is None else (EVENT, relation.added, args, notes, cause)
            return self.add_here(relation, args, notes, cause)
        if before is not None:
            self._remove_held(relation, before, notes, cause, here=False, exact=not args)
            if args != before:
                self._changed(relation, args, before, notes, cause)
        return self.add_here(relation, args, notes, cause)

    def _changed(self, relation: Relation, args: Args, before: Args, notes: Annotations, cause: Any) -> None:
        trigger = self.library.triggers.get(f"changed {relation.key}")
        if trigger is not None and args != before:
            self.events.append((trigger, args + before, notes, cause))

    # Removing

    def remove(self, relation: Relation, args: Args, notes: Annotations, cause: Any, here: bool) -> Any:
        """Remove the sources in ``notes`` from the newest matching belief, and the belief with its last source.

        A pattern with variables that leaves other sources raises no event, as in Jason.
        """
        exact = closed(args) and closed(notes)
        found = next(relation.match(args, notes, []), None)
        return None if found is None else self._remove_held(relation, found, notes, cause, here, exact)

    def _remove_held(
        self, relation: Relation, found: Args, notes: Annotations, cause: Any, here: bool, exact: bool
    ) -> Any:
        """Remove sources from a belief; there is an event if it was ``exact`` or the belief has no source any more."""
        since, held, begin = relation.facts[found]
        taken = notes if notes is SELF else resolve(notes)
        if held.__class__ is AnnotationSet:
            left, remains = held, held.remove(taken)
        else:
            alone = held == taken
            left = () if alone else tuple(n for n in held if n not in taken and not is_source_of(n, taken))
            remains = any(map(is_source, left))
        if remains:
            relation.facts[found] = (since, left, begin)
            relation.touch(found)
        else:
            del relation.facts[found]
            relation.leave(found)
        if self.trace.sink is not None:
            others = {"left": _sources(left)} if found in relation.facts else {}
            cause = self.trace.record("unbelief", relation.text(found), cause, **others)
        if relation.watchers and found not in relation.facts:
            self.notify(relation, found, False, cause)
        if relation.removed is None or not (exact or found not in relation.facts):
            return None
        if here:
            return (EVENT, relation.removed, found, taken, cause)
        self.events.append((relation.removed, found, taken, cause))
        return None

    def remove_known(self, relation: Relation, args: Args, notes: Annotations | None, cause: Any, here: bool) -> Any:
        """Variant of `remove` for arguments without variables; without ``notes``, it removes a source of any name."""
        fact = relation.facts.get(args)
        if fact is None:
            return None
        alone = len(fact[1]) == 1 if notes is None else fact[1] == notes
        if not relation.quiet or self.trace.sink is not None or not alone:
            return self.remove(relation, args, (source(Var()),) if notes is None else notes, cause, here)
        del relation.facts[args]
        return None

    def forget_one(self, relation: Relation, args: Args, cause: Any) -> None:
        """Remove a belief with all its sources."""
        fact = relation.facts.pop(args, None)
        if fact is None:
            return
        relation.leave(args)
        if self.trace.sink is not None:
            cause = self.trace.record("unbelief", relation.text(args), cause)
        if relation.watchers:
            self.notify(relation, args, False, cause)
        if relation.removed is not None:
            self.events.append((relation.removed, args, tuple(fact[1]), cause))

    def forget_all(self, relation: Relation, args: Args, notes: Annotations, cause: Any) -> None:
        """Remove the matching beliefs with all their sources."""
        for found in list(relation.match(args, notes, [])):
            self.forget_one(relation, found, cause)

    def forget_sources(self, relation: Relation, args: Args, notes: Annotations, cause: Any) -> None:
        """Remove the sources in ``notes`` from the matching beliefs, and each belief with its last source."""
        for found, taken in [(found, resolve(notes)) for found in relation.match(args, notes, [])]:
            self.remove(relation, found, taken, cause, here=False)

    # Watching

    def watch(self, key: str, watcher: Watcher) -> None:
        """Call ``watcher`` at once whenever a belief with this key, such as ``at/2``, begins or ends.

        The watcher may change beliefs; its exceptions are written to the trace.
        """
        relation = self.relation(key)
        relation.watchers = (*relation.watchers, watcher)
        self.equip(relation)

    def notify(self, relation: Relation, args: Args, held: bool, cause: Any) -> None:
        for watcher in relation.watchers:
            try:
                watcher(args, held, cause)
            except Exception as problem:  # noqa: BLE001 - user code
                self.trace.record_failure(f"watching {relation.key}", cause, problem)

    def set_hold_timer(self, relation: Relation, args: Args, plan: CompiledPlan) -> None:
        """Start the timer of a plan with a ``held_for`` event for this belief."""
        event, fact = plan.plan.event, relation.facts[args]
        if not all(not ground(part) or part == arg for part, arg in zip(event.literal.args, args, strict=True)):
            return
        try:
            seconds = event.seconds() if callable(event.seconds) else event.seconds
            due = fact[0] + nanoseconds(seconds)
        except Exception as problem:  # noqa: BLE001 - user code
            self.trace.record_failure(str(plan.plan), fact[2], problem)
            return
        self.start_hold_timer(relation, args, plan, due, seconds)

    def start_hold_timer(self, relation: Relation, args: Args, plan: CompiledPlan, due: int, seconds: float) -> None:
        """Start the timer of a plan for this belief, with the time (ns) at which it is due."""
        length = due - relation.facts[args][0]
        timer = relation.hold_timers.get(plan)
        if timer is None or timer.length != length or not timer.accepts(due):
            timer = HoldTimer(self, relation, plan, seconds, length)
            relation.keep_timer(plan, timer)
        timer.add(args, due)

    # The plan library

    def use(self, library: Library) -> None:
        self.library = library
        for relation in self.relations.values():
            self.equip(relation)

    def listen(self, key: str) -> None:
        """Queue the events of a key, such as ``+at/2``, even without plans for them."""
        self.library.triggers[key]
        relation = self.relations.get(key.partition(" ")[2] or key[1:])
        if relation is not None:
            self.equip(relation)

    def declare(self, kind: type[Literal]) -> None:
        """Apply the rules of a belief class, such as singleton or reactor, to its relations."""
        self.library.declare(kind)
        for relation in list(self.relations.values()):
            if relation.key.startswith(f"{kind.functor}/"):
                self.equip(relation)

    def equip(self, relation: Relation) -> None:
        """Look up the plans and the class of a relation."""
        key, triggers = relation.key, self.library.triggers
        if self.library.general:
            for sign in "+-":
                triggers[f"{sign}{key}"]
        relation.added = triggers.get(f"+{key}")
        relation.removed = triggers.get(f"-{key}")
        relation.held = triggers.get(f"held {key}")
        watched = bool(relation.watchers)
        relation.quiet = relation.removed is None and relation.held is None and not relation.indexes and not watched
        relation.kind = kind = self.library.kinds.get(key.rpartition("/")[0])
        relation.special = watched or (kind is not None and (kind.singleton or issubclass(kind, (Reactor, Computed))))
        changed = triggers.get(f"changed {key}")
        relation.care = relation.special or relation.held is not None or changed is not None


def _held(relation: Relation, args: Args) -> HeldBelief:
    since, annotations, cause = relation.facts[args]
    sources = tuple(str(note.args[0]) for note in annotations if is_source(note))
    others = tuple(note for note in annotations if not is_source(note))
    return HeldBelief(relation.literal(args, others), sources, since, str(cause))


def _sources(notes: Annotations) -> str:
    return ",".join(str(note.args[0]) for note in notes if is_source(note))
