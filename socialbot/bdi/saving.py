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
import itertools
import json
import os
import random
import tempfile
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socialbot.bdi._explain import later_request
from socialbot.bdi.belief_base import HoldTimer, Relation
from socialbot.bdi.intentions import EVENT, OPEN, SUBGOAL, Intention, Request
from socialbot.bdi.library import CompiledPlan, Trigger
from socialbot.bdi.literals import Literal, literal
from socialbot.bdi.terms import Atom, show
from socialbot.bdi.trace import log
from socialbot.bdi.unification import Var, closed, resolve
from socialbot.core.errors import SocialbotError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine

SCHEMA, VERSION = "socialbot/mind", 1

HELD = "held "
"""Key prefix of ``held_for`` events."""


class MindError(SocialbotError):
    """Error while saving or restoring a mind."""

    exit_code = 3


# Saving


def save(engine: Engine) -> dict[str, Any]:
    """Return the mind of an agent as JSON data. Call it in the engine's thread (see `Engine.call`).

    Posted items and due timers are processed first. Raises MindError for a belief or goal with a value other than
    numbers, strings, lists, atoms and literals.
    """
    engine.interpreter.take_in()
    engine.timers.run_due()
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "name": engine.name,
        "time": engine.clock.now(),
        "stage": engine.interpreter.stage,
        "random": _random_state(engine),
        "records": _next_record(engine),
        "beliefs": [
            _belief(relation, args) for relation in list(engine.beliefs.relations.values()) for args in relation.facts
        ],
        "pursuits": [
            _pursuit(request, suspended=intention.suspended)
            for intention in engine.intentions
            if (request := _request_of(intention)) is not None
        ]
        + [_pursuit((EVENT, *event)) for event in engine.interpreter.events],
        "held_plans": sorted({_plan_id(plan) for plan in _held_plans(engine)}),
        "ripening": _hold_timers(engine),
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
    """Make a rename durable against power failures."""
    with contextlib.suppress(OSError):  # unsupported on some systems
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _random_state(engine: Engine) -> list[Any] | None:
    if engine.interpreter.random is None:
        return None  # not used yet
    version, numbers, gauss = engine.interpreter.random.getstate()
    return [version, list(numbers), gauss]


def _next_record(engine: Engine) -> int:
    return int(engine.trace.numbers.__reduce__()[1][0])  # reads the counter without advancing it


def _belief(relation: Relation, args: tuple[Any, ...]) -> dict[str, Any]:
    since, notes, cause = relation.facts[args]
    where = f"belief {relation.literal(args)}"
    return {
        "belief": relation.key.rpartition("/")[0],
        "args": [_encode(arg, where) for arg in args],
        "annotations": [_encode(note, where) for note in notes],
        "since": since,
        "cause": str(cause),
    }


def _request_of(intention: Intention) -> Request | None:
    """Outermost pursued goal of an intention, or its event; None for a branch."""
    if intention.event is None or not intention.frames:
        return intention.event
    body, goal, _ = intention.frames[0]
    if goal is not None:
        return goal
    return (later_request(body) if body is not None else None) or intention.event


def _pursuit(request: Request, *, suspended: bool = False) -> dict[str, Any]:
    _, trigger, args, notes, cause = request
    where = f"{'goal' if trigger.goal else 'event'} {trigger.key.rpartition('/')[0]}"
    variables: dict[int, str] = {}
    saved: dict[str, Any] = {
        "event": trigger.key,
        "args": [_encode(arg, where, variables) for arg in resolve(args)],
        "annotations": [_encode(note, where, variables) for note in resolve(notes)],
        "cause": str(cause),
    }
    if suspended:
        saved["suspended"] = True
    if trigger.key.startswith(HELD) and trigger.plans:
        saved["plan"] = _plan_id(trigger.plans[0])
    return saved


def _held_plans(engine: Engine) -> list[CompiledPlan]:
    return [
        plan for key, trigger in list(engine.library.triggers.items()) if key.startswith(HELD) for plan in trigger.plans
    ]


def _plan_id(plan: CompiledPlan) -> str:
    return plan.plan.label or str(plan.plan)


def _hold_timers(engine: Engine) -> list[dict[str, Any]]:
    found = []
    for due, _, timer in sorted(engine.timers.heap, key=lambda timer: timer[:2]):
        if isinstance(timer, HoldTimer) and not timer.over():
            where = f"belief {timer.relation.literal(timer.args)}"
            found.append(
                {
                    "belief": timer.relation.key,
                    "args": [_encode(arg, where) for arg in timer.args],
                    "plan": _plan_id(timer.plan),
                    "due": due,
                    "seconds": float(timer.seconds),
                }
            )
    return found


def _encode(term: Any, where: str, variables: dict[int, str] | None = None) -> Any:
    if term is None or type(term) in (str, int, float, bool):
        return term
    if type(term) is tuple:
        return {"list": [_encode(item, where, variables) for item in term]}
    if isinstance(term, Atom):
        return {"atom": term.name}
    if isinstance(term, Var) and variables is not None:
        return {"variable": variables.setdefault(id(term), f"{term.name}#{len(variables)}")}
    if isinstance(term, Literal):
        return {
            "functor": term.functor,
            "args": [_encode(arg, where, variables) for arg in term.args],
            "annotations": [_encode(note, where, variables) for note in term.annotations],
            "negated": term.negated,
        }
    raise MindError(
        f"{show(term)} ({type(term).__name__}) cannot be saved",
        where=where,
        remedy="use numbers, strings, tuples, atoms and literals in what the agent is to remember",
    )


# Restoring


@dataclass(frozen=True)
class _Fact:
    key: str
    args: tuple[Any, ...]
    notes: tuple[Any, ...]
    since: int
    cause: str


@dataclass(frozen=True)
class _Pursuit:
    key: str
    args: tuple[Any, ...]
    notes: tuple[Any, ...]
    cause: str
    plan: str | None
    suspended: bool


@dataclass(frozen=True)
class _HoldTimer:
    key: str
    args: tuple[Any, ...]
    plan: str
    due: int
    seconds: float


@dataclass(frozen=True)
class _Mind:
    stage: str | None
    random: random.Random | None
    records: int
    facts: list[_Fact]
    pursuits: list[_Pursuit]
    held_plans: set[str]
    hold_timers: list[_HoldTimer]


def read(path: str | PathLike[str]) -> dict[str, Any]:
    """Read a file of `write`. Raises MindError for other or damaged files."""
    try:
        data = json.loads(Path(path).read_text("utf-8"))
        _check(data)
    except OSError as problem:
        raise MindError(f"cannot read: {problem.strerror or problem}", where=str(path)) from problem
    except MindError as problem:
        raise MindError(problem.what, where=str(path), remedy=problem.remedy) from problem
    except (ValueError, RecursionError) as problem:
        raise MindError("this is no saved mind, or it is damaged", where=str(path)) from problem
    return data


def restore(engine: Engine, data: dict[str, Any]) -> None:
    """Replace the mind of an agent by a saved one. Call it in the engine's thread, after adding the plans.

    The current beliefs and intentions are removed. Watchers receive all removed beliefs, then all restored ones.
    Overdue timers run at once. Raises MindError for damaged data, without any change.
    """
    mind, beliefs = _decode_mind(engine, data), engine.beliefs
    gone = [(relation, args) for relation in beliefs.relations.values() if relation.watchers for args in relation.facts]
    _clear(engine)
    for relation, args in gone:
        beliefs.notify(relation, args, False, "")
    engine.interpreter.stage = mind.stage
    engine.interpreter.random = mind.random
    engine.trace.numbers = itertools.count(max(mind.records, _next_record(engine)))
    for fact in mind.facts:
        relation = beliefs.relation(fact.key)
        held = relation.facts[fact.args] = (fact.since, fact.notes, fact.cause)
        if relation.indexes:
            relation.enter(fact.args)
        if relation.held is not None:
            relation.begin(fact.args, held)
        beliefs.notify(relation, fact.args, True, fact.cause)
    _set_hold_timers(engine, mind)
    for pursuit in mind.pursuits:
        _pursue(engine, pursuit)


def _clear(engine: Engine) -> None:
    """Remove the mind, but keep other posted calls for the engine's thread, such as the start of a sensor."""
    for intention in engine.intentions:
        engine.intentions.drop(intention)
    inbox = engine.interpreter.inbox
    for item in list(inbox):
        if isinstance(item, tuple) or getattr(item, "mental", False):
            inbox.remove(item)
    engine.interpreter.events.clear()
    engine.timers.remove(
        lambda timer: isinstance(timer, HoldTimer) or ((over := getattr(timer, "over", None)) is not None and over())
    )
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
    for item in mind.hold_timers:
        plan = plans.get((item.key, item.plan))
        relation = engine.beliefs.relation(item.key)
        fact = relation.first_facts.get(item.args)
        if plan is None or fact is None:
            log().warning("%s: the plan %s or its belief %s is missing", engine.name, item.plan, item.key)
        else:
            timer = HoldTimer(engine.beliefs, relation, item.args, fact, plan, item.seconds)
            engine.timers.at(item.due, timer)


def _pursue(engine: Engine, pursuit: _Pursuit) -> None:
    trigger = engine.library.triggers[pursuit.key]
    if pursuit.plan is not None:
        plan = next((plan for plan in trigger.plans if _plan_id(plan) == pursuit.plan), None)
        if plan is None:
            log().warning("%s: the plan %s is missing", engine.name, pursuit.plan)
            return
        trigger = Trigger(pursuit.key, (plan,))
    if not trigger.goal:
        if trigger.plans:
            engine.interpreter.events.append((trigger, pursuit.args, pursuit.notes, pursuit.cause))
        return
    kind = SUBGOAL if closed(pursuit.args) else SUBGOAL | OPEN
    request = (kind, trigger, pursuit.args, pursuit.notes, pursuit.cause)
    if kind == SUBGOAL and not pursuit.suspended:
        engine.interpreter.events.append(request[1:])
    else:
        engine.intentions.adopt_later(request, suspended=pursuit.suspended)


# Decoding


def _check(data: Any) -> None:
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise MindError("this is no saved mind", remedy="give a file that was written by saving a mind")
    if data.get("version") != VERSION:
        raise MindError(
            f"this mind is of version {data.get('version')!r}, known is {VERSION}",
            remedy="use the socialbot it is from",
        )


def _decode_mind(engine: Engine, data: Any) -> _Mind:
    """Decode and check all data before any change."""
    _check(data)
    try:
        ahead = max(0, _typed(data["time"], int) - engine.clock.now())
        return _Mind(
            _typed(data["stage"], str, type(None)),
            _decode_random(data["random"]),
            _typed(data["records"], int),
            [_decode_fact(engine, item, ahead) for item in data["beliefs"]],
            [_decode_pursuit(engine, item) for item in data["pursuits"]],
            {_typed(plan, str) for plan in data["held_plans"]},
            [
                _HoldTimer(
                    _typed(item["belief"], str),
                    _terms(engine, item["args"]),
                    _typed(item["plan"], str),
                    _typed(item["due"], int) - ahead,
                    _typed(item["seconds"], float, int),
                )
                for item in data["ripening"]
            ],
        )
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, OverflowError) as problem:
        what = f"this mind is damaged ({type(problem).__name__}: {problem})"
        raise MindError(what, remedy="restore an older one") from problem


def _decode_random(state: Any) -> random.Random | None:
    if state is None:
        return None
    version, numbers, gauss = state
    numbers_to_come = random.Random()
    numbers_to_come.setstate((version, tuple(numbers), gauss))
    return numbers_to_come


def _decode_fact(engine: Engine, item: dict[str, Any], ahead: int) -> _Fact:
    args = _terms(engine, item["args"])
    key = f"{_typed(item['belief'], str)}/{len(args)}"
    since = _typed(item["since"], int) - ahead
    return _Fact(key, args, _terms(engine, item["annotations"]), since, _typed(item["cause"], str))


def _decode_pursuit(engine: Engine, item: dict[str, Any]) -> _Pursuit:
    key = _typed(item["event"], str)
    variables: dict[str, Var] = {}
    args = _terms(engine, item["args"], variables)
    if not key.startswith(("+", "-", HELD)) or key.rpartition("/")[2] != str(len(args)):
        raise ValueError(f"{key} is no event")
    notes = _terms(engine, item["annotations"], variables)
    plan = _typed(item.get("plan"), str, type(None))
    return _Pursuit(key, args, notes, _typed(item["cause"], str), plan, item.get("suspended") is True)


def _terms(engine: Engine, items: Any, variables: dict[str, Var] | None = None) -> tuple[Any, ...]:
    return tuple(_decode(engine, item, variables) for item in _typed(items, list))


def _decode(engine: Engine, item: Any, variables: dict[str, Var] | None) -> Any:
    if item is None or isinstance(item, (str, int, float)):
        return item
    if "list" in item:
        return _terms(engine, item["list"], variables)
    if "atom" in item:
        return Atom(_typed(item["atom"], str))
    if "variable" in item and variables is not None:
        name = _typed(item["variable"], str)
        return variables.setdefault(name, Var(name.partition("#")[0]))
    functor = _typed(item["functor"], str)
    args = _terms(engine, item["args"], variables)
    notes = _terms(engine, item["annotations"], variables)
    kind = engine.library.kinds.get(functor) or engine.library.goals.get(functor)
    if kind is None or item["negated"]:
        return literal(functor, args, notes, negated=bool(item["negated"]))
    made = kind(*args)
    return made.with_(annotations=notes) if notes else made


def _typed(value: Any, *kinds: type) -> Any:
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise TypeError(f"{value!r} is no {kinds[0].__name__}")
    return value


__all__ = ["SCHEMA", "VERSION", "MindError", "read", "restore", "save", "write", "write_data"]
