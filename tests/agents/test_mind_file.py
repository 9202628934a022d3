"""Agents continue with their saved state after their process ended."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Belief, Engine
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from tests.agents.waldo.corridor import ANNA, Corridor


def crash(corridor: Corridor) -> None:
    """Waldo's process is killed, and started again."""
    corridor.runner.kill("waldo")
    corridor.runner.restart("waldo")


def times(corridor: Corridor, what: str) -> list[float]:
    return [t for t, did in corridor.did if did == what]


@pytest.mark.parametrize(("kept", "greetings"), [(True, 1), (False, 2)])
def test_greeted_person_is_not_greeted_again_after_a_crash(kept: bool, greetings: int, tmp_path: Path) -> None:
    corridor = Corridor(mind_file=str(tmp_path / "minds" / "waldo.json") if kept else "")
    corridor.see(ANNA, times=20)
    crash(corridor)
    corridor.see(ANNA, times=20)
    assert len(times(corridor, "greeting")) == greetings


def test_state_is_saved_again_if_its_folder_is_removed(tmp_path: Path) -> None:
    corridor = Corridor(mind_file=str(tmp_path / "minds" / "waldo.json"), help_after_s=3.0)
    corridor.see(ANNA, times=60)
    assert times(corridor, "offer"), "nothing changes from now on"
    shutil.rmtree(tmp_path / "minds")
    corridor.see(ANNA, times=11)
    crash(corridor)
    corridor.see(ANNA, times=60)
    assert len(times(corridor, "greeting")) == len(times(corridor, "offer")) == 1


def test_state_that_could_not_be_saved_is_saved_later(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "minds"
    corridor = Corridor(mind_file=str(folder / "waldo.json"), help_after_s=3.0)
    corridor.see()
    shutil.rmtree(folder)
    folder.write_text("")
    corridor.see(ANNA, times=60)
    assert times(corridor, "offer"), "nothing changes from now on"
    folder.unlink()
    corridor.see(ANNA, times=11)
    crash(corridor)
    corridor.see(ANNA, times=60)
    assert len(times(corridor, "greeting")) == len(times(corridor, "offer")) == 1
    assert caplog.text.count("cannot save its state") == 1


def test_state_of_an_idle_agent_that_could_not_be_saved_is_saved_later(tmp_path: Path) -> None:
    folder = tmp_path / "minds"
    folder.write_text("")
    runner, thinker = thinking(folder / "mind.json")
    thinker.engine.believe(thing("seen"))
    runner.advance(SECOND)
    folder.unlink()
    runner.advance(2 * SECOND)
    assert "seen" in (folder / "mind.json").read_text()


def test_beliefs_keep_their_begin(tmp_path: Path) -> None:
    corridor = Corridor(mind_file=str(tmp_path / "waldo.json"))
    corridor.see(ANNA, times=20)
    before = {belief.text: belief.since for belief in corridor.minds[-1].beliefs}
    crash(corridor)
    assert {belief.text: belief.since for belief in corridor.minds[-1].beliefs} == before
    assert before['greeted("t1")']


def test_absence_continues_over_a_crash(tmp_path: Path) -> None:
    def greeted_anew(crashed: bool) -> list[float]:
        corridor = Corridor(mind_file=str(tmp_path / f"{crashed}.json"), forget_after_s=5.0)
        corridor.see(ANNA, times=20)
        corridor.see(times=30)
        if crashed:
            crash(corridor)
        corridor.see(times=60)
        corridor.see(ANNA, times=20)
        return times(corridor, "greeting")

    whole = greeted_anew(crashed=False)
    assert len(whole) == 2
    assert greeted_anew(crashed=True) == whole


def test_trace_ids_are_unique_over_a_crash(tmp_path: Path) -> None:
    corridor = Corridor(mind_file=str(tmp_path / "waldo.json"))
    corridor.see(ANNA, times=20)
    crash(corridor)
    corridor.see(times=60)
    ids = [record.id for record in corridor.trace]
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("text", ["", "{", '{"schema": "socialbot/mind", "version": 1, "records": "many"}'])
def test_damaged_mind_file_is_renamed_and_ignored(text: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "waldo.json").write_text(text)
    corridor = Corridor(mind_file=str(tmp_path / "waldo.json"))
    corridor.see(ANNA, times=20)
    assert len(times(corridor, "greeting")) == 1
    assert (tmp_path / "waldo.json.damaged").read_text() == text
    assert json.loads((tmp_path / "waldo.json").read_text())["name"] == "waldo"
    assert "starts without its mind file" in caplog.text


def test_damaged_mind_file_that_cannot_be_renamed_is_ignored(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "waldo.json").write_text("{")
    (tmp_path / "waldo.json.damaged").mkdir()
    corridor = Corridor(mind_file=str(tmp_path / "waldo.json"))
    corridor.see(ANNA, times=20)
    assert len(times(corridor, "greeting")) == 1
    assert "damaged and cannot be renamed (Is a directory)" in caplog.text


def test_agent_starts_where_its_state_cannot_be_saved(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As after a crash while the disk is read-only, or full and without the folder."""
    (tmp_path / "minds").write_text("")
    corridor = Corridor(mind_file=str(tmp_path / "minds" / "waldo.json"))
    corridor.see(ANNA, times=20)
    assert len(times(corridor, "greeting")) == 1
    assert caplog.text.count("cannot save its state") == 1


class thing(Belief):  # noqa: N801 - written as agents write it
    """An object known to the agent."""


class Thinker(AgentNode):
    """Agent that believes each received message."""

    def build(self) -> Engine:
        return Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)


def thinking(path: Path) -> tuple[InlineRunner, Thinker]:
    runner = InlineRunner(Graph("test", (NodeConfig("thinker", Thinker, {"mind_file": str(path)}),)))
    runner.start()
    thinker = runner.nodes["thinker"]
    assert isinstance(thinker, Thinker)
    return runner, thinker


def saved(path: Path) -> list[object]:
    return [belief["args"][0] for belief in json.loads(path.read_text())["beliefs"]]


def test_mind_is_saved_at_most_five_times_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mind.json"
    runner, thinker = thinking(path)
    runner.advance(SECOND)
    thinker.engine.believe(thing(1))
    runner.advance(SECOND)
    assert saved(path) == [1]
    thinker.engine.believe(thing(2))
    runner.advance(SECOND + nanoseconds(0.19))
    assert saved(path) == [1]
    runner.advance(SECOND + nanoseconds(0.2))
    assert saved(path) == [1, 2]


def test_last_state_is_saved_at_stop(tmp_path: Path) -> None:
    path = tmp_path / "mind.json"
    runner, thinker = thinking(path)
    for number in range(3):
        thinker.engine.believe(thing(number))
        runner.advance(SECOND + number)
    runner.close()
    assert saved(path) == [0, 1, 2]


def test_last_state_is_saved_at_stop_if_its_folder_was_removed(tmp_path: Path) -> None:
    path = tmp_path / "minds" / "mind.json"
    runner, thinker = thinking(path)
    thinker.engine.believe(thing(1))
    runner.advance(SECOND)
    shutil.rmtree(path.parent)
    runner.close()
    assert saved(path) == [1]


def test_unsavable_mind_is_logged_and_agent_continues(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    runner, thinker = thinking(tmp_path / "mind.json")
    thinker.engine.believe(thing(object()))
    runner.advance(SECOND)
    assert "cannot save its state" in caplog.text
    assert runner.faults["thinker"].failures == 0
