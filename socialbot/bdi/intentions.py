"""Intentions as stacks of plans, the reasons for pauses, and the failures of goals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import Annotation, Goal, Literal, error, error_msg, literal_from_key
from socialbot.bdi.steps import PlanFailed
from socialbot.bdi.terms import Atom, Variable
from socialbot.bdi.unification import Trail, Var, annotations_match, closed, free, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._explain import GoalLevel
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.belief_base import HeldBelief
    from socialbot.bdi.library import CompiledPlan, Trigger
    from socialbot.bdi.plans import Origin

SUBGOAL, TAIL, EVENT, OPEN = 0, 1, 2, 4
"""Kinds of requests: goal, goal as last step, internal event; the flag ``OPEN`` marks unbound variables.

If each argument is either a value or an unbound variable, the bits from `MODE` on tell which are variables, the first
argument in the lowest one.
"""

MODE = 3
"""Number of the lowest bit of a mode."""

DONE = object()
"""Result of a plan without remaining steps."""

KEPT: Any = object()
"""Plan of a frame that only keeps a goal: one with a time limit or, with the flag `EVENT`, one that failed."""

GENERATED_FILE = "<plan>"
"""Prefix of the file names of generated code; tracebacks omit the lines of files ending with ``>``."""

END, NEXT = object(), object()
"""Result of a body without remaining steps, and of a step that was not executed yet."""

GENERATOR = type(_ for _ in ())
"""Class of the bodies of plans."""

REASONS = {
    "action_failed": "the action failed",
    "exception": "an action raised an exception",
    "no_relevant": "no plan for the goal",
    "no_applicable": "no plan whose condition holds",
    "test_goal_failed": "no belief answers the question",
    "constraint_failed": "a comparison or unification does not hold",
    "ia_failed": "an internal action failed",
    "wrong_arguments": "wrong number or kind of arguments of an internal action",
    "no_value": "a variable has no value",
    "timeout": "the time limit has passed",
    "deadline_reached": "the deadline has passed",
    "wait_timeout": "the event did not occur, or the condition did not hold, in time",
    "ask_failed": "the answer to a question does not match",
    "receiver_not_found": "there is no agent of this name",
    "cancelled": "the goal was dropped",
}
"""Reasons of failures: ``-g[error(E), error_msg(M)]`` binds E to a key, as an atom, and M to a sentence."""


_MESSAGES = {
    "no_relevant": "Found a goal for which there is no relevant plan: +!{}",
    "no_applicable": "Found a goal for which there is no applicable plan: +!{}",
    "test_goal_failed": "Failed to test '{}'",
}


class code(Annotation):  # noqa: N801 - written as AgentSpeak writes it
    """Step that failed: a term in AgentSpeak, otherwise its text."""


class code_src(Annotation):  # noqa: N801
    """File of the step that failed, such as ``file:robot.asl``."""


class code_line(Annotation):  # noqa: N801
    """Line of the step that failed."""


class Failed(PlanFailed):
    """Failure with a reason, one of `REASONS`, and annotations for the failure event."""

    def __init__(self, reason: str, message: str = "", annotations: tuple[Any, ...] = ()) -> None:
        super().__init__(message or REASONS.get(reason, reason))
        self.reason = reason
        self.annotations = annotations


@dataclass(slots=True)
class Failure:
    """Failure of a goal: reason, message, failed step, trace record, and place in the text of the plan."""

    reason: str
    message: str
    step: str
    cause: Any
    more: tuple[Any, ...] = ()
    where: Origin | None = None
    term: Callable[[], Any] | None = None
    """Returns the failed step of a plan in AgentSpeak as a term, or None if it is none."""
    raised_at: str = ""
    """File and line of the user's code that raised an exception."""

    @property
    def annotations(self) -> tuple[Any, ...]:
        term = None if self.term is None else self.term()
        step = self.step if term is None else term
        message = self.message if term is None else self._told_of(term)
        given: tuple[Any, ...] = (error(Atom(self.reason)), error_msg(message), code(step))
        if self.where is not None:
            given += (code_src(f"file:{self.where.file}"), code_line(self.where.line))
        if self.more:
            given = (
                *self.more,
                *(note for note in given if note.__class__ is not error_msg or not self._has_message()),
            )
        return given

    def _told_of(self, term: Any) -> str:
        """Message to a program in AgentSpeak, with Jason's words for goals without a plan."""
        words = _MESSAGES.get(self.reason)
        if words is None:
            return self.message
        from socialbot.bdi.agentspeak._spelling import spelled  # it imports this module

        return words.format(spelled(term))

    def _has_message(self) -> bool:
        return any(isinstance(note, Literal) and note.key == "error_msg/1" for note in self.more)


Request = tuple[int, "Trigger", tuple[Any, ...], tuple[Any, ...], Any]
"""Request of a body: kind, trigger, arguments and annotations of the goal, and its record."""


class OpenRequest(tuple[Any, ...]):
    """Request for a goal with variables, after the selection of its plan.

    Args:
        request: The request.
    """

    def __new__(cls, request: Request) -> OpenRequest:
        return super().__new__(cls, request)

    def __init__(self, request: Request) -> None:
        self._selected: tuple[Any, Any] = resolve(request[2:4])

    def undo(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Undo all bindings of its failed plan.

        Returns:
            Its arguments and annotations for a failure plan: with the values that head and context of the failed plan
            gave, which the goal itself does not keep.
        """
        _, _, args, notes, _ = self
        free((args, notes, self._selected))
        found, selected_notes = self._selected
        return tuple(arg if one.__class__ is Var else one for arg, one in zip(args, found, strict=True)), selected_notes


Body = Any
"""Generator of the remaining steps of a plan."""


@dataclass(frozen=True, slots=True)
class SpecialBody:
    """Body of an atomic plan or of a plan for a meta-event."""

    body: Body


Frame = tuple["Body | None", "Request | None", "CompiledPlan | None"]
"""Active plan: its steps, its goal, and the plan. A frame without steps keeps a goal for its failure plans."""


QueuedPlan = tuple[Body, "CompiledPlan", int, "Trigger", tuple[Any, ...], tuple[Any, ...], Any]
"""Intention of a single plan for an event: body, plan, number and event. It becomes an `Intention` when it pauses,
pursues a goal or is looked at; most of them never do, and a tuple is made and forgotten faster."""

SHOWN_LEVELS = 8
"""Largest number of levels in the text of an intention."""


class Intention:
    """Stack of plans for one event or goal; each plan serves the one below it."""

    __slots__ = ("active", "atomic", "ended", "event", "frames", "number", "parent", "pause", "stepwise", "suspended")

    def __init__(self, number: int, event: Request | None = None) -> None:
        self.number = number
        self.event = event
        self.frames: list[Frame] = []
        self.pause: Pause | None = None
        self.active = True
        self.suspended = False
        self.atomic = False
        self.parent: Intention | None = None  # of a branch
        self.stepwise = False  # a condition that holds can end it after each step
        self.ended: Callable[[Failure | None], None] | None = None

    def goals(self) -> list[Request]:
        """Goals of the plans, the outermost first."""
        return [goal for _, goal, _ in self.frames if goal is not None]

    @property
    def is_meta(self) -> bool:
        """Whether it handles a meta-event."""
        return self.event is not None and self.event[1].key[0] == "^"

    @property
    def state(self) -> str:
        """``running``, ``waiting`` or ``suspended``."""
        return "suspended" if self.suspended else "waiting" if self.pause is not None else "running"

    @property
    def because(self) -> str:
        """Reason of the current pause, or an empty string."""
        return "" if self.pause is None else str(self.pause)

    def stack(self, kinds: Mapping[str, type[Goal]] | None = None) -> tuple[GoalLevel, ...]:
        from socialbot.bdi._explain import stack_of

        return stack_of(self, kinds or {})

    def __str__(self) -> str:
        stack = [str(ready.plan.event) for _, _, ready in reversed(self.frames) if ready and ready is not KEPT]
        if len(stack) > SHOWN_LEVELS:
            stack[SHOWN_LEVELS - 2 : -1] = [f"{len(stack) - SHOWN_LEVELS + 1} more"]
        return " < ".join(stack) + (f" ({self.pause})" if self.pause else "")


@dataclass(frozen=True, slots=True)
class TimedRequest:
    """Request with a time limit."""

    request: Request
    seconds: float


class Pause:
    """Pause of an intention; subclasses override `begin` and `cancel`."""

    intention: Any = None
    """The `Intention`, or the `QueuedPlan` of a plain pause; None after the end."""
    interpreter: Interpreter
    plain = False

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        """Start the pause and arrange its end."""
        self.interpreter = interpreter
        self.intention = intention

    def cancel(self, then: Callable[[], None]) -> None:
        """Cancel the pause; call ``then`` after its end."""
        self.intention = None
        then()

    def end(self, problem: Exception | None = None) -> None:
        """Resume the intention, or fail its step."""
        intention, self.intention = self.intention, None
        if intention is not None:
            self.interpreter.intentions.resume(intention, problem)

    def limit(self, seconds: float, problem: Exception) -> None:
        """Fail the step after a pause of more than ``seconds``."""

        def expire() -> None:
            intention = self.intention
            self.cancel(lambda: intention and self.interpreter.intentions.resume(intention, problem))

        self.interpreter.timers.after(seconds, expire, lambda: self.intention is None)


def timed(pause: Pause | None, elapsed: Any) -> Pause | None:
    """Bind the duration of a pause (ms); the end of its limit is no failure."""
    if pause is None:
        unify(elapsed, 0, [])
        return None
    begin, end, limit = pause.begin, pause.end, pause.limit
    pause.plain = False
    since = 0

    def begin_timed(interpreter: Interpreter, intention: Any) -> None:
        nonlocal since
        since = interpreter.now()
        begin(interpreter, intention)

    def end_timed(problem: Exception | None = None) -> None:
        if problem is None:
            unify(elapsed, (pause.interpreter.now() - since) // 1_000_000, [])
        end(problem)

    def limit_timed(seconds: float, problem: Exception) -> None:
        if not isinstance(problem, Failed) or problem.reason != "wait_timeout":
            limit(seconds, problem)
            return
        pause.interpreter.timers.after(seconds, expire, lambda: pause.intention is None)

    def expire() -> None:
        intention = pause.intention
        pause.cancel(lambda: None)
        pause.intention = intention
        end_timed()

    pause.begin, pause.end, pause.limit = begin_timed, end_timed, limit_timed  # type: ignore[method-assign]
    return pause


@dataclass(eq=False)
class Sleep(Pause):
    """Pause for a duration."""

    seconds: float

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        super().begin(interpreter, intention)
        interpreter.timers.after(self.seconds, self.end, lambda: self.intention is None)

    def __str__(self) -> str:
        return f"waits {self.seconds} s"


class EventPause(Pause):
    """Pause until an event; a ``plain`` one does nothing else at its begin and end."""

    __match_args__ = ("key", "args", "notes", "limit_s")

    number = 0
    place: Any = None
    outside = False

    def __init__(self, key: str, args: tuple[Any, ...], notes: tuple[Any, ...], limit_s: float | None) -> None:
        self.key = key
        self.args = args
        self.notes = notes
        self.limit_s = limit_s
        self.plain = limit_s is None

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        self.interpreter = interpreter
        self.intention = intention
        interpreter.intentions.waits.await_event(self)
        if self.limit_s is not None:
            self.limit(self.limit_s, Failed("wait_timeout", f"{self.key} did not come in {self.limit_s} s"))

    def matches(self, args: tuple[Any, ...], notes: tuple[Any, ...]) -> bool:
        """Whether an event matches; binds its variables."""
        trail: Trail = []
        if unify(self.args, args, trail) and annotations_match(self.notes, notes, trail):
            return True
        undo(trail, 0)
        return False

    def cancel(self, then: Callable[[], None]) -> None:
        self.interpreter.intentions.waits.forget_event(self)
        super().cancel(then)

    def __str__(self) -> str:
        return f"waits for {self.key}"


@dataclass(eq=False)
class ConditionPause(Pause):
    """Pause until a condition holds.

    ``beliefs`` are the keys of the beliefs in the condition, each with the known arguments; None if the condition
    depends on other things. ``cells`` are its variables that may have no value yet.
    """

    solve: Callable[[], Any]
    found: list[Any]
    limit_s: float | None
    beliefs: tuple[tuple[str, tuple[Any, ...]], ...] | None = None
    cells: tuple[Any, ...] = ()
    number: int = 0
    places: list[Any] | None = None

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        super().begin(interpreter, intention)
        interpreter.intentions.waits.await_condition(self)
        if self.limit_s is not None:
            self.limit(self.limit_s, Failed("wait_timeout", f"the condition did not hold in {self.limit_s} s"))

    def check(self) -> bool:
        solution = self.solve()
        if solution is not None:
            self.found.append(solution)
        return solution is not None

    def may_be_bound(self) -> bool:
        """Whether a parallel branch may bind a variable of the condition."""
        return self.intention is not None and self.intention.event is None and not closed(self.cells)

    def cancel(self, then: Callable[[], None]) -> None:
        self.interpreter.intentions.waits.forget_condition(self)
        super().cancel(then)

    def __str__(self) -> str:
        return "waits for a condition"


class ForkPause(Pause):
    """Pause until one branch, or every branch, has ended."""

    def __init__(self, bodies: tuple[Body, ...], cause: Any, *, every: bool) -> None:
        self.bodies = bodies
        self.cause = cause
        self.every = every
        self.branches: list[Intention] = []
        self._then: Callable[[], None] | None = None

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        super().begin(interpreter, intention)
        for body in self.bodies:
            self.branches.append(interpreter.intentions.branch(body, intention, self._ended))

    def _ended(self, branch: Intention, failure: Failure | None) -> None:
        self.branches.remove(branch)
        if self.intention is None:
            return
        if failure is None and (not self.every or not self.branches):
            self._drop(self.end)
        elif failure is not None and (self.every or not self.branches):
            problem = Failed(failure.reason, failure.message, failure.more)
            self._drop(lambda: self.end(problem))

    def cancel(self, then: Callable[[], None]) -> None:
        self.intention = None
        self._drop(then)

    def _drop(self, then: Callable[[], None]) -> None:
        """Drop the remaining branches, then call ``then``."""
        dropping, self._then = self._then is not None, then
        if dropping:
            return  # the last request has the widest scope
        left = list(self.branches)
        self.branches.clear()
        missing = len(left)

        def gone() -> None:
            nonlocal missing
            missing -= 1
            if missing <= 0:
                last, self._then = self._then, None
                assert last is not None
                last()

        for branch in left:
            branch.ended = None
            self.interpreter.intentions.drop(branch, gone)
        if not left:
            gone()

    def __str__(self) -> str:
        return f"waits for {'all' if self.every else 'one'} of {len(self.branches)} branches"


@dataclass(frozen=True, slots=True)
class MentalState:
    """Snapshot of an agent's beliefs, desires and intentions."""

    beliefs: tuple[HeldBelief, ...]
    desires: tuple[Literal, ...]
    intentions: tuple[Intention, ...]


def goal_of(request: Request, kinds: Mapping[str, type[Goal]]) -> Literal:
    """Goal of a request; ``kinds`` are the classes of goals by name."""
    _, trigger, args, _, _ = request
    args = tuple(map(_shown, resolve(args)))
    key = trigger.key.lstrip("+-!?")
    kind = kinds.get(key.rpartition("/")[0])
    return kind(*args) if kind is not None else literal_from_key(key, args)


def _shown(term: Any) -> Any:
    return Variable(term.name if term.name.isidentifier() else "_") if term.__class__ is Var else term


def origin_of(plan: CompiledPlan | None) -> Origin | None:
    """Source location of a plan, if known."""
    return None if plan is None or plan is KEPT else plan.plan.origin


def source_of(origin: Origin) -> str:
    """Source file as in annotations, such as ``file:a.asl``."""
    return origin.file if origin.file[:1] == "<" else f"file:{origin.file}"


def mode_of(free: Iterable[bool]) -> int:
    """Return the flags of a request whose arguments are values, except for the ``free`` ones."""
    mode = sum(1 << i for i, unbound in enumerate(free) if unbound)
    return OPEN | mode << MODE if mode else 0


def subgoal(trigger: Trigger, args: tuple[Any, ...], notes: tuple[Any, ...], cause: Any) -> Request:
    """Request for a goal, whose arguments and annotations may be unbound."""
    return (SUBGOAL if closed(args) and closed(notes) else SUBGOAL | OPEN, trigger, args, notes, cause)


def once(result: Any) -> Body:
    """Body with one result; with None, it does nothing for one turn."""
    yield result


def asking_for(request: Request) -> Body:
    """Body that only adopts a goal."""
    kind, *rest = request
    yield (kind | TAIL if not kind & EVENT else kind, *rest)  # type: ignore[misc]
