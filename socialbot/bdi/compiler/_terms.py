"""Compile terms to values, structures with variables, and pattern matching."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from socialbot.bdi.aggregates import needed_names
from socialbot.bdi.compiler._dynamic import embeds, is_embedded, is_template, variables_of
from socialbot.bdi.compiler._runtime import FUNCTIONS
from socialbot.bdi.compiler._source import CELL, VALUE, Function, tuple_of
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Event, Literal, Symbolic, ground, literal
from socialbot.bdi.steps import Step
from socialbot.bdi.terms import (
    Aggregate,
    Atom,
    Call,
    Computation,
    Cons,
    Expression,
    LiteralVariable,
    OwnName,
    Rest,
    Variable,
    names_in,
    show,
)
from socialbot.core.errors import RuleError

LIBRARIES = ("math.", "system.")
"""Beginnings of the names of built-in functions."""


def has_value(f: Function, term: object) -> bool:
    """Check whether all variables of a term hold values at this point of the function."""
    return all(f.scope.get(name) == VALUE for name in needed_names(term))


def settled(f: Function, term: object) -> bool:
    """Check whether a term has a value and no anonymous variable."""
    return has_value(f, term) and "_" not in needed_names(term)


def has_cell(f: Function, term: object) -> bool:
    return any(f.scope.get(name) == CELL for name in names_in(term))


def value(f: Function, term: object) -> str:
    """Return the expression of a term's value. Raises RuleError for an unbound variable."""
    if embeds(term):
        return build(f, term)
    if isinstance(term, Variable):
        state = f.scope.get(term.name)
        if state is None and f.unit.lenient:
            return f"known(Var({term.name!r}))"
        if state is None:
            raise RuleError(f"{term!s} has no value", remedy="give it one in the event or condition")
        return f.local(term.name) if state == VALUE else f"known({f.local(term.name)})"
    if isinstance(term, Expression):
        return arithmetic(f, term)
    if isinstance(term, int) and term.__class__ is int and abs(term) < 1000:
        return f"({term})"
    if isinstance(term, Call):
        return call(f, term)
    if isinstance(term, Computation):
        return f"{f.unit.constant(term.function)}({', '.join(value(f, Variable(name)) for name in term.parameters)})"
    if isinstance(term, OwnName):
        return "ag.engine.name"
    if isinstance(term, Aggregate):
        from socialbot.bdi.compiler._conditions import aggregated

        return f"aggregate({term.kind!r}, {aggregated(f, term)})"
    if isinstance(term, tuple) and not (term and ground(term)):
        return tuple_of(value(f, item) for item in term)
    if isinstance(term, Rest):
        return f"*{value(f, term.tail)}"
    if ground(term):
        return f.unit.constant(term)
    if isinstance(term, Cons):
        return f"cons({value(f, term.items)}, {value(f, term.tail)})"
    if isinstance(term, Event):
        return f"Event({f.unit.constant(term.change)}, {value(f, term.literal)})"
    if isinstance(term, LiteralVariable):
        return f"known({build(f, term)})"
    if not isinstance(term, Literal):
        raise RuleError(f"{show(term)} is not a value", remedy="compare in a condition")
    return structure(f, term, value(f, term.args), value(f, term.annotations))


def arithmetic(f: Function, term: Expression) -> str:
    left, right = value(f, term.left), value(f, term.right)
    if term.symbol in ("div", "mod"):
        return f"{term.symbol}({left}, {right})"
    result = f"power({left}, {right})" if term.symbol == "**" else f"({left} {term.symbol} {right})"
    if not f.unit.lenient or not _may_join(term):
        return result
    if term.symbol == "*":
        return f"product({left}, {right}, {str(term)!r})"
    item = f.unit.name("t")
    return (
        f"({item} if ({item} := {result}).__class__ is int or {item}.__class__ is float "
        f"else joined({item}, {str(term)!r}))"
    )


def _may_join(term: Expression) -> bool:
    """Check whether Python would join lists, or repeat lists or strings."""
    numeric = [isinstance(part, (int, float, Expression)) for part in (term.left, term.right)]
    return (term.symbol == "+" and not any(numeric)) or (term.symbol == "*" and not all(numeric))


def call(f: Function, term: Call) -> str:
    if term.function == ".count":
        from socialbot.bdi.compiler._conditions import collected

        return collected(f, literal(".count", (*term.args, Variable("_"))))
    if term.predicate:
        return f"computed_by_rule(ag, {f'{term.predicate}/{len(term.args) + 1}'!r}, {build(f, term.args)})"
    return f"{f.unit.constant(function_of(term))}(ag.engine{''.join(', ' + value(f, arg) for arg in term.args)})"


def function_of(term: Call) -> Callable[..., Any]:
    """Return the function of a call. Raises RuleError for an unknown one."""
    function = FUNCTIONS.get(term.function)
    if function is None and "." in term.function and not term.function.startswith((".", *LIBRARIES)):
        return partial(_missing_function, term.function)
    if function is None:
        raise RuleError(f"there is no function {term.function}", remedy="see docs/semantics.md")
    return function


def _missing_function(name: str, engine: Any, *args: Any) -> Any:
    raise Failed("action_failed", f"there is no function {name}/{len(args)}; register it in Python")


def structure(f: Function, term: Literal, args: str, annotations: str) -> str:
    """Return the expression of a literal inside another term."""
    if type(term).functor == term.functor and not term.annotations and not term.negated:
        return f"{f.unit.constant(type(term))}(*{args})"
    negated = ", negated=True" if term.negated else ""
    return f"literal({term.functor!r}, {args}, {annotations}{negated})"


def build(f: Function, term: object) -> str:
    """Return the expression of a term with variables; variables without a local get one."""
    if is_embedded(term):
        return embedded(f, term)
    if isinstance(term, LiteralVariable):
        variable, notes = build(f, term.variable), build(f, term.annotations)
        namespace = "" if term.namespace is None else f", {build(f, term.namespace)}"
        return f"literal_with({variable}, {notes}, {term.negated}{namespace})"
    if settled(f, term) and not embeds(term):
        return value(f, term)
    if isinstance(term, Variable):
        if term.name == "_":
            return "Var()"
        if term.name not in f.scope:
            f.line(f"{f.local(term.name)} = Var({term.name!r})")
            f.scope[term.name] = CELL
        return f.local(term.name)
    if isinstance(term, tuple):
        if term and isinstance(term[-1], Rest):
            return f"spread({tuple_of([*(build(f, item) for item in term[:-1]), f'Rest({build(f, term[-1].tail)})'])})"
        return tuple_of([build(f, item) for item in term])
    if isinstance(term, Rest):
        return f"Rest({build(f, term.tail)})"
    if isinstance(term, Cons):
        return f"cons({build(f, term.items)}, {build(f, term.tail)})"
    if isinstance(term, Literal):
        return structure(f, term, build(f, term.args), build(f, term.annotations))
    if isinstance(term, Event):
        return f"Event({f.unit.constant(term.change)}, {build(f, term.literal)})"
    return value(f, term)


def build_pattern(f: Function, term: object) -> str:
    """Return the expression of a term that is unified: in plans, steps and conditions, too, variables get a local."""
    before, f.matches = f.matches, True
    built = build(f, term)
    f.matches = before
    return built


def embedded(f: Function, term: object) -> str:
    """Return the expression of a plan, body or rule with the values that its variables have here."""
    constant = f.unit.constant(term)
    used = variables_of(term)
    if is_template(term) or (f.matches and any(f.scope.get(name) != VALUE for name in used)):
        for name in used:
            build(f, Variable(name))
        cells = ", ".join(f"{name!r}: {f.local(name)}" for name in used)
        return f"template({constant}, {{{cells}}})"
    names = sorted(used.keys() & f.scope.keys())
    if not names:
        return constant
    return f"substituted({constant}, {{{', '.join(f'{name!r}: {f.local(name)}' for name in names)}}})"


def match(f: Function, pattern: object, subject: str, fail: str, step: Step | None = None) -> None:
    """Emit a match of a pattern with a value: it binds variables or executes ``fail``."""
    if isinstance(pattern, Variable) and pattern.name not in f.scope:
        if pattern.name != "_":
            found = f"plain({subject})" if pattern.name in f.unit.symbols else subject
            f.line(f"{f.local(pattern.name)} = {found}")
            f.scope[pattern.name] = VALUE
    elif has_cell(f, pattern) or isinstance(pattern, LiteralVariable) or _is_annotated(pattern) or embeds(pattern):
        fresh = names_in(pattern) - f.scope.keys() - {"_"}
        f.line(f"if not unify({build_pattern(f, pattern)}, {subject}, trail): {fail}", step)
        # Others stay cells, since a surrounding loop may bind them again.
        f.resolve(fresh, VALUE)
    elif has_value(f, pattern):
        differs = "is not" if pattern.__class__ is Atom else "!="
        f.line(f"if {subject} {differs} {value(f, pattern)}: {fail}", step)
    elif isinstance(pattern, (tuple, Cons)):
        match_list(f, pattern, subject, fail, step)
    elif isinstance(pattern, Literal):
        match_literal(f, pattern, subject, fail, step)
    elif f.unit.lenient:
        f.line(f"if {subject} != {value(f, pattern)}: {fail}", step)
    else:
        raise RuleError(f"{show(pattern)} has no value", remedy="give its variables values before")


def _is_annotated(pattern: object) -> bool:
    return isinstance(pattern, Literal) and bool(pattern.annotations)


def match_literal(f: Function, pattern: Literal, subject: str, fail: str, step: Step | None = None) -> None:
    """Emit a match with a literal that may have more annotations than the pattern, which has none."""
    item = subject
    if not subject.isidentifier():
        item = f.unit.name("t")
        f.line(f"{item} = {subject}")
    f.line(f"if not isinstance({item}, Literal) or {item}.key != {pattern.key!r}: {fail}", step)
    for i, arg in enumerate(pattern.args):
        part = f"{item}.args[{i}]"
        if isinstance(pattern, Symbolic) and i < pattern.symbols and isinstance(arg, Variable):
            part = f"plain({part})"
        match(f, arg, part, fail, step)


def match_list(f: Function, pattern: tuple[object, ...] | Cons, subject: str, fail: str, step: Step | None) -> None:
    item = f.unit.name("t")
    items, tail = (pattern.items, pattern.tail) if isinstance(pattern, Cons) else (pattern, None)
    differs = "!=" if tail is None else "<"
    f.line(f"{item} = {subject}")
    f.line(f"if {item}.__class__ is not tuple or len({item}) {differs} {len(items)}: {fail}", step)
    for i, part in enumerate(items):
        match(f, part, f"{item}[{i}]", fail, step)
    if tail is not None:
        match(f, tail, f"{item}[{len(items)}:]", fail, step)


def refresh(f: Function, names: set[str]) -> None:
    """Emit updates of variables that a pause may have bound."""
    f.resolve(name for name in names - {"_"} if f.scope.get(name) == CELL)
