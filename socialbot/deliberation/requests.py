"""What agents ask of each other: those that come, and those that were sent and wait for their answer."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from socialbot.agent_messages import AgentReply, AgentRequest, Desire, Fact, Operation
from socialbot.bdi import Engine
from socialbot.clock import nanoseconds

REMEMBERED = 1000
"""So many answers are kept, for requests that come twice."""

REPEAT_S = 0.5
"""A request without an answer is sent again after so long; who gets it twice carries it out once."""

MONITOR_S = 5.0
"""How often a request is sent again while a desire is monitored: who was started anew meanwhile answers anew."""

AnswerState = Literal["waiting", "done", "refused", "fulfilled", "dropped", "timeout"]


@dataclass(eq=False)
class Asked:
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
class Correspondence:
    """The requests that an agent of a ``group`` has sent by ``send``; a reply that nobody waits for is refused."""

    engine: Engine
    group: str
    send: Callable[[AgentRequest], object]
    timeout_s: float = 2.0
    refused: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._count = 0
        self._open: dict[str, Asked] = {}
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
    ) -> Asked:
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
        asked = Asked(request)
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

    def forget(self, asked: Asked) -> None:
        """Waits no longer for what becomes of a request."""
        self._close(asked)

    def _close(self, asked: Asked) -> None:
        self._open.pop(asked.request.id, None)
        self._closed[asked.request.id] = None
        if len(self._closed) > REMEMBERED:
            self._closed.popitem(last=False)

    def _repeat(self, asked: Asked, deadline: int) -> None:
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

    def _remind(self, asked: Asked) -> None:
        """Sends the request of a monitored desire again as long as its end is waited for."""
        if self._open.get(asked.request.id) is asked:
            self.send(asked.request)
            self.engine.at_in(MONITOR_S, lambda: self._remind(asked))


def text_of(request: AgentRequest) -> str:
    """A request as the trace shows it."""
    about = request.belief if request.belief is not None else request.desire and request.desire.name
    kind = "belief" if request.belief is not None else "desire"
    return f"{request.sender} asks {request.receiver} to {request.operation} {kind} {about}"
