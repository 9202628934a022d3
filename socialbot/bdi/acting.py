"""Acting: how steps of plans reach the world, other agents and the engine itself; generated code calls it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from socialbot.bdi.actions import Action
from socialbot.bdi.belief_base import Notes
from socialbot.bdi.beliefs import Args, literal_of
from socialbot.bdi.compiler.runtime import EVENT, OPEN, SUBGOAL
from socialbot.bdi.explain import reasons_against
from socialbot.bdi.intention_stack import Timed
from socialbot.bdi.intentions import Body, ConditionPause, EventPause, Failed, ForkPause, Pause, Request, Sleep
from socialbot.bdi.library import Ready, Trigger
from socialbot.bdi.literals import SELF, Change, Event, Literal
from socialbot.bdi.reasoner import Reasoner
from socialbot.bdi.stdlib.registry import Internal
from socialbot.bdi.terms import Atom, show
from socialbot.bdi.unification import Trail, closed, resolve

if TYPE_CHECKING:
    from random import Random

    from socialbot.bdi.durative_actions import Pool
    from socialbot.bdi.society import Society


class Acting(Reasoner):
    """What the steps of plans may ask for."""

    __slots__ = ("_random", "accepts", "action_id", "actions", "cause", "out", "pool", "seed", "society")

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.society: Society | None = None
        self.accepts: Callable[[str, str, Any], bool] | None = None
        self.out: Callable[[str], object] | None = None
        self.cause: Any = ""
        self.actions: dict[str, Callable[..., Any] | type[Action]] = {}
        self.action_id = ""
        self.pool: Pool | None = None
        self.seed: int | str = self.name
        self._random: Random | None = None

    @property
    def random(self) -> Random:
        """The agent's source of random numbers, made when it is first used: it is large."""
        if self._random is None:
            from random import Random

            self._random = Random(self.seed)
        return self._random

    # Actions

    def acting(self, functor: str, args: Args, cause: Any) -> str:
        """Puts an action on record."""
        what = "" if self.sink is None else f"{functor}({', '.join(map(show, args))})"
        self.action_id = self.record("action", what, cause)
        return self.action_id

    def perform(self, kind: type[Action], args: Args, cause: Any) -> Any:
        """Executes an action of a class, made for this one time: agents that share a plan share no state."""
        action = kind(*args)
        action.engine = self  # type: ignore[assignment]
        action.id = self.acting(kind.functor, args, cause)
        if kind.threaded:
            from socialbot.bdi.durative_actions import ThreadRun

            return ThreadRun(action)  # type: ignore[arg-type]
        return action.execute(*args)

    def act(self, name: str, args: Args, cause: Any) -> Any:
        """Executes an action by its name, as AgentSpeak does."""
        action = self.actions.get(name)
        if action is None:
            raise Failed("action_failed", f"there is no action {name}/{len(args)}")
        if isinstance(action, type):
            if action.function is None:
                return self.perform(action, args, cause)
            action = action.function
        if self.sink is not None:
            self.acting(name, args, cause)
        return action(self, *args)

    def outcome(self, found: Any) -> Pause | None:
        """What an action returned: a pause, a coroutine to be awaited, False for a failure; the rest is ignored."""
        if isinstance(found, Pause):
            return found
        if inspect.iscoroutine(found):
            from socialbot.bdi.durative_actions import CoroutineRun

            return CoroutineRun(found, self.action_id)
        if found is False:
            raise Failed("action_failed", "the action returned False")
        return None

    def internal(self, entry: Internal, name: str, args: Args, cause: Any) -> Pause | None:
        """Carries out an internal action."""
        trail: Trail = []
        if self.sink is not None:
            self.acting(name, tuple(map(resolve, args)), cause)
        self.cause = cause
        found = entry.function(self, args, trail)
        if entry.many:
            found = next(found, "none") != "none"
        if found is False:
            raise Failed("ia_failed", f"{name} failed")
        return found if isinstance(found, Pause) else None

    def limited(self, pause: Pause | None, seconds: float) -> Pause | None:
        """A pause that fails when it takes too long."""
        if pause is None:
            return None
        begin = pause.begin

        def begin_limited(reasoner: Reasoner, intention: Any) -> None:
            begin(reasoner, intention)
            pause.limit(seconds, Failed("timeout", f"it took longer than {seconds} s"))

        pause.begin = begin_limited  # type: ignore[method-assign]
        return pause

    def sleep(self, seconds: float) -> Pause:
        """A pause of some seconds."""
        return Sleep(seconds)

    # Goals

    def open_goal(self, kind: int, trigger: Trigger, args: Args, notes: Notes, cause: Any) -> Request:
        """The request for a goal whose arguments may be variables."""
        args = resolve(args)
        return (kind if closed(args) else kind | OPEN, trigger, args, notes, cause)

    def goal_of(self, goal: Any, cause: Any) -> Request:
        """The request for a goal that is the value of a variable."""
        goal = _literal(goal)
        notes = goal.annotations or SELF
        return self.open_goal(SUBGOAL, self.triggers[f"+!{goal.key}"], goal.args, notes, cause)

    def adopt_term(self, goal: Any, cause: Any) -> None:
        """``!!G``."""
        self.adopt_later(self.goal_of(goal, cause))

    def adopt_later(self, request: Request) -> None:
        """Adopts a goal in an intention of its own when its turn comes."""
        _, trigger, args, notes, cause = request
        if not closed(args):
            raise Failed("no_value", f"!!{trigger.key[2:]} has a variable without a value")
        self.events.append((trigger, args, notes, cause))

    def question(self, trigger: Trigger, args: Args, notes: Notes, cause: Any) -> Request:
        """The request for a plan that answers a question."""
        if not trigger.plans:
            raise Failed("test_goal_failed", f"nothing answers {trigger.key[1:].rpartition('/')[0]}")
        return self.open_goal(SUBGOAL, trigger, args, notes, cause)

    def question_of(self, query: Any, cause: Any) -> Request | None:
        """``?Q``: None when something believed answers it."""
        query = _literal(query)
        for _ in self.solve(query.key, query.args, query.annotations, []):
            return None
        return self.question(self.triggers[f"+?{query.key}"], query.args, SELF, cause)

    def timed(self, request: Request, seconds: float) -> Timed:
        """A request with a time limit."""
        return Timed(request, seconds)

    # Beliefs

    def update_of(self, sign: str, belief: Any, cause: Any) -> Any:
        """``+B`` and the like."""
        belief = _literal(belief)
        relation, notes = self.relations[belief.key], belief.annotations or SELF
        if sign in ("-", "--"):
            return self.remove(relation, belief.args, notes, cause, sign == "-")
        if sign == "++":
            return self.add(relation, belief.args, notes, cause)
        return (self.add_here if sign == "+" else self.replace)(relation, belief.args, notes, cause)

    # Waiting, branches, stages

    def await_event(self, key: str, args: Args, notes: Notes, limit_s: float | None) -> Pause:
        """A pause until an event comes."""
        return EventPause(key, args, notes, limit_s)

    def await_condition(self, solve: Callable[[], Any], found: list[Any], limit_s: float | None) -> Pause | None:
        """A pause until a condition holds; None when it does already."""
        solution = solve()
        if solution is not None:
            found.append(solution)
            return None
        return ConditionPause(solve, found, limit_s)

    def fork(self, every: bool, bodies: tuple[Body, ...], cause: Any) -> Pause:
        """A pause until branches have ended."""
        return ForkPause(bodies, cause, every=every)

    def enter(self, stage: str | None, *, cause: Any = "") -> None:
        """Enters a stage: plans of other stages are no longer chosen. That is an event, ``entered(stage)``."""
        self.stage = stage
        self.library.declare(entered)
        self.equip(entered)
        self.add(self.relations["entered/1"], (stage or "",), SELF, cause)

    # The trace

    def chose(self, plan: Ready, args: Args, notes: Notes, cause: Any) -> str:
        """Puts on record that a plan was chosen, and why those before it were not."""
        text, event = plan.shown()
        detail: dict[str, object] = {"rule": text}
        if plan.plan.label:
            detail["label"] = plan.plan.label
        trigger = self.triggers[plan.plan.event.key]
        if closed(args) and len(trigger.plans) > 1:
            rejected = reasons_against(self, trigger, args, notes, plan)
            if rejected:
                detail["rejected"] = rejected
        return self.record("plan", event, cause, **detail)

    # Messages

    def tell(self, receiver: Any, key: str, args: Args, cause: Any) -> None:
        """Tells another agent a belief."""
        if self.society is None:
            self.send(receiver, "tell", literal_of(key, args), cause=cause)
            return
        if self.sink is not None:
            cause = self.record("message", f"tell {show(receiver)}: {literal_of(key, args)}", cause)
        self.society.tell(self, receiver, key, args, cause)  # type: ignore[arg-type]

    def send(self, receiver: Any, performative: str, content: Any, *, cause: Any = "") -> Pause | None:
        """Says something to another agent, or to several."""
        from socialbot.bdi.messaging import send

        return send(self, receiver, performative, content, cause)  # type: ignore[arg-type]

    def say(self, text: str) -> None:
        """Prints a line, or gives it to ``out``."""
        if self.out is not None:
            self.out(text)
        else:
            print(f"[{self.name}] {text}", flush=True)

    def raise_event(self, event: Event, cause: Any) -> None:
        """Has plans react to an event, as if it had come from outside."""
        literal = event.literal
        trigger = self.triggers.get(event.key)
        if trigger is None and event.change is Change.WANTED:
            trigger = self.triggers[event.key]
        if trigger is not None:
            self.events.append((trigger, literal.args, literal.annotations or SELF, cause))


def _literal(term: Any) -> Literal:
    from socialbot.bdi.literals import literal

    term = resolve(term)
    if isinstance(term, Atom):
        return literal(term.name)
    if not isinstance(term, Literal):
        raise Failed("wrong_arguments", f"{term} is no literal")
    return term


from socialbot.bdi.literals import Reactor  # noqa: E402


class entered(Reactor):  # noqa: N801 - written like a belief
    """``+entered(Stage)``: the event that a stage has begun."""


__all__ = ["EVENT", "Acting", "entered"]
