"""Save and restore the mind of an agent across restarts of its process.

Saved are beliefs with their annotations and times, goals and events of intentions, queued events, pending ``held_for``
timers, the stage, the state of the random numbers, and the number of the next trace record.

Restored intentions start again: the outermost pursued goal is adopted, or the event is raised, once more. Executed
steps may therefore run twice, and time limits and ``wait`` start again. Not saved are plans (the program adds them),
sensors, queued percepts, and other timers and threads. The new engine needs a continuous clock, such as the wall clock
or ``ManualClock(data["time"])``. If its clock is behind, all saved times are shifted back by the difference.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import itertools
import json
import operator
import os
import random
import tempfile
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from socialbot.bdi._explain import later_request
from socialbot.bdi._hold_timers import HoldTimer
from socialbot.bdi._relations import Annotations, Args, Fact, Relation
from socialbot.bdi.intentions import EVENT, Intention, Request, subgoal
from socialbot.bdi.library import CompiledPlan, Trigger
from socialbot.bdi.literals import Literal, literal, source_notes
from socialbot.bdi.stdlib.environment import JAVA, JavaRandom
from socialbot.bdi.terms import Atom, Name, show
from socialbot.bdi.trace import log
from socialbot.bdi.unification import Var, resolve
from socialbot.core.errors import SocialbotError
from socialbot.core.reading import read_bytes

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine

SCHEMA, VERSION = "socialbot/mind", 1

Kinds = Mapping[str, type[Literal]]
"""Classes of beliefs and goals by name."""

HELD = "held "
"""Key prefix of ``held_for`` events."""


class MindError(SocialbotError):
    """Error while saving or restoring a mind."""

    exit_code = 3


class _Mind(NamedTuple):
    """Decoded mind, with the keys and plans of events and timers as texts."""

    stage: str | None
    random: random.Random | None
    records: int
    beliefs: list[tuple[str, Args, Fact]]
    pursuits: list[tuple[str, str | None, bool, tuple[Args, Annotations, str]]]
    held_plans: list[str]
    timers: list[tuple[str, str, Args, int, float]]


# Saving


def save(engine: Engine) -> dict[str, Any]:
    """Return the mind of an agent as JSON data. Call it in the engine's thread (see `Engine.call`).

    Posted items and due timers are processed first. Raises MindError for a belief or goal with a value other than
    numbers, strings, lists, atoms and literals.
    """
    interpreter = engine.interpreter
    interpreter.take_in()
    engine.timers.run_due()
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "name": engine.name,
        "time": engine.clock.now(),
        "stage": interpreter.stage,
        "random": None if interpreter.random is None else list(interpreter.random.getstate()),
        "records": _next_record(engine),
        "beliefs": [belief for relation in list(engine.beliefs.relations.values()) for belief in _beliefs(relation)],
        "pursuits": [
            _event(request, suspended=intention.suspended)
            for intention in engine.intentions
            if (request := _request_of(intention)) is not None
        ]
        + [_event((EVENT, *event)) for event in interpreter.events],
        "held_plans": sorted({_plan_id(plan) for plan in _held_plans(engine)}),
        "ripening": [
            {
                "belief": timer.relation.key,
                "args": _encode(args, functools.partial(_belief_text, timer.relation, args)),
                "plan": _plan_id(timer.plan),
                "due": due,
                "seconds": float(timer.seconds),
            }
            for due, _, args, timer in sorted(_hold_timers(engine), key=lambda found: found[:2])
        ],
    }


def write(engine: Engine, path: str | PathLike[str]) -> None:
    """Save the mind to a file, replaced atomically."""
    write_data(save(engine), path)


def write_data(data: dict[str, Any], path: str | PathLike[str]) -> None:
    """Write the result of `save` to a file, replaced atomically; callable from any thread."""
    target = Path(path)
    text = json.dumps(data, ensure_ascii=False)
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        try:
            with open(handle, "w", encoding="utf-8") as file:
                file.write(text + "\n")
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
        _sync_folder(target.parent)
    except OSError as problem:
        raise MindError(f"cannot write: {problem.strerror or problem}", where=str(path)) from problem


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # unsupported on some systems
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _beliefs(relation: Relation) -> Iterator[dict[str, Any]]:
    name = relation.key.rpartition("/")[0]
    # Most beliefs share their annotations with others.
    shared: dict[int, list[Any]] = {}
    for args, (since, notes, cause) in relation.facts.items():
        encoded = shared.get(id(notes))
        if encoded is None:
            encoded = shared[id(notes)] = _encode(notes, functools.partial(_belief_text, relation, args))
        yield {
            "belief": name,
            "args": list(args)
            if _JSON.issuperset(map(type, args))
            else _encode(args, functools.partial(_belief_text, relation, args)),
            "annotations": encoded,
            "since": since,
            "cause": str(cause),
        }


def _belief_text(relation: Relation, args: Args) -> str:
    return f"belief {relation.literal(args)}"


def _next_record(engine: Engine) -> int:
    # Its text, "count(7)", tells the number without advancing it.
    return int(repr(engine.trace.numbers).removeprefix("count(").removesuffix(")"))


def _request_of(intention: Intention) -> Request | None:
    """Outermost pursued goal of an intention, or its event; None for a branch."""
    if intention.event is None or not intention.frames:
        return intention.event
    body, goal, _ = intention.frames[0]
    if goal is not None:
        return goal
    return (later_request(body) if body is not None else None) or intention.event


def _event(request: Request, *, suspended: bool = False) -> dict[str, Any]:
    _, trigger, args, notes, cause = request

    def where() -> str:
        return f"{'goal' if trigger.goal else 'event'} {trigger.key.rpartition('/')[0]}"

    variables: dict[int, str] = {}
    saved: dict[str, Any] = {
        "event": trigger.key,
        "args": _encode(resolve(args), where, variables),
        "annotations": _encode(resolve(notes), where, variables),
        "cause": str(cause),
    }
    if suspended:
        saved["suspended"] = True
    if trigger.key.startswith(HELD) and trigger.plans:
        saved["plan"] = _plan_id(trigger.plans[0])
    return saved


def _hold_timers(engine: Engine) -> Iterator[tuple[int, int, Args, HoldTimer]]:
    """Yield the beliefs that ``held_for`` plans wait for, with their due times and numbers."""
    for _, _, timer, _ in engine.timers.heap:
        if isinstance(timer, HoldTimer):
            for due, number, args in timer.waiting():
                yield due, number, args, timer


def _held_plans(engine: Engine) -> list[CompiledPlan]:
    return [
        plan for key, trigger in list(engine.library.triggers.items()) if key.startswith(HELD) for plan in trigger.plans
    ]


def _plan_id(plan: CompiledPlan) -> str:
    return plan.plan.label or str(plan.plan)


_JSON = frozenset({type(None), str, int, float, bool})
"""Classes of terms that are JSON data themselves."""


def _encode(terms: tuple[Any, ...], where: Callable[[], str], variables: dict[int, str] | None = None) -> list[Any]:
    """JSON data of terms; ``where`` names their owner in an error."""
    return [_encode_term(term, where, variables) for term in terms]


def _encode_term(term: Any, where: Callable[[], str], variables: dict[int, str] | None) -> Any:
    if type(term) in _JSON:
        return term
    if isinstance(term, Name):
        return str(term)
    if type(term) is tuple:
        return {"list": _encode(term, where, variables)}
    if isinstance(term, Atom):
        return {"atom": term.name}
    if isinstance(term, Var) and variables is not None:
        return {"variable": variables.setdefault(id(term), f"{term.name}#{len(variables)}")}
    if isinstance(term, Literal):
        return {
            "functor": term.functor,
            "args": _encode(term.args, where, variables),
            "annotations": _encode(term.annotations, where, variables),
            "negated": term.negated,
        }
    raise MindError(
        f"{show(term)} ({type(term).__name__}) cannot be saved",
        where=where(),
        remedy="use numbers, strings, tuples, atoms and literals in beliefs and goals",
    )


# Restoring


@contextlib.contextmanager
def _collector_paused() -> Iterator[None]:
    """Pause the collection of garbage, which would look through all restored data again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def read(path: str | PathLike[str]) -> dict[str, Any]:
    """Read a file of `write`. Raises MindError for other or damaged files."""
    try:
        with _collector_paused():
            data = json.loads(read_bytes(path))
        _check(data)
    except OSError as problem:
        what = f"cannot read: {problem.strerror or problem}"
        raise MindError(what, where=str(path), remedy="give a saved mind") from problem
    except MindError as problem:
        raise MindError(problem.what, where=str(path), remedy=problem.remedy) from problem
    except (ValueError, RecursionError) as problem:
        raise MindError("the file is not a saved mind, or damaged", where=str(path)) from problem
    return data


def restore(engine: Engine, data: dict[str, Any]) -> None:
    """Replace the mind of an agent by a saved one. Call it in the engine's thread, after adding the plans.

    The current beliefs and intentions are removed. Watchers receive all removed beliefs, then all restored ones.
    Overdue timers run at once. Raises MindError for damaged data, without any change.
    """
    with _collector_paused():
        _restore(engine, _decode_mind(engine, data))


def _restore(engine: Engine, mind: _Mind) -> None:
    beliefs = engine.beliefs
    gone = [(relation, args) for relation in beliefs.relations.values() if relation.watchers for args in relation.facts]
    _clear(engine)
    for relation, args in gone:
        beliefs.notify(relation, args, False, "")
    engine.interpreter.stage = mind.stage
    engine.interpreter.random = mind.random
    engine.trace.numbers = itertools.count(max(mind.records, _next_record(engine)))
    relation: Any = None
    for key, args, fact in mind.beliefs:
        if relation is None or relation.key != key:
            relation = beliefs.relation(key)
        relation.facts[args] = fact
        if relation.indexes:
            relation.enter(args)
        if relation.watchers:
            beliefs.notify(relation, args, True, fact[2])
    _set_hold_timers(engine, mind)
    for key, plan_id, suspended, event in mind.pursuits:
        _pursue(engine, key, plan_id, suspended, event)


def _clear(engine: Engine) -> None:
    """Remove the mind, but keep other posted calls for the engine's thread, such as the start of a sensor."""
    for intention in engine.intentions:
        engine.intentions.drop(intention)
    inbox = engine.interpreter.inbox
    for item in list(inbox):
        if isinstance(item, tuple) or getattr(item, "mental", False):
            inbox.remove(item)
    engine.interpreter.events.clear()
    engine.timers.remove(lambda callback: isinstance(callback, HoldTimer))
    for relation in engine.beliefs.relations.values():
        relation.clear()


def _set_hold_timers(engine: Engine, mind: _Mind) -> None:
    """Start the saved ``held_for`` timers, and those of new plans."""
    plans: dict[tuple[str, str], CompiledPlan] = {}
    for plan in _held_plans(engine):
        key = plan.plan.event.literal.key
        plans.setdefault((key, _plan_id(plan)), plan)
        if _plan_id(plan) not in mind.held_plans:
            relation = engine.beliefs.relation(key)
            for args in relation.facts:
                engine.beliefs.set_hold_timer(relation, args, plan)
    for key, plan_id, args, due, seconds in mind.timers:
        plan = plans.get((key, plan_id))
        relation = engine.beliefs.relation(key)
        if plan is None or args not in relation.facts:
            log().warning("%s: the plan %s or its belief %s is missing", engine.name, plan_id, key)
        else:
            engine.beliefs.start_hold_timer(relation, args, plan, due, seconds)


def _pursue(
    engine: Engine, key: str, plan_id: str | None, suspended: bool, event: tuple[Args, Annotations, str]
) -> None:
    trigger = engine.library.triggers[key]
    if plan_id is not None:
        plan = next((plan for plan in trigger.plans if _plan_id(plan) == plan_id), None)
        if plan is None:
            log().warning("%s: the plan %s is missing", engine.name, plan_id)
            return
        trigger = Trigger(key, (plan,))
    if trigger.goal and suspended:
        engine.intentions.adopt_suspended(subgoal(trigger, *event))
    elif trigger.goal or trigger.plans:
        engine.interpreter.events.append((trigger, *event))


def _check(data: Any) -> None:
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise MindError("this is not a saved mind", remedy="give a file that was written by saving a mind")
    if data.get("version") != VERSION:
        raise MindError(
            f"version {data.get('version')!r} of a saved mind is not supported (supported: {VERSION})",
            remedy="use the version of socialbot that wrote it",
        )


def _decode_mind(engine: Engine, data: Any) -> _Mind:
    """Decode and check all data before any change."""
    _check(data)
    kinds = {**engine.library.goals, **engine.library.kinds}
    try:
        match data:
            case {
                "time": int(time),
                "stage": str() | None as stage,
                "records": int(records),
                "held_plans": list(plans),
            }:
                ahead = max(0, time - engine.clock.now())
            case _:
                raise ValueError("the time, stage, record number or plans are missing or of a wrong type")
        if not all(isinstance(plan, str) for plan in plans):
            raise ValueError("a plan is not a text")
        return _Mind(
            stage,
            _decode_random(data["random"]),
            records,
            _decode_beliefs(data["beliefs"], kinds, ahead),
            [_decode_event(item, kinds) for item in data["pursuits"]],
            plans,
            [_decode_timer(item, kinds, ahead) for item in data["ripening"]],
        )
    except (KeyError, TypeError, ValueError, RecursionError, OverflowError) as problem:
        what = f"the saved mind is damaged ({type(problem).__name__}: {problem})"
        raise MindError(what, remedy="restore an older one") from problem


def _decode_random(state: Any) -> random.Random | None:
    if state is None:
        return None
    version, numbers, gauss = state
    decoded = JavaRandom() if version == JAVA else random.Random()
    decoded.setstate((version, tuple(numbers), gauss))
    return decoded


def _decode_beliefs(items: Any, kinds: Kinds, ahead: int) -> list[tuple[str, Args, Fact]]:
    found: list[tuple[str, Args, Fact]] = []
    keys: dict[tuple[str, int], str] = {}
    sources: dict[str, Annotations] = {}
    before: Any = None
    annotations: Annotations = ()
    parts = operator.itemgetter("belief", "args", "annotations", "since", "cause")
    for item in items:
        name, args, notes, since, cause = parts(item)
        if name.__class__ is not str or args.__class__ is not list or type(since) is not int or type(cause) is not str:
            raise ValueError(f"{item!r} is not a belief")
        terms = tuple(args) if _JSON.issuperset(map(type, args)) else _decode(args, kinds)
        key = keys.get((name, len(terms))) or keys.setdefault((name, len(terms)), f"{name}/{len(terms)}")
        if notes != before:
            annotations, before = _decode_source(notes, kinds, sources) or _decode(notes, kinds), notes
        found.append((key, terms, (since - ahead, annotations, cause)))
    return found


def _decode_source(notes: Any, kinds: Kinds, sources: dict[str, Annotations]) -> Annotations | None:
    """Shared annotations of a belief whose only annotation is its source, an atom; None for others."""
    try:
        (note,) = notes
        ((_, name),) = note["args"][0].items()
        known = sources.get(name)
        if known is None:
            known = _decode(notes, kinds)
            if known == source_notes(name):
                sources[name] = known
        elif note != {"functor": "source", "args": [{"atom": name}], "annotations": [], "negated": False}:
            return None
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        return None
    return known


def _decode_event(item: Any, kinds: Kinds) -> tuple[str, str | None, bool, tuple[Args, Annotations, str]]:
    variables: dict[str, Var] = {}
    match item:
        case {"event": str(key), "args": args, "annotations": notes, "cause": str(cause)}:
            terms, plan = _decode(args, kinds, variables), item.get("plan")
            if key.startswith(("+", "-", HELD)) and key.endswith(f"/{len(terms)}") and isinstance(plan, str | None):
                event = (terms, _decode(notes, kinds, variables), cause)
                return key, plan, item.get("suspended") is True, event
    raise ValueError(f"{item!r} is not an event")


def _decode_timer(item: Any, kinds: Kinds, ahead: int) -> tuple[str, str, Args, int, float]:
    match item:
        case {"belief": str(key), "plan": str(plan), "args": args, "due": int(due), "seconds": float() | int() as span}:
            return key, plan, _decode(args, kinds), due - ahead, span
    raise ValueError(f"{item!r} is not a timer")


def _decode(items: Any, kinds: Kinds, variables: dict[str, Var] | None = None) -> Args:
    """Terms of a list of JSON data."""
    if not isinstance(items, list):
        raise ValueError(f"{items!r} is not a list of terms")
    return tuple([_decode_term(item, kinds, variables) for item in items])


def _decode_term(item: Any, kinds: Kinds, variables: dict[str, Var] | None) -> Any:
    match item:
        case None | str() | int() | float():
            return item
        case {"list": list(terms)}:
            return _decode(terms, kinds, variables)
        case {"atom": str(name)}:
            return Atom(name)
        case {"variable": str(name)} if variables is not None:
            return variables.setdefault(name, Var(name.partition("#")[0]))
        case {"functor": str(name), "args": list(args), "annotations": list(notes), "negated": bool(negated)}:
            terms, annotations = _decode(args, kinds, variables), _decode(notes, kinds, variables)
            kind = kinds.get(name)
            if kind is None or negated:
                return literal(name, terms, annotations, negated=negated)
            return kind(*terms).with_(annotations=annotations) if annotations else kind(*terms)
    raise ValueError(f"{item!r} is not a term")
