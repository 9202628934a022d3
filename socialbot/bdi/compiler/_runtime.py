"""Runtime library of generated code: its global names, and the operations of plan steps.

Generated functions receive the interpreter as ``ag`` and use `NAMES` beside it. They read ``ag.stage``,
``ag.relations``, ``ag.triggers``, ``ag.ready``, ``ag.events``, ``ag.others``, ``ag.inbox`` and ``ag.trace.sink``, set
``ag.begun``, and call public methods of ``ag``, ``ag.beliefs``, ``ag.intentions`` and ``ag.messaging``. Actions receive
``ag.engine``.
"""

from __future__ import annotations

import inspect
import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from socialbot.bdi._explain import failure_of, matched, plans_after, reasons_against
from socialbot.bdi._inner_plans import ScopePause
from socialbot.bdi._open_beliefs import add_belief, remove_belief
from socialbot.bdi.compiler._dynamic import (
    change_rule,
    literal_with,
    pause_until,
    plan_of,
    plan_parts,
    run_value,
    solutions_of,
    spread,
    steps_of,
    substituted,
    template,
)
from socialbot.bdi.intentions import (
    DONE,
    OPEN,
    SUBGOAL,
    ConditionPause,
    EventPause,
    Failed,
    ForkPause,
    Pause,
    Request,
    SpecialBody,
    TimedRequest,
    mode_of,
    timed,
)
from socialbot.bdi.literals import SELF, Change, Event, KnownSource, Literal, distinct, is_source, literal, source_notes
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.stdlib.actions import DIRECT, call, registered
from socialbot.bdi.stdlib.registry import Collection, detached, is_number, literal_of
from socialbot.bdi.steps import Action, PlanBody
from socialbot.bdi.terms import Atom, Condition, Cons, LiteralVariable, Name, Rest, by_order, order, show
from socialbot.bdi.unification import SIMPLE, Trail, Var, annotations_match, closed, cons, resolve, same, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.library import CompiledPlan, Trigger
    from socialbot.bdi.stdlib.registry import Internal

Args = tuple[Any, ...]


# Functions of AgentSpeak


def _length(engine: Any, items: Any) -> int:
    if not isinstance(items, (tuple, str, Collection)):
        raise Failed("wrong_arguments", f".length expects a list or a string, not {items}")
    return len(items)


def _checked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a numeric function to fail for arguments outside its domain."""

    def compute(engine: Any, *args: Any) -> Any:
        try:
            return function(*args)
        except (TypeError, ValueError, ArithmeticError) as problem:
            shown = ", ".join(map(str, args))
            raise Failed("wrong_arguments", f"{name}({shown}): {problem}") from problem

    return compute


def _average(numbers: Any) -> float:
    return sum(numbers) / len(numbers)


def _deviation(numbers: Any) -> float:
    mean = _average(numbers)
    return math.sqrt(sum((number - mean) ** 2 for number in numbers) / (len(numbers) - 1))


_NUMBERS = frozenset({int, float})


def _numbers(function: Callable[..., Any]) -> Callable[..., Any]:
    """Apply a function to the numbers of a list, or to two numbers."""

    def compute(*args: Any) -> Any:
        if len(args) == 1 and isinstance(args[0], tuple):
            plain = _NUMBERS.issuperset(map(type, args[0]))
            return function(args[0] if plain else [item for item in args[0] if is_number(item)])
        if len(args) != 2 or function not in (max, min):
            raise TypeError("a list of numbers is required")
        return function(args)

    return compute


_STATISTICS = {
    "max": max, "min": min, "sum": sum, "average": _average, "mean": _average, "median": statistics.median,
    "std_dev": _deviation,
}  # fmt: skip
_MATH = ("floor", "ceil", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "log", "exp")

FUNCTIONS: dict[str, Callable[..., Any]] = {
    ".length": _length,
    "math.random": lambda engine, most=1: engine.random.random() * most,
    "system.time": lambda engine: engine.clock.now() // 1_000_000,  # ms
    **{f"math.{name}": _checked(f"math.{name}", _numbers(function)) for name, function in _STATISTICS.items()},
    **{f"math.{name}": _checked(f"math.{name}", getattr(math, name)) for name in _MATH},
    "math.abs": _checked("math.abs", abs),
    "math.round": _checked("math.round", lambda x: math.floor(x + 0.5)),
    "math.pi": _checked("math.pi", lambda: math.pi),
    "math.e": _checked("math.e", lambda: math.e),
}
"""AgentSpeak functions by name; the engine is their first argument."""


# Terms


def known(term: Any) -> Any:
    """Return the value of a term. Raises Failed for an unbound variable."""
    if term.__class__ is Var:
        term = term.value
    if term.__class__ in SIMPLE:
        return term
    value = resolve(term)
    if not closed(value):
        raise Failed("no_value", f"{value!s} has no value")
    return value


def told_by(name: Any) -> Args:
    """Return the annotation ``source(Name)`` of AgentSpeak, in which a string differs from an atom."""
    return source_notes(name) if name.__class__ is Atom else (literal("source", (name,)),)


def first_source(notes: Args) -> Literal | None:
    """Return the first annotation ``source(S)`` in the order of terms."""
    return next((note for note in by_order(notes) if isinstance(note, Literal) and note.key == "source/1"), None)


def plain(term: Any) -> Any:
    """Return the value of a term, a `Name` instead of an atom."""
    term = resolve(term)
    return Name(term.name) if term.__class__ is Atom else term


_FAILS = object()


def aggregate(kind: str, values: Any, nothing: Any = _FAILS) -> Any:
    """Return the value of an aggregate; ``values`` are those that it is about, or their number for ``count``.

    Raises:
        Failed: There are no values for an extreme, unless ``nothing`` is given.
    """
    if kind == "count":
        return values
    found = tuple(values)
    if kind == "findall":
        return found
    if kind == "sum_of":
        return sum(found)
    if not found and nothing is _FAILS:
        raise Failed("no_value", f"{kind} has no solution")
    return (min if kind == "min_of" else max)(found, key=order) if found else nothing


def renew(cell: Any) -> Any:
    """Replace an unbound variable by a new one; return other terms unchanged."""
    cell = resolve(cell)
    return Var(cell.name) if cell.__class__ is Var else cell


def holds(solutions: Iterator[Any], trail: Trail) -> bool:
    """Check for a solution and undo its bindings."""
    mark = len(trail)
    found = next(solutions, None) is not None
    undo(trail, mark)
    return found


def joined(result: Any, expression: str) -> Any:
    """Return the result of an expression with ``+``. Raises Failed for a list."""
    if isinstance(result, tuple):
        raise _no_numbers(expression)
    return result


def product(left: Any, right: Any, expression: str) -> Any:
    """Return the product of two numbers. Raises Failed for a list or string, which Python would repeat."""
    if isinstance(left, (tuple, str)) or isinstance(right, (tuple, str)):
        raise _no_numbers(expression)
    return left * right


def _no_numbers(expression: str) -> Failed:
    return Failed("wrong_arguments", f"{expression} needs numbers; join lists and strings with .concat")


def div(left: Any, right: Any) -> int:
    """Divide integers, rounding towards zero."""
    quotient = abs(math.trunc(left)) // abs(math.trunc(right))
    return quotient if (left >= 0) == (right >= 0) else -quotient


def mod(left: Any, right: Any) -> Any:
    """Return the remainder, with the sign of the dividend."""
    rest = math.fmod(left, right)
    return int(rest) if rest.is_integer() else rest


_MOST_BITS = 1 << 20
"""Longest power of whole numbers: 300,000 digits take milliseconds; 9 ** 9 ** 9 ** 9 has no end."""


def power(left: Any, right: Any) -> Any:
    """Return ``left`` to the power of ``right``. Raises Failed if that is complex or too long."""
    whole = isinstance(left, int) and isinstance(right, int)
    if whole and abs(left) > 1 and right * left.bit_length() > _MOST_BITS:
        raise Failed("wrong_arguments", f"a power of more than {_MOST_BITS} bits")
    result = left**right
    if result.__class__ is complex:
        raise Failed("wrong_arguments", f"{left} ** {right} is no real number")
    return result


def univ(term: Any, parts: Any, trail: Trail) -> bool:
    """Unify ``term =.. [namespace, name, [args], [annotations]]``, or a plan with ``[label, event, condition, body]``.

    The namespace, or the label, may be left out. Steps are taken apart as their first one: ``achieve``, ``action``.
    """
    term, parts = resolve(term), resolve(parts)
    size = len(parts) if parts.__class__ is tuple else 0
    if isinstance(term, Plan):
        return unify(parts, plan_parts(term)[1 if size == 3 else 0 :], trail)
    term = _structure(term)
    if isinstance(term, Literal):
        sign, notes = "~" if term.negated else "", tuple(by_order(term.annotations))
        if size == 3:
            return unify(parts, (Atom(sign + term.functor), term.args, notes), trail)
        namespace, _, name = term.functor.rpartition("::")
        return unify(parts, (Atom(namespace or "default"), Atom(sign + name), term.args, notes), trail)
    if term.__class__ is not Var:
        return False
    if size == 4 and isinstance(parts[1], Event):
        return unify(term, plan_of(*parts), trail)
    if size not in (3, 4) or any(part.__class__ is not Atom for part in parts[:-2]):
        raise Failed("no_value", f"{term} =.. {parts} has unbound variables on both sides")
    name = parts[-3].name
    prefix = f"{parts[0].name}::" if size == 4 and parts[0].name != "default" else ""
    made = literal(prefix + name.removeprefix("~"), *parts[-2:], negated=name.startswith("~"))
    return unify(term, made if made.args or made.annotations or made.negated else Atom(prefix + name), trail)


def _structure(term: Any) -> Any:
    """Return an atom, or steps, as a literal; other terms as they are."""
    if isinstance(term, Event) and term.change in (Change.ADDED, Change.REMOVED):
        term = steps_of(term)
    if isinstance(term, PlanBody):
        return term.as_structure()
    return literal(term.name) if isinstance(term, Atom) else term


def ordered(left: Any, symbol: str, right: Any) -> bool:
    """Compare terms of different types, by the order of terms."""
    one, two = order(left), order(right)
    return {"<": one < two, "<=": one <= two, ">": one > two, ">=": one >= two}[symbol]


# Actions


def record_action(ag: Interpreter, functor: str, args: Args, cause: Any) -> str:
    """Record an action in the trace; return the id of the record."""
    what = "" if ag.trace.sink is None else f"{functor}({', '.join(map(show, args))})"
    ag.action = ag.trace.record("action", what, cause)
    return ag.action


def perform(ag: Interpreter, kind: type[Action], args: Args, cause: Any) -> Any:
    """Execute an action of a class on a new instance, so that agents with a shared plan share no state."""
    action = kind(*args)
    action.engine = ag.engine
    action.id = record_action(ag, kind.functor, args, cause)
    if kind.threaded:
        from socialbot.bdi.durative_actions import ThreadRun

        return ThreadRun(action)  # type: ignore[arg-type]
    return action.execute(*args)


def act(ag: Interpreter, name: str, args: Args, cause: Any, plain: bool = False) -> Any:
    action = ag.engine.actions.get(name) or _world_action(ag, name) or registered(name)
    if action is None:
        raise Failed("action_failed", f"there is no action {name}/{len(args)}")
    if isinstance(action, type):
        if action.function is None:
            return perform(ag, action, known(args), cause)
        kind, action = action, action.function
        if action in DIRECT[len(args)]:
            DIRECT[len(args)][kind] = action
    if ag.trace.sink is not None:
        record_action(ag, name, resolve(args), cause)
    return call(ag.engine, name, action, args, plain=plain)


def _world_action(ag: Interpreter, name: str) -> Any:
    """Action of the environment of the society, if any."""
    society = ag.messaging.society
    return None if society is None or society.environment is None else society.environment.action(name)


def outcome(ag: Interpreter, found: Any) -> Pause | None:
    """Convert the result of an action to a pause; False raises a failure, and other results are ignored."""
    if isinstance(found, Pause):
        return found
    if inspect.iscoroutine(found):
        from socialbot.bdi.durative_actions import CoroutineRun

        return CoroutineRun(found, ag.action)
    if found is False or (type(found).__name__ in ("bool", "bool_") and not found):  # also that of numpy
        raise Failed("action_failed", "the action returned False")
    return None


def internal(ag: Interpreter, entry: Internal, name: str, args: Args, cause: Any) -> Pause | None:
    trail: Trail = []
    if ag.trace.sink is not None:
        record_action(ag, name, tuple(map(resolve, args)), cause)
    ag.cause = cause
    found = entry.function(ag.engine, args, trail)
    if entry.many:
        found = next(found, "none") != "none"
    if found is False:
        raise Failed("ia_failed", f"{name} failed")
    return found if isinstance(found, Pause) else None


def limited(pause: Pause | None, seconds: float) -> Pause | None:
    """Limit a pause to ``seconds``, after which it fails."""
    if pause is None:
        return None
    begin, pause.plain = pause.begin, False

    def begin_limited(interpreter: Interpreter, intention: Any) -> None:
        begin(interpreter, intention)
        pause.limit(seconds, Failed("timeout", f"it took longer than {seconds} s"))

    pause.begin = begin_limited  # type: ignore[method-assign]
    return pause


def await_condition(
    solve: Callable[[], Any], found: list[Any], limit_s: float | None, beliefs: Any, cells: Args
) -> Pause | None:
    """Pause until a condition holds; return None if it already does. See `ConditionPause`."""
    solution = solve()
    if solution is not None:
        found.append(solution)
        return None
    return ConditionPause(solve, found, limit_s, beliefs, cells)


# Goals


def open_goal(ag: Interpreter, kind: int, trigger: Trigger, args: Args, notes: Args, cause: Any) -> Request:
    """Request a goal whose arguments and annotations may be unbound."""
    args = resolve(args)
    if not closed(notes):
        return (kind | OPEN, trigger, args, notes, cause)
    free = []
    for arg in args:
        free.append(arg.__class__ is Var)
        if arg.__class__ not in SIMPLE and arg.__class__ is not Var and not closed(arg):
            return (kind | OPEN, trigger, args, notes, cause)
    return (kind | mode_of(free), trigger, args, notes, cause)


def computed_by_rule(ag: Interpreter, key: str, args: Args) -> Any:
    """Return the value of a registered function: the last argument of the first solution of its rule."""
    result = Var("Result")
    for _ in ag.solve(key, (*args, result), (), []):
        return known(result)
    raise Failed("wrong_arguments", f"the rule {key} gives no value for {', '.join(map(show, args))}")


def goal_of(ag: Interpreter, goal: Any, cause: Any) -> Request:
    """Request a goal that is the value of a variable."""
    goal = literal_of("!", goal)
    return open_goal(ag, SUBGOAL, ag.triggers[f"+!{goal.key}"], goal.args, goal.annotations or SELF, cause)


def adopt_later(ag: Interpreter, request: Request) -> None:
    """Adopt ``!!g`` in a separate intention."""
    if ag.intentions.goal_states is not None:
        request = ag.intentions.goal_states.announced(request)
    _, trigger, args, notes, cause = request
    ag.events.append((trigger, detached(args), notes, cause))


def question(ag: Interpreter, trigger: Trigger, args: Args, notes: Args, cause: Any) -> Request:
    if not trigger.plans:
        raise Failed("test_goal_failed", f"nothing answers {trigger.key[1:].rpartition('/')[0]}")
    return open_goal(ag, SUBGOAL, trigger, args, notes, cause)


def question_of(ag: Interpreter, query: Any, cause: Any) -> Request | None:
    """Evaluate ``?Q``: return None if a belief matches, otherwise the request for a plan."""
    query = resolve(query)
    if isinstance(query, Condition) and not isinstance(query, Literal):
        for _ in solutions_of(ag, query, []):
            return None
        raise Failed("test_goal_failed", f"nothing answers {query}")
    query = literal_of("?", query)
    for _ in ag.solve(query.key, query.args, query.annotations, []):
        return None
    return question(ag, ag.triggers[f"+?{query.key}"], query.args, SELF, cause)


# Beliefs, the trace


def update_of(ag: Interpreter, sign: str, belief: Any, cause: Any) -> Any:
    """Apply ``+B``, ``-B`` or another update to the value of a variable."""
    belief = resolve(belief)
    if isinstance(belief, Inference):
        return change_rule(ag, sign, belief)
    belief = literal_of(sign, belief)
    notes = belief.annotations
    if not any(map(is_source, notes)):
        notes = (*notes, *SELF)
    if sign in ("-", "--"):
        return remove_belief(ag, belief.key, belief.args, notes, cause, sign == "-")
    return add_belief(ag, sign, belief.key, belief.args, notes, cause)


def chosen(ag: Interpreter, plan: CompiledPlan, args: Args, notes: Args, cause: Any, values: Mapping[str, Any]) -> str:
    """Record the selection of a plan: its place, what its condition matched, and the other plans for the event."""
    text, event = plan.shown()
    detail: dict[str, object] = {"rule": text}
    if plan.plan.label:
        detail["label"] = plan.plan.label
    if plan.plan.origin is not None:
        detail["where"] = str(plan.plan.origin)
    if plan.plan.condition.terms:
        detail["matched"] = matched(ag, plan.plan, values)
    trigger = ag.triggers[plan.plan.event.key]
    if closed(args) and len(trigger.plans) > 1:
        rejected = reasons_against(ag, trigger, args, notes, plan)
        if rejected:
            detail["rejected"] = rejected
        later = plans_after(trigger, args, plan)
        if later:
            detail["later"] = later
    return ag.trace.record("plan", event, cause, **detail)


_SHARED: tuple[Any, ...] = (
    Cons, Event, EventPause, Failed, ForkPause, KnownSource, Literal, LiteralVariable, Rest, ScopePause,
    SpecialBody, TimedRequest, Var, act, add_belief, adopt_later, aggregate, annotations_match, await_condition,
    by_order, change_rule, chosen, closed, computed_by_rule, cons, distinct, div, failure_of, first_source,
    goal_of, holds, internal, joined, known, limited, literal, literal_with, mod, open_goal, order, ordered,
    outcome, pause_until, perform, plain, power, product, question, question_of, record_action, remove_belief,
    renew, resolve, run_value, same, solutions_of, source_notes, spread, substituted, template, timed, told_by,
    undo, unify, univ, update_of,
)  # fmt: skip
NAMES: dict[str, Any] = {
    "ANY": Var(),
    "DONE": DONE,
    "ONCE": (None,),
    "SELF": SELF,
    **{each.__name__: each for each in _SHARED},
}
"""Global names of generated code."""
