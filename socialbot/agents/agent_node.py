"""The node that an agent lives in: messages in, actions out, every step of reasoning on record."""

from __future__ import annotations

from collections.abc import Mapping

from socialbot.bdi import Action, Engine, Record
from socialbot.graph import Context, Delivery, Node, Output, Timer
from socialbot.messages import ActionRequest, Mind, MindBelief, TraceRecord


class AgentNode(Node):
    """Hosts one engine. Subclasses build it, and show its sensors what their inputs bring."""

    actions = Output(ActionRequest, "/agent/actions")
    mind = Output(Mind, "/agent/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "/agent/trace")

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._due: int | None = None
        self._alarm: Timer | None = None
        self._shown: Mind | None = None
        self._beliefs: tuple[MindBelief, ...] | None = None
        self.engine = self.build()

    def build(self) -> Engine:
        """Makes the engine: rules, sensors, ``robot=self, sink=self.record, wake=self.wake``."""
        raise NotImplementedError

    def start(self) -> None:
        self.wake()

    def wake(self) -> None:
        """Lets the engine think as soon as the node is free."""
        self.context.call_soon(self.think)

    def think(self) -> None:
        """Lets the engine do what there is to do, and sees to it that it is called when there is more."""
        if self.engine.run_until_idle():
            self.wake()
        self._set_alarm(self.engine.next_wakeup())
        self._show_mind()

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
        desires, intentions = tuple(map(str, engine.desires())), tuple(map(str, engine.intentions))
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
