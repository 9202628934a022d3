"""Questions by the ask skill, in simulated time."""

# ruff: noqa: N801 - beliefs and goals are written like literals

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot import ActionServer, Engine, Goal, GoalHandle, Graph, Node, NodeConfig, SingletonBelief, variables
from socialbot.bdi import error
from socialbot.robots.asking import AskingAgent, ask
from socialbot.testing import GraphTester

(Why,) = variables("Why")


class serve(Goal): ...


class failed(SingletonBelief): ...


class Host(AskingAgent):
    """Asks for a drink."""

    within_s = 20.0

    def build(self) -> Engine:
        engine = Engine("host", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_rules(
            serve() >> [ask("What would you like to drink?", '{"drink": "string"}', "p1").within(self.within_s)],
            -serve()[error(Why)] >> [+failed(Why)],
        )
        return engine


class Skill(Node):
    """Stands in for the skill, and answers what the test says."""

    asked = ActionServer("communication_skills/action/Ask", "/skill/ask")
    answers: str | None = "{}"
    code = 0
    goal: Any = None

    @asked
    def on_goal(self, goal: GoalHandle) -> None:
        self.goal = goal.request
        if self.answers is not None:
            result = SimpleNamespace(error_code=self.code, error_msg="nobody is there" if self.code else "")
            self.call_after(1.0, lambda: goal.succeed(SimpleNamespace(result=result, answers=self.answers)))


def asked(answers: str | None, code: int = 0) -> tuple[list[str], Any]:
    """Beliefs of the host after the skill has answered, and the goal that it got."""
    with GraphTester(Graph("host", (NodeConfig("host", Host), NodeConfig("skill", Skill)))) as graph:
        skill = graph.node("skill")
        skill.answers, skill.code = answers, code
        graph.node("host").engine.achieve(serve())
        graph.run(30.0)
        return sorted(str(held.belief) for held in graph.node("host").engine.beliefs), skill.goal


@pytest.fixture(autouse=True)
def without_ros_types(monkeypatch):
    """The stand-in answers with plain objects, whether or not the types are installed."""
    monkeypatch.setattr("socialbot.graph.calls.installed_class", lambda name: None)


def test_answers_become_beliefs():
    beliefs, goal = asked('{"drink": "tea", "sugar": 2, "milk": true, "with": ["lemon"]}')
    assert beliefs == [
        'answered("drink", "tea")',
        'answered("milk", "true")',
        'answered("sugar", 2)',
        'answered("with", "[\\"lemon\\"]")',
    ]
    assert (goal.question, goal.answers_schema, goal.person_id) == (
        "What would you like to drink?",
        '{"drink": "string"}',
        "p1",
    )
    assert (goal.meta.caller, goal.meta.priority) == ("host", 128)


@pytest.mark.parametrize(
    ("answers", "code", "why"),
    [
        ("{}", 3, "refused"),
        ("tea", 0, "not_understood"),
        ("[1]", 0, "not_understood"),
        (None, 0, "timeout"),
        ('{"sugar": NaN}', 0, "not_understood"),
        ('{"sugar": 1e999}', 0, "not_understood"),
        ('{"sugar": "\\ud800"}', 0, "not_understood"),
        ("[" * 100_000, 0, "not_understood"),
        (json.dumps(dict.fromkeys(map(str, range(2000)), 1)), 0, "not_understood"),
    ],
)
def test_a_question_that_fails_has_a_reason(answers, code, why):
    assert asked(answers, code)[0] == [f'failed("{why}")']
