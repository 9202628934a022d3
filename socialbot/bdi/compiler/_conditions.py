"""Compile conditions to nested loops and ifs around the code that follows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext

from socialbot.bdi.compiler._source import CELL, VALUE, Function, Scope, tuple_of
from socialbot.bdi.compiler._terms import build, has_cell, has_value, match, settled, value
from socialbot.bdi.literals import Literal, literal
from socialbot.bdi.stdlib import called
from socialbot.bdi.terms import (
    Atom,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    FunctionCondition,
    Negation,
    Truth,
    Variable,
    names_in,
)
from socialbot.core.errors import RuleError

MOST_LOOPS = 10
MOST_BLOCKS = 50
"""Depth at which a new function starts. Python allows 20 nested loops and 100 nested blocks."""

COLLECTORS = {".findall", ".setof", ".count"}
"""Internal actions with a condition as argument."""

Rest = Callable[[], None]


class Reached(Condition):
    """Marker in a diagnostic function: the conditions before it hold."""

    def __init__(self, number: int) -> None:
        self.number = number

    def names(self) -> set[str]:
        return set()


def write(f: Function, condition: Condition, fail: str, rest: Rest) -> None:
    """Emit ``rest`` for each solution of a condition; the statement ``fail`` continues with the next solution."""
    if isinstance(condition, Conjunction):
        conjunction(f, condition.terms, fail, rest)
    elif isinstance(condition, Truth):
        with nullcontext() if condition.value else f.block("if False"):
            rest()
    elif isinstance(condition, FunctionCondition):
        arguments = ", ".join(value(f, Variable(name)) for name in condition.parameters)
        with f.block(f"if {f.unit.constant(condition.function)}({arguments})"):
            rest()
    elif isinstance(condition, Reached):
        f.line(f"trail.reached = max(trail.reached, {condition.number})")
        rest()
    elif isinstance(condition, Negation):
        negation(f, condition.condition, rest)
    elif isinstance(condition, Disjunction):
        as_function(f, condition, rest)
    elif isinstance(condition, Comparison):
        comparison(f, condition, fail, rest)
    else:
        assert isinstance(condition, Literal), condition
        if "." in condition.functor:
            internal(f, condition, fail, rest)
        else:
            belief(f, condition, rest)


def conjunction(f: Function, terms: tuple[Condition, ...], fail: str, rest: Rest) -> None:
    if len(terms) == 0:
        rest()
    elif (f.loops >= MOST_LOOPS or f.depth >= MOST_BLOCKS) and len(terms) > 1:
        as_function(f, Conjunction(terms), rest)
    else:
        loops = f.loops

        def others() -> None:
            conjunction(f, terms[1:], "continue" if f.loops > loops else fail, rest)

        write(f, terms[0], fail, others)
        f.loops = loops


def belief(f: Function, pattern: Literal, rest: Rest) -> None:
    annotated = pattern.annotations or any(isinstance(arg, Literal) and arg.annotations for arg in pattern.args)
    if annotated or f.unit.library.derives(pattern.key) or has_cell(f, pattern):
        solve(f, pattern, rest)
        return
    known = [i for i, arg in enumerate(pattern.args) if settled(f, arg)]
    relation = f.relation(pattern.key)
    if len(known) == len(pattern.args):
        with f.block(f"if {value(f, pattern.args)} in {relation}.facts"):
            rest()
        return
    with loop(f, f"reversed({_bucket(f, pattern, known, relation)})", binds=False) as found:
        for i, arg in enumerate(pattern.args):
            if i not in known:
                match(f, arg, f"{found}[{i}]", "continue")
        rest()


def _bucket(f: Function, pattern: Literal, known: list[int], relation: str) -> str:
    if not known:
        return f"{relation}.facts"
    keys = [value(f, pattern.args[i]) for i in known]
    key = keys[0] if len(keys) == 1 else tuple_of(keys)
    return f"{relation}.index({f.unit.constant(tuple(known))}).get({key}, ())"


@contextmanager
def loop(f: Function, items: str, *, binds: bool = True) -> Iterator[str]:
    """Emit ``for x in items:`` around the block.

    Each iteration undoes the bindings of the previous one; generators with own bindings undo these themselves.
    """
    found = f.unit.name("f")
    mark = f.unit.name("m") if not binds and CELL in f.scope.values() else None
    if mark:
        f.line(f"{mark} = len(trail)")
    with f.block(f"for {found} in {items}"):
        f.loops += 1
        if mark:
            f.line(f"undo(trail, {mark})")
        yield found


def solve(f: Function, pattern: Literal, rest: Rest) -> None:
    """Emit the loop over solutions of annotated or derived beliefs, or of arguments with unbound variables."""
    fresh = names_in(pattern) - f.scope.keys() - {"_"}
    args, notes = build(f, pattern.args), build(f, pattern.annotations)
    cells = f.save(fresh)
    with loop(f, f"ag.solve({pattern.key!r}, {args}, {notes}, trail)"):
        f.resolve(fresh, VALUE, cells)
        rest()


def negation(f: Function, inner: Condition, rest: Rest) -> None:
    if isinstance(inner, Literal) and "." not in inner.functor and not inner.annotations and _plain(f, inner):
        known = [i for i, arg in enumerate(inner.args) if settled(f, arg)]
        relation = f.relation(inner.key)
        if len(known) == len(inner.args):
            test = f"{value(f, inner.args)} not in {relation}.facts"
        else:
            test = f"not {_bucket(f, inner, known, relation)}"
    else:
        name, arguments, _ = query(f, inner)
        test = f"not holds({name}({arguments}), trail)"
    with f.block(f"if {test}"):
        rest()


def _plain(f: Function, pattern: Literal) -> bool:
    """Check for a stored belief whose unbound arguments are distinct variables."""
    if f.unit.library.derives(pattern.key) or has_cell(f, pattern):
        return False
    free = [arg for arg in pattern.args if not settled(f, arg)]
    names = [arg.name for arg in free if isinstance(arg, Variable) and arg.name != "_"]
    return all(isinstance(arg, Variable) for arg in free) and len(names) == len(set(names))


def as_function(f: Function, condition: Condition, rest: Rest) -> None:
    """Emit a condition as a function, and the loop over its solutions."""
    name, arguments, fresh = query(f, condition)
    with loop(f, f"{name}({arguments})") as found:
        unpack(f, fresh, found)
        rest()


def unpack(f: Function, fresh: Scope, found: str) -> None:
    """Emit assignments of a solution and mark the variables as assigned."""
    assign(f, fresh, found)
    f.scope.update(fresh)


def assign(f: Function, fresh: Iterable[str], found: str) -> None:
    """Emit assignments of a solution to locals."""
    if fresh:
        f.line(f"{tuple_of(f.local(name) for name in fresh)} = {found}")


def joined_state(name: str, *scopes: Scope) -> str:
    """Return the state of a variable after alternatives."""
    return VALUE if all(scope.get(name) == VALUE for scope in scopes) else CELL


def query(
    f: Function, condition: Condition, template: object = None, also: Iterable[str] = ()
) -> tuple[str, str, Scope]:
    """Emit a function that yields a tuple of new variable values for each solution.

    A ``template`` replaces the tuple. ``also`` are unbound variables that get values, too. Returns the name of the
    function, its arguments, and the new variables with their states.
    """
    used = sorted(((names_in(condition) | names_in(template)) & f.scope.keys()) - {"_"})
    inner = f.unit.function("q", ["ag", "trail", *(f.local(name) for name in used)], {n: f.scope[n] for n in used})
    inner.line("mark = len(trail)")
    branches = condition.terms if isinstance(condition, Disjunction) else (condition,)
    scopes = [_branch(inner, branch, dry=True) for branch in branches]
    fresh = {name: joined_state(name, *scopes) for scope in scopes for name in scope if name not in used}
    fresh |= {name: CELL for name in also if name in used}
    fresh = dict(sorted(fresh.items()))
    if not f.unit.dry:
        for branch in branches:
            _branch(inner, branch, fresh=fresh, template=template)
    inner.line("undo(trail, mark)")
    return inner.name, ", ".join(["ag", "trail", *(f.local(name) for name in used)]), fresh


def _branch(
    f: Function,
    condition: Condition,
    *,
    fresh: Scope | None = None,
    template: object = None,
    dry: bool = False,
) -> Scope:
    """Emit one branch; return the states of its variables. A dry run emits nothing."""
    scope, lines, functions = dict(f.scope), len(f.lines), len(f.unit.functions)
    f.unit.dry += dry
    found: Scope = {}

    def give() -> None:
        found.update(f.scope)
        if dry:
            return
        if template is not None:
            f.line(f"yield {build(f, template)}" if has_value(f, template) else f"yield resolve({build(f, template)})")
        else:
            for name in fresh or {}:
                build(f, Variable(name))
            given = (f"resolve({f.local(name)})" if f.scope[name] == CELL else f.local(name) for name in fresh or {})
            f.line(f"yield {tuple_of(given)}")

    f.line("undo(trail, mark)")
    with f.block("for _ in ONCE"):
        f.loops = 1
        write(f, condition, "continue", give)
    f.scope.clear()
    f.scope.update(scope)
    f.unit.dry -= dry
    if dry:
        del f.lines[lines:]
        del f.unit.functions[functions:]
    return found


def comparison(f: Function, condition: Comparison, fail: str, rest: Rest) -> None:
    left, right = condition.left, condition.right
    if condition.symbol == "=":
        if not settled(f, right) and settled(f, left):
            left, right = right, left
        if settled(f, right):
            match(f, left, value(f, right), fail)
        else:
            f.line(f"if not unify({build(f, left)}, {build(f, right)}, trail): {fail}")
        rest()
        return
    if condition.symbol == "=..":
        test = f"univ({build(f, left)}, {build(f, right)}, trail)"
    else:
        test = f"{value(f, left)} {condition.symbol} {value(f, right)}"
    with f.block(f"if {test}"):
        rest()


def internal(f: Function, condition: Literal, fail: str, rest: Rest) -> None:
    if condition.functor in COLLECTORS:
        match(f, condition.args[-1], collected(f, condition), fail)
        rest()
        return
    entry = called(condition, condition=True)
    fresh = names_in(condition) - f.scope.keys() - {"_"}
    args = build(f, condition.args)
    test = f"{f.unit.constant(entry.function)}(ag.engine, {args}, trail)"
    cells = f.save(fresh)
    with loop(f, test) if entry.many else f.block(f"if {test} is not False"):
        f.resolve(fresh, VALUE if entry.binds else CELL, cells)
        rest()


def collected_goal(action: Literal) -> Condition:
    """Return the condition of ``.findall``, ``.setof`` or ``.count``. Raises RuleError for a wrong call."""
    goal = action.args[-2] if len(action.args) == (2 if action.functor == ".count" else 3) else None
    if isinstance(goal, Atom):
        goal = literal(goal.name)
    if not isinstance(goal, Condition):
        raise RuleError(f"the arguments of {action} are wrong", remedy="see docs/semantics.md")
    return goal


def collected(f: Function, action: Literal) -> str:
    """Return the expression of all solutions of the condition in an action, or of their count."""
    counts = action.functor == ".count"
    name, arguments, _ = query(f, collected_goal(action), None if counts else action.args[0])
    found = f.unit.name("l")
    if counts:
        f.line(f"{found} = sum(1 for _ in {name}({arguments}))")
    elif action.functor == ".setof":
        f.line(f"{found} = tuple(sorted(set({name}({arguments})), key=order))")
    else:
        f.line(f"{found} = tuple({name}({arguments}))")
    return found
