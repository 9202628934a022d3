"""Run-time operations on values that stand for literals, conditions, steps or plans."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import NoneType
from typing import TYPE_CHECKING, Any

from socialbot.bdi._open_beliefs import any_belief
from socialbot.bdi.agentspeak.lexer import qualified
from socialbot.bdi.intentions import OPEN, SUBGOAL, EventPause, Failed
from socialbot.bdi.library import BODY, CompiledPlan, Trigger
from socialbot.bdi.literals import SELF, Change, Event, Literal, literal
from socialbot.bdi.plans import Inference, Plan, parts_of
from socialbot.bdi.stdlib import find
from socialbot.bdi.stdlib.registry import literal_of, name_of
from socialbot.bdi.steps import Achieve, Ask, Do, PlanBody, Step, Update
from socialbot.bdi.terms import (
    NOTHING,
    Atom,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Holds,
    LiteralVariable,
    Negation,
    Pattern,
    Rest,
    Variable,
    conjunction,
)
from socialbot.bdi.unification import Trail, Var, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter

COLLECTORS = frozenset({".findall", ".setof", ".count", ".eval"})
"""Internal actions with a condition as argument."""

_EMBEDDED = (Plan, PlanBody, Inference, Comparison, Conjunction, Disjunction, Negation)
"""Classes of terms that contain conditions or steps."""


def is_embedded(term: object) -> bool:
    """Check whether a term is a plan, steps, a rule or a condition, whose unbound variables are its own."""
    return isinstance(term, _EMBEDDED) or (isinstance(term, Literal) and term.functor in COLLECTORS)


def variables_of(item: object) -> dict[str, None]:
    """Return the names of the variables in a term, also in its plans and steps, in order and without ``_``."""
    if isinstance(item, Variable):
        return {} if item.name == "_" else {item.name: None}
    found: dict[str, None] = {}
    for part in parts_of(item):
        found |= variables_of(part)
    return found


def embeds(term: object) -> bool:
    """Check whether a term is or contains a plan, steps, a rule or a condition."""
    if is_embedded(term):
        return True
    if isinstance(term, Cons):
        return embeds(term.items)
    if isinstance(term, (tuple, Literal)):
        return any(map(embeds, term if isinstance(term, tuple) else term.args))
    return False


def substituted(item: Any, values: Mapping[str, Any]) -> Any:
    """Copy a plan, rule or body with the values of some variables."""

    def value_of(leaf: Any) -> Any:
        value = resolve(values.get(leaf.name, leaf)) if leaf.__class__ is not Var else leaf
        return leaf if value.__class__ is Var else value

    return _rewritten(item, value_of)


def _rewritten(item: Any, change: Callable[[Any], Any]) -> Any:
    """Copy a plan, rule or body with other terms in place of its variables and cells."""
    if isinstance(item, (Variable, Var)):
        return change(item)
    if isinstance(item, tuple):
        return tuple(_rewritten(part, change) for part in item)
    if not isinstance(item, (Pattern, Step, Plan, Inference)):
        return item
    if isinstance(item, LiteralVariable):
        variable, notes = _rewritten(item.variable, change), _rewritten(item.annotations, change)
        made = literal_with(variable, notes, item.negated, _rewritten(item.namespace, change))
        return item if isinstance(made, Inference) else made
    if isinstance(item, Cons):
        items, tail = _rewritten(item.items, change), _rewritten(item.tail, change)
        return (*items, *tail) if isinstance(tail, tuple) else Cons(items, tail)
    twin = copy.copy(item)
    twin.__dict__.pop("compiled", None)
    for name, part in vars(item).items():
        changed = _rewritten(part, change)
        if changed is not part:
            if isinstance(changed, Atom) and isinstance(item, (Do, Achieve, Update, Ask, Holds)):
                changed = literal(changed.name)
            object.__setattr__(twin, name, changed)  # plans are frozen
    if isinstance(twin, Holds) and isinstance(twin.what, Condition):
        return twin.what
    return twin


def shared(item: Any, cells: dict[str, Any]) -> Any:
    """Copy a part of a plan with cells, which its other parts share, for its variables."""
    return _rewritten(item, lambda leaf: cells.setdefault(leaf.name, Var()) if isinstance(leaf, Variable) else leaf)


def _parameterised(item: Any) -> tuple[Any, dict[str, Any]]:
    """Replace the cells without a value in steps or a condition by variables; return these with their cells."""
    names: dict[Any, Variable] = {}

    def variable_of(leaf: Any) -> Any:
        value = resolve(leaf)
        return names.setdefault(value, Variable(f"_Cell{len(names)}")) if value.__class__ is Var else value

    made = _rewritten(item, variable_of)
    return made, {variable.name: cell for cell, variable in names.items()}


def is_template(term: object) -> bool:
    """Check whether a plan or body has variables for whole parts, such as ``{ @L +!T : C <- B }`` and ``{ S; _ }``."""
    if isinstance(term, Plan):
        return isinstance(term.label, Variable) or isinstance(term.event.literal, Variable)
    return isinstance(term, PlanBody) and any(isinstance(step, Do) and _is_open(step.action) for step in term.steps)


def _is_open(part: object) -> bool:
    return part.__class__ is Variable or part.__class__ is Var


def template(item: Any, values: Mapping[str, Any]) -> Any:
    """Copy a plan, steps or a condition with values, and with cells for the variables that have none, for `unify`."""

    def value_of(leaf: Any) -> Any:
        return leaf if leaf.__class__ is Var else resolve(values.get(leaf.name, leaf))

    twin = _rewritten(item, value_of)
    if twin is item:
        twin = copy.copy(item)
    twin.__dict__["match"] = lambda pattern, other, trail: _Match(trail).terms(pattern, other)
    return twin


class _Match:
    """Unification of plans, steps and conditions that have cells with others, whose variables become cells."""

    def __init__(self, trail: Trail) -> None:
        self.trail = trail
        self.own: dict[str, Any] = {}

    def terms(self, pattern: Any, other: Any) -> bool:
        pattern = resolve(_named(pattern))
        if pattern.__class__ is Var or isinstance(pattern, LiteralVariable):
            return unify(pattern, shared(other, self.own), self.trail)
        if isinstance(pattern, Plan):
            return isinstance(other, Plan) and self._plans(pattern, other)
        if isinstance(pattern, PlanBody):
            return isinstance(other, PlanBody) and self._steps(pattern.steps, other.steps, bare=False)
        if isinstance(pattern, Holds):
            return self.terms(pattern.what, other)
        if isinstance(pattern, Conjunction) and len(pattern.terms) == 1:
            first = pattern.terms[0]
            single = isinstance(other, Conjunction) and len(other.terms) == 1 and not isinstance(first, Holds)
            return self.terms(first, other.terms[0] if single else other)
        if isinstance(pattern, Conjunction) and isinstance(other, Conjunction):
            return self._conjunctions(pattern.terms, other.terms)
        if isinstance(pattern, tuple) and isinstance(other, tuple):
            return len(pattern) == len(other) and all(map(self.terms, pattern, other))
        if isinstance(pattern, (Step, Condition)) and not isinstance(pattern, Literal):
            return pattern.__class__ is other.__class__ and all(
                self.terms(part, vars(other)[name]) for name, part in vars(pattern).items() if name not in _UNWRITTEN
            )
        return unify(pattern, shared(other, self.own), self.trail)

    def _plans(self, pattern: Plan, other: Plan) -> bool:
        return (
            pattern.event.change is other.event.change
            and (isinstance(pattern.label, (str, NoneType)) or self.terms(pattern.label, _label_of(other)))
            and (not isinstance(pattern.label, str) or pattern.label == other.label)
            and self.terms(pattern.event.literal, other.event.literal)
            and (not pattern.condition.terms or self.terms(pattern.condition, _condition_of(other)))
            and self._steps(pattern.body, other.body, bare=True)
        )

    def _conjunctions(self, pattern: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
        """Unify conditions in order; a variable as the last one is all remaining conditions."""
        if len(other) > len(pattern) and isinstance(pattern[-1], Holds) and _is_open(pattern[-1].what):
            other = (*other[: len(pattern) - 1], Conjunction(other[len(pattern) - 1 :]))
        return len(pattern) == len(other) and all(map(self.terms, pattern, other))

    def _steps(self, pattern: tuple[Any, ...], other: tuple[Any, ...], *, bare: bool) -> bool:
        """Unify steps in order; a variable as the last one is all remaining steps."""
        for i, step in enumerate(pattern):
            if isinstance(step, Do) and _is_open(step.action):
                if i == len(pattern) - 1:
                    return self.terms(step.action, PlanBody(other[i:], bare))
                if i >= len(other) or not self.terms(step.action, PlanBody(other[i : i + 1], bare=True)):
                    return False
            elif i >= len(other) or not self.terms(step, other[i]):
                return False
        return len(pattern) == len(other)


_UNWRITTEN = frozenset({"line", "compiled", "match"})
"""Attributes of steps and conditions that are no parts of their text."""


def plan_parts(plan: Plan) -> tuple[Any, ...]:
    """Return the label with annotations, event, condition and body of a plan as terms that share cells."""
    cells: dict[str, Any] = {}
    parts = plan.event, _condition_of(plan), PlanBody(plan.body, bare=True)
    return _label_of(plan), *(shared(part, cells) for part in parts)


def plan_of(label: Any, event: Event, condition: Any, body: Any) -> Plan:
    """Make a plan of its parts; the condition may be in braces. Raises Failed for parts of other kinds."""
    tested = condition.as_structure() if isinstance(condition, PlanBody) else None
    condition = condition if tested is None else tested.args[0]
    always = condition.__class__ is Atom and condition.name == "true"
    if not isinstance(body, PlanBody) or not (always or isinstance(condition, (Atom, Condition))):
        raise Failed("wrong_arguments", "a plan has a label, an event, a condition and steps: [l, {+!g}, true, { a }]")
    name = literal_of("a label", label)
    tests = condition if isinstance(condition, Condition) else literal_of("a condition", condition)
    known = NOTHING if always else conjunction(tests)
    return _parameterised(Plan(event, known, body.steps, name.functor, annotations=name.annotations))[0]


def _label_of(plan: Plan) -> Any:
    return plan.known.label if plan.known else literal(plan.label or "unlabelled", (), (*plan.annotations, *SELF))


def _condition_of(plan: Plan) -> Any:
    return plan.condition if plan.condition.terms else Atom("true")


def _named(term: Any) -> Any:
    """Copy a term with a cell for each ``_``."""
    if isinstance(term, Variable):
        return Var() if term.name == "_" else term
    if isinstance(term, tuple):
        return tuple(map(_named, term))
    if isinstance(term, Rest):
        return Rest(_named(term.tail))
    if isinstance(term, Cons):
        return Cons(_named(term.items), _named(term.tail))
    if isinstance(term, LiteralVariable):
        return LiteralVariable(_named(term.variable), _named(term.annotations), term.negated, term.namespace)
    if isinstance(term, Literal):
        return term.with_(args=_named(term.args), annotations=_named(term.annotations))
    return term


def literal_with(value: Any, notes: tuple[Any, ...], negated: bool, namespace: Any = None) -> Any:
    """Return the value of ``X[notes]``, ``~X`` or ``Namespace::X``; a `LiteralVariable` while a part has none."""
    value, namespace = resolve(value), resolve(namespace)
    if isinstance(value, (Var, Variable)) or isinstance(namespace, (Var, Variable)):
        return LiteralVariable(value, notes, negated, namespace)
    if isinstance(value, Inference):
        return replace(value, head=literal_with(value.head, notes, negated, namespace))
    item = literal_of("a literal with annotations", value)
    new = tuple(note for note in notes if note not in item.annotations)
    made = item.with_(annotations=item.annotations + new)
    if negated:
        made.negated = True
    if namespace is not None:
        name = name_of("a namespace", namespace)
        made.functor = qualified("" if name == "default" else name, made.functor.rpartition("::")[2], len(made.args))
    made.__dict__.pop("key", None)
    return made


def spread(notes: tuple[Any, ...]) -> tuple[Any, ...]:
    """Replace the remaining annotations at the end by their values, if known."""
    tail = resolve(notes[-1].tail)
    return (*notes[:-1], *tail) if tail.__class__ is tuple else notes


def solutions_of(ag: Interpreter, condition: Any, trail: Trail) -> Iterator[None]:
    """Yield the solutions of a condition that is a value."""
    condition = resolve(condition)
    if condition.__class__ is Atom and condition.name in ("true", "false"):
        if condition.name == "true":
            yield
        return
    if isinstance(condition, LiteralVariable) and isinstance(condition.variable, Literal):
        yield from _in_any_namespace(ag, condition, trail)
        return
    if condition.__class__ is Var or isinstance(condition, LiteralVariable):
        yield from (None for _ in any_belief(ag, condition, trail))
        return
    if isinstance(condition, Condition) and (not isinstance(condition, Literal) or condition.functor in COLLECTORS):
        from socialbot.bdi.compiler._plans import compile_query

        condition, cells = _parameterised(condition)
        names, solve = compile_query(conjunction(condition), ag.library, lenient=True)
        mark = len(trail)
        for values in solve(ag, trail):
            found = dict(zip(names, values, strict=True))
            if all(unify(cell, found[name], trail) for name, cell in cells.items() if name in found):
                yield
            undo(trail, mark)
        return
    item = literal_of("a condition", condition)
    entry = find(item.functor) if "." in item.functor else None
    if entry is None:
        yield from ag.solve(item.key, item.args, item.annotations, trail)
    elif entry.many:
        yield from entry.function(ag.engine, item.args, trail)
    elif entry.function(ag.engine, item.args, trail) is not False:
        yield


def _in_any_namespace(ag: Interpreter, pattern: LiteralVariable, trail: Trail) -> Iterator[None]:
    """Yield the solutions of a literal in each namespace that has beliefs of its name."""
    item: Any = pattern.variable
    mark = len(trail)
    for key in dict.fromkeys((*ag.beliefs.relations, *ag.library.inferences)):
        prefix, _, name = key.rpartition("::")
        if name == item.key.removeprefix("~") and unify(pattern.namespace, Atom(prefix or "default"), trail):
            yield from ag.solve(key, item.args, item.annotations, trail)
        undo(trail, mark)


def steps_of(event: Event) -> PlanBody:
    """Return the change of a belief, which is read as an event in braces, as a step."""
    return PlanBody((Update("+" if event.change is Change.ADDED else "-", event.literal),))


def run_value(ag: Interpreter, value: Any, cause: Any) -> Any:
    """Return the request for the steps, or the action, that is the value of a variable."""
    value = resolve(value)
    if value.__class__ is Var or isinstance(value, LiteralVariable):
        raise Failed("no_value", f"the action {value!s} has no value")
    if isinstance(value, Event) and value.change in (Change.ADDED, Change.REMOVED):
        value = steps_of(value)
    if not isinstance(value, PlanBody):
        other = isinstance(value, Condition) and not isinstance(value, Literal)
        action: Any = value if other else literal_of("an action", value)
        value = PlanBody((Do(action),))
    trigger, cells = _trigger(ag, value)
    return (SUBGOAL | OPEN if cells else SUBGOAL, trigger, cells, SELF, cause)


def _trigger(ag: Interpreter, body: PlanBody) -> tuple[Trigger, tuple[Any, ...]]:
    """Return the trigger of a plan with this body, and the cells of the body, which are its arguments."""
    known = body.__dict__.get("compiled")
    if known is not None and known[0] is ag.library:
        return known[1], ()
    made, cells = _parameterised(body)
    head = literal(BODY, tuple(map(Variable, cells)))
    plan = Plan(Event(Change.WANTED, head), NOTHING, made.steps, text=str(body))
    trigger = Trigger(f"+!{BODY}/{len(cells)}", (CompiledPlan(plan, ag.library),))
    if not cells:
        body.__dict__["compiled"] = (ag.library, trigger)
    return trigger, tuple(cells.values())


def pause_until(change: Change, value: Any, limit_s: float | None) -> EventPause:
    """Return the pause until an event whose literal is the value of a variable."""
    item = literal_of("an event", value)
    return EventPause(f"{change.value}{item.key}", item.args, item.annotations, limit_s)


def change_rule(ag: Interpreter, sign: str, rule: Inference) -> None:
    """Add a rule before the others, or remove an equal one, if there is one."""
    if sign == "+":
        ag.engine.add_rules(rule, first=True)
    else:
        ag.own_library().remove_inference(rule)


def specialised(plan: Plan, key: str) -> Plan | None:
    """Return a plan for one key of a plan whose trigger is a variable; None if it does not match the key."""
    name, _, arity = key.rpartition("/")
    change = plan.event.change
    name = name[len(change.value) :]
    negated = name.startswith("~")
    args = tuple(Variable(f"_Arg{i}") for i in range(int(arity)))
    pattern: Any = plan.event.literal
    notes: tuple[Any, ...] = (Rest(Variable("_Notes")),)
    variable: Any = pattern
    given: tuple[Any, ...] = notes
    if isinstance(pattern, LiteralVariable) and pattern.namespace is not None:
        prefix, _, bare_name = name.rpartition("::")
        inner: Any = pattern.variable
        if isinstance(inner, Literal) and f"{bare_name}/{arity}" != inner.key:
            return None
        known = Comparison("=", pattern.namespace, Atom(prefix.removeprefix("~") or "default"))
        args = inner.args if isinstance(inner, Literal) else args
        notes = inner.annotations if isinstance(inner, Literal) else pattern.annotations
        head = literal(name.removeprefix("~"), args, notes, negated=negated)
        more = () if isinstance(inner, Literal) else (Comparison("=", inner, literal(bare_name, args)),)
        return replace(plan, event=Event(change, head), condition=Conjunction((known, *more, *plan.condition.terms)))
    if isinstance(pattern, LiteralVariable):
        notes, variable, given = pattern.annotations, pattern.variable, ()
    head = literal(name.removeprefix("~"), args, notes, negated=negated)
    bare: Any = head.with_(annotations=given)
    if isinstance(pattern, LiteralVariable) and pattern.negated:
        bare = literal(bare.functor, args)
    if not args and not given and not bare.negated:
        bare = Atom(bare.functor)
    bound = () if variable.name == "_" else (Comparison("=", variable, bare),)
    condition = Conjunction((*bound, *plan.condition.terms))
    return replace(plan, event=Event(change, head), condition=condition)
