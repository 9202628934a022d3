"""Load AgentSpeak text into an engine; a text with a mistake changes nothing.

>>> from socialbot.bdi import Engine
>>> from socialbot.core.clock import ManualClock
>>> engine = Engine("cat", ManualClock())
>>> load(engine, "hungry. +hungry <- .my_name(N); .print(N, ' is hungry').")
>>> engine.run_until_idle()
[cat] cat is hungry
False
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.parser import Program, parse
from socialbot.bdi.belief_base import is_source
from socialbot.bdi.compiler._conditions import COLLECTORS
from socialbot.bdi.compiler._plans import compile_inference, compile_plan
from socialbot.bdi.compiler._runtime import FUNCTIONS, div, mod
from socialbot.bdi.intentions import OPEN, SUBGOAL, Failed
from socialbot.bdi.library import CompiledInference, CompiledPlan, Library
from socialbot.bdi.literals import SELF, Literal, ground
from socialbot.bdi.plans import Inference, Origin, Plan
from socialbot.bdi.stdlib import find
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, For, Fork, If, Step, Update, While
from socialbot.bdi.terms import (
    Atom,
    Call,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    Negation,
    Pattern,
)
from socialbot.bdi.unification import closed
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError, SocialbotError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine

_WORD = re.compile(r"\.?\w+(?:\.\w+)*")


def load(engine: Engine, text: str, file: str = "<text>") -> None:
    """Add the rules, plans, beliefs and goals of a text. Raises AgentSpeakError, and adds nothing, for a mistake."""
    program = parse(text, file)
    problems = problems_of(program, text, file, engine.library, check_plan=_look_over)
    if problems:
        raise problems[0]
    for inference in program.inferences:
        engine.add_rules(inference)
    for plan in program.plans:
        engine.add_rules(plan)
    begin(engine, program)


def library_of(program: Program) -> Library:
    """Build a library of the rules and plans of a program, for several agents to share."""
    library = Library()
    for inference in program.inferences:
        library.add_inference(inference)
    for plan in program.plans:
        library.add(plan)
    return library


def begin(engine: Engine, program: Program) -> None:
    """Add the initial beliefs and goals of a program."""
    # Queries try the newest belief first, so reversed insertion preserves the order of the text.
    for belief in reversed(program.beliefs):
        args, notes = _evaluated(engine, belief.args), _evaluated(engine, belief.annotations)
        engine.interpreter.post((engine.beliefs.relation(belief.key), args, _with_source(notes), "", None))
    for goal in program.goals:
        variables: dict[str, Any] = {}
        args = opened(_evaluated(engine, goal.args), variables)
        notes = opened(_evaluated(engine, goal.annotations), variables)
        engine.interpreter.post(_InitialGoal(engine, goal.key, args, _with_source(notes)))


class _InitialGoal:
    """Event that adopts an initial goal after the events of the initial beliefs."""

    mental = True
    """A restored mental state replaces pending objects of this class."""

    def __init__(self, engine: Engine, key: str, args: tuple[Any, ...], notes: tuple[Any, ...]) -> None:
        self.engine = engine
        self.key = key
        self.args = args
        self.notes = notes

    def __call__(self) -> None:
        trigger = self.engine.library.triggers[f"+!{self.key}"]
        if closed(self.args):
            self.engine.interpreter.events.append((trigger, self.args, self.notes, ""))
        else:
            self.engine.intentions.adopt((SUBGOAL | OPEN, trigger, self.args, self.notes, ""))


def _with_source(notes: tuple[Any, ...]) -> tuple[Any, ...]:
    return notes if any(map(is_source, notes)) else notes + SELF


# Arithmetic

_OPERATORS = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "//": lambda left, right: left // right,
    "%": lambda left, right: left % right,
    "**": lambda left, right: left**right,
    "div": div,
    "mod": mod,
}


def _evaluated(engine: Engine, term: Any) -> Any:
    """Evaluate the arithmetic in a term; variables stay."""
    if ground(term):
        return term
    if isinstance(term, tuple):
        return tuple(_evaluated(engine, item) for item in term)
    if isinstance(term, Cons):
        return Cons(_evaluated(engine, term.items), _evaluated(engine, term.tail))
    if isinstance(term, Expression):
        return _OPERATORS[term.symbol](_evaluated(engine, term.left), _evaluated(engine, term.right))
    if isinstance(term, Call):
        return FUNCTIONS[term.function](engine, *(_evaluated(engine, arg) for arg in term.args))
    if isinstance(term, Literal):
        args, notes = _evaluated(engine, term.args), _evaluated(engine, term.annotations)
        return term.with_(args=args, annotations=notes)
    return term


# Checking


def check(text: str, file: str = "<text>") -> list[AgentSpeakError]:
    """Return all mistakes in a text that static analysis finds."""
    try:
        program = parse(text, file)
    except AgentSpeakError as problem:
        return [problem]
    return problems_of(program, text, file)


def problems_of(
    program: Program,
    text: str,
    file: str,
    library: Library | None = None,
    check_plan: Callable[[Plan, Library], None] | None = None,
) -> list[AgentSpeakError]:
    """Return the mistakes in a parsed program that extends a library.

    ``check_plan`` replaces the default check, which compiles each plan.
    """
    check_plan = check_plan or _check_plan
    scratch = _scratch(library, program.inferences)
    found: list[AgentSpeakError] = []
    nobody: Any = SimpleNamespace(random=random.Random(0), clock=ManualClock())
    for inference in program.inferences:
        try:
            compile_inference(CompiledInference(inference, scratch))
        except SocialbotError as problem:
            found.append(_placed(problem, inference, text, file))
    for plan in program.plans:
        try:
            if library is not None and plan.label is not None and library.labelled(plan.label) is not None:
                raise RuleError(f"the label {plan.label} is taken", remedy="choose another label")
            check_plan(plan, scratch)
        except SocialbotError as problem:
            found.append(_placed(problem, plan, text, file))
    for item in (*program.beliefs, *program.goals):
        try:
            _evaluated(nobody, (item.args, item.annotations))
        except (Failed, KeyError, TypeError, ValueError, ArithmeticError) as problem:
            what = f"there is no function {problem.args[0]}" if isinstance(problem, KeyError) else str(problem)
            found.append(AgentSpeakError(f"{item} cannot be computed: {what}", where=file))
    return sorted(found, key=lambda problem: (problem.line, problem.column))


def check_plans(plans: Iterable[Plan], library: Library) -> None:
    """Check plans that extend a library. Raises RuleError for a plan that could never run."""
    scratch = _scratch(library, ())
    for plan in plans:
        _check_plan(plan, scratch)


def _check_plan(plan: Plan, library: Library) -> None:
    plan.check()
    for opened_ in (False, True):
        compile_plan(CompiledPlan(plan, library), opened=opened_)
    for inner in _inner_plans(plan.body):
        _check_plan(inner, library)


def _look_over(plan: Plan, library: Library) -> None:
    """Check the names in a plan, without compilation, which takes twenty times as long."""
    plan.check()
    for term in plan.condition.terms:
        if isinstance(term, Literal) and "." in term.functor:
            entry = find(term.functor)
            if entry is not None and entry.pauses:
                raise RuleError(f"{term.functor} cannot be a condition", remedy="make it a step of the body")
    _known(plan.condition)
    _known(plan.body)


def _known(part: Any) -> None:
    """Raise RuleError for an unknown internal action or function in part of a plan."""
    if isinstance(part, tuple):
        for item in part:
            _known(item)
    elif isinstance(part, Plan):
        _look_over(part, Library())
    elif isinstance(part, Literal):
        if "." in part.functor:
            _known_action(part)
        if part.args:
            _known(part.args)
    elif isinstance(part, Call):
        if part.function != ".count" and part.function not in FUNCTIONS:
            raise RuleError(f"there is no function {part.function}", remedy="see docs/semantics.md")
        _known(part.args)
    elif isinstance(part, (Pattern, Step)):
        for name in _PARTS.get(type(part), ()):
            _known(getattr(part, name))


def _known_action(action: Literal) -> None:
    if action.functor in COLLECTORS:
        wanted = 2 if action.functor == ".count" else 3
        if len(action.args) != wanted or not isinstance(action.args[-2], (Condition, Atom)):
            raise RuleError(f"{action} is put together wrongly", remedy="see docs/semantics.md")
        return
    entry = find(action.functor)
    if entry is None:
        raise RuleError(f"there is no internal action {action.functor}", remedy="see docs/semantics.md")
    least, most = entry.arity
    if not least <= len(action.args) <= most:
        count = str(least) if least == most else f"{least} to {most}"
        raise RuleError(f"{action.functor} takes {count} arguments", remedy="see docs/semantics.md")


_PARTS: dict[type, tuple[str, ...]] = {
    Conjunction: ("terms",),
    Disjunction: ("terms",),
    Negation: ("condition",),
    Comparison: ("left", "right"),
    Expression: ("left", "right"),
    Do: ("action",),
    Achieve: ("goal",),
    Ask: ("query",),
    Update: ("literal",),
    Constrain: ("condition",),
    If: ("condition", "then", "otherwise"),
    While: ("condition", "body"),
    For: ("condition", "body"),
    Fork: ("branches",),
}
"""Attributes of plan parts that hold other parts."""


def _inner_plans(part: Any) -> Iterable[Plan]:
    """Return the plans in arguments of internal actions."""
    if isinstance(part, (tuple, list)):
        for item in part:
            yield from _inner_plans(item)
    elif isinstance(part, Do):
        yield from (arg for arg in part.action.args if isinstance(arg, Plan))
    elif isinstance(part, Step):
        for name in ("then", "otherwise", "body", "branches"):
            yield from _inner_plans(getattr(part, name, ()))


def _scratch(library: Library | None, inferences: Iterable[Inference]) -> Library:
    """Return an empty library with the same compile-time dependencies as ``library``."""
    scratch = Library()
    if library is not None:
        scratch.inferences.update(library.inferences)
        scratch.kinds.update(library.kinds)
        scratch.goals.update(library.goals)
    for inference in inferences:
        scratch.inferences.setdefault(inference.head.key, [])
    return scratch


def _placed(problem: SocialbotError, item: Plan | Inference, text: str, file: str) -> AgentSpeakError:
    """Add the text position to a plan or rule error: the token in question if known."""
    if isinstance(problem, AgentSpeakError):
        return problem
    origin, written = item.origin or Origin(file, 1), item.text or ""
    lines = text.split("\n")
    begin_ = sum(len(line) + 1 for line in lines[: origin.line - 1])
    begin_ = max(text.find(written, begin_), 0) if written else begin_
    offset = begin_ + _offset(problem.what, written)
    line = text.count("\n", 0, offset) + 1
    column = offset - (text.rfind("\n", 0, offset) + 1) + 1
    shown = lines[line - 1].rstrip() if line <= len(lines) else ""
    under = "".join("\t" if char == "\t" else " " for char in shown[: column - 1])
    error = AgentSpeakError(
        f"{problem.what}\n    {shown}\n    {under}^", where=f"{file}:{line}:{column}", remedy=problem.remedy
    )
    error.line, error.column = line, column
    return error


def _offset(what: str, written: str) -> int:
    """Return the offset in a plan of the first name that an error message quotes."""
    for word in _WORD.findall(what):
        if word[0] == "." or word[0].isupper() or f"function {word}" in what:
            found = re.search(rf"(?<![\w.]){re.escape(word)}(?!\w)", written)
            if found is not None:
                return found.start()
    return 0
