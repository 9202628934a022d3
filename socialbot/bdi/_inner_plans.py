"""Plans in plans and goal conditions: ``+!g : c <: until <- body. { inner plans }``.

An inner plan knows the variables of the trigger and the context of the plan around it. For a goal or a belief change of
that plan's body, the inner plans come before all others. For events from elsewhere they run beside the body.

`flattened` makes plans without inner ones. An inner plan then requires a mark: an annotation with the values of the
variables of the plan around it. The goals and belief changes in the body have this annotation.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from socialbot.bdi.intentions import DONE, EVENT, ConditionPause, Failed, ForkPause, Intention, Pause
from socialbot.bdi.literals import ATOMIC, Change, Literal, literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Achieve, Ask, For, Fork, If, Scoped, Step, Update, While
from socialbot.bdi.terms import Variable
from socialbot.bdi.unification import Var, resolve
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.intentions import Body, Failure

_KINDS = {
    Change.WANTED: "!", Change.FAILED: "!", Change.ASKED: "?", Change.UNANSWERED: "?", Change.ADDED: "+",
    Change.REMOVED: "-",
}  # fmt: skip
"""Kinds of events of inner plans."""


# Before the plan runs


def is_nested(plan: Plan) -> bool:
    """Check whether a plan has inner plans or a goal condition."""
    return bool(plan.inner) or plan.until is not None


SCOPE = "scope__"
"""Beginning of the names of marks."""


def is_mark(note: object) -> bool:
    """Check whether an annotation is the mark of an inner plan."""
    return isinstance(note, Literal) and note.functor.startswith(SCOPE)


def flattened(plan: Plan, names: Iterator[str]) -> list[Plan]:
    """Return a plan and its inner plans without inner ones.

    Args:
        plan: Plan with inner plans or a goal condition.
        names: New names of marks.

    Returns:
        The plan itself, then the inner ones. Of several for an event, the last one is to be tried first.

    Raises:
        RuleError: The event of an inner plan is of another kind than goals, questions and beliefs.
    """
    found = sorted(_flattened(plan, (), names, False), key=lambda item: item[0])
    return [each for _, each in found]


def parts(plan: Plan) -> list[Plan]:
    """Return a plan, and its inner plans without inner ones, for checks."""
    return flattened(plan, (f"{SCOPE}{number}" for number in itertools.count(1))) if is_nested(plan) else [plan]


@dataclass(frozen=True)
class _Around:
    """Plan around others: its mark, and the kinds and keys of the events of its inner plans."""

    mark: Literal
    events: frozenset[str]


def _flattened(
    plan: Plan, around: tuple[_Around, ...], names: Iterator[str], stepwise: bool
) -> Iterator[tuple[int, Plan]]:
    depth = len(around)
    stepwise = stepwise or plan.until is not None
    inner: tuple[Plan, ...] = ()
    watched: tuple[tuple[str, tuple[object, ...]], ...] = ()
    known = sorted((plan.event.literal.names() | plan.condition.names()) - {"_"})
    mark = literal(next(names), tuple(map(Variable, known)))
    if plan.inner:
        heads: dict[str, list[tuple[object, ...]]] = {}
        for each in plan.inner:
            heads.setdefault(_kind(each) + each.event.literal.key, []).append(each.event.literal.args)
        watched = tuple((key, _common(heads[key], set(known))) for key in sorted(heads) if key[0] in "+-")
        around = (_Around(mark, frozenset(heads)), *around)
        inner = tuple(_marked_trigger(each, mark) for each in plan.inner)
    body = tuple(_marked(step, around) for step in plan.body)
    if watched or plan.until is not None:
        body = (Scoped(body, mark, watched, plan.until),)
    yield depth, replace(plan, body=body, inner=(), until=None, stepwise=stepwise)
    for each in reversed(inner):
        yield from _flattened(each, around, names, stepwise)


def _common(heads: list[tuple[object, ...]], known: set[str]) -> tuple[object, ...]:
    """Return the arguments that several events share: constants and ``known`` variables, elsewhere ``_``."""
    found: list[object] = []
    for first, *others in zip(*heads, strict=True):
        given = first.name in known if isinstance(first, Variable) else first.__class__ in ATOMIC
        same = given and all(str(other) == str(first) and type(other) is type(first) for other in others)
        found.append(first if same else Variable("_"))
    return tuple(found)


def _kind(plan: Plan) -> str:
    kind = _KINDS.get(plan.event.change)
    if kind is None or not isinstance(plan.event.literal, Literal):
        raise RuleError(
            f"a plan within a plan is for one goal, question or belief, not for {plan.event}",
            where=plan.place,
            remedy="write the plan after the outer one",
        )
    return kind


def _marked_trigger(plan: Plan, mark: Literal) -> Plan:
    head: Any = plan.event.literal
    event = replace(plan.event, literal=head.with_(annotations=(*head.annotations, mark)))
    return replace(plan, event=event)


def _marked(step: Step, around: tuple[_Around, ...]) -> Step:
    """Copy of a step with the marks of the plans around it that have inner plans for its event."""

    def marks(event: str) -> tuple[Literal, ...]:
        return tuple(each.mark for each in around if event in each.events)

    def inside(body: tuple[Step, ...]) -> tuple[Step, ...]:
        return tuple(_marked(each, around) for each in body)

    twin: Any = copy.copy(step)
    match step:
        case Achieve(goal=Literal() as goal):
            twin.goal = goal.with_(annotations=(*goal.annotations, *marks("!" + goal.key)))
        case Ask(query=Literal() as query):
            twin.marks = marks("?" + query.key)
        case Update(sign=sign, literal=Literal() as changed) if sign not in ("++", "--"):
            twin.marks = marks(sign[-1] + changed.key)
        case If():
            twin.then, twin.otherwise = inside(step.then), inside(step.otherwise)
        case While() | For():
            twin.body = inside(step.body)
        case Fork():
            twin.branches = tuple(map(inside, step.branches))
    return twin


# While the plan runs


class ScopePause(ForkPause):
    """Pause of a plan until its body, or its goal condition, has ended; inner plans for events run meanwhile.

    Args:
        body: The steps of the plan.
        cause: Trace record of the plan.
        mark: Annotation that the inner plans require.
        watched: Keys of the events with inner plans, each with the arguments that all of these share.
        until: Pause until the goal condition holds; None without one.
    """

    def __init__(
        self,
        body: Body,
        cause: Any,
        mark: Literal,
        watched: tuple[tuple[str, tuple[Any, ...]], ...],
        until: ConditionPause | None,
    ) -> None:
        super().__init__((body,), cause, every=False)
        self.mark = mark
        self.until = until
        self._watchers = [_Watcher(self, key, args) for key, args in watched]

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        super().begin(interpreter, intention)
        self.branches[0].stepwise = self.until is not None
        waits = interpreter.intentions.waits
        for watcher in self._watchers:
            waits.await_event(watcher)  # type: ignore[arg-type]
        if self.until is not None:
            self.until.intention = intention
            self.until.end = self.finish  # type: ignore[method-assign]
            waits.await_condition(self.until)

    def finish(self, problem: Exception | None = None) -> None:
        """End the plan and all its inner plans: achieved, or failed with ``problem``."""
        if self.intention is not None:
            self._forget()
            self._drop(lambda: self.end(problem))

    def cancel(self, then: Any) -> None:
        self._forget()
        super().cancel(then)

    def _forget(self) -> None:
        waits = self.interpreter.intentions.waits
        for watcher in self._watchers:
            waits.forget_event(watcher)  # type: ignore[arg-type]
        if self.until is not None:
            waits.forget_condition(self.until)

    def _ended(self, branch: Intention, failure: Failure | None) -> None:
        self.branches.remove(branch)
        if self.intention is None:
            return
        if failure is not None:
            self.finish(Failed(failure.reason, failure.message, failure.more))
        elif self.until is None:
            self._forget()
            for inner in self.branches:
                inner.ended = None  # inner plans that still run continue: only a goal condition ends them
            self.branches.clear()
            self.end()

    def is_within_another(self, key: str, args: tuple[Any, ...]) -> bool:
        """Whether a plan further outside in the same intention has inner plans for an event, too."""
        around = None if self.intention is None else self.intention.parent
        while around is not None:
            if isinstance(around.pause, ScopePause) and any(each.awaits(key, args) for each in around.pause._watchers):
                return True
            around = around.parent
        return False

    def react(self, key: str, args: tuple[Any, ...], notes: tuple[Any, ...]) -> bool:
        """Run the first applicable inner plan for an event, the innermost first; return whether there is one."""
        if any(inner.react(key, args, notes) for branch in list(self.branches) for inner in _scopes_in(branch)):
            return True
        if all(each.key != key for each in self._watchers):
            return False
        interpreter = self.interpreter
        trigger = interpreter.triggers[key]
        notes = (*notes, self.mark)
        for plan in trigger.candidates(args):
            head: Any = plan.plan.event.literal
            if all(getattr(note, "functor", "") != self.mark.functor for note in head.annotations):
                continue
            try:
                result = plan.run(interpreter, args, notes, self.cause)
            except Exception as problem:  # noqa: BLE001 - a condition is user code
                interpreter.trace.record_failure(str(plan.plan), self.cause, problem)
                continue
            if result is DONE:
                return True
            if result is not None:
                request = (EVENT, trigger, args, notes, self.cause)
                interpreter.intentions.intend(request, plan, result, began=self._began)
                return True
        return False

    def _began(self, inner: Intention) -> None:
        self.branches.append(inner)
        inner.parent = self.intention
        inner.stepwise = self.until is not None
        inner.ended = lambda _: self.branches.remove(inner) if inner in self.branches else None

    def __str__(self) -> str:
        return "runs its steps and inner plans"


def _scopes_in(branch: Intention) -> Iterator[ScopePause]:
    """Yield the outermost plans with inner plans in a branch."""
    if isinstance(branch.pause, ScopePause):
        yield branch.pause
    elif isinstance(branch.pause, ForkPause):
        for inner in branch.pause.branches:
            yield from _scopes_in(inner)


class _Watcher(Pause):
    """Waiter for the events of inner plans; it remains, and starts them.

    Its ``notes`` are those of no event, so that it is asked for each event (`matches`).
    """

    number = 0
    place: Any = None
    outside = True
    """Only events from elsewhere matter: the body of the plan chooses its inner plans itself."""

    def __init__(self, scope: ScopePause, key: str, args: tuple[Any, ...]) -> None:
        self.scope = scope
        self.key = key
        self.args = tuple(arg if arg.__class__ in ATOMIC else Var() for arg in resolve(args))
        self.notes = (scope.mark,)

    def awaits(self, key: str, args: tuple[Any, ...]) -> bool:
        """Check whether inner plans may match an event."""
        return key == self.key and all(
            mine.__class__ is Var or mine == other for mine, other in zip(self.args, args, strict=True)
        )

    def matches(self, args: tuple[Any, ...], notes: tuple[Any, ...]) -> bool:
        if not self.scope.is_within_another(self.key, args):
            self.scope.react(self.key, args, notes)
        return False
