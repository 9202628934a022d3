"""Literals for beliefs and goals, and the events that trigger plans."""

from __future__ import annotations

import copy
import enum
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from socialbot.bdi.terms import (
    NOTHING,
    Atom,
    Condition,
    Conjunction,
    Pattern,
    Term,
    Variable,
    conjunction,
    names_in,
    order,
    show,
)
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
    GOAL_STATE = "^!"
    QUESTION_STATE = "^?"


META = frozenset({Change.GOAL_STATE, Change.QUESTION_STATE})
"""Changes of the states of goals, the meta-events of AgentSpeak."""

SIGNS = {Change.WANTED: "", Change.FAILED: "-", Change.ASKED: "?", Change.UNANSWERED: "-?"}


@dataclass(eq=False, repr=False)
class Event(Pattern):
    """Change of a belief or goal: the head of a plan or, for beliefs, a step of its body.

    In AgentSpeak, ``literal`` may be a `Variable` or `LiteralVariable`: such a plan handles every event of its kind.
    ``reason`` is that of a change by a sensor (see `because`).
    """

    change: Change
    literal: Literal
    seconds: Seconds = 0.0
    reason: str = ""

    def because(self, reason: str) -> Event:
        """Return this change with the reason of a sensor, for explanations.

        >>> print((+Belief("near", "anna")).because("2.1 m away, within range_m 3.0").reason)
        2.1 m away, within range_m 3.0
        """
        return replace(self, reason=reason)

    @property
    def key(self) -> str:
        """Key of the trigger with the relevant plans, as in ``+!at/2``."""
        if self.change is Change.CHANGED:
            return f"{self.change.value}{self.literal.functor}/{len(self.literal.args) // 2}"
        if not isinstance(self.literal, Literal):
            return f"{self.change.value}*"
        return self.change.value + self.literal.key

    def __truediv__(self, condition: object) -> PlanHead:
        return PlanHead(self, conjunction(condition))

    def __rshift__(self, body: Iterable[object]) -> Plan:
        return PlanHead(self, NOTHING) >> body

    def __pos__(self) -> Event:
        raise RuleError(f"{self} is an event already", remedy="leave out the +")

    def __and__(self, other: object) -> Any:
        raise RuleError(
            f"{self} is an event, which cannot be joined with other parts",
            remedy="write event / (condition & condition) >> [...]; give each event a plan of its own",
        )

    __rand__ = __or__ = __ror__ = __and__

    def __str__(self) -> str:
        if self.change is Change.HELD:
            seconds = self.seconds if isinstance(self.seconds, (int, float)) else "..."
            return f"+{self.literal}.held_for({seconds})"
        if self.change is Change.CHANGED:
            half = len(self.literal.args) // 2
            now, before = self.literal.with_(args=self.literal.args[:half]), self.literal.args[half:]
            return f"{now}.changed({', '.join(map(show, before))})"
        return f"{SIGNS.get(self.change, self.change.value)}{self.literal!s}"


@dataclass(eq=False, repr=False)
class HeldFor(Pattern):
    """Belief with the minimum duration for which it is held; ``+`` makes an event of it."""

    belief: Belief
    seconds: Seconds

    def __pos__(self) -> Event:
        return Event(Change.HELD, self.belief, self.seconds)

    def __truediv__(self, condition: object) -> Any:
        raise RuleError(f"{self} alone is not an event", remedy=f"write +{self}")

    __rshift__ = __truediv__

    def __str__(self) -> str:
        return str(+self)[1:]


@dataclass(eq=False, repr=False)
class PlanHead:
    """Event with a condition: the left side of ``>> [steps]``."""

    event: Event
    condition: Conjunction

    def __rshift__(self, body: Iterable[object]) -> Plan:
        from socialbot.bdi.plans import Plan, origin_in_python
        from socialbot.bdi.steps import body_of

        return Plan(self.event, self.condition, body_of(body), origin=origin_in_python(__name__)).check()

    def __and__(self, other: object) -> None:
        raise RuleError(f"the condition of {self.event} is not in parentheses", remedy="write event / (a & b) >> [...]")


ANYTHING = Variable("_")

T = TypeVar("T", bound="Literal")

Seconds = float | Callable[[], float]
"""Duration, or a function that returns it at the start of the wait."""


ATOMIC = frozenset({str, int, float, bool, Atom, type(None)})
"""Classes of the values without parts."""


class _Key:
    """Descriptor that computes the key of a literal on first access and caches it."""

    def __get__(self, item: Literal | None, owner: type[Literal]) -> str:
        if item is None:
            return owner.__name__
        key = f"{'~' if item.negated else ''}{item.functor}/{len(item.args)}"
        item.key = key  # type: ignore[misc]  # not in `__dict__`, whose creation takes memory
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
        if not self.annotations and all(arg.__class__ in ATOMIC for arg in self.args):
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
            twin.annotations = distinct(annotations)
        return twin

    def __getitem__(self: T, annotations: object) -> T:
        added = annotations if isinstance(annotations, tuple) else (annotations,)
        for note in added:
            if not isinstance(note, (str, Atom, Literal, Term)):
                raise RuleError(
                    f"{note!r} is not an annotation of {self!s}",
                    remedy=f'write annotations as {self.functor}(...)[source("bob")]; arguments are in literal.args',
                )
        return self.with_(annotations=(*self.annotations, *map(symbol, added)))

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

    def __lt__(self, other: object) -> bool:
        return order(self) < order(other)

    def __gt__(self, other: object) -> bool:
        return order(self) > order(other)

    def __le__(self, other: object) -> bool:
        return order(self) <= order(other)

    def __ge__(self, other: object) -> bool:
        return order(self) >= order(other)

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
        made.annotations = distinct(annotations)
    if negated:
        made.negated = True
    return made


def literal_from_key(key: str, args: tuple[object, ...], annotations: tuple[object, ...] = ()) -> Structure:
    """Literal without a class, from a key such as ``~at/2``."""
    name = key.rpartition("/")[0]
    return literal(name.removeprefix("~"), args, annotations, negated=name.startswith("~"))


class _Kind(type):
    """Class of the classes of beliefs, goals and actions: refuses the class itself as a part of a rule."""

    def _refuse(cls, *_: object) -> Any:
        raise RuleError(f"{cls.__name__} is a class", remedy=f"write {cls.__name__}(), with its arguments")

    __pos__ = __neg__ = __invert__ = __rshift__ = __lshift__ = __truediv__ = __and__ = __rand__ = _refuse


class Belief(Literal, Condition, metaclass=_Kind):
    """Belief of the agent; several beliefs of one name can be held."""

    singleton: ClassVar[bool] = False

    def held_for(self, seconds: Seconds) -> HeldFor:
        """Event that this belief has been held continuously for ``seconds``."""
        if not callable(seconds):
            check_seconds(seconds, f"{self}.held_for")
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

        return Inference(self, conjunction(condition)).check()


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


class TimedLiteral(Literal, metaclass=_Kind):
    """Goal or action, with an optional time limit."""

    limit_s: object = None

    def within(self: T, seconds: object) -> T:
        """Copy of the goal or action that fails (``timeout``) if it has not ended after ``seconds``."""
        if not isinstance(seconds, Term):
            check_seconds(seconds, f"{self}.within")
        twin: Any = copy.copy(self)
        twin.limit_s = seconds
        return twin


class Goal(TimedLiteral):
    """Achievement goal: the head of a plan, or a step that pursues it at once."""

    def __pos__(self) -> Any:
        raise RuleError(
            f"+{self} is not written: goals have no +",
            remedy=f"write {self} >> [...] for its plan, {self} or apart({self}) as a step, engine.achieve({self})",
        )

    def __invert__(self) -> Any:
        raise RuleError(
            f"~{self} is not written: goals have no ~",
            remedy=f"write drop({self}) to give up the goal, test(~belief) to require that a belief is absent",
        )

    def __lshift__(self, condition: object) -> Any:
        raise RuleError(f"{self} is a goal, which follows from nothing", remedy=f"write {self} / condition >> [...]")

    def __neg__(self) -> Event:
        """Event of the failure of this goal."""
        return Event(Change.FAILED, self)

    def __truediv__(self, condition: object) -> PlanHead:
        return Event(Change.WANTED, self) / condition

    def __rshift__(self, body: Iterable[object]) -> Plan:
        return Event(Change.WANTED, self) >> body


def symbol(term: object) -> object:
    """Convert a string to the equally named atom; return other terms unchanged."""
    return Atom(str(term)) if isinstance(term, str) else term


class Symbolic(Literal):
    """Literal whose first ``symbols`` arguments are names, such as those of agents.

    Strings there become atoms, and in a rule in Python the variables there have a `Name` as value.
    """

    symbols: ClassVar[int] = 1

    def __init__(self, *args: object) -> None:
        for arg in args[: self.symbols]:
            if isinstance(arg, str):
                args = (*map(symbol, args[: self.symbols]), *args[self.symbols :])
                break
        self.args = args


class Annotation(Literal):
    """Annotation of a belief, goal or event, written in brackets, such as ``source(S)``."""


class source(Symbolic, Annotation):  # noqa: N801 - written as AgentSpeak writes it
    """Source of a belief or goal: ``self``, ``percept`` or the name of an agent."""


class KnownSource(source):
    """Source that all its beliefs share. Events read its key, which takes less time than for other literals."""

    __slots__ = ("key",)

    def __init__(self, name: Atom) -> None:
        super().__init__(name)
        self.key = "source/1"

    def with_(self, *, args: tuple[object, ...] | None = None, annotations: tuple[object, ...] | None = None) -> source:
        """Copy with other arguments or annotations, which is no longer this source."""
        return source(*self.args).with_(args=args, annotations=annotations)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if other.__class__ is KnownSource:  # there is another object only for a name that was forgotten meanwhile
            return self.args == other.args  # type: ignore[attr-defined]
        return super().__eq__(other)

    __hash__ = source.__hash__

    def __reduce__(self) -> tuple[Callable[[Any], KnownSource], tuple[object]]:
        return _known_source, (self.args[0],)


KnownSource.functor = source.functor


class error(Symbolic, Annotation):  # noqa: N801
    """Reason of a failure, such as ``timeout`` (see `socialbot.bdi.intentions`)."""


class error_msg(Annotation):  # noqa: N801
    """Message of a failure."""


SELF = (KnownSource(Atom("self")),)
PERCEPT = (KnownSource(Atom("percept")),)
"""Annotations of the agent's own conclusions and of percepts."""


OWN_SOURCES = frozenset({"self", "percept"})
"""Sources that stand for the agent and its percepts. No agent may have such a name: what it says would count as one."""

SOURCES: dict[object, tuple[Literal, ...]] = {
    name: notes for text, notes in (("self", SELF), ("percept", PERCEPT)) for name in (text, Atom(text))
}
"""Annotations of the sources that were needed before, by name."""

MOST_SOURCES = 10_000
"""Names that are kept; each message may come from another agent. Half of the oldest ones are then forgotten."""

known_notes = SOURCES.get
"""Annotations of a source that was needed before; a method of an imported name would take longer to call."""


def source_notes(name: object) -> tuple[Literal, ...]:
    """Annotations of a belief with a source: ``self``, ``percept`` or an agent; the same object while it is known.

    A name is a string or an atom; other terms are possible in AgentSpeak.
    """
    if not isinstance(name, (str, Atom)):
        return (source(name),)
    notes = SOURCES.get(name)
    if notes is None:
        # An equal string is the same source as the atom.
        atom = Atom(str(name))
        if len(SOURCES) >= MOST_SOURCES:
            for old in list(SOURCES)[len(OWN_SOURCES) * 2 : MOST_SOURCES // 2]:
                SOURCES.pop(old, None)
        notes = SOURCES.setdefault(atom, (KnownSource(atom),))
        SOURCES[name] = notes
    return notes


def _known_source(name: Atom) -> KnownSource:
    (note,) = source_notes(name)
    assert isinstance(note, KnownSource)
    return note


def distinct(notes: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return annotations without those that are equal to earlier ones; those with variables are kept."""
    if len(notes) < 2:
        return notes
    kept: list[Any] = []
    known: list[Any] = []
    for note in notes:
        if ground(note):
            if note in known:
                continue
            known.append(note)
        kept.append(note)
    return notes if len(kept) == len(notes) else tuple(kept)


def is_source(note: object) -> bool:
    """Whether an annotation is ``source(S)``."""
    return isinstance(note, Literal) and note.functor == "source" and len(note.args) == 1


def check_seconds(seconds: object, what: str) -> None:
    """Check a duration. Raises RuleError unless it is a number, 0 or more."""
    if not isinstance(seconds, (int, float)) or isinstance(seconds, bool) or not seconds >= 0:
        shown = show(seconds)
        raise RuleError(f"{what}({shown}) is not a duration", remedy="give a number of seconds, 0 or more")


def ground(term: object) -> bool:
    """Whether a term has no variables."""
    if isinstance(term, tuple):
        return all(map(ground, term))
    if isinstance(term, Literal):
        return ground(term.args) and (not term.annotations or ground(term.annotations))
    return not isinstance(term, Pattern)
