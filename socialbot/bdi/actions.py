"""Actions: what an agent can do. Subclass `Action` and override `Action.execute`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import Literal
from socialbot.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine


class Action(Literal):
    """One thing the agent can do, as a step of a rule's body.

    While it executes, ``engine`` is the engine it runs in and ``id`` its record in the trace. An
    exception fails the goal that the action serves; it never stops the agent.
    """

    engine: Engine
    id: str

    def execute(self, *args: Any, **kwargs: Any) -> None:
        """Does it; ``args`` are the values of the arguments."""
        raise RuleError(f"the action {self.functor} does nothing", remedy="override execute()")

    def run(self, engine: Engine, record_id: str) -> None:
        """Executes this action, which `ground` has made for this one time: agents that share a rule share no state."""
        self.engine = engine
        self.id = record_id
        self.execute(*self.args)


class fail(Action):  # noqa: N801 - reads as a step of a plan
    """Fails the goal at hand, for a reason."""

    def execute(self, reason: str = "the plan says so") -> None:
        raise PlanFailed(reason)


class PlanFailed(Exception):  # noqa: N818 - what it says
    """Raised by an action that could not do what it was asked to."""


class wait(Action):  # noqa: N801 - reads as a step of a plan
    """Suspends the intention for some seconds; the agent goes on with its other intentions."""

    def execute(self, seconds: float) -> None:
        self.engine.suspend(seconds)
