"""Load AgentSpeak text into an engine; a text with a mistake changes nothing.

>>> from socialbot.bdi import Engine
>>> from socialbot.core.clock import ManualClock
>>> engine = Engine("cat", ManualClock())
>>> load(engine, 'hungry. +hungry <- .my_name(N); .print(N, " is hungry").')
>>> engine.run_until_idle()
[cat] cat is hungry
False
"""

from __future__ import annotations

import itertools
import operator
import random
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi._inner_plans import is_nested, parts
from socialbot.bdi._rule_checks import beliefs_not_given, goals_without_plans
from socialbot.bdi.agentspeak.lexer import AgentSpeakError, Source, bare
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.agentspeak.programs import IncludePaths, Program, parse
from socialbot.bdi.compiler._conditions import COLLECTORS, collected_goal
from socialbot.bdi.compiler._dynamic import specialised
from socialbot.bdi.compiler._plans import ANY_MODE, compile_inference, compile_plan
from socialbot.bdi.compiler._runtime import div, mod, power
from socialbot.bdi.compiler._terms import function_of
from socialbot.bdi.intentions import Failed
from socialbot.bdi.library import CompiledInference, CompiledPlan, Library
from socialbot.bdi.literals import SELF, Literal, distinct, is_source
from socialbot.bdi.plans import LEAVES, Inference, Origin, Plan, contents_of, nodes_of, parts_of, unbound_in
from socialbot.bdi.stdlib import called, find
from socialbot.bdi.stdlib.actions import registered
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.steps import Action, Do, Step
from socialbot.bdi.terms import Call, Condition, Expression
from socialbot.core.clock import ManualClock
from socialbot.core.errors import RuleError, SocialbotError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine

SELECT_OPTION = "select__option/4"
"""Rules by which Jason 3.3 chooses among the applicable plans."""

_WORD = re.compile(r"\.?\w+(?:\.\w+)*")


def load(engine: Engine, text: str, file: str = "<text>", paths: IncludePaths | None = None) -> None:
    """Add the rules, plans, beliefs and goals of a text; ``paths`` allows it to include files.

    Raises:
        AgentSpeakError: The text has a mistake; nothing is added.
    """
    program = parse(text, file, paths)
    problems = problems_of(program, engine.library, check_plan=_check_names)
    if problems:
        raise problems[0]
    for inference in program.inferences:
        engine.add_rules(inference)
    for plan in program.plans:
        engine.add_rules(plan)
    begin(engine, program)


def library_of(program: Program) -> Library:
    """Build a library of the rules and plans of a program, for several agents to share.

    It stays as it is for further agents: one that changes it gets its own copy.
    """
    library = Library()
    library.users = 1
    for inference in program.inferences:
        library.add_inference(inference)
    for plan in program.plans:
        library.add(plan)
    return library


def begin(engine: Engine, program: Program) -> None:
    """Add the initial beliefs and goals of a program."""
    compute = partial(_computed, engine)
    # Queries try the newest belief first, so reversed insertion preserves the order of the text.
    for belief in reversed(program.beliefs):
        args, notes = opened((belief.args, belief.annotations), compute=compute)
        engine.interpreter.post((engine.beliefs.relation(belief.key), args, _with_source(notes), "", None))
    for goal in program.goals:
        args, notes = opened((goal.args, goal.annotations), compute=compute)
        engine.interpreter.post(_InitialGoal(engine, goal.key, args, _with_source(notes)))


@dataclass(eq=False)
class _InitialGoal:
    """Event that adopts an initial goal after the events of the initial beliefs."""

    mental: ClassVar[bool] = True
    """A restored mental state replaces pending objects of this class."""

    engine: Engine
    key: str
    args: tuple[Any, ...]
    notes: tuple[Any, ...]

    def __call__(self) -> None:
        trigger = self.engine.library.triggers[f"+!{self.key}"]
        self.engine.interpreter.events.append((trigger, self.args, self.notes, ""))


def _with_source(notes: tuple[Any, ...]) -> tuple[Any, ...]:
    notes = distinct(notes)
    return notes if any(map(is_source, notes)) else notes + SELF


# Arithmetic

_OPERATORS = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "//": operator.floordiv,
    "%": operator.mod,
    "**": power,
    "div": div,
    "mod": mod,
}


def _computed(engine: Any, term: Expression | Call) -> Any:
    """Evaluate an expression or function call without variables."""
    parts = (term.left, term.right) if isinstance(term, Expression) else term.args
    values = opened(parts, compute=partial(_computed, engine))
    if isinstance(term, Expression):
        return _OPERATORS[term.symbol](*values)
    return function_of(term)(engine, *values)


# Checking


def check(text: str, file: str = "<text>", paths: IncludePaths | None = None) -> list[AgentSpeakError]:
    """Return all mistakes in a text that static analysis finds; ``paths`` allows it to include files."""
    try:
        program = parse(text, file, paths)
    except AgentSpeakError as problem:
        return [problem]
    return problems_of(program)


def problems_of(
    program: Program,
    library: Library | None = None,
    check_plan: Callable[[Plan, Library], None] | None = None,
) -> list[AgentSpeakError]:
    """Return the mistakes in a parsed program that extends a library.

    ``check_plan`` replaces the default check, which compiles each plan.
    """
    check_plan = check_plan or _check_plan
    scratch = _scratch(library, program.inferences)
    found: list[AgentSpeakError] = []
    for inference in program.inferences:
        try:
            if inference.head.key == SELECT_OPTION:
                remedy = "order the plans, or give them priorities: @label[priority(2)]"
                raise RuleError("rules that choose among plans have no effect", remedy=remedy)
            compile_inference(CompiledInference(inference, scratch))
        except SocialbotError as problem:
            found.append(_placed(problem, inference, program))
    for plan in program.plans:
        try:
            if library is not None and plan.label is not None and library.labelled(plan.label) is not None:
                raise RuleError(f"the label {plan.label} is taken", remedy="choose another label")
            check_plan(plan, scratch)
        except SocialbotError as problem:
            found.append(_placed(problem, plan, program))
    facts = (*program.beliefs, *program.goals)
    compute = partial(_computed, SimpleNamespace(random=random.Random(0), clock=ManualClock())) if facts else None
    for item in facts:
        try:
            opened((item.args, item.annotations), compute=compute)
        except (Failed, RuleError, TypeError, ValueError, ArithmeticError) as problem:
            what = problem.what if isinstance(problem, RuleError) else problem
            found.append(AgentSpeakError(f"{item!s} cannot be computed: {what}", where=next(iter(program.texts), None)))
    return sorted(found, key=lambda problem: (problem.line, problem.column))


def check_plans(plans: Iterable[Plan], library: Library) -> None:
    """Check plans that extend a library. Raises RuleError for a plan that could never run."""
    scratch = _scratch(library, ())
    for plan in plans:
        _check_plan(plan, scratch)


def _check_plan(plan: Plan, library: Library) -> None:
    if is_nested(plan):
        for part in parts(plan):
            _check_plan(part, library)
        return
    plan.check()
    if not isinstance(plan.event.literal, Literal):
        pattern: Any = plan.event.literal
        inner = getattr(pattern, "variable", None)
        key = inner.key if isinstance(inner, Literal) else "any/0"
        plan = specialised(plan, f"{plan.event.change.value}{key}") or plan
    for mode in (0, ANY_MODE):
        compile_plan(CompiledPlan(plan, library), mode=mode)
    for inner in _inner_plans(plan.body):
        _check_plan(inner, library)


def _check_names(plan: Plan, library: Library) -> None:
    """Check the names in a plan, without compilation, which takes twenty times as long."""
    if is_nested(plan):
        for part in parts(plan):
            _check_names(part, library)
        return
    plan.check()
    for term in plan.condition.terms:
        if isinstance(term, Literal) and "." in term.functor and term.functor not in COLLECTORS:
            called(term, condition=True)
    for part in contents_of(plan).calls:
        try:
            if isinstance(part, Plan):
                _check_names(part, Library())
            elif isinstance(part, Literal):
                check_call = collected_goal if part.functor in COLLECTORS else called
                check_call(part)
            elif part.function != ".count":
                function_of(part)
        except RuleError as problem:
            problem.line = problem.line or _line_of(part, plan)
            raise


def _inner_plans(part: Any) -> Iterable[Plan]:
    """Return the plans in arguments of internal actions."""
    for inner in parts_of(part):
        if isinstance(inner, Plan):
            yield inner
        else:
            yield from _inner_plans(inner)


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


def warnings_of(program: Program) -> list[AgentSpeakError]:
    """Return steps that fail when they are reached, rules that never apply, and steps without ``;`` before them.

    The first two are uses of variables without a value, conditions as actions, goals without plans, and beliefs that
    the program adds with other numbers of arguments only.
    """
    found = list(program.omissions)
    library = library_of(program)
    doubts = (*goals_without_plans(library, program.goals), *beliefs_not_given(library, program.beliefs))
    for item, what, remedy, literal in doubts:
        found.append(_placed(RuleError(what, remedy=remedy), item, program, literal))
    for plan in program.plans:
        for condition in _conditions_as_actions(plan.body):
            what = f"{agentspeak(condition)} is a condition, which is no action"
            problem = RuleError(what, remedy=f"write ?({agentspeak(condition)})")
            found.append(_placed(problem, plan, program, condition))
    for item in (*program.inferences, *itertools.chain(*map(parts, program.plans))):
        for names, where in unbound_in(item):
            what = f"{names} has no value in {agentspeak(where)}"
            remedy = "give it one in the event or the context" if isinstance(item, Plan) else "give it one before"
            found.append(_placed(RuleError(what, remedy=remedy), item, program, where))
    return sorted(found, key=lambda problem: (problem.line, problem.column))


def _conditions_as_actions(part: Any) -> Iterable[Condition]:
    for inner in parts_of(part):
        if isinstance(inner, Do) and isinstance(inner.action, Condition) and not isinstance(inner.action, Literal):
            yield inner.action
        elif inner.__class__ not in LEAVES:
            yield from _conditions_as_actions(inner)


def needs_of(program: Program) -> tuple[str, ...]:
    """Return the actions and functions that a program uses and nobody has registered, such as ``move/2``."""
    found: set[str] = set()
    _collect_needs((program.inferences, program.plans), found)
    return tuple(sorted(found))


def _collect_needs(part: Any, found: set[str]) -> None:
    if isinstance(part, Do) and isinstance(part.action, Literal) and "." not in part.action.functor:
        if registered(part.action.functor) is None and not isinstance(part.action, Action):
            found.add(part.action.key)
    elif isinstance(part, (Literal, Call)):
        name = part.functor if isinstance(part, Literal) else part.function
        custom = "." in name and name[0] != "." and name.partition(".")[0] not in ("math", "system")
        if custom and find(name) is None and not (isinstance(part, Call) and part.predicate):
            found.add(f"{name}/{len(part.args)}")
    for inner in parts_of(part):
        if inner.__class__ not in LEAVES:
            _collect_needs(inner, found)


def _placed(
    problem: SocialbotError, item: Plan | Inference | Literal, program: Program, part: object = None
) -> AgentSpeakError:
    """Add the text position to a plan or rule error: the step with a ``part``, and the token in question if known."""
    if isinstance(problem, AgentSpeakError):
        return problem
    if isinstance(item, Literal):
        return AgentSpeakError(problem.what, where=next(iter(program.texts), None), remedy=problem.remedy)
    origin, written = item.origin or Origin("<text>", 1), item.text or ""
    file, text = origin.file, program.texts.get(origin.file, "")
    lines = text.split("\n")
    begin_ = sum(len(line) + 1 for line in lines[: origin.line - 1])
    begin_ = max(text.find(written, begin_), 0) if written else begin_
    line = (isinstance(problem, RuleError) and problem.line) or _line_of(part, item)
    before = lines[: max(line, origin.line) - 1]
    skipped = max(sum(map(len, before)) + len(before) - begin_, 0)
    return Source(text, file).error_at(begin_ + _offset(problem.what, written, skipped), problem.what, problem.remedy)


def _line_of(part: object, item: Plan | Inference) -> int:
    """Return the line of the innermost step of a plan that has a part; 0 if it is in no step."""
    steps = [node for node in nodes_of(item) if isinstance(node, Step) and node.line]
    return next((step.line for step in reversed(steps) if any(node is part for node in nodes_of(step))), 0)


def _offset(what: str, written: str, skipped: int) -> int:
    """Return the offset in a plan of the first name after ``skipped`` characters that an error message quotes."""
    written = bare(written)
    skipped += len(written) - skipped - len(written[skipped:].lstrip())
    for word in _WORD.findall(what):
        if word[0] == "." or word[0].isupper() or f"function {word}" in what:
            found = re.compile(rf"(?<![\w.]){re.escape(word)}(?!\w)").search(written, skipped)
            if found is not None:
                return found.start()
    return skipped
