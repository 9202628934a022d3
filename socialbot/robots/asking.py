"""Questions to people by the ask skill of ROS4HRI, as an action of an agent.

::

    class Host(AskingAgent):
        def build(self) -> Engine:
            engine = Engine("host", self.clock, robot=self, sink=self.record, wake=self.wake)
            engine.add_rules(
                serve() >> [ask("What would you like to drink?", '{"drink": "string"}').within(20)],
                +answered("drink", What) >> [bring(What)],
                -serve()[error(Why)] >> [apologize(Why)],
            )
            return engine
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.base.ros_action import RosAction
from socialbot.bdi import Belief, Failed
from socialbot.bdi.sensors import Sensed
from socialbot.core import limits
from socialbot.core.decoding import from_json
from socialbot.core.messages import NO_JSON
from socialbot.graph.services import ActionClient

NORMAL_PRIORITY = 128
"""Priority of a skill among 0 to 255."""


class answered(Belief):
    """A person answered a question: name of the answer, and its value as text or number."""


class AskingAgent(AgentNode):
    """Agent that asks people by the robot's skill (communication_skills/action/Ask)."""

    asking = ActionClient("communication_skills/action/Ask", "/skill/ask")


class ask(RosAction):
    """Ask people a question, and believe the answers.

    ``schema`` is the JSON schema of the answers that the skill expects; empty for any. ``person`` is the ROS4HRI id of
    the person to ask; empty for anybody. The action fails with ``error("refused")`` if the skill reports an error, and
    with ``error("not_understood")`` if the answers are no JSON object, or longer than a sentence may be.
    """

    client = "asking"

    def goal(self, question: str, schema: str = "{}", person: str = "") -> Any:
        meta = {"caller": self.engine.robot.name, "priority": NORMAL_PRIORITY}
        return {"meta": meta, "question": question, "answers_schema": schema, "person_id": person}

    def result(self, result: Any) -> Sensed:
        outcome = getattr(result, "result", None)
        if code := getattr(outcome, "error_code", 0):
            raise Failed("refused", getattr(outcome, "error_msg", "") or f"error {code} of the skill")
        if len(result.answers) > limits.SENTENCE_CHARACTERS:
            most = limits.SENTENCE_CHARACTERS
            raise Failed("not_understood", f"the answers have {len(result.answers)} characters, more than {most}")
        try:
            answers = from_json(result.answers.encode(), Any)
        except NO_JSON as error:
            raise Failed("not_understood", f"the answers are no JSON: {error}") from error
        if not isinstance(answers, Mapping):
            raise Failed("not_understood", f"the answers are no JSON object: {result.answers!r}")
        return [+answered(str(name), _value(value)) for name, value in answers.items()]


def _value(value: Any) -> str | int | float:
    return value if isinstance(value, (str, int, float)) and not isinstance(value, bool) else json.dumps(value)
