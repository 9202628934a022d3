"""Requests of other agents: whether they may ask for that, and what is done about it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import msgspec

from socialbot.agent_messages import AgentReply, AgentRequest, Desire, Fact
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.desires import End
from socialbot.deliberation.policies import Policies
from socialbot.deliberation.requests import REMEMBERED, text_of


class Reception:
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
