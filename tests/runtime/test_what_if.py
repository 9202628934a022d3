"""Branches of recorded runs: replays of a bag, and a simulation."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import pytest

from socialbot.agents.dialogue import Proposals, Whitelist
from socialbot.agents.dialogue.language_model import Prompt
from socialbot.core.errors import ParameterError, RunError
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs.difference import difference
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import RunRecord
from socialbot.runtime.bag_source import replay
from socialbot.runtime.run import run
from socialbot.runtime.simulated_source import SimulatedSource
from socialbot.runtime.sweeps import graph_for
from socialbot.runtime.what_if import BranchChange, Futures, branch, side_by_side
from tests.runtime.test_sweeps import bag as bag
from tests.system.running import socialbot_here


@pytest.fixture(scope="module")
def recorded(bag, tmp_path_factory) -> RecordedRun:
    folder = tmp_path_factory.mktemp("runs") / "run"
    replay(bag, graph_for(bag, str(bag.with_name("eyes.yaml"))), folder)
    return open_run(folder)


def parted(recorded: RecordedRun, at_s: float, folder, *changes: tuple[str, str], agent: str = "") -> Futures:
    return branch(recorded, at_s, [BranchChange(*each) for each in changes], agent, folder)


def said(run: RecordedRun) -> list[str]:
    return [record.what for record in run.history if record.kind == "utterance"]


def greeted_at(run: RecordedRun) -> float:
    return next(run.history.seconds(record.stamp) for record in run.history if record.kind == "utterance")


def test_an_unchanged_future_is_the_recorded_one(recorded, tmp_path):
    futures = parted(recorded, 0.1, tmp_path, ("believe", 'weather("fine")'))
    assert futures.reproduced
    before = [(each.stamp, each.kind, each.what) for each in recorded.history]
    assert [(each.stamp, each.kind, each.what) for each in futures.unchanged.history] == before


def test_both_futures_are_the_same_until_the_branch(recorded, tmp_path):
    at_s = greeted_at(recorded) - 0.05
    futures = parted(recorded, at_s, tmp_path, ("without", "GreetPeople()"))
    early = [
        [(each.stamp, each.kind, each.what) for each in run.history if run.history.seconds(each.stamp) < at_s]
        for run in (futures.unchanged, futures.changed)
    ]
    assert early[0] == early[1]
    assert said(futures.unchanged)[0] not in said(futures.changed)


def test_a_belief_of_the_past_is_forgotten(recorded, tmp_path):
    at_s = greeted_at(recorded) + 0.5
    futures = parted(recorded, at_s, tmp_path, ("forget", "greeted(_)"), ("achieve", "GreetPeople()"))
    assert said(futures.changed).count(said(recorded)[0]) == 2
    rows = side_by_side(futures)
    assert any(not before and said(recorded)[0] in now for _, before, now in rows)
    assert all(time >= at_s for time, _, _ in rows)


def test_a_parameter_changes_from_then_on(recorded, tmp_path):
    futures = parted(recorded, 0.0, tmp_path, ("set", "waldo.greeting=Good morning!"))
    assert said(futures.changed)[0] == "Good morning!"
    assert futures.reproduced


def test_a_rule_is_added(recorded, tmp_path):
    rule = '+engages(Who) <- speak("offer").'
    futures = parted(recorded, 0.0, tmp_path, ("without", "+engages(Who)"), ("rule", rule))
    assert said(futures.changed)[:1] != said(futures.unchanged)[:1]


class Model:
    """Model with one answer."""

    def __init__(self, answer: str) -> None:
        self._answer = answer

    def complete(self, prompt: Prompt) -> str:
        return self._answer


def with_proposal(recorded: RecordedRun, folder: Path, answer: str) -> tuple[RecordedRun, str]:
    """Copy a run, with the record of a proposed plan that `Proposals` checked."""
    shutil.copytree(recorded.folder, folder)
    last = recorded.history[-1]

    def record(kind: str, what: str, cause: str, **detail: object) -> str:
        added = TraceRecord(
            stamp=last.stamp, id="bdi_engine-proposed", kind=kind, what=what, source=last.source, detail=detail
        )
        with (folder / "trace.jsonl").open("ab") as file:
            file.write(msgspec.json.encode(added) + b"\n")
        return added.id

    whitelist = Whitelist(goals={"GreetPeople": 0}, actions={"speak": 1})
    found = Proposals(Model(answer), record).plan("Offer help at once", whitelist)
    return open_run(folder), found.record


def test_proposed_plans_are_tried(recorded, tmp_path):
    proposed, record = with_proposal(recorded, tmp_path / "run", "+!'GreetPeople' <- speak(\"offer\").")
    futures = parted(proposed, 0.0, tmp_path, ("without", "GreetPeople()"), ("proposal", record))
    assert said(futures.changed)[:1] != said(futures.unchanged)[:1]
    with pytest.raises(ParameterError, match="no proposed plans 'nothing'"):
        parted(proposed, 0.0, tmp_path / "other", ("proposal", "nothing"))


def test_refused_proposals_are_not_tried(recorded, tmp_path):
    proposed, record = with_proposal(recorded, tmp_path / "run", "+!fly <- speak(up).")
    with pytest.raises(ParameterError, match="was refused: the goal 'fly' is not allowed"):
        parted(proposed, 0.0, tmp_path / "other", ("proposal", record))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("believe", "tall(X)"), "has a variable"),
        (("forget", "dragons(_)"), "believes nothing like"),
        (("achieve", "fly"), "has no plan"),
        (("set", "waldo.range_m=99"), "out of range"),
        (("set", "person_detector.threads=2"), "before the node starts"),
        (("set", "bdi_engine.nonsense=2"), "no parameter 'nonsense'"),
        (("rule", "+hello <-"), "--rule"),
        (("without", "FlyAway()"), "no rule like 'FlyAway"),
    ],
    ids=str,
)
def test_impossible_changes_are_refused_with_the_reason(recorded, tmp_path, change, message):
    with pytest.raises(ParameterError, match=message):
        parted(recorded, 1.0, tmp_path, change)


def test_times_outside_the_run_are_refused(recorded, tmp_path):
    with pytest.raises(RunError, match=r"does not contain 99\.00 s"):
        parted(recorded, 99.0, tmp_path, ("forget", "greeted(_)"))


def test_a_live_run_cannot_be_branched(recorded, tmp_path):
    live = tmp_path / "live"
    live.mkdir()
    for name in ("trace.jsonl", "graph.yaml"):
        (live / name).write_bytes((recorded.folder / name).read_bytes())
    with pytest.raises(RunError, match="its input is not recorded"):
        parted(open_run(live), 1.0, tmp_path, ("forget", "greeted(_)"))


def test_a_run_of_another_version_is_told(recorded, tmp_path):
    trace = (recorded.folder / "trace.jsonl").read_text().replace("Hello!", "Ahoy!")
    other = tmp_path / "other"
    other.mkdir()
    (other / "trace.jsonl").write_text(trace)
    for name in ("results.json", "graph.yaml"):
        (other / name).write_bytes((recorded.folder / name).read_bytes())
    assert not parted(open_run(other), 1.0, tmp_path, ("believe", 'weather("fine")')).reproduced


@pytest.mark.slow
def test_a_simulation_is_branched(tmp_path):
    with RunRecord(tmp_path / "run") as record:
        run(load_graph("warehouse"), SimulatedSource(), record)
    recorded = open_run(tmp_path / "run")
    agents = [config.name for config in load_graph("warehouse").nodes if config.type.is_agent]
    with pytest.raises(ParameterError, match=r"the graph has \d agents"):
        parted(recorded, 5.0, tmp_path / "none", ("drop", "x"))
    gripper = next(name for name in agents if "gripper" in name)
    desire = next(each.what for each in recorded.history if each.kind == "desire" and each.source == gripper)
    futures = parted(recorded, 20.0, tmp_path / "both", ("drop", desire), agent=gripper)
    assert futures.reproduced
    found = difference(futures.unchanged, futures.changed)
    assert not found.same


def test_the_command_shows_both_futures(recorded, tmp_path):
    command = ["whatif", recorded.folder, "--at", "0.1", "--set", "waldo.greeting=Good morning!"]
    done = socialbot_here(*command, "--out", tmp_path / "both", "--html", tmp_path / "both.html")
    assert done.returncode == 1, done.stderr
    assert "Good morning!" in done.stdout
    assert "comes out differently" in done.stdout
    assert "Good morning!" in (tmp_path / "both.html").read_text()
    as_json = socialbot_here(*command, "--out", tmp_path / "json", "--json")
    assert msgspec.json.decode(as_json.stdout)["difference"]["same"] is False
    nothing = socialbot_here("whatif", recorded.folder, "--at", "1")
    assert (nothing.returncode, "--believe" in nothing.stderr) == (4, True)
    same = socialbot_here(
        "whatif", recorded.folder, "--at", "1", "--believe", 'weather("fine")', "--out", tmp_path / "s"
    )
    assert same.returncode == 0
