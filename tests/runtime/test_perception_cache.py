"""The cache of perception, with real bags, nodes and processes."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import msgspec
import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.errors import BagError
from socialbot.core.messages import Image, PersonDetections
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input
from socialbot.runs.record import RunRecord
from socialbot.runtime import perception_cache
from socialbot.runtime._memory_nodes import PUBLISHED, StepRecorder
from socialbot.runtime.bag_source import BagSource
from socialbot.runtime.perception_cache import CacheFolder, PerceptionCache, describe
from socialbot.runtime.run import RunResult, run
from socialbot.vision.person_detector import PersonDetector
from tests.system.running import socialbot_here
from tests.vision.metrics.scenes import drawn_bag
from tests.vision.networks import constant_network, yolov8_rows

EYES = {"detector": "onnx", "layout": "yolov8", "tracker": "none", "faces": False}
LIMIT = 10_000_000
FILES = ("trace.jsonl", "seen.jsonl", "scored.jsonl")


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    """A bag with the model of a detector beside it, which sees two people in every image."""
    made = drawn_bag(tmp_path_factory.mktemp("bags"), frames=6)
    rows = yolov8_rows((100, 100, 60, 200, 0.9), (300, 120, 50, 180, 0.5))
    model_of(made).write_bytes(constant_network({"boxes": rows}, shape=(1, 3, 480, 640)))
    return made


def model_of(bag: Path) -> Path:
    return bag.with_name("model.onnx")


@pytest.fixture
def cache(tmp_path) -> PerceptionCache:
    return PerceptionCache(CacheFolder(tmp_path / "cache", LIMIT))


def graph(bag: Path, **detector: object) -> Graph:
    return load_graph("waldo").with_parameters({"person_detector": {**EYES, "model": str(model_of(bag)), **detector}})


def replayed(bag: Path, graph: Graph, folder: Path, cache: PerceptionCache | None) -> RunResult:
    with open_bag(bag) as opened, RunRecord(folder) as record:
        return run(graph, BagSource(opened, cache=cache), record)


def state(result: RunResult) -> str:
    return result.results["bag"]["cache"]


def records(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in FILES if (folder / name).exists()]


def test_the_second_replay_decides_the_same_without_looking(bag, cache, tmp_path, monkeypatch):
    plain = replayed(bag, graph(bag), tmp_path / "plain", None)
    first = replayed(bag, graph(bag), tmp_path / "first", cache)
    with monkeypatch.context() as patched:
        patched.setattr(PersonDetector, "on_image", lambda *_: pytest.fail("an image was searched"))
        second = replayed(bag, graph(bag), tmp_path / "second", cache)
    assert (state(first), state(second)) == ("written", "read")
    assert records(tmp_path / "plain") == records(tmp_path / "first") == records(tmp_path / "second")
    assert any(b'"detection"' in line for line in records(tmp_path / "second"))
    assert plain.nodes == first.nodes == second.nodes


@pytest.mark.slow
def test_the_corridor_from_the_cache_is_the_corridor(corridor, cache, tmp_path):
    """With the default detector, tracker, faces and memory of clothes."""
    results = [replayed(corridor, load_graph("waldo"), tmp_path / name, cache) for name in "ab"]
    assert [state(result) for result in results] == ["written", "read"]
    assert records(tmp_path / "a") == records(tmp_path / "b")


@pytest.mark.parametrize(
    "change",
    [
        {"threshold": 0.3},
        {"tracker": "kalman"},
        {"threads": 2},
        {"hfov_rad": 1.2},
        {"person_height_m": 1.5},
    ],
    ids=str,
)
def test_other_parameters_of_the_detector_are_another_entry(bag, cache, tmp_path, change):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    assert state(replayed(bag, graph(bag, **change), tmp_path / "second", cache)) == "written"


def test_parameters_of_the_agent_are_not(bag, cache, tmp_path):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    other = graph(bag).with_parameters({"bdi_engine": {"help_after_s": 2.0}})
    assert state(replayed(bag, other, tmp_path / "second", cache)) == "read"


def test_other_pictures_are_another_entry(bag, cache, tmp_path):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    other = shutil.copytree(bag, tmp_path / "moved" / bag.name)
    assert state(replayed(other, graph(bag), tmp_path / "second", cache)) == "read"
    [file] = other.glob("*.mcap")
    data = bytearray(file.read_bytes())
    at = data.index(b"\xff\xd8") + 700
    data[at] ^= 1
    file.write_bytes(data)
    assert state(replayed(other, graph(bag), tmp_path / "third", cache)) == "written"


@pytest.mark.parametrize("package", ["opencv-python-headless", "onnxruntime", "numpy"])
def test_other_versions_of_libraries_are_another_entry(bag, cache, tmp_path, monkeypatch, package):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    version = perception_cache.metadata.version
    newer: Callable[[str], str] = lambda name: "99" if name == package else version(name)  # noqa: E731
    monkeypatch.setattr(perception_cache.metadata, "version", newer)
    perception_cache._environment.cache_clear()
    try:
        assert state(replayed(bag, graph(bag), tmp_path / "second", cache)) == "written"
    finally:
        perception_cache._environment.cache_clear()


def test_other_code_is_another_entry(tmp_path):
    code = tmp_path / "eyes.py"
    code.write_text("STRONG = 0.5\n")
    before = perception_cache._source(code)
    perception_cache._source.cache_clear()
    code.write_text("STRONG = 0.6\n")
    assert perception_cache._source(code) != before


def test_another_model_in_the_same_file_is_another_entry(bag, cache, tmp_path):
    model = tmp_path / "model.onnx"
    results = []
    for name, left in ("first", 100), ("again", 100), ("other", 300):
        rows = yolov8_rows((left, 100, 60, 200, 0.9))
        model.write_bytes(constant_network({"boxes": rows}, shape=(1, 3, 480, 640)))
        results.append(replayed(bag, graph(bag, model=str(model)), tmp_path / name, cache))
    assert [state(result) for result in results] == ["written", "read", "written"]
    assert records(tmp_path / "first") == records(tmp_path / "again") != records(tmp_path / "other")


def test_a_damaged_entry_is_reported_and_written_again(bag, cache, tmp_path, caplog):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    [file] = cache.folder.files()
    data = bytearray(file.path.read_bytes())
    for damaged in (data[: len(data) // 2], b"", data[:-1] + bytes([data[-1] ^ 1])):
        file.path.write_bytes(damaged)
        caplog.clear()
        result = replayed(bag, graph(bag), tmp_path / f"run{len(damaged)}", cache)
        assert state(result) == "written"
        assert "is damaged" in caplog.text
        assert records(tmp_path / "first") == records(tmp_path / f"run{len(damaged)}")
        assert file.path.read_bytes() == data


def test_a_stopped_replay_leaves_no_entry(bag, cache, tmp_path):
    with open_bag(bag) as opened:
        perception = cache.open(opened, graph(bag).without_sources(), {"/camera/camera_info": "/camera/camera_info"})
        assert list(perception.messages())
        perception.finish(complete=False)
    assert perception.state == "the run was stopped"
    assert not cache.folder.path.exists()


def test_a_bag_that_changes_under_a_replay_is_refused(bag, cache, tmp_path, monkeypatch):
    replayed(bag, graph(bag), tmp_path / "first", cache)
    shorter = drawn_bag(tmp_path, "shorter", frames=4)
    [file] = cache.folder.files()
    with open_bag(shorter) as opened:
        monkeypatch.setattr(perception_cache, "_key", lambda *_: file.key)
        monkeypatch.setattr(perception_cache, "_only_for", lambda *_: False)
        with RunRecord(tmp_path / "second") as record, pytest.raises(BagError, match="changed during the replay"):
            run(graph(bag), BagSource(opened, cache=cache), record)
    assert cache.folder.files() == []


class Watcher(Node):
    """Looks at the converted images, too."""

    image = Input(Image, "/camera/image_color")
    detections = Input(PersonDetections, "/humans/bodies/detections")
    sizes: ClassVar[list[int]] = []

    @image
    def on_image(self, message: Image) -> None:
        self.sizes.append(message.data.size)

    @detections
    def on_detections(self, message: PersonDetections) -> None: ...


def test_nodes_that_look_at_images_themselves_get_them(bag, cache, tmp_path):
    watched = graph(bag)
    watched = replace(watched, nodes=(*watched.nodes, NodeConfig("watcher", Watcher)))
    Watcher.sizes.clear()
    replayed(bag, watched, tmp_path / "first", cache)
    seen = Watcher.sizes.copy()
    Watcher.sizes.clear()
    assert state(replayed(bag, watched, tmp_path / "second", cache)) == "read"
    assert Watcher.sizes == seen == [640 * 480 * 3] * 6


class OwnDetector(PersonDetector):
    """A detector that does not say what it depends on."""


def test_a_detector_that_does_not_declare_its_files_is_not_cached(bag, cache, tmp_path):
    own = graph(bag)
    nodes = tuple(replace(each, type=OwnDetector) if each.name == "person_detector" else each for each in own.nodes)
    result = replayed(bag, replace(own, nodes=nodes), tmp_path / "run", cache)
    assert state(result) == "no node can be cached"
    assert not cache.folder.path.exists()


def test_damaged_images_are_counted_as_in_the_first_replay(bag, cache, tmp_path):
    damaged = drawn_bag(tmp_path, frames=4)
    [file] = damaged.glob("*.mcap")
    data = file.read_bytes()
    at = data.index(b"\xff\xd9")
    file.write_bytes(data[:at] + b"\0\0" + data[at + 2 :])
    first = replayed(damaged, graph(bag), tmp_path / "first", cache)
    second = replayed(damaged, graph(bag), tmp_path / "second", cache)
    assert state(second) == "read"
    assert first.nodes["image_converter"].failures == 1
    assert first.nodes == second.nodes
    assert first.results["bag"]["skipped"] == second.results["bag"]["skipped"]


def test_the_least_recently_used_entries_go_first(tmp_path):
    folder = CacheFolder(tmp_path, 1000)
    noise = os.urandom(600)
    for number, key in enumerate("abc"):
        assert folder.write(key, noise[: 300 + number])
        os.utime(tmp_path / f"{key}.percepts", (number, number))
    assert folder.read("b") is not None  # used last
    assert folder.write("d", noise[:300])
    assert {file.key for file in folder.files()} == {"b", "d"}
    assert sum(file.size for file in folder.files()) <= folder.max_bytes


def test_an_entry_larger_than_the_cache_is_not_kept(bag, tmp_path):
    cache = PerceptionCache(CacheFolder(tmp_path / "cache", 100))
    assert state(replayed(bag, graph(bag), tmp_path / "run", cache)) == "the cache is too small for this bag"
    assert not cache.folder.path.exists()


def test_a_cache_that_cannot_be_written_does_not_stop_a_replay(bag, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    cache = PerceptionCache(CacheFolder(tmp_path / "file" / "cache", LIMIT))
    assert state(replayed(bag, graph(bag), tmp_path / "run", cache)) == "the cache cannot be written"
    assert "perception is not cached" in caplog.text


def _replay_in_process(bag: Path, folder: Path, run_folder: Path) -> None:
    replayed(bag, graph(bag), run_folder, PerceptionCache(CacheFolder(folder, LIMIT)))


@pytest.mark.slow
def test_several_processes_use_one_cache(bag, tmp_path):
    context = multiprocessing.get_context("spawn")
    workers = [
        context.Process(target=_replay_in_process, args=(bag, tmp_path / "cache", tmp_path / str(number)))
        for number in range(4)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [worker.exitcode for worker in workers] == [0] * 4
    assert all(records(tmp_path / str(number)) == records(tmp_path / "0") for number in range(4))
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_the_command_shows_and_clears(bag, tmp_path, monkeypatch):
    monkeypatch.setenv("SOCIALBOT_CACHE", str(tmp_path / "cache"))
    assert "0 entries, 0.0 of 500 MB" in socialbot_here("cache", "show").stdout
    replayed(bag, graph(bag), tmp_path / "run", PerceptionCache())
    (tmp_path / "cache" / "bad.percepts").write_text("")
    shown = socialbot_here("cache", "show").stdout
    assert "image_converter, person_detector (onnx)" in shown.replace("\n", " ")
    assert "damaged" in shown
    assert "2 entries" in socialbot_here("cache", "size").stdout
    assert "removed 2 entries" in socialbot_here("cache", "clear").stdout
    assert list((tmp_path / "cache").iterdir()) == []
    monkeypatch.setenv("SOCIALBOT_CACHE_MB", "much")
    refused = socialbot_here("cache", "size")
    assert refused.returncode == 4
    assert "SOCIALBOT_CACHE_MB: not a size: 'much'" in refused.stderr


def test_no_cache_looks_again(bag, tmp_path, monkeypatch):
    monkeypatch.setenv("SOCIALBOT_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    sets = [f"person_detector.{name}={value}" for name, value in {**EYES, "model": model_of(bag)}.items()]
    shown = ["replay", bag, "--no-video", *(word for each in sets for word in ("--set", each))]
    for name, options in ("one", ["--no-cache"]), ("two", []), ("three", []):
        assert socialbot_here(*shown, "--out", name, *options).returncode == 0
    found = [msgspec.json.decode((tmp_path / name / "results.json").read_bytes()) for name in ("one", "two", "three")]
    assert [each["bag"]["cache"] for each in found] == ["", "written", "read"]


def test_an_entry_tells_what_it_holds(bag, cache, tmp_path):
    replayed(bag, graph(bag), tmp_path / "run", cache)
    [file] = cache.folder.files()
    entry = describe(cache.folder, file)
    assert entry is not None
    assert (entry.bag, entry.nodes, entry.detector) == (bag.name, ("image_converter", "person_detector"), "onnx")
    assert cache.folder.files() == [file]  # to look is no use


def test_a_graph_from_a_module_without_a_file_is_not_cached():
    assert sys.modules[Watcher.__module__].__file__
    config = NodeConfig("watcher", type("Loose", (Watcher,), {"__module__": "__main__"}))
    assert perception_cache._code_roots(config.type) is None


def test_the_first_reason_against_a_recording_is_kept():
    recorder = StepRecorder(lambda step: None)
    recorder.refuse("a node set a timer")
    recorder.note(PUBLISHED, "seen", b"")
    assert recorder.refused == "a node set a timer"
