"""Messages between agents, and the effect of each performative on the receiver.

Contents are terms; only plans may be sent as text. The receiver adds told beliefs with ``source(Sender)``.
"""

from __future__ import annotations

import difflib
import functools
from collections.abc import Callable, Iterator
from itertools import count
from typing import TYPE_CHECKING, Any

from socialbot.bdi._open_beliefs import add_belief, remove_belief
from socialbot.bdi.intentions import EVENT, OPEN, Failed, Failure, Intention, Pause, subgoal
from socialbot.bdi.literals import SELF, Event, Literal, is_source, literal_from_key, source_notes
from socialbot.bdi.plans import Plan
from socialbot.bdi.stdlib.registry import detached, each_of, literal_of, wrong
from socialbot.bdi.steps import message
from socialbot.bdi.terms import Atom, Rest, show
from socialbot.bdi.unification import Trail, Var, closed, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.society import Society

PERFORMATIVES = (
    "tell", "untell", "signal", "achieve", "unachieve", "askOne", "askAll", "askHow", "tellHow", "untellHow",
)  # fmt: skip

TOLD: Any = object()
"""Begin of a belief that another agent tells: the time when the agent reads the message."""

TIMEOUT = Atom("timeout")
"""Answer to a question after its time limit."""

RECEIVED = "+!kqml_received/4"
"""Trigger of the plans of a program for messages: sender, performative, content and number of the message."""

Reply = Callable[["Engine", Any], None]


class Messaging:
    """Messages of one agent to and from the other agents of its society.

    Attributes:
        society: The other agents; None for a single agent.
        accepts: Function of sender, performative and content; returns whether the agent accepts a message.
        questions: Questions that plans for messages may answer, by the number of the message.
    """

    __slots__ = ("_engine", "_numbers", "accepts", "questions", "society")

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.society: Society | None = None
        self.accepts: Callable[[str, str, Any], bool] | None = None
        self.questions: dict[Any, tuple[str, Reply]] = {}
        self._numbers = count(1)

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
            performative: One of `PERFORMATIVES`, or another name, for which the receivers need plans (`RECEIVED`).
            content: A term; a question must be a literal.
            cause: The trace record of the cause.
            answer: The term that has to match the answer to a question, or the number of a question to answer.
            limit_s: The time after which a missing answer is ``timeout``.

        Returns:
            The pause until the answer, if ``answer`` is given.

        Raises:
            Failed: The message is not valid, or the agent does not exist.
        """
        act = str(performative)
        content = _content(act, content)
        receivers = [self._find(each) for each in each_of(receiver)]
        trace = self._engine.trace
        if trace.sink is not None:
            names = ", ".join(agent.name for agent in receivers)
            cause = trace.record("message", f"{act} {names}: {show(content)}", cause)
        asking = None
        question = None if answer is None or act.startswith("ask") else self.questions.pop(resolve(answer), None)
        if question is not None:
            self._answer(question, act, content)
            return None
        if answer is not None and act.startswith("ask"):
            asking = AnswerPause(answer, receivers, resolve(receiver).__class__ is tuple, limit_s)
        for agent in receivers:
            deliver(self._engine, agent, act, content, cause, None if asking is None else asking.take)
        return asking

    def broadcast(self, performative: str | Atom, content: Any, cause: Any = "") -> None:
        """Send a message to all other agents. Raises Failed if it is not valid."""
        act, society, trace = str(performative), self.society, self._engine.trace
        others = [] if society is None else [agent for agent in society.agents.values() if agent is not self._engine]
        content = _content(act, content)
        if trace.sink is not None:
            cause = trace.record("message", f"{act} to all: {show(content)}", cause)
        if society is not None:
            literals = all(isinstance(each, (Literal, Atom)) for each in each_of(content))
            if act == "tell" and literals and detached(content) is content:
                society.tell_all(self._engine, others, content, cause)
                return
            for agent in others:
                deliver(self._engine, agent, act, content, cause)

    def tell(self, receiver: Any, key: str, args: tuple[Any, ...], cause: Any) -> None:
        """Send a belief, given by its key and arguments, to another agent."""
        if self.society is None:
            self.send(receiver, "tell", literal_from_key(key, args), cause)
            return
        trace = self._engine.trace
        if trace.sink is not None:
            cause = trace.record("message", f"tell {show(receiver)}: {literal_from_key(key, args)}", cause)
        self.society.tell(self._engine, receiver, key, args, cause)

    @property
    def takes_beliefs(self) -> bool:
        """Whether told beliefs need no check, record or event of the message, so that they can be added at once."""
        engine = self._engine
        triggers = engine.library.triggers
        return (
            self.accepts is None
            and engine.trace.sink is None
            and "+message/3" not in triggers
            and RECEIVED not in triggers
        )

    @property
    def reads(self) -> bool:
        """Whether the program has plans for messages."""
        trigger = self._engine.library.triggers.get(RECEIVED)
        return trigger is not None and bool(trigger.plans)

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
        said_by = source_notes(name)
        if agent.trace.sink is not None:
            cause = agent.trace.record("message", f"{performative} from {name}: {show(content)}", cause)
        if "+message/3" in agent.library.triggers:
            relation = agent.beliefs.relation("message/3")
            if relation.kind is not message:
                agent.beliefs.declare(message)
            said = tuple(map(_closed, (Atom(name), Atom(performative), content)))
            agent.beliefs.add(relation, said, said_by, cause)
        if self.reads and self._received(name, performative, content, cause, reply):
            return
        if performative not in PERFORMATIVES:
            problem = Failed("no_applicable", f"no plan for the message {performative} from {name}: {show(content)}")
            agent.trace.record_failure(f"+!kqml_received({name}, {performative}, ...)", cause, problem)
            if reply is not None:
                reply(agent, Atom("false"))
            return
        if performative.startswith("ask"):
            _ask(agent, sender, performative, content, said_by, cause, reply)
        else:
            try:
                _apply(agent, performative, content, said_by, cause)
            except Failed as problem:  # the sender does not wait for the effect
                agent.trace.record_failure(f"{performative} from {name}", cause, problem)

    def _received(self, name: str, performative: str, content: Any, cause: Any, reply: Reply | None) -> bool:
        """Pursue the goal of a message by a plan of the program; return whether one applies."""
        agent = self._engine
        trigger, number = agent.library.triggers[RECEIVED], Atom(f"mid{next(self._numbers)}")
        args = (Atom(name), Atom(performative), content, number)
        request = subgoal(trigger, args, SELF, cause)
        if reply is not None:
            self.questions[number] = (performative, reply)
        plan, result = agent.interpreter.select_plan(trigger, args, SELF, cause, bool(request[0] & OPEN))
        if result is None:
            self.questions.pop(number, None)
            return False
        agent.intentions.adopt_with(request, plan, result)
        return True

    def _answer(self, question: tuple[str, Reply], act: str, content: Any) -> None:
        """Answer a question by a message of a plan for messages; ``untell`` means that there is no answer."""
        asked, reply = question
        said = source_notes(self._engine.name)
        found = tuple(
            each.with_(annotations=_notes(each, said)) if isinstance(each, Literal) else each
            for each in each_of(content)
        )
        if act == "untell" and asked == "askOne":
            content = Atom("false")
        elif resolve(content).__class__ is tuple:
            content = found
        else:
            (content,) = found
        reply(self._engine, detached(content))

    def _find(self, receiver: Any) -> Engine:
        if receiver.__class__ is Atom:
            receiver = receiver.name
        if receiver in ("self", self._engine.name):
            return self._engine
        if receiver.__class__ is Var:
            raise wrong(".send", receiver, "the name of an agent, or a list of names")
        if self.society is None:
            raise Failed("receiver_not_found", f"there is no agent {receiver}: {self._engine.name} is in no society")
        return self.society.find(receiver)


def deliver(sender: Engine, receiver: Engine, act: str, content: Any, cause: Any, reply: Reply | None = None) -> None:
    """Post a message to an agent; agents share no variables."""
    receiver.call(Message(receiver.messaging.receive, sender, act, detached(content), cause, reply))


class Message(functools.partial[None]):
    """Posted message; an agent reads one in a turn, so that its plans for one see no beliefs of later ones."""


# Effects of performatives on the receiver


def told_beliefs(sender: Engine, content: Any) -> list[tuple[str, tuple[Any, ...], tuple[Any, ...]]]:
    """Return the keys, arguments and annotations of the beliefs in a message to other agents."""
    said_by = source_notes(sender.name)
    beliefs = [literal_of("tell", each) for each in each_of(content)]
    return [(belief.key, belief.args, _notes(belief, said_by)) for belief in beliefs]


def _apply(agent: Engine, act: str, content: Any, said_by: Any, cause: Any) -> None:
    """Apply a message other than a question."""
    from socialbot.bdi.stdlib import _plans, goals  # they import the parser

    for each in each_of(content):
        if act in ("tellHow", "untellHow"):
            (_plans.learn if act == "tellHow" else _plans.unlearn)(agent, each, said_by)
            continue
        literal = literal_of(act, each)
        key, args, notes = literal.key, literal.args, _notes(literal, said_by)
        match act:
            case "tell" if content.__class__ is tuple and not closed(literal):
                problem = Failed("no_value", f"{literal}: in a list, beliefs need values")
                agent.trace.record_failure("tell", cause, problem)
            case "tell":
                add_belief(agent.interpreter, "++", key, args, notes, cause)
            case "untell":
                remove_belief(agent.interpreter, key, args, notes, cause, here=False)
            case "signal":
                _signal(agent, key, args, (*notes, Atom("signal")), cause)
            case "achieve":
                agent.intentions.adopt(subgoal(agent.library.triggers[f"+!{key}"], args, notes, cause), told=True)
            case "unachieve":
                goals.drop_goal(agent, literal)


def _signal(agent: Engine, key: str, args: Any, notes: Any, cause: Any) -> None:
    added = agent.beliefs.relation(key).added
    if added is None:
        return
    if closed(args):
        agent.interpreter.events.append((added, args, notes, cause))
    else:
        agent.intentions.adopt((EVENT | OPEN, added, args, notes, cause), told=True)


def _ask(agent: Engine, sender: Engine, act: str, content: Any, said_by: Any, cause: Any, reply: Reply | None) -> None:
    """Answer a question through ``reply``, or else by a message: tell the solutions, or untell the query."""
    from socialbot.bdi.stdlib._plans import relevant, shown

    def answer(found: Any) -> None:
        if reply is None:
            deliver(agent, sender, "untell" if found is None else "tell", content if found is None else found, cause)
            return
        said = source_notes(agent.name)
        answers = () if found is None else each_of(found)
        solutions = tuple(each.with_(annotations=_notes(each, said)) for each in answers)
        reply(agent, detached(solutions if act == "askAll" else solutions[0] if solutions else Atom("false")))

    def ended(failure: Failure | None) -> None:
        asked = query.with_(annotations=tuple(note for note in query.annotations if not is_source(note)))
        answer(resolve(asked) if failure is None else None)

    if act == "askHow":
        plans = relevant(agent, content)
        if reply is not None:
            reply(agent, tuple(shown(agent, plan, source_notes(agent.name)) for plan in plans))
        elif plans:
            deliver(agent, sender, "tellHow", plans, cause)
        return
    query = literal_of(act, content)
    trail: Trail = []
    solutions = _annotated(agent, query, trail)
    if act == "askAll":
        answer(tuple(solutions))
        return
    found = next(solutions, None)
    undo(trail, 0)
    trigger = agent.library.triggers.get(f"+?{query.key}")
    if found is not None or trigger is None or not trigger.plans:
        answer(found)
    else:
        agent.intentions.adopt(subgoal(trigger, query.args, _notes(query, said_by), cause), ended, told=True)


def _annotated(agent: Engine, query: Literal, trail: Trail) -> Iterator[Literal]:
    """Yield the solutions of a query with all annotations of the beliefs but the source ``self``."""
    others = Var()
    for _ in agent.interpreter.solve(query.key, query.args, (*query.annotations, Rest(others)), trail):
        found, more = resolve(query), resolve(others)
        more = tuple(note for note in more if note not in SELF) if more.__class__ is tuple else ()
        yield found.with_(annotations=found.annotations + more)


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
            interpreter.timers.after(self.limit_s, self._late, lambda: self.intention is None)

    def take(self, replier: Engine, answer: Any) -> None:
        """Accept an answer, from the thread of the replying agent."""
        self.interpreter.post(functools.partial(self._take, replier.name, answer))

    def _take(self, name: str, answer: Any) -> None:
        if self.intention is None or name not in self.missing:
            return
        self.missing.remove(name)
        self.found.append(answer)
        if not self.missing:
            self._answered(tuple(self.found) if self.several else answer)

    def _late(self) -> None:
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
        near = difflib.get_close_matches(act, PERFORMATIVES, 1, cutoff=0.75)
        if not near:
            return content  # for plans of the receiver
        raise wrong(".send", Atom(act), f"'{near[0]}', or a performative that is not almost one of its own")
    if act == "askHow":
        from socialbot.bdi.stdlib.environment import event_of

        return event_of(act, content)
    if act in ("tellHow", "untellHow"):
        for each in each_of(content):
            if not isinstance(each, (Plan, str, Atom)):
                raise wrong(act, each, "a plan")
        return content
    if act.startswith("ask"):
        literal_of(act, content)  # a question without a meaning would have no answer
    return content


def _notes(what: Literal, said_by: tuple[Any, ...]) -> tuple[Any, ...]:
    """Annotations with the sender as source, which has the given sources itself: ``source(ann)[source(bob)]``."""
    if not what.annotations:
        return said_by
    nested = tuple(filter(is_source, what.annotations))
    if nested:
        said_by = tuple(source.with_(annotations=nested) for source in said_by)
    return (*(note for note in what.annotations if not is_source(note)), *said_by)


def _closed(term: Any) -> Any:
    term = resolve(term)
    match term:
        case Event():
            return Event(term.change, _closed(term.literal), term.seconds)
        case _ if closed(term):
            return term
        case tuple():
            return tuple(map(_closed, term))
        case Literal():
            return term.with_(args=_closed(term.args), annotations=_closed(term.annotations))
    return Atom("_")
