"""Compile terms to values, structures with variables, and pattern matching."""

from __future__ import annotations

from socialbot.bdi.compiler._runtime import FUNCTIONS
from socialbot.bdi.compiler._source import CELL, VALUE, Function, simple, tuple_of
from socialbot.bdi.literals import ANYTHING, Event, Literal, ground, literal
from socialbot.bdi.steps import Step
from socialbot.bdi.terms import Atom, Call, Cons, Expression, Variable, names_in, show
from socialbot.core.errors import RuleError


def has_value(f: Function, term: object) -> bool:
    """Check whether all variables of a term hold values at this point of the function."""
    if isinstance(term, Call):
        return True
    return all(f.scope.get(name) == VALUE for name in names_in(term))


def has_cell(f: Function, term: object) -> bool:
    """Check whether a variable of a term may be unbound."""
    return any(f.scope.get(name) == CELL for name in names_in(term))


def value(f: Function, term: object) -> str:
    """Return the expression of a term's value. Raises RuleError for an unbound variable."""
    if isinstance(term, Variable):
        state = f.scope.get(term.name)
        if state is None:
            raise RuleError(f"{term} has no value", where=f.unit.title, remedy="give it one in the event or condition")
        return f.local(term.name) if state == VALUE else f"known({f.local(term.name)})"
    if isinstance(term, Expression):
        return arithmetic(f, term)
    if isinstance(term, int) and term.__class__ is int and abs(term) < 1000:
        return f"({term})"
    if isinstance(term, Call):
        return call(f, term)
    if ground(term):
        return f.unit.constant(term)
    if isinstance(term, tuple):
        return tuple_of(value(f, item) for item in term)
    if isinstance(term, Cons):
        return f"cons({tuple_of(value(f, item) for item in term.items)}, {value(f, term.tail)})"
    if isinstance(term, Event):
        return f"Event({f.unit.constant(term.change)}, {value(f, term.literal)})"
    if not isinstance(term, Literal):
        raise RuleError(f"{show(term)} is no value", where=f.unit.title, remedy="compare in a condition")
    return structure(f, term, tuple_of(value(f, arg) for arg in term.args), [value(f, a) for a in term.annotations])


def values(f: Function, terms: tuple[object, ...]) -> str:
    """Return the expression of a tuple of values; one constant if all are ground."""
    return f.unit.constant(terms) if ground(terms) else tuple_of(value(f, term) for term in terms)


def arithmetic(f: Function, term: Expression) -> str:
    """Return the expression of an arithmetic term."""
    left, right = value(f, term.left), value(f, term.right)
    if term.symbol in ("div", "mod"):
        return f"{term.symbol}({left}, {right})"
    return f"({left} {term.symbol} {right})"


def call(f: Function, term: Call) -> str:
    """Return the expression of an AgentSpeak function call."""
    if term.function == ".count":
        from socialbot.bdi.compiler._conditions import collected

        goal = term.args[0]
        return collected(f, ".count", literal(goal.name) if isinstance(goal, Atom) else goal, None)  # type: ignore[arg-type]
    function = FUNCTIONS.get(term.function)
    if function is None:
        raise RuleError(f"there is no function {term.function}", where=f.unit.title, remedy="see docs/semantics.md")
    return f"{f.unit.constant(function)}(ag.engine{''.join(', ' + value(f, arg) for arg in term.args)})"


def structure(f: Function, term: Literal, args: str, annotations: list[str]) -> str:
    """Return the expression of a literal inside another term."""
    if type(term).functor == term.functor and not term.annotations and not term.negated:
        return f"{f.unit.constant(type(term))}(*{args})"
    negated = ", negated=True" if term.negated else ""
    return f"literal({term.functor!r}, {args}, {tuple_of(annotations)}{negated})"


def build(f: Function, term: object) -> str:
    """Return the expression of a term with variables; variables without a local get one."""
    if has_value(f, term) and "_" not in names_in(term):
        return value(f, term)
    if isinstance(term, Variable):
        if term.name == "_":
            return "Var()"
        if term.name not in f.scope:
            f.line(f"{f.local(term.name)} = Var({term.name!r})")
            f.scope[term.name] = CELL
        return f.local(term.name)
    if isinstance(term, tuple):
        return tuple_of([build(f, item) for item in term])
    if isinstance(term, Cons):
        items = tuple_of([build(f, item) for item in term.items])
        return f"cons({items}, {build(f, term.tail)})"
    if isinstance(term, Literal):
        args = tuple_of([build(f, arg) for arg in term.args])
        return structure(f, term, args, [build(f, note) for note in term.annotations])
    if isinstance(term, Event):
        return f"Event({f.unit.constant(term.change)}, {build(f, term.literal)})"
    return value(f, term)


def match(f: Function, pattern: object, subject: str, fail: str, step: Step | None = None) -> None:
    """Emit a match of a pattern with a value: it binds variables or executes ``fail``."""
    if isinstance(pattern, Variable) and pattern.name not in f.scope:
        if pattern.name != "_":
            f.line(f"{f.local(pattern.name)} = {subject}")
            f.scope[pattern.name] = VALUE
    elif has_cell(f, pattern) or (isinstance(pattern, Literal) and pattern.annotations):
        unified(f, pattern, subject, fail, step)
    elif has_value(f, pattern):
        differs = "is not" if simple(pattern) else "!="
        f.line(f"if {subject} {differs} {value(f, pattern)}: {fail}", step)
    elif isinstance(pattern, (tuple, Cons)):
        match_list(f, pattern, subject, fail, step)
    elif isinstance(pattern, Literal):
        item = f.unit.name("t")
        f.line(f"{item} = {subject}")
        f.line(
            f"if not isinstance({item}, Literal) or {item}.functor != {pattern.functor!r} "
            f"or {item}.negated != {pattern.negated} or len({item}.args) != {len(pattern.args)}: {fail}",
            step,
        )
        for i, arg in enumerate(pattern.args):
            match(f, arg, f"{item}.args[{i}]", fail, step)
    else:
        raise RuleError(f"{show(pattern)} has no value", where=f.unit.title, remedy="give its variables values before")


def match_list(f: Function, pattern: tuple[object, ...] | Cons, subject: str, fail: str, step: Step | None) -> None:
    """Emit a match of a list pattern."""
    item = f.unit.name("t")
    items, tail = (pattern.items, pattern.tail) if isinstance(pattern, Cons) else (pattern, None)
    differs = "!=" if tail is None else "<"
    f.line(f"{item} = {subject}")
    f.line(f"if {item}.__class__ is not tuple or len({item}) {differs} {len(items)}: {fail}", step)
    for i, part in enumerate(items):
        match(f, part, f"{item}[{i}]", fail, step)
    if tail is not None:
        match(f, tail, f"{item}[{len(items)}:]", fail, step)


def unified(f: Function, pattern: object, subject: str, fail: str, step: Step | None = None) -> None:
    """Emit the unification of a pattern with a value, which binds all variables of the pattern."""
    fresh = names_in(pattern) - f.scope.keys() - {ANYTHING.name}
    f.line(f"if not unify({build(f, pattern)}, {subject}, trail): {fail}", step)
    settle(f, fresh)


def settle(f: Function, fresh: set[str]) -> None:
    """Mark new variables as values. Others stay cells, since a surrounding loop may bind them again."""
    for name in sorted(fresh):
        f.line(f"{f.local(name)} = resolve({f.local(name)})")
        f.scope[name] = VALUE


def refresh(f: Function, names: set[str], before: set[str]) -> None:
    """Emit updates of variables that a pause may have bound."""
    for name in sorted(names - {"_"}):
        if f.scope.get(name) == CELL or name not in before:
            f.line(f"{f.local(name)} = resolve({f.local(name)})")
