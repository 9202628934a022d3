"""Requests between agents: who may ask for what, requests received, and requests sent."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from socialbot.bdi import Engine
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.desires import End
from socialbot.deliberation.messages import AgentReply, AgentRequest, Desire, Fact, Operation

_DEEDS: Mapping[str, str] = {"check": "check", "add": "add", "del": "delete"}


@dataclass(frozen=True, slots=True)
class Permission:
    """Whether a request is granted, or the reason why not; and which priority a desire may have at most."""

    granted: bool
    reason: str = ""
    max_priority: float = 0.0


@dataclass(frozen=True)
class Policies:
    """The groups of agents that may check (``ck``) or write (``w``) beliefs and desires.

    ``desire_pr`` is the highest priority, 0 to 1, that each group of ``desire_w`` may give, in the same order; it is
    0 for those that it does not reach.
    """

    belief_ck: tuple[str, ...] = ()
    belief_w: tuple[str, ...] = ()
    desire_ck: tuple[str, ...] = ()
    desire_w: tuple[str, ...] = ()
    desire_pr: tuple[float, ...] = ()

    @classmethod
    def parse(
        cls,
        *,
        belief_ck: str = "",
        belief_w: str = "",
        desire_ck: str = "",
        desire_w: str = "",
        desire_pr: str = "",
        where: str = "policies",
    ) -> Policies:
        """Policies from lists separated by commas, as parameters have them.

        Raises ParameterError for a priority that is none, and for more priorities than groups.
        """
        writers = _words(desire_w)
        priorities = tuple(_priority(word, where) for word in _words(desire_pr))
        if len(priorities) > len(writers):
            raise ParameterError(
                f"desire_pr has {len(priorities)} priorities for {len(writers)} groups of desire_w",
                where=where,
                remedy="give each group of desire_w one priority, in the same order",
            )
        return cls(_words(belief_ck), _words(belief_w), _words(desire_ck), writers, priorities)

    def may(self, request: AgentRequest) -> Permission:
        """Whether the sender's group may have this done."""
        kind = "belief" if request.belief is not None else "desire"
        checks = request.operation == "check"
        if kind == "belief":
            groups = self.belief_ck if checks else self.belief_w
        else:
            groups = self.desire_ck if checks else self.desire_w
        if request.group not in groups:
            allowed = f"these may: {', '.join(groups)}" if groups else "nobody may"
            return Permission(False, f"group {request.group!r} may not {_DEEDS[request.operation]} {kind}s; {allowed}")
        if kind == "belief" or checks:
            return Permission(True)
        number = self.desire_w.index(request.group)
        return Permission(True, max_priority=self.desire_pr[number] if number < len(self.desire_pr) else 0.0)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _priority(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise ParameterError(f"desire_pr: {word!r} is no priority", where=where, remedy="give numbers from 0 to 1")
    return value


REMEMBERED = 1000
"""So many answers are kept, for requests that come twice."""

REPEAT_S = 0.5
"""A request without an answer is sent again after so long; who gets it twice carries it out once."""

MONITOR_S = 5.0
"""How often a request is sent again while a desire is monitored: who was started anew meanwhile answers anew."""

AnswerState = Literal["waiting", "done", "refused", "fulfilled", "dropped", "timeout"]


@dataclass(eq=False)
class SentRequest:
    """A request that was sent, and what has come of it so far; actions look at it each time they advance.

    ``state`` is ``waiting`` until the answer comes, or ``timeout`` when none came in time; ``found`` and ``priority``
    are those of the answer. That of a monitored desire becomes ``fulfilled`` or ``dropped`` later, or ``refused`` by a
    receiver that was started anew.
    """

    request: AgentRequest
    state: AnswerState = "waiting"
    found: bool = False
    priority: float | None = None
    reason: str = ""

    @property
    def accepted(self) -> bool:
        """Whether the other agent did what it was asked to, or has begun to."""
        return self.state in ("done", "fulfilled", "dropped")


@dataclass(eq=False)
class RequestClient:
    """The requests that an agent of a ``group`` has sent by ``send``; a reply that nobody waits for is refused."""

    engine: Engine
    group: str
    send: Callable[[AgentRequest], object]
    timeout_s: float = 2.0
    refused: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._count = 0
        self._open: dict[str, SentRequest] = {}
        self._closed: OrderedDict[str, None] = OrderedDict()

    def ask(
        self,
        receiver: str,
        operation: Operation,
        *,
        belief: Fact | None = None,
        desire: Desire | None = None,
        monitor: bool = False,
        cause: str = "",
    ) -> SentRequest:
        """Asks another agent to check, add or delete a belief or a desire."""
        self._count += 1
        now = self.engine.clock.now()
        request = AgentRequest(
            stamp=now,
            # The time tells it from requests before a restart.
            id=f"{self.engine.name}-{now}-{self._count}",
            sender=self.engine.name,
            group=self.group,
            receiver=receiver,
            operation=operation,
            belief=belief,
            desire=desire,
            monitor=monitor,
        )
        asked = SentRequest(request)
        self._open[request.id] = asked
        self.engine.record("request", text_of(request), cause, id=request.id)
        self._repeat(asked, now + nanoseconds(self.timeout_s))
        return asked

    def take(self, reply: AgentReply) -> bool:
        """Takes an answer; False when nobody waits for it. One that comes twice is left alone the second time."""
        asked = self._open.get(reply.id)
        if asked is None or reply.sender != asked.request.receiver:
            if asked is not None or reply.id not in self._closed:
                self.refused += 1
                reason = "nobody waits for it"
                self.engine.record("refused", f"the reply {reply.id} of {reply.sender}", reply.id, reason=reason)
            return False
        before = asked.state, asked.found, asked.reason
        asked.state = reply.state if reply.accepted else "refused"
        asked.found, asked.priority, asked.reason = reply.found, reply.priority, reply.reason
        if not (asked.request.monitor and reply.accepted and reply.state == "done"):
            self._close(asked)
        if (asked.state, asked.found, asked.reason) != before:
            self.engine.record("reply", f"{reply.sender}: {asked.state}", reply.id, reason=reply.reason)
        return True

    def forget(self, asked: SentRequest) -> None:
        """Waits no longer for what becomes of a request."""
        self._close(asked)

    def _close(self, asked: SentRequest) -> None:
        self._open.pop(asked.request.id, None)
        self._closed[asked.request.id] = None
        if len(self._closed) > REMEMBERED:
            self._closed.popitem(last=False)

    def _repeat(self, asked: SentRequest, deadline: int) -> None:
        """Sends a request, and again while no answer comes: the receiver may be just starting."""
        if self._open.get(asked.request.id) is not asked:
            return
        if asked.state != "waiting":
            self.engine.at_in(MONITOR_S, lambda: self._remind(asked))
            return
        now = self.engine.clock.now()
        if now < deadline:
            self.send(asked.request)
            self.engine.at(min(now + nanoseconds(REPEAT_S), deadline), lambda: self._repeat(asked, deadline))
            return
        asked.state = "timeout"
        asked.reason = f"no answer from {asked.request.receiver} in {self.timeout_s:g} s"
        self._close(asked)
        self.engine.record("reply", f"{asked.request.receiver}: timeout", asked.request.id, reason=asked.reason)

    def _remind(self, asked: SentRequest) -> None:
        """Sends the request of a monitored desire again as long as its end is waited for."""
        if self._open.get(asked.request.id) is asked:
            self.send(asked.request)
            self.engine.at_in(MONITOR_S, lambda: self._remind(asked))


def text_of(request: AgentRequest) -> str:
    """A request as the trace shows it."""
    about = request.belief if request.belief is not None else request.desire and request.desire.name
    kind = "belief" if request.belief is not None else "desire"
    return f"{request.sender} asks {request.receiver} to {request.operation} {kind} {about}"


class RequestServer:
    """Answers requests to an agent, each once, by ``send``; one that comes again gets the same answer again."""

    def __init__(self, deliberator: Deliberator, policies: Policies, send: Callable[[AgentReply], object]) -> None:
        self._deliberator = deliberator
        self._policies = policies
        self._send = send
        self._answers: OrderedDict[tuple[str, str], AgentReply] = OrderedDict()

    def take(self, request: AgentRequest) -> None:
        """Answers a request that is for this agent; others are left alone."""
        engine = self._deliberator.engine
        if request.receiver != engine.name:
            return
        key = (request.sender, request.id)
        answer = self._answers.get(key)
        if answer is None:
            engine.record("asked", text_of(request), request.id, group=request.group)
            answer = self._answer(request)
            if not answer.accepted:
                engine.record("refused", text_of(request), request.id, reason=answer.reason)
        self._remember(key, answer)
        self._send(answer)

    def _remember(self, key: tuple[str, str], answer: AgentReply) -> None:
        self._answers[key] = answer
        self._answers.move_to_end(key)
        if len(self._answers) > REMEMBERED:
            self._answers.popitem(last=False)

    def _answer(self, request: AgentRequest) -> AgentReply:
        if (request.belief is None) == (request.desire is None):
            return self._refusal(request, "it has to name a belief or a desire")
        permission = self._policies.may(request)
        if not permission.granted:
            return self._refusal(request, permission.reason)
        if request.belief is not None:
            return self._about_belief(request, request.belief)
        assert request.desire is not None
        return self._about_desire(request, request.desire, permission.max_priority)

    def _about_belief(self, request: AgentRequest, belief: Fact) -> AgentReply:
        facts = self._deliberator.facts
        misfit = facts.unfit(belief)
        if misfit:
            return self._refusal(request, misfit)
        if request.operation == "check":
            return self._reply(request, found=facts.current(belief) == belief)
        if request.operation == "add":
            facts.add(belief, source=request.sender, cause=request.id)
        else:
            return self._reply(request, found=bool(facts.remove(belief, request.id)))
        return self._reply(request, found=True)

    def _about_desire(self, request: AgentRequest, desire: Desire, most: float) -> AgentReply:
        deliberator = self._deliberator
        if request.operation == "check":
            return self._reply(request, found=desire.name in deliberator.desires)
        if request.operation == "del":
            return self._reply(
                request, found=deliberator.drop(desire.name, f"{request.sender} asked for it", cause=request.id)
            )
        reason = deliberator.objection(desire)
        if reason:
            return self._refusal(request, reason)
        priority = min(desire.priority, most)
        if deliberator.facts.fulfilled(desire):
            return self._reply(request, state="fulfilled", found=True, priority=priority)
        reason = deliberator.desire(
            msgspec.structs.replace(desire, priority=priority),
            cause=request.id,
            listener=self._monitor(request) if request.monitor else None,
        )
        return self._refusal(request, reason) if reason else self._reply(request, found=True, priority=priority)

    def _monitor(self, request: AgentRequest) -> Callable[[End, str], None]:
        """Tells the sender what becomes of a desire, now and when the request comes again."""

        def tell(how: End, reason: str) -> None:
            answer = self._reply(request, state=how, found=how == "fulfilled", reason=reason)
            self._remember((request.sender, request.id), answer)
            self._send(answer)

        return tell

    def _refusal(self, request: AgentRequest, reason: str) -> AgentReply:
        return self._reply(request, accepted=False, state="refused", reason=reason)

    def _reply(self, request: AgentRequest, *, accepted: bool = True, **more: Any) -> AgentReply:
        engine = self._deliberator.engine
        return AgentReply(
            stamp=engine.clock.now(),
            id=request.id,
            sender=engine.name,
            receiver=request.sender,
            accepted=accepted,
            **more,
        )
