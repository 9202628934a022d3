"""Intention stack of an agent: its intentions, their goals, and the handling of failures."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from itertools import count, takewhile
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from socialbot.bdi._explain import failure_of, no_plan, unhandled, waiting_term
from socialbot.bdi._goal_states import GoalStates, WatchedBody
from socialbot.bdi._waits import Waits
from socialbot.bdi.intentions import (
    DONE,
    EVENT,
    KEPT,
    OPEN,
    REASONS,
    SUBGOAL,
    TAIL,
    Body,
    Failed,
    Failure,
    Frame,
    Intention,
    OpenRequest,
    Pause,
    QueuedPlan,
    Request,
    SpecialBody,
    TimedRequest,
    asking_for,
    goal_of,
    once,
    origin_of,
)
from socialbot.bdi.library import CompiledPlan, Trigger
from socialbot.bdi.trace import log
from socialbot.bdi.unification import closed, free, resolve

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.literals import Literal

_number = attrgetter("number")

CHAIN = range(64)
"""Plans with a single goal that are followed in one step, if no other work waits."""


class IntentionStack:
    """Intentions of one agent, for the engine's thread; iteration yields each `Intention`, the oldest first."""

    __slots__ = (
        "_all", "_interpreter", "atomic", "choosing", "goal_states", "numbers", "ready", "running", "turn_may_end",
        "unwound", "waits",
    )  # fmt: skip

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._all: dict[Intention, None] = {}
        self.numbers = count(1)  # of the next intentions
        self.choosing: Request | None = None  # event for which a plan is chosen, while its condition needs to know
        self.ready: deque[Any] = deque()  # runnable intentions or queued plans, in the order of their turns
        self.waits = Waits(interpreter)
        self.goal_states: GoalStates | None = None  # of an agent with plans for meta-events
        self.running: Any = None  # intention or queued plan whose step is being executed
        self.atomic: Intention | None = None  # it excludes the others
        self.turn_may_end = False  # the current step has begun no other plan
        self.unwound = False  # a step ended goals or intentions, maybe its own, or added plans for the states of goals

    def __iter__(self) -> Iterator[Intention]:
        self._register_all()
        return iter(sorted(self._all, key=_number))

    def __len__(self) -> int:
        self._register_all()
        return len(self._all)

    @property
    def current(self) -> Intention | None:
        """Intention whose step is being executed."""
        self._register_ready()
        return self.running

    def desires(self) -> tuple[Literal, ...]:
        """Goals of all intentions."""
        return tuple(self.goal(request) for intention in self for request in intention.goals())

    def goal(self, request: Request) -> Literal:
        return goal_of(request, self._interpreter.library.goals)

    def watch_goals(self) -> None:
        """Report the states of goals if a plan of the library handles meta-events."""
        if self._interpreter.library.watches_goals and self.goal_states is None:
            self.goal_states = GoalStates(self._interpreter)
            self.unwound = True

    # Adopting

    def new(self, event: Request | None = None) -> Intention:
        intention = Intention(next(self.numbers), event)
        self._all[intention] = None
        return intention

    def register_running(self) -> Intention:
        """Make an `Intention` of the running one, if it is still a tuple."""
        item = self.running
        if item.__class__ is tuple:
            item = self.running = self.register(item)
        return item

    def register(self, queued: QueuedPlan) -> Intention:
        """Make an `Intention` of a queued plan."""
        body, plan, number, trigger, args, notes, cause = queued
        request = (SUBGOAL if trigger.goal else EVENT, trigger, args, notes, cause)
        intention = Intention(number, request)
        intention.frames.append((body, request if trigger.goal else None, plan))
        self._all[intention] = None
        return intention

    def _register_all(self) -> None:
        """Make an `Intention` of each tuple."""
        self._register_ready()
        for pause in self.waits.queued():
            intention = self.register(pause.intention)
            intention.pause, pause.intention = pause, intention

    def _register_ready(self) -> None:
        """Make an `Intention` of each tuple that is runnable or running."""
        known = {id(item): self.register(item) for item in self.ready if item.__class__ is tuple}
        if known:
            items = [known.get(id(item), item) for item in self.ready]
            self.ready.clear()
            self.ready.extend(items)
        running = self.running
        if running.__class__ is tuple:
            ended = running[0].gi_frame is None
            self.running = None if ended else known.get(id(running)) or self.register(running)

    def intend(
        self,
        event: Request,
        plan: CompiledPlan,
        result: Any,
        *,
        first: bool = False,
        began: Callable[[Intention], None] | None = None,
    ) -> None:
        """Create an intention with a plan for an event; ``first`` ones precede the other intentions.

        ``began`` gets the intention before its first step.
        """
        intention = self.new(event)
        if began is not None:
            began(intention)
        self._let_wait(intention, self._take_on(intention, None, plan, result))
        self.settle(intention, first=first)

    def _let_wait(self, intention: Intention, result: Any) -> None:
        """Let the intention of a plan whose first steps were executed in place wait for its next turn."""
        if result is not None and result is self._interpreter.begun and self._interpreter.events:
            intention.frames.append((once(None), None, None))

    def adopt(
        self, request: Request, ended: Callable[[Failure | None], None] | None = None, *, told: bool = False
    ) -> None:
        """Adopt a goal in a new intention; ``ended`` receives its failure, or None.

        Without ``ended``, the goal is queued until an atomic plan has ended. A goal that another agent ``told`` is
        adopted before the event of the turn, so that its intention has a step in this turn.
        """
        if self.atomic is not None and ended is None:
            self._interpreter.events.append(request[1:])
            return
        intention = self.new(request)
        intention.ended = ended
        result = self.pursue(intention, request)
        if not told:
            self._let_wait(intention, result)
        self.settle(intention)

    def adopt_with(self, request: Request, plan: CompiledPlan | None, result: Any) -> None:
        """Adopt a goal in a new intention, with the selected plan for it and its result."""
        intention = self.new(request)
        self._let_wait(intention, self.pursue(intention, request, (plan, result)))
        self.settle(intention)

    def adopt_within(self, request: Request, seconds: float) -> None:
        intention = self.new(request)
        intention.frames.append((once(TimedRequest(request, seconds)), None, None))
        self.settle(intention)

    def adopt_suspended(self, request: Request) -> None:
        """Adopt a goal in a new intention that starts after `.resume`."""
        intention = self.new(request)
        intention.frames.append((asking_for(request), None, None))
        intention.suspended = True

    def branch(self, body: Body, parent: Intention, ended: Callable[[Intention, Failure | None], None]) -> Intention:
        intention = self.new()
        intention.ended = lambda failure: ended(intention, failure)
        intention.frames.append((body, None, None))
        intention.atomic = parent.atomic
        intention.parent = parent
        self.ready.append(intention)
        return intention

    def settle(self, intention: Intention, first: bool = False) -> None:
        """Queue an intention with remaining steps for its turn, or ``first``; end an empty one."""
        frames = intention.frames
        if not intention.active:
            return
        self.pop_kept(frames)
        if not frames:
            self.end(intention, None)
        elif intention.pause is None and not intention.suspended:
            if first:
                # It follows the plans for meta-events at the begin of the queue.
                metas = takewhile(lambda item: item.__class__ is not tuple and item.is_meta, self.ready)
                self.ready.insert(sum(1 for _ in metas), intention)
            else:
                (self.ready.appendleft if intention.atomic else self.ready.append)(intention)

    def pop_kept(self, frames: list[Any]) -> None:
        while frames and frames[-1][0] is None:
            _, goal, plan = frames.pop()
            if plan is not KEPT:
                self.achieved(goal)

    def end(self, intention: Intention, failure: Failure | None) -> None:
        self._all.pop(intention, None)
        intention.active = False
        if self.running is intention:
            self.running = None
        if self.atomic is intention:
            self.atomic = None
        if intention.ended is not None:
            intention.ended(failure)

    def _take_on(self, intention: Intention, goal: Request | None, plan: CompiledPlan, result: Any) -> Any:
        """Continue with the result of a plan; return its body, if it has one."""
        if result.__class__ is tuple:
            self.replace_goal(intention, goal, plan)
            return self.pursue(intention, result)
        if result.__class__ is Failure:
            return self.fail_goal(intention, goal, result)
        self._push(intention, result, goal, plan, goal)
        return result

    def _push(
        self, intention: Intention, body: Body, goal: Request | None, plan: CompiledPlan, ends: Request | None
    ) -> None:
        """Push the body of a plan; its end is that of the goal ``ends``, also for a failure plan."""
        if body.__class__ is SpecialBody:
            body = body.body
        if self.goal_states is not None and ends is not None:
            body = WatchedBody(body, self.goal_states, ends)
        intention.frames.append((body, goal, plan))
        self.turn_may_end = True
        if plan.plan.atomic and not intention.atomic:
            intention.atomic = True
            self.atomic = intention

    def pursue(
        self, intention: Intention, request: Request, selected: tuple[CompiledPlan | None, Any] | None = None
    ) -> Any:
        """Select a plan for a goal and push it on the intention; follow a plan with a single goal at once.

        ``selected`` is the plan for the request and its result, if already known. Returns the pushed body, if any.
        """
        interpreter, states = self._interpreter, self.goal_states
        for _ in CHAIN:
            kind, trigger, args, notes, cause = request
            goal = None if kind & EVENT else request
            if goal is not None and interpreter.trace.sink is not None:
                cause = interpreter.trace.record("goal", str(self.goal(request)), cause)
                goal = (kind, trigger, args, notes, cause)
            if states is not None and goal is not None:
                states.pending(goal)
            if selected is not None:
                (plan, result), selected = selected, None
            else:
                if trigger.key in self.waits.events:
                    self.waits.notify(trigger.key, args, notes, outside=goal is not None)
                plan, result = interpreter.select_plan(trigger, args, notes, cause, bool(kind & OPEN))
            if result is None:
                if goal is not None:
                    return self.fail_goal(intention, goal, no_plan(interpreter, goal, intention))
                if interpreter.trace.sink is not None:
                    unhandled(interpreter, trigger, args, notes, cause)
                return None
            if states is not None and goal is not None:
                states.executing(goal)
            if result is DONE:
                self.achieved(goal)
                return None
            assert plan is not None
            if goal is not None and kind & OPEN and self.failure_plans(goal).plans:
                goal = OpenRequest(goal)
            if result.__class__ is not tuple:
                return self._take_on(intention, goal, plan, result)
            self.replace_goal(intention, goal, plan)
            request = result
            others = interpreter.events or interpreter.inbox or interpreter.peers or self.ready
            if others and not intention.atomic:
                break
        intention.frames.append((asking_for(request), None, None))
        self.turn_may_end = True
        return None

    def replace_goal(self, intention: Intention, goal: Request | None, plan: CompiledPlan) -> None:
        """Replace a goal by the last goal of its plan; keep a goal with failure plans below it."""
        if goal is None:
            return
        if self.failure_plans(goal).plans:
            intention.frames.append((None, goal, plan))
            return
        if self.goal_states is not None:
            self.goal_states.replaced(goal)
        if self._interpreter.trace.sink is not None:
            self._interpreter.trace.record("continued", str(self.goal(goal)), goal[4])

    def finished_plan(self, intention: Intention, ended: Frame) -> None:
        """Record the end of a plan that was popped."""
        _, goal, plan = ended
        self.record_achieved(goal)
        if intention.atomic:
            self.finished_atomic(intention, plan)

    def finished_atomic(self, intention: Intention, plan: CompiledPlan | None) -> None:
        """Release the other intentions after the last atomic plan of an intention."""
        if intention.atomic and plan is not None and plan is not KEPT and plan.plan.atomic:
            held = any(other and other is not KEPT and other.plan.atomic for _, _, other in intention.frames)
            intention.atomic = held
            if not held and self.atomic is intention:
                self.atomic = None

    def achieved(self, goal: Request | None) -> None:
        if self.goal_states is not None:
            self.goal_states.finished(goal, "achieved")
        self.record_achieved(goal)

    def record_achieved(self, goal: Request | None) -> None:
        if goal is not None and self._interpreter.trace.sink is not None and not goal[0] & EVENT:
            self._interpreter.trace.record("achieved", str(self.goal(goal)), goal[4])

    # Pauses

    def rest(self, intention: Intention, pause: Pause) -> None:
        intention.pause = pause
        if self.goal_states is not None:
            self.goal_states.waiting(intention)
        try:
            pause.begin(self._interpreter, intention)
        except Exception as problem:  # noqa: BLE001 - a long action is user code
            intention.pause = None
            self._fail_step(intention, problem)

    def resume(self, intention: Any, problem: Exception | None = None) -> None:
        """Continue an intention after a pause, or fail its step."""
        if intention.__class__ is tuple:
            if problem is None and self.goal_states is None:
                self.ready.append(intention)
                return
            intention = self.register(intention)
        if not intention.active:
            return
        intention.pause = None
        if problem is not None:
            self._fail_step(intention, problem)
        elif self.goal_states is not None:
            self.goal_states.woken(intention)
        self.settle(intention)

    def pursue_timed(self, intention: Intention, timed: TimedRequest) -> None:
        """Pursue a goal with a time limit."""
        kind, trigger, args, notes, cause = timed.request
        marker = (kind & ~TAIL, trigger, args, notes, cause)
        intention.frames.append((None, marker, KEPT))

        def over() -> bool:
            return not intention.active or all(goal is not marker for _, goal, _ in intention.frames)

        def give_up() -> None:
            frames = intention.frames
            while frames[-1][1] is not marker or frames[-1][2] is not KEPT:
                self.close(intention, frames.pop())
            frames.pop()
            hard = any(getattr(note, "functor", "") == "hard_deadline" for note in notes)
            problem = Failed("deadline_reached" if hard else "timeout", f"not achieved in {timed.seconds} s")
            self.fail_goal(intention, marker, failure_of(self._interpreter, None, problem, marker))
            self.settle(intention)

        self._interpreter.timers.after(timed.seconds, lambda: self.interrupt(intention, give_up), over)
        self.pursue(intention, marker)

    # Failures

    def _fail_step(self, intention: Intention, problem: Exception) -> None:
        """Fail the step of a paused intention."""
        frame = intention.frames.pop()
        body, goal, plan = frame
        cause = body.gi_frame.f_locals.get("c") if body is not None and body.gi_frame is not None else None
        found = failure_of(self._interpreter, plan, problem, goal, cause)
        term = None if body is None or plan is None or plan is KEPT else waiting_term(body, plan)
        if term is not None:
            found.term = lambda: term
        self.close(intention, frame)
        self.fail_goal(intention, goal, found)

    def fail_goal(self, intention: Intention, goal: Request | None, problem: Failure) -> Any:
        """Replace a failed goal by its failure plan, or fail the goals below it until one recovers; return its body."""
        states = self.goal_states
        failing = None if states is None else states.failed(intention, goal, problem, self.failure_plans)
        began = problem.reason not in ("no_relevant", "no_applicable")  # the goal had a plan
        left: Any = problem if goal is None else self._recover(intention, goal, problem, began=began)
        frames, where = intention.frames, problem.where
        while left.__class__ is Failure and frames:
            problem = left
            frame = frames.pop()
            where = where or origin_of(frame[2])
            self.close(intention, frame)
            if frame[1] is not None and frame[2] is not KEPT:
                left = self._recover(intention, frame[1], problem, began=True)
        if left.__class__ is Failure:
            what = left.message if left.step in left.message else f"{left.step}: {left.message}"
            places, trace = [str(left.where or where or "")], self._interpreter.trace
            if left.raised_at and left.raised_at != os.path.basename(places[0]):
                places.append(f"raised at {left.raised_at}")
            place = ", ".join(filter(None, places))
            log().warning("%s: %s%s", trace.name, what, f" ({place})" if place else "")
            trace.record("dropped", "intention", left.cause, reason=left.reason, message=left.message)
            if states is not None and failing is not None:
                states.lost(failing)
            self.end(intention, left)
        return left

    def _recover(self, intention: Intention, goal: Request, problem: Failure, *, began: bool) -> Any:
        """Push the failure plan of a goal and return its body, or the remaining failure if no plan applies or it fails.

        A goal that ``began`` remains below its failure plan for plans that look for it.
        """
        trigger = self.failure_plans(goal)
        if not trigger.plans and not self.waits.events:
            return problem
        kind, _, args, notes, _ = goal
        if isinstance(goal, OpenRequest):
            args, notes = goal.undo()
        elif kind & OPEN:
            free((args, notes))  # a failed plan gives no values
        args = resolve(args)
        if trigger.annotated or self.waits.events or self._interpreter.trace.sink is not None:
            notes = problem.annotations + notes
        if self.waits.events:
            self.waits.notify(trigger.key, args, notes)
        plan, result = self._interpreter.select_plan(trigger, args, notes, problem.cause, not closed(args))
        if result is None:
            return problem
        if result.__class__ is Failure:
            return result
        if result.__class__ is tuple:
            result = asking_for(result)
        frames = intention.frames
        if frames and frames[-1][2] is KEPT:
            kept = frames[-1][1]
            if kept is not None and kept[1] is goal[1] and kept[2] is goal[2]:
                frames.pop()  # the time limit of a goal does not apply to its failure plan
        if result is DONE:
            if self.goal_states is not None:
                self.goal_states.finished(goal, "achieved")
        else:
            assert plan is not None
            pending = intention.event is not None and intention.event[1] is trigger
            if began and not pending and self._interpreter.library.keeps_goals:
                kind, *others = goal
                frames.append((None, (kind | EVENT, *others), KEPT))  # type: ignore[arg-type]
            self._push(intention, result, None, plan, goal)
        return result

    def failure_plans(self, goal: Request) -> Trigger:
        trigger = goal[1]
        if trigger.failure is None:
            trigger.failure = self._interpreter.triggers[f"-{trigger.key[1:]}"]
        return trigger.failure

    def close(self, intention: Intention, frame: Any) -> None:
        """End the plan of a frame that was popped."""
        body, _, plan = frame
        if body is not None and not body.gi_running:
            body.close()
        if intention.atomic:
            self.finished_atomic(intention, plan)

    # Interruption

    def interrupt(self, intention: Intention, then: Callable[[], None]) -> None:
        """Stop the current step of an intention, then call ``then``."""
        if intention in self.ready:
            self.ready.remove(intention)
        pause = intention.pause
        if pause is None:
            then()
            return

        def stopped() -> None:
            intention.pause = None
            then()

        # The pause remains until its end: a second interruption has to wait for it as well.
        pause.cancel(stopped)

    def drop(self, intention: Intention, then: Callable[[], None] | None = None) -> None:
        """End an intention; call ``then`` after its current action has stopped."""
        self._all.pop(intention, None)
        intention.active = False
        if self.atomic is intention:
            self.atomic = None
        if self.goal_states is not None:
            self.goal_states.dropped(intention)

        self.unwound = True

        def close() -> None:
            cause = next((goal[4] for _, goal, _ in reversed(intention.frames) if goal is not None), "")
            while intention.frames:
                self.close(intention, intention.frames.pop())
            self._interpreter.trace.record("dropped", "intention", cause, reason="cancelled")
            if intention.ended is not None:
                intention.ended(Failure("cancelled", REASONS["cancelled"], "", ""))
            if then is not None:
                then()

        self.interrupt(intention, close)
