"""Actions: what an agent can do. Subclass `Action` and override `Action.execute`, or decorate a function.

>>> @action
... def greet(engine, name): print("Hello", name)
>>> greet("Ada")
greet("Ada")
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.literals import Literal, T
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine


class Action(Literal):
    """One thing the agent can do, as a step of a plan's body.

    While it executes, ``engine`` is the engine it runs in and ``id`` its record in the trace. An
    exception fails the goal that the action serves; it never stops the agent.
    """

    engine: Engine
    id: str
    limit_s: object = None
    function: ClassVar[Callable[..., Any] | None] = None
    threaded: ClassVar[bool] = False

    def execute(self, *args: Any, **kwargs: Any) -> Any:
        """Does it; ``args`` are the values of the arguments. False means that it failed."""
        raise RuleError(f"the action {self.functor} does nothing", remedy="override execute()")

    def within(self: T, seconds: object) -> T:
        """The same action, which fails (``timeout``) when it has not ended in ``seconds``."""
        twin: Any = copy.copy(self)
        twin.limit_s = seconds
        return twin


def action(function: Callable[..., Any]) -> type[Action]:
    """Makes an action of a function, whose first parameter is the engine."""
    return type(
        function.__name__,
        (Action,),
        {"__doc__": function.__doc__, "__module__": function.__module__, "function": staticmethod(function)},
    )


class fail(Action):  # noqa: N801 - reads as a step of a plan
    """Fails the goal at hand, for a reason."""

    def execute(self, reason: str = "the plan says so") -> None:
        """Raises PlanFailed."""
        raise PlanFailed(reason)


class PlanFailed(Exception):  # noqa: N818 - what it says
    """Raised by an action that could not do what it was asked to."""


class wait(Action):  # noqa: N801 - reads as a step of a plan
    """Rests the intention for some seconds; the agent goes on with its other intentions."""

    def execute(self, seconds: float) -> Any:
        """Lets the plan rest for so many seconds."""
        from socialbot.bdi.intentions import Sleep

        return Sleep(seconds)
