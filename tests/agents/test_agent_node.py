"""Nodes that host an engine."""

from __future__ import annotations

import pytest

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Engine
from socialbot.core.errors import GraphError
from socialbot.testing import GraphTester


class Forgetful(AgentNode):
    """Builds an engine, but does not return it."""

    def build(self) -> Engine:
        Engine("forgetful", self.clock, robot=self, sink=self.record, wake=self.wake)
        return None  # type: ignore[return-value]


def test_an_engine_that_build_does_not_return_is_missed():
    with pytest.raises(GraphError, match=r"node: Forgetful\.build returns None, which is no engine") as caught:
        GraphTester(Forgetful)
    assert "return engine" in str(caught.value.remedy)
