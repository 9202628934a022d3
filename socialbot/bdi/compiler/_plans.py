"""Compile plans and inference rules.

A plan becomes a function of the engine, the event's arguments and annotations and the id of its trace record. The
function returns None if the plan is not applicable, DONE for a finished body, a request for a final subgoal, or the
body as a generator. A body yields requests and pauses, and None after a step to let other intentions run.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from socialbot.bdi._inner_plans import is_mark
from socialbot.bdi._rule_checks import report_confused_names
from socialbot.bdi.compiler._beliefs import loop, match_annotations, needs_unification
from socialbot.bdi.compiler._bodies import Body, straight
from socialbot.bdi.compiler._conditions import Reached, query, write
from socialbot.bdi.compiler._source import CELL, VALUE, Function, Unit
from socialbot.bdi.compiler._steps import are_same
from socialbot.bdi.compiler._terms import build, match
from socialbot.bdi.intentions import SUBGOAL
from socialbot.bdi.literals import META, Change, Literal, is_source
from socialbot.bdi.plans import Inference, Plan, nodes_of, symbol_variables
from socialbot.bdi.stdlib import looks_at_goals
from socialbot.bdi.steps import Achieve, Do, Forget, Update
from socialbot.bdi.terms import Call, Comparison, Conjunction, Expression, Variable, names_in

if TYPE_CHECKING:
    from socialbot.bdi.library import CompiledInference, CompiledPlan, Library

ANY_MODE = -1
"""Mode in which every argument may have unbound variables."""

GIVING = {Change.WANTED, Change.ASKED}
GOALS = {Change.WANTED, Change.FAILED, Change.ASKED, Change.UNANSWERED}

BELIEFS = {Change.ADDED, Change.REMOVED}

OTHERS = "ag.ready or ag.events"
"""Expression that tests for other intentions or events."""


def compile_plan(compiled: CompiledPlan, *, mode: int = 0) -> Any:
    """Compile a plan; the bits of ``mode`` tell which arguments may have unbound variables."""
    plan = compiled.plan
    if plan.event.change in META:
        mode = ANY_MODE  # the goal may have variables
    opened = bool(mode)
    lenient = plan.text is not None
    with Unit(plan.place, compiled.library, symbol_variables(plan), lenient=lenient) as unit:
        unit.constants["PLAN"] = compiled
        f = unit.function("plan", ["ag", "args", "notes", "cause"], {})
        fail = "return undo(trail, 0)" if opened else "return None"
        if plan.stage is not None:
            f.line(f"if ag.stage != {plan.stage!r}: return None")
        change = plan.event.change
        head(f, plan.event.literal, fail, mode, belief=change in BELIEFS, gives=change in GIVING)
        write(f, plan.condition, fail, lambda: chosen(f, plan, opened=opened))
        f.line(fail)
        run, lines = unit.build()
    compiled.lines.update(lines)
    if lenient and not mode:
        report_confused_names(plan, compiled.library)
    return _telling(run, plan) if looks_at_goals(_internal(plan.condition)) else run


def _internal(condition: Conjunction) -> list[str]:
    """Return the names of the internal actions in a condition."""
    literals = [node for node in nodes_of(condition) if isinstance(node, Literal)]
    return [each.functor for each in literals if each.functor[:1] == "."]


def _telling(run: Any, plan: Plan) -> Any:
    """Wrap a plan to tell its condition for which event a plan is chosen."""
    key = plan.event.key

    def choose(ag: Any, args: Any, notes: Any, cause: Any) -> Any:
        ag.intentions.choosing = (SUBGOAL, ag.triggers[key], args, notes, cause)
        try:
            return run(ag, args, notes, cause)
        finally:
            ag.intentions.choosing = None

    return choose


def head(f: Function, pattern: Literal, fail: str, mode: int, *, belief: bool = False, gives: bool = False) -> None:
    """Emit the match of an event or a conclusion; the bits of ``mode`` are its possibly unbound arguments.

    The annotations of the event of a ``belief`` have no unbound variables. A plan that ``gives`` values binds those in
    the annotations of its goal.
    """
    for i, arg in enumerate(pattern.args):
        subject = f"args[{i}]"
        if not mode >> i & 1:
            match(f, arg, subject, fail)
        elif isinstance(arg, Variable) and arg.name not in f.scope:
            if arg.name != "_":
                f.line(f"{f.local(arg.name)} = {subject}")
                f.scope[arg.name] = CELL
        else:
            f.line(f"if not unify({build(f, arg)}, {subject}, trail): {fail}")
    if belief and pattern.annotations and not needs_unification(pattern.with_(args=())):
        match_annotations(f, pattern.annotations, fail)
    elif pattern.annotations:
        # The event must have all annotations of the trigger.
        fresh = names_in(pattern.annotations) - f.scope.keys() - {"_"}
        notes = build(f, pattern.annotations)
        f.line(f"if not annotations_match({notes}, notes, trail): {fail}")
        open_notes = tuple(note for note in pattern.annotations if gives and not (is_source(note) or is_mark(note)))
        known = fresh - names_in(open_notes)
        f.resolve(known, VALUE)


def chosen(f: Function, plan: Plan, *, opened: bool) -> None:
    """Emit the code after a successful context condition; an ``opened`` goal may have unbound variables."""
    values = ", ".join(f"{name!r}: {f.local(name)}" for name in sorted(f.scope))
    f.line(f"c = cause if ag.trace.sink is None else chosen(ag, PLAN, args, notes, cause, {{{values}}})")
    if not plan.body:
        f.line("return DONE")
        return
    event = plan.event.literal.args
    again = not opened and any(
        isinstance(step, (Update, Forget))
        and isinstance(step.literal, Literal)
        and are_same(f, step.literal.args, event)
        for step in plan.body
    )
    f.event = event if again else None
    body = Body(f.unit, plan, {name: f.scope[name] for name in sorted(f.scope)}, f.event)
    generator = body.generator()
    meta = plan.event.change in META
    kept = f.unit.library.keeps_goals and _ends_with_goal(plan)
    if straight(plan.body) and not (plan.atomic or meta or kept or plan.stepwise):
        inline(f, plan, body, generator, opened=opened)
    else:
        f.line(f"return SpecialBody({generator})" if plan.atomic or meta else f"return {generator}")


def _ends_with_goal(plan: Plan) -> bool:
    return bool(plan.body) and isinstance(plan.body[-1], Achieve) and not plan.body[-1].apart


def inline(f: Function, plan: Plan, body: Body, generator: str, *, opened: bool) -> None:
    """Emit a body without branches in place. Once other intentions wait, the remainder becomes a generator.

    The body of an ``opened`` goal with failure plans begins later: they do not see what it binds.
    """
    scope, depth = dict(f.scope), f.depth
    remainder, names = body.resumable()

    def rest(start: int, pause: str = "None") -> str:
        state = [f.local(name) if name in f.scope else "None" for name in names]
        return f"{remainder.name}({', '.join([*body.given, str(start), pause, *state])})"

    # A goal's plan starts in the next cycle. An event's plan starts in this one unless another intention waits; its
    # second step follows after a switch if more events or posted items wait.
    goal = plan.event.change in GOALS
    begin = f"{OTHERS} or ag.inbox" if goal else "ag.ready or ag.others"
    if goal and opened:
        begin += f" or ag.triggers[{f.key(f'-{plan.event.key[1:]}')}].plans"
    f.line(f"if {begin}: return {generator}")
    with f.block("try"):
        for i, step in enumerate(plan.body):
            if i:
                # Only actions can wake another intention.
                others = OTHERS if isinstance(plan.body[i - 1], Do) else "ag.events"
                if i == 1 and not goal:
                    others = f"{others} or ag.inbox"
                with f.block(f"if {others}"):
                    f.line(f"ag.begun = r = {rest(i)}")
                    f.line("return r")
            body.write_inline(
                f, step, last=i == len(plan.body) - 1, rest=lambda pause, i=i: f"return {rest(i + 1, pause)}"
            )
            if i == 0:
                body.write_rest(remainder, f.scope)
    with f.block("except Exception as problem"):
        f.line("return failure_of(ag, PLAN, problem, None, c)")
    f.line("return DONE")
    f.scope, f.depth = scope, depth


def compile_inference(compiled: CompiledInference) -> Any:
    """Compile a rule to a generator of engine, arguments and trail that yields once per solution."""
    inference = _without_arithmetic(compiled.inference)
    symbols, lenient = symbol_variables(inference), inference.text is not None
    with Unit(str(inference.origin or inference), compiled.library, symbols, lenient=lenient) as unit:
        f = unit.function("rule", ["ag", "args", "trail"], {})
        f.line("mark = len(trail)")
        with f.block("for _ in ONCE"):
            f.loops = 1
            head(f, inference.head.with_(annotations=()), "continue", ANY_MODE)
            write(f, inference.condition, "continue", lambda: f.line("yield"))
        f.line("undo(trail, mark)")
        return unit.build()[0]


def _without_arithmetic(rule: Inference) -> Inference:
    """Move the arithmetic in the head of a rule to the end of its condition."""
    args: list[object] = []
    added = []
    for number, arg in enumerate(rule.head.args):
        if isinstance(arg, (Expression, Call)):
            result = Variable(f"_Result{number}")
            added.append(Comparison("=", result, arg))
            args.append(result)
        else:
            args.append(arg)
    if not added:
        return rule
    return replace(rule, head=rule.head.with_(args=tuple(args)), condition=Conjunction((*rule.condition.terms, *added)))


def compile_query(condition: Conjunction, library: Library, *, lenient: bool = False) -> tuple[list[str], Any]:
    """Compile a condition; return the names of its new variables and the generator of their value tuples."""
    with Unit(str(condition), library, symbol_variables(condition), lenient=lenient) as unit:
        f = unit.function("ask", ["ag", "trail"], {})
        name, arguments, fresh = query(f, condition)
        with loop(f, f"{name}({arguments})") as found:
            f.line(f"yield resolve({found})")
        return list(fresh), unit.build()[0]


def compile_probe(compiled: CompiledPlan) -> Any:
    """Compile a diagnostic function of a plan that counts the satisfied conditions in ``trail.reached``."""
    plan = compiled.plan
    terms = plan.condition.terms
    marked = [part for i, term in enumerate(terms) for part in (Reached(i), term)]
    lenient = plan.text is not None
    with Unit(plan.place, compiled.library, symbol_variables(plan), lenient=lenient) as unit:
        f = unit.function("probe", ["ag", "args", "notes", "trail"], {})
        head(f, plan.event.literal, "return", 0)
        write(f, Conjunction((*marked, Reached(len(terms)))), "return", lambda: f.line("return"))
        return unit.build()[0]
