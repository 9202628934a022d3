"""Goals and questions of bodies in generated code."""

from __future__ import annotations

from socialbot.bdi.compiler.beliefs import notes_of
from socialbot.bdi.compiler.conditions import assign, query
from socialbot.bdi.compiler.runtime import SUBGOAL, TAIL
from socialbot.bdi.compiler.source import CELL, Function, tuple_of
from socialbot.bdi.compiler.terms import build, has_value, refresh, value, values
from socialbot.bdi.literals import Goal, Literal
from socialbot.bdi.steps import Achieve, Ask
from socialbot.bdi.terms import Variable, names_in


def request(f: Function, step: Achieve, kind: int) -> str:
    """The expression that asks for a goal."""
    goal = step.goal
    if isinstance(goal, Goal):
        f.unit.library.declare(type(goal))
    if isinstance(goal, Variable):
        return f"ag.goal_of({value(f, goal)}, c)"
    settled = "_" not in names_in(goal) and has_value(f, goal)
    args = values(f, goal.args) if settled else tuple_of([build(f, arg) for arg in goal.args])
    notes = notes_of(f, goal)
    trigger = f"ag.triggers[{'+!' + goal.key!r}]"
    if settled:
        return f"({kind}, {trigger}, {args}, {notes}, c)"
    return f"ag.open_goal({kind}, {trigger}, {args}, {notes}, c)"


def achieve(f: Function, step: Achieve, *, last: bool) -> None:
    """Writes a goal; one that is ``last`` takes the place of the goal that the plan serves."""
    if step.apart:
        if isinstance(step.goal, Variable):
            f.line(f"ag.adopt_term({value(f, step.goal)}, c)", step)
        elif step.limit_s is not None:
            f.line(f"ag.adopt_within({request(f, step, SUBGOAL)}, {value(f, step.limit_s)})", step)
        else:
            f.line(f"ag.adopt_later({request(f, step, SUBGOAL)})", step)
        return
    goal = step.goal
    tail = last and step.limit_s is None and not isinstance(goal, Variable)
    before = set(f.scope)
    asked = request(f, step, TAIL if tail else SUBGOAL)
    if step.limit_s is not None:
        asked = f"ag.timed({asked}, {value(f, step.limit_s)})"
    f.line(f"yield {asked}", step)
    refresh(f, names_in(goal), before)


def ask(f: Function, step: Ask) -> None:
    """Writes a question: what is believed answers it, or else a plan does."""
    query_ = step.query
    if isinstance(query_, Variable):
        f.line(f"yield ag.question_of({value(f, query_)}, c)", step)
        return
    name, arguments, fresh = query(f, query_)
    found = f.unit.name("s")
    f.line(f"{found} = next({name}({arguments}), None)", step)
    with f.block(f"if {found} is not None"):
        assign(f, fresh, found)
    with f.block("else"):
        if isinstance(query_, Literal) and "." not in query_.functor:
            scope = dict(f.scope)
            args = tuple_of([build(f, arg) for arg in query_.args])
            trigger = f"ag.triggers[{'+?' + query_.key!r}]"
            f.line(f"yield ag.question({trigger}, {args}, {notes_of(f, query_)}, c)", step)
            for variable in sorted(names_in(query_) - {"_"}):
                if f.scope[variable] == CELL:
                    f.line(f"{f.local(variable)} = known({f.local(variable)})", step)
            f.scope = scope
        else:
            f.line(f"raise Failed('test_goal_failed', {f'nothing answers {query_}'!r})", step)
    f.scope.update(fresh)
