"""Compile conditions to nested loops and ifs around the code that follows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext

from socialbot.bdi.compiler._beliefs import Lookup, loop, needs_unification, stored
from socialbot.bdi.compiler._dynamic import COLLECTORS, embeds
from socialbot.bdi.compiler._source import CELL, VALUE, Function, Scope, tuple_of
from socialbot.bdi.compiler._terms import build, build_pattern, has_cell, has_value, match, settled, value
from socialbot.bdi.literals import Event, Literal, ground, literal
from socialbot.bdi.stdlib import called
from socialbot.bdi.steps import Step
from socialbot.bdi.terms import (
    Aggregate,
    Atom,
    Call,
    Comparison,
    Computation,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    FunctionCondition,
    Holds,
    LiteralVariable,
    Negation,
    Truth,
    Variable,
    names_in,
)
from socialbot.core.errors import RuleError

MOST_LOOPS = 10
MOST_BLOCKS = 50
"""Depth at which a new function starts. Python allows 20 nested loops and 100 nested blocks."""

ORDERS = ("<", "<=", ">", ">=")

_IMPURE = {"math.random", "system.time"}
"""Functions whose value changes without a change of beliefs."""

_PURE = {
    ".atom", ".concat", ".delete", ".difference", ".empty", ".ground", ".intersection", ".length", ".list", ".literal",
    ".lower_case", ".max", ".member", ".min", ".nth", ".number", ".prefix", ".range", ".reverse", ".sort", ".string",
    ".structure", ".sublist", ".substring", ".suffix", ".term2string", ".union", ".upper_case", ".var",
}  # fmt: skip
"""Internal actions whose solutions depend on their arguments alone."""

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
    elif isinstance(condition, Holds):
        holds(f, condition, rest)
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
    if f.unit.library.derives(pattern.key) or has_cell(f, pattern) or needs_unification(pattern):
        solve(f, pattern, rest)
    else:
        stored(f, pattern, rest)


def holds(f: Function, condition: Holds, rest: Rest) -> None:
    """Emit the loop over the solutions of a condition that is the value of a variable."""
    with loop(f, f"solutions_of(ag, {build(f, condition.what)}, trail)"):
        rest()


def solve(f: Function, pattern: Literal, rest: Rest) -> None:
    """Emit the loop over solutions of derived beliefs, or of arguments with unbound variables."""
    fresh = names_in(pattern) - f.scope.keys() - {"_"}
    args, notes = build_pattern(f, pattern.args), build_pattern(f, pattern.annotations)
    cells = f.save(fresh)
    with loop(f, f"ag.solve({pattern.key!r}, {args}, {notes}, trail)"):
        f.resolve(fresh, CELL if f.unit.library.is_open(pattern.key) else VALUE, cells)
        rest()


def negation(f: Function, inner: Condition, rest: Rest) -> None:
    lookup = exact_lookup(f, inner)
    if lookup is not None:
        test = lookup.test(negated=True)
    else:
        name, arguments, _ = query(f, inner)
        test = f"not holds({name}({arguments}), trail)"
    with f.block(f"if {test}"):
        rest()


def exact_lookup(f: Function, condition: object) -> Lookup | None:
    """Return the lookup of the stored beliefs that match a condition; None if it takes more than a lookup."""
    if not isinstance(condition, Literal) or "." in condition.functor or condition.annotations:
        return None
    if f.unit.library.derives(condition.key) or has_cell(f, condition) or needs_unification(condition):
        return None
    lookup = Lookup(f, condition)
    return lookup if lookup.exact else None


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
    f: Function,
    condition: Condition,
    template: object = None,
    also: Iterable[str] = (),
    *,
    once: bool = False,
) -> tuple[str, str, Scope]:
    """Emit a function that yields a tuple of new variable values for each solution.

    A ``template`` replaces the tuple. ``also`` are unbound variables that get values, too. With ``once`` the function
    returns the tuple of the first solution, or None. Returns the name of the function, its arguments, and the new
    variables with their states.
    """
    f.unit.nest()
    used = sorted(((names_in(condition) | names_in(template)) & f.scope.keys()) - {"_"})
    inner = f.unit.function("q", ["ag", "trail", *(f.local(name) for name in used)], {n: f.scope[n] for n in used})
    inner.line(_MARK)
    give = "return" if once else "yield"
    branches = condition.terms if isinstance(condition, Disjunction) else (condition,)
    scopes = [_branch(inner, branch, dry=True) for branch in branches]
    fresh = {name: joined_state(name, *scopes) for scope in scopes for name in scope if name not in used}
    fresh |= {name: CELL for name in also if name in used}
    fresh = dict(sorted(fresh.items()))
    if not f.unit.dry:
        for branch in branches:
            _branch(inner, branch, fresh=fresh, template=template, give=give)
    f.unit.unnest()
    inner.line(_UNDO)
    if not any("trail" in text for _, text, _ in inner.lines if text not in (_MARK, _UNDO)):
        inner.lines = [line for line in inner.lines if line[1] not in (_MARK, _UNDO)]
    return inner.name, ", ".join(["ag", "trail", *(f.local(name) for name in used)]), fresh


_MARK, _UNDO = "mark = len(trail)", "undo(trail, mark)"


def _branch(
    f: Function,
    condition: Condition,
    *,
    fresh: Scope | None = None,
    template: object = None,
    dry: bool = False,
    give: str = "yield",
) -> Scope:
    """Emit one branch; return the states of its variables. A dry run emits nothing."""
    scope, lines, functions = dict(f.scope), len(f.lines), len(f.unit.functions)
    f.unit.dry += dry
    found: Scope = {}

    def solved() -> None:
        found.update(f.scope)
        if dry:
            return
        if template is not None:
            f.line(
                f"{give} {build(f, template)}" if has_value(f, template) else f"{give} resolve({build(f, template)})"
            )
        else:
            for name in fresh or {}:
                build(f, Variable(name))
            given = (f"resolve({f.local(name)})" if f.scope[name] == CELL else f.local(name) for name in fresh or {})
            f.line(f"{give} {tuple_of(given)}")

    f.line(_UNDO)
    with f.block("for _ in ONCE"):
        f.loops = 1
        write(f, condition, "continue", solved)
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
        if isinstance(right, Aggregate) and right.kind in ("min_of", "max_of"):
            found = f.unit.name("t")
            f.line(f"{found} = aggregate({right.kind!r}, {aggregated(f, right)}, None)")
            f.line(f"if {found} is None: {fail}")
            match(f, left, found, fail)
            rest()
            return
        if not settled(f, right) and settled(f, left):
            left, right = right, left
        if may_be_plans(f, left, right):
            agree_as_plans(f, left, right, fail)
        elif settled(f, right):
            match(f, left, value(f, right), fail)
        else:
            assigns = any(isinstance(each, Variable) and each.name not in f.scope for each in (left, right))
            made = [(build if assigns else build_pattern)(f, each) for each in (left, right)]
            f.line(f"if not unify({made[0]}, {made[1]}, trail): {fail}")
        rest()
        return
    if condition.symbol == "=..":
        test = f"univ({build(f, left)}, {build_pattern(f, right)}, trail)"
    elif f.unit.lenient and condition.symbol in ORDERS:
        order_test(f, condition, fail)
        rest()
        return
    else:
        test = test_of(f, condition)
    with f.block(f"if {test}"):
        rest()


def may_be_plans(f: Function, left: object, right: object) -> bool:
    """Whether two known values may be plans or steps, which agree by their text or parts, not as objects."""
    if not isinstance(left, Variable):
        return embeds(left)
    return f.scope.get(left.name) == VALUE and (embeds(right) or (f.unit.lenient and isinstance(right, Variable)))


def agree_as_plans(f: Function, left: object, right: object, fail: str, step: Step | None = None) -> None:
    """Emit the unification of two known values that may be plans."""
    one, two = build_pattern(f, left), build_pattern(f, right)
    differ = f"{one} != {two} and " if isinstance(left, Variable) and isinstance(right, Variable) else ""
    f.line(f"if {differ}not unify({one}, {two}, trail): {fail}", step)


def order_test(f: Function, condition: Comparison, fail: str, step: Step | None = None) -> None:
    """Emit a comparison that may be one of different types, or of variables without values."""
    left, right, symbol = operand(f, condition.left), operand(f, condition.right), condition.symbol
    f.line("try:")
    f.line(f"    if not ({left} {symbol} {right}): {fail}", step)
    f.line("except TypeError:")
    f.line(f"    if not ordered({left}, {symbol!r}, {right}): {fail}", step)


def operand(f: Function, term: object) -> str:
    """Return the expression of a term; its variables need no values."""
    return value(f, term) if settled(f, term) else f"resolve({build(f, term)})"


def test_of(f: Function, condition: Comparison) -> str:
    """Return the expression of a comparison; ``==`` and ``!=`` compare unbound variables, too."""
    left, right, symbol = condition.left, condition.right, condition.symbol
    if symbol in ("==", "!=") and f.unit.lenient and not (settled(f, left) and settled(f, right)):
        return f"{'not ' if symbol == '!=' else ''}same({build(f, left)}, {build(f, right)})"
    plans = any(embeds(each) or isinstance(each, Event) for each in (left, right))
    plans = plans or (isinstance(left, Variable) and isinstance(right, Variable))
    if symbol in ("==", "!=") and f.unit.lenient and plans:
        one, two = value(f, left), value(f, right)
        equal = f"({one} == {two} or same({one}, {two}))"
        return equal if symbol == "==" else f"not {equal}"
    return f"{value(f, left)} {symbol} {value(f, right)}"


def internal(f: Function, condition: Literal, fail: str, rest: Rest) -> None:
    if condition.functor in COLLECTORS:
        result = condition.args[0 if condition.functor == ".eval" else -1]
        match(f, result, collected(f, condition), fail)
        rest()
        return
    entry = called(condition, condition=True)
    if condition.functor == ".fail":  # false, where a step fails its plan
        with f.block("if False"):
            rest()
        return
    fresh = names_in(condition) - f.scope.keys() - {"_"}
    args = build(f, condition.args)
    test = f"{f.unit.constant(entry.function)}(ag.engine, {args}, trail)"
    cells = f.save(fresh)
    with loop(f, test) if entry.many else f.block(f"if {test} is not False"):
        f.resolve(fresh, VALUE if entry.binds else CELL, cells)
        rest()


def aggregated(f: Function, term: Aggregate) -> str:
    """Return the expression of the values of an aggregate, and of their number for ``count``."""
    every = all_of(f, term.condition, None if term.kind == "count" else term.template)
    if every is not None:
        return every
    name, arguments, _ = query(f, term.condition, True if term.kind == "count" else term.template)
    return f"sum({name}({arguments}))" if term.kind == "count" else f"{name}({arguments})"


def all_of(f: Function, condition: Condition, template: object) -> str | None:
    """Return the tuple of a variable in all beliefs that match a condition, or without a template their number.

    The result is None if this takes more than a lookup.
    """
    if isinstance(condition, Conjunction) and len(condition.terms) == 1:
        (condition,) = condition.terms
    if f.unit.dry or (template is not None and not isinstance(template, Variable)):
        return None
    lookup = exact_lookup(f, condition)
    if lookup is None:
        return None
    if not isinstance(template, Variable):
        return lookup.count()
    position = None if template.name in f.unit.symbols else lookup.position(template.name)
    return None if position is None else f"tuple([f[{position}] for f in {lookup.newest_first()}])"


def collected_goal(action: Literal) -> Condition:
    """Return the condition of ``.findall``, ``.setof``, ``.count`` or ``.eval``. Raises RuleError for a wrong call."""
    goal = action.args[-2] if len(action.args) == (2 if action.functor in (".count", ".eval") else 3) else None
    if action.functor == ".eval" and goal is not None:
        goal = action.args[1]
    if isinstance(goal, Atom):
        goal = Truth(goal.name == "true") if goal.name in ("true", "false") else literal(goal.name)
    if isinstance(goal, (Variable, LiteralVariable)):
        goal = Holds(goal)
    if not isinstance(goal, Condition):
        raise RuleError(f"the arguments of {action} are wrong", remedy="see docs/semantics.md")
    return goal


def collected(f: Function, action: Literal) -> str:
    """Emit the search for all solutions of the condition in an action; return the local with them, or their count."""
    counts, tests, sorts = (action.functor == name for name in (".count", ".eval", ".setof"))
    goal, template = collected_goal(action), None if counts or tests else action.args[0]
    every = None if tests else all_of(f, goal, template)
    if every is None:
        name, arguments, _ = query(f, goal, template)
        every = f"{name}({arguments})"
        if tests:
            true, false = f.unit.constant(Atom("true")), f.unit.constant(Atom("false"))
            every = f"{true} if holds({every}, trail) else {false}"
        elif counts:
            every = f"sum(1 for _ in {every})"
        elif not sorts:
            every = f"tuple({every})"
    found = f.unit.name("l")
    f.line(f"{found} = tuple(sorted(set({every}), key=order))" if sorts else f"{found} = {every}")
    return found


# Dependencies


class _DependsOnMoreError(Exception):
    """The truth of a condition also depends on other things than beliefs, such as the time."""


def beliefs_in(part: object) -> list[Literal] | None:
    """Beliefs in a condition or term; None if its truth also depends on other things, such as the time."""
    try:
        return list(_beliefs_in(part))
    except _DependsOnMoreError:
        return None


def _beliefs_in(part: object) -> Iterator[Literal]:
    if isinstance(part, Negation):
        yield from _beliefs_in(part.condition)
    elif isinstance(part, (Conjunction, Disjunction)):
        for each in part.terms:
            yield from _beliefs_in(each)
    elif isinstance(part, Comparison):
        yield from _beliefs_in_terms((part.left, part.right))
    elif isinstance(part, Literal) and "." not in part.functor:
        yield part
        yield from _beliefs_in_terms((*part.args, *part.annotations))
    elif isinstance(part, Literal) and part.functor in COLLECTORS:
        yield from _beliefs_in(collected_goal(part))
        yield from _beliefs_in_terms(part.args)
    elif isinstance(part, Literal) and part.functor in _PURE:
        yield from _beliefs_in_terms(part.args)
    elif not isinstance(part, Truth):
        raise _DependsOnMoreError


def _beliefs_in_terms(terms: Iterable[object]) -> Iterator[Literal]:
    """Beliefs in the function calls of terms."""
    for term in terms:
        if isinstance(term, Aggregate):
            yield from _beliefs_in(term.condition)
            yield from _beliefs_in_terms((term.template,))
        elif isinstance(term, Call) and term.function == ".count":
            for each in term.args:
                yield from _beliefs_in(each)
        elif isinstance(term, Computation) or (isinstance(term, Call) and term.function in _IMPURE):
            raise _DependsOnMoreError
        elif isinstance(term, Call):
            yield from _beliefs_in_terms(term.args)
        elif isinstance(term, Expression):
            yield from _beliefs_in_terms((term.left, term.right))
        elif isinstance(term, Cons):
            yield from _beliefs_in_terms((*term.items, term.tail))
        elif isinstance(term, tuple):
            yield from _beliefs_in_terms(term)
        elif isinstance(term, Literal):
            yield from _beliefs_in_terms((*term.args, *term.annotations))


def dependencies(f: Function, condition: Condition, known: Scope) -> str:
    """Return the expression of the beliefs in a condition: their keys and the arguments ``known`` before it."""
    beliefs = beliefs_in(condition)
    if beliefs is None:
        return "None"
    patterns = (
        f"({belief.key!r}, {tuple_of(_known_or_any(f, arg, known) for arg in belief.args)})" for belief in beliefs
    )
    return tuple_of(dict.fromkeys(patterns))


def _known_or_any(f: Function, arg: object, known: Scope) -> str:
    if isinstance(arg, Variable):
        return f.local(arg.name) if arg.name in known else "ANY"
    return f.unit.constant(arg) if ground(arg) else "ANY"
