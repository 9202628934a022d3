"""Internal actions on beliefs and plans of the agent."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from socialbot.bdi._open_beliefs import any_belief, forget_all
from socialbot.bdi.agentspeak._spelling import label_term, spelled_item
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.parser import parse_plan
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.compiler._dynamic import substituted, variables_of
from socialbot.bdi.intentions import Failed, source_of
from socialbot.bdi.literals import SELF, Literal, is_source, literal, source
from socialbot.bdi.plans import Inference, KnownPlan, Plan
from socialbot.bdi.stdlib.environment import event_of, print_
from socialbot.bdi.stdlib.registry import (
    Args,
    detached,
    each,
    each_of,
    gives,
    internal,
    literal_of,
    name_of,
    opened,
    wrong,
)
from socialbot.bdi.terms import Atom, LiteralVariable, Variable
from socialbot.bdi.unification import Trail, Var, annotations_match, closed, resolve, undo, unify
from socialbot.core.errors import RuleError, SocialbotError


@internal(".abolish", 1)
def abolish(engine: Any, args: Args, trail: Trail) -> None:
    """``.abolish(b(_))``: remove every matching belief from any source; ``.abolish(_[source(bob)])`` any of bob."""
    what, ag = resolve(args[0]), engine.interpreter
    if isinstance(what, (Var, LiteralVariable)):
        for relation, found in list(any_belief(ag, what, trail)):
            engine.beliefs.forget_one(relation, found, ag.cause)
        return
    forget_all(ag, literal_of(".abolish", what), ag.cause)


@internal(".belief", 1, many=True)
def belief(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.belief(b(X))``: a stored belief matches; rules are not consulted."""
    what = literal_of(".belief", args[0])
    for _ in engine.beliefs.relation(what.key).match(what.args, what.annotations, trail):
        yield


@internal(".asserta", 1)
def asserta(engine: Any, args: Args, trail: Trail) -> None:
    """``.asserta(b(1))``: add a belief that queries try first. A separate intention handles the event."""
    _assert(engine, ".asserta", args[0])


@internal(".assertz", 1)
def assertz(engine: Any, args: Args, trail: Trail) -> None:
    """``.assertz(b(1))``: add a belief that queries try last. A separate intention handles the event."""
    _assert(engine, ".assertz", args[0], last=True)


def _assert(engine: Any, name: str, term: Any, *, last: bool = False) -> None:
    """Add a belief or a rule; ``last`` makes a new belief the oldest, in time linear in the size of the relation."""
    rule = resolve(term)
    if isinstance(rule, Inference):
        engine.add_rules(rule, first=not last)
        return
    what = literal_of(name, term)
    args = what.args
    if not closed(what):
        raise Failed("no_value", f"{name}: {what} has a variable without a value")
    relation = engine.beliefs.relation(what.key)
    new = args not in relation.facts
    notes = what.annotations if any(map(is_source, what.annotations)) else what.annotations + SELF
    engine.beliefs.add(relation, args, notes, engine.interpreter.cause)
    if last and new and args in relation.facts:
        relation.make_first(args)


@internal(".enter", 1)
def enter(engine: Any, args: Args, trail: Trail) -> None:
    """``.enter(night)``: enter a stage, which disables the plans of other stages."""
    engine.interpreter.enter(name_of(".enter", args[0]), cause=engine.interpreter.cause)


@internal(".add_plan", 1, 3)
def add_plan(engine: Any, args: Args, trail: Trail) -> None:
    """``.add_plan({+!g <- .print(hello)}, Source, begin)``: add plans (terms or strings), at the end by default."""
    plans, *rest = args
    notes = (source(Atom(name_of(".add_plan", rest[0]))),) if rest else SELF
    first = len(rest) > 1 and name_of(".add_plan", rest[1]) == "begin"
    for item in each_of(plans):
        learn(engine, item, notes, first=first)


@internal(".remove_plan", 1, 2)
def remove_plan(engine: Any, args: Args, trail: Trail) -> None:
    """``.remove_plan(label, Source)``: remove a source (default: self) of a plan, or the plan with its last source."""
    plans, *rest = args
    notes = (source(Atom(name_of(".remove_plan", rest[0]))),) if rest else SELF
    for item in each_of(plans):
        unlearn(engine, item, notes)


@internal(".relevant_plans", 2, 3)
def relevant_plans(engine: Any, args: Args, trail: Trail) -> bool:
    """``.relevant_plans({+!g(_)}, Plans, Labels)``: the plans for an event, and their labels with annotations."""
    found = relevant(engine, args[0])
    labels = tuple(label_of(engine, plan) for plan in found)
    plans = tuple(shown(engine, plan) for plan in found)
    return gives(args[1:], (plans, labels)[: len(args) - 1], trail)


@internal(".relevant_plan", 2, many=True)
def relevant_plan(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.relevant_plan({+!g(_)}, Plan)``: Plan is in turn each plan for an event."""
    return each(args[1], (shown(engine, plan) for plan in relevant(engine, args[0])), trail)


@internal(".plan_label", 2, many=True)
def plan_label(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.plan_label(Plan, Label)``: the plan with a label, the label of a plan, or all of both."""
    plan, label = map(resolve, args)
    if isinstance(plan, Plan) and plan.known is not None:
        return each(label, [plan.known.label], trail)
    if isinstance(plan, Plan) and not isinstance(plan.label, str):
        bare = _bare(plan)
        return each(label, [label_of(engine, known) for known in engine.library if _bare(known) == bare], trail)
    if isinstance(plan, Plan):
        return each(label, [label_term(plan)], trail)
    if label.__class__ is Var:
        return each(args, [(shown(engine, found), label_of(engine, found)) for found in engine.library], trail)
    found = _labelled(engine, label)
    return each(plan, [] if found is None else [shown(engine, found)], trail)


@internal(".list_plans", 0, 1)
def list_plans(engine: Any, args: Args, trail: Trail) -> None:
    """``.list_plans({+!g(_)})``: print the plans for an event, or all plans by their files."""
    if args:
        for plan in relevant(engine, args[0]):
            print_(engine, (_listed(engine, plan),), trail)
        return
    files: dict[str, list[str]] = {}
    for plan in engine.library:
        origin = plan.origin if SELF[0] in _sources(plan) else None
        place = "without file" if origin is None else f"from {source_of(origin)}"
        files.setdefault(place, []).append(_listed(engine, plan))
    text = "".join(f"\n\n// plans {place}\n\n" + "\n".join(plans) + "\n" for place, plans in files.items())
    print_(engine, (f"{text}\n",), trail)


@internal(".list_rules", 0)
def list_rules(engine: Any, args: Args, trail: Trail) -> None:
    """``.list_rules``: print the rules."""
    for rules in engine.library.inferences.values():
        for compiled in rules:
            rule = compiled.inference
            head = rule.head.with_(annotations=(*rule.head.annotations, *SELF))
            print_(engine, (spelled_item(replace(rule, head=head)),), trail)


@internal(".relevant_rules", 2)
def relevant_rules(engine: Any, args: Args, trail: Trail) -> bool:
    """``.relevant_rules(b(_), Rules)``: Rules are those whose head matches; all for an unbound variable."""
    if resolve(args[0]).__class__ is Var:
        rules = itertools.chain(*engine.library.inferences.values())
        return gives(args[1], tuple(_unsourced(compiled.inference) for compiled in rules), trail)
    pattern = literal_of(".relevant_rules", args[0])
    found = []
    for compiled in engine.library.inferences.get(pattern.key, ()):
        if gives(opened(compiled.inference.head.args), pattern.args, trail):
            found.append(_unsourced(compiled.inference))
        undo(trail, 0)
    return gives(args[1], tuple(found), trail)


def _unsourced(rule: Inference) -> Inference:
    """Return a rule without its sources."""
    left = tuple(note for note in rule.head.annotations if not is_source(note))
    return replace(rule, head=rule.head.with_(annotations=left))


@internal(".namespace", 1, many=True)
def namespace(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.namespace(N)``: N is in turn each namespace of the beliefs; ``default`` is always one."""
    keys = (key.lstrip("~") for key, relation in engine.beliefs.relations.items() if relation.facts)
    names = dict.fromkeys(["default", *(key.partition("::")[0] for key in keys if "::" in key)])
    return each(args[0], map(Atom, names), trail)


@internal(".namespace_set_prop", 3)
def namespace_set_prop(engine: Any, args: Args, trail: Trail) -> None:
    """``.namespace_set_prop(family, uri, "http://x")``: set a property of a namespace."""
    name, key, value = map(resolve, args)
    properties = engine.library.namespaces.setdefault(name_of(".namespace_set_prop", name), {})
    properties[Atom(name_of(".namespace_set_prop", key))] = detached(value)


@internal(".namespace_get_prop", 2, 4, many=True)
def namespace_get_prop(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.namespace_get_prop(family, K, V, Default)``: K is in turn each property of a namespace, and V its value.

    V is the default for a known K that is no property.
    """
    name, key, *rest = map(resolve, args)
    properties = engine.library.namespaces.get(name_of(".namespace_get_prop", name), {})
    if key.__class__ is not Var and key not in properties and len(rest) == 2:
        return each(rest[0], [rest[1]], trail)
    found = [(key, value)[: len(args) - 1] for key, value in properties.items()]
    return each(args[1:3], found, trail)


def label_of(engine: Any, plan: Plan, said_by: tuple[Any, ...] = ()) -> Any:
    """Return the label of a plan with its annotations; a plan without one gets a name, such as ``p__2``.

    ``said_by`` replaces its sources.
    """
    name = plan.label or engine.library.given_label(plan)
    place = () if plan.origin is None else (literal("url", (source_of(plan.origin),)),)
    marked = replace(plan, label=name, annotations=(*_others(plan), *(said_by or _sources(plan)), *place))
    return label_term(marked)


def renamed(item: Any, numbers: Iterator[int]) -> tuple[Any, dict[str, Variable]]:
    """Copy a plan or body with numbers for the names of its variables; return it with the new variables."""
    names = {name: Variable(f"_{next(numbers)}") for name in variables_of(item)}
    return substituted(item, names), names


def shown(engine: Any, plan: Plan, said_by: tuple[Any, ...] = ()) -> Plan:
    """Return a plan of the library as a value: it has its label, and variables of its own.

    ``said_by`` are the sources of the plan as the answer to another agent.
    """
    twin, _ = renamed(plan, itertools.count(1))
    twin = copy.copy(plan) if twin is plan else twin
    label = label_of(engine, plan, said_by)
    if said_by:
        plan = replace(plan, annotations=(*_others(plan), *said_by))
    twin.__dict__["known"] = KnownPlan(plan, label)
    return twin


def _listed(engine: Any, plan: Plan) -> str:
    """Format a plan of the library with its label; only plans of others lose the names of their variables."""
    if _sources(plan) != SELF:
        return spelled_item(shown(engine, plan))
    twin = copy.copy(plan)
    twin.__dict__["known"] = KnownPlan(plan, label_of(engine, plan))
    return spelled_item(twin)


def _labelled(engine: Any, term: Any) -> Plan | None:
    """Return the plan of a label: an atom, a literal with annotations, or a string."""
    label = resolve(term)
    if isinstance(label, Literal) and not label.args:
        label = Atom(label.functor)
    return engine.library.labelled(name_of(".plan_label", label).removeprefix("@"))


def relevant(engine: Any, term: Any) -> tuple[Plan, ...]:
    """Return the relevant plans of an event, which may be of any source, in the order of selection."""
    event = event_of(".relevant_plans", term)
    found, triggers = [], engine.library.triggers
    if not isinstance(event.literal, Literal):
        return tuple(plan for plan in engine.library if plan.event.change is event.change)
    notes = event.literal.annotations
    if not any(map(is_source, notes)):
        notes += (literal("source", (Var(),)),)
    for ready in triggers[event.key].plans if event.key in triggers else ():
        trail: Trail = []
        head = opened(ready.plan.event.literal)
        if unify(head.args, event.literal.args, trail) and annotations_match(head.annotations, notes, trail):
            found.append(engine.library.written(ready.plan))
        undo(trail, 0)
    return tuple(found)


def learn(engine: Any, item: Any, notes: tuple[Any, ...], *, first: bool = False) -> None:
    """Add a plan (term or string) from a source. An equal plan only gets another source."""
    plan = resolve(item)
    if isinstance(plan, str):
        try:
            plan = parse_plan(plan, "<string>")
        except AgentSpeakError as problem:
            raise Failed("wrong_arguments", f"the plan cannot be read: {problem}") from problem
    if isinstance(plan, Plan) and plan.known is not None:
        plan = plan.known.plan
        notes = (*(note for note in plan.annotations if is_source(note) and note not in notes), *notes)
    if not isinstance(plan, Plan):
        raise wrong(".add_plan", plan, "a plan, such as {+!g <- .print(hello)}")
    known = _known(engine, plan)
    if known is not None:
        new = tuple(note for note in notes if note not in _sources(known.plan))
        notes = (*_others(known.plan), *_sources(known.plan), *new)
        engine.library.replace(known, replace(known.plan, annotations=notes))
        return
    from socialbot.bdi.agentspeak.loading import check_plans

    try:
        check_plans([plan], engine.library)
        engine.add_rules(replace(plan, annotations=(*_others(plan), *notes)), first=first)
    except RuleError as problem:
        raise Failed("wrong_arguments", f"the plan cannot be added: {problem}") from problem


def unlearn(engine: Any, item: Any, notes: tuple[Any, ...]) -> None:
    """Remove sources of a plan (term, label or ``"@label"``); without any source the plan is removed."""
    item = resolve(item)
    if not isinstance(item, Plan):
        item = _labelled(engine, item)
    if item is not None and not isinstance(item.event.literal, Literal):
        found = next((plan for plan in engine.library.general if _text(plan) == _text(item)), None)
        if found is not None:
            engine.remove_plan(found)
        return
    known = None if item is None else _known(engine, item)
    if known is None:
        return
    left = tuple(note for note in _sources(known.plan) if note not in notes)
    if left:
        engine.interpreter.own_library()
        known = _known(engine, known.plan)
        engine.library.replace(known, replace(known.plan, annotations=(*_others(known.plan), *left)))
    else:
        engine.remove_plan(known.plan)


def _known(engine: Any, plan: Plan) -> Any:
    """Return the equal compiled plan of the library."""
    plan = plan.known.plan if plan.known else plan
    trigger = engine.library.triggers.get(plan.event.key)
    known = () if trigger is None else trigger.plans
    return next((ready for ready in known if ready.plan is plan or _text(ready.plan) == _text(plan)), None)


def _text(plan: Plan) -> str:
    return agentspeak(replace(plan, annotations=_others(plan)))


def _bare(plan: Plan) -> str:
    """Text of a plan without its label."""
    return agentspeak(replace(plan.without_truth(), label=None, annotations=()))


def _sources(plan: Plan) -> tuple[object, ...]:
    return tuple(filter(is_source, plan.annotations)) or SELF


def _others(plan: Plan) -> tuple[object, ...]:
    return tuple(note for note in plan.annotations if not is_source(note))


_namespaces = itertools.count(1)


@internal(".include", 1, 2, binds=True)
def include(engine: Any, args: Args, trail: Trail) -> bool:
    """``.include("file.asl", Namespace)``: load a program into this agent; an unbound Namespace gets a new one.

    The file is searched in the include folders of the society.
    """
    from socialbot.bdi.agentspeak.loading import load  # needs this package

    file, *rest = map(resolve, args)
    if not isinstance(file, str):
        raise wrong(".include", file, "the name of a file, a string")
    society = engine.messaging.society
    if society is None or society.include_paths is None:
        raise Failed("action_failed", f".include: {file} cannot be loaded: set Society.include_paths")
    namespace = rest[0] if rest else None
    given = namespace
    if namespace.__class__ is Var:
        given = Atom(f"ns{next(_namespaces)}")
    elif namespace is not None and not isinstance(namespace, Atom):
        raise wrong(".include", namespace, "the name of a namespace")
    directive = literal("include", (file,) if given is None else (file, given))
    try:
        load(engine, f"{{ {agentspeak(directive)} }}", ".include", society.include_paths)
    except SocialbotError as problem:
        raise Failed("action_failed", f".include: {problem}") from problem
    return namespace is None or gives(namespace, given, trail)
