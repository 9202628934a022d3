"""Pursuit: goals choose plans, plans become intentions; failure finds who handles it, or ends them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import repeat
from typing import Any

from socialbot.bdi.belief_base import Memory, Notes
from socialbot.bdi.beliefs import Args
from socialbot.bdi.compiler.runtime import DONE, EVENT, OPEN, TAIL
from socialbot.bdi.explain import reasons_against
from socialbot.bdi.intentions import REASONS, Body, Failed, Failure, Intention, Pause, Request, failure, goal_of
from socialbot.bdi.library import Ready, Trigger, record_behind
from socialbot.bdi.log import log
from socialbot.bdi.unification import closed, free, resolve

CHAIN = 64
"""So many goals it may follow in one of these steps, when each plan's last step is a goal."""

KEPT = Ready.__new__(Ready)
"""Stands for the plan of a frame that only keeps a goal with a time limit."""


class Timed:
    """A request with a time limit."""

    __slots__ = ("request", "seconds")

    def __init__(self, request: Request, seconds: float) -> None:
        self.request = request
        self.seconds = seconds


class Deadline:
    """What a timer calls when the time for a goal is up."""

    __slots__ = ("intention", "marker", "reasoner", "seconds")

    def __init__(self, reasoner: Pursuit, intention: Intention, marker: Request, seconds: float) -> None:
        self.reasoner = reasoner
        self.intention = intention
        self.marker = marker
        self.seconds = seconds

    def __call__(self) -> None:
        if not self.over():
            self.reasoner._expire(self.intention, self.marker, self.seconds)

    def over(self) -> bool:
        """Whether the goal has been achieved, or has failed."""
        return self.intention not in self.reasoner.intentions or all(
            goal is not self.marker for _, goal, _ in self.intention.frames
        )


class Pursuit(Memory):
    """What an agent is about: its intentions, how they grow with goals, and how they shrink when these fail."""

    __slots__ = (
        "_atomic", "_begun", "_fresh", "_numbers", "conditions", "current", "inbox", "intentions", "ready", "waiting",
    )  # fmt: skip

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.inbox: deque[Any] = deque()
        self.ready: deque[Intention] = deque()
        self.waiting: dict[str, list[Any]] = {}
        self.conditions: list[Any] = []
        self.intentions: dict[Intention, None] = {}
        self.current: Intention | None = None
        self._atomic: Intention | None = None
        self._begun: Body | None = None
        self._fresh = False
        self._numbers = 0

    # Intentions

    def _new(self, event: Request | None = None) -> Intention:
        self._numbers += 1
        intention = Intention(self._numbers, event)
        self.intentions[intention] = None
        return intention

    def _intend(self, event: Request, plan: Ready, result: Any) -> None:
        """Makes an intention of what a plan has to do about an event."""
        intention = self._new(event)
        self._take_on(intention, None, plan, result)
        if self.events:
            self._let_wait(intention)
        self._settle(intention)

    def hand_over(self, body: Body) -> Body:
        """Notes that a plan which ran in place has made steps, and goes on as ``body`` now that others wait."""
        self._begun = body
        return body

    def _let_wait(self, intention: Intention) -> None:
        """Lets a plan that has made steps already, as nobody waited then, make no more of them in this turn."""
        if self._begun is not None and intention.frames and intention.frames[-1][0] is self._begun:
            intention.frames.append((_turn(), None, None))
        self._begun = None

    def adopt(self, request: Request, ended: Callable[[Failure | None], None] | None = None) -> None:
        """Takes on a goal in an intention of its own; while a plan is atomic, when that has ended.

        ``ended`` is called with how that went; who waits for that does not wait for an atomic plan.
        """
        if self._atomic is not None and ended is None:
            self.events.append(request[1:])
            return
        intention = self._new(request)
        intention.ended = ended
        self._pursue(intention, request)
        if self.events:
            self._let_wait(intention)
        self._settle(intention)

    def adopt_within(self, request: Request, seconds: float) -> None:
        """Takes on a goal that fails when it takes longer, in an intention of its own."""
        intention = self._new(request)
        intention.frames.append((_timed(request, seconds), None, None))
        self._settle(intention)

    def branch(self, body: Body, parent: Intention, ended: Callable[[Intention, Failure | None], None]) -> Intention:
        """Begins an intention for a branch of another one."""
        intention = self._new()
        intention.ended = lambda failure: ended(intention, failure)
        intention.frames.append((body, None, None))
        intention.atomic = parent.atomic
        self.ready.append(intention)
        return intention

    def _settle(self, intention: Intention) -> None:
        """Puts an intention that has something to do in line for its turn."""
        frames = intention.frames
        if intention not in self.intentions:
            return
        self._pop_kept(frames)
        if frames:
            if intention.pause is None and not intention.suspended:
                (self.ready.appendleft if intention.atomic else self.ready.append)(intention)
        else:
            self._end(intention, None)

    def _pop_kept(self, frames: list[Any]) -> None:
        """Takes off the goals that were kept for the sake of their failure plans, and have been achieved by now."""
        while frames and frames[-1][0] is None:
            _, goal, plan = frames.pop()
            if plan is not KEPT:
                self._achieved(goal)

    def _end(self, intention: Intention, failure: Failure | None) -> None:
        self.intentions.pop(intention, None)
        if self.current is intention:
            self.current = None
        if self._atomic is intention:
            self._atomic = None
        if intention.ended is not None:
            intention.ended(failure)

    def _take_on(self, intention: Intention, goal: Request | None, plan: Ready, result: Any) -> None:
        """Puts what a plan has to do on an intention."""
        if result.__class__ is tuple:
            self._replace_goal(intention, goal, plan)
            self._pursue(intention, result)
        elif result.__class__ is Failure:
            self._fail_goal(intention, goal, result)
        else:
            self._push(intention, result, goal, plan)

    def _push(self, intention: Intention, body: Body, goal: Request | None, plan: Ready) -> None:
        intention.frames.append((body, goal, plan))
        self._fresh = True
        if plan.plan.atomic and not intention.atomic:
            intention.atomic = True
            self._atomic = intention

    def _pursue(self, intention: Intention, request: Request) -> None:
        """Chooses a plan for a goal and puts it on the intention. A plan that is only a goal is followed at once."""
        for _ in repeat(None, CHAIN):
            kind, trigger, args, notes, cause = request
            goal = None if kind & EVENT else request
            if goal is not None and self.sink is not None:
                cause = self.record("goal", str(goal_of(request, self.library.goals)), cause)
                goal = (kind, trigger, args, notes, cause)
            if self.waiting:
                self._notify(trigger.key, args, notes)
            plan, result = self._choose(trigger, args, notes, cause, bool(kind & OPEN))
            if result is None:
                if goal is not None:
                    self._fail_goal(intention, goal, self._no_plan(goal))
                return
            if result is DONE:
                self._achieved(goal)
                return
            assert plan is not None
            if result.__class__ is not tuple:
                self._take_on(intention, goal, plan, result)
                return
            self._replace_goal(intention, goal, plan)
            request = result
        intention.frames.append((_later(request), None, None))
        self._fresh = True

    def _choose(self, trigger: Trigger, args: Args, notes: Notes, cause: Any, opened: bool) -> tuple[Ready | None, Any]:
        """The first plan that applies, and what it has to do."""
        for plan in trigger.plans if opened else trigger.candidates(args):
            try:
                result = (plan.run_open if opened else plan.run)(self, args, notes, cause)
            except Exception as problem:  # noqa: BLE001 - a condition is user code
                self._condition_failed(plan, problem, cause)
                if opened:
                    free(args)
                continue
            if result is not None:
                return plan, result
        return None, None

    def _replace_goal(self, intention: Intention, goal: Request | None, plan: Ready) -> None:
        """A plan has made its last step a goal, which stands for its own from now on; only failure plans need that."""
        if goal is None:
            return
        if self._handlers(goal).plans:
            intention.frames.append((None, goal, plan))
        elif self.sink is not None:
            self.record("continued", str(goal_of(goal, self.library.goals)), goal[4])

    def _finished(self, intention: Intention, goal: Request | None, plan: Ready | None) -> None:
        self._achieved(goal)
        self._finished_atomic(intention, plan)

    def _finished_atomic(self, intention: Intention, plan: Ready | None) -> None:
        if intention.atomic and plan is not None and plan is not KEPT and plan.plan.atomic:
            held = any(ready and ready is not KEPT and ready.plan.atomic for _, _, ready in intention.frames)
            intention.atomic = held
            if not held and self._atomic is intention:
                self._atomic = None

    def _achieved(self, goal: Request | None) -> None:
        if goal is not None and self.sink is not None and not goal[0] & EVENT:
            self.record("achieved", str(goal_of(goal, self.library.goals)), goal[4])

    def _rest(self, intention: Intention, pause: Pause) -> None:
        """Lets an intention rest."""
        intention.pause = pause
        try:
            pause.begin(self, intention)
        except Exception as problem:  # noqa: BLE001 - a long action is user code
            intention.pause = None
            self._fail_step(intention, problem)

    def resume(self, intention: Intention, problem: Exception | None = None) -> None:
        """Lets an intention go on after a pause, or fail."""
        if intention not in self.intentions:
            return
        intention.pause = None
        if problem is not None:
            self._fail_step(intention, problem)
            self._settle(intention)
        elif not intention.suspended:
            self.ready.append(intention)

    def _pursue_timed(self, intention: Intention, timed: Timed) -> None:
        kind, trigger, args, notes, cause = timed.request
        marker = (kind & ~TAIL, trigger, args, notes, cause)
        intention.frames.append((None, marker, KEPT))
        self.at_in(timed.seconds, Deadline(self, intention, marker, timed.seconds))
        self._pursue(intention, marker)

    def _expire(self, intention: Intention, marker: Request, seconds: float) -> None:
        """The time for a goal is up: whatever is done for it ends, and it has failed."""

        def give_up() -> None:
            frames = intention.frames
            while frames[-1][1] is not marker or frames[-1][2] is not KEPT:
                self._close(intention, frames.pop())
            frames.pop()
            problem = Failed("timeout", f"not achieved in {seconds} s")
            self._fail_goal(intention, marker, self._failure(None, problem, marker))
            self._settle(intention)

        self.interrupt(intention, give_up)

    # Failure

    def _no_plan(self, goal: Request) -> Failure:
        _, trigger, args, notes, cause = goal
        reasons = reasons_against(self, trigger, args, notes) if self.sink is not None and closed(args) else []
        reason = "no_applicable" if trigger.plans else "no_relevant"
        what = str(goal_of(goal, self.library.goals))
        message = f"no {'applicable ' if trigger.plans else ''}plan for {what}"
        record = self.record("failure", what, cause, reason=reason, message=message, rejected=reasons)
        return Failure(reason, message, what, record)

    def broken(self, plan: Ready, problem: Exception, cause: Any) -> Failure:
        """What an exception in a body that runs in place amounts to."""
        return self._failure(plan, problem, None, cause)

    def _failure(self, plan: Ready | None, problem: Exception, goal: Request | None, cause: Any = None) -> Failure:
        step = plan.step_at(problem) if plan is not None and plan is not KEPT else None
        what = "step" if goal is None else str(goal_of(goal, self.library.goals))
        if step is not None and plan is not None:
            from socialbot.bdi.explain import written

            what = written(step, plan.plan)
        if cause is None:
            cause = record_behind(problem) or (goal[4] if goal is not None else "")
        found = failure(problem, what, cause)
        log().info("%s: %s: %s", self.name, what, found.message)
        record = self.record("failure", what, cause, reason=found.reason, message=found.message)
        return Failure(found.reason, found.message, what, record, found.more, _origin(plan))

    def _fail_step(self, intention: Intention, problem: Exception) -> None:
        """The step at which an intention rests has failed."""
        frame = intention.frames.pop()
        body, goal, plan = frame
        cause = body.gi_frame.f_locals.get("c") if body is not None and body.gi_frame is not None else None
        found = self._failure(plan, problem, goal, cause)
        self._close(intention, frame)
        self._fail_goal(intention, goal, found)

    def _fail_goal(self, intention: Intention, goal: Request | None, problem: Failure) -> None:
        """Has a failure plan take the place of the failed one, or fails the goal below, and so on."""
        left = problem if goal is None else self._recover(intention, goal, problem)
        frames, where = intention.frames, problem.where
        while left is not None and frames:
            problem = left
            frame = frames.pop()
            where = where or _origin(frame[2])
            self._close(intention, frame)
            if frame[1] is not None and frame[2] is not KEPT:
                left = self._recover(intention, frame[1], problem)
        if left is not None:
            what = left.message if left.step in left.message else f"{left.step}: {left.message}"
            place = left.where or where
            log().warning("%s: %s%s", self.name, what, f" ({place})" if place else "")
            self.record("dropped", "intention", left.cause, reason=left.reason, message=left.message)
            self._end(intention, left)

    def _recover(self, intention: Intention, goal: Request, problem: Failure) -> Failure | None:
        """Takes up the failure plan of a goal; returns the failure that goes on when there is none, or it fails."""
        trigger = self._handlers(goal)
        if not trigger.plans:
            return problem
        _, _, args, notes, _ = goal
        args = resolve(args)
        plan, result = self._choose(trigger, args, problem.annotations + notes, problem.cause, not closed(args))
        if result is None:
            return problem
        if result.__class__ is Failure:
            return result
        if result.__class__ is tuple:
            result = _later(result)
        frames = intention.frames
        if frames and frames[-1][2] is KEPT:
            kept = frames[-1][1]
            if kept is not None and kept[1] is goal[1] and kept[2] is goal[2]:
                frames.pop()  # the limit was that of the goal, not of the plan for its failure
        if result is not DONE:
            assert plan is not None
            self._push(intention, result, None, plan)
        return None

    def _handlers(self, goal: Request) -> Trigger:
        return self.triggers[f"-{goal[1].key[1:]}"]

    def _close(self, intention: Intention, frame: Any) -> None:
        body, _, plan = frame
        if body is not None and not body.gi_running:
            body.close()
        self._finished_atomic(intention, plan)

    # Interruption

    def interrupt(self, intention: Intention, then: Callable[[], None]) -> None:
        """Stops what an intention is about, and calls ``then`` when that has stopped."""
        if intention in self.ready:
            self.ready.remove(intention)
        pause = intention.pause
        if pause is None:
            then()
            return

        def stopped() -> None:
            intention.pause = None
            then()

        # The pause stays until it has ended: who interrupts again before that has to wait as well.
        pause.cancel(stopped)

    def drop(self, intention: Intention, then: Callable[[], None] | None = None) -> None:
        """Ends an intention; ``then`` is called when its action, if there is one, has stopped."""
        self.intentions.pop(intention, None)
        if self._atomic is intention:
            self._atomic = None

        def close() -> None:
            cause = next((goal[4] for _, goal, _ in reversed(intention.frames) if goal is not None), "")
            while intention.frames:
                body = intention.frames.pop()[0]
                if body is not None and not getattr(body, "gi_running", False):
                    body.close()
            self.record("dropped", "intention", cause, reason="cancelled")
            if intention.ended is not None:
                intention.ended(Failure("cancelled", REASONS["cancelled"], "", ""))
            if then is not None:
                then()

        self.interrupt(intention, close)

    def unwind(self, intention: Intention, wanted: Callable[[Request], bool], problem: Failure | None = None) -> None:
        """Ends what an intention does for the outermost goal that is ``wanted``: it is achieved, or has failed."""
        frames = intention.frames
        goals = [goal for _, goal, _ in frames]
        depth = next((i for i, goal in enumerate(goals) if goal is not None and wanted(goal)), 0)
        goal = goals[depth] if goals and goals[depth] is not None else intention.event
        running = any(body is not None and body.gi_running for body, _, _ in frames)
        while len(frames) > depth:
            self._close(intention, frames.pop())
        if problem is None:
            self._achieved(goal)
        else:
            self._fail_goal(intention, goal, problem)
        if not running:
            self._settle(intention)

    def fail_request(self, request: Request, problem: Failure) -> None:
        """Has a goal fail before anything was done for it."""
        intention = self._new(request)
        self._fail_goal(intention, request, problem)
        self._settle(intention)

    # Waiting for events

    def _notify(self, key: str, args: Args, notes: Notes) -> None:
        """Lets intentions go on that wait for this event."""
        for pause in list(self.waiting.get(key, ())):
            if pause.hear(args, notes):
                self.unlisten(pause)
                pause.end()

    def unlisten(self, pause: Any) -> None:
        """Waits no longer for an event."""
        pauses = self.waiting.get(pause.key, [])
        if pause in pauses:
            pauses.remove(pause)
            if not pauses:
                del self.waiting[pause.key]

    def _condition_failed(self, plan: Ready, problem: Exception, cause: Any) -> None:
        self.record_failure(str(plan.plan), cause, problem)


def _origin(ready: Ready | None) -> str:
    """Where a plan was written, if that is known."""
    return "" if ready is None or ready is KEPT or ready.plan.origin is None else str(ready.plan.origin)


def _turn() -> Body:
    """A body that only lets a turn pass."""
    yield


def _later(request: Request) -> Body:
    """A body that only asks for a goal."""
    kind, *rest = request
    yield (kind | TAIL if not kind & EVENT else kind, *rest)  # type: ignore[misc]


def _timed(request: Request, seconds: float) -> Body:
    """A body that only asks for a goal, with a limit."""
    yield Timed(request, seconds)
