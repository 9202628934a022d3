"""The reasoner: one event a turn, and one step of one intention."""

from __future__ import annotations

import heapq
from collections.abc import Collection
from itertools import repeat
from typing import Any

from socialbot.bdi.belief_base import Notes
from socialbot.bdi.beliefs import Args
from socialbot.bdi.compiler.runtime import DONE, END, EVENT, SUBGOAL, TAIL
from socialbot.bdi.intention_stack import Pursuit, Timed
from socialbot.bdi.intentions import Intention
from socialbot.bdi.library import Trigger

STEPS = 8
"""So many steps an intention makes in its turn when nobody else waits; then the clock is looked at."""


class Reasoner(Pursuit):
    """Gives events, timers, messages and intentions their turns."""

    __slots__ = ("others", "signalled")

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.signalled = False
        # Whom a plan for an event lets go first. While an event has its turn these are not the other events.
        self.others: Collection[Any] = self.events

    # The cycle

    def run_until_idle(self, budget: int = 10_000) -> bool:
        """Reasons until nothing is left to do now, or ``budget`` turns are made; True when something is left.

        In a turn the agent takes in what was posted, looks at what is due, handles one event and makes a step of one
        intention (more steps when nobody else waits).
        """
        self.signalled = False
        inbox, events, ready = self.inbox, self.events, self.ready
        while budget > 0:
            budget -= 1
            trigger: Trigger | None = None
            args: Args = ()
            notes: Notes = ()
            cause: Any = None
            if inbox:
                item = inbox.popleft()
                if inbox or events or item.__class__ is not tuple:
                    inbox.appendleft(item)
                    self._take_in()
                else:
                    # What comes alone is looked at without a detour through the queue: most percepts do.
                    relation, args, notes, cause, since = item
                    if args in relation.facts or relation.care or self.sink is not None:
                        self._take(item)
                    else:
                        relation.facts[args] = (self._now() if since is None else since, notes, cause)
                        if relation.indexes:
                            relation.enter(args)
                        trigger = relation.added
            if self._timers and self._timers[0][0] <= self._now():
                self._ring()
            if self._atomic is not None:
                if trigger is not None:
                    events.append((trigger, args, notes, cause))
                if not self._advance_atomic() and not inbox and not self._wake_atomic():
                    return False
                continue
            if trigger is None and events:
                trigger, args, notes, cause = events.popleft()
                if trigger.goal:
                    self.adopt((SUBGOAL, trigger, args, notes, cause))
                    trigger = None
            if trigger is not None:
                position = trigger.position
                if events:
                    self.others = ()
                for plan in trigger.plans if position is None else trigger.by.get(args[position], trigger.rest):
                    try:
                        result = plan.run(self, args, notes, cause)
                    except Exception as problem:  # noqa: BLE001 - a condition is user code
                        self._condition_failed(plan, problem, cause)
                        continue
                    if result is not None:
                        if result is not DONE:
                            self._intend((EVENT, trigger, args, notes, cause), plan, result)
                        break
                self.others = events
                if self.waiting:
                    self._notify(trigger.key, args, notes)
            if ready:
                self._advance(ready.popleft())
            if self.conditions:
                self._recheck()
            busy = events or ready or inbox or self._atomic
            if not busy and (not self._timers or self._timers[0][0] > self._now()):
                return False
        return bool(inbox or events or ready)

    def _take_in(self) -> None:
        """Takes in all that was posted."""
        inbox = self.inbox
        while inbox:
            item = inbox.popleft()
            self._take(item)

    def _take(self, item: Any) -> None:
        try:
            if item.__class__ is tuple:
                self.add(*item)
            else:
                item()
        except Exception as problem:  # noqa: BLE001 - what comes from outside never stops the agent
            self.record_failure("inbox", "", problem)

    def _ring(self) -> None:
        timers, now = self._timers, self._now()
        while timers and timers[0][0] <= now:
            callback = heapq.heappop(timers)[2]
            try:
                callback()
            except Exception as problem:  # noqa: BLE001 - a sensor or a step behind a timer is user code
                self.record_failure("timer", "", problem)

    def _recheck(self) -> bool:
        """Lets intentions go on whose condition holds by now."""
        woken = False
        for pause in list(self.conditions):
            try:
                holds, problem = pause.check(), None
            except Exception as error:  # noqa: BLE001 - a condition is user code
                holds, problem = True, error
            if holds:
                self.conditions.remove(pause)
                pause.end(problem)
                woken = True
        return woken

    # Intentions

    def _advance(self, intention: Intention) -> None:
        """Makes steps of an intention, until others want their turn."""
        frames = intention.frames
        if intention.suspended or intention not in self.intentions:
            return
        self.current = intention
        for _ in repeat(None, STEPS):
            body, goal, plan = frames[-1]
            result: Any = None
            self._fresh = True
            try:
                result = next(body, END)  # type: ignore[arg-type]
            except Exception as problem:  # noqa: BLE001 - actions are user code: they fail their goal, never the agent
                frames.pop()
                self._finished_atomic(intention, plan)
                self._fresh = False
                self._fail_goal(intention, goal, self._failure(plan, problem, goal))
                body = frames[-1][0] if frames else None
            if not frames or frames[-1][0] is not body:
                # It has ended a goal of its own intention.
                result = None
            if result is END:
                frames.pop()
                self._finished(intention, goal, plan)
                self._fresh = False
            elif result.__class__ is tuple:
                if result[0] & TAIL:
                    frames.pop()
                    self._finished_atomic(intention, plan)
                    if plan is not None:
                        self._replace_goal(intention, goal, plan)
                self._fresh = False
                self._pursue(intention, result)
            elif result.__class__ is Timed:
                self._pursue_timed(intention, result)
            elif result is not None:
                self._rest(intention, result)
                if intention.pause is not None or not frames:
                    return
            if frames and frames[-1][0] is None:
                self._pop_kept(frames)
            if not frames:
                if intention in self.intentions:
                    self._end(intention, None)
                return
            if intention.suspended or intention.pause is not None:
                return
            # A plan whose goal has been dealt with goes on to the end of its step.
            if self._fresh and (self.ready or self.events or self.inbox) and not intention.atomic:
                break
        self.ready.append(intention)

    def _advance_atomic(self) -> bool:
        """Makes steps of the atomic intention only; False when it rests."""
        intention = self._atomic
        assert intention is not None
        for candidate in list(self.ready):
            if candidate is intention or candidate.atomic:
                self.ready.remove(candidate)
                self._advance(candidate)
                return True
        return False

    def _wake_atomic(self) -> bool:
        """Whether what the atomic intention waits for has come: events it leaves alone, but it may wait for one."""
        self._recheck()
        for trigger, args, notes, _ in list(self.events):
            if trigger.key in self.waiting:
                self._notify(trigger.key, args, notes)
        return any(intention.atomic for intention in self.ready)
