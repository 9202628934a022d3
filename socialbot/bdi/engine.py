"""Engine of one agent: the public interface of its parts.

An engine is passive: `Engine.run_until_idle` does everything that is due, `Engine.next_wakeup` tells the time of the
next timer. `Engine.run` does both in a program without a loop of its own. Beliefs, goals, percepts and calls may be
posted from any thread; everything happens in the thread that runs the engine.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from socialbot.bdi.actions import Action
from socialbot.bdi.explain import why_not
from socialbot.bdi.intentions import SUBGOAL, Failure, Intention, MentalState
from socialbot.bdi.interpreter import Interpreter
from socialbot.bdi.library import Library
from socialbot.bdi.literals import PERCEPT, SELF, Belief, Change, Goal, Literal, source
from socialbot.bdi.plans import Inference, Plan, flat
from socialbot.bdi.sensors import Sensor
from socialbot.bdi.terms import Atom, conjunction
from socialbot.bdi.timers import Timers, Wakeup
from socialbot.bdi.trace import Sink, TraceWriter
from socialbot.core.clock import SECOND, Clock

if TYPE_CHECKING:
    from random import Random


class MindChange(functools.partial[None]):
    """A posted change of beliefs or goals, which a restored mind replaces."""

    mental = True


class Engine:
    """One agent: a small interface to its belief base, intention stack, interpreter, library, messages and trace.

    Args:
        name: The name of the agent, unique in its society.
        clock: The clock of all its timers and records.
        robot: What the actions act upon.
        sink: Receives the trace records, such as a `Trace`.
        wake: Called, from any thread, when something is posted to an idle agent.
        library: The plans; agents of one kind may share a library.
        seed: The seed of the random numbers; by default the name.

    Attributes:
        beliefs: The belief base: iterate over it, ask ``belief in engine.beliefs``, or watch it.
        intentions: The intention stack: iterate over it, or drop an intention.
        library: The plan library.
        messaging: Messages to and from other agents.
        timers: Timers on the clock of the agent.
        trace: Writes trace records and explains them.
        interpreter: The reasoning cycle.
        actions: The actions of AgentSpeak by name.
        out: Receives the lines of ``.print``; by default they are printed.
        run_until_idle: Runs turns until nothing is left to do now, at most the given number (10,000); returns whether
            something is left. In a turn the agent takes in what was posted, calls due timers, handles one event and
            makes a step of one intention.
    """

    __slots__ = (
        "__weakref__", "_inbox", "_seed", "_stopping", "actions", "beliefs", "clock", "intentions", "interpreter",
        "messaging", "name", "out", "robot", "run_until_idle", "timers", "trace", "wake",
    )  # fmt: skip

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
        self.name = name
        self.clock = clock
        self.robot = robot
        self.wake = wake
        self.out: Callable[[str], object] | None = None
        self.actions: dict[str, Callable[..., Any] | type[Action]] = {}
        library = library or Library()
        library.users += 1
        self.trace = TraceWriter(name, clock, sink)
        self.timers = Timers(clock, self.trace)
        self.interpreter = Interpreter(self, library)
        self.beliefs = self.interpreter.beliefs
        self.intentions = self.interpreter.intentions
        self.messaging = self.interpreter.messaging
        self._inbox = self.interpreter.inbox
        # Not a method, which would be a further call for each event.
        self.run_until_idle = self.interpreter.run_until_idle
        self._seed = name if seed is None else seed
        self._stopping = False

    @property
    def library(self) -> Library:
        """The plan library, perhaps shared with other agents; change it by the methods of the engine."""
        return self.interpreter.library

    @property
    def random(self) -> Random:
        """The random numbers of the agent."""
        if self.interpreter.random is None:
            from random import Random  # made late, because it is large

            self.interpreter.random = Random(self._seed)
        return self.interpreter.random

    # Rules, actions and sensors: for the engine's thread

    def add_rules(self, *rules: Plan | Inference | list[Plan], first: bool = False) -> None:
        """Adds plans and inferences, behind the others or ``first``.

        Of the plans that fit an event, the first one whose condition holds is selected.
        """
        for rule in rules:
            if isinstance(rule, Inference):
                self.interpreter.own_library().add_inference(rule)
            else:
                for plan in flat([rule]):
                    self._add_plan(plan, first)

    def _add_plan(self, plan: Plan, first: bool) -> None:
        compiled, beliefs = self.interpreter.own_library().add(plan, first=first), self.beliefs
        for kind in plan.classes():
            beliefs.declare(kind)
        beliefs.listen(plan.event.key)
        if plan.event.change is Change.HELD:
            relation = beliefs.relation(plan.event.literal.key)
            for args, fact in list(relation.facts.items()):
                if args not in relation.first_facts:
                    relation.begin(args, fact)
                beliefs.set_hold_timer(relation, args, compiled)

    def remove_plan(self, plan: Plan | str) -> bool:
        """Removes a plan, or the one with a label; returns whether it existed."""
        library = self.interpreter.own_library()
        found = library.labelled(plan) if isinstance(plan, str) else plan
        return found is not None and library.remove(found)

    def add_text(self, text: str, file: str = "<text>") -> None:
        """Adds AgentSpeak text: beliefs, rules, goals and plans. Raises AgentSpeakError with the place of a mistake."""
        from socialbot.bdi.agentspeak.loading import load

        load(self, text, file)

    def add_action(self, action: Callable[..., Any] | type[Action], name: str | None = None) -> None:
        """Registers an action for AgentSpeak by its name: an `Action`, or a function of the engine and arguments."""
        self.actions[name or getattr(action, "functor", None) or action.__name__] = action

    def add_sensor(self, sensor: Sensor) -> None:
        """Adds a sensor, from any thread; one with a period is polled from now on."""
        sensor.attach(self)

    def compile_plans(self) -> None:
        """Compiles all plans now, so that the first events do not wait for it; otherwise each at its first use."""
        self.library.compile()

    # From any thread

    def believe(self, belief: Belief, *, source: str = "self", cause: str = "", since: int | None = None) -> None:
        """Adds a belief; a belief already held from this source is no event.

        Args:
            belief: The belief, without variables.
            source: ``self``, ``percept``, or the name of an agent.
            cause: The id of the trace record or message that led to it.
            since: The time (ns) at which it began; by default now.
        """
        item = belief.posted
        if item is None or item[0].base is not self.beliefs:
            item = self.interpreter.admit(belief)
        if source != "self" or cause or since is not None:
            item = (item[0], item[1], belief.annotations + _source(source), cause, since)
        self._inbox.append(item)
        if self.wake is not None and not self.interpreter.signalled:
            self.interpreter.signal()

    def forget(self, belief: Belief, *, cause: str = "") -> None:
        """Removes the beliefs that match, with all their sources; variables match anything."""
        self.interpreter.post(MindChange(self.interpreter.forget, belief, cause))

    def achieve(self, goal: Goal | Literal, *, cause: str = "") -> None:
        """Adopts a goal in an intention of its own."""
        goal.check()
        self.interpreter.post(MindChange(self._want, goal, goal.annotations or SELF, cause))

    def perceive(self, sensor: Sensor, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Passes a percept of the time ``since`` (ns, by default now) to a sensor."""
        self.interpreter.post(MindChange(self.interpreter.sense, sensor, percept, cause, since))

    def call(self, function: Callable[[], object]) -> None:
        """Calls a function in the engine's thread.

        For methods that only this thread may call: ``engine.call(lambda: engine.add_rules(rule))``.
        """
        self.interpreter.post(function)

    def stop(self) -> None:
        """Ends `run`."""
        self._stopping = True
        self.interpreter.signal()

    # For the engine's thread

    def attempt(self, goal: Goal | Literal, ended: Callable[[Failure | None], None], *, cause: str = "") -> Intention:
        """Adopts a goal at once; ``ended`` is called with the failure, or None.

        ``engine.intentions.drop(intention, then)`` gives it up, and calls ``then`` when its actions have stopped.
        """
        goal.check()
        intentions = self.intentions
        request = (SUBGOAL, self.library.triggers[f"+!{goal.key}"], goal.args, goal.annotations or SELF, cause)
        intention = intentions.new(request)
        intention.ended = ended
        intentions.pursue(intention, request)
        intentions.settle(intention)
        return intention

    def next_wakeup(self) -> int | None:
        """The time (ns) of the next timer; None without timers."""
        heap = self.timers.heap
        return heap[0][0] if heap else None

    def run(self) -> None:
        """Runs until `stop`; sleeps while there is nothing to do. The clock has to advance by itself."""
        wakeup, host = Wakeup(), self.wake

        def ring_both() -> None:
            wakeup.ring()
            if host is not None:
                host()

        self.wake = wakeup.ring if host is None else ring_both
        try:
            while not self._stopping:
                if not self.run_until_idle(16):
                    due = self.next_wakeup()
                    wakeup.wait(None if due is None else (due - self.clock.now()) / SECOND)
        finally:
            self.wake = host
            if self.interpreter.pool is not None:
                self.interpreter.pool.close()

    def mind(self) -> MentalState:
        """The beliefs, desires and intentions of this moment."""
        return MentalState(tuple(self.beliefs), self.intentions.desires(), tuple(self.intentions))

    def query(self, condition: object) -> Iterator[dict[str, Any]]:
        """The solutions of a condition, as the values of its variables by name."""
        from socialbot.bdi.compiler.plans import compile_query

        names, solve = compile_query(conjunction(condition), self.library)
        for found in list(solve(self.interpreter, [])):
            yield dict(zip(names, found, strict=True))

    def why_not(self, plan: Plan | str, *args: Any) -> str:
        """Why a plan (by its label, or itself) would not be selected now, for an event with these arguments."""
        label = plan if isinstance(plan, str) else plan.label or str(plan)
        return why_not(self.interpreter, label, args or None)

    # Posted calls

    def _want(self, goal: Literal, notes: tuple[Any, ...], cause: str) -> None:
        trigger, limit_s = self.library.triggers[f"+!{goal.key}"], getattr(goal, "limit_s", None)
        if limit_s is None:
            self.interpreter.events.append((trigger, goal.args, notes, cause))
        else:
            self.intentions.adopt_within((SUBGOAL, trigger, goal.args, notes, cause), limit_s)


def _source(name: str) -> tuple[object, ...]:
    return PERCEPT if name == "percept" else SELF if name == "self" else (source(Atom(name)),)
