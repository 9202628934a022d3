"""Run an agent as a node: messages in, actions out, every reasoning step on record, its mind kept in a file."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from socialbot.agents.base.commands import CommandHandler, ObligingEngine, RefusedError
from socialbot.bdi import Action, Engine, Record, saving
from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import (
    AGENT_ANSWERS,
    AGENT_COMMANDS,
    ActionRequest,
    AgentAnswer,
    AgentCommand,
    Mind,
    MindBelief,
    State,
    TraceRecord,
)
from socialbot.graph.node import Context, Delivery, Input, Node, Output, Parameter, Timer

SAVE_EVERY_S = 0.2
"""At least so long between two savings."""

RECORDS_SKIPPED = 1000
"""Numbers of trace records that may have been given after the last saving, and are not to be given again."""


class MindFile:
    """Keeps the mind of ``engine`` in ``path``. What takes time is done beside the agent.

    At any time the file holds one mind, whole. A disk that fails is told of, and keeps no agent from going on.
    """

    def __init__(self, engine: Engine, path: Path, context: Context, log: logging.Logger) -> None:
        self._engine = engine
        self._path = path
        self._context = context
        self._log = log
        self._earliest = 0
        self._due: Timer | None = None
        self._closed = threading.Event()
        self._one_at_a_time = threading.Lock()

    def recall(self) -> bool:
        """Gives the agent the mind that is kept; says whether there is one. One that is damaged is set aside."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if not self._path.exists():
            return False
        try:
            data = saving.read(self._path)
            saving.restore(self._engine, {**data, "records": data["records"] + RECORDS_SKIPPED})
        except (saving.MindError, KeyError, TypeError) as error:
            aside = self._path.with_name(f"{self._path.name}.damaged")
            self._log.warning("begins anew: its mind cannot be restored and is now %s: %s", aside, error)
            self._path.replace(aside)
            return False
        return True

    def changed(self) -> None:
        """Has the mind saved: soon, with all that changes until then."""
        if self._due is None:
            self._due = self._context.call_at(max(self._context.clock.now(), self._earliest), self._save)

    def close(self) -> None:
        """Saves the mind for the last time, at once."""
        if self._due is not None:
            self._due.cancel()
        with self._one_at_a_time:
            self._closed.set()
            self._try(lambda: saving.write(self._engine, self._path))

    def _save(self) -> None:
        self._due = None
        self._earliest = self._context.clock.now() + nanoseconds(SAVE_EVERY_S)
        if (data := self._try(lambda: saving.save(self._engine))) is not None:
            self._context.run_in_background(functools.partial(self._write, data), self._written)

    def _write(self, data: dict[str, Any]) -> None:
        with self._one_at_a_time:
            if not self._closed.is_set():
                saving.write_data(data, self._path)

    def _written(self, result: Exception | None) -> None:
        if isinstance(result, Exception):
            self._log.warning("its mind is not kept: %s", result)

    def _try(self, work: Callable[[], Any]) -> Any:
        try:
            return work()
        except (saving.MindError, OSError) as error:
            self._written(error)
            return None


class AgentNode(Node):
    """Hosts one engine. Subclasses build it, and show its sensors what their inputs bring.

    With a ``mind_file`` the agent goes on where it was when its process was ended, in whatever way.
    """

    is_agent = True

    keeps_mind: ClassVar[bool] = True
    """Whether its mind is worth keeping: not so where its plans come by messages."""

    actions = Output(ActionRequest, "/agent/actions")
    mind = Output(Mind, "/agent/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "/agent/trace")
    people_ask = Input(AgentCommand, AGENT_COMMANDS, optional=True)
    people_told = Output(AgentAnswer, AGENT_ANSWERS)

    mind_file = Parameter("", "where to keep what it believes and wants; it goes on from there", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._due: int | None = None
        self._alarm: Timer | None = None
        self._shown: Mind | None = None
        self._beliefs: tuple[MindBelief, ...] | None = None
        self._mind_file: MindFile | None = None
        self._paused = False
        self._health: tuple[State, str] = ("ok", "")
        self.engine = self.build()

    def build(self) -> Engine:
        """Makes the engine: rules, sensors, ``robot=self, sink=self.record, wake=self.wake``."""
        raise NotImplementedError

    def start(self) -> None:
        self.engine.compile_plans()
        self.recall()
        self.wake()

    def stop(self) -> None:
        if self._mind_file is not None:
            self._mind_file.close()

    def recall(self) -> None:
        """Goes on where the mind in ``mind_file`` was left, and keeps it there from now on."""
        if self.mind_file and self.keeps_mind:
            path = paths.in_workspace(self.mind_file, where=f"{self.name}.mind_file")
            self._mind_file = MindFile(self.engine, path, self.context, self.log)
            if self._mind_file.recall():
                self._beliefs = None
                self.on_recalled()

    def on_recalled(self) -> None:
        """Called when the mind of an earlier run was restored: sensors that remember take up what is believed."""

    def wake(self) -> None:
        """Lets the engine think as soon as the node is free."""
        self.context.call_soon(self.think)

    def think(self) -> None:
        """Lets the engine do what there is to do, and sees to it that it is called when there is more."""
        if self._paused:
            return
        if self.engine.run_until_idle():
            self.wake()
        self._set_alarm(self.engine.next_wakeup())
        self._show_mind()

    # What people ask for

    @people_ask
    def on_people_ask(self, message: AgentCommand) -> None:
        """Does what a person asks for, or says why not; both are in the trace."""
        if message.agent != self.name:
            return
        text = f"{message.command} {message.text}".strip()
        try:
            self._obey(message, text)
            reason = ""
        except SocialbotError as error:
            reason = error.what if isinstance(error, RefusedError) else str(error)
            self.engine.trace.record("refused", text, message.id, reason=reason)
        answer = AgentAnswer(stamp=self.clock.now(), id=message.id, agent=self.name, accepted=not reason, reason=reason)
        self.people_told.publish(answer)

    def asked(self) -> CommandHandler:
        """What people may ask for."""
        return ObligingEngine(self.engine)

    def _obey(self, message: AgentCommand, text: str) -> None:
        if message.command in ("pause", "resume", "step"):
            if self._paused == (message.command == "pause"):
                raise RefusedError("it is paused already" if self._paused else "it is not paused")
            self.engine.trace.record("command", text, message.id)
            self._halt(message.command)
        else:
            do = getattr(self.asked(), message.command)(message.text)
            do(self.engine.trace.record("command", text, message.id))

    def _halt(self, command: str) -> None:
        """Pauses; goes on; or, between these, lets the engine have one turn."""
        if command == "step":
            self.engine.run_until_idle(1)
            self._show_mind()
            return
        self._paused = command == "pause"
        self.say_health(*self._health)
        if not self._paused:
            self.wake()

    def say_health(self, state: State, reason: str = "") -> None:
        """Says how the node is; while it is paused, that."""
        self._health = (state, reason)
        if self._paused:
            super().say_health("paused", "paused by a person")
        else:
            super().say_health(state, reason)

    # Time

    def _set_alarm(self, due: int | None) -> None:
        if due == self._due:
            return
        if self._alarm is not None:
            self._alarm.cancel()
        self._due = due
        self._alarm = None if due is None else self.context.call_at(due, self._ring)

    def _ring(self) -> None:
        self._due = self._alarm = None
        self.think()

    def act(self, action: Action, *arguments: str | int | float | bool) -> None:
        """Asks the robot to do ``action``; for the actions of the agent to call."""
        self.actions.publish(
            ActionRequest(
                stamp=self.clock.now(),
                id=action.id,
                agent=self.engine.name,
                name=action.functor,
                arguments=arguments,
            )
        )

    def record(self, record: Record) -> None:
        """Publishes one record of the trace."""
        if record.kind in ("belief", "unbelief"):
            self._beliefs = None
        if self._mind_file is not None:
            self._mind_file.changed()
        self.trace.publish(
            TraceRecord(
                stamp=record.time,
                id=record.id,
                source=self.name,
                kind=record.kind,
                what=record.what,
                cause=record.cause,
                detail=record.detail,
            )
        )

    def _show_mind(self) -> None:
        engine, before = self.engine, self._shown
        if self._beliefs is None:
            self._beliefs = tuple(
                MindBelief(text=str(held.belief), source=held.source, since=held.since) for held in engine.beliefs
            )
        desires, intentions = tuple(map(str, engine.intentions.desires())), tuple(map(str, engine.intentions))
        if before is None or (before.beliefs, before.desires, before.intentions) != (
            self._beliefs,
            desires,
            intentions,
        ):
            self._shown = Mind(
                stamp=self.clock.now(),
                agent=engine.name,
                beliefs=self._beliefs,
                desires=desires,
                intentions=intentions,
            )
            self.mind.publish(self._shown)
