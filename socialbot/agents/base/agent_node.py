"""Agent node: runs a BDI engine, publishes its actions, trace and mental state, and takes commands of users."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from socialbot.agents.base.state_file import MindFile
from socialbot.bdi import Action, Engine, Record
from socialbot.bdi.agentspeak import AgentSpeakError, parse_literal
from socialbot.bdi.literals import Computed, Literal, ground, literal
from socialbot.bdi.stdlib.goals import desire as pursued
from socialbot.bdi.stdlib.goals import drop_goal
from socialbot.bdi.stdlib.registry import opened
from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.decoding import from_json
from socialbot.core.errors import GraphError, RuleError, SocialbotError
from socialbot.core.messages import (
    AGENT_ANSWERS,
    AGENT_COMMANDS,
    NO_JSON,
    ActionRequest,
    AgentAnswer,
    AgentCommand,
    Mind,
    MindBelief,
    State,
    TraceRecord,
)
from socialbot.deliberation import parse_fact, parse_facts
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.messages import Desire
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Delivery, Input, Output, Parameter

TURNS = 16
"""Turns of the engine between two looks at other messages and calls of the node."""

SHOW_EVERY_S = 0.1
"""Minimum time between two messages about the mind of an agent that never becomes idle."""


PERSON = "person"
"""Source of beliefs that users add."""


class RefusedError(SocialbotError):
    """Command that an agent refuses."""

    exit_code = 4


Change = Callable[[str], object]
"""Accepted command; its argument is the id of the causing trace record."""


class EngineCommands:
    """Commands to an engine. Beliefs and goals are AgentSpeak literals. Methods raise RefusedError."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def believe(self, text: str) -> Change:
        """Add a belief with the source `PERSON`."""
        belief = _closed(text)
        kind = self._engine.beliefs.relation(belief.key).kind
        if kind is not None and issubclass(kind, Computed):
            raise RefusedError(f"{belief} is computed: it cannot be added")
        return lambda cause: self._engine.believe(belief, source=PERSON, cause=cause)  # type: ignore[arg-type]

    def forget(self, text: str) -> Change:
        """Remove a belief of any source; variables match anything."""
        belief = _parsed(text)
        relation = self._engine.beliefs.relations.get(belief.key)
        if relation is None or not relation.facts:
            raise RefusedError(f"it believes nothing like {belief}")
        if ground(belief) and belief.args not in relation.facts:
            raise RefusedError(f"it does not believe {belief}")
        return lambda cause: self._engine.forget(belief, cause=cause)  # type: ignore[arg-type]

    def achieve(self, text: str) -> Change:
        """Adopt a goal that has plans."""
        goal = _closed(text)
        triggers = self._engine.library.triggers.items()
        known = {key[2:] for key, trigger in triggers if key.startswith("+!") and trigger.plans}
        if goal.key not in known:
            has = f"it has some for {', '.join(sorted(known))}" if known else "it has none for any goal"
            raise RefusedError(f"it has no plan for {goal}; {has}")
        return lambda cause: self._engine.achieve(goal, cause=cause)

    def drop(self, text: str) -> Change:
        """Drop a goal."""
        goal = _parsed(text)
        goal = goal.with_(args=opened(goal.args, {}))
        if next(pursued(self._engine, (goal,), []), 0) == 0:
            raise RefusedError(f"it does not want {text.strip()}")
        return lambda cause: self._engine.call(lambda: drop_goal(self._engine, goal))


class DeliberatorCommands:
    """Commands to a deliberator. Beliefs are facts of its domain, goals are desires. Methods raise SocialbotError."""

    def __init__(self, deliberator: Deliberator) -> None:
        self._deliberator = deliberator
        self._facts = deliberator.facts

    def believe(self, text: str) -> Change:
        """Add a fact of the domain."""
        fact = parse_fact(text)
        _refuse(self._facts.unfit(fact))
        return self._call(lambda cause: self._facts.add(fact, source=PERSON, cause=cause))

    def forget(self, text: str) -> Change:
        """Remove a fact; wildcards match anything."""
        fact = parse_fact(text)
        _refuse(self._facts.unfit_pattern(fact))
        if "*" not in fact.params and self._facts.current(fact) is None:
            raise RefusedError(f"it does not believe {fact}")
        return self._call(lambda cause: self._facts.remove(fact, cause))

    def achieve(self, text: str) -> Change:
        """Adopt a desire, given as JSON or as its target facts."""
        desire = _desire(text)
        _refuse(self._deliberator.objection(desire))
        if self._facts.fulfilled(desire):
            raise RefusedError("its target holds already")
        return self._call(lambda cause: self._deliberator.desire(desire, cause=cause))

    def drop(self, text: str) -> Change:
        """Drop the desire of this name."""
        desires, name = self._deliberator.desires, text.strip()
        if name not in desires:
            names = ", ".join(state.name for state in desires)
            raise RefusedError(f"it has no desire {name!r}; {f'it has {names}' if names else 'it desires nothing'}")
        return self._call(lambda cause: self._deliberator.drop(name, "a person asked for it", cause=cause))

    def _call(self, change: Change) -> Change:
        return lambda cause: self._deliberator.engine.call(lambda: change(cause))


def _refuse(reason: str | None) -> None:
    if reason:
        raise RefusedError(reason)


def _parsed(text: str) -> Literal:
    """Parse an AgentSpeak literal that may start with a capital, as class names do. Raises RefusedError."""
    text = text.strip().removesuffix("()")
    capital = text[:1].isupper()
    try:
        found = parse_literal(text[:1].lower() + text[1:] if capital else text, "command")
    except AgentSpeakError as error:
        raise RefusedError(error.what.partition("\n")[0]) from error
    except RuleError as error:
        raise RefusedError(error.what) from error
    return literal(text[:1] + found.functor[1:], found.args) if capital else found


def _closed(text: str) -> Literal:
    found = _parsed(text)
    if not ground(found):
        raise RefusedError(f"{found} has a variable or a computed value: write values")
    return found


def _desire(text: str) -> Desire:
    text = text.strip()
    if not text.startswith("{"):
        return Desire(name=text.lower(), value=parse_facts(text))
    try:
        return from_json(text, Desire)
    except NO_JSON as error:
        raise RefusedError(f"invalid desire: {error}") from error


class AgentNode(Node):
    """Node that hosts one engine. Subclasses build the engine and pass input messages to its sensors.

    With a ``mind_file`` the agent restores its mental state after a restart or crash.
    """

    is_agent = True

    keeps_mind: ClassVar[bool] = True
    """Whether to save the mental state; False if the plans of the agent arrive as messages."""

    actions = Output(ActionRequest, "/agent/actions")
    mind = Output(Mind, "/agent/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "/agent/trace")
    people_ask = Input(AgentCommand, AGENT_COMMANDS, optional=True)
    people_told = Output(AgentAnswer, AGENT_ANSWERS)

    mind_file = Parameter("", "file of beliefs and goals, to continue after a restart; empty: none", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._due: int | None = None
        self._alarm: Timer | None = None
        self._shown: Mind | None = None
        self._next_look = 0
        self._is_to_show = True
        """Whether something was recorded or a time was up since the mind was shown."""
        self._beliefs: tuple[MindBelief, ...] | None = None
        self._mind_file: MindFile | None = None
        self._paused = False
        self._health: tuple[State, str] = ("ok", "")
        self._broken: Mapping[str, str] = {}
        engine: object = self.build()
        if not isinstance(engine, Engine):
            what = f"{type(self).__name__}.build returns {engine!r}, which is no engine"
            raise GraphError(what, where=self.name, remedy="end it with: return engine")
        for name, connected, role in ("wake", engine.wake, "never act"), ("sink", engine.trace.sink, "leave no record"):
            if connected is None:
                value = "self.wake" if name == "wake" else "self.record"
                what = f"the engine of {type(self).__name__}.build has no {name}: the agent would {role}"
                raise GraphError(what, where=self.name, remedy=f"make it with Engine(..., {name}={value})")
        self.engine = engine

    def build(self) -> Engine:
        """Return the engine: rules, sensors, ``robot=self, sink=self.record, wake=self.wake``."""
        raise NotImplementedError

    def start(self) -> None:
        self.engine.compile_plans()
        self.recall()
        self.wake()

    def stop(self) -> None:
        if self._mind_file is not None:
            self._mind_file.close()

    def recall(self) -> None:
        """Restore the state in ``mind_file`` and save it there from now on."""
        if self.mind_file and self.keeps_mind:
            path = paths.in_workspace(self.mind_file, where=f"{self.name}.mind_file")
            self._mind_file = MindFile(self, path, self.engine)
            if self._mind_file.recall():
                self._beliefs = None
                self.on_recalled()

    def on_recalled(self) -> None:
        """Called after a restore: stateful sensors initialize themselves from the beliefs."""

    def wake(self) -> None:
        """Schedule `think` in the thread of the node."""
        self.context.call_soon(self.think)

    def think(self) -> None:
        """Run the engine, and schedule the next call."""
        if self._paused:
            return
        busy = self.engine.run_until_idle(TURNS)
        if self.engine.interpreter.broken_sensors != self._broken:
            self._report_sensors()
        if busy:
            self.wake()
        if self._mind_file is not None:
            self._mind_file.look()
        self._set_alarm(self.engine.next_wakeup())
        # Most messages of sensors change nothing.
        if (self._is_to_show and not busy) or self.clock.now() >= self._next_look:
            self._show_mind()

    def _report_sensors(self) -> None:
        """Report sensors that understand no percept."""
        self._broken = self.engine.interpreter.broken_sensors
        reasons = (f"the sensor {name} fails at each percept: {why}" for name, why in self._broken.items())
        self.report_health("degraded" if self._broken else "ok", "; ".join(reasons))

    # Commands of users

    @people_ask
    def on_people_ask(self, message: AgentCommand) -> None:
        """Execute or refuse the command of a user, and record it in the trace."""
        if message.agent != self.name:
            return
        text = f"{message.command} {message.text}".strip()
        try:
            self._execute(message, text)
            reason = ""
        except SocialbotError as error:
            reason = error.what if isinstance(error, RefusedError) else str(error)
            self.engine.trace.record("refused", text, message.id, reason=reason)
        answer = AgentAnswer(stamp=self.clock.now(), id=message.id, agent=self.name, accepted=not reason, reason=reason)
        self.people_told.publish(answer)

    def command_handler(self) -> EngineCommands | DeliberatorCommands:
        """The handler of user commands other than pause, resume and step."""
        return EngineCommands(self.engine)

    def _execute(self, message: AgentCommand, text: str) -> None:
        if message.command not in ("pause", "resume", "step"):
            change = getattr(self.command_handler(), message.command)(message.text)
            change(self.engine.trace.record("command", text, message.id))
            return
        if self._paused == (message.command == "pause"):
            raise RefusedError("it is paused already" if self._paused else "it is not paused")
        self.engine.trace.record("command", text, message.id)
        if message.command == "step":
            self.engine.run_until_idle(1)
            self._show_mind()
            return
        self._paused = not self._paused
        self.report_health(*self._health)
        if not self._paused:
            self.wake()

    def report_health(self, state: State, reason: str = "") -> None:
        """Report the health of the node; a paused node reports that instead."""
        self._health = (state, reason)
        if self._paused:
            super().report_health("paused", "paused by a person")
        else:
            super().report_health(state, reason)

    def _set_alarm(self, due: int | None) -> None:
        if due == self._due:
            return
        if self._alarm is not None:
            self._alarm.cancel()
        self._due = due
        self._alarm = None if due is None else self.context.call_at(due, self._ring)

    def _ring(self) -> None:
        self._due = self._alarm = None
        self._is_to_show = True
        self.think()

    def act(self, action: Action, *arguments: str | int | float | bool) -> None:
        """Publish an action request for ``action``; called by the actions of the agent."""
        now, agent = self.clock.now(), self.engine.name
        request = ActionRequest(stamp=now, id=action.id, agent=agent, name=action.functor, arguments=arguments)
        self.actions.publish(request)

    def record(self, record: Record) -> None:
        """Publish a trace record."""
        self._is_to_show = True
        if record.kind in ("belief", "unbelief"):
            self._beliefs = None
        if self._mind_file is not None:
            self._mind_file.changed()
        self.trace.publish(self.trace_message(record))

    def trace_message(self, record: Record) -> TraceRecord:
        """Return the message of a trace record."""
        return TraceRecord(
            stamp=record.time,
            id=record.id,
            source=self.name,
            kind=record.kind,
            what=record.what,
            cause=record.cause,
            detail=record.detail,
        )

    def _show_mind(self) -> None:
        engine, before, self._is_to_show = self.engine, self._shown, False
        self._next_look = self.clock.now() + nanoseconds(SHOW_EVERY_S)
        if self._beliefs is None:
            self._beliefs = tuple(
                MindBelief(text=str(held.belief), source=held.source, since=held.since) for held in engine.beliefs
            )
        shown = self._beliefs, tuple(map(str, engine.intentions.desires())), tuple(map(str, engine.intentions))
        if before is None or (before.beliefs, before.desires, before.intentions) != shown:
            beliefs, desires, intentions = shown
            self._shown = Mind(
                stamp=self.clock.now(), agent=engine.name, beliefs=beliefs, desires=desires, intentions=intentions
            )
            self.mind.publish(self._shown)
