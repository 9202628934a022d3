"""What people ask of agents, taken to them over ROS and answered: sealed where keys are set, like any command."""

from __future__ import annotations

import asyncio
import secrets
from typing import Any

from socialbot.agents.base.agent_node import AGENT_ANSWERS, AGENT_COMMANDS
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.qos import publisher_qos, subscription_qos
from socialbot.bridge.transport import reason_of, wire
from socialbot.core.clock import WallClock
from socialbot.core.errors import MessageError
from socialbot.core.messages import AgentAnswer, AgentCommand, Command, Health
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Delivery, WireForm

ANSWER_WITHIN_S = 3.0

AT_ODDS = {
    "sealed": f"the graph has keys and the inspector has none (set {KEYS_VARIABLE}, see docs/security.md)",
    "unsealed": "the inspector has a key and the graph has none",
    "unknown sender": "the inspector does not know the key of the graph",
}
"""By the reason why nothing that a graph says can be read: why it would not listen either."""


class RosOffice:
    """Takes commands to agents by ``ros``, a node that spins; messages have the ``form`` of the graph.

    It is shut as long as it can read nothing of what the nodes say of their health. Raises what `wire` does.
    """

    def __init__(self, ros: Any, form: WireForm = "json") -> None:
        self.shut = ""
        self._understands = False
        self._wire = wire(form=form)
        self._clock = WallClock()
        self._waiting: dict[str, tuple[asyncio.AbstractEventLoop, asyncio.Future[AgentAnswer]]] = {}
        self._outlet = self._wire.outlet(
            ros.create_publisher(self._wire.message_class(AgentCommand), AGENT_COMMANDS, publisher_qos(Delivery.EVERY))
        )
        self._inlet = self._wire.inlet(AGENT_ANSWERS)
        ros.create_subscription(
            self._wire.message_class(AgentAnswer),
            AGENT_ANSWERS,
            self._hear,
            subscription_qos(Delivery.EVERY, outside=False),
        )
        self._health = self._wire.inlet(HEALTH_TOPIC)
        ros.create_subscription(
            self._wire.message_class(Health),
            HEALTH_TOPIC,
            self._try_to_read,
            subscription_qos(Delivery.EVERY, outside=False),
        )

    async def ask(self, agent: str, command: Command, text: str) -> AgentAnswer | None:
        """Asks an agent for something; None when it does not answer in time."""
        loop = asyncio.get_running_loop()
        id = f"person-{secrets.token_hex(4)}"
        answer: asyncio.Future[AgentAnswer] = loop.create_future()
        self._waiting[id] = loop, answer
        asked = AgentCommand(stamp=self._clock.now(), id=id, agent=agent, command=command, text=text)
        try:
            await loop.run_in_executor(None, self._outlet.publish, asked)
            return await asyncio.wait_for(answer, ANSWER_WITHIN_S)
        except asyncio.TimeoutError:
            return None
        finally:
            del self._waiting[id]

    def _hear(self, ros_message: Any) -> None:
        try:
            answer = self._inlet.decode(AgentAnswer, ros_message)
        except MessageError:
            return  # it is logged by those who answer for the graph
        if answer is not None and (waiting := self._waiting.get(answer.id)) is not None:
            loop, future = waiting
            loop.call_soon_threadsafe(_settle, future, answer)

    def _try_to_read(self, ros_message: Any) -> None:
        if self._understands:  # whatever strangers say then
            return
        try:
            self._health.decode(Health, ros_message)
        except MessageError as error:
            self.shut = AT_ODDS.get(reason_of(error), self.shut)
        else:
            self._understands, self.shut = True, ""


def _settle(future: asyncio.Future[AgentAnswer], answer: AgentAnswer) -> None:
    if not future.done():
        future.set_result(answer)
