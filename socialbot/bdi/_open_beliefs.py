"""Beliefs with variables that a plan adds and removes: they are rules without a condition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from socialbot.bdi.intentions import EVENT, OPEN, Failed
from socialbot.bdi.literals import SELF, Literal, is_source, literal_from_key
from socialbot.bdi.plans import Inference
from socialbot.bdi.stdlib.registry import detached, opened
from socialbot.bdi.terms import NOTHING, Atom, Variable
from socialbot.bdi.unification import Trail, Var, annotations_match, closed, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi._relations import Annotations, Args, Relation


def add_belief(ag: Interpreter, sign: str, key: str, args: Args, notes: Annotations, cause: Any) -> Any:
    """Add a belief of a plan, as ``+``, ``-+`` or ``++``; an argument without a value stands for any value.

    Returns:
        The request for a plan for the event, or None.
    """
    base = ag.beliefs
    relation, args = base.relation(key), resolve(args)
    if sign == "-+":
        for fact in _facts(ag, key):
            if _said_by(fact, notes):
                _forget(ag, relation, fact, cause)
                break
    if closed(args):
        if sign == "++":
            return base.add(relation, args, notes, cause)
        return (base.add_here if sign == "+" else base.replace)(relation, args, notes, cause)
    if sign == "-+":
        _remove(ag, relation, tuple(Var() for _ in args), notes, cause, here=False)
    notes = resolve(tuple(notes))
    if not closed(notes):
        raise Failed("no_value", f"an annotation of {literal_from_key(key, args)} has no value")
    head = literal_from_key(key, _general(args, {})).with_(annotations=notes)
    ag.engine.add_rules(Inference(head, NOTHING, text=f"{head}"))
    cause = ag.trace.record("belief", str(head), cause)
    base.notify(relation, args, True, cause)
    return _event(ag, f"+{key}", args, notes, cause, here=sign != "++")


def remove_belief(ag: Interpreter, key: str, args: Args, notes: Annotations, cause: Any, here: bool) -> Any:
    """Remove the newest belief that matches, or else a belief with variables. Returns the request of `add_belief`."""
    return _remove(ag, ag.beliefs.relation(key), args, notes, cause, here=here)


def _remove(ag: Interpreter, relation: Relation, args: Args, notes: Annotations, cause: Any, *, here: bool) -> Any:
    trail: Trail = []
    found = next(relation.match(args, notes, trail), None)
    undo(trail, 0)
    if found is not None:
        return ag.beliefs.remove(relation, args, notes, cause, here)
    if closed(args) and args:  # it is no instance that is removed
        return None
    fact = next((fact for fact in _facts(ag, relation.key) if _matches(fact, args, notes, trail)), None)
    if fact is None:
        return None
    _forget(ag, relation, fact, cause)
    return _event(ag, f"-{relation.key}", args, notes, cause, here=here)


def _event(ag: Interpreter, key: str, args: Args, notes: Annotations, cause: Any, *, here: bool) -> Any:
    """Return the request for a plan for an event with variables, or adopt it."""
    trigger = ag.triggers.get(key)
    if trigger is None or not (trigger.plans or trigger.key in ag.intentions.waits.events):
        return None
    request = (EVENT | OPEN, trigger, detached(args), notes, cause)
    if here:
        return request
    ag.intentions.adopt(request)
    return None


def forget_all(ag: Interpreter, pattern: Literal, cause: Any) -> None:
    """Remove all beliefs that match a pattern, also those with variables, with all their sources."""
    relation = ag.beliefs.relation(pattern.key)
    ag.beliefs.forget_all(relation, pattern.args, pattern.annotations, cause)
    trail: Trail = []
    for fact in _facts(ag, pattern.key):
        if _matches(fact, pattern.args, pattern.annotations, trail):
            _forget(ag, relation, fact, cause)
        undo(trail, 0)


def any_belief(ag: Interpreter, pattern: Any, trail: Trail) -> Iterator[tuple[Relation, Args]]:
    """Yield the held beliefs of any name that unify with ``X`` or ``X[a]``, the newest of each relation first."""
    mark = len(trail)
    for relation in list(ag.beliefs.relations.values()):
        for args, fact in reversed(list(relation.facts.items())):
            if args in relation.facts and unify(pattern, relation.literal(args, tuple(fact[1])), trail):
                yield relation, args
            undo(trail, mark)


def _facts(ag: Interpreter, key: str) -> list[Inference]:
    """Beliefs with variables, the newest first."""
    rules = [compiled.inference for compiled in ag.library.inferences.get(key, ())]
    return [rule for rule in reversed(rules) if not rule.condition.terms]


def _said_by(fact: Inference, notes: Annotations) -> bool:
    held = fact.head.annotations
    return annotations_match(notes, held if any(map(is_source, held)) else held + SELF, [])


def _matches(fact: Inference, args: Args, notes: Annotations, trail: Trail) -> bool:
    mark = len(trail)
    if unify(args, opened(fact.head.args), trail) and _said_by(fact, notes):
        return True
    undo(trail, mark)
    return False


def _forget(ag: Interpreter, relation: Relation, fact: Inference, cause: Any) -> None:
    ag.own_library().remove_inference(fact)
    ag.intentions.waits.relearn()
    ag.trace.record("unbelief", str(fact.head), cause)
    ag.beliefs.notify(relation, fact.head.args, False, cause)


def _general(term: Any, names: dict[Var, Variable]) -> Any:
    """Replace unbound variables by those of a rule."""
    if term.__class__ is Var:
        return names.setdefault(term, Variable(f"V{len(names) + 1}"))
    if isinstance(term, tuple):
        return tuple(_general(item, names) for item in term)
    if isinstance(term, Literal):
        return term.with_(args=_general(term.args, names), annotations=_general(term.annotations, names))
    if closed(term) or isinstance(term, Atom):
        return term
    raise Failed("no_value", f"{term} has a part without a value")
