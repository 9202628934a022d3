"""Messages between agents, and the effect of each performative on the receiver.

Contents are terms; only plans may be sent as text. The receiver adds told beliefs with ``source(Sender)``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from socialbot.bdi.belief_base import is_source
from socialbot.bdi.intentions import OPEN, SUBGOAL, Failed, Failure, Intention, Pause, PauseTimer
from socialbot.bdi.literals import Event, Literal, literal_from_key, source
from socialbot.bdi.plans import Plan
from socialbot.bdi.stdlib.registry import detached, each_of, literal_of, wrong
from socialbot.bdi.steps import message
from socialbot.bdi.terms import Atom, show
from socialbot.bdi.unification import Trail, closed, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.society import Society

PERFORMATIVES = {
    "tell": "the receiver believes it, from the sender",
    "untell": "the receiver no longer believes it from the sender",
    "achieve": "the receiver takes on a goal",
    "unachieve": "the receiver gives up a goal, whoever wanted it",
    "askOne": "the receiver answers with the first thing it believes that fits, or false",
    "askAll": "the receiver answers with a list of all it believes that fits",
    "askHow": "the receiver answers with a list of its plans for an event",
    "tellHow": "the receiver gets a plan, from the sender",
    "untellHow": "the receiver loses a plan of the sender",
    "signal": "the receiver has the event that a belief is added, but does not believe it",
}
"""Performatives and their effects."""

TIMEOUT = Atom("timeout")
"""Answer to a question after its time limit."""


Reply = Callable[["Engine", Any], None]


class Messaging:
    """Messages of one agent to and from the other agents of its society.

    Attributes:
        society: The other agents; None for a single agent.
        accepts: Function of sender, performative and content; returns whether the agent accepts a message.
    """

    __slots__ = ("_engine", "accepts", "society")

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.society: Society | None = None
        self.accepts: Callable[[str, str, Any], bool] | None = None

    def send(
        self,
        receiver: Any,
        performative: str | Atom,
        content: Any,
        cause: Any = "",
        *,
        answer: Any = None,
        limit_s: float | None = None,
    ) -> Pause | None:
        """Send a message to one agent, or to several.

        Args:
            receiver: A name, an atom, or a tuple of them.
            performative: One of `PERFORMATIVES`.
            content: A term, without variables if the performative requires it.
            cause: The trace record of the cause.
            answer: The term that has to match the answer to a question.
            limit_s: The time after which a missing answer is ``timeout``.

        Returns:
            The pause until the answer, if ``answer`` is given.

        Raises:
            Failed: The message is not valid, or the agent does not exist.
        """
        act, content = str(performative), _content(str(performative), content)
        receivers = [self._find(each) for each in each_of(receiver)]
        trace = self._engine.trace
        if trace.sink is not None:
            names = ", ".join(agent.name for agent in receivers)
            cause = trace.record("message", f"{act} {names}: {show(content)}", cause)
        asking = None
        if answer is not None and act.startswith("ask"):
            asking = AnswerPause(answer, receivers, resolve(receiver).__class__ is tuple, limit_s)
        for agent in receivers:
            self._deliver(agent, act, content, cause, None if asking is None else asking.hear)
        return asking

    def broadcast(self, performative: str | Atom, content: Any, cause: Any = "") -> None:
        """Send a message to all other agents. Raises Failed if it is not valid."""
        act, content = str(performative), _content(str(performative), content)
        trace = self._engine.trace
        if trace.sink is not None:
            cause = trace.record("message", f"{act} to all: {show(content)}", cause)
        for agent in [] if self.society is None else list(self.society.agents.values()):
            if agent is not self._engine:
                self._deliver(agent, act, content, cause, None)

    def tell(self, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        """Send a belief, given by its key and arguments, to another agent."""
        if self.society is None:
            self.send(receiver, "tell", literal_from_key(key, args), cause)
            return
        trace = self._engine.trace
        if trace.sink is not None:
            cause = trace.record("message", f"tell {show(receiver)}: {literal_from_key(key, args)}", cause)
        self.society.tell(self._engine, receiver, key, args, cause)

    def receive(
        self, sender: Engine, performative: str, content: Any, cause: Any = "", reply: Reply | None = None
    ) -> None:
        """Handle a message in the thread of this agent; answer a refused question with false."""
        agent = self._engine
        name = sender.name if sender is not agent else "self"
        if self.accepts is not None and not self.accepts(name, performative, content):
            if reply is not None:
                reply(agent, Atom("false"))
            return
        said_by = (source(Atom(name)),)
        if agent.trace.sink is not None:
            cause = agent.trace.record("message", f"{performative} from {name}: {show(content)}", cause)
        if "+message/3" in agent.library.triggers:
            relation = agent.beliefs.relation("message/3")
            if relation.kind is not message:
                agent.beliefs.declare(message)
            said = tuple(map(_closed, (Atom(name), Atom(performative), content)))
            agent.beliefs.add(relation, said, said_by, cause)
        _RECEIVERS[performative](agent, sender, content, said_by, cause, reply)

    def _deliver(self, receiver: Engine, act: str, content: Any, cause: Any, reply: Reply | None) -> None:
        # Agents share no variables.
        deliver(self._engine, receiver, act, detached(content), cause, reply)

    def _find(self, receiver: Any) -> Engine:
        if receiver.__class__ is Atom:
            receiver = receiver.name
        if receiver in ("self", self._engine.name):
            return self._engine
        if self.society is None:
            raise Failed("action_failed", f"{self._engine.name} is alone: there is no agent {receiver}")
        return self.society.find(receiver)


def deliver(sender: Engine, receiver: Engine, act: str, content: Any, cause: Any, reply: Reply | None = None) -> None:
    """Post a message to an agent."""
    receiver.call(functools.partial(receiver.messaging.receive, sender, act, content, cause, reply))


# Handlers of performatives


def _tell(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    for each in each_of(content):
        belief = literal_of("tell", each)
        agent.beliefs.add(agent.beliefs.relation(belief.key), belief.args, _notes(belief, said_by), cause)


def _untell(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    for each in each_of(content):
        belief = literal_of("untell", each)
        agent.beliefs.remove(agent.beliefs.relation(belief.key), belief.args, _notes(belief, said_by), cause, False)


def _signal(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    for each in each_of(content):
        signal = literal_of("signal", each)
        added = agent.beliefs.relation(signal.key).added
        if added is not None:
            agent.interpreter.events.append((added, signal.args, (*_notes(signal, said_by), Atom("signal")), cause))


def _achieve(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    for each in each_of(content):
        goal = literal_of("achieve", each)
        kind = SUBGOAL if closed(goal.args) else SUBGOAL | OPEN
        agent.intentions.adopt((kind, agent.library.triggers[f"+!{goal.key}"], goal.args, _notes(goal, said_by), cause))


def _unachieve(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    from socialbot.bdi.stdlib.goals import drop_goal

    for each in each_of(content):
        drop_goal(agent, literal_of("unachieve", each))


def _ask_one(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Reply | None) -> None:
    query = literal_of("askOne", content)
    trail: Trail = []
    for _ in agent.interpreter.solve(query.key, query.args, query.annotations, trail):
        found = resolve(query)
        undo(trail, 0)
        _answer(agent, sender, query, found, cause, reply)
        return
    undo(trail, 0)
    trigger = agent.library.triggers.get(f"+?{query.key}")
    if trigger is None or not trigger.plans:
        _answer(agent, sender, query, None, cause, reply)
        return

    def ended(failure: Failure | None) -> None:
        _answer(agent, sender, query, resolve(query) if failure is None else None, cause, reply)

    kind = SUBGOAL if closed(query.args) else SUBGOAL | OPEN
    agent.intentions.adopt((kind, trigger, query.args, _notes(query, said_by), cause), ended)


def _ask_all(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Reply | None) -> None:
    query = literal_of("askAll", content)
    trail: Trail = []
    found = tuple(resolve(query) for _ in agent.interpreter.solve(query.key, query.args, query.annotations, trail))
    _answer(agent, sender, query, found, cause, reply)


def _ask_how(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Reply | None) -> None:
    from socialbot.bdi.stdlib._plans import relevant

    found = relevant(agent, content)
    if reply is not None:
        reply(agent, found)
    elif found:
        deliver(agent, sender, "tellHow", found, cause)


def _tell_how(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    from socialbot.bdi.stdlib._plans import learn

    for each in each_of(content):
        learn(agent, each, said_by)


def _untell_how(agent: Engine, sender: Engine, content: Any, said_by: Any, cause: Any, reply: Any) -> None:
    from socialbot.bdi.stdlib._plans import unlearn

    for each in each_of(content):
        unlearn(agent, each, said_by)


_RECEIVERS: dict[str, Callable[..., None]] = {
    "tell": _tell,
    "untell": _untell,
    "achieve": _achieve,
    "unachieve": _unachieve,
    "askOne": _ask_one,
    "askAll": _ask_all,
    "askHow": _ask_how,
    "tellHow": _tell_how,
    "untellHow": _untell_how,
    "signal": _signal,
}


# Answers


def _answer(agent: Engine, sender: Engine, query: Literal, found: Any, cause: Any, reply: Reply | None) -> None:
    """Answer a question through ``reply``, or else by a message: tell the solution, or untell the query."""
    if reply is not None:
        said_by = (source(Atom(agent.name)),)
        if found is None:
            found = Atom("false")
        elif found.__class__ is tuple:
            found = tuple(each.with_(annotations=_notes(each, said_by)) for each in found)
        else:
            found = found.with_(annotations=_notes(found, said_by))
        reply(agent, detached(found))
    elif found is None:
        deliver(agent, sender, "untell", detached(query), cause)
    else:
        deliver(agent, sender, "tell", detached(found), cause)


class AnswerPause(Pause):
    """Pause until the answer to a question."""

    def __init__(self, answer: Any, asked: list[Engine], several: bool, limit_s: float | None) -> None:
        self.answer = answer
        self.missing = {agent.name for agent in asked}
        self.names = ", ".join(agent.name for agent in asked)
        self.several = several
        self.limit_s = limit_s
        self.found: list[Any] = []

    def begin(self, interpreter: Any, intention: Intention) -> None:
        super().begin(interpreter, intention)
        if not self.missing:
            self._answered(())
        elif self.limit_s is not None:
            interpreter.timers.after(self.limit_s, PauseTimer(self, self._late))

    def hear(self, replier: Engine, answer: Any) -> None:
        """Accept an answer, from the thread of the replying agent."""
        self.interpreter.post(lambda: self._take(replier.name, answer))

    def _take(self, name: str, answer: Any) -> None:
        if self.intention is None or name not in self.missing:
            return
        self.missing.remove(name)
        self.found.append(answer)
        if not self.missing:
            self._answered(tuple(self.found) if self.several else answer)

    def _late(self) -> None:
        if self.intention is not None:
            self._answered(tuple(self.found) if self.several else TIMEOUT)

    def _answered(self, answer: Any) -> None:
        trail: Trail = []
        if unify(self.answer, answer, trail):
            self.end()
        else:
            undo(trail, 0)
            self.end(Failed("ask_failed", f"the answer of {self.names} does not fit: {show(answer)}"))

    def __str__(self) -> str:
        return f"waits for an answer of {self.names}"


def _content(act: str, content: Any) -> Any:
    """Check the content of a message. Raises Failed if it is not valid."""
    content = resolve(content)
    if act not in PERFORMATIVES:
        raise wrong(".send", Atom(act), f"one of {', '.join(PERFORMATIVES)}")
    if act == "askHow":
        from socialbot.bdi.stdlib.environment import event_of

        return event_of(act, content)
    if act in ("tellHow", "untellHow"):
        for each in each_of(content):
            if not isinstance(each, (Plan, str, Atom)):
                raise wrong(act, each, "a plan")
        return content
    for each in (content,) if act in ("askOne", "askAll") else each_of(content):
        what = literal_of(act, each)
        if act in ("tell", "signal") and not closed(what):
            raise Failed("no_value", f"{act} {what}: a variable has no value")
    return content


def _notes(what: Literal, said_by: tuple[object, ...]) -> tuple[object, ...]:
    """Annotations with the sources replaced by the sender."""
    if not what.annotations:
        return said_by
    return (*(note for note in what.annotations if not is_source(note)), *said_by)


def _closed(term: Any) -> Any:
    """Copy of a term with ``_`` in place of variables, for an event."""
    term = resolve(term)
    if closed(term) and not isinstance(term, Event):
        return term
    if isinstance(term, Event):
        return Event(term.change, _closed(term.literal), term.seconds)
    if term.__class__ is tuple:
        return tuple(map(_closed, term))
    if isinstance(term, Literal):
        return term.with_(args=_closed(term.args), annotations=_closed(term.annotations))
    return Atom("_")
