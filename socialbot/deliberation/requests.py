"""Requests between agents: access policies, the server of received requests, its bids, and the client of sent ones."""

from __future__ import annotations

import functools
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import msgspec

from socialbot.bdi import Engine
from socialbot.bdi.literals import OWN_SOURCES
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.decoding import from_builtins
from socialbot.core.errors import ParameterError
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.desires import End
from socialbot.deliberation.messages import AgentReply, AgentRequest, Desire, Fact, Operation, Priority
from socialbot.deliberation.sensing import silence_of
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem, in_time
from socialbot.planning.pddl.formulas import Formula
from socialbot.planning.pddl.restriction import restricted
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import state_after
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerLimits


@dataclass(frozen=True)
class Bid:
    """Time (s) until a desire would be achieved; None with the reason if the agent cannot achieve it."""

    seconds: float | None
    reason: str = ""


def make_bid(deliberator: Deliberator, desire: Desire, then: Callable[[Bid], object]) -> None:
    """Estimate the time for a desire in the background, and call ``then`` in the thread of the engine.

    The agent first completes its plan, and the desires that precede the offered one. Those without a plan count as 0 s.
    """
    facts, pursuit = deliberator.facts, deliberator.pursuit
    if facts.fulfilled(desire):
        then(Bid(0.0))
        return
    reason = _obstacle(deliberator, desire)
    if reason:
        then(Bid(None, reason))
        return
    earlier, busy_s, problem = _prediction(deliberator, desire)
    goals = [facts.goal(one.wanted) for one in (*earlier, desire) if not any(map(facts.unknown_condition, one.wanted))]
    domain = facts.domain
    if pursuit.unavailable:
        domain, problem = restricted(domain, problem, pursuit.unavailable, ())
    limits = pursuit.options.limits
    work = functools.partial(_estimate, pursuit.planner, domain, problem, goals, desire.deadline, limits)

    def on_estimate(found: Any) -> None:
        if not isinstance(found, tuple):
            then(Bid(None, f"{type(found).__name__}: {found}"))
            return
        spent_s, answer = found
        plan = answer.plan
        if plan is None:
            then(Bid(None, answer.message or answer.verdict.value))
        elif not in_time(plan, desire.deadline):
            then(Bid(None, f"the plan lasts {plan.makespan_s:g} s, longer than the {desire.deadline:g} s there are"))
        elif unhandled := pursuit.without_handler(step.action for step in plan.steps):
            then(Bid(None, f"no plan or action performs {', '.join(unhandled)}"))
        else:
            then(Bid(busy_s + spent_s + plan.makespan_s))

    pursuit.run_in_background(work, lambda found: deliberator.engine.call(lambda: on_estimate(found)))


def _obstacle(deliberator: Deliberator, desire: Desire) -> str:
    """Return why the agent cannot pursue a desire now, or an empty text."""
    facts, silent = deliberator.facts, tuple(deliberator.sensor_timeouts.since)
    unknown = (facts.unknown_condition(condition) for condition in desire.wanted)
    if reason := next(filter(None, unknown), ""):
        return reason
    if silent and not deliberator.pursuit.unavailable:
        return silence_of(silent)
    if not (facts.satisfied(desire.precondition) and facts.satisfied(desire.context)):
        return "its precondition or context does not hold"
    return ""


def _prediction(deliberator: Deliberator, desire: Desire) -> tuple[list[Desire], float, PddlProblem]:
    """Return the desires that precede an offered one, the rest (s) of the plan, and the predicted state after it."""
    executor, pursuit = deliberator.plan_executor, deliberator.pursuit
    rank = (-desire.priority, desire.deadline)
    policy, current = pursuit.options.reschedule_policy, pursuit.current
    completes = current is not None and not pursuit.problem
    if current is not None and policy == "PREEMPT" and rank < current.rank[:2]:
        completes = False
    earlier = [
        state.desire
        for state in deliberator.desires.ranked
        if state.rank[:2] <= rank and not state.blocked and not (completes and state is current)
    ]
    if completes:
        return earlier, executor.remaining_s, executor.problem_after_plan()
    return earlier, 0.0, executor.projected()


def _estimate(
    planner: Planner,
    domain: PddlDomain,
    problem: PddlProblem,
    goals: Sequence[Formula],
    deadline_s: float,
    limits: PlannerLimits,
) -> tuple[float, PlannerAnswer]:
    """Plan for goals one after the other; return the time (s) for all but the last, and the answer for that."""
    spent_s = 0.0
    for goal in goals[:-1]:
        plan = planner.solve(domain, replace(problem, goal=goal), limits).plan
        if plan is not None:
            spent_s += plan.makespan_s
            problem = state_after(PddlState.of(problem, domain), plan).problem(None)
    last = replace(problem, goal=goals[-1])
    return spent_s, planner.solve(domain, last, replace(limits, makespan_s=deadline_s))


@dataclass(frozen=True, slots=True)
class Permission:
    """Result of a policy check: granted or the reason for the refusal, and the highest priority of a desire."""

    granted: bool
    reason: str = ""
    max_priority: float = 0.0


@dataclass(frozen=True)
class Policies:
    """Groups of agents that may check (``ck``) or write (``w``) beliefs and desires.

    ``desire_pr`` is the highest priority, 0 to 1, for each group of ``desire_w`` in the same order; 0 if missing.
    """

    belief_ck: tuple[str, ...] = ()
    belief_w: tuple[str, ...] = ()
    desire_ck: tuple[str, ...] = ()
    desire_w: tuple[str, ...] = ()
    desire_pr: tuple[float, ...] = ()

    @classmethod
    def parse(cls, *, where: str = "policies", desire_pr: str = "", **groups: str) -> Policies:
        """Parse lists separated by commas. Raises ParameterError for wrong priorities, or more of them than groups."""
        priorities = tuple(_priority(word, where) for word in _words(desire_pr))
        found = cls(**{name: _words(text) for name, text in groups.items()}, desire_pr=priorities)
        if len(priorities) > len(found.desire_w):
            raise ParameterError(
                f"desire_pr has {len(priorities)} priorities for {len(found.desire_w)} groups of desire_w",
                where=where,
                remedy="give each group of desire_w one priority, in the same order",
            )
        return found

    def may(self, request: AgentRequest) -> Permission:
        """Check whether the group of the sender may make a request."""
        kind = "belief" if request.belief is not None else "desire"
        groups: tuple[str, ...] = getattr(self, f"{kind}_{'ck' if request.operation == 'check' else 'w'}")
        if request.group not in groups:
            verb = {"del": "delete", "bid": "bid for"}.get(request.operation, request.operation)
            allowed = f"these may: {', '.join(groups)}" if groups else "no group may"
            return Permission(False, f"group {request.group!r} may not {verb} {kind}s; {allowed}")
        if kind == "belief" or request.operation == "check":
            return Permission(True)
        return Permission(True, max_priority=(*self.desire_pr, *(0.0 for _ in groups))[groups.index(request.group)])


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _priority(word: str, where: str) -> float:
    try:
        return from_builtins(word, Priority, strict=False)
    except msgspec.ValidationError as error:
        what = f"desire_pr: {word!r} is no priority"
        raise ParameterError(what, where=where, remedy="give numbers from 0 to 1") from error


MAX_REMEMBERED = 1000
"""Number of answers and closed requests that are kept to detect duplicates."""

REPEAT_S = 0.5
"""Period (s) of sending a request without an answer; the receiver executes it once."""

MONITOR_S = 5.0
"""Period (s) of sending the request of a monitored desire, for a receiver that has restarted."""

AnswerState = Literal["waiting", "done", "refused", "fulfilled", "dropped", "timeout"]


@dataclass(eq=False)
class SentRequest:
    """A request and its answer so far.

    Attributes:
        state: ``waiting`` before the answer, ``timeout`` without one. A monitored desire later becomes ``fulfilled``
            or ``dropped``, or ``refused`` by a receiver that has restarted.
        found: Whether a checked item exists, or a deleted one existed.
        priority: Priority of the desire at the receiver.
        bid: Time (s) until the receiver would have achieved an offered desire.
        replied_at: Time (ns) of the latest reply.
    """

    request: AgentRequest
    state: AnswerState = "waiting"
    found: bool = False
    priority: float | None = None
    reason: str = ""
    bid: float | None = None
    replied_at: int = 0

    @property
    def accepted(self) -> bool:
        """Whether the receiver has executed the request, or adopted the desire."""
        return self.state in ("done", "fulfilled", "dropped")


@dataclass(eq=False)
class RequestClient:
    """Sends the requests of an agent by ``send``, and handles replies; ``refused`` counts unexpected replies."""

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
        timeout_s: float | None = None,
    ) -> SentRequest:
        """Ask another agent to check, add or delete a belief or a desire, or offer it a desire for a ``bid``.

        ``timeout_s`` (default: that of the client) is the time to wait for the answer.
        """
        self._count += 1
        now = self.engine.clock.now()
        request = AgentRequest(
            stamp=now,
            # The time makes it unique after a restart.
            id=f"{self.engine.name}-{now}-{self._count}",
            sender=self.engine.name,
            group=self.group,
            receiver=receiver,
            operation=operation,
            belief=belief,
            desire=desire,
            monitor=monitor,
        )
        sent = SentRequest(request)
        self._open[request.id] = sent
        self.engine.trace.record("request", text_of(request), cause, id=request.id)
        self._repeat(sent, now + nanoseconds(self.timeout_s if timeout_s is None else timeout_s))
        return sent

    def handle(self, reply: AgentReply) -> bool:
        """Process a reply; return False for an unknown request. Duplicates have no effect."""
        sent = self._open.get(reply.id)
        if sent is None or reply.sender != sent.request.receiver:
            if sent is not None or reply.id not in self._closed:
                self.refused += 1
                reason = "no open request has this id and receiver"
                self.engine.trace.record("refused", f"the reply {reply.id} of {reply.sender}", reply.id, reason=reason)
            return False
        before = sent.state, sent.found, sent.reason
        sent.replied_at, sent.bid = self.engine.clock.now(), reply.bid
        sent.state = reply.state if reply.accepted else "refused"
        sent.found, sent.priority, sent.reason = reply.found, reply.priority, reply.reason
        if not (sent.request.monitor and reply.accepted and reply.state == "done"):
            self.forget(sent)
        if (sent.state, sent.found, sent.reason) != before:
            self.engine.trace.record("reply", f"{reply.sender}: {sent.state}", reply.id, reason=reply.reason)
        return True

    def forget(self, sent: SentRequest) -> None:
        """Stop waiting for the reply to a request."""
        self._open.pop(sent.request.id, None)
        self._closed[sent.request.id] = None
        if len(self._closed) > MAX_REMEMBERED:
            self._closed.popitem(last=False)

    def _repeat(self, sent: SentRequest, deadline: int, reminds: bool = False) -> None:
        """Send a request repeatedly until its answer or the deadline (ns), and then as long as it is monitored."""
        if self._open.get(sent.request.id) is not sent:
            return
        now = self.engine.clock.now()
        if sent.state != "waiting":
            if reminds:
                self.send(sent.request)
            self.engine.timers.after(MONITOR_S, lambda: self._repeat(sent, deadline, True))
        elif now < deadline:
            self.send(sent.request)
            self.engine.timers.at(min(now + nanoseconds(REPEAT_S), deadline), lambda: self._repeat(sent, deadline))
        else:
            sent.state = "timeout"
            waited_s = (now - sent.request.stamp) / SECOND
            sent.reason = f"no answer from {sent.request.receiver} in {waited_s:g} s"
            self.forget(sent)
            self.engine.trace.record("reply", f"{sent.request.receiver}: timeout", sent.request.id, reason=sent.reason)


def text_of(request: AgentRequest) -> str:
    """Return a request as text for the trace."""
    about = request.belief if request.belief is not None else request.desire and request.desire.name
    kind = "belief" if request.belief is not None else "desire"
    what = f"{'bid for' if request.operation == 'bid' else request.operation} {kind} {about}"
    return f"{request.sender} asks {request.receiver} to {what}"


class RequestServer:
    """Answers requests to an agent by ``send``; duplicates get the same answer without being executed again."""

    def __init__(self, deliberator: Deliberator, policies: Policies, send: Callable[[AgentReply], object]) -> None:
        self._deliberator = deliberator
        self._policies = policies
        self._send = send
        self._answers: OrderedDict[tuple[str, str], AgentReply] = OrderedDict()
        self._bidding: set[tuple[str, str]] = set()

    def handle(self, request: AgentRequest) -> None:
        """Answer a request if this agent is its receiver."""
        engine = self._deliberator.engine
        if request.receiver != engine.name:
            return
        key = (request.sender, request.id)
        if key in self._bidding:
            return
        answer = self._answers.get(key)
        if answer is None:
            engine.trace.record("asked", text_of(request), request.id, group=request.group)
            answer = self._answer(request)
            if answer is None:
                self._bid(request, key)
                return
            if not answer.accepted:
                engine.trace.record("refused", text_of(request), request.id, reason=answer.reason)
        self._remember(key, answer)
        self._send(answer)

    def _bid(self, request: AgentRequest, key: tuple[str, str]) -> None:
        """Answer with the estimate for a desire as soon as there is one."""
        assert request.desire is not None
        priority = min(request.desire.priority, self._policies.may(request).max_priority)
        self._bidding.add(key)

        def on_bid(bid: Bid) -> None:
            self._bidding.discard(key)
            answer = self._reply(request, found=bid.seconds is not None, bid=bid.seconds, reason=bid.reason)
            self._remember(key, answer)
            self._send(answer)

        make_bid(self._deliberator, msgspec.structs.replace(request.desire, priority=priority), on_bid)

    def _remember(self, key: tuple[str, str], answer: AgentReply) -> None:
        self._answers[key] = answer
        self._answers.move_to_end(key)
        if len(self._answers) > MAX_REMEMBERED:
            self._answers.popitem(last=False)

    def _answer(self, request: AgentRequest) -> AgentReply | None:
        """Execute a request and return its answer; None for the offer of a desire, which is answered later."""
        if request.sender in OWN_SOURCES:
            return self._refuse(request, f"no agent can be named {request.sender}")
        if (request.belief is None) == (request.desire is None):
            return self._refuse(request, "it has to name a belief or a desire")
        if request.operation == "bid" and request.desire is None:
            return self._refuse(request, "only a desire can be offered")
        permission = self._policies.may(request)
        if not permission.granted:
            return self._refuse(request, permission.reason)
        if request.belief is not None:
            return self._about_belief(request, request.belief)
        assert request.desire is not None
        if request.operation == "bid":
            reason = self._deliberator.objection(request.desire)
            return self._refuse(request, reason) if reason else None
        return self._about_desire(request, request.desire, permission.max_priority)

    def _about_belief(self, request: AgentRequest, belief: Fact) -> AgentReply:
        facts = self._deliberator.facts
        misfit = facts.unfit(belief)
        if misfit:
            return self._refuse(request, misfit)
        if request.operation == "check":
            return self._reply(request, found=facts.current(belief) == belief)
        if request.operation == "add":
            facts.add(belief, source=request.sender, cause=request.id)
        else:
            return self._reply(request, found=bool(facts.remove(belief, request.id)))
        return self._reply(request, found=True)

    def _about_desire(self, request: AgentRequest, desire: Desire, max_priority: float) -> AgentReply:
        deliberator = self._deliberator
        if request.operation == "check":
            return self._reply(request, found=desire.name in deliberator.desires)
        if request.operation == "del":
            return self._reply(
                request, found=deliberator.drop(desire.name, f"{request.sender} asked for it", cause=request.id)
            )
        reason = deliberator.objection(desire)
        if reason:
            return self._refuse(request, reason)
        priority = min(desire.priority, max_priority)
        if deliberator.facts.fulfilled(desire):
            return self._reply(request, state="fulfilled", found=True, priority=priority)
        reason = deliberator.desire(
            msgspec.structs.replace(desire, priority=priority),
            cause=request.id,
            listener=self._monitor(request) if request.monitor else None,
        )
        return self._refuse(request, reason) if reason else self._reply(request, found=True, priority=priority)

    def _monitor(self, request: AgentRequest) -> Callable[[End, str], None]:
        """Return a listener that sends the end of a desire, now and for duplicates of the request."""

        def listener(how: End, reason: str) -> None:
            answer = self._reply(request, state=how, found=how == "fulfilled", reason=reason)
            self._remember((request.sender, request.id), answer)
            self._send(answer)

        return listener

    def _refuse(self, request: AgentRequest, reason: str) -> AgentReply:
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
