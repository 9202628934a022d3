"""Actions of plans as Python classes, whose `PlanAction.advance` is called periodically.

>>> class carrier_unload(PlanAction):
...     def advance(self):
...         return self.progress_made + 0.25

`register` assigns it to the PDDL action of that name. A plan of the engine for a goal of that name and its objects, in
Python or AgentSpeak, is equivalent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi import Engine, LongAction, Variable
from socialbot.bdi.literals import Change, Event, literal
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError

if TYPE_CHECKING:
    from socialbot.bdi.intentions import Intention


class PlanAction(LongAction):
    """Action that advances periodically: override `advance`, and perhaps `begin` and `stop`.

    An exception in any of these methods fails the action.

    Attributes:
        rate_hz: Rate of `advance`; the first call is one period after the start.
        args: Names of the objects.
        progress_made: Progress so far, 0 to 1.
    """

    rate_hz: ClassVar[float] = 2.0
    args: tuple[str, ...]  # pyright: ignore[reportIncompatibleVariableOverride] - names rather than terms
    progress_made: float = 0.0
    _over = False
    _due = 0

    @property
    def agent(self) -> Any:
        """The robot or node that the agent acts upon (``Engine.robot``)."""
        return self.engine.robot

    def begin(self, *args: Any, **never: Any) -> None:
        """Start the action; an override may name the objects one by one."""

    def advance(self) -> float:
        """Do the next part; return the total progress, 0 to 1. The action ends with 1 or more."""
        raise PlanningError(f"the action {self.functor} does nothing", remedy="override advance()")

    def stop(self) -> None:
        """Stop the action, and call `stopped` then or later."""
        self.stopped()

    def fail(self, reason: str) -> None:
        self.failed(reason)

    def stopped(self) -> None:
        self.cancelled()

    def done(self) -> None:
        self._over = True
        super().done()

    def failed(self, reason: str | Exception = "the action failed") -> None:
        self._over = True
        super().failed(reason)

    def execute(self, *args: Any) -> Any:
        """Start the action with the names of its objects."""
        self.args = tuple(map(str, args))
        return super().execute(*self.args)

    def start(self, *args: str) -> None:
        """Start the action for the engine. Raises PlanningError for a wrong rate."""
        if not self.rate_hz > 0:
            raise PlanningError(f"rate_hz of {self.functor} must be > 0 (got {self.rate_hz})")
        self._due = self.engine.clock.now()
        self.begin(*args)
        self._wait()

    def cancel(self) -> None:
        """Stop the action for the engine."""
        self._over = True
        self.stop()

    def _wait(self) -> None:
        if not self._over:
            now, period = self.engine.clock.now(), nanoseconds(1 / self.rate_hz)
            # Periods missed during a pause of the agent are skipped.
            self._due = self._due + period if self._due + period > now else now + period
            self.engine.timers.at(self._due, self._tick)

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
    """Assign a class to the PDDL action ``name`` (default: that of the class). Call it as `Engine.add_rules`."""
    objects = tuple(Variable(f"P{number}") for number in range(1, parameters + 1))
    wanted = Event(Change.WANTED, literal(name or kind.functor, objects))
    engine.add_rules(wanted >> [kind(*objects)])


def progress_of(intention: Intention) -> float | None:
    """Return the progress of the `PlanAction` that an intention waits for; None if it waits for none."""
    action = getattr(intention.pause, "action", None)
    return action.progress_made if isinstance(action, PlanAction) else None
