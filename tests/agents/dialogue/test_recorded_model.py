"""A bag is replayed with the answers that a language model gave in a recorded run."""

from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.agents.dialogue import model_from_environment
from socialbot.agents.dialogue.language_model import RUN, URL
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import HeardSpeech
from tests.agents.dialogue.model_server import serving, streamed
from tests.system.running import socialbot_here

HEARD = "/humans/voices/speech"
GRAPH = """
name: guide
inputs: [/humans/voices/speech]
nodes:
  guide: {type: "GUIDE:Guide"}
"""
GUIDE = '''
"""Guide who asks a language model for a plan, and adopts it."""

from socialbot import Action, AgentNode, Belief, Engine, Input, Sensor, variables
from socialbot.agents.dialogue import Proposals, Whitelist, adopt, model_from_environment, proposed
from socialbot.core.messages import HeardSpeech

(Request, Record) = variables("Request Record")
TOURS = Whitelist(goals={"tour": 1}, actions={"wave": 0}, beliefs={})


class wish(Belief):
    """A person wants this."""


class consult(Action):
    """Ask the model for plans, and follow them once they are adopted."""

    def execute(self, request: str) -> None:
        found = self.engine.robot.proposals.plan(request, TOURS, cause=self.id)
        if found.value is not None:
            self.engine.believe(proposed(found.record), source="model", cause=found.record)


class begin(Action):
    """Want the tour."""

    def execute(self) -> None:
        self.engine.add_text("!tour(ann).")


class wave(Action):
    """Wave."""

    def execute(self) -> None: ...


class Ears(Sensor):
    """Turn speech into wishes."""

    def sense(self, percept: HeardSpeech):
        return [+wish(percept.text)]


class Guide(AgentNode):
    """Guide."""

    speech = Input(HeardSpeech, "/humans/voices/speech")

    def build(self) -> Engine:
        engine = Engine("guide", self.clock, robot=self, sink=self.record, wake=self.wake)
        self.proposals = Proposals(model_from_environment(), engine.trace.record)
        self.ears = Ears()
        engine.add_sensor(self.ears)
        engine.add_action(wave)
        engine.add_rules(+wish(Request) >> [consult(Request)], +proposed(Record) >> [adopt(Record), begin()])
        return engine

    @speech
    def on_speech(self, message: HeardSpeech) -> None:
        self.ears.push(message)
'''


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "bag") as writer:
        for second in (1, 2):
            stamp = second * SECOND
            text = f"Show me floor {second}."
            writer.write(HEARD, HeardSpeech(stamp=stamp, start=stamp - SECOND // 2, text=text, language="en"), stamp)
    return tmp_path / "bag"


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    module = f"guide_{abs(hash(request.node.name))}"  # a module of its own for each test
    (tmp_path / f"{module}.py").write_text(GUIDE)
    monkeypatch.syspath_prepend(tmp_path)
    for name in (URL, RUN, "SOCIALBOT_LLM_MODEL"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "guide.yaml").write_text(GRAPH.replace("GUIDE", module))
    return tmp_path / "guide.yaml"


def replay(bag: Path, graph: Path, out: Path, *more: object) -> list[str]:
    done = socialbot_here("replay", bag, "--graph", graph, "--no-video", "--out", out, *more)
    assert done.returncode == 0, done.stdout + done.stderr
    return (out / "trace.jsonl").read_text().splitlines()


def test_a_bag_with_the_answers_of_a_run_gives_an_equal_trace(bag, graph, tmp_path, monkeypatch):
    with serving(streamed("+!tour(X) <- wave.")) as (server, url):
        monkeypatch.setenv(URL, url)
        monkeypatch.setenv("SOCIALBOT_LLM_MODEL", "small")
        first = replay(bag, graph, tmp_path / "first")
        asked = len(server.requests)
    monkeypatch.delenv(URL)
    without = replay(bag, graph, tmp_path / "without")
    monkeypatch.setenv(RUN, str(tmp_path / "first"))
    again = replay(bag, graph, tmp_path / "again")
    assert asked == 2
    assert sum('"wave()"' in each for each in first) == 2
    assert again == first
    assert not any('"wave()"' in each for each in without)


def test_only_a_run_with_answers_is_taken(tmp_path):
    with pytest.raises(ParameterError, match="has no answers of a model"):
        model_from_environment({RUN: str(empty_run(tmp_path))})
    with pytest.raises(ParameterError, match="both set"):
        model_from_environment({RUN: "run", URL: "https://example.org/v1", "SOCIALBOT_LLM_MODEL": "m"})


def empty_run(folder: Path) -> Path:
    run = folder / "empty"
    run.mkdir()
    (run / "trace.jsonl").write_text("")
    (run / "results.json").write_text("{}")
    return run
