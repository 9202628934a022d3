from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import ModelProto, helper

from socialbot.core import inference
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.inference import check_external_data
from socialbot.vision.detectors import FILE, SHA256
from socialbot.vision.network import OnnxModel, included_model
from tests.system.running import eventually, next_line
from tests.vision.networks import (
    echo_network,
    endless_network,
    greedy_network,
    model_with_external_data,
    strict_network,
)


def picture(width: int = 4, height: int = 3) -> np.ndarray:
    return np.arange(3 * width * height, dtype=np.float32).reshape(3, height, width)


def test_network_is_read_from_a_file_or_from_memory(tmp_path):
    file = tmp_path / "echo.onnx"
    file.write_bytes(echo_network())
    for network in (OnnxModel(file), OnnxModel(echo_network())):
        (answer,) = network.run(picture())
        assert answer[0].tolist() == picture().tolist()


def test_a_network_reports_its_use_to_nobody_and_leaves_no_files(tmp_path, monkeypatch):
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY", raising=False)
    for folder in ("HOME", "TMPDIR", "XDG_CACHE_HOME"):
        monkeypatch.setenv(folder, str(tmp_path))
    program = "from tests.vision.networks import *; from socialbot.vision.network import OnnxModel; " + (
        "OnnxModel(echo_network()).run(__import__('numpy').zeros((3, 3, 4), 'float32'))"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)
    assert [str(path) for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ((1, 3, 48, 64), (64, 48)),
        (("batch", 3, "h", "w"), (0, 0)),
        ((1, 48, 64, 3), (64, 48)),
        ((1, 3, 48, "w"), (0, 48)),
    ],
)
def test_size_of_the_image_is_that_of_the_model(shape, size):
    assert OnnxModel(echo_network(shape=shape)).size == size


@pytest.mark.parametrize(
    "place",
    [
        "../secret.bin",
        "/proc/self/environ",
        "{folder}/secret.bin",
        "link.bin",
        "self.bin",
        "location",
        "a/../../secret.bin",
        "*/_ORT_MEM_ADDR_/*",
        "a/../" * 300 + "../secret.bin",
    ],
)
def test_model_reads_no_file_outside_of_its_folder(tmp_path, place):
    (tmp_path / "secret.bin").write_bytes(bytes(64))
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "link.bin").symlink_to(tmp_path / "secret.bin")
    (tmp_path / "model" / "self.bin").symlink_to("self.bin")
    (tmp_path / "model" / "location").symlink_to(tmp_path / "secret.bin")
    file = tmp_path / "model" / "model.onnx"
    file.write_bytes(model_with_external_data(place.format(folder=tmp_path)))
    with pytest.raises(ParameterError, match="outside of its folder"):
        OnnxModel(file)


def test_model_reads_data_in_its_folder(tmp_path):
    (tmp_path / "known.bin").write_bytes(np.arange(12, dtype=np.float32).tobytes())
    file = tmp_path / "model.onnx"
    file.write_bytes(model_with_external_data("known.bin"))
    (total,) = OnnxModel(file).run(np.zeros((3, 2, 2), np.float32))
    assert total.ravel().tolist() == list(range(12))


def test_data_of_a_network_within_a_network_are_found(tmp_path):
    """The branches of an operator are networks, too."""
    inner = ModelProto.FromString(model_with_external_data("../secret.bin"))
    branch = helper.make_attribute("then_branch", inner.graph)
    node = helper.make_node("If", ["picture"], ["sum"])
    node.attribute.append(branch)
    inner.graph.CopyFrom(helper.make_graph([node], "outer", [], []))
    with pytest.raises(ParameterError, match=r"its data in '\.\./secret\.bin'"):
        check_external_data(inner.SerializeToString(), "model", tmp_path)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_as_fields_to_their_end(content):
    check_external_data(content, "model", Path("model"))


def test_too_many_fields_are_refused(monkeypatch):
    monkeypatch.setattr("socialbot.core.inference.MAX_FIELDS", 1000)
    with pytest.raises(ParameterError, match="more than 1000 fields"):
        check_external_data(b"\x3a\x00" * 2000, "model")


def test_model_with_operators_of_others_is_refused():
    with pytest.raises(ParameterError, match="not a network that onnxruntime"):
        OnnxModel(echo_network(domain="com.example"))


def test_a_network_that_loops_without_end_is_stopped_and_not_run_again(monkeypatch):
    monkeypatch.setattr(inference.Inference.__init__, "__defaults__", (0.5,))
    network = OnnxModel(endless_network(), where="loop.onnx")
    for longest_s in (20.0, 0.1):
        begun = time.monotonic()
        with pytest.raises(ParameterError, match=r"loop\.onnx: the network takes more than 0\.5 s"):
            network.run(picture())
        assert time.monotonic() - begun < longest_s


def test_runs_of_a_network_start_no_thread_each(monkeypatch):
    """Four views of an image would start forty threads a second, which takes as long as the smallest view."""
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda thread: (started.append(thread), start(thread)))
    network = OnnxModel(included_model(FILE, SHA256))
    begun = time.monotonic()
    for _ in range(50):
        network.run(picture())
    assert len(started) <= 1 + time.monotonic() - begun, "at most one thread a second"


def test_a_network_that_takes_all_memory_is_stopped():
    network = OnnxModel(greedy_network(10**9), where="greedy.onnx")
    with pytest.raises(ParameterError, match=r"greedy\.onnx: the network takes more than 2\.1 GB of memory"):
        network.run(picture())


RUN = """
import sys, time
from socialbot.core import inference
from socialbot.core.errors import ParameterError
from socialbot.vision.network import OnnxModel
from tests.vision.networks import endless_network
from tests.vision.test_network import picture
inference.Inference.__init__.__defaults__ = (1.0,)
network = OnnxModel(endless_network(), where="loop.onnx")
print("runs", flush=True)
begun = time.process_time()
try:
    network.run(picture())
except ParameterError:
    print(time.process_time() - begun)
"""


def test_the_time_in_which_a_process_stands_still_does_not_count():
    """Otherwise a detector whose process is stopped for a minute would never look again."""
    with subprocess.Popen([sys.executable, "-c", RUN], stdout=subprocess.PIPE, text=True) as process:
        assert next_line(process) == "runs\n"
        time.sleep(0.5)  # into the run
        process.send_signal(signal.SIGSTOP)
        time.sleep(2.0)
        process.send_signal(signal.SIGCONT)
        assert float(next_line(process)) >= 1.0


def test_channels_may_come_last_and_numbers_may_be_small():
    network = OnnxModel(echo_network(shape=(1, "h", "w", 3), dtype="uint8"))
    (answer,) = network.run(picture())
    assert answer.dtype == np.uint8
    assert answer[0].tolist() == picture().transpose(1, 2, 0).tolist()
    (half,) = OnnxModel(echo_network(dtype="float16")).run(picture())
    assert half.dtype == np.float16


def test_no_such_file():
    with pytest.raises(ParameterError, match=r"nowhere\.onnx: no such file\n  remedy: name an ONNX file"):
        OnnxModel(Path("nowhere.onnx"))


def test_file_that_is_no_network_is_named(tmp_path):
    file = tmp_path / "holiday.onnx"
    file.write_bytes(b"not a network")
    with pytest.raises(ParameterError, match=r"holiday\.onnx: not a network that onnxruntime [0-9.]+ can run"):
        OnnxModel(file)


@pytest.mark.parametrize("shape", [(1, 4), (2, 3, 8, 8), (1, 1, 8, 8), (1, 8, 8, 4)])
def test_network_that_takes_something_else_than_a_image_is_refused(shape):
    sizes = " x ".join(map(str, shape))
    with pytest.raises(ParameterError, match=f"the model takes picture {sizes} float, expected"):
        OnnxModel(echo_network(shape=shape), where="model")


def test_error_names_the_input_that_fits():
    network = OnnxModel(strict_network(8, 6), where="strict")
    with pytest.raises(ParameterError, match=r"strict: an image of shape \(1, 3, 3, 4\) does not fit"):
        network.run(picture(4, 3))
    assert network.run(picture(8, 6))


def test_missing_onnxruntime_is_an_error_with_a_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InstallationError, match="install onnxruntime, or choose the detector hog"):
        OnnxModel(echo_network())


def test_importing_the_detectors_does_not_import_onnxruntime():
    code = "import sys, socialbot.vision.detectors; print('onnxruntime' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("False\n", 0), done.stderr


def test_threads_sleep_between_images():
    data = np.zeros((3, 320, 416), np.float32)
    tasks = Path("/proc/self/task")
    before = {task.name for task in tasks.iterdir()}
    network = OnnxModel(included_model(FILE, SHA256), threads=3)
    network.run(data)
    # The thread that calls works as well, and the one that limits the time ends soon.
    assert eventually(lambda: len({task.name for task in tasks.iterdir()} - before) <= 2)
    assert threading.active_count() >= 1
    begin = time.process_time()
    time.sleep(0.2)
    assert time.process_time() - begin < 0.1


def test_answers_do_not_depend_on_the_number_of_threads():
    data = np.random.default_rng(0).integers(0, 256, size=(3, 160, 224))
    answers = [OnnxModel(included_model(FILE, SHA256), threads=threads).run(data)[0] for threads in (1, 2, 4)]
    assert answers[0].tobytes() == answers[1].tobytes() == answers[2].tobytes()
