"""Plans: ``event / condition >> [steps]``, with the steps for an event under a condition.

Both the operators of this package and AgentSpeak text create plans.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import PurePath
from types import FrameType
from typing import Any, ClassVar

from socialbot.bdi._rule_checks import check_action, check_change, check_condition, check_event, check_values
from socialbot.bdi.aggregates import needed_names
from socialbot.bdi.literals import Belief, Change, Event, Goal, Literal, Structure, Symbolic, literal
from socialbot.bdi.steps import (
    Achieve,
    Action,
    Ask,
    Await,
    Constrain,
    Do,
    Enter,
    For,
    Forget,
    Fork,
    If,
    Scoped,
    Step,
    Update,
    While,
)
from socialbot.bdi.terms import (
    NOTHING,
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
    Holds,
    LiteralVariable,
    Negation,
    Pattern,
    Rest,
    Term,
    Truth,
    Variable,
    show,
    written_condition,
)
from socialbot.core.errors import RuleError


@dataclass(frozen=True)
class Origin:
    """Source location of a plan: the name of the text and the line, from 1."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


def origin_in_python(module: str) -> Origin | None:
    """Return the place of the rule that calls functions of ``module`` now; None outside any file.

    The file is relative to the folder of its outermost package, so that it is the same on all machines.
    """
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__") == module:
        frame = frame.f_back
    if frame is None or frame.f_code.co_filename.startswith("<"):
        return None
    path, name = PurePath(frame.f_code.co_filename), str(frame.f_globals.get("__name__"))
    packages = 0 if name == "__main__" else name.count(".") + (path.stem == "__init__")
    return Origin("/".join(path.parts[-packages - 1 :]), frame.f_lineno)


@dataclass(frozen=True, eq=False)
class KnownPlan:
    """Plan of the library that a copy with other names of variables stands for, and its label as a term."""

    plan: Plan
    label: Literal


@dataclass(eq=False, repr=False)
class Plan:
    """Plan for ``event``: its steps are ``body``, executed if ``condition`` holds.

    Among the applicable plans the engine selects the first one with the highest ``priority``. A plan with a ``stage``
    only applies in that stage. An ``atomic`` plan excludes other intentions until its end. ``annotations`` are those of
    the label without a meaning to the engine; ``text`` is its AgentSpeak source, if any. ``inner`` are its inner plans,
    ``until`` is its goal condition. A ``stepwise`` plan ends its turn after each step.
    """

    event: Event
    condition: Conjunction
    body: tuple[Step, ...]
    label: str | None = None
    atomic: bool = False
    priority: int = 0
    stage: str | None = None
    annotations: tuple[object, ...] = ()
    origin: Origin | None = None
    text: str | None = None
    inner: tuple[Plan, ...] = ()
    until: Conjunction | None = None
    stepwise: bool = False

    known: ClassVar[KnownPlan | None] = None
    """Set by copies that are values, such as those of ``.relevant_plans``."""

    def check(self) -> Plan:
        """Return the plan. Raises RuleError for a plan that can never run.

        In AgentSpeak, a variable without a value fails its step instead.
        """
        head = self.event.literal
        try:
            check_event(self.event)
            if isinstance(head, Literal):
                check_values(head)
        except RuleError as problem:
            raise _located(problem, self) from None
        computed = isinstance(head, Literal) and any(
            isinstance(arg, Term) and not isinstance(arg, (Variable, Cons, LiteralVariable)) for arg in head.args
        )
        if computed:
            raise RuleError(
                f"{self.event} computes in its arguments", where=str(self), remedy="compare in the condition instead"
            )
        checker = _Checker(self, strict=self.text is None)
        checker.check()
        self.__dict__["checked"] = checker  # `open_changes` takes it
        return self

    @property
    def place(self) -> str:
        """Where the plan is, for error messages: its line in AgentSpeak text, or else the plan itself."""
        return str(self) if self.origin is None or self.text is None else str(self.origin)

    def __copy__(self) -> Plan:
        twin = object.__new__(type(self))
        twin.__dict__.update(vars(self))
        for found in ("checked", "contents"):
            twin.__dict__.pop(found, None)  # the copy may get other parts
        return twin

    def same_text(self, other: Plan) -> bool:
        """Whether another plan is written alike; two plans as terms are equal then."""
        from socialbot.bdi.agentspeak.printer import agentspeak

        mine, theirs = (each.known.plan if each.known else each for each in (self, other))
        return agentspeak(mine.without_truth()) == agentspeak(theirs.without_truth())

    def as_structure(self) -> Literal:
        """Return the plan as ``plan(Label, Event, Condition, Body)``."""
        from socialbot.bdi.compiler._dynamic import plan_parts

        return literal("plan", plan_parts(self))

    def without_truth(self) -> Plan:
        """Return the plan without the condition ``true``, which says nothing."""
        always = all(isinstance(term, Truth) and term.value for term in self.condition.terms)
        return replace(self, condition=NOTHING) if always else self

    def __str__(self) -> str:
        if self.text is not None:
            return self.text
        condition = f" / ({written_condition(self.condition)})" if self.condition.terms else ""
        return f"{self.event}{condition} >> [{', '.join(map(str, self.body))}]"


@dataclass(eq=False, repr=False)
class Inference:
    """Inference of ``head`` from ``condition`` (AgentSpeak: ``head :- condition``)."""

    head: Literal
    condition: Conjunction
    origin: Origin | None = None
    text: str | None = None

    def check(self) -> Inference:
        """Return the inference. Raises RuleError for one that can never hold."""
        _Checker(self, strict=self.text is None).check()
        return self

    def _unjoined(self, *_: object) -> Any:
        raise RuleError(
            f"{self} is complete before the & or | after it",
            remedy=f"put the whole condition in parentheses: {self.head} << (a & b)",
        )

    __and__ = __or__ = _unjoined

    def __str__(self) -> str:
        return self.text or f"{self.head} << ({written_condition(self.condition)})"


def atomic(*plans: Plan | list[Plan]) -> list[Plan]:
    """Make plans atomic: they exclude other intentions until their end."""
    return [replace(plan, atomic=True) for plan in flat(plans)]


def priority(rank: int, *plans: Plan | list[Plan]) -> list[Plan]:
    """Set the priority of plans; higher values are tried first."""
    if not isinstance(rank, int) or isinstance(rank, bool):
        raise RuleError(f"{show(rank)} is not a priority", remedy="write priority(2, plan, ...)")
    return [replace(plan, priority=rank) for plan in flat(plans)]


def stage(name: str, *plans: Plan | list[Plan]) -> list[Plan]:
    """Limit plans to a stage; the step `enter` begins it."""
    if not isinstance(name, str):
        raise RuleError(f"{show(name)} is not the name of a stage", remedy='write stage("night", plan, ...)')
    return [replace(plan, stage=name) for plan in flat(plans)]


def labelled(label: str, plan: Plan) -> Plan:
    """Set the label of a plan, its name for removal and explanations."""
    if not isinstance(label, str) or not isinstance(plan, Plan):
        raise RuleError(
            f"labelled({show(label)}, {show(plan)}) is not a label and a plan", remedy='write labelled("name", plan)'
        )
    return replace(plan, label=label)


def flat(items: Iterable[object]) -> Iterator[Plan]:
    """Flatten nested lists of plans. Raises RuleError for other items."""
    for item in items:
        if isinstance(item, Plan):
            yield item
        elif isinstance(item, (list, tuple)):
            yield from flat(item)
        else:
            raise RuleError(f"{item!r} is not a plan", remedy="write event / condition >> [steps]")


def parts_of(item: object) -> tuple[object, ...]:
    """Direct parts of a plan, step, condition or term, or the items of a tuple."""
    if isinstance(item, tuple):
        return item
    if isinstance(item, Literal):
        return (*item.args, *item.annotations)
    return tuple(vars(item).values()) if isinstance(item, (Pattern, Step, Plan, Inference)) else ()


def nodes_of(item: object) -> list[Any]:
    """The item and all parts of it, at any depth, that have parts themselves."""
    found = [item]
    for each in found:  # it grows
        kind = each.__class__
        if kind is tuple:
            inner: Any = each
        elif isinstance(each, Literal):
            inner = each.args + each.annotations if each.annotations else each.args
        else:
            inner = vars(each).values()
        for part in inner:
            if part.__class__ not in LEAVES and _has_parts(part.__class__):
                found.append(part)  # noqa: PERF401 - faster than a comprehension for few parts
    return found


LEAVES = frozenset({str, bool, int, float, type(None), Atom, Variable})
"""Classes of the most frequent terms without parts."""


@cache
def _has_parts(kind: type) -> bool:
    return issubclass(kind, (tuple, Pattern, Step, Plan, Inference))


def symbol_variables(part: object) -> set[str]:
    """Names of the variables of a plan in places for names, such as ``S`` in ``source(S)``."""
    symbolic = (each for each in nodes_of(part) if isinstance(each, Symbolic))
    return {arg.name for each in symbolic for arg in each.args[: each.symbols] if isinstance(arg, Variable)}


def beliefs_in(part: object) -> Iterator[Belief]:
    """Beliefs in a plan, an inference, a part of them, or a tuple of parts."""
    if isinstance(part, Event) and part.change is Change.CHANGED:
        changed = part.literal
        part = changed.with_(args=changed.args[: len(changed.args) // 2])  # the others are those before
    if isinstance(part, Belief):
        yield part
    for inner in parts_of(part):
        yield from beliefs_in(inner)


def beliefs_by_name(rules: tuple[object, ...]) -> dict[str, list[Belief]]:
    """Beliefs in plans and inferences, by their names."""
    found: dict[str, list[Belief]] = {}
    for belief in beliefs_in(rules):
        found.setdefault(belief.functor, []).append(belief)
    return found


@dataclass(frozen=True)
class Contents:
    """What a plan or inference contains.

    ``kinds`` are the classes of its beliefs and goals, ``internal`` the names of its internal actions, ``rules`` the
    keys of the beliefs that follow from inferences in its steps, and ``calls`` the internal actions, the functions and
    the plans in the condition and the body of a plan.
    """

    kinds: tuple[type[Literal], ...]
    internal: tuple[str, ...]
    rules: tuple[str, ...]
    calls: tuple[Literal | Call | Plan, ...]


def contents_of(item: Plan | Inference) -> Contents:
    """Return what a plan or inference contains."""
    known = item.__dict__.get("contents")
    if known is None:
        kinds: list[type[Literal]] = []
        internal: list[str] = []
        rules: list[str] = []
        calls: list[Literal | Call | Plan] = []
        if isinstance(item, Inference):
            outside, inside = nodes_of(item), []
        else:
            outside = nodes_of((item.event, item.annotations, item.inner, item.until))
            inside = nodes_of((item.condition, item.body))
        for nodes in (outside, inside):
            for node in nodes:
                kind = node.__class__
                if kind is tuple:
                    continue
                if isinstance(node, Literal):
                    if kind is not Structure and isinstance(node, (Belief, Goal)):
                        kinds.append(kind)
                    if "." in node.functor:
                        if nodes is inside:
                            calls.append(node)
                        if node.functor[0] == ".":
                            internal.append(node.functor)
                elif kind is Inference and node is not item:
                    rules.append(node.head.key)
                elif nodes is inside and (kind is Call or kind is Plan):
                    calls.append(node)
        known = Contents(tuple(kinds), tuple(internal), tuple(rules), tuple(calls))
        item.__dict__["contents"] = known
    return known


def unbound_in(item: Plan | Inference) -> list[tuple[str, object]]:
    """Return the names of variables without a value at their use, each with the step or condition that uses them."""
    checker = _Checker(item, strict=False)
    checker.check()
    return checker.found


def open_changes(plan: Plan) -> list[Literal]:
    """Return the beliefs that a plan in AgentSpeak adds or tells with variables that have no value."""
    if plan.text is None:
        return []
    checker = plan.__dict__.pop("checked", None)
    if checker is None:
        checker = _Checker(plan, strict=False)
        checker.check()
    steps = [where for _, where in checker.found if isinstance(where, Update)]
    added = [step.literal for step in steps if step.sign in ("+", "-+", "++") and isinstance(step.literal, Literal)]
    return added + checker.told


def unbound_result(rule: Inference, open_keys: Collection[str]) -> bool:
    """Check whether a belief may follow with a variable without a value; ``open_keys`` are beliefs that may."""
    names = rule.head.with_(annotations=()).names()
    if not names:
        return False
    return not names <= _Checker(rule, strict=False, open_keys=open_keys).condition(rule.condition, set())


def _located(problem: RuleError, rule: Plan | Inference) -> RuleError:
    """Return the error of a check with the rule as its place."""
    return RuleError(problem.what, where=problem.where or str(rule), remedy=problem.remedy)


class _Checker:
    """Check that each variable has a value at its use. The methods return the names with a value afterwards."""

    def __init__(self, rule: Plan | Inference, *, strict: bool, open_keys: Collection[str] = ()) -> None:
        self.rule = rule
        self.strict = strict
        self.open_keys = open_keys
        self.found: list[tuple[str, object]] = []
        self.told: list[Literal] = []  # contents of messages with variables that have no value

    def check(self) -> None:
        rule = self.rule
        try:
            if isinstance(rule, Plan):
                self.body(rule.body, self.condition(rule.condition, rule.event.literal.names() - {"_"}))
            else:
                self.condition(rule.condition, rule.head.names() - {"_"})
        except RuleError as problem:
            raise _located(problem, rule) from None

    def condition(self, condition: Condition, bound: set[str]) -> set[str]:
        match condition:
            case Conjunction():
                for term in condition.terms:
                    bound = self.condition(term, bound)
            case Disjunction():
                return set.intersection(*(self.condition(term, bound) for term in condition.terms))
            case Negation():
                self.condition(condition.condition, bound)
            case Literal(key=key) if key in self.open_keys:
                return bound
            case Literal():
                if "." not in condition.functor or not isinstance(condition, Structure):
                    check_condition(condition)  # internal actions take conditions
                return self.pattern((*condition.args, *condition.annotations), bound, condition)
            case Holds(what=what):
                return self.pattern((what,), bound, condition)
            case Comparison(symbol="=" | "=.."):
                return self.pattern((condition.left, condition.right), bound, condition)
            case Comparison(symbol="==" | "!=") if not self.strict:
                pass  # free variables are the same only as themselves
            case Comparison():
                self.value((condition.left, condition.right), bound, condition)
            case _:
                self.bound(condition.names() - bound, condition)
        return bound

    def value(self, term: object, bound: set[str], where: object) -> None:
        """Check a term that is computed."""
        self.bound(needed_names(term) - bound, where)
        self.aggregates(term, bound, where)

    def aggregates(self, term: object, bound: set[str], where: object) -> None:
        match term:
            case Aggregate():
                self.value(term.template, self.condition(term.condition, bound), term)
            case tuple() | Expression() | Literal() | Cons():
                for part in parts_of(term):
                    self.aggregates(part, bound, where)

    def pattern(self, terms: tuple[object, ...], bound: set[str], where: object) -> set[str]:
        for term in terms:
            match term:
                case Variable():
                    if term.name != "_" and term.name not in bound:
                        bound = bound | {term.name}
                case Expression() | Computation() | Aggregate():
                    self.value(term, bound, where)
                case tuple():
                    bound = self.pattern(term, bound, where)
                case Cons():
                    bound = self.pattern((*term.items, term.tail), bound, where)
                case LiteralVariable():
                    bound = self.pattern((term.variable, *term.annotations, term.namespace), bound, where)
                case Rest():
                    bound = self.pattern((term.tail,), bound, where)
                case Literal():
                    bound = self.pattern((*term.args, *term.annotations), bound, where)
        return bound  # The variables in the query of an AgentSpeak function are its own.

    def body(self, body: tuple[Step, ...], bound: set[str]) -> set[str]:
        for step in body:
            self.literals(step, bound)
            bound = self.step(step, bound)
        return bound

    def step(self, step: Step, bound: set[str]) -> set[str]:
        match step:
            case Ask(query=Variable() | LiteralVariable()) | Enter():
                return bound
            case Do(action=Term() as part) | Achieve(goal=Term() as part):
                return self.pattern((part,), bound, step)
            case Update(literal=Inference()):
                return bound
            case Do(action=Condition() as part) if not isinstance(part, Literal):
                return self.condition(part, bound)
            case Update(literal=LiteralVariable() as part):
                self.value(part.variable, bound, step)
                return self.pattern(part.annotations, bound, step)
            case Ask(query=Condition() as part) | Constrain(condition=part) | Await(what=Condition() as part):
                return self.condition(part, bound)
            case Await(what=Event(literal=Literal() as literal)):
                return self.pattern(literal.args, bound, step)
            case Await(what=Event(literal=part)):
                return self.pattern((part,), bound, step)
            case Achieve(goal=Literal() as goal, apart=False):
                return self.pattern(goal.args, bound, step)
            case Update(sign="-" | "--", literal=Literal() as literal):
                return self.pattern(literal.args, bound, step)
            case Do(action=Structure() as action) if "." not in action.functor:
                return self.pattern((*action.args, *action.annotations), bound, step)  # unbound ones are results
            case Do(action=Literal() as action) if "." in action.functor:
                if action.functor in (".send", ".broadcast"):
                    contents = [each for arg in action.args for each in (arg if isinstance(arg, tuple) else (arg,))]
                    self.told += [each for each in contents if isinstance(each, Literal) and each.names() - bound]
                return bound | action.names()
            case Achieve(goal=Pattern() as part) | Update(literal=Pattern() as part) | Do(action=part):
                self.value(part, bound, step)
            case Forget():
                self.bound(step.literal.names() - bound - {"_"}, step)
            case If():
                then = self.body(step.then, self.condition(step.condition, bound))
                return then & self.body(step.otherwise, bound) | bound
            case While() | For():
                self.body(step.body, self.condition(step.condition, bound))
            case Fork():
                for branch in step.branches:
                    bound = bound | self.body(branch, bound)
            case Scoped():
                if step.until is not None:
                    self.condition(step.until, bound)
                return self.body(step.body, bound)
        return bound

    def literals(self, step: Step, known: set[str]) -> None:
        match step:
            case Do(action=Action() as action):
                check_action(action, known)
            case Do(action=Structure() as action) if "." in action.functor:
                pass  # internal actions take conditions
            case Do(action=Literal() as literal) | Achieve(goal=Literal() as literal):
                check_values(literal)
            case Update(literal=Literal() as literal) | Forget(literal=literal):
                check_change(literal)
            case Await(what=Event() as event):
                check_event(event)

    def bound(self, unbound: set[str], where: object) -> None:
        if unbound:
            self.found.append((", ".join(sorted(unbound)), where))
        if unbound and self.strict:
            raise RuleError(
                f"{', '.join(sorted(unbound))} has no value in {where!s}",
                remedy="name the variable in the event, or in a belief of the condition before it",
            )
