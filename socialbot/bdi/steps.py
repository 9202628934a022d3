"""Steps of plan bodies: actions, goals, belief changes, messages and control structures."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.literals import (
    Belief,
    Change,
    Event,
    Goal,
    HeldFor,
    Literal,
    Reactor,
    Structure,
    Symbolic,
    TimedLiteral,
    literal,
)
from socialbot.bdi.terms import (
    Comparison,
    Condition,
    Conjunction,
    LiteralVariable,
    Quoted,
    Variable,
    conjunction,
    show,
    written_condition,
)
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.plans import Inference


class Action(TimedLiteral):
    """Step of a plan's body that acts on the world.

    During its execution ``engine`` is its engine and ``id`` its trace record. An exception fails the goal of its plan
    but never stops the agent.
    """

    engine: Engine
    id: str
    function: ClassVar[Callable[..., Any] | None] = None
    threaded: ClassVar[bool] = False
    entry: ClassVar[str] = "execute"
    """Name of the method that takes the arguments."""

    def _only_a_step(self, *_: object) -> Any:
        raise RuleError(f"{self} is an action, which can only be a step", remedy=f"write event / condition >> [{self}]")

    __pos__ = __neg__ = __invert__ = __and__ = __rand__ = __or__ = __ror__ = __lshift__ = _only_a_step
    __truediv__ = __rshift__ = _only_a_step

    def execute(self, *args: Any, **kwargs: Any) -> Any:
        """Execute the action with the values of its arguments; the result False reports a failure."""
        raise RuleError(f"action {self.functor} has no execute()", remedy="override execute()")


def action(function: Callable[..., Any]) -> type[Action]:
    """Decorator that makes an action from a function with the engine as its first parameter.

    Raises:
        RuleError: The function has no parameter for the engine, or is a generator.
    """
    name = function.__name__
    code = getattr(function, "__code__", None)
    if code is not None and not (code.co_argcount or code.co_flags & inspect.CO_VARARGS):
        raise RuleError(f"action {name} has no parameter for the engine", remedy=f"write def {name}(engine, ...)")
    if inspect.isgeneratorfunction(function) or inspect.isasyncgenfunction(function):
        raise RuleError(f"action {name} is a generator, which no step runs", remedy="use async def and await")
    return type(
        function.__name__,
        (Action,),
        {"__doc__": function.__doc__, "__module__": function.__module__, "function": staticmethod(function)},
    )


class fail(Action):  # noqa: N801 - reads as a step of a plan
    """Action that fails the current goal for a reason."""

    def execute(self, reason: str = "failed by the plan") -> None:
        raise PlanFailed(reason)


class PlanFailed(Exception):  # noqa: N818 - a failure of a plan, not an error
    """Exception that an action raises to report a failure."""

    reason = "action_failed"
    annotations: tuple[Any, ...] = ()


class wait(Action):  # noqa: N801 - reads as a step of a plan
    """Action that pauses its intention for some seconds; other intentions continue."""

    def execute(self, seconds: float) -> Any:
        from socialbot.bdi.intentions import Sleep

        return Sleep(seconds)


class send(Action):  # noqa: N801 - reads as a step of a plan
    """Message to another agent: ``send(to, belief)`` tells a belief, ``send(to, goal, "achieve")`` delegates a goal.

    The third argument is the performative (see `socialbot.bdi._messaging.PERFORMATIVES`).
    """

    def execute(self, receiver: Any, content: Any, performative: str = "tell") -> Any:
        return self.engine.messaging.send(receiver, performative, content, self.id)


class message(Symbolic, Reactor):  # noqa: N801 - written like a belief
    """Event ``+message(Sender, Performative, Content)`` of every message to the agent."""

    symbols = 2


class AslCall(Structure):
    """Call of an action of AgentSpeak programs in a rule; ``shown`` is the name of the Python function for it."""

    shown = ""

    def __str__(self) -> str:
        args = ", ".join(map(show, self.args))
        return f"{self.shown}({args})" if self.shown else f'asl("{self.functor}"{", " if args else ""}{args})'


def asl(name: str, *args: object) -> AslCall:
    """Call an action of AgentSpeak programs in a rule, such as ``asl(".length", L, N)``.

    It is a step; an internal action, whose name has a dot, can be a condition, too. Variables without a value get the
    results; names in results are atoms.

    Args:
        name: The name of an internal action or of an action registered with `asl_action` or `Engine.add_action`.
        args: Its arguments.

    Raises:
        RuleError: There is no internal action of this name, or it takes another number of arguments.
    """
    from socialbot.bdi.stdlib import called  # it imports this module

    made = AslCall(*args)
    made.functor = name
    if "." in name:
        called(made)
    return made


def _on_goal(shown: str, name: str, goal: Goal | Variable | None) -> AslCall:
    if goal is not None and not isinstance(goal, (Goal, Structure, Variable)):
        raise RuleError(f"{goal!r} is not a goal", remedy=f"write {shown}(g()) with a Goal")
    made = asl(name, *(() if goal is None else (goal,)))
    made.shown = shown
    return made


def drop(goal: Goal | Variable) -> AslCall:
    """Drop the matching goals and the intentions that pursue them; unbound variables match anything."""
    return _on_goal("drop", ".drop_desire", goal)


def suspend(goal: Goal | Variable | None = None) -> AslCall:
    """Suspend the intentions that pursue a goal until `resume`; without a goal, the one of this plan."""
    return _on_goal("suspend", ".suspend", goal)


def resume(goal: Goal | Variable) -> AslCall:
    """Resume the suspended intentions that pursue a goal."""
    return _on_goal("resume", ".resume", goal)


class Step:
    """Base class of steps; ``line`` is the line in the AgentSpeak text, or 0."""

    line: int = 0

    def __repr__(self) -> str:
        return str(self)


@dataclass(eq=False, repr=False)
class Do(Step):
    """Action: an `Action`, a literal for a registered or internal one (``.print``), or a variable with such a value.

    The value of a variable may be a `PlanBody`, too. It fails (``timeout``) after ``limit_s`` seconds, if given.
    A condition as a step of AgentSpeak, such as ``a & b``, is an action that no agent has, as in Jason.
    """

    action: Literal | Variable | LiteralVariable | Condition
    limit_s: object = None

    def __str__(self) -> str:
        return f"{self.action!s}{_limit(self.limit_s)}"


@dataclass(eq=False, repr=False)
class Achieve(Step):
    """Goal, or a variable with a goal as its value; it fails (``timeout``) after ``limit_s`` seconds, if given.

    ``apart`` adopts it in a new intention (``!!g``) without waiting for it.
    """

    goal: Literal | Variable | LiteralVariable
    apart: bool = False
    limit_s: object = None

    def __str__(self) -> str:
        goal = f"{self.goal!s}{_limit(self.limit_s)}"
        return f"apart({goal})" if self.apart else goal


@dataclass(eq=False, repr=False)
class Ask(Step):
    """Test goal ``?q``, written ``ask(q)``: binds variables by beliefs, or else by a plan for ``+?q``.

    The event has the annotations ``marks``, which select inner plans.
    """

    query: Condition | Variable | LiteralVariable
    marks: tuple[Literal, ...] = ()

    def __str__(self) -> str:
        return f"ask({self.query!s})"


@dataclass(eq=False, repr=False)
class Update(Step):
    """Change of a belief with the source ``self``: ``+`` adds, ``-`` removes the first match, ``-+`` replaces.

    A plan for the event runs before the next step; after ``++`` and ``--`` it runs in a new intention. The event, but
    not the belief, has the annotations ``marks``, which select inner plans.
    """

    sign: str
    literal: Literal | Variable | LiteralVariable | Inference
    marks: tuple[Literal, ...] = ()

    def __str__(self) -> str:
        return f"{'+' if self.sign == '++' else self.sign}{self.literal!s}"


@dataclass(eq=False, repr=False)
class Forget(Step):
    """Removal of every matching belief, with all its sources, or of the sources in its annotations."""

    literal: Literal

    def __str__(self) -> str:
        return f"-{self.literal!s}"


@dataclass(eq=False, repr=False)
class Constrain(Step):
    """Comparison or unification that must hold, such as ``X = Y + 1``."""

    condition: Condition

    def __str__(self) -> str:
        text = written_condition(self.condition)
        return text if isinstance(self.condition, Comparison) and self.condition.binds() else f"test({text})"


@dataclass(eq=False, repr=False)
class Enter(Step):
    """Begin of a stage (see `stage`), written ``enter(name)``; plans of other stages no longer apply."""

    stage: str

    def __str__(self) -> str:
        return f"enter({show(self.stage)})"


@dataclass(eq=False, repr=False)
class Await(Step):
    """Pause until an event or a condition; fails (``timeout``) after ``limit_s``."""

    what: Event | Condition
    limit_s: object = None

    def __str__(self) -> str:
        limit = "" if self.limit_s is None else f", {show(self.limit_s)}"
        return f"wait_for({written_condition(self.what)}{limit})"


@dataclass(eq=False, repr=False)
class PlanBody(Quoted):
    """Steps as a term, ``{ a; b }`` in AgentSpeak; the ``bare`` ones that a plan pattern took are spelled ``a; b``."""

    steps: tuple[Step, ...] = ()
    bare: bool = False

    def __str__(self) -> str:
        return f"PlanBody({_list(self.steps)})"

    def as_structure(self) -> Literal | None:
        """Return the first step as a structure, such as ``achieve(g)`` for ``!g``; None for control structures."""
        match self.steps[:1]:
            case (Do(action),):
                return literal("internalAction" if getattr(action, "functor", "")[:1] == "." else "action", (action,))
            case (Achieve(goal, apart),):
                return literal("achieveNF" if apart else "achieve", (goal,))
            case (Ask(query),):
                return literal("test", (query,))
            case (Constrain(condition),):
                if isinstance(condition, Conjunction) and len(condition.terms) == 1:
                    condition = condition.terms[0]
                return literal("constraint", (condition,))
            case (Update(sign, what),) if sign in _UPDATES:
                return literal(_UPDATES[sign], (what,))
        return None


_UPDATES = {"+": "addBel", "-": "delBel", "-+": "delAddBel", "++": "addBelNewFocus", "--": "delBelNewFocus"}
"""Names of the structures of belief changes."""


class Nested(Step):
    """Step with nested bodies."""


@dataclass(eq=False, repr=False)
class If(Nested):
    """Conditional step: ``then`` if the condition holds, else ``otherwise``."""

    condition: Condition
    then: tuple[Step, ...]
    otherwise: tuple[Step, ...] = ()

    def __str__(self) -> str:
        otherwise = f", {_list(self.otherwise)}" if self.otherwise else ""
        return f"when({written_condition(self.condition)}, {_list(self.then)}{otherwise})"


@dataclass(eq=False, repr=False)
class _Loop(Nested):
    condition: Condition
    body: tuple[Step, ...]

    name: ClassVar[str]

    def __str__(self) -> str:
        return f"{self.name}({written_condition(self.condition)}, {_list(self.body)})"


class While(_Loop):
    """Loop over the body while the condition holds."""

    name = "as_long_as"


class For(_Loop):
    """Loop over the initial solutions of the condition."""

    name = "for_each"


@dataclass(eq=False, repr=False)
class Fork(Nested):
    """Parallel bodies; it ends when all of them (``every``), or the first one, have ended."""

    branches: tuple[tuple[Step, ...], ...]
    every: bool

    def __str__(self) -> str:
        return f"{'together' if self.every else 'first_of'}({', '.join(map(_list, self.branches))})"


@dataclass(eq=False, repr=False)
class Scoped(Nested):
    """Body of a plan with a goal condition, or with inner plans for beliefs.

    It ends when the condition ``until`` holds, or without one when the steps have ended. Meanwhile, inner plans handle
    the ``watched`` events, given by keys and shared arguments; ``mark`` is the annotation that they require.
    """

    body: tuple[Step, ...]
    mark: Literal
    watched: tuple[tuple[str, tuple[object, ...]], ...]
    until: Condition | None

    def __str__(self) -> str:
        return _list(self.body)


def when(condition: object, then: Iterable[object], otherwise: Iterable[object] = ()) -> If:
    """Conditional step `If`: ``when(X > 3, [speak("many")], [speak("few")])``."""
    return If(conjunction(condition), body_of(then), body_of(otherwise))


def as_long_as(condition: object, body: Iterable[object]) -> While:
    """Loop step `While`."""
    return While(conjunction(condition), body_of(body))


def for_each(condition: object, body: Iterable[object]) -> For:
    """Loop step `For`."""
    return For(conjunction(condition), body_of(body))


def together(*branches: Iterable[object]) -> Fork:
    """Execute bodies in parallel until all have ended; fail with the first failure."""
    return Fork(tuple(map(body_of, branches)), every=True)


def first_of(*branches: Iterable[object]) -> Fork:
    """Execute bodies in parallel until one has ended; drop the others."""
    return Fork(tuple(map(body_of, branches)), every=False)


def wait_for(what: object, limit_s: object = None) -> Await:
    """Pause until an event such as ``+b(X)``, or until a condition holds."""
    return Await(what if isinstance(what, Event) else conjunction(what), limit_s)


def test(condition: object) -> Constrain:
    """Condition as a step: it binds its variables, or fails the goal."""
    return Constrain(conjunction(condition))


def enter(stage: str) -> Enter:
    """Begin a stage (see `socialbot.bdi.stage`)."""
    if not isinstance(stage, str):
        raise RuleError(f"{stage!r} is not the name of a stage", remedy='write enter("night")')
    return Enter(stage)


def ask(query: object) -> Ask:
    """Query the beliefs, or else run a plan that answers: ``ask(at(X))``."""
    if isinstance(query, (Condition, Variable)):
        return Ask(query)
    if isinstance(query, Goal):
        raise RuleError(f"{query} is a goal", remedy=f"write {query} to achieve it; ask for a belief")
    return Ask(conjunction(query))


def apart(goal: Goal) -> Achieve:
    """Adopt a goal in a new intention, without waiting for it."""
    if not isinstance(goal, Goal):
        raise RuleError(f"{goal!r} is not a goal", remedy="write apart(g()); together([...], [...]) runs steps apart")
    return Achieve(goal, apart=True, limit_s=goal.limit_s)


def body_of(items: Iterable[object]) -> tuple[Step, ...]:
    """Convert a list of actions, goals, +beliefs and -beliefs to steps. Raises RuleError for other items."""
    if not isinstance(items, Iterable) or isinstance(items, (str, Literal)):
        raise RuleError(f"{items} is not a list of steps", remedy=f"write >> [{items}]")
    return tuple(map(step_of, items))


def step_of(item: object) -> Step:
    """Convert an item to a step. Raises RuleError for other items."""
    if isinstance(item, Step):
        return item
    if isinstance(item, Action):
        return Do(item, item.limit_s)
    if isinstance(item, AslCall):
        return Do(item)
    if isinstance(item, Goal):
        return Achieve(item, limit_s=item.limit_s)
    if isinstance(item, Event) and item.change in (Change.ADDED, Change.REMOVED):
        return Update("++", item.literal) if item.change is Change.ADDED else Forget(item.literal)
    if isinstance(item, (Belief, HeldFor)):
        raise RuleError(
            f"{item} is not a step of a plan",
            remedy="write +belief or -belief to change a belief, test(belief) to require it",
        )
    if isinstance(item, Comparison) and item.binds():
        return Constrain(item)
    if isinstance(item, Condition):
        raise RuleError(f"{item} is not a step of a plan", remedy=f"write test({item})")
    if isinstance(item, Event) and item.change is Change.FAILED:
        raise RuleError(f"{item} is not a step of a plan", remedy=f"write drop({item.literal}) to give up the goal")
    if callable(item) and not isinstance(item, type):
        raise RuleError(f"{item!r} is not a step of a plan", remedy="make an action of it with @action, and write it()")
    if isinstance(item, type) and issubclass(item, Literal):
        raise RuleError(f"{item.__name__} is a class, which is not a step of a plan", remedy=f"write {item.__name__}()")
    raise RuleError(f"{item!r} is not a step of a plan", remedy="use actions, goals, +belief and -belief")


def _limit(seconds: object) -> str:
    return "" if seconds is None else f".within({show(seconds)})"


def _list(body: tuple[Step, ...]) -> str:
    return f"[{', '.join(map(str, body))}]"
