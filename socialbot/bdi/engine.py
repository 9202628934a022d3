"""The engine: events choose rules, rules become intentions, intentions act, one step at a time.

An engine is passive: `Engine.run_until_idle` does what there is to do, `Engine.next_wakeup` tells
when there will be more. `Engine.run` does both for a program that has no other loop. Everything may be posted from
any thread; everything happens in the thread that runs the engine.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from socialbot.bdi.actions import Action, PlanFailed
from socialbot.bdi.beliefs import BeliefBase, Held
from socialbot.bdi.intentions import Frame, Intention, Mind
from socialbot.bdi.literals import Belief, Change, Event, Goal, Literal, Reactor
from socialbot.bdi.rules import Rule
from socialbot.bdi.sensors import Sensor, changes
from socialbot.bdi.terms import Bindings, Term, unify
from socialbot.bdi.trace import Record, Sink
from socialbot.clock import SECOND, Clock, nanoseconds
from socialbot.errors import RuleError

log = logging.getLogger("socialbot.bdi")


@dataclass(frozen=True, slots=True)
class _Happening:
    """An event that waits for a rule; ``rule`` is set when it concerns that one only."""

    change: Change
    literal: Literal
    record: str
    rule: Rule | None = None


@dataclass(slots=True)
class _Choice:
    """The rule chosen for an event, what its variables stand for, and the rules whose condition did not hold."""

    rule: Rule | None = None
    bindings: Bindings = field(default_factory=dict)
    rejected: list[Rule] = field(default_factory=list)


class Engine:
    """One agent: its beliefs, rules, sensors and intentions.

    ``robot`` is whatever the actions act upon; ``sink`` takes the trace; ``wake`` is called, from any
    thread, when something was posted.
    """

    def __init__(
        self,
        name: str,
        clock: Clock,
        *,
        robot: Any = None,
        sink: Sink | None = None,
        wake: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.clock = clock
        self.robot = robot
        self.beliefs = BeliefBase()
        self._sink = sink
        self._posted = threading.Event()
        self._wake = wake or (lambda: None)
        self._stopping = False
        self._rules: dict[tuple[Change, str, int], list[Rule]] = {}
        self._inbox: deque[Callable[[], None]] = deque()
        self._events: deque[_Happening] = deque()
        self._intentions: deque[Intention] = deque()
        self._suspended: dict[Intention, int] = {}
        self._current: Intention | None = None
        self._timers: list[tuple[int, int, Callable[[], None]]] = []
        self._sequence = itertools.count()
        self._records = itertools.count(1)

    # What an agent is made of

    def add_rules(self, *rules: Rule) -> None:
        """Adds rules; of those that fit an event, the first one whose condition holds is chosen."""
        for rule in rules:
            if not isinstance(rule, Rule):
                raise RuleError(f"{rule!r} is no rule", remedy="write event / condition >> [steps]")
            self._rules.setdefault(rule.event.key, []).append(rule)
            if rule.event.change is Change.HELD:
                for held in self.beliefs:
                    if held.belief.key == rule.event.literal.key:
                        self._watch(held, rule)

    def add_sensor(self, sensor: Sensor) -> None:
        """Adds a sensor; one with a period is asked from now on."""
        if sensor.period_s is not None:
            if not sensor.period_s > 0:
                where = type(sensor).__name__
                raise RuleError(f"a period of {sensor.period_s} s", where=where, remedy="give more than 0 s, or None")
            self._poll(sensor, sensor.period_s)

    # What others may call, from any thread

    def perceive(self, sensor: Sensor, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Shows ``percept`` to ``sensor``; ``since`` (ns) is the time it speaks of, now if not given."""
        self._post(functools.partial(self._sense, sensor, percept, cause, since))

    def believe(self, belief: Belief, *, source: str = "outside", cause: str = "") -> None:
        """Holds ``belief`` from now on; believing again what is believed is no event."""
        _check_ground(belief)
        self._post(functools.partial(self._add, belief, source, cause, None))

    def forget(self, belief: Belief, *, cause: str = "") -> None:
        """Holds ``belief`` no longer."""
        self._post(functools.partial(self._remove, belief, cause))

    def achieve(self, goal: Goal, *, cause: str = "") -> None:
        """Adopts ``goal`` in an intention of its own."""
        _check_ground(goal)
        self._post(functools.partial(self._adopt, goal, cause))

    def stop(self) -> None:
        """Ends `run`."""
        self._stopping = True
        self._posted.set()
        self._wake()

    # What the host calls, from one thread

    def run_until_idle(self, budget: int = 10_000) -> bool:
        """Reasons until nothing is left to do now, or ``budget`` steps are made; True when something is left."""
        return all(self._cycle() for _ in range(budget))

    def next_wakeup(self) -> int | None:
        """When (ns) a timer is due next; None when none is."""
        return self._timers[0][0] if self._timers else None

    def run(self) -> None:
        """Runs until `stop`, asleep while there is nothing to do. The clock has to run by itself."""
        while not self._stopping:
            self._posted.clear()
            if not self.run_until_idle():
                due = self.next_wakeup()
                self._posted.wait(None if due is None else max(0.0, (due - self.clock.now()) / SECOND))

    def mind(self) -> Mind:
        """What is believed, desired and intended at this moment."""
        intentions = (*self._intentions, *self._suspended)
        return Mind(
            beliefs=tuple(self.beliefs),
            desires=tuple(frame.goal for intention in intentions for frame in intention.frames if frame.goal),
            intentions=tuple(intentions),
        )

    def suspend(self, seconds: float) -> None:
        """Lets the intention that is executing rest for ``seconds``; for actions to call."""
        assert self._current is not None, "only an action can suspend its intention"
        due = max(self.clock.now() + nanoseconds(seconds), self._suspended.get(self._current, 0))
        self._suspended[self._current] = due
        self._at(due, functools.partial(self._resume, self._current, due))

    # The reasoning cycle

    def _cycle(self) -> bool:
        """One round: what came in, what is due, one event, one step of one intention; False when there was nothing."""
        busy = False
        while self._inbox:
            busy = True
            self._inbox.popleft()()
        now = self.clock.now()
        while self._timers and self._timers[0][0] <= now:
            busy = True
            heapq.heappop(self._timers)[2]()
        if self._events:
            busy = True
            self._react(self._events.popleft())
        if self._intentions:
            busy = True
            self._execute(self._intentions.popleft())
        return busy

    def _react(self, happening: _Happening) -> None:
        choice = self._choose(happening)
        if choice.rule is not None:
            self._intentions.append(Intention([self._frame(choice, happening.record)]))

    def _choose(self, happening: _Happening) -> _Choice:
        """The first rule that fits the event and whose condition holds."""
        choice = _Choice()
        literal = happening.literal
        rules = self._rules.get((happening.change, *literal.key), ()) if happening.rule is None else (happening.rule,)
        for rule in rules:
            bindings = unify(rule.event.literal.args, literal.args, {})
            if bindings is None:
                continue
            try:
                solution = next(self.beliefs.solve(rule.condition, bindings), None)
            except Exception as error:  # noqa: BLE001 - a condition is user code
                self._failure(str(rule), happening.record, error)
                solution = None
            if solution is not None:
                choice.rule, choice.bindings = rule, solution
                break
            choice.rejected.append(rule)
        return choice

    def _frame(self, choice: _Choice, cause: str, goal: Goal | None = None) -> Frame:
        assert choice.rule is not None
        detail: dict[str, object] = {"rule": str(choice.rule)}
        if choice.rejected:
            detail["rejected"] = [str(rule) for rule in choice.rejected]
        what = f"{choice.rule.event}"
        return Frame(choice.rule, choice.bindings, self._record("plan", what, cause, **detail), goal)

    def _execute(self, intention: Intention) -> None:
        """Makes one step of ``intention``."""
        frame = intention.frames[-1]
        step = frame.advance()
        self._current = intention
        try:
            if isinstance(step, Action):
                action = step.ground(frame.bindings)
                action.run(self, self._record("action", str(action), frame.record))
            elif isinstance(step, Goal):
                self._pursue(intention, step.ground(frame.bindings), frame.record)
            elif step is not None:
                self._change(Event(step.change, step.literal.bind(frame.bindings)), "self", frame.record)
        except Exception as error:  # noqa: BLE001 - actions are user code: they fail their goal, never the agent
            self._suspended.pop(intention, None)
            self._unwind(intention, self._failure(str(step), frame.record, error))
        self._current = None
        self._close(intention)

    def _pursue(self, intention: Intention, goal: Goal, cause: str) -> None:
        record = self._record("goal", str(goal), cause)
        choice = self._choose(_Happening(Change.WANTED, goal, record))
        if choice.rule is not None:
            intention.frames.append(self._frame(choice, record, goal))
        else:
            failure = self._record(
                "failure",
                str(goal),
                record,
                reason="no applicable plan",
                rejected=[str(rule) for rule in choice.rejected],
            )
            if not self._recover(intention, goal, failure):
                self._unwind(intention, failure)

    def _unwind(self, intention: Intention, failure: str) -> None:
        """Takes plans off the intention until one whose goal has a failure plan; that plan goes in its place."""
        while intention.frames:
            goal = intention.frames.pop().goal
            if goal is not None and self._recover(intention, goal, failure):
                return
        self._record("dropped", "intention", failure)

    def _recover(self, intention: Intention, goal: Goal, failure: str) -> bool:
        choice = self._choose(_Happening(Change.FAILED, goal, failure))
        if choice.rule is not None:
            intention.frames.append(self._frame(choice, failure))
        return choice.rule is not None

    def _close(self, intention: Intention) -> None:
        """Takes finished plans off the intention, and puts it back in line if something is left."""
        if intention in self._suspended:
            return
        while intention.frames and intention.frames[-1].finished:
            frame = intention.frames.pop()
            if frame.goal is not None:
                self._record("achieved", str(frame.goal), frame.record)
        if intention.frames:
            self._intentions.append(intention)

    def _resume(self, intention: Intention, due: int) -> None:
        if self._suspended.get(intention) == due:
            del self._suspended[intention]
            self._close(intention)

    # Changes of mind

    def _sense(self, sensor: Sensor, percept: Any, cause: str, since: int | None) -> None:
        try:
            for event in changes(sensor.sense(percept)):
                self._change(event, "percept", cause, since)
        except Exception as error:  # noqa: BLE001 - sensors are user code
            self._failure(type(sensor).__name__, cause, error)

    def _change(self, event: Event, source: str, cause: str, since: int | None = None) -> None:
        assert isinstance(event.literal, Belief)
        if event.change is Change.ADDED:
            _check_ground(event.literal)
            self._add(event.literal, source, cause, since)
        else:
            self._remove(event.literal, cause)

    def _add(self, belief: Belief, source: str, cause: str, since: int | None) -> None:
        if isinstance(belief, Reactor):
            self._announce(Change.ADDED, belief, self._record("event", str(belief), cause))
            return
        if belief in self.beliefs:
            return
        if belief.singleton:
            for other in self.beliefs.others(belief):
                self._remove(other.belief, cause)
        record = self._record("belief", str(belief), cause, source=source)
        held = Held(belief, source, self.clock.now() if since is None else since, record)
        self.beliefs.add(held)
        self._announce(Change.ADDED, belief, record)
        for rule in self._rules.get((Change.HELD, *belief.key), ()):
            self._watch(held, rule)

    def _remove(self, belief: Belief, cause: str) -> None:
        for held, _ in list(self.beliefs.match(belief, {})):
            self.beliefs.remove(held.belief)
            self._announce(Change.REMOVED, held.belief, self._record("unbelief", str(held.belief), cause))

    def _adopt(self, goal: Goal, cause: str) -> None:
        intention = Intention([])
        self._pursue(intention, goal, cause)
        self._close(intention)

    def _announce(self, change: Change, literal: Literal, record: str) -> None:
        if (change, *literal.key) in self._rules:
            self._events.append(_Happening(change, literal, record))

    def _watch(self, held: Held, rule: Rule) -> None:
        """Sees to it that ``rule`` hears of it when ``held`` has been held long enough."""
        if unify(rule.event.literal.args, held.belief.args, {}) is None:
            return
        seconds = rule.event.seconds
        try:
            duration = seconds() if callable(seconds) else seconds
            due = held.since + nanoseconds(duration)
        except Exception as error:  # noqa: BLE001 - user code
            self._failure(str(rule), held.record, error)
            return
        self._at(due, functools.partial(self._ripen, held, rule, duration))

    def _ripen(self, held: Held, rule: Rule, duration: float) -> None:
        if self.beliefs.get(held.belief) is held:
            record = self._record("held", str(held.belief), held.record, seconds=duration)
            self._events.append(_Happening(Change.HELD, held.belief, record, rule))

    # Small things

    def _poll(self, sensor: Sensor, period_s: float) -> None:
        self._sense(sensor, None, "", None)
        self._at(self.clock.now() + nanoseconds(period_s), functools.partial(self._poll, sensor, period_s))

    def _post(self, item: Callable[[], None]) -> None:
        self._inbox.append(item)
        self._posted.set()
        self._wake()

    def _at(self, time: int, callback: Callable[[], None]) -> None:
        heapq.heappush(self._timers, (time, next(self._sequence), callback))

    def _failure(self, what: str, cause: str, error: Exception) -> str:
        reason = "failed" if isinstance(error, PlanFailed) else type(error).__name__
        log.warning("%s: %s: %s", self.name, what, error)
        return self._record("failure", what, cause, reason=reason, message=str(error))

    def _record(self, kind: str, what: str, cause: str, **detail: object) -> str:
        record_id = f"{self.name}-{next(self._records)}"
        if self._sink is not None:
            self._sink(Record(record_id, self.clock.now(), kind, what, cause, detail))
        return record_id


def _check_ground(literal: Literal) -> None:
    if any(isinstance(arg, Term) for arg in literal.args):
        raise RuleError(f"{literal} has a variable in it", remedy="give values only")
    try:
        hash(literal.args)
    except TypeError as error:
        raise RuleError(f"{literal}: {error}", remedy="give values that cannot change") from error
