"""The engine: one agent, as its host and other programs see it.

An engine is passive: `Engine.run_until_idle` does what there is to do, `Engine.next_wakeup` tells
when there will be more. `Engine.run` does both for a program that has no other loop. Everything may be posted from
any thread; everything happens in the thread that runs the engine.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from socialbot.bdi.acting import Acting
from socialbot.bdi.actions import Action
from socialbot.bdi.beliefs import Relation
from socialbot.bdi.compiler.runtime import SUBGOAL
from socialbot.bdi.explain import why_not
from socialbot.bdi.intentions import Failure, Intention, Mind, goal_of
from socialbot.bdi.library import Library
from socialbot.bdi.literals import PERCEPT, SELF, Belief, Change, Event, Goal, Literal, Structure, source
from socialbot.bdi.plans import Inference, Plan, flat
from socialbot.bdi.sensors import Sensor, changes
from socialbot.bdi.terms import Atom, Variable, conjunction
from socialbot.bdi.trace import Record, Sink
from socialbot.bdi.unification import Var, closed, resolve
from socialbot.bdi.wakeup import Wakeup
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import RuleError


class Engine(Acting):
    """One agent: its beliefs, plans, sensors and intentions.

    ``robot`` is whatever the actions act upon; ``sink`` takes the trace; ``wake`` is called, from any
    thread, when something was posted. ``library`` may be shared by agents of one kind; ``seed`` is that of
    the agent's random numbers.
    """

    __slots__ = ("__weakref__", "_stopping", "robot", "wake")

    def __init__(
        self,
        name: str,
        clock: Clock,
        *,
        robot: Any = None,
        sink: Sink | None = None,
        wake: Callable[[], object] | None = None,
        library: Library | None = None,
        seed: int | str | None = None,
    ) -> None:
        super().__init__(name, clock, sink, library or Library())
        self.robot = robot
        self.wake = wake
        self._stopping = False
        self.seed = name if seed is None else seed

    # What an agent is made of

    def add_rules(self, *rules: Plan | Inference | list[Plan]) -> None:
        """Adds plans and inferences; of the plans that fit an event, the first one whose condition holds is chosen."""
        for rule in rules:
            if isinstance(rule, Inference):
                self.own_library().add_inference(rule)
            else:
                for plan in flat([rule]):
                    self.add_plan(plan)

    def add_plan(self, plan: Plan, *, first: bool = False) -> None:
        """Adds a plan behind the others, or before them."""
        ready = self.own_library().add(plan, first=first)
        for kind in plan.classes():
            self.equip(kind)
        self.listen(plan.event.key)
        if plan.event.change is Change.HELD:
            relation = self.relations[plan.event.literal.key]
            for args, fact in list(relation.facts.items()):
                if args not in relation.lives:
                    relation.live(args, fact)
                self._watch_for(relation, args, relation.lives[args], ready)

    def remove_plan(self, plan: Plan | str) -> bool:
        """Removes a plan, or the one with a label; False when it is not there."""
        library = self.own_library()
        found = library.labelled(plan) if isinstance(plan, str) else plan
        return found is not None and library.remove(found)

    def add_text(self, text: str, file: str = "<text>") -> None:
        """Adds AgentSpeak text: beliefs, rules, goals and plans. Raises AgentSpeakError with the place of a mistake."""
        from socialbot.bdi.agentspeak.loading import load

        load(self, text, file)

    def add_action(self, action: Callable[..., Any] | type[Action], name: str | None = None) -> None:
        """Makes an action known by its name, for AgentSpeak: an `Action`, or a function that takes engine and args."""
        self.actions[name or getattr(action, "functor", None) or action.__name__] = action

    def add_sensor(self, sensor: Sensor) -> None:
        """Adds a sensor, from any thread; one with a period is asked from now on."""
        sensor.attach(self)

    # What others may call, from any thread

    def believe(self, belief: Belief, *, source: str = "self", cause: str = "", since: int | None = None) -> None:
        """Holds ``belief`` from now on; believing again what is believed is no event."""
        item = belief.posted
        if item is None or item[0].base is not self.relations:
            item = self._admit(belief)
        if source != "self" or cause or since is not None:
            item = (item[0], item[1], belief.annotations + _source(source), cause, since)
        self.inbox.append(item)
        if self.wake is not None and not self.signalled:
            self._signal()

    def forget(self, belief: Belief, *, cause: str = "") -> None:
        """Holds ``belief`` no longer, whoever said it; variables in it match anything."""
        self._post(functools.partial(self._forget, belief, cause))

    def achieve(self, goal: Goal | Literal, *, cause: str = "") -> None:
        """Adopts ``goal`` in an intention of its own."""
        goal.check()
        notes = goal.annotations or SELF
        self._post(functools.partial(self._want, goal, notes, cause))

    def perceive(self, sensor: Sensor, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Shows ``percept`` to ``sensor``; ``since`` (ns) is the time it speaks of, now if not given."""
        self._post(functools.partial(self.take, sensor, percept, cause, since))

    def call(self, function: Callable[[], object]) -> None:
        """Has a function called in the engine's thread, before it goes on.

        What is no call for any thread, such as `add_rules`, `add_plan`, `remove_plan`, `query` and `mind`, is made
        one by this: ``engine.call(lambda: engine.add_rules(rule))``.
        """
        self._post(function)

    def attempt(self, goal: Goal | Literal, ended: Callable[[Failure | None], None], *, cause: str = "") -> Intention:
        """Adopts ``goal`` at once, for the engine's own thread; ``ended`` is called with the failure, or None.

        ``drop(intention, then)`` gives it up, and calls ``then`` when what goes on for it has stopped.
        """
        goal.check()
        intention = self._new((SUBGOAL, self.triggers[f"+!{goal.key}"], goal.args, goal.annotations or SELF, cause))
        assert intention.event is not None
        intention.ended = ended
        self._pursue(intention, intention.event)
        self._settle(intention)
        return intention

    def stop(self) -> None:
        """Ends `run`."""
        self._stopping = True
        self._signal()

    # What the host calls, from one thread

    def next_wakeup(self) -> int | None:
        """When (ns) a timer is due next; None when none is."""
        return self._timers[0][0] if self._timers else None

    def run(self) -> None:
        """Runs until `stop`, asleep while there is nothing to do. The clock has to run by itself."""
        bell, host = Wakeup(), self.wake

        def ring_both() -> None:
            bell.ring()
            if host is not None:
                host()

        self.wake = bell.ring if host is None else ring_both
        try:
            while not self._stopping:
                if not self.run_until_idle(16):
                    due = self.next_wakeup()
                    bell.wait(None if due is None else (due - self.clock.now()) / SECOND)
        finally:
            self.wake = host
            if self.pool is not None:
                self.pool.close()

    def mind(self) -> Mind:
        """What is believed, desired and intended at this moment."""
        return Mind(
            beliefs=tuple(self.beliefs),
            desires=self.desires(),
            intentions=tuple(self.intentions),
        )

    def desires(self) -> tuple[Literal, ...]:
        """The goals that are pursued at this moment."""
        return tuple(goal_of(goal, self.library.goals) for intention in self.intentions for goal in intention.goals())

    def query(self, condition: object) -> Iterator[dict[str, Any]]:
        """The solutions of a condition, as the values of its variables by name."""
        from socialbot.bdi.compiler.plans import compile_query

        names, solve = compile_query(conjunction(condition), self.library)
        for found in list(solve(self, [])):
            yield dict(zip(names, found, strict=True))

    def why_not(self, plan: Plan | str, *args: Any) -> str:
        """Why a plan (by its label, or itself) would not be chosen now, for an event with these arguments."""
        label = plan if isinstance(plan, str) else plan.label or str(plan)
        return why_not(self, label, args or None)

    def explain(self, record: str) -> list[Record]:
        """What led to a record such as an action, back to the percept. The trace has to go to a `Trace`."""
        chain = getattr(self.sink, "explain", None)
        if chain is None:
            raise RuleError("no trace is kept", where=self.name, remedy="give the engine sink=Trace()")
        return chain(record)

    # For sensors

    def take(self, sensor: Sensor, percept: Any, cause: str, since: int | None) -> None:
        """Has a sensor make beliefs of a percept."""
        if sensor.engine is self and not sensor.running:
            return
        try:
            sensed = changes(sensor.sense(percept))
            for event in sensed:
                self._change(event, cause, since)
        except Exception as problem:  # noqa: BLE001 - sensors are user code
            self.record_failure(type(sensor).__name__, cause, problem)
            return
        if sensor.once and sensed:
            sensor.stop()

    # Within

    def _change(self, event: Event, cause: str, since: int | None) -> None:
        belief = event.literal
        if event.change is Change.ADDED:
            relation, args, *_ = self._admit(belief)
            self.add(relation, args, belief.annotations + PERCEPT, cause, since)
        else:
            self._forget(belief, cause)

    def _admit(self, belief: Literal) -> tuple[Relation, Any, Any, str, None]:
        """Checks a belief, and looks up once where it belongs."""
        belief.check()
        kind = belief.__class__
        known = self.relations.known.get((kind, len(belief.args)))
        if known is not None:
            belief.posted = (known, belief.args, belief.annotations + SELF, "", None)
            return belief.posted
        relation = self.relations[belief.key]
        if belief.__class__ is not Structure and relation.kind is not belief.__class__:
            self.library.declare(belief.__class__)
            self.equip(belief.__class__)
        if kind is not Structure and not belief.negated and belief.posted is None:
            # A class that makes new beliefs is worth it; a constant that agents share is not.
            self.relations.know(kind, len(belief.args), relation)
        belief.posted = (relation, belief.args, belief.annotations + SELF, "", None)
        return belief.posted

    def _want(self, goal: Literal, notes: tuple[Any, ...], cause: str) -> None:
        trigger, limit_s = self.triggers[f"+!{goal.key}"], getattr(goal, "limit_s", None)
        if limit_s is None:
            self.events.append((trigger, goal.args, notes, cause))
        else:
            self.adopt_within((SUBGOAL, trigger, goal.args, notes, cause), limit_s)

    def _forget(self, belief: Literal, cause: str) -> None:
        variables: dict[str, Var] = {}
        args = tuple(_opened(arg, variables) for arg in belief.args)
        notes = tuple(_opened(note, variables) for note in belief.annotations)
        self.forget_all(self.relations[belief.key], args, notes, cause)

    def _post(self, item: Any) -> None:
        self.inbox.append(item)
        if self.wake is not None and not self.signalled:
            self._signal()

    def _signal(self) -> None:
        self.signalled = True
        if self.wake is not None:
            self.wake()


def _source(name: str) -> tuple[object, ...]:
    return PERCEPT if name == "percept" else SELF if name == "self" else (source(Atom(name)),)


def _opened(term: Any, variables: dict[str, Var]) -> Any:
    """A term with fresh variables for the named ones."""
    if isinstance(term, Variable):
        return Var() if term.name == "_" else variables.setdefault(term.name, Var(term.name))
    if isinstance(term, tuple):
        return tuple(_opened(item, variables) for item in term)
    if isinstance(term, Literal):
        return term.with_(args=_opened(term.args, variables), annotations=_opened(term.annotations, variables))
    return term


__all__ = ["Engine", "closed", "resolve"]
