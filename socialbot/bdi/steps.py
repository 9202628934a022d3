"""Speech acts: what agents say to each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from socialbot.bdi.actions import Action
from socialbot.bdi.literals import Belief, Change, Event, Goal, HeldFor, Literal, Reactor
from socialbot.bdi.terms import Condition, Conjunction, Variable, conjunction, show
from socialbot.core.errors import RuleError


class send(Action):  # noqa: N801 - reads as a step of a plan
    """Says something to another agent: ``send(to, belief)`` tells it, ``send(to, goal, "achieve")`` asks for it.

    The third argument is the performative (see `socialbot.bdi.messaging.PERFORMATIVES`).
    """

    def execute(self, receiver: Any, content: Any, performative: str = "tell") -> Any:
        """Sends the message; it has this action as its cause."""
        return self.engine.messaging.send(receiver, performative, content, self.id)


class message(Reactor):  # noqa: N801 - written like a belief
    """``+message(Sender, Performative, Content)``: the event that something was said to the agent, whatever follows."""


class Step:
    """The base of steps."""

    def __repr__(self) -> str:
        return str(self)


@dataclass(eq=False, repr=False)
class Do(Step):
    """An action: an `Action`, or a literal that names a registered or (``.print``) an internal one.

    With a limit it fails (``timeout``) when it has not ended in so many seconds.
    """

    action: Literal
    limit_s: object = None

    def __str__(self) -> str:
        return f"{self.action}{_limit(self.limit_s)}"


@dataclass(eq=False, repr=False)
class Achieve(Step):
    """A goal, or a variable that stands for one.

    ``apart`` adopts it in an intention of its own (``!!g``) and does not wait. With a limit it fails (``timeout``)
    when it is not achieved in so many seconds.
    """

    goal: Literal | Variable
    apart: bool = False
    limit_s: object = None

    def __str__(self) -> str:
        goal = f"{self.goal}{_limit(self.limit_s)}"
        return f"apart({goal})" if self.apart else goal


@dataclass(eq=False, repr=False)
class Ask(Step):
    """``?q``: binds variables from what is believed, or else by a plan for ``+?q``."""

    query: Condition | Variable

    def __str__(self) -> str:
        return f"ask({self.query})"


@dataclass(eq=False, repr=False)
class Update(Step):
    """A change of what the agent itself concluded, as in Jason: ``+`` adds, ``-`` removes the first match, ``-+`` does
    both. A plan for the event is carried out before the next step; after ``++`` and ``--`` in an intention of its own.
    """

    sign: str
    literal: Literal | Variable

    def __str__(self) -> str:
        return f"{'+' if self.sign == '++' else self.sign}{self.literal}"


@dataclass(eq=False, repr=False)
class Forget(Step):
    """Removes every belief that matches, whoever said it."""

    literal: Literal

    def __str__(self) -> str:
        return f"-{self.literal}"


@dataclass(eq=False, repr=False)
class Constrain(Step):
    """A comparison or unification that has to hold, as ``X = Y + 1``."""

    condition: Condition

    def __str__(self) -> str:
        return str(self.condition)


@dataclass(eq=False, repr=False)
class Enter(Step):
    """Enters a stage: plans of other stages are no longer chosen."""

    stage: str

    def __str__(self) -> str:
        return f"enter({show(self.stage)})"


@dataclass(eq=False, repr=False)
class Await(Step):
    """Rests until an event comes or a condition holds; fails (``timeout``) after ``limit_s``."""

    what: Event | Condition
    limit_s: object = None

    def __str__(self) -> str:
        limit = "" if self.limit_s is None else f", {show(self.limit_s)}"
        return f"wait_for({self.what}{limit})"


class Nested(Step):
    """A step that has bodies in it."""


@dataclass(eq=False, repr=False)
class If(Nested):
    """Does ``then`` when the condition holds, else ``otherwise``."""

    condition: Condition
    then: tuple[Step, ...]
    otherwise: tuple[Step, ...] = ()

    def __str__(self) -> str:
        otherwise = f", {_list(self.otherwise)}" if self.otherwise else ""
        return f"If({self.condition}, {_list(self.then)}{otherwise})"


@dataclass(eq=False, repr=False)
class While(Nested):
    """Does the body again and again as long as the condition holds."""

    condition: Condition
    body: tuple[Step, ...]

    def __str__(self) -> str:
        return f"While({self.condition}, {_list(self.body)})"


@dataclass(eq=False, repr=False)
class For(Nested):
    """Does the body for every solution that the condition has at the beginning."""

    condition: Condition
    body: tuple[Step, ...]

    def __str__(self) -> str:
        return f"For({self.condition}, {_list(self.body)})"


@dataclass(eq=False, repr=False)
class Fork(Nested):
    """Does several bodies side by side and goes on when all have ended (``every``), or the first one has."""

    branches: tuple[tuple[Step, ...], ...]
    every: bool

    def __str__(self) -> str:
        return f"{'together' if self.every else 'first_of'}({', '.join(map(_list, self.branches))})"


def when(condition: object, then: Iterable[object], otherwise: Iterable[object] = ()) -> If:
    """The step ``If``: ``when(X > 3, [speak("many")], [speak("few")])``."""
    return If(conjunction(condition), body_of(then), body_of(otherwise))


def as_long_as(condition: object, body: Iterable[object]) -> While:
    """The step ``While``."""
    return While(conjunction(condition), body_of(body))


def for_each(condition: object, body: Iterable[object]) -> For:
    """The step ``For``."""
    return For(conjunction(condition), body_of(body))


def together(*branches: Iterable[object]) -> Fork:
    """Does several bodies side by side, until all have ended; fails when one does."""
    return Fork(tuple(map(body_of, branches)), every=True)


def first_of(*branches: Iterable[object]) -> Fork:
    """Does several bodies side by side, until one has ended; the others are dropped."""
    return Fork(tuple(map(body_of, branches)), every=False)


def wait_for(what: object, limit_s: object = None) -> Await:
    """Rests until an event such as ``+b(X)``, or a condition, comes true."""
    return Await(what if isinstance(what, Event) else conjunction(what), limit_s)


def enter(stage: str) -> Enter:
    """Enters a stage (see `stage`)."""
    return Enter(stage)


def test(condition: object) -> Constrain:
    """A condition as a step; the goal fails when it does not hold. Its variables have values afterwards."""
    return Constrain(conjunction(condition))


def ask(query: Condition) -> Ask:
    """Binds variables from what is believed; when nothing matches, a plan for the question is tried."""
    return Ask(query)


def apart(goal: Goal) -> Achieve:
    """Adopts a goal in an intention of its own, without waiting for it."""
    return Achieve(goal, apart=True, limit_s=goal.limit_s)


def body_of(items: Iterable[object]) -> tuple[Step, ...]:
    """The steps that a list of actions, goals, +beliefs and -beliefs stands for. Raises RuleError for anything else."""
    if not isinstance(items, Iterable) or isinstance(items, (str, Literal)):
        raise RuleError(f"{items} is no list of steps", remedy=f"write >> [{items}]")
    return tuple(map(step_of, items))


def step_of(item: object) -> Step:
    """One step. Raises RuleError for what is none."""
    if isinstance(item, Step):
        return item
    if isinstance(item, Action):
        return Do(item, item.limit_s)
    if isinstance(item, Goal):
        return Achieve(item, limit_s=item.limit_s)
    if isinstance(item, Event) and item.change in (Change.ADDED, Change.REMOVED):
        return Update("++", item.literal) if item.change is Change.ADDED else Forget(item.literal)
    if isinstance(item, (Belief, HeldFor, Conjunction)):
        raise RuleError(f"{item} is no step of a plan", remedy="write +belief or -belief to change what is believed")
    if isinstance(item, type) and issubclass(item, (Action, Goal)):
        raise RuleError(f"{item.__name__} is a class", remedy=f"write {item.__name__}()")
    raise RuleError(f"{item!r} is no step of a plan", remedy="use actions, goals, +belief and -belief")


def _limit(seconds: object) -> str:
    return "" if seconds is None else f".within({show(seconds)})"


def _list(body: tuple[Step, ...]) -> str:
    return f"[{', '.join(map(str, body))}]"
