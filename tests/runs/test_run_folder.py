from __future__ import annotations

import functools
import json
import operator
import os

import msgspec
import pytest

from socialbot.core.errors import RunError
from socialbot.core.messages import Health, State
from socialbot.graph.files import load_graph
from socialbot.runs.asking import answer
from socialbot.runs.distances import distances_of
from socialbot.runs.folder import newest_run, open_run
from socialbot.runs.record import SOUNDS, RunRecord, RunTrace
from socialbot.runs.report import report_html
from socialbot.runs.run import NoCommands, Picture, overview, wording_of
from tests.runs.deliberating_runs import record
from tests.runs.runs import START, greeting, long_run

BELIEF = record(1.0, "ann", "belief", "b")


def test_run_is_opened(tmp_path):
    run = open_run(str(greeting(tmp_path / "evening")))
    assert (run.title, run.live, run.damage, run.wording.name("bdi_engine")) == ("Waldo: evening", False, [], "Waldo")
    assert run.history.start == START
    view = run.graph_view()
    assert {node.name for node in view.nodes} >= {"person_detector", "bdi_engine", "speech"}
    assert view.topics["/speech/say"] == "Utterance"
    assert (run.world(START), run.trees(START), run.picture(START)) == (None, (), None)


BAND = {"tp": 1, "fp": 0, "fn": 0, "precision": 1.0, "recall": 1.0, "f1": 1.0}
RESULTS = {
    "graph": "waldo",
    "ended": "well",
    "bag": {"path": "film", "start": 1, "duration_s": 2.0},
    "nodes": {"head": {"calls": 1, "cpu_s": 0.1, "peak_rss_mb": 50.0, "first_failure": ""}},
    "parameters": {"head": {"range_m": 3.0}},
    "labels": {"visitor": "t1"},
    "versions": {"python": "3"},
    "scores": {"frames": 1, "bands": {"0-2 m": BAND}},
    "wall_s": 1.0,
}


def places(value, *path):
    yield path
    for key, part in value.items() if isinstance(value, dict) else ():
        yield from places(part, *path, key)


@pytest.mark.parametrize("wrongs", [("x\0",), pytest.param((5, [1], {"a": 1}, None, -1.5), marks=pytest.mark.slow)])
def test_results_of_any_types_are_shown_or_refused(tmp_path, wrongs):
    """The file may be damaged, or from somebody else."""
    folder = greeting(tmp_path / "run")
    refused = 0
    for *path, last in filter(None, places(RESULTS)):
        for wrong in wrongs:
            results = json.loads(json.dumps(RESULTS))
            functools.reduce(operator.getitem, path, results)[last] = wrong
            (folder / "results.json").write_text(json.dumps(results))
            run = open_run(folder)
            refused += any("results.json" in each for each in run.damage)
            assert run.title
            overview(run, NoCommands("it has ended"))
            if len(wrongs) > 1:
                report_html(run)
    assert refused > 10 * len(wrongs)
    (folder / "results.json").write_text(json.dumps(RESULTS))
    assert open_run(folder).damage == []


@pytest.mark.parametrize("persons", [5, "x", None, [1], [{}], {"a": 1}, [{"x": "left"}], True])
def test_record_with_unreadable_people_is_left_out_and_reported(tmp_path, persons):
    folder = greeting(tmp_path / "run")
    lines = [json.loads(line) for line in (folder / "trace.jsonl").read_text().splitlines()]
    seen = next(line for line in lines if line.get("detail", {}).get("persons"))
    seen["detail"]["persons"] = persons
    (folder / "trace.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    run = open_run(folder)
    assert len(run.history) == len(lines) - 1
    assert run.damage[0].startswith(f"trace.jsonl:{lines.index(seen) + 1}: detail.persons")
    assert answer(run, "Who was there?").known
    assert distances_of(run)


def test_record_without_a_source_can_be_asked(tmp_path):
    folder = greeting(tmp_path / "run")
    with (folder / "trace.jsonl").open("ab") as file:
        file.write(msgspec.json.encode(record(9.0, "", "belief", "b")) + b"\n")
    assert answer(open_run(folder), "Why did you greet me?").known


NODES = """
name: my_robot
nodes:
  mind: {type: "evaluation.inspect_agents:Walker"}
"""
WALDOS = """
name: waldos
inputs: [/humans/bodies/detections]
nodes:
  left: {type: waldo}
  right: {type: waldo}
"""


@pytest.mark.parametrize(
    ("graph", "names"),
    [(NODES, {"mind": "mind"}), (WALDOS, {"left": "left", "right": "right"})],
    ids=["called nothing else", "called the same"],
)
def test_agent_without_unique_display_name_keeps_its_node_name(tmp_path, graph, names):
    (tmp_path / "graph.yaml").write_text(graph)
    wording = wording_of(load_graph(str(tmp_path / "graph.yaml")))
    assert {name: wording.name(name) for name in names} == names


def test_pictures_come_from_the_given_source(tmp_path):
    class Pictures:
        def at(self, stamp: int) -> Picture | None:
            return Picture(stamp, b"jpeg")

    assert open_run(greeting(tmp_path / "run"), Pictures()).picture(7) == Picture(7, b"jpeg")


@pytest.mark.parametrize("folder", ["", "nowhere"])
def test_folder_without_a_run_is_an_error(tmp_path, folder):
    with pytest.raises(RunError, match="there is no run"):
        open_run(tmp_path / folder)


def test_damaged_lines_are_skipped_and_listed(tmp_path):
    line = msgspec.json.encode(BELIEF)
    (tmp_path / "trace.jsonl").write_bytes(b"\n".join((line, b"{]", b'{"stamp": 1}', line, line[:20])))
    (tmp_path / "results.json").write_text("[1]")
    run = open_run(tmp_path)
    assert len(run.history) == 2
    assert [damage.partition(":")[0] for damage in run.damage] == [
        "results.json cannot be read",
        "trace.jsonl",
        "trace.jsonl",
    ]
    assert run.damage[1].startswith("trace.jsonl:2: ")


def test_unfinished_run_lists_its_damage(tmp_path):
    (tmp_path / "trace.jsonl").write_bytes(msgspec.json.encode(BELIEF)[:-5])
    run = open_run(tmp_path)
    assert (len(run.history), run.results) == (0, {})
    assert run.damage == ["results.json is missing: the run has not ended, or was broken off"]
    assert run.states.at(0).agents == ()


def test_node_status_at_a_time(tmp_path):
    told = {"machine": "desk", "state": "active", "call_hz": "30.0"}
    graph = load_graph("waldo")
    with RunRecord(tmp_path) as kept:
        kept.describe(graph)
        kept.observe("/waldo/trace", msgspec.structs.replace(BELIEF, stamp=START))
        kept.note_node(START + 10**9, "speech", told)
        silent = Health(stamp=START + 2 * 10**9, node="speech", state="degraded", reason="no sound")
        kept.observe("/health", silent)
        kept.observe("/health", msgspec.structs.replace(silent, stamp=START + 3 * 10**9))
    run = open_run(tmp_path)
    assert len((tmp_path / "seen.jsonl").read_bytes().splitlines()) == 2
    assert {node.name: node.machine for node in run.graph_view().nodes}["speech"] == "desk"

    def speech(second: int) -> tuple[str, str, float | None]:
        found = next(node for node in run.nodes(START + second * 10**9) if node.name == "speech")
        return found.condition, found.reason, found.handled_hz

    assert speech(0) == ("no messages", "", None)
    assert speech(1) == ("active", "", 30.0)
    assert speech(3) == ("degraded", "no sound", 30.0)


def test_no_node_is_silent_because_its_recording_is_over(tmp_path):
    def told(second: int, node: str, state: State, silent: tuple[str, ...], outputs: tuple[str, ...] = ()) -> Health:
        stamp = START + second * 10**9
        return Health(stamp=stamp, node=node, state=state, reason=node, silent=silent, outputs=outputs)

    with RunTrace(tmp_path) as kept:
        kept.describe(load_graph("waldo"))
        kept.observe("/waldo/trace", msgspec.structs.replace(BELIEF, stamp=START))
        for name in ("image_converter", "person_detector", "bdi_engine", "head"):
            kept.note_node(START + 4 * 10**9, name, {"machine": "desk", "state": "active", "call_hz": "30.0"})
        kept.observe("/health", told(2, "head", "degraded", ("/head/command",)))
        kept.observe("/health", told(4, "bag", "ended", (), ("/pictures",)))
        kept.observe("/health", told(5, "image_converter", "degraded", ("/pictures",), ("/converted",)))
        kept.observe("/health", told(5, "person_detector", "degraded", ("/converted",)))
        kept.observe("/health", told(5, "bdi_engine", "degraded", ("/converted", "/other")))
    run = open_run(tmp_path)
    found = {node.name: (node.condition, node.reason) for node in run.nodes(START + 5 * 10**9)}
    assert found["image_converter"] == found["person_detector"] == ("active", "the recording is over")
    assert found["head"] == ("input silent", "head")
    assert found["bdi_engine"] == ("input silent", "bdi_engine")


def test_newest_part_of_a_long_run_is_kept(tmp_path):
    run = open_run(long_run(tmp_path / "run", visits=6, max_bytes=500_000))
    assert sum(part.stat().st_size for part in (tmp_path / "run").glob("trace.jsonl*")) < 510_000
    assert sum(part.stat().st_size for part in (tmp_path / "run").glob("seen.jsonl*")) < 510_000
    assert "trace.jsonl: the beginning is gone" in run.damage[-1]
    assert run.end >= START + 358 * 10**9
    assert START + 100 * 10**9 < run.history.start < START + 300 * 10**9
    assert {node.name: node.condition for node in run.nodes(run.end)}["speech"] == "active"
    speech = next(node for node in run.nodes(run.end) if node.name == "speech")
    assert speech.handled_hz == 30.0
    assert [said.text for said in run.states.at(run.end).speech][-1] == "Can I help you with anything?"


def test_trimmed_log_repeats_the_latest_node_status(tmp_path):
    with RunTrace(tmp_path, max_bytes=40_000) as kept:
        kept.describe(load_graph("waldo"))
        kept.observe("/waldo/trace", msgspec.structs.replace(BELIEF, stamp=START))
        kept.observe("/health", Health(stamp=START, node="speech", state="degraded", reason="no sound"))
        for second in range(1000):
            kept.note_node(START + second * 10**9, "speech", {"machine": "desk", "state": "active"})
    found = next(node for node in open_run(tmp_path).nodes(START + 999 * 10**9) if node.name == "speech")
    assert (found.condition, found.reason) == ("degraded", "no sound")


def test_newest_run_is_the_last_written(tmp_path):
    with pytest.raises(RunError, match="there is no run yet"):
        newest_run(tmp_path)
    for age, name in ((0, "new"), (100, "old")):
        trace = tmp_path / name / "trace.jsonl"
        trace.parent.mkdir()
        trace.touch()
        os.utime(trace, (1e9 - age, 1e9 - age))
    assert newest_run(tmp_path) == tmp_path / "new"


def test_a_sound_is_a_file_of_the_run(tmp_path):
    run = open_run(greeting(tmp_path / "run"))
    (tmp_path / "secret.wav").write_bytes(b"secret")
    sounds = tmp_path / "run" / SOUNDS
    sounds.mkdir(exist_ok=True)
    (sounds / "own.wav").write_bytes(b"own")
    (sounds / "link.wav").symlink_to(tmp_path / "secret.wav")
    assert run.sound("own.wav") == b"own"
    assert run.sound("link.wav") is None
