"""Internal actions on goals and intentions.

They search the current goals of the intentions and the initial goal of each. A goal whose plan ended with another goal
is no longer current, unless it is the initial goal or has a failure plan.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from socialbot.bdi._goal_states import pause_term
from socialbot.bdi._inner_plans import ScopePause
from socialbot.bdi.agentspeak._spelling import said, spelled
from socialbot.bdi.compiler._dynamic import variables_of
from socialbot.bdi.intentions import (
    EVENT,
    KEPT,
    Failed,
    Failure,
    ForkPause,
    Intention,
    Request,
    source_of,
    subgoal,
)
from socialbot.bdi.literals import Event, Literal, error, error_msg, literal, literal_from_key
from socialbot.bdi.stdlib.environment import Appointment, event_of
from socialbot.bdi.stdlib.registry import Args, gives, internal, literal_of, opened
from socialbot.bdi.steps import Achieve, PlanBody
from socialbot.bdi.terms import Atom, Variable
from socialbot.bdi.unification import Trail, Var, annotations_match, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._intention_stack import IntentionStack

# Looking


@internal(".desire", 1, many=True, aware=True)
def desire(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.desire(g(X))``: a goal that matches is current, pending, or about to get a plan."""
    goal = _wanted(".desire", args[0])
    choosing = engine.intentions.choosing
    found = [*_pending(engine), *(each for intention in engine.intentions for each in _goals(intention))]
    for request in [choosing, *found] if choosing is not None else found:
        yield from _matches(goal, request, trail)


@internal(".intend", 1, 2, many=True, aware=True)
def intend(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.intend(g(X), Id)``: an intention that is not suspended, with this number, has a plan for the goal."""
    goal = _wanted(".intend", args[0])
    for intention in engine.intentions:
        for request in () if intention.suspended else _intended(engine, intention):
            for _ in _matches(goal, request, trail):
                if len(args) == 1 or gives(args[1], intention.number, trail):
                    yield


def _intended(engine: Any, intention: Intention) -> Iterator[Request]:
    """Yield the goals of an intention that have a plan, or a failure plan."""
    frames = intention.frames
    if all(plan is None for _, _, plan in frames) and intention is not engine.intentions.running:
        return  # a plan for its goal is being chosen, or it has not begun
    _, top, plan = frames[-1] if frames else (None, None, None)
    chosen_for = top if top is not None and plan is KEPT and not top[0] & EVENT else None
    yield from (request for request in _goals(intention) if request is not chosen_for)


@internal(".suspended", 2, many=True, aware=True)
def suspended(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.suspended(g(X), Reason)``: a suspended or waiting intention pursues the goal.

    The reason is ``wait(N)[time(500)]`` or ``wait(N)[b(1)]``, ``suspend_ia``, or a string for other pauses.
    """
    goal = literal_of(".suspended", args[0])
    for intention in engine.intentions:
        if intention.suspended or intention.pause is not None:
            for request in _goals(intention):
                for _ in _matches(goal, request, trail):
                    if gives(args[1], pause_term(intention), trail):
                        yield


@internal(".current_intention", 1, aware=True)
def current_intention(engine: Any, args: Args, trail: Trail) -> bool:
    """``.current_intention(intention(Number, Stack))``: the intention of this plan, with the plans of `.intention`."""
    intention = engine.intentions.current
    return gives(args[0], literal("intention", (intention.number, _stack(engine, intention))), trail)


@internal(".intention", 2, 4, many=True, aware=True)
def intention_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.intention(Id, State, Stack, current)``: an intention, its state and plans, the innermost first.

    A plan is ``im(Label, {Trigger}, {Remaining; Steps}, Values)``; ``current`` selects the intention of this plan.
    """
    current = engine.intentions.current
    if len(args) == 4 and resolve(args[3]) is Atom("current"):
        found = [current] if current is not None and current.frames else []
    else:
        found = [each for each in engine.intentions if each.frames]
    for each in found:
        state: Any = Atom("running" if each is current else each.state)
        if each is not current and each.state == "waiting" and resolve(args)[1] is not state:
            state = literal(each.state, (), (literal("reason", (pause_term(each),)),))
        values = (each.number, state, _stack(engine, each) if len(args) > 2 else ())
        mark = len(trail)
        if unify(args[:3], values[: len(args[:3])], trail):
            yield
        undo(trail, mark)


def _stack(engine: Any, intention: Intention) -> Args:
    from socialbot.bdi.stdlib._plans import label_of, renamed  # it imports this module's neighbours

    means = []
    numbers = itertools.count(1)
    for body, goal, compiled in reversed(intention.frames):
        if compiled is None or compiled is KEPT or body is None:
            continue
        plan = compiled.plan
        label = label_of(engine, plan)
        origin, left = plan.origin, _remaining(compiled, body)
        if origin is not None:
            line = next((step.line for step in left if step.line), origin.line)
            place = (literal("code_line", (line,)), literal("code_src", (source_of(origin),)))
            label = label.with_(annotations=(*label.annotations, *place))
        wanted = plan.event.literal
        if goal is not None:
            wanted = literal_from_key(goal[1].key.lstrip("+-!?"), resolve(goal[2]), goal[3])
        steps, _ = renamed(PlanBody(left), numbers)
        values = (literal("map", (Variable(f"_{next(numbers)}"), value)) for value in _values(plan, body))
        means.append(literal("im", (label, Event(plan.event.change, wanted), steps, tuple(values))))
    return tuple(means)


def _values(plan: Any, body: Any) -> list[Any]:
    """Return the values of the variables of a suspended plan."""
    known = {} if body.gi_frame is None else body.gi_frame.f_locals
    found = (resolve(known.get(f"v_{name}")) for name in variables_of(plan))
    return [value for value in found if value is not None and value.__class__ is not Var]


def _remaining(compiled: Any, body: Any) -> tuple[Any, ...]:
    """Return the steps of a suspended body from the current one on."""
    line = 0 if body.gi_frame is None else body.gi_frame.f_lineno
    known = [number for number in compiled.lines if number <= line]
    steps = compiled.plan.body
    if not known:
        return steps
    step = compiled.lines[max(known)]
    if step in steps:
        return steps[steps.index(step) :]
    return (step,)


# Dropping


@internal(".drop_intention", 0, 1, pauses=True, aware=True)
def drop_intention(engine: Any, args: Args, trail: Trail) -> None:
    """``.drop_intention(g)``: drop the intentions that pursue the goal; without a goal the current intention."""
    for intention in _with(engine, args, ".drop_intention"):
        engine.intentions.drop(intention)


@internal(".drop_all_intentions", 0, pauses=True)
def drop_all_intentions(engine: Any, args: Args, trail: Trail) -> None:
    """Drop all other intentions and the events scheduled with `.at`."""
    ours = engine.intentions.current
    for intention in engine.intentions:
        if intention is not ours and intention.active and not _is_branch_parent(intention, ours):
            engine.intentions.drop(intention)
    engine.timers.remove(lambda callback: isinstance(callback, Appointment))


def _is_branch_parent(intention: Intention, branch: Intention | None) -> bool:
    return any(each is branch or _is_branch_parent(each, branch) for each in _branches(intention))


def _branches(intention: Intention) -> Iterable[Intention]:
    return intention.pause.branches if isinstance(intention.pause, ForkPause) else ()


@internal(".drop_desire", 1, pauses=True, aware=True)
def drop_desire(engine: Any, args: Args, trail: Trail) -> None:
    """``.drop_desire(g)``: `.drop_intention` that drops pending goals, too."""
    drop_goal(engine, literal_of(".drop_desire", args[0]))


def drop_goal(engine: Any, goal: Literal) -> None:
    """Drop a pending goal and all intentions that pursue it."""
    _take_pending(engine, goal)
    for intention in _pursuing(engine, goal):
        engine.intentions.drop(intention)


@internal(".drop_all_desires", 0, pauses=True)
def drop_all_desires(engine: Any, args: Args, trail: Trail) -> None:
    """Drop all other intentions and all pending goals and events."""
    engine.interpreter.events.clear()
    drop_all_intentions(engine, args, trail)


@internal(".drop_future_intention", 1, pauses=True, aware=True)
def drop_future_intention(engine: Any, args: Args, trail: Trail) -> None:
    """``.drop_future_intention(g)``: drop the intentions whose innermost plan has the goal as a step."""
    goal = literal_of(".drop_future_intention", args[0])
    for intention in engine.intentions:
        plan = next((plan for _, _, plan in reversed(intention.frames) if plan is not None and plan is not KEPT), None)
        if plan is not None and any(_is_step(goal, step) for step in plan.plan.body):
            engine.intentions.drop(intention)


def _is_step(goal: Literal, step: Any) -> bool:
    if not isinstance(step, Achieve) or not isinstance(step.goal, Literal) or step.goal.key != goal.key:
        return False
    trail: Trail = []
    try:
        return unify(opened(step.goal.args), goal.args, trail)
    except Failed:  # its arguments are not computed yet
        return False
    finally:
        undo(trail, 0)


@internal(".drop_event", 1, pauses=True, aware=True)
def drop_event(engine: Any, args: Args, trail: Trail) -> None:
    """``.drop_event(g)``: drop a pending goal."""
    _take_pending(engine, literal_of(".drop_event", args[0]))


@internal(".drop_all_events", 0, pauses=True)
def drop_all_events(engine: Any, args: Args, trail: Trail) -> None:
    """Drop all pending goals and events."""
    engine.interpreter.events.clear()


# Ending


@internal(".succeed_goal", 1, pauses=True, aware=True)
def succeed_goal(engine: Any, args: Args, trail: Trail) -> None:
    """``.succeed_goal(g)``: achieve the goal without its plan and continue the parent goal."""
    goal = literal_of(".succeed_goal", args[0])
    _take_pending(engine, goal)
    for intention in _pursuing(engine, goal):
        _unwind(engine, intention, goal, None)


@internal(".done", 0, 1, pauses=True, aware=True)
def done(engine: Any, args: Args, trail: Trail) -> None:
    """``.done(g)``: `.succeed_goal` in this intention only; without a goal that of this plan.

    In an inner plan for a belief, the goal is that of the plan around it.
    """
    intention = engine.intentions.current
    goals: list[Request] = []
    while True:
        goals = [request for request in _goals(intention) if not args or _fits(literal_of(".done", args[0]), request)]
        around = intention.parent
        if goals or around is None:
            break
        if not args and isinstance(around.pause, ScopePause):
            around.pause.finish()
            return
        intention = around
    if not goals:
        raise Failed("ia_failed", f".done: this intention does not pursue {spelled(args[0]) if args else 'a goal'}")
    if args:
        _unwind(engine, intention, literal_of(".done", args[0]), None)
    else:
        goal = goals[-1]
        engine.intentions.interrupt(
            intention, lambda: _end_goal(engine.intentions, intention, lambda request: request is goal, None)
        )


@internal(".signal", 1, 2)
def signal(engine: Any, args: Args, trail: Trail) -> None:
    """``.signal({+b(1)})``: queue an event without changing a belief or a goal of this intention."""
    engine.interpreter.raise_event(event_of(".signal", args[0]), engine.interpreter.cause)


@internal(".fail_goal", 1, pauses=True, aware=True)
def fail_goal(engine: Any, args: Args, trail: Trail) -> None:
    """``.fail_goal(g)``: fail the goal; a plan for ``-!g`` handles this, or the parent goal fails."""
    goal = literal_of(".fail_goal", args[0])
    message = f"{spelled(goal)} was ended by .fail_goal"
    intentions = engine.intentions
    for request in _take_pending(engine, goal):
        kind, _, args, notes, cause = request
        # No intention pursues the goal any more.
        intention = intentions.new((kind, intentions.failure_plans(request), args, notes, cause))
        problem = Failure("cancelled", message, ".fail_goal", engine.interpreter.cause)
        intentions.fail_goal(intention, request, problem)
        intentions.settle(intention)
    for intention in _pursuing(engine, goal):
        _unwind(engine, intention, goal, message)


def _unwind(engine: Any, intention: Intention, goal: Literal, message: str | None) -> None:
    """End the plans of a goal, which fails with ``message`` or, without one, succeeds."""
    if not intention.active:
        return
    cause = engine.interpreter.cause

    def end() -> None:
        problem = None if message is None else Failure("cancelled", message, ".fail_goal", cause)
        _end_goal(engine.intentions, intention, lambda request: _fits(goal, request), problem)

    engine.intentions.interrupt(intention, end)


def _end_goal(
    intentions: IntentionStack, intention: Intention, wanted: Callable[[Request], bool], problem: Failure | None
) -> None:
    """End the outermost ``wanted`` goal of an intention: failed with ``problem``, or achieved."""
    frames, states = intention.frames, intentions.goal_states
    goals = [goal for _, goal, _ in frames]
    depth = next((i for i, goal in enumerate(goals) if goal is not None and wanted(goal)), 0)
    goal = goals[depth] if goals and goals[depth] is not None else intention.event
    running = any(body is not None and body.gi_running for body, _, _ in frames)
    intentions.unwound = True
    while len(frames) > depth:
        intentions.close(intention, frames.pop())
    if problem is None:
        intentions.achieved(goal)
    else:
        intentions.fail_goal(intention, goal, problem)
    if not running and problem is None and frames and states is not None:
        states.continued(intention, Atom("suceed_internal_action"))  # Jason writes it so
    if not running:
        intentions.settle(intention)


@internal(".fail", 0, 100)
def fail(engine: Any, args: Args, trail: Trail) -> None:
    """``.fail(error(e), error_msg("m"), a)``: fail with annotations for ``-!g``."""
    reason, message, others = "internal_action" if args else "ia_failed", "", []
    for arg in map(resolve, args):
        if isinstance(arg, Literal) and len(arg.args) == 1:
            value = arg.args[0]
            if arg.functor == error.functor and isinstance(value, Atom):
                reason = value.name
                continue
            if arg.functor == error_msg.functor:
                message = said(value)
                continue
        others.append(arg)
    if not message:
        others.append(error_msg(""))
    raise Failed(reason, message or ".fail", tuple(others))


# Suspending


@internal(".suspend", 0, 1, pauses=True, aware=True)
def suspend(engine: Any, args: Args, trail: Trail) -> None:
    """``.suspend(g)``: suspend intentions that pursue the goal, also a pending one; without a goal the current one."""
    states = engine.intentions.goal_states
    for request in _take_pending(engine, literal_of(".suspend", args[0])) if args else ():
        engine.intentions.adopt_suspended(request)
        if states is not None:
            states.tell(request, "suspended", Atom("suspend_ia"))
    for intention in _with(engine, args, ".suspend"):
        rests = args and (intention.suspended or intention.pause is not None)
        _suspend(engine, intention, _goal_of(intention, literal_of(".suspend", args[0])) if rests else None)


def _suspend(engine: Any, intention: Intention, goal: Request | None = None) -> None:
    """Suspend an intention; meta-events are those of a goal, or of the innermost one."""
    intention.suspended = True
    states = engine.intentions.goal_states
    if states is not None and goal is not None:
        states.tell(goal, "suspended", Atom("suspend_ia"))
    elif states is not None:
        states.suspended(intention)
    if intention in engine.interpreter.ready:
        engine.interpreter.ready.remove(intention)
    for branch in _branches(intention):
        _suspend(engine, branch)


@internal(".resume", 1, pauses=True, aware=True)
def resume(engine: Any, args: Args, trail: Trail) -> None:
    """``.resume(g)``: resume suspended intentions that pursue the goal; variables get the values of the first one."""
    goal = literal_of(".resume", args[0])
    for intention in engine.intentions:
        if intention.suspended and any(_binds(goal, request, trail) for request in _goals(intention)):
            _resume(engine, intention)


def _resume(engine: Any, intention: Intention) -> None:
    if intention.suspended:
        intention.suspended = False
        states = engine.intentions.goal_states
        if states is not None:
            states.resumed(intention)
        if intention.pause is None and intention.frames:
            engine.interpreter.ready.append(intention)
        for branch in _branches(intention):
            _resume(engine, branch)


# Finding


def _with(engine: Any, args: Args, name: str) -> list[Intention]:
    """Return the intentions that pursue a goal; without arguments the current intention."""
    return _pursuing(engine, literal_of(name, args[0])) if args else [_whole(engine, engine.intentions.current)]


def _whole(engine: Any, intention: Intention) -> Intention:
    """Return the parent intention of a branch."""
    return next((whole for whole in engine.intentions if _is_branch_parent(whole, intention)), intention)


def _pursuing(engine: Any, goal: Literal) -> list[Intention]:
    return [intention for intention in engine.intentions if _goal_of(intention, goal) is not None]


def _goal_of(intention: Intention, goal: Literal) -> Request | None:
    """Return the outermost goal of an intention that matches, if there is one."""
    return next((request for request in _goals(intention) if _fits(goal, request)), None)


def _goals(intention: Intention | None) -> Iterator[Request]:
    """Yield the goals of an intention from the outermost; the initial goal is always included."""
    if intention is None:
        return
    first = intention.event
    found = list(intention.goals())
    if first is not None and first[1].goal and all(first[1] is not goal[1] or first[2] != goal[2] for goal in found):
        yield first
    yield from found


def _wanted(name: str, term: Any) -> Any:
    """Convert a term to a goal; a variable without a value stands for any goal."""
    term = resolve(term)
    return term if term.__class__ is Var else literal_of(name, term)


def _matches(goal: Any, request: Request, trail: Trail) -> Iterator[None]:
    """Yield once if a request matches a goal; its variables stay bound until the next step."""
    _, trigger, args, notes, _ = request
    mark = len(trail)
    if goal.__class__ is Var:
        if trigger.goal and gives(goal, literal_from_key(trigger.key[2:], resolve(args), notes), trail):
            yield
        undo(trail, mark)
        return
    fits = trigger.key == f"+!{goal.key}" and unify(goal.args, args, trail)
    if fits and annotations_match(goal.annotations, notes, trail):
        yield
    undo(trail, mark)


def _fits(goal: Literal, request: Request) -> bool:
    """Check whether a request matches a goal, without bindings."""
    trail: Trail = []
    fits = next(_matches(goal, request, trail), "none") != "none"
    undo(trail, 0)
    return fits


def _binds(goal: Literal, request: Request, trail: Trail) -> bool:
    """Check whether a request matches a goal, whose variables it binds."""
    fits = request[1].key == f"+!{goal.key}" and gives(goal.args, request[2], trail)
    return fits and annotations_match(goal.annotations, request[3], trail)


def _pending(engine: Any) -> list[Request]:
    return [subgoal(*event) for event in engine.interpreter.events if event[0].goal]


def _take_pending(engine: Any, goal: Literal) -> list[Request]:
    taken = [request for request in _pending(engine) if _fits(goal, request)]
    for request in taken:
        engine.interpreter.events.remove(request[1:])
    return taken
