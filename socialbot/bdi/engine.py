"""Engine of one agent: the public interface of its parts.

An engine is passive: `Engine.run_until_idle` processes all pending work, and `Engine.next_wakeup` returns the time of
the next timer. `Engine.run` combines them for programs without a loop of their own. Any thread may post beliefs, goals,
percepts and calls; the thread that runs the engine processes them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from socialbot.bdi._explain import why_not
from socialbot.bdi._interpreter import Interpreter
from socialbot.bdi._rule_checks import actions_not_given, check_belief, check_goal, check_running, goals_without_plans
from socialbot.bdi._timers import Timers, Wakeup
from socialbot.bdi.intentions import SUBGOAL, Failure, Intention, MentalState
from socialbot.bdi.library import Library
from socialbot.bdi.literals import OWN_SOURCES, SELF, Belief, Change, Goal, Literal, distinct, known_notes, source_notes
from socialbot.bdi.plans import Inference, Plan, contents_of, flat
from socialbot.bdi.sensors import Sensor, take_percept
from socialbot.bdi.steps import Action
from socialbot.bdi.terms import Atom, conjunction
from socialbot.bdi.trace import Sink, TraceWriter, log
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from random import Random


class MindChange(functools.partial[None]):
    """Posted change of beliefs or goals; restoring a saved mind discards it."""

    mental = True


class Solutions:
    """Iterator over the solutions of a query; it is true while solutions are left."""

    __slots__ = ("_left",)

    def __init__(self, found: list[dict[str, Any]]) -> None:
        self._left = found[::-1]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return self

    def __next__(self) -> dict[str, Any]:
        if not self._left:
            raise StopIteration
        return self._left.pop()

    def __len__(self) -> int:
        return len(self._left)


class Engine:
    """One agent: its belief base, intention stack, interpreter, plan library, messages and trace.

    Args:
        name: The name of the agent, unique in its society.
        clock: The clock of all its timers and records.
        robot: The robot that actions control.
        sink: Receives the trace records, such as a `Trace`.
        wake: Called, from any thread, when something is posted to an idle agent.
        library: The plans; agents of one kind may share a library.
        seed: The seed of the random numbers; by default the name.

    Attributes:
        beliefs: The belief base: iterate over it, test ``belief in engine.beliefs``, or watch it.
        intentions: The intention stack: iterate over it, or drop an intention.
        library: The plan library.
        messaging: Messages to and from other agents.
        timers: Timers on the clock of the agent.
        trace: Writes trace records and explains them.
        interpreter: The reasoning cycle.
        actions: The actions of AgentSpeak by name.
        out: Receives the lines of ``.print``; by default they are printed.
        run_until_idle: Runs up to 10,000 turns, or another number; returns whether work remains.
            A turn processes posted items and due timers, handles one event, and executes a step of one intention.
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
        if isinstance(clock, type) or not callable(getattr(clock, "now", None)):
            raise RuleError(f"{clock!r} is not a clock", where=name, remedy="give a clock such as WallClock()")
        if name in OWN_SOURCES:
            raise RuleError(f"no agent can be named {name}: it is a source of beliefs", remedy="choose another name")
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
        # A method would cost a further call for each event.
        self.run_until_idle = self.interpreter.run_until_idle
        self._seed = name if seed is None else seed
        self._stopping = False

    @property
    def library(self) -> Library:
        """Plan library, possibly shared with other agents; change it by the methods of the engine."""
        return self.interpreter.library

    @property
    def random(self) -> Random:
        """Random numbers of the agent."""
        if self.interpreter.random is None:
            from random import Random  # created on demand, because it is large

            self.interpreter.random = Random(self._seed)
        return self.interpreter.random

    # Rules, actions and sensors: for the engine's thread

    def add_rules(self, *rules: Plan | Inference | list[Plan], first: bool = False) -> None:
        """Add plans and inferences, after the existing ones or ``first``.

        The engine selects the first relevant plan whose condition holds.
        """
        for rule in rules:
            if isinstance(rule, Inference):
                self.interpreter.own_library().add_inference(rule, first=first)
                for kind in contents_of(rule).kinds:
                    self.beliefs.declare(kind)
                self.intentions.waits.relearn()
            else:
                for plan in flat([rule]):
                    self._add_plan(plan, first)

    def _add_plan(self, plan: Plan, first: bool) -> None:
        compiled, beliefs = self.interpreter.own_library().add(plan, first=first), self.beliefs
        self.intentions.watch_goals()
        for kind in contents_of(plan).kinds:
            beliefs.declare(kind)
        if not isinstance(plan.event.literal, Literal) or plan.inner:
            beliefs.use(self.interpreter.library)
            return
        beliefs.listen(plan.event.key)
        if plan.event.change is Change.HELD:
            relation = beliefs.relation(plan.event.literal.key)
            for args in list(relation.facts):
                beliefs.set_hold_timer(relation, args, compiled)

    def remove_plan(self, plan: Plan | str) -> bool:
        """Remove a plan, given by itself or its label; return whether it existed."""
        library = self.interpreter.own_library()
        found = library.labelled(plan) if isinstance(plan, str) else plan
        return found is not None and library.remove(found)

    def add_text(self, text: str, file: str = "<text>") -> None:
        """Add AgentSpeak beliefs, rules, goals and plans. Raises AgentSpeakError with the place of an error."""
        from socialbot.bdi.agentspeak.loading import load

        load(self, text, file)

    def add_action(self, action: Callable[..., Any] | type[Action], name: str | None = None) -> None:
        """Register an AgentSpeak action: an `Action`, or a function of the engine and the arguments.

        Raises:
            RuleError: The name has a dot, as those of internal actions, which belong to all agents.
        """
        functor: str = name or getattr(action, "functor", None) or action.__name__
        if "." in functor:
            remedy = f'decorate the function with @asl_action("{functor}"), before the program is read'
            raise RuleError(f"{functor} is the name of an internal action", where=self.name, remedy=remedy)
        self.actions[functor] = action

    def add_sensor(self, sensor: Sensor) -> None:
        """Add a sensor, from any thread, and start to poll it if it has a period."""
        if not isinstance(sensor, Sensor):
            raise RuleError(f"{sensor!r} is not a sensor", where=self.name, remedy="give an instance of a Sensor class")
        sensor.attach(self)

    def compile_plans(self) -> None:
        """Compile all plans now instead of each at its first use.

        Goals of plans that no plan is for, and actions that nobody has registered, are logged.
        """
        self.library.compile()
        doubts = (*goals_without_plans(self.library), *actions_not_given(self.library, self.actions))
        for plan, what, remedy, _ in doubts:
            log().warning("%s: %s: %s; %s", self.name, getattr(plan, "place", ""), what, remedy)

    # From any thread

    def believe(self, belief: Belief, source: str = "self", cause: str = "", since: int | None = None) -> None:
        """Add a belief; a belief already held from this source raises no event.

        Args:
            belief: The belief, without variables.
            source: ``self``, ``percept``, or the name of an agent.
            cause: The id of the trace record or message that led to it.
            since: The begin of the belief (ns); by default now.
        """
        # Defaults of parameters that are keywords only would cost three percent of an event.
        try:
            item = belief.posted
        except AttributeError:
            item = None
        if item is None or item[0].base is not self.beliefs:
            if not isinstance(belief, Belief):
                check_belief(belief, "believe")
            item = self.interpreter.admit(belief)
        if source != "self" or cause or since is not None:
            if source.__class__ is not str and not isinstance(source, (str, Atom)):
                raise RuleError(f"{source!r} is not a source", where=self.name, remedy="give the name of an agent")
            if item[2] is SELF:
                item = (item[0], item[1], known_notes(source) or source_notes(source), cause, since)
            else:
                item = (item[0], item[1], distinct(belief.annotations + source_notes(source)), cause, since)
        self._inbox.append(item)
        if self.wake is not None and not self.interpreter.signalled:
            self.interpreter.signal()

    def forget(self, belief: Belief, *, cause: str = "") -> None:
        """Remove the matching beliefs, with all their sources or those of ``belief``; variables match anything."""
        check_belief(belief, "forget")
        self.interpreter.post(MindChange(self.interpreter.forget, belief, cause))

    def achieve(self, goal: Goal | Literal, cause: str = "") -> None:
        """Adopt a goal in a new intention."""
        check_goal(goal)
        self.interpreter.post(MindChange(self._want, goal, goal.annotations or SELF, cause))

    def perceive(self, sensor: Sensor, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Pass a percept from the time ``since`` (ns, by default now) to a sensor."""
        self.interpreter.post(MindChange(take_percept, self.interpreter, sensor, percept, cause, since))

    def call(self, function: Callable[[], object]) -> None:
        """Call a function in the engine's thread.

        Use it for methods limited to this thread: ``engine.call(lambda: engine.add_rules(rule))``.
        """
        self.interpreter.post(function)

    def stop(self) -> None:
        """End `run`, after the current step of the agent."""
        self._stopping = True
        self.interpreter.peers.append(self)  # ends the turn of a looping agent
        self.interpreter.signal()

    # For the engine's thread

    def attempt(self, goal: Goal | Literal, ended: Callable[[Failure | None], None], *, cause: str = "") -> Intention:
        """Adopt a goal at once; ``ended`` receives the failure, or None.

        ``engine.intentions.drop(intention, then)`` abandons it, and calls ``then`` after its actions have stopped.
        """
        check_goal(goal)
        intentions = self.intentions
        request = (SUBGOAL, self.library.triggers[f"+!{goal.key}"], goal.args, goal.annotations or SELF, cause)
        intention = intentions.new(request)
        intention.ended = ended
        intentions.pursue(intention, request)
        intentions.settle(intention)
        return intention

    def next_wakeup(self) -> int | None:
        """Time (ns) of the next timer; None without timers."""
        heap = self.timers.heap
        return heap[0][0] if heap else None

    def run(self) -> None:
        """Run until `stop` and sleep while no work is pending. The clock must advance by itself."""
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
                    if due is not None:
                        check_running(self.clock, self.name)
                    wakeup.wait(None if due is None else (due - self.clock.now()) / SECOND)
        finally:
            self.wake = host
            if self.interpreter.pool is not None:
                self.interpreter.pool.close()

    def mind(self) -> MentalState:
        """Snapshot of the beliefs, desires and intentions."""
        return MentalState(tuple(self.beliefs), self.intentions.desires(), tuple(self.intentions))

    def query(self, condition: object) -> Solutions:
        """Solutions of a condition, as the values of its variables by name; false if there is none."""
        from socialbot.bdi.compiler._plans import compile_query

        names, solve = compile_query(conjunction(condition), self.library)
        return Solutions([dict(zip(names, found, strict=True)) for found in solve(self.interpreter, [])])

    def why_not(self, plan: Plan | str, *args: Any) -> str:
        """Reason why a plan, given by itself or its label, does not apply to an event with these arguments."""
        label = plan if isinstance(plan, str) else plan.label or str(plan)
        return why_not(self.interpreter, label, args or None)

    # Posted calls

    def _want(self, goal: Literal, notes: tuple[Any, ...], cause: str) -> None:
        trigger, limit_s = self.library.triggers[f"+!{goal.key}"], getattr(goal, "limit_s", None)
        if limit_s is None:
            self.interpreter.events.append((trigger, goal.args, notes, cause))
        else:
            self.intentions.adopt_within((SUBGOAL, trigger, goal.args, notes, cause), limit_s)
