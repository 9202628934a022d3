"""Commands of users to agents of each kind."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.base.deliberating import Deliberating
from socialbot.agents.hospital.robot_node import Spot
from socialbot.agents.hospital.ward.messages import MESSAGES, RESULTS, STATE
from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.bdi import Engine
from socialbot.bdi.compiler._source import Unit
from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    AGENT_ANSWERS,
    AGENT_COMMANDS,
    ActionRequest,
    AgentAnswer,
    AgentCommand,
    Command,
    Health,
    PersonDetection,
    PersonDetections,
    TraceRecord,
)
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import PREDICATE, Desire, Fact
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph, NodeConfig
from tests.deliberation.office import JOBS
from tests.inline import InlineRun

DETECTIONS = "/humans/bodies/detections"

PROGRAM = """
count(0).
+!go(0).
+!go(N) <- .my_name(Me); step(N); ?count(C); -+count(C + N); !go(N - 1).
+count(C) : C > 3 <- many(C); .wait(50); later(C).
+news(X) <- heard(X).
"""


def deed(node: Counter, name: str):
    def do(engine: Engine, *args: object) -> None:
        node.did.append((name, args))

    return do


class Counter(AgentNode):
    """Counts, in AgentSpeak."""

    def build(self) -> Engine:
        self.did: list[tuple[str, tuple[object, ...]]] = []
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        for name in ("step", "many", "heard", "later"):
            engine.add_action(deed(self, name), name)
        engine.add_text(PROGRAM)
        return engine


class Asking(InlineRun):
    """One agent, and a person who asks it for something."""

    def __init__(self, config: NodeConfig, *topics: str) -> None:
        self.name = config.name
        self.asked = 0
        self.health: list[Health] = []
        graph = Graph("room", (config,), inputs=frozenset(topics))
        super().__init__(graph)
        self.runner.tap(HEALTH_TOPIC, lambda _, health: self.health.append(health))  # type: ignore[arg-type]

    @property
    def trace(self) -> list[TraceRecord]:
        return self.of(TraceRecord)

    def ask(self, command: Command, text: str = "", agent: str = "") -> AgentAnswer:
        self.asked += 1
        asked = AgentCommand(
            stamp=self.clock.now(),
            id=f"person-{self.asked}",
            agent=agent or self.name,
            command=command,
            text=text,
        )
        self.send(AGENT_COMMANDS, asked)
        return self.messages(AGENT_ANSWERS)[-1]

    def refused(self, command: Command, text: str = "") -> str:
        answer = self.ask(command, text)
        assert not answer.accepted
        record = self.trace[-1]
        assert (record.kind, record.what, record.cause) == ("refused", f"{command} {text}".strip(), answer.id)
        assert record.detail["reason"] == answer.reason
        return answer.reason

    def told(self, kind: str) -> list[str]:
        return [record.what for record in self.trace if record.kind == kind]

    def cause(self, record: TraceRecord) -> TraceRecord:
        return next(each for each in self.trace if each.id == record.cause)


def counter() -> Asking:
    return Asking(NodeConfig("counter", Counter))


def waldo() -> Asking:
    return Asking(NodeConfig("waldo", WaldoNode), DETECTIONS)


def did(asking: Asking) -> list[tuple[str, tuple[object, ...]]]:
    node = asking.node(asking.name)
    assert isinstance(node, Counter)
    return node.did


def test_belief_of_a_user_has_source_and_cause():
    asking = counter()
    assert asking.ask("believe", "news(1)").accepted
    assert did(asking) == [("heard", (1,))]
    belief = next(record for record in asking.trace if record.what == "news(1)")
    assert belief.detail["source"] == "person"
    assert (asking.cause(belief).kind, asking.cause(belief).what) == ("command", "believe news(1)")
    assert asking.cause(belief).cause == "person-1"


def test_belief_is_removed():
    asking = counter()
    asking.ask("believe", "news(1)")
    asking.ask("believe", "news(2)")
    assert asking.ask("forget", "news(2)").accepted
    assert asking.told("unbelief") == ["news(2)"]
    assert asking.ask("forget", "news(_)").accepted
    assert asking.told("unbelief") == ["news(2)", "news(1)"]


def test_goal_is_adopted_and_dropped():
    asking = counter()
    assert asking.ask("achieve", "go(2)").accepted
    assert did(asking) == [("step", (2,)), ("step", (1,))]
    asking.ask("pause")
    asking.ask("achieve", "go(3)")
    asking.ask("step")
    assert asking.ask("drop", "go(_)").accepted
    asking.ask("resume")
    assert ("step", (1,)) not in did(asking)[3:]


@pytest.mark.parametrize(
    ("command", "text", "reason"),
    [
        ("believe", "news(", "expected a term, found the end of the text"),
        ("believe", "news(X)", "news(X) has a variable or a computed value: write values"),
        ("forget", "news(7)", "it believes nothing like news(7)"),
        ("forget", "count(7)", "it does not believe count(7)"),
        ("achieve", "fly(1)", "it has no plan for fly(1); it has some for go/1"),
        ("drop", "go(1)", "it does not want go(1)"),
        ("resume", "", "it is not paused"),
        ("step", "", "it is not paused"),
    ],
)
def test_impossible_command_is_refused_with_reason(command, text, reason):
    assert counter().refused(command, text) == reason


def test_command_for_another_agent_is_ignored():
    asking = counter()
    asking.ask("pause")
    asking.ask("believe", "news(1)", agent="somebody_else")
    assert [answer.id for answer in asking.messages(AGENT_ANSWERS)] == ["person-1"]


def test_paused_agent_accepts_messages_and_does_not_act():
    asking = counter()
    assert asking.ask("pause").accepted
    assert asking.refused("pause") == "it is paused already"
    asking.ask("believe", "news(1)")
    asking.ask("achieve", "go(3)")
    asking.run(10)
    assert did(asking) == []
    assert asking.ask("resume").accepted
    assert ("heard", (1,)) in did(asking)
    assert ("step", (3,)) in did(asking)


def test_timers_wait_during_a_pause():
    asking = counter()
    asking.ask("achieve", "go(4)")
    asking.ask("pause")
    asking.run(1)
    assert "later" not in dict(did(asking))
    asking.ask("resume")
    assert ("later", (4,)) in did(asking)


def test_pause_is_reported_as_health():
    asking = counter()
    asking.ask("pause")
    asking.run(2)
    assert (asking.health[-1].state, asking.health[-1].reason) == ("paused", "paused by a person")
    asking.ask("resume")
    asking.run(2)
    assert (asking.health[-1].state, asking.health[-1].reason) == ("ok", "")
    assert asking.told("command") == ["pause", "resume"]


@settings(max_examples=60, deadline=None)
@given(
    goals=st.lists(st.integers(1, 4), min_size=1, max_size=3),
    steps=st.lists(st.integers(0, 6), min_size=1, max_size=5),
)
def test_pauses_and_steps_do_not_change_the_actions(goals, steps):
    straight, halting = counter(), counter()
    for asking in (straight, halting):
        asking.ask("pause")
        for number in goals:
            asking.ask("achieve", f"go({number})")
    straight.ask("resume")
    for count in steps:
        for _ in range(count):
            halting.ask("step")
        halting.ask("resume")
        halting.ask("pause")
    halting.ask("resume")
    straight.run(1)
    halting.run(1)
    assert did(halting) == did(straight)
    assert halting.told("goal") == straight.told("goal")


def test_waldo_greets_on_command_and_pauses():
    asking = waldo()
    assert asking.ask("achieve", "GreetPeople()").accepted
    assert [action.name for action in asking.of(ActionRequest)] == ["speak"]
    assert "it has some for" in asking.refused("achieve", "Dance()")
    asking.ask("pause")
    seen = (PersonDetection(x=0, y=0, w=9, h=30, score=1.0, distance_m=2.0),)
    for tenth in range(30):
        shown = PersonDetections(stamp=tenth * SECOND // 10, frame_id="camera", width=640, height=480, persons=seen)
        asking.send(DETECTIONS, shown)
    assert len(asking.of(ActionRequest)) == 1
    assert 'personDetected("Yes")' not in asking.told("belief")
    assert asking.ask("believe", 'personDetected("No")').accepted
    asking.ask("resume")
    assert 'personDetected("Yes")' in asking.told("belief")


def test_first_percepts_compile_nothing(monkeypatch):
    asking, compiled = waldo(), []
    monkeypatch.setattr(Unit, "build", lambda unit: compiled.append(unit.title))
    seen = (PersonDetection(x=0, y=0, w=9, h=30, score=1.0, distance_m=2.0),)
    for tenth in range(30):
        shown = PersonDetections(stamp=tenth * SECOND // 10, frame_id="camera", width=640, height=480, persons=seen)
        asking.send(DETECTIONS, shown)
    assert [action.name for action in asking.of(ActionRequest)] != []
    assert compiled == []


class do(PlanAction):  # noqa: N801 - named like the action of the domain
    """Does a job, in two seconds."""

    rate_hz = 1.0

    def begin(self, *args: str) -> None:
        self.begun = self.engine.clock.now()

    def advance(self) -> float:
        return (self.engine.clock.now() - self.begun) / SECOND / 2.0


class Worker(Deliberating):
    actions_known = (do,)


@pytest.fixture
def worker(tmp_path: Path) -> Asking:
    (tmp_path / "jobs.pddl").write_text(JOBS.text)
    (tmp_path / "b.yaml").write_text("- {name: a, pddl_type: 1, type: job}\n")
    parameters = {"pddl_file": str(tmp_path / "jobs.pddl"), "init_bset": str(tmp_path / "b.yaml")}
    return Asking(NodeConfig("worker", Worker, parameters), "/agents/requests", "/agents/replies")


def test_deliberating_agent_accepts_facts_and_desires(worker):
    assert worker.ask("believe", "b - job").accepted
    assert worker.ask("achieve", "(done b)").accepted
    worker.run(10)
    assert worker.told("desire_fulfilled") == ["(done b)"]
    desire = next(record for record in worker.trace if record.kind == "desire")
    assert worker.cause(desire).what == "achieve (done b)"
    assert worker.refused("achieve", "(done b)") == "its target holds already"
    assert worker.ask("forget", "(done b)").accepted
    assert "done(b)" in " ".join(worker.told("unbelief"))


def test_desire_as_json_is_adopted_and_dropped_by_name(worker):
    wanted = Desire(name="tidy", value=(Fact(name="done", pddl_type=PREDICATE, params=("a",)),), priority=0.9)
    assert worker.ask("achieve", msgspec.json.encode(wanted).decode()).accepted
    assert worker.ask("drop", "tidy").accepted
    assert worker.told("desire_dropped") == ["tidy"]


@pytest.mark.parametrize(
    ("command", "text", "reason"),
    [
        ("believe", "done a", "is no fact"),
        ("believe", "(flies a)", "flies"),
        ("believe", "(done a) (done b)", "more than one fact"),
        ("forget", "(done a)", "it does not believe (done a)"),
        ("achieve", '{"name": 1}', "invalid desire"),
        ("achieve", "(flies a)", "flies"),
        ("drop", "tidy", "it has no desire 'tidy'; it desires nothing"),
    ],
)
def test_deliberating_agent_refuses_with_reason(worker, command, text, reason):
    assert reason in worker.refused(command, text)


def test_paused_agent_does_not_continue_its_plan(worker):
    worker.ask("achieve", "(done a)")
    worker.run(1)
    worker.ask("pause")
    worker.run(20)
    assert worker.told("desire_fulfilled") == []
    worker.ask("resume")
    worker.run(5)
    assert worker.told("desire_fulfilled") == ["(done a)"]


def test_hospital_robot_accepts_commands():
    asking = Asking(NodeConfig("spot1", Spot), MESSAGES, RESULTS, STATE)
    assert asking.ask("believe", "start(m1)").accepted
    assert "start(m1)" in asking.told("belief")
    assert "it has" in asking.refused("achieve", "dance(1)")
    assert asking.ask("pause").accepted
    assert asking.ask("step").accepted
    assert asking.ask("resume").accepted
