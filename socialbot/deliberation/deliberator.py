"""The deliberator: it looks at what is believed and desired, has plans made, and has them carried out.

It lives in the engine's thread. Whatever changes, beliefs, desires, a plan that ends, an answer of the planner, only
notes that there is something to think about; then `Deliberator.think` goes through all of it, once, in a fixed order:
rules, desires that are fulfilled, whose turn it is. What it decides goes on the trace:

| kind | meaning |
|---|---|
| `desire` | a desire was adopted, or has another priority or deadline from now on; detail: priority, deadline |
| `desire_refused` | it was not; detail: reason |
| `desire_fulfilled`, `desire_dropped` | it has ended; detail: reason |
| `rule` | a rule has fired; detail: effect |
| `planning` | a plan was made for a desire, or was not; detail: verdict, message, steps, makespan_s |
| `silent`, `heard` | a sensor tells nothing any more, or again |

Each has what it follows from as its cause: a desire the rule, file or request, planning the desire or the end of the
plan before. The plan and its steps follow, see `socialbot.deliberation.plan_executor`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from socialbot.bdi import Engine
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation.action_executor import Watched
from socialbot.deliberation.desires import (
    DesireBase,
    DesireState,
    End,
    Listener,
    ending_with,
    hindrances,
    lacking,
    lifted,
    next_desire,
    prepares,
)
from socialbot.deliberation.fact_index import like
from socialbot.deliberation.facts import FactBase, out_of_range
from socialbot.deliberation.matching import mismatch, unfit_condition
from socialbot.deliberation.messages import Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import Options
from socialbot.deliberation.plan_executor import DirectorOptions, PlanExecutor
from socialbot.deliberation.pursuit import Aside, DesirePursuit
from socialbot.deliberation.rules import Reaction, ReactiveRule, RuleBook, conditions_in
from socialbot.deliberation.wakeup import Alarm, SensorTimeouts
from socialbot.planning.pddl.domain import PddlDomain
from socialbot.planning.planners.planner import Planner

NEARLY_DONE = 0.75
"""A plan that has come this far is carried out to its end though its desire is fulfilled already."""

ROUNDS = 100
"""So many times rules may set off each other before that is taken for a circle."""


class Observer(Protocol):
    """Hears of what changes, to show it to others."""

    def beliefs_changed(self) -> None: ...
    def desires_changed(self) -> None: ...
    def plan_changed(self, info: PlanExecutionInfo) -> None: ...
    def status_changed(self, status: str, reason: str) -> None: ...


class Deliberator:
    """Deliberates for one agent. All calls are for the engine's thread.

    What is ``watched`` sensors tell of; the effects of actions on that are waited for rather than taken for granted.
    """

    def __init__(
        self,
        engine: Engine,
        domain: PddlDomain,
        planner: Planner,
        aside: Aside,
        *,
        options: Options | None = None,
        director_options: DirectorOptions | None = None,
        watched: Watched = lambda name, objects: False,
        observer: Observer | None = None,
    ) -> None:
        self.engine = engine
        self.domain = domain
        self.options = options or Options()
        self.facts = FactBase(engine, domain)
        self.desires = DesireBase()
        self.rules = RuleBook(self.facts)
        self.silence = SensorTimeouts(engine)
        self.director = PlanExecutor(
            engine,
            self.facts,
            domain,
            director_options or DirectorOptions(rtc_deadline=self.options.rtc_deadline),
            watched=watched,
            ended=lambda outcome: self.pursuit.hear(outcome),
            changed=self._plan_changed,
        )
        self.pursuit = DesirePursuit(
            engine, self.facts, self.director, planner, aside, self.options, end=self._end, wake=self.wake
        )
        self._observer = observer
        self._alarm = Alarm(engine, self.wake)
        self._changed: dict[tuple[int, str, tuple[str, ...]], Fact] = {}
        self._new: list[DesireState] = []
        self._pursued: DesireState | None = None
        self._rules_changed = True
        self._posted = False
        self._desires_shown = True
        self._status = ("", "")
        self.facts.watch(self._note)
        self.wake()

    # What others may do

    def desire(self, desire: Desire, *, cause: str = "", listener: Listener | None = None) -> str:
        """Adopts a desire. Returns why not, or an empty text; ``listener`` is told how it ended.

        One of the same name that wants the same gets the new priority and deadline, and stays as it is in all else.
        """
        wish = self.desires.get(desire.name)
        if wish is None:
            reason = self.objection(desire)
        elif wish.desire.wanted != desire.wanted:
            reason = f"there is another desire called {desire.name}"
        else:
            reason = out_of_range(desire) or ""
        if reason:
            self.engine.record("desire_refused", desire.name, cause, reason=reason)
            return reason
        if wish is None:
            wish = self._adopt(desire, cause)
        elif wish.rank[:2] != (-desire.priority, desire.deadline):
            self._revise(wish, desire.priority, desire.deadline, cause)
        if listener is not None:
            wish.listeners.append(listener)
        return ""

    def objection(self, desire: Desire) -> str:
        """Why a desire can never be had in this domain, or an empty text. Objects may be unknown as yet."""
        facts = self.facts
        if not desire.wanted:
            return "it wants nothing"
        odd = out_of_range(desire)
        if odd is not None:
            return odd
        found = (
            *(mismatch(check) or facts.unfit(check.condition_to_check) for check in desire.wanted),
            *(unfit_condition(check, facts) for check in conditions_in(desire.precondition)),
            *(unfit_condition(check, facts) for check in conditions_in(desire.context)),
            *map(facts.unfit, desire.rollback_belief_add),
            *map(facts.unfit_pattern, desire.rollback_belief_del),
        )
        return next(filter(None, found), "")

    def drop(self, name: str, reason: str = "deleted", *, cause: str = "") -> bool:
        """Drops a desire, and the plan for it; False when there is none of that name."""
        wish = self.desires.get(name)
        if wish is None:
            return False
        self._end(wish, "dropped", reason, cause)
        return True

    def add_rule(self, rule: ReactiveRule) -> None:
        """Adds a rule, which fires for what holds already, too. Raises PlanningError as `RuleBook.add` does."""
        self.rules.add(rule)
        self._rules_changed = True
        self.wake()

    def remove_rule(self, name: str) -> bool:
        """Removes a rule; what it has done stays done. False when there is none of that name."""
        return self.rules.remove(name)

    def expect_sensor(self, sensor: str) -> None:
        """Begins nothing before a new sensor has told something. Raises PlanningError for one of the same name."""
        self.silence.expect(sensor)
        self.wake()

    def sensor_is_silent(self, sensor: str) -> None:
        """Starts nothing new from now on: what the sensor told last may be wrong by now."""
        if self.silence.begin(sensor):
            self.wake()

    def sensor_is_back(self, sensor: str, cause: str = "") -> None:
        """Goes on when no other sensor is silent; ``cause`` is the percept."""
        if self.silence.end(sensor, cause):
            self.wake()

    def stop(self) -> None:
        """Wants no answer of the planner any more."""
        self.pursuit.withdraw()

    def wake(self) -> None:
        """Has `think` called soon."""
        if not self._posted:
            self._posted = True
            self.engine.call(self.think)

    # Thinking

    def think(self) -> None:
        """Goes through everything that has changed."""
        self._alarm.begin()
        try:
            changed = self._apply_rules()
        finally:
            self._posted = False
        if self._pursued is not None and self._pursued is not self.pursuit.wish:
            self._new.append(self._pursued)  # Whether it may be taken up again was of no interest until now.
        self._look_at(changed)
        if changed and self._observer is not None:
            self._guarded(self._observer.beliefs_changed)
        self._mind_silence()
        self._schedule()
        self._pursued = self.pursuit.wish
        self._tell()
        self._alarm.end()

    def _note(self, fact: Fact, held: bool, cause: str) -> None:
        self._changed[fact.identity] = fact
        self.wake()

    def _apply_rules(self) -> list[Fact]:
        """Lets rules react until nothing changes any more; returns the facts that have changed."""
        seen: dict[tuple[int, str, tuple[str, ...]], Fact] = {}
        for _ in range(ROUNDS):
            if not (self._changed or self._rules_changed):
                return list(seen.values())
            seen.update(self._changed)
            self._changed.clear()
            self._rules_changed = False
            for reaction in self.rules.react():
                self._carry_out(reaction)
        message = f"rules set each other off {ROUNDS} times; they rest until something else changes"
        self.engine.record("failure", "rules", "", reason="circle", message=message)
        seen.update(self._changed)
        self._changed.clear()
        self.rules.react()
        return list(seen.values())

    def _carry_out(self, reaction: Reaction) -> None:
        cause = self.engine.record("rule", reaction.rule, reaction.cause, effect=str(reaction))
        try:
            if reaction.desire is not None:
                if reaction.operation == "ADD":
                    self.desire(reaction.desire, cause=cause)
                else:
                    self._drop_like(reaction.desire.name, f"the rule {reaction.rule}", cause)
            elif reaction.fact is not None:
                if reaction.operation == "ADD":
                    self.facts.add(reaction.fact, cause=cause)
                else:
                    self.facts.remove(reaction.fact, cause)
        except PlanningError as problem:  # an effect before it may have taken away what it is about
            self.engine.record_failure(f"rule {reaction.rule}", cause, problem)

    def _drop_like(self, pattern: str, reason: str, cause: str) -> None:
        fits = like(pattern)
        for wish in self.desires:
            if fits(wish.name):
                self.drop(wish.name, reason, cause=cause)

    def _look_at(self, changed: Iterable[Fact]) -> None:
        """Ends desires that are fulfilled by now, and finds out which may be taken up."""
        wishes = dict.fromkeys(wish for fact in changed for wish in self.desires.about(fact))
        for wish in wishes:
            wish.in_vain.clear()
        while wishes or self._new:
            wishes.update(dict.fromkeys(self._new))
            self._new.clear()
            for wish in wishes:
                if self.desires.get(wish.name) is wish:
                    self._judge(wish)
            wishes.clear()  # what was desired meanwhile to prepare others

    def _judge(self, wish: DesireState) -> None:
        if wish.is_fulfilled() and not self._lets_finish(wish):
            self._end(wish, "fulfilled", "")
            return
        wish.blocked = not (wish.is_prepared() and wish.is_in_context())
        if wish.blocked and wish is not self.pursuit.wish and not self.desires.children(wish.name):
            for desire in lacking(wish, self.options):
                if desire.name not in self.desires:
                    self.desire(desire, cause=wish.record)
            hindrance = hindrances(wish, self.options)
            if hindrance is not None and hindrance[0] not in wish.told:
                wish.told.append(hindrance[0])
                self.engine.record("desire_refused", hindrance[0], wish.record, reason=hindrance[1])

    def _lets_finish(self, wish: DesireState) -> bool:
        """Whether the plan for a desire that is fulfilled is nearly done, and had better be carried out to its end."""
        if self.pursuit.wish is not wish or self.pursuit.problem:
            return False
        steps = self.director.info.actions_exec_info
        return bool(steps) and sum(step.progress for step in steps) / len(steps) >= NEARLY_DONE

    def _mind_silence(self) -> None:
        if not self.silence:
            self.director.release()
            return
        if self.pursuit.wish is not None or self.pursuit.asked is not None:
            self.director.hold(str(self.silence))
        since, give_up_s = self.silence.since, self.options.give_up_silent_s
        if self.pursuit.wish is not None and self._alarm.is_due(since + nanoseconds(give_up_s)):
            seconds = (self.engine.clock.now() - since) / SECOND
            self.pursuit.abort(f"{self.silence} for {seconds:.0f} s")

    def _schedule(self) -> None:
        """Has a plan made for the desire whose turn it is."""
        if self.silence or self.director.aborting:
            return
        pursued = self.pursuit.wish
        wish = next_desire(self.desires.ranked, pursued, self.options.reschedule_policy, self._is_ready)
        if wish is None and pursued is not None and self.pursuit.problem and self._alarm.is_due(pursued.not_before):
            wish = pursued  # Its plan has failed, and nobody comes first.
        if wish is not None:
            self.pursuit.ask(wish)

    def _is_ready(self, wish: DesireState) -> bool:
        hopeless = wish.hopeless_at == self.facts.version and not self._alarm.is_due(wish.hopeless_until)
        return not hopeless and self._alarm.is_due(wish.not_before)

    # The begin and the end of a desire

    def _adopt(self, desire: Desire, cause: str) -> DesireState:
        wish = self.desires.add(desire)
        assert wish is not None
        wish.is_fulfilled = self.facts.achieved(desire)
        wish.is_prepared = self.facts.test(desire.precondition)
        wish.is_in_context = self.facts.test(desire.context)
        wish.blocked = True  # until it is looked at
        wish.record = self.engine.record(
            "desire", desire.name, cause, priority=desire.priority, deadline=desire.deadline
        )
        self._new.append(wish)
        self._desires_shown = False
        self.wake()
        return wish

    def _revise(self, wish: DesireState, priority: float, deadline: float, cause: str) -> None:
        self.desires.revise(wish, priority, deadline)
        record = self.engine.record("desire", wish.name, cause, priority=priority, deadline=deadline)
        self.pursuit.revise(wish)
        for child in self.desires.children(wish.name):
            if prepares(child.desire, wish.desire):
                self._revise(child, lifted(priority), deadline, record)
        self._desires_shown = False
        self.wake()

    def _end(self, wish: DesireState, how: End, reason: str, cause: str = "") -> None:
        if self.desires.get(wish.name) is not wish:
            return  # its plan was still being stopped
        record = self._take_out(wish, how, reason, cause)
        for relative, why in ending_with(wish, how, reason, self.desires):
            self._take_out(relative, "dropped", why, record)

    def _take_out(self, wish: DesireState, how: End, reason: str, cause: str) -> str:
        self.desires.remove(wish)
        self._desires_shown = False
        record = self.engine.record(f"desire_{how}", wish.name, cause or wish.record, reason=reason)
        self.pursuit.forget(wish, how, reason or f"{wish.name} is {how}")
        for listener in wish.listeners:
            self._guarded(lambda listener=listener: listener(how, reason))
        self.wake()
        return record

    # Showing

    def _plan_changed(self) -> None:
        if self._observer is not None:
            self._observer.plan_changed(self.director.info)

    def _tell(self) -> None:
        if self._observer is None:
            return
        if not self._desires_shown:
            self._desires_shown = True
            self._guarded(self._observer.desires_changed)
        if self._status_now() != self._status:
            self._status = status, reason = self._status_now()
            self._guarded(lambda: self._observer and self._observer.status_changed(status, reason))

    def _status_now(self) -> tuple[str, str]:
        if self.silence:
            return "BOOTING" if self.silence.is_first else "PAUSED", str(self.silence)
        if self.director.aborting:
            return "ABORTING", ""
        if self.pursuit.wish is not None and not self.pursuit.problem:
            return "EXECUTING", self.pursuit.wish.name
        if self.pursuit.asked is not None:
            return "PLANNING", self.pursuit.asked.name
        return "SCHEDULING", ""

    def _guarded(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except Exception as problem:  # noqa: BLE001 - whoever listens never stops the agent
            self.engine.record_failure("deliberator", "", problem)
