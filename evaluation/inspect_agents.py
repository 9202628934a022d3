"""Agents of `evaluation.inspect`, which decide something every second."""

from __future__ import annotations

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Engine
from socialbot.core.messages import ActionRequest, Mind, TraceRecord
from socialbot.graph.ports import Delivery, Output

PROGRAM = """
at(0).
!walk.
+!walk <- ?at(X); -+at((X + 1) mod 10); !look(X); .wait(1000); !walk.
+!look(X) : X > 5 <- +seen(X).
+!look(X) <- -seen(_).
+!look(_).
"""


class Walker(AgentNode):
    """Agent that walks in a circle and notes its percepts."""

    actions = Output(ActionRequest, "~/actions")
    mind = Output(Mind, "~/mind", Delivery.LATCHED)
    trace = Output(TraceRecord, "~/trace")

    def build(self) -> Engine:
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_text(PROGRAM)
        return engine
