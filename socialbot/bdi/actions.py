"""Actions of an agent: subclass `Action` and override `Action.execute`, or decorate a function.

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
    """Step of a plan's body that acts on the world.

    During its execution ``engine`` is its engine and ``id`` its trace record. An exception fails the goal of its plan
    but never stops the agent.
    """

    engine: Engine
    id: str
    limit_s: object = None
    function: ClassVar[Callable[..., Any] | None] = None
    threaded: ClassVar[bool] = False

    def execute(self, *args: Any, **kwargs: Any) -> Any:
        """Execute the action with the values of its arguments; the result False reports a failure."""
        raise RuleError(f"the action {self.functor} does nothing", remedy="override execute()")

    def within(self: T, seconds: object) -> T:
        """Copy of the action that fails (``timeout``) if it is still executing after ``seconds``."""
        twin: Any = copy.copy(self)
        twin.limit_s = seconds
        return twin


def action(function: Callable[..., Any]) -> type[Action]:
    """Decorator that makes an action from a function with the engine as its first parameter."""
    return type(
        function.__name__,
        (Action,),
        {"__doc__": function.__doc__, "__module__": function.__module__, "function": staticmethod(function)},
    )


class fail(Action):  # noqa: N801 - reads as a step of a plan
    """Action that fails the current goal for a reason."""

    def execute(self, reason: str = "the plan says so") -> None:
        raise PlanFailed(reason)


class PlanFailed(Exception):  # noqa: N818 - a failure of a plan, not an error
    """Exception that an action raises to report a failure."""


class wait(Action):  # noqa: N801 - reads as a step of a plan
    """Action that pauses its intention for some seconds; other intentions continue."""

    def execute(self, seconds: float) -> Any:
        from socialbot.bdi.intentions import Sleep

        return Sleep(seconds)
