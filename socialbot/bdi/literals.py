"""Literals for beliefs and goals, and the events that trigger plans."""

from __future__ import annotations

import copy
import enum
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from socialbot.bdi.terms import NOTHING, Atom, Condition, Conjunction, Pattern, Variable, conjunction, names_in, show
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.plans import Inference, Plan


class Change(enum.Enum):
    """Kind of a change of a belief or goal; the values are AgentSpeak's signs."""

    ADDED = "+"
    REMOVED = "-"
    HELD = "held "
    CHANGED = "changed "
    WANTED = "+!"
    FAILED = "-!"
    ASKED = "+?"
    UNANSWERED = "-?"


SIGNS = {Change.WANTED: "", Change.FAILED: "-", Change.ASKED: "?", Change.UNANSWERED: "-?"}


@dataclass(eq=False, repr=False)
class Event(Pattern):
    """Change of a belief or goal: the head of a plan or, for beliefs, a step of its body."""

    change: Change
    literal: Literal
    seconds: Seconds = 0.0

    @property
    def key(self) -> str:
        """Key of the trigger with the relevant plans, as in ``+!at/2``."""
        if self.change is Change.CHANGED:
            return f"{self.change.value}{self.literal.functor}/{len(self.literal.args) // 2}"
        return self.change.value + self.literal.key

    def __truediv__(self, condition: object) -> PlanHead:
        return PlanHead(self, conjunction(condition))

    def __rshift__(self, body: Iterable[object]) -> Plan:
        return PlanHead(self, NOTHING) >> body

    def __str__(self) -> str:
        if self.change is Change.HELD:
            seconds = self.seconds if isinstance(self.seconds, (int, float)) else "..."
            return f"+{self.literal}.held_for({seconds})"
        if self.change is Change.CHANGED:
            half = len(self.literal.args) // 2
            now, before = self.literal.with_(args=self.literal.args[:half]), self.literal.args[half:]
            return f"{now}.changed({', '.join(map(show, before))})"
        return f"{SIGNS.get(self.change, self.change.value)}{self.literal}"


@dataclass(eq=False, repr=False)
class HeldFor(Pattern):
    """Belief with the minimum duration for which it is held; ``+`` makes an event of it."""

    belief: Belief
    seconds: Seconds

    def __pos__(self) -> Event:
        return Event(Change.HELD, self.belief, self.seconds)

    def __str__(self) -> str:
        return str(+self)[1:]


@dataclass(eq=False, repr=False)
class PlanHead:
    """Event with a condition: the left side of ``>> [steps]``."""

    event: Event
    condition: Conjunction

    def __rshift__(self, body: Iterable[object]) -> Plan:
        from socialbot.bdi.plans import Plan
        from socialbot.bdi.steps import body_of

        return Plan(self.event, self.condition, body_of(body)).check()

    def __and__(self, other: object) -> None:
        raise RuleError(f"the condition of {self.event} is not in parentheses", remedy="write event / (a & b) >> [...]")


ANYTHING = Variable("_")

T = TypeVar("T", bound="Literal")

Seconds = float | Callable[[], float]
"""Duration, or a function that returns it at the start of the wait."""


_PLAIN = frozenset({str, int, float, bool, Atom, type(None)})


class _Key:
    """Descriptor that computes the key of a literal on first access and caches it."""

    def __get__(self, item: Literal | None, owner: type[Literal]) -> str:
        if item is None:
            return owner.__name__
        key = f"{'~' if item.negated else ''}{item.functor}/{len(item.args)}"
        item.__dict__["key"] = key
        return key


class Literal(Pattern):
    """Name (functor) with arguments and annotations; ``negated`` is the strong negation of AgentSpeak."""

    functor: str = "literal"
    annotations: tuple[object, ...] = ()
    negated = False

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        cls.functor = cls.__name__

    def __init__(self, *args: object) -> None:
        self.args = args

    key = _Key()
    """Name and number of arguments, as in ``at/2``; only literals with the same key can match."""

    posted: Any = None
    """Inbox item cached by an engine."""

    def check(self) -> None:
        """Raise RuleError for variables or mutable values."""
        if not self.annotations and all(arg.__class__ in _PLAIN for arg in self.args):
            return
        if not ground(self.args) or not ground(self.annotations):
            raise RuleError(f"{self} has a variable", remedy="give values only")
        try:
            hash(self.args)
        except TypeError as problem:
            raise RuleError(f"{self}: {problem}", remedy="give immutable values") from problem

    def names(self) -> set[str]:
        """Names of the variables in the arguments and annotations."""
        return names_in(self.args) | names_in(self.annotations) if self.annotations else names_in(self.args)

    def with_(self: T, *, args: tuple[object, ...] | None = None, annotations: tuple[object, ...] | None = None) -> T:
        """Copy with other arguments or annotations."""
        twin = copy.copy(self)
        twin.posted = None
        if args is not None:
            twin.args = args
            twin.__dict__.pop("key", None)
        if annotations is not None:
            twin.annotations = annotations
        return twin

    def __getitem__(self: T, annotations: object) -> T:
        added = annotations if isinstance(annotations, tuple) else (annotations,)
        return self.with_(annotations=(*self.annotations, *added))

    __iter__ = None  # else __getitem__ would make it an endless iterable

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Literal)
            and self.functor == other.functor
            and self.args == other.args
            and self.negated == other.negated
            and self.annotations == other.annotations
        )

    def __hash__(self) -> int:
        return hash((self.functor, self.args))

    def __str__(self) -> str:
        name = f"{'~' if self.negated else ''}{self.functor}"
        notes = f"[{', '.join(map(show, self.annotations))}]" if self.annotations else ""
        return f"{name}({', '.join(map(show, self.args))}){notes}"


def literal(
    functor: str, args: tuple[object, ...] = (), annotations: tuple[object, ...] = (), *, negated: bool = False
) -> Structure:
    """Literal without a class, as in AgentSpeak."""
    made = Structure(*args)
    made.functor = functor
    if annotations:
        made.annotations = annotations
    if negated:
        made.negated = True
    return made


def literal_from_key(key: str, args: tuple[object, ...], annotations: tuple[object, ...] = ()) -> Structure:
    """Literal without a class, from a key such as ``~at/2``."""
    name = key.rpartition("/")[0]
    return literal(name.removeprefix("~"), args, annotations, negated=name.startswith("~"))


class Belief(Literal, Condition):
    """Belief of the agent; several beliefs of one name can be held."""

    singleton: ClassVar[bool] = False

    def held_for(self, seconds: Seconds) -> HeldFor:
        """Event that this belief has been held continuously for ``seconds``."""
        return HeldFor(self, seconds)

    def changed(self, *before: object) -> Event:
        """Event that this belief replaced another one of its name, with the arguments ``before``."""
        if len(before) != len(self.args) or not before:
            raise RuleError(
                f"changed() of {self} needs {len(self.args)} arguments",
                remedy="give the arguments of the replaced belief",
            )
        return Event(Change.CHANGED, self.with_(args=(*self.args, *before)))

    def __pos__(self) -> Event:
        return Event(Change.ADDED, self)

    def __neg__(self) -> Event:
        return Event(Change.REMOVED, self)

    def __lshift__(self, condition: object) -> Inference:
        """Inference ``near(X) << (at(X, D) & (D < 2))``: the belief follows from the condition."""
        from socialbot.bdi.plans import Inference

        return Inference(self, conjunction(condition))


class Structure(Belief):
    """Literal without a class of its own: from AgentSpeak, a message or a saved mind."""

    def __str__(self) -> str:
        text = super().__str__()
        return text if self.args else text.replace("()", "", 1)


class SingletonBelief(Belief):
    """Belief that replaces any other belief of its name."""

    singleton = True


class Reactor(Belief):
    """Event-only belief: it triggers the plans for ``+r``, but is never held."""


class Computed(Belief):
    """Belief that is computed by queries and never held: override `solutions`."""

    def solutions(self, *args: Any, **kwargs: Any) -> bool | Iterable[tuple[object, ...]]:
        """Whether the belief holds for ``args``, or all tuples of arguments for which it holds.

        ``ANYTHING`` marks an unknown argument.
        """
        raise RuleError(f"{self.functor} has no solutions()", remedy="override solutions()")


class TimedLiteral(Literal):
    """Goal or action, with an optional time limit."""

    limit_s: object = None

    def within(self: T, seconds: object) -> T:
        """Copy of the goal or action that fails (``timeout``) if it has not ended after ``seconds``."""
        twin: Any = copy.copy(self)
        twin.limit_s = seconds
        return twin


class Goal(TimedLiteral):
    """Achievement goal: the head of a plan, or a step that pursues it at once."""

    def __neg__(self) -> Event:
        """Event of the failure of this goal."""
        return Event(Change.FAILED, self)

    def __truediv__(self, condition: object) -> PlanHead:
        return Event(Change.WANTED, self) / condition

    def __rshift__(self, body: Iterable[object]) -> Plan:
        return Event(Change.WANTED, self) >> body


class Annotation(Literal):
    """Annotation of a belief, goal or event, written in brackets, such as ``source(S)``."""


class source(Annotation):  # noqa: N801 - written as AgentSpeak writes it
    """Source of a belief or goal: ``self``, ``percept`` or the name of an agent."""


class error(Annotation):  # noqa: N801
    """Reason of a failure, as an `Atom` (see `socialbot.bdi.intentions`)."""


class error_msg(Annotation):  # noqa: N801
    """Message of a failure."""


SELF = (source(Atom("self")),)
PERCEPT = (source(Atom("percept")),)
"""Annotations of the agent's own conclusions and of percepts."""


def source_notes(name: str) -> tuple[Literal, ...]:
    """Annotations of a belief with a source: ``self``, ``percept`` or the name of an agent."""
    return PERCEPT if name == "percept" else SELF if name == "self" else (source(Atom(name)),)


def ground(term: object) -> bool:
    """Whether a term has no variables."""
    if isinstance(term, tuple):
        return all(map(ground, term))
    if isinstance(term, Literal):
        return ground(term.args) and (not term.annotations or ground(term.annotations))
    return not isinstance(term, Pattern)
