"""One robot or nurse without a world and a coordinator, which the test plays."""

from __future__ import annotations

import itertools

from socialbot.agents.hospital.robot_node import Spot
from socialbot.agents.hospital.ward.messages import MESSAGES, RESULTS, STATE, AgentState, WardState
from socialbot.agents.teams.messages import AclMessage, ActionResult, Belief, Performative, Plan, Start
from socialbot.bdi.agentspeak.parser import parse_literal
from socialbot.graph.node import Graph, NodeConfig
from tests.agents.hospital.listings import NURSE, ROOM, SPOT, UVD
from tests.agents.hospital.watched import Watched

CONSTANTS = (NURSE, ROOM, SPOT, UVD)


class Alone(Watched):
    """The node ``name``, and its messages."""

    def __init__(
        self, kind: type = Spot, name: str = SPOT, *, topics: tuple[str, ...] = (), start: int = 0, **parameters
    ) -> None:
        self.name = name
        self.numbers = itertools.count()
        inputs = frozenset({MESSAGES, RESULTS, STATE, *topics})
        super().__init__(Graph("alone", (NodeConfig(name, kind, parameters),), inputs=inputs), start=start)
        self.engine = self.runner.nodes[name].engine  # type: ignore[attr-defined]

    def observe(self, topic: str, message) -> None:
        if not isinstance(message, AclMessage) or message.sender == self.name:
            super().observe(topic, message)

    @property
    def now(self) -> int:
        return self.runner.clock.now()

    def tell(
        self, content, *, sender="coordinator", performative: Performative = "inform", mission="mission_1_1"
    ) -> AclMessage:
        message = AclMessage(
            stamp=self.now, id=f"m{next(self.numbers)}", sender=sender, receiver=self.name, performative=performative,
            content=content, mission=mission,
        )  # fmt: skip
        self.receive(message)
        return message

    def receive(self, message: AclMessage) -> None:
        self.runner.feed(MESSAGES, message)
        assert self.runner.faults[self.name].failures == 0, self.runner.faults[self.name].first

    def take_on(self, *plans: str, label: str = "mission_1_1") -> None:
        """Send it plans, and their start."""
        texts = tuple(f"@{label}_{number} {text}" for number, text in enumerate(plans))
        self.tell(Plan(label, texts), mission=label)
        self.tell(Start(CONSTANTS), performative="request", mission=label)

    def answer(self, outcome, reason: str = "") -> None:
        """Send the result of its latest command."""
        last = self.commands[-1]
        result = ActionResult(
            stamp=self.now, id=last.id, robot=last.robot, action=last.action, args=last.args, outcome=outcome,
            reason=reason,
        )  # fmt: skip
        self.runner.feed(RESULTS, result)

    def see(self, place: str, battery: float = 1.0) -> None:
        agent = AgentState(
            name=self.name, kind="x", home="room4", place=place, inside=True, x=0.0, y=0.0, battery=battery
        )
        self.runner.feed(STATE, WardState(stamp=self.now, rooms=(), agents=(agent,)))

    def beliefs_sent(self) -> list[tuple[str, str]]:
        return [
            (message.receiver, message.content.literal) for message in self.said if isinstance(message.content, Belief)
        ]

    def done(self) -> list[str]:
        return [command.action for command in self.commands]

    def believes(self, text: str) -> bool:
        return any(held.belief == parse_literal(text) for held in self.engine.beliefs)
