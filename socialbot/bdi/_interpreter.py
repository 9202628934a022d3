"""Interpreter of an agent: the reasoning cycle and its timers. A turn handles one event and a step of one intention."""

# pyright: reportPossiblyUnboundVariable=false
# A trigger comes with the arguments of its event; initial values for them would cost two percent of an event.

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from socialbot.bdi._explain import failure_of, unhandled
from socialbot.bdi._intention_stack import IntentionStack
from socialbot.bdi._messaging import TOLD, Message, Messaging
from socialbot.bdi._relations import Annotations, Args, Relation
from socialbot.bdi.belief_base import BeliefBase
from socialbot.bdi.intentions import (
    DONE,
    END,
    EVENT,
    GENERATOR,
    MODE,
    NEXT,
    OPEN,
    SUBGOAL,
    TAIL,
    Body,
    EventPause,
    Intention,
    TimedRequest,
    subgoal,
)
from socialbot.bdi.library import CompiledPlan, Library, Trigger
from socialbot.bdi.literals import ANYTHING, SELF, Computed, Event, Literal, Reactor, Structure, distinct, is_source
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.unification import Trail, annotations_match, closed, free, has_unbound, resolve, undo, unify
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from random import Random

    from socialbot.bdi.durative_actions import Pool
    from socialbot.bdi.engine import Engine


STEPS, STEPS_WITH_TIMERS = range(64), range(8)
"""Steps of a turn of the only runnable intention, without and with timers to check in between.

In a society the turn ends after a step if another agent has work to do.
"""

_NO_SENSORS: Mapping[str, str] = {}
"""Errors of sensors by their names, of agents whose sensors work."""


class entered(Reactor):  # noqa: N801 - written like a belief
    """Event ``+entered(Stage)`` at the begin of a stage."""


class Interpreter:
    """Reasoning cycle: selects events, plans and intentions. Compiled plans receive it as ``ag``.

    Attributes:
        inbox: Items posted from any thread: beliefs to add, as tuples, and functions to call.
        others: Queued events, but empty while the plan of an event is chosen: its first step belongs to the same turn.
        cause: Trace record of the current internal action.
        action: Trace record of the last action.
        begun: Body of the last plan whose first steps were executed in place.
        heap: Timers, for the code of plans.
        peers: Queue of the agents of the society that have work to do; a list for a single agent.
        reading: Whether a message was read in the last turn.
        signalled: Whether the wake-up of the engine was called since the last turn.
    """

    __slots__ = (
        "_parts", "action", "begun", "beliefs", "broken_sensors", "cause", "engine", "events", "heap", "inbox",
        "intentions", "library", "messaging", "now", "others", "peers", "pool", "random", "reading", "ready",
        "relations", "signalled", "stage", "timers", "trace", "triggers", "unclosed",
    )  # fmt: skip

    def __init__(self, engine: Engine, library: Library) -> None:
        self.engine, self.trace = engine, engine.trace
        self.timers, self.heap, self.now = engine.timers, engine.timers.heap, engine.clock.now
        self.library, self.triggers = library, library.triggers
        self.inbox = engine.timers.posted
        self.events: deque[tuple[Trigger, Args, Annotations, Any]] = deque()
        self.others: Collection[Any] = ()
        self.peers: Any = []  # a queue of its own would take a sixth of the memory of an agent
        self.reading = False
        self.beliefs = BeliefBase(library, self.events, self.timers, self.trace)
        self.relations = self.beliefs.relations
        self.intentions = IntentionStack(self)
        self.intentions.watch_goals()
        self.messaging = Messaging(engine)
        self.ready = self.intentions.ready
        self.stage: str | None = None
        self.cause: Any = ""
        self.action = ""
        self.begun: Body = None
        self.signalled = False
        self.broken_sensors: Mapping[str, str] = _NO_SENSORS
        self.pool: Pool | None = None
        self.random: Random | None = None
        self.unclosed: list[Generator[None, None, None]] | None = None
        waits = self.intentions.waits
        # One tuple is read faster than several attributes.
        self._parts = (
            self.inbox, self.events, self.ready, self.heap, self.intentions, waits.events, waits.due, self.trace,
            self.intentions.numbers, self.now,
        )  # fmt: skip

    # From any thread

    def post(self, item: Any) -> None:
        """Queue a belief to add, or a function to call in the engine's thread."""
        self.inbox.append(item)
        if self.engine.wake is not None and not self.signalled:
            self.signal()

    def signal(self) -> None:
        self.signalled = True
        if self.engine.wake is not None:
            self.engine.wake()

    # Beliefs

    def admit(self, belief: Literal) -> tuple[Relation, Any, Any, str, None]:
        """Check a belief and return its inbox item, cached in the belief. Callable from any thread."""
        belief.check()
        kind, beliefs = belief.__class__, self.beliefs
        relation = beliefs.known.get((kind, len(belief.args)))
        if relation is None:
            if issubclass(kind, Computed):
                raise RuleError(f"{belief} is computed, and cannot be added", remedy="make it a Belief")
            relation = beliefs.relation_of(belief)
            if kind is not Structure and relation.kind is not kind:
                beliefs.declare(kind)
            if kind is not Structure and not belief.negated and belief.posted is None:
                # Useful for a class of new beliefs, not for a constant shared by agents.
                beliefs.know(kind, len(belief.args), relation)
        belief.posted = item = (relation, belief.args, distinct(belief.annotations + SELF), "", None)
        return item

    def forget(self, belief: Literal, cause: str) -> None:
        """Remove the matching beliefs, or only the sources that ``belief`` names."""
        args, notes = opened((belief.args, belief.annotations))
        method = self.beliefs.forget_sources if any(map(is_source, notes)) else self.beliefs.forget_all
        method(self.beliefs.relation(belief.key), args, notes, cause)

    # The cycle

    def run_until_idle(self, budget: int = 10_000) -> bool:
        """Run turns while work is pending, at most ``budget``; return whether any remains."""
        self.signalled = False
        inbox, events, ready, heap, intentions, awaited, due, trace, numbers, now = self._parts
        while True:
            if budget < 1:  # this takes less time than as a condition of a long loop
                return bool(inbox or events or ready)
            trigger: Trigger | None = None
            if inbox:
                begin: int | None = None  # beliefs between two function calls begin at the same time
                while True:
                    item = inbox.popleft()
                    if trigger is not None:  # of the item before
                        events.append((trigger, args, notes, cause))  # noqa: F821
                        trigger = None
                    if item.__class__ is tuple:
                        relation, args, notes, cause, since = item
                        if since is not None and since is TOLD and self._read_later(item):
                            break
                        if relation.care or trace.sink is not None:
                            if since is None or since is TOLD:
                                begin = since = now() if begin is None else begin
                            self._take((relation, args, notes, cause, since))
                        else:
                            facts = relation.facts
                            if args not in facts:
                                if since is None or since is TOLD:
                                    if begin is None:
                                        begin = now()
                                    facts[args] = (begin, notes, cause)
                                else:
                                    facts[args] = (since, notes, cause)
                                if relation.indexes:
                                    relation.enter(args)
                                trigger = relation.added
                            else:
                                notes = relation.merge(args, notes)
                                if notes:
                                    trigger = relation.added
                        if since is not None and item[4] is TOLD:
                            break  # the next message has to wait for a turn, as in Jason
                    elif self._take_call(item):
                        begin = None
                    else:
                        break
                    if not inbox:
                        break
                if trigger is not None and events:
                    events.append((trigger, args, notes, cause))
                    trigger = None
            if heap and heap[0][0] <= now():
                self.timers.run_due()
            if intentions.atomic is not None:
                if trigger is not None:
                    events.append((trigger, args, notes, cause))
                if not self._advance_atomic() and not inbox and not self._wake_atomic():
                    return False
                budget -= 1
                continue
            if trigger is None and events:
                trigger, args, notes, cause = events.popleft()
                if trigger.goal:
                    if trace.sink is not None or intentions.goal_states is not None or not closed(args):
                        intentions.adopt(subgoal(trigger, args, notes, cause))
                        trigger = None
                    elif trigger.key in awaited:
                        intentions.waits.notify(trigger.key, args, notes)
            if trigger is not None:
                position = trigger.position
                plan: Any
                for plan in trigger.plans if position is None else trigger.by.get(args[position], trigger.rest):
                    run = plan.run  # a call of the attribute itself takes longer
                    try:
                        result = run(self, args, notes, cause)
                    except Exception as problem:  # noqa: BLE001 - a condition is user code
                        trace.record_failure(str(plan.plan), cause, problem)
                        continue
                    if result is not None:
                        break
                else:
                    plan = result = None
                if result is not DONE:
                    if result.__class__ is GENERATOR:
                        ready.append((result, plan, next(numbers), trigger, args, notes, cause))
                        if result is self.begun:
                            # The step of this turn was executed in place.
                            if awaited and trigger.key in awaited and not trigger.goal:
                                item = ready.pop()
                                intentions.waits.notify(trigger.key, args, notes)
                                ready.append(item)
                            if due:
                                intentions.waits.recheck()
                            budget -= 1
                            continue
                    elif trigger.goal:
                        intentions.adopt_with((SUBGOAL, trigger, args, notes, cause), plan, result)
                    elif result is not None:
                        intentions.intend((EVENT, trigger, args, notes, cause), plan, result)
                    elif trace.sink is not None:
                        unhandled(self, trigger, args, notes, cause)
                if awaited and trigger.key in awaited and not trigger.goal:
                    intentions.waits.notify(trigger.key, args, notes)
            while ready:
                item = intentions.running = ready.popleft()
                if item.__class__ is tuple:
                    try:
                        # A loop takes less time than a call of next().
                        for result in item[0]:  # noqa: B007
                            break
                        else:
                            result = END
                    except Exception as problem:  # noqa: BLE001 - actions are user code
                        result = problem
                        intentions.unwound = False
                    if intentions.running is not item:
                        self._advance(intentions.register_running(), result)
                    elif result is None:
                        ready.append(item)
                    elif result is END and trace.sink is None:
                        if not ready:  # it is no intention any more, as its body shows
                            break
                    elif isinstance(result, EventPause) and result.plain and intentions.goal_states is None:
                        intentions.waits.rest(item, result)
                    else:
                        self._advance(intentions.register_running(), result)
                else:
                    self._advance(item)
                if events or inbox or heap or due or budget == 1 or intentions.atomic is not None:
                    break
                budget -= 1  # without other work, the next turn is a step as well
            if due:
                intentions.waits.recheck()
            if not (events or ready or inbox or intentions.atomic) and (not heap or heap[0][0] > now()):
                return False
            budget -= 1

    def take_in(self) -> None:
        """Process all posted items."""
        while self.inbox:
            self._take(self.inbox.popleft())

    def _take_call(self, item: Any) -> bool:
        """Call a posted function or read a message; return whether the next item may be read in this turn."""
        told = item.__class__ is Message
        if told and self._read_later(item):
            return False
        self._take(item)
        return not told

    def _read_later(self, message: Any) -> bool:
        """Put a message back if one was read in the last turn and other work waits."""
        self.reading = not (self.reading and (self.events or self.ready))
        if not self.reading:
            self.inbox.appendleft(message)
        return not self.reading

    def _take(self, item: Any) -> None:
        try:
            if item.__class__ is tuple:
                relation, args, notes, cause, since = item
                self.beliefs.add(relation, args, notes, cause, None if since is TOLD else since)
            else:
                item()
        except Exception as problem:  # noqa: BLE001 - errors from outside must not stop the agent
            self.trace.record_failure("inbox", "", problem)

    # Steps of intentions

    def _advance(self, intention: Intention, result: Any = NEXT) -> None:
        """Execute steps of an intention; ``result`` is that of its current step, if it was executed before."""
        if intention.suspended or not intention.active:
            return
        inbox, events, ready, heap, intentions, awaited, due, trace, _, _ = self._parts
        intentions.running = intention
        frames, peers = intention.frames, self.peers
        special = trace.sink is not None or intentions.goal_states is not None
        self.others = events
        body: Any = frames[-1][0]
        if result is not NEXT:
            body, intentions.unwound = iter(() if result is END else (result,)), False
        try:
            for _ in STEPS_WITH_TIMERS if heap else STEPS:
                try:
                    for result in body:  # noqa: B007
                        break
                    else:
                        result = END
                except Exception as problem:  # noqa: BLE001 - actions are user code: they fail their goal, never the agent
                    result = problem
                    intentions.unwound = False
                if intentions.unwound:
                    # The step may have ended a goal of its own intention, or added plans for the states of goals.
                    intentions.unwound = False
                    special = trace.sink is not None or intentions.goal_states is not None
                    if not frames or frames[-1][0] is not body:
                        result = None
                if result.__class__ is tuple:
                    kind, trigger, args, notes, cause = served = result
                    mode = 0
                    apart = special
                    if kind:
                        mode = kind >> MODE
                        if kind & EVENT:
                            served = None
                        apart = apart or (
                            kind & OPEN and (not mode or (trigger.failure or intentions.failure_plans(result)).plans)
                        )
                        if kind & TAIL:
                            _, goal, plan = frames.pop()
                            if intention.atomic:
                                intentions.finished_atomic(intention, plan)
                            if plan is not None:
                                intentions.replace_goal(intention, goal, plan)
                    if apart or (awaited and trigger.key in awaited):
                        intentions.turn_may_end = False
                        intentions.pursue(intention, result)
                        turn_may_end = intentions.turn_may_end
                    else:
                        # A shorter form of `IntentionStack.pursue` for the most frequent requests.
                        position = trigger.position
                        chosen: Any
                        found: Any
                        for chosen in (
                            trigger.plans
                            if position is None or (mode and mode >> position & 1)
                            else trigger.by.get(args[position], trigger.rest)
                        ):
                            try:
                                run = (chosen.modes.get(mode) or chosen.in_mode(mode)) if mode else chosen.run
                                found = run(self, args, notes, cause)
                            except Exception as problem:  # noqa: BLE001 - a condition is user code
                                trace.record_failure(str(chosen.plan), cause, problem)
                                free(args)
                                continue
                            if found is not None:
                                break
                        else:
                            chosen = found = None
                        if found.__class__ is GENERATOR:
                            frames.append((found, served, chosen))
                            if (ready or events or inbox or peers) and not intention.atomic:
                                ready.append(intention)
                                return
                            body = found
                            continue
                        if found is DONE:
                            turn_may_end = False
                        else:
                            intentions.turn_may_end = False
                            intentions.pursue(intention, result, (chosen, found))
                            turn_may_end = intentions.turn_may_end
                elif result is END:
                    ended = frames.pop()
                    if special or intention.atomic:
                        intentions.finished_plan(intention, ended)
                    # The plan below continues to the end of its step even if its goal has ended.
                    if frames and not intention.suspended:
                        body = frames[-1][0]
                        if body is not None:
                            continue
                    turn_may_end = False
                elif result is None:
                    turn_may_end = True
                elif isinstance(result, Exception):
                    _, goal, plan = frames.pop()
                    if intention.atomic:
                        intentions.finished_atomic(intention, plan)
                    intentions.turn_may_end = False
                    intentions.fail_goal(intention, goal, failure_of(self, plan, result, goal))
                    turn_may_end = intentions.turn_may_end
                elif result.__class__ is TimedRequest:
                    intentions.pursue_timed(intention, result)
                    turn_may_end = True
                else:
                    intentions.rest(intention, result)
                    turn_may_end = True
                    if intention.pause is not None or not frames:
                        return
                if frames and frames[-1][0] is None:
                    intentions.pop_kept(frames)
                if not frames:
                    if intention.active:
                        intentions.end(intention, None)
                    return
                if intention.suspended or intention.pause is not None:
                    return
                if (
                    turn_may_end
                    and (ready or events or inbox or peers or (due and intention.stepwise))
                    and not intention.atomic
                ):
                    ready.append(intention)
                    return
                body = frames[-1][0]
            ready.append(intention)
        finally:
            self.others = ()

    def _advance_atomic(self) -> bool:
        """Execute steps of the atomic intention only; return False if it waits."""
        for candidate in list(self.ready):
            if candidate.__class__ is not tuple and (candidate is self.intentions.atomic or candidate.atomic):
                self.ready.remove(candidate)
                self._advance(candidate)
                return True
        return False

    def _wake_atomic(self) -> bool:
        """Continue the atomic intention if its event or condition has occurred; keep the events queued."""
        waits = self.intentions.waits
        waits.recheck()
        for trigger, args, notes, _ in list(self.events):
            if trigger.key in waits.events:
                waits.notify(trigger.key, args, notes)
        return any(item.__class__ is not tuple and item.atomic for item in self.ready)

    # Plans and queries

    def select_plan(
        self, trigger: Trigger, args: Args, notes: Annotations, cause: Any, opened: bool
    ) -> tuple[CompiledPlan | None, Any]:
        """First applicable plan and its result; ``opened`` marks arguments with variables."""
        position = None if opened else trigger.position
        for plan in trigger.plans if position is None else trigger.by.get(args[position], trigger.rest):
            try:
                result = plan.run_open(self, args, notes, cause) if opened else plan.run(self, args, notes, cause)
            except Exception as problem:  # noqa: BLE001 - a condition is user code
                self.trace.record_failure(str(plan.plan), cause, problem)
                if opened:
                    free(args)
                continue
            if result is not None:
                return plan, result
        return None, None

    def solve(self, key: str, args: Args, notes: Annotations, trail: Trail) -> Iterator[None]:
        """Yield the solutions of a query: beliefs held, computed or inferred; undo the bindings in between."""
        for _ in self.beliefs.relation(key).match(args, notes, trail):
            yield
        mark = len(trail)
        kind = self.library.computes(key)
        if kind is not None:
            for found in self._compute(kind, resolve(args)):
                if unify(args, found, trail):
                    yield
                undo(trail, mark)
        for rule in self.library.inferences.get(key, ()):
            if notes and not annotations_match(notes, rule.annotations, trail):
                undo(trail, mark)
                continue
            inner = rule.solve(self, args, trail)
            try:
                for _ in inner:
                    if not closed(args) and has_unbound(args) and not self.library.is_open(key):
                        raise RuleError(
                            f"{rule.inference.head} follows with a variable that has no value",
                            where=str(rule.inference.origin or rule.inference),
                            remedy="give every variable of the head a value in the condition, or in the question",
                        )
                    yield
            except GeneratorExit:
                # Python would close one within the other in calls of C, and 3.12 ends the process if they are many.
                if self.unclosed is not None:
                    self.unclosed.append(inner)
                    return
                unclosed = self.unclosed = [inner]
                try:
                    while unclosed:
                        unclosed.pop().close()
                finally:
                    self.unclosed = None
                return
            undo(trail, mark)

    def _compute(self, kind: type[Computed], args: Args) -> Iterable[Args]:
        computed = self.library.computed.get(kind.functor)
        if computed is None:
            computed = self.library.computed.setdefault(kind.functor, kind())
        found = computed.solutions(*(arg if closed(arg) else ANYTHING for arg in args))
        if isinstance(found, bool):
            return [args] if found else []
        return list(found)

    def own_library(self) -> Library:
        """Library of this agent alone; a shared library is copied first."""
        if self.library.users > 1:
            self.library.users -= 1
            self.library = self.library.copy()
            self.library.users = 1
            self.triggers = self.library.triggers
            self.beliefs.use(self.library)
            self.intentions.waits.listen(self.beliefs)
        return self.library

    def enter(self, stage: str | None, *, cause: Any = "") -> None:
        """Enter a stage, with the event ``entered(stage)``; plans of other stages no longer apply."""
        self.stage = stage
        self.beliefs.declare(entered)
        self.beliefs.add(self.beliefs.relation("entered/1"), (stage or "",), SELF, cause)

    def raise_event(self, event: Event, cause: Any) -> None:
        """Queue an event or goal like an external one."""
        literal = event.literal
        trigger = self.triggers[event.key] if event.key.startswith("+!") else self.triggers.get(event.key)
        if trigger is not None:
            self.events.append((trigger, literal.args, literal.annotations or SELF, cause))
