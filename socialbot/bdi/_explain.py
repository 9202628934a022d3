"""Explanations: the current step of an intention, rejected plans, and the causes of an action."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from socialbot.bdi.intentions import KEPT, Failure, Intention, Request, asking_for, goal_of, origin_of
from socialbot.bdi.library import locals_at, record_behind
from socialbot.bdi.literals import Event, Goal, Literal, ground, literal, literal_from_key
from socialbot.bdi.plans import Origin, Plan
from socialbot.bdi.steps import Await, PlanFailed, Step
from socialbot.bdi.terms import Atom, Comparison, Condition, Conjunction, Expression, Variable, show
from socialbot.bdi.trace import log, message_of, raised_in
from socialbot.bdi.unification import closed, resolve
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.library import CompiledPlan, Trigger


Args = tuple[Any, ...]

COMES_LATER = "another plan came first"
NO_MATCH = "the event does not match"


class ProbeTrail(list[Any]):
    """Trail of a probe; ``reached`` counts the conditions that hold, or is -1 for an event that does not match."""

    reached = -1


@dataclass(frozen=True, slots=True)
class GoalLevel:
    """One plan of an intention with its current or next ``step``.

    ``plan`` is None for a branch or a frame that only keeps a goal; ``goal`` is None for a plan for an event.
    """

    plan: Plan | None
    goal: Literal | None
    step: Step | None

    def __str__(self) -> str:
        if self.plan is None:
            return "a branch" if self.goal is None else str(self.goal)
        head = self.plan.label or written(self.plan.event, self.plan)
        goal = f" for {self.goal}" if self.goal is not None else ""
        return f"{head}{goal}{f', at {written(self.step, self.plan)}' if self.step is not None else ''}"


def written(item: Event | Step | Condition, plan: Plan) -> str:
    """Text of a part of a plan in the notation of the plan."""
    if plan.text is None:
        return str(item)
    from socialbot.bdi.agentspeak.printer import agentspeak

    return agentspeak(item)


def failed_step(plan: CompiledPlan | None, problem: Exception) -> tuple[str | None, Origin | None]:
    """Text of the step whose code raised an exception, in the notation of its plan, and its place or that of the plan.

    The text is None if the step is not known.
    """
    step = None if plan is None or plan is KEPT else plan.step_at(problem)
    if step is None or plan is None:
        return None, origin_of(plan)
    known = plan.texts.get(step)
    if known is None:
        known = plan.texts[step] = (written(step, plan.plan), _place(plan, step))
    return known


def place_of_step(intention: Intention) -> Origin | None:
    """Place in the text of the current step of the innermost plan."""
    if not intention.frames:
        return None
    body, _, plan = intention.frames[-1]
    if plan is None or plan is KEPT:
        return None
    step = None if body is None else step_of(body, plan, passed=False)
    if step is None and plan.plan.body:
        step = plan.plan.body[-1]
    return _place(plan, step)


def _place(plan: CompiledPlan | None, step: Step | None) -> Origin | None:
    origin = origin_of(plan)
    if origin is None or step is None or not step.line:
        return origin
    return Origin(origin.file, step.line)


def failed_term(plan: CompiledPlan | None, problem: BaseException) -> Any:
    """Step of a plan in AgentSpeak whose code raised an exception, as a term; None if it is none."""
    if plan is None or plan is KEPT:
        return None
    try:
        return _term_of(plan, plan.step_at(problem), locals_at(problem))
    except RecursionError:  # a term that contains itself
        return None


def waiting_term(body: Any, plan: CompiledPlan) -> Any:
    """Step of a plan in AgentSpeak that waits, as a term; None if it is none."""
    frame = body.gi_frame
    return None if frame is None else _term_of(plan, step_of(body, plan, passed=False), frame.f_locals)


_PARTS = ("action", "goal", "query", "condition", "literal")


def _term_of(plan: CompiledPlan, step: Step | None, values: Mapping[str, Any]) -> Any:
    """Content of a step with the values of its variables: the action, goal, query, condition or belief."""
    from socialbot.bdi.compiler._dynamic import substituted
    from socialbot.bdi.stdlib.registry import opened

    part: Any = next((getattr(step, name) for name in _PARTS if hasattr(step, name)), None)
    if isinstance(step, Await):
        limit = step.limit_s.left if isinstance(step.limit_s, Expression) else step.limit_s
        part = literal(".wait", (step.what,) if limit is None else (step.what, limit))
    if plan.plan.text is None or part is None:
        return None
    term = substituted(part, {name[2:]: value for name, value in values.items() if name[:2] == "v_"})
    if isinstance(term, Conjunction) and len(term.terms) == 1:
        term = term.terms[0]
    if isinstance(term, Literal):
        with contextlib.suppress(PlanFailed):  # An expression cannot be computed.
            term = opened(term)
    return Atom(term.functor) if isinstance(term, Literal) and _is_name(term) else term


def _is_name(term: Literal) -> bool:
    return not (term.args or term.annotations or term.negated)


def stack_of(intention: Intention, kinds: Mapping[str, type[Goal]]) -> tuple[GoalLevel, ...]:
    """Plans of an intention, the outermost first; ``kinds`` are the classes of goals by name."""
    levels = []
    for body, request, plan in intention.frames:
        known = None if plan is KEPT else plan
        goal = None if request is None else goal_of(request, kinds)
        if known is None and goal is None and body is not None and (later := later_request(body)) is not None:
            goal = goal_of(later, kinds)
        passed = body is intention.frames[-1][0] and intention.pause is None
        step = step_of(body, known, passed=passed) if body is not None and known is not None else None
        levels.append(GoalLevel(known.plan if known is not None else None, goal, step))
    return tuple(levels)


def step_of(body: Any, plan: CompiledPlan, *, passed: bool) -> Step | None:
    """Current step of a body; with ``passed`` (only the turn has ended) the next step."""
    frame = body.gi_frame
    if frame is None:
        return None
    lines, local = plan.lines, frame.f_locals
    if inspect.getgeneratorstate(body) == inspect.GEN_CREATED:
        if "start" in local:
            steps = plan.plan.body
            # A body started in place and paused at a step continues with the next one.
            at = local["start"] - (local.get("pause") is not None)
            return steps[at] if at < len(steps) else None
        return plan.plan.body[0] if plan.plan.body else None
    text = _line(frame)
    if text == "yield pause":
        steps, at = plan.plan.body, local["start"] - (not passed)
        return steps[at] if at < len(steps) else None
    if passed or text == "yield" or text.endswith(": yield"):
        later = [line for line in lines if line > frame.f_lineno]
        return lines[min(later)] if later else None
    before = [line for line in lines if line <= frame.f_lineno]
    return lines[max(before)] if before else None


def later_request(body: Any) -> Request | None:
    """Request of a body that only adopts a goal; None for other bodies."""
    if body.gi_frame is None or body.gi_code is not asking_for.__code__:
        return None
    return body.gi_frame.f_locals.get("request")


def _line(frame: Any) -> str:
    source = frame.f_globals["__loader__"].get_source("").split("\n")
    return source[frame.f_lineno - 1].strip()


def reason_against(interpreter: Interpreter, compiled: CompiledPlan, args: Args, notes: Args) -> str | None:
    """Reason why a plan does not apply to an event now; None if it applies."""
    plan = compiled.plan
    if plan.stage is not None and plan.stage != interpreter.stage:
        return f"the stage is {interpreter.stage or 'none'}, not {plan.stage}"
    from socialbot.bdi.compiler._dynamic import substituted

    terms, trail = plan.condition.terms, ProbeTrail()
    try:
        compiled.probe(interpreter, args, notes, trail)
    except Exception as problem:  # noqa: BLE001 - a condition is user code
        return f"{written(terms[trail.reached], plan)} raises {type(problem).__name__}: {problem}"
    if trail.reached == len(terms):
        return None
    if trail.reached < 0:
        return NO_MATCH
    failed = substituted(terms[trail.reached], _values(plan, args))
    text = written(failed, plan)
    return f"{f'({text})' if isinstance(failed, Comparison) else text} does not hold"


def _values(plan: Plan, args: Args) -> dict[str, Any]:
    """Values that the arguments of an event give to the variables of a plan."""
    pattern = plan.event.literal
    named = pattern.args if isinstance(pattern, Literal) else ()
    return {one.name: arg for one, arg in zip(named, args, strict=False) if isinstance(one, Variable) and closed(arg)}


def reasons_against(
    interpreter: Interpreter, trigger: Trigger, args: Args, notes: Args, before: CompiledPlan | None = None
) -> list[dict[str, str]]:
    """Reasons why each candidate plan for an event, up to ``before``, does not apply."""
    found = []
    for compiled in trigger.candidates(args):
        if compiled is before:
            break
        reason = reason_against(interpreter, compiled, args, notes)
        found.append({"plan": compiled.plan.label or compiled.shown()[0], "because": reason or COMES_LATER})
    return found


def plans_after(trigger: Trigger, args: Args, chosen: CompiledPlan) -> list[str]:
    """Texts of the candidate plans for an event that were not considered, since ``chosen`` came before them."""
    candidates = list(trigger.candidates(args))
    after = candidates[candidates.index(chosen) + 1 :] if chosen in candidates else []
    return [compiled.plan.label or compiled.shown()[0] for compiled in after]


def matched(interpreter: Interpreter, plan: Plan, values: Mapping[str, Any]) -> list[dict[str, object]]:
    """What each part of the condition of a plan matched, with these values of its variables.

    Each item has the text ``what`` and, for a held belief, the time ``since`` (ns) from which it has been held.
    """
    from socialbot.bdi.compiler._dynamic import substituted

    found: list[dict[str, object]] = []
    for term in plan.condition.terms:
        part = substituted(term, values)
        entry: dict[str, object] = {"what": written(part, plan)}
        held = interpreter.beliefs.get(part) if isinstance(part, Literal) and ground(part.args) else None
        if held is not None:
            entry["since"] = held.since
        found.append(entry)
    return found


def why_not(interpreter: Interpreter, label: str, args: Args | None = None) -> str:
    """Reason why the plan with this label does not apply to an event with these arguments."""
    for trigger in list(interpreter.triggers.values()):
        for compiled in trigger.plans:
            if label not in (compiled.plan.label, str(compiled.plan)):
                continue
            event = compiled.plan.event
            if args is None and event.literal.names():
                raise RuleError(f"{event} has variables", remedy="give the arguments of the event")
            args = event.literal.args if args is None else args
            own = reason_against(interpreter, compiled, args, ())
            if own is not None:
                return own
            earlier = reasons_against(interpreter, trigger, args, (), compiled)
            first = next((other["plan"] for other in earlier if other["because"] == COMES_LATER), None)
            return "it applies" if first is None else f"{first} comes first"
    raise RuleError(f"no plan {label}", remedy="give the label of a plan, or its text")


# Failures


def no_plan(interpreter: Interpreter, goal: Request, intention: Intention) -> Failure:
    """Failure of a goal without an applicable plan, also written to the trace."""
    _, trigger, args, notes, cause = goal
    trace = interpreter.trace
    explained = trace.sink is not None and closed(args)
    reasons = reasons_against(interpreter, trigger, args, notes) if explained else []
    reason = "no_applicable" if trigger.plans else "no_relevant"
    what = str(interpreter.intentions.goal(goal))
    message = f"no {'applicable ' if trigger.plans else ''}plan for {what}"
    if not trigger.plans:
        name = trigger.key.rpartition("/")[0]
        others = [key for key, other in interpreter.triggers.items() if key.rpartition("/")[0] == name and other.plans]
        if others:
            message += f", only for {', '.join(key[2:] for key in sorted(others))}"
    record = trace.record("failure", what, cause, reason=reason, message=message, rejected=reasons)
    wanted = literal_from_key(trigger.key[2:], args, notes)
    return Failure(reason, message, what, record, (), place_of_step(intention), lambda: resolve(wanted))


def unhandled(interpreter: Interpreter, trigger: Trigger, args: Args, notes: Args, cause: Any) -> None:
    """Record why no plan applies to the change of a belief, if some plan is for this belief."""
    reasons = reasons_against(interpreter, trigger, args, notes) if closed(args) else []
    if any(reason["because"] != NO_MATCH for reason in reasons):
        what = f"{trigger.key.rpartition('/')[0]}({', '.join(map(show, args))})"
        interpreter.trace.record("unhandled", what, cause, rejected=reasons)


def failure_of(
    interpreter: Interpreter, plan: CompiledPlan | None, problem: Exception, goal: Request | None, cause: Any = None
) -> Failure:
    """Failure for an exception in a step of a plan, also written to the trace."""
    step, place = failed_step(plan, problem)
    what = step or ("step" if goal is None else str(interpreter.intentions.goal(goal)))
    if isinstance(problem, PlanFailed):
        reason, message, notes, raised_at = problem.reason, str(problem), problem.annotations, ""
    else:
        reason, notes, raised_at = "exception", (), raised_in(problem)
        message = f"{type(problem).__name__}: {message_of(problem)}".removesuffix(": ")
    trace = interpreter.trace
    if cause is None and trace.sink is not None:
        cause = record_behind(problem) or (goal[4] if goal is not None else "")
    log().info("%s: %s: %s", trace.name, what, message)
    where = {"where": raised_at} if raised_at else {}
    record = trace.record("failure", what, cause, reason=reason, message=message, **where)
    return Failure(reason, message, what, record, notes, place, partial(failed_term, plan, problem), raised_at)
