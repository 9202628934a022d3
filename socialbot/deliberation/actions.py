"""How people write what an action of a plan does: a class whose `PlanAction.advance` is called again and again.

>>> class carrier_unload(PlanAction):
...     def advance(self):
...         return self.progress_made + 0.25

`register` makes it the way to carry out the action of PDDL of that name. A plan of the engine for a goal of that name
and its objects, in Python or AgentSpeak, is as good.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi import Engine, LongAction, variables
from socialbot.bdi.literals import Change, Event, literal
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError

if TYPE_CHECKING:
    from socialbot.bdi.intentions import Intention


class PlanAction(LongAction):
    """An action that advances bit by bit: override `advance`, and perhaps `begin` and `stop`.

    ``agent`` is what the agent acts upon (``Engine.robot``), ``args`` are the names of the objects, ``progress_made``
    is the progress so far, 0 to 1. ``rate_hz`` is how often `advance` is called; the first time comes one period
    after the begin. An exception in any of them fails the action.
    """

    rate_hz: ClassVar[float] = 2.0
    args: tuple[str, ...]  # pyright: ignore[reportIncompatibleVariableOverride] - names, for whoever writes an action
    progress_made: float = 0.0
    _over = False
    _due = 0

    @property
    def agent(self) -> Any:
        """What the agent acts upon."""
        return self.engine.robot

    def begin(self, *args: Any, **never: Any) -> None:
        """Begins it; ``args`` are the names of the objects, which an override may name one by one."""

    def advance(self) -> float:
        """Does the next bit; returns the progress in all, 0 to 1. With 1 or more it is done."""
        raise PlanningError(f"the action {self.functor} does nothing", remedy="override advance()")

    def stop(self) -> None:
        """Stops it, as it is given up. Say `stopped` when it has; that may be later."""
        self.stopped()

    def fail(self, reason: str) -> None:
        """Says that it could not do what it was asked to."""
        self.failed(reason)

    def stopped(self) -> None:
        """Says that it has stopped, as `stop` asked for."""
        self.cancelled()

    # As the engine sees it

    def done(self) -> None:
        """Says that the action has done what it is for."""
        self._over = True
        super().done()

    def failed(self, reason: str | Exception = "the action failed") -> None:
        """Says that the action has failed, and why."""
        self._over = True
        super().failed(reason)

    def execute(self, *args: Any) -> Any:
        """Starts the action with its objects as text, and lets the plan wait for it."""
        self.args = tuple(map(str, args))
        return super().execute(*self.args)

    def start(self, *args: str) -> None:
        """Begins the action, as the engine asks. Raises PlanningError when it would never advance."""
        if not self.rate_hz > 0:
            raise PlanningError(f"{self.functor} advances {self.rate_hz} times a second", remedy="give more than 0")
        self._due = self.engine.clock.now()
        self.begin(*args)
        self._wait()

    def cancel(self) -> None:
        """Stops the action, as the engine asks."""
        self._over = True
        self.stop()

    def _wait(self) -> None:
        if not self._over:
            now, period = self.engine.clock.now(), nanoseconds(1 / self.rate_hz)
            # After a pause of the whole agent it goes on at its pace, and catches up on nothing.
            self._due = self._due + period if self._due + period > now else now + period
            self.engine.at(self._due, self._tick)

    def _tick(self) -> None:
        if self._over:
            return
        try:
            made = float(self.advance())
            if math.isnan(made):
                raise ValueError(f"advance() of {self.functor} returned {made}")
        except Exception as problem:  # noqa: BLE001 - user code
            self.failed(problem)
            return
        if self._over:
            return
        before, self.progress_made = self.progress_made, min(max(made, 0.0), 1.0)
        if self.progress_made >= 1.0:
            self.done()
        else:
            if self.progress_made != before:
                self.progress(self.progress_made)
            self._wait()


def register(engine: Engine, kind: type[PlanAction], parameters: int, name: str = "") -> None:
    """Has ``kind`` carry out the action of PDDL called ``name`` (as the class, if not given) with so many parameters.

    To be called as `Engine.add_rules` is: before the engine runs, or in its thread.
    """
    objects = variables(" ".join(f"P{number}" for number in range(1, parameters + 1)))
    wanted = Event(Change.WANTED, literal(name or kind.functor, tuple(objects)))
    engine.add_rules(wanted >> [kind(*objects)])


def progress_of(intention: Intention) -> float | None:
    """How far the `PlanAction` has come at which an intention rests; None when it rests at no such action."""
    action = getattr(intention.pause, "action", None)
    return action.progress_made if isinstance(action, PlanAction) else None
