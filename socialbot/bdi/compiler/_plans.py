"""Compile plans and inference rules.

A plan becomes a function of the engine, the event's arguments and annotations and the id of its trace record. The
function returns None if the plan is not applicable, DONE for a finished body, a request for a final subgoal, or the
body as a generator. A body yields requests and pauses, and None after a step to let other intentions run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from socialbot.bdi.compiler._conditions import Reached, loop, query, write
from socialbot.bdi.compiler._source import CELL, VALUE, Function, Unit
from socialbot.bdi.compiler._steps import Body, straight
from socialbot.bdi.compiler._terms import build, match
from socialbot.bdi.literals import Change, Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Do
from socialbot.bdi.terms import Conjunction, Variable, names_in

if TYPE_CHECKING:
    from socialbot.bdi.library import CompiledInference, CompiledPlan, Library

GOALS = {Change.WANTED, Change.FAILED, Change.ASKED, Change.UNANSWERED}

OTHERS = "ag.ready or ag.events"
"""Expression that tests for other intentions or events."""


def compile_plan(compiled: CompiledPlan, *, opened: bool) -> Any:
    """Compile a plan; ``opened`` allows unbound variables in the arguments."""
    plan = compiled.plan
    with Unit(str(plan.origin or plan), compiled.library) as unit:
        unit.constants["PLAN"] = compiled
        f = unit.function("plan", ["ag", "args", "notes", "cause"], {})
        fail = "return undo(trail, 0)" if opened else "return None"
        if plan.stage is not None:
            f.line(f"if ag.stage != {plan.stage!r}: return None")
        head(f, plan.event.literal, fail, opened=opened)
        write(f, plan.condition, fail, lambda: chosen(f, plan))
        f.line(fail)
        run, lines = unit.build()
    compiled.lines.update(lines)
    return run


def head(f: Function, pattern: Literal, fail: str, *, opened: bool) -> None:
    """Emit the match of an event or a conclusion."""
    for i, arg in enumerate(pattern.args):
        subject = f"args[{i}]"
        if not opened:
            match(f, arg, subject, fail)
        elif isinstance(arg, Variable) and arg.name not in f.scope:
            if arg.name != "_":
                f.line(f"{f.local(arg.name)} = {subject}")
                f.scope[arg.name] = CELL
        else:
            f.line(f"if not unify({build(f, arg)}, {subject}, trail): {fail}")
    if pattern.annotations:
        # The event must have all annotations of the trigger.
        fresh = names_in(pattern.annotations) - f.scope.keys() - {"_"}
        notes = build(f, pattern.annotations)
        f.line(f"if not annotations_match({notes}, notes, trail): {fail}")
        f.resolve(fresh, VALUE)


def chosen(f: Function, plan: Plan) -> None:
    """Emit the code after a successful context condition."""
    f.line("c = cause if ag.trace.sink is None else chosen(ag, PLAN, args, notes, cause)")
    if not plan.body:
        f.line("return DONE")
        return
    names = sorted(f.scope)
    body = Body(f.unit, plan, {name: f.scope[name] for name in names})
    if straight(plan.body) and not plan.atomic:
        inline(f, plan, body)
    else:
        generator = body.generator()
        f.line(f"return {generator}({', '.join(['ag', 'c', *(f.local(name) for name in names)])})")


def inline(f: Function, plan: Plan, body: Body) -> None:
    """Emit a body without branches in place. Once other intentions wait, the remainder becomes a generator."""
    scope, depth = dict(f.scope), f.depth
    resume = body.resumable()

    def rest(start: int, pause: str = "None") -> str:
        state = ", ".join(f"{f.local(name)}={f.local(name)}" for name in sorted(f.scope))
        return f"{resume}(ag, c, {start}, {pause}{', ' if state else ''}{state})"

    # A goal's plan starts in the next cycle. An event's plan may start in this one unless another intention waits.
    begin = "ag.ready or ag.others" if plan.event.change not in GOALS else f"{OTHERS} or ag.inbox"
    f.line(f"if {begin}: return {rest(0)}")
    with f.block("try"):
        for i, step in enumerate(plan.body):
            if i:
                # Only actions can wake another intention.
                others = OTHERS if isinstance(plan.body[i - 1], Do) else "ag.events"
                f.line(f"if {others}: return ag.intentions.hand_over({rest(i)})")
            body.write_inline(
                f, step, last=i == len(plan.body) - 1, rest=lambda pause, i=i: f"return {rest(i + 1, pause)}"
            )
    with f.block("except Exception as problem"):
        f.line("return ag.intentions.failure_of(PLAN, problem, None, c)")
    f.line("return DONE")
    f.scope, f.depth = scope, depth


def compile_inference(compiled: CompiledInference) -> Any:
    """Compile a rule to a generator of engine, arguments and trail that yields once per solution."""
    inference = compiled.inference
    with Unit(str(inference.origin or inference), compiled.library) as unit:
        f = unit.function("rule", ["ag", "args", "trail"], {})
        f.line("mark = len(trail)")
        with f.block("for _ in ONCE"):
            f.loops = 1
            head(f, inference.head.with_(annotations=()), "continue", opened=True)
            write(f, inference.condition, "continue", lambda: f.line("yield"))
        f.line("undo(trail, mark)")
        return unit.build()[0]


def compile_query(condition: Conjunction, library: Library) -> tuple[list[str], Any]:
    """Compile a condition; return the names of its new variables and the generator of their value tuples."""
    with Unit(str(condition), library) as unit:
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
    with Unit(str(plan.origin or plan), compiled.library) as unit:
        f = unit.function("probe", ["ag", "args", "notes", "trail"], {})
        head(f, plan.event.literal, "return", opened=False)
        write(f, Conjunction((*marked, Reached(len(terms)))), "return", lambda: f.line("return"))
        return unit.build()[0]
