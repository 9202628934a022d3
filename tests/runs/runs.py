"""Small runs, recorded by the real parts: Waldo, who sees somebody come; and agents with plans, written by hand."""

from __future__ import annotations

from pathlib import Path

from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    AGENT_ANSWERS,
    AGENT_COMMANDS,
    AgentAnswer,
    AgentCommand,
    Command,
    Message,
    PersonDetection,
    PersonDetections,
    Utterance,
)
from socialbot.graph.files import load_graph, parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.record import RunRecord, RunTrace
from socialbot.runs.run import LiveRun
from socialbot.runtime.run import observed_topics, with_speech_files

START = 1_700_000_000 * SECOND


DETECTED = """
name: waldo
inputs: [/humans/bodies/detections]
nodes:
  bdi_engine: {type: waldo, parameters: {forget_after_s: 30.0}}
  listener: {type: listener}
  speech: {type: speaker, parameters: {playback: 'off'}}
  head: {type: head}
"""
"""Waldo without a camera that he could miss."""


def frame(tenth: int, *distances_m: float) -> PersonDetections:
    """Return the detections ``tenth`` tenths of a second after the start."""
    persons = tuple(
        PersonDetection(x=100.0 * n, y=50, w=80, h=200, score=0.9, track_id=f"t{n}", distance_m=distance_m)
        for n, distance_m in enumerate(distances_m, start=1)
    )
    return PersonDetections(
        stamp=START + tenth * SECOND // 10, frame_id="camera", width=640, height=480, persons=persons
    )


def greeting(folder: Path, *, comes: int = 5, tenths: int = 20) -> Path:
    """A run of Waldo, shorter than he waits for a camera: until ``comes`` (tenths of a second) nobody is there."""
    graph = with_speech_files(load_graph("waldo").without_sources(), folder, playback="off")
    runner = InlineRunner(graph, start=START)
    with RunRecord(folder) as record:
        record.describe(graph)
        for topic in observed_topics(graph):
            runner.tap(topic, record.observe)
        runner.start()
        for tenth in range(tenths):
            runner.feed("/humans/bodies/detections", frame(tenth, *([4.0] if tenth >= comes else [])))
        runner.close()
        record.write_results({"graph": "waldo", "runner": "inline", "parameters": {"bdi_engine": {"range_m": 6.0}}})
    return folder


def long_run(folder: Path, *, visits: int, max_bytes: int) -> Path:
    """A run of Waldo that keeps the newest part only: each minute somebody comes and stays for 20 s."""
    graph = parse_graph(DETECTED, where="runs.py")
    runner = InlineRunner(graph, start=START)
    told = {"machine": "desk", "state": "active", "call_hz": "30.0"}
    with RunTrace(folder, max_bytes=max_bytes) as record:
        record.describe(graph)
        for topic in observed_topics(graph):
            runner.tap(topic, record.observe)
        runner.start()
        for tenth in range(600 * visits):
            runner.feed("/humans/bodies/detections", frame(tenth, *([4.0] if tenth % 600 < 200 else [])))
            if tenth % 10 == 0:
                record.note_node(frame(tenth).stamp, "speech", told)
        runner.close()
    return folder


def waldo_heard_by(*lives: LiveRun) -> InlineRunner:
    """Run Waldo inline on given detections; ``lives`` receive the records."""
    parameters = {"speech": {"playback": "off"}, "bdi_engine": {"forget_after_s": 30.0}}
    graph = load_graph("waldo").without_sources().with_parameters(parameters)
    runner = InlineRunner(graph, start=START)
    for live in lives:
        for topic in observed_topics(graph):
            runner.tap(topic, live.observe)
    runner.start()
    return runner


def waldo_at_work(folder: Path, live: LiveRun, tenths: range, runner: InlineRunner | None = None) -> InlineRunner:
    """Show Waldo a person; ``live`` receives the records of the run."""
    if runner is None:
        graph = load_graph("waldo").without_sources().with_parameters({"speech": {"playback": "off"}})
        runner = InlineRunner(graph, start=START)
        record = RunTrace(folder)
        record.add_listener(live)
        for topic in observed_topics(graph):
            runner.tap(topic, record.observe)
        runner.start()
    for tenth in tenths:
        runner.feed("/humans/bodies/detections", frame(tenth, *([4.0] if tenth >= 5 else [])))
    return runner


class InlineCommands:
    """Commands of people to the agents of ``runner``."""

    shut = ""

    def __init__(self, runner: InlineRunner) -> None:
        self._runner = runner
        self._answers: list[AgentAnswer] = []
        runner.tap(AGENT_ANSWERS, self._take)

    def _take(self, topic: str, answer: Message) -> None:
        assert isinstance(answer, AgentAnswer)
        self._answers.append(answer)

    async def ask(self, agent: str, command: Command, text: str) -> AgentAnswer:
        now = self._runner.clock.now()
        id = f"person-{len(self._answers)}"
        self._runner.feed(AGENT_COMMANDS, AgentCommand(stamp=now, id=id, agent=agent, command=command, text=text))
        return self._answers[-1]

    async def say(self, text: str) -> str:
        id = f"person-said-{text}"
        self._runner.feed("/speech/say", Utterance(stamp=self._runner.clock.now(), id=id, text=text, cause=id))
        return ""
