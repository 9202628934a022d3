"""Processes of a running graph: signals, restarts, parameters and faults."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import psutil
import pytest

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.graph_observer import await_graph
from socialbot.bridge.keys import new_key
from socialbot.graph.files import load_graph
from socialbot.runtime.launch import Launch
from tests.system.nodes import detector_graph
from tests.system.running import PATIENCE_S, cut, eventually, is_alive, results, running, socialbot, socialbot_here

pytestmark = pytest.mark.ros


@pytest.mark.slow
def test_a_process_that_cannot_leave_dds_ends_well(tmp_path: Path) -> None:
    graph = load_graph(str(detector_graph("DetectorThatCannotLeave", tmp_path)))
    with Launch(graph, tmp_path / "log") as launch, spinning_node("onlooker") as ros:
        assert not await_graph(ros, graph, timeout_s=PATIENCE_S)
    assert launch.exit_codes == {"detector": 0, "image_converter": 0}


@pytest.fixture
def onlooker() -> Iterator[Any]:
    with spinning_node("onlooker") as ros:
        yield ros


def live(pictures: Path, out: Path, *more: object) -> list[object]:
    """Arguments that run Waldo on a folder of images in a loop."""
    return ["up", "--camera", pictures, "--out", out, "--set", "camera.loop=true", *more]


def is_connected(ros: Any) -> bool:
    return not await_graph(ros, load_graph("waldo"), timeout_s=PATIENCE_S)


@pytest.mark.parametrize(
    ("how", "hosting"),
    [
        pytest.param(signal.SIGINT, (), marks=pytest.mark.slow, id="SIGINT, process a node"),
        pytest.param(signal.SIGTERM, ("--composed",), id="SIGTERM, composed"),
    ],
)
def test_signals_end_every_process_with_code_0(
    pictures: Path, tmp_path: Path, onlooker: Any, how: signal.Signals, hosting: tuple[str, ...]
) -> None:
    with running(*live(pictures, tmp_path / "run", *hosting)) as process:
        assert is_connected(onlooker)
        process.send_signal(how)
        assert process.wait(PATIENCE_S) == 0
    logs = tmp_path / "run" / "log"
    assert not [log for log in logs.glob("*.log") if "Traceback" in log.read_text()]


@pytest.mark.parametrize(
    "hosting", [pytest.param((), marks=pytest.mark.slow), ("--composed",)], ids=["node", "composed"]
)
def test_a_closed_terminal_ends_every_process_and_keeps_the_record(
    pictures: Path, tmp_path: Path, onlooker: Any, hosting: tuple[str, ...]
) -> None:
    """As does a lost connection of ssh: the kernel sends SIGHUP, and writing fails."""
    terminal, end = pty.openpty()
    command = [sys.executable, "-m", "socialbot", *map(str, live(pictures, tmp_path / "run", *hosting))]
    login = "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", login, *command], stdin=end, stdout=end, stderr=end, start_new_session=True
    )
    os.close(end)
    try:
        assert is_connected(onlooker)
        children = [each.pid for each in psutil.Process(process.pid).children(recursive=True)]
        os.close(terminal)
        assert process.wait(PATIENCE_S) == 0
        assert eventually(lambda: not any(map(is_alive, children)))
    finally:
        process.kill()
        process.wait()
    assert results(tmp_path / "run")["graph"] == "waldo"


def test_a_node_leaves_on_both_signals_and_joins_again(onlooker: Any) -> None:
    def heads() -> int:
        return onlooker.get_node_names().count("head")

    for how in (signal.SIGINT, signal.SIGTERM):
        with running("node", "head") as head:
            assert eventually(lambda: heads() == 1)
            head.send_signal(how)
            assert head.wait(PATIENCE_S) == 0
        assert eventually(lambda: heads() == 0)


def handles_sigterm(pid: int) -> bool:
    """Whether the process has installed its own handler: Python has none for SIGTERM."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def processor_s(pid: int) -> float:
    times = psutil.Process(pid).cpu_times()
    return times.user + times.system


@pytest.mark.parametrize(
    ("stage", "how"),
    [
        ("first import", signal.SIGTERM),
        ("imports", signal.SIGINT),
        ("launch", signal.SIGTERM),
        pytest.param("first import", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("imports", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("launch", signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_signals_during_the_start_end_a_replay_with_code_0(
    short_bag: Path, tmp_path: Path, stage: str, how: signal.Signals
) -> None:
    def is_reached() -> bool:
        if stage == "launch":
            return (tmp_path / "run" / "log" / "graph.yaml").exists()
        return handles_sigterm(process.pid) and (stage == "first import" or processor_s(process.pid) > 0.4)

    graph = detector_graph("Detector", tmp_path)
    with running(
        "replay", short_bag, "--runner", "ros", "--graph", graph, "--out", tmp_path / "run", "--no-video"
    ) as process:
        assert eventually(is_reached, PATIENCE_S)
        process.send_signal(how)
        assert process.wait(PATIENCE_S) == 0


def result_of(future: Any) -> Any:
    assert eventually(future.done)
    return future.result()


@pytest.fixture(scope="class")
def speech_and_mind() -> Iterator[subprocess.Popen[str]]:
    """A process with the nodes ``speech`` and ``bdi_engine``."""
    with running("node", "speech", "bdi_engine", "--set", "bdi_engine.range_m=3.5") as process:
        yield process


class TestParameters:
    def test_invalid_and_fixed_ones_are_refused(self, speech_and_mind: subprocess.Popen[str], onlooker: Any) -> None:
        from rclpy.parameter import Parameter
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(onlooker, "speech")
        assert eventually(client.services_are_ready)
        invalid = result_of(client.set_parameters([Parameter("voice", value="no such voice")])).results[0]
        assert not invalid.successful
        assert "voice" in invalid.reason
        fixed = result_of(client.set_parameters([Parameter("playback", value="off")])).results[0]
        assert not fixed.successful
        assert "read" in fixed.reason.lower()
        assert speech_and_mind.poll() is None

    def test_have_ranges_and_change_at_run_time(self, speech_and_mind: subprocess.Popen[str], onlooker: Any) -> None:
        from rclpy.parameter import Parameter
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(onlooker, "bdi_engine")
        assert eventually(client.services_are_ready)
        described = result_of(client.describe_parameters(["help_after_s"])).descriptors[0]
        assert "help is offered" in described.description
        assert described.floating_point_range[0].from_value == 0.5
        assert result_of(client.get_parameters(["range_m"])).values[0].double_value == 3.5
        too_short = [Parameter("help_after_s", value=0.1)]
        assert not result_of(client.set_parameters(too_short)).results[0].successful
        assert result_of(client.set_parameters([Parameter("help_after_s", value=4.0)])).results[0].successful
        assert result_of(client.get_parameters(["help_after_s"])).values[0].double_value == 4.0
        assert speech_and_mind.poll() is None


@pytest.mark.slow
def test_a_second_up_names_the_first_and_a_killed_one_leaves_no_process(
    pictures: Path, tmp_path: Path, onlooker: Any
) -> None:
    with running(*live(pictures, tmp_path / "run")) as process:
        assert is_connected(onlooker)
        children = [each.pid for each in psutil.Process(process.pid).children(recursive=True)]
        second = socialbot(*live(pictures, tmp_path / "second"))
        assert second.returncode == 6
        assert f"process {process.pid}" in second.stderr
        process.kill()
        assert eventually(lambda: not any(map(is_alive, children)))


BLOCKED_UP = """
import functools, sys
from pathlib import Path
from socialbot.core import process_guard
from socialbot.runtime.launch import Supervisor
from tests.system.nodes import deadlock

def attend(self, timeout_s, attend=Supervisor.attend):
    if Path(sys.argv[-1], "block").exists():
        deadlock()
    attend(self, timeout_s)

Supervisor.attend = attend
process_guard.guarded = functools.partial(process_guard.guarded, end_s=1.0)
from socialbot.__main__ import run
run()
"""


@pytest.mark.slow
def test_up_ends_at_a_signal_even_if_dds_blocks_it(pictures: Path, tmp_path: Path, onlooker: Any) -> None:
    command = [sys.executable, "-c", BLOCKED_UP, *map(str, live(pictures, tmp_path / "run", "--minds", tmp_path))]
    with (tmp_path / "up.log").open("w") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    try:
        assert is_connected(onlooker)
        children = [each.pid for each in psutil.Process(process.pid).children(recursive=True)]
        (tmp_path / "block").touch()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) in (-signal.SIGQUIT, -signal.SIGKILL)
        assert eventually(lambda: not any(map(is_alive, children)))
    finally:
        process.kill()
        process.wait()
    text = (tmp_path / "up.log").read_text()
    assert f"process {process.pid} did not end within 1 s after a signal and is killed; its threads:" in text
    assert "in attend" in text


UP_WITH_PAGE = """
import psutil
from socialbot.runs import report

def write_report(folder, title, write_report=report.write_report):
    commands = [" ".join(child.cmdline()) for child in psutil.Process().children()]
    print("guards:", sum("_process_guard.py" in command for command in commands))
    return write_report(folder, title)

report.write_report = write_report
from socialbot.__main__ import run
run()
"""


@pytest.mark.slow
def test_the_page_of_a_long_run_has_no_time_limit(pictures: Path, tmp_path: Path, onlooker: Any) -> None:
    """The guard would kill a process that writes it; a day of records takes a minute on a busy machine."""
    more = ("--inspect", "--port", "0")
    command = [sys.executable, "-c", UP_WITH_PAGE, *map(str, live(pictures, tmp_path / "run", *more))]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    try:
        assert is_connected(onlooker)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        process.wait()
    assert "guards: 0" in output
    assert (tmp_path / "run" / "report.html").exists()


@pytest.mark.slow
def test_a_blocked_node_does_not_outlive_a_killed_up(
    tmp_path: Path, onlooker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BLOCKED", str(tmp_path / "blocked"))
    file = detector_graph("BlockedDetector", tmp_path)
    with running("up", file, "--out", tmp_path / "run") as process:
        assert not await_graph(onlooker, load_graph(str(file)), timeout_s=PATIENCE_S)
        children = [each.pid for each in psutil.Process(process.pid).children(recursive=True)]
        (tmp_path / "blocked").touch()
        process.kill()
        assert eventually(lambda: not any(map(is_alive, children)))


@pytest.mark.slow
def test_a_replay_with_keys_refuses_nothing(short_bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between processes DDS fills up messages to whole words, of which seals must not depend."""
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    done = socialbot("replay", short_bag, "--runner", "ros", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    logs = "".join(path.read_text() for path in (tmp_path / "run" / "log").glob("*.log"))
    assert "refused" not in logs
    records = [json.loads(line) for line in (tmp_path / "run" / "seen.jsonl").read_text().splitlines()]
    assert len(records) >= 10


def test_an_error_at_the_start_of_a_node_ends_the_replay(short_bag: Path, tmp_path: Path) -> None:
    graph = detector_graph("StillbornDetector", tmp_path)
    done = socialbot_here(
        "replay", short_bag, "--runner", "ros", "--graph", graph, "--out", tmp_path / "run", "--no-video", "--composed"
    )
    assert done.returncode == 6
    assert "cannot start: RuntimeError: not today" in done.stderr


@pytest.mark.slow
def test_counts_damaged_messages_over_ros(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for number in range(2):
            bag.write_raw("/camera/image_raw", "sensor_msgs/msg/Image", b"", 10**18 + number)
    graph = detector_graph("Detector", tmp_path)
    options = ("--out", tmp_path / "run", "--rate", 10, "--no-video", "--composed")
    done = socialbot_here("replay", tmp_path / "bag", "--runner", "ros", "--graph", graph, *options)
    assert done.returncode == 3
    assert "2 damaged" in done.stderr
    assert results(tmp_path / "run")["bag"]["skipped"]["/camera/image_raw"]["count"] == 2


def test_a_replay_beside_a_node_of_its_names_is_refused(short_bag: Path, tmp_path: Path, onlooker: Any) -> None:
    graph = detector_graph("Detector", tmp_path)
    graph.write_text(graph.read_text().replace("  detector:", "  head:"))
    with running("node", "head"):
        assert eventually(lambda: "head" in onlooker.get_node_names())
        done = socialbot_here(
            "replay", short_bag, "--runner", "ros", "--no-video", "--composed", "--graph", graph,
            "--out", tmp_path / "joined", "--domain", os.environ["ROS_DOMAIN_ID"],
        )  # fmt: skip
    assert done.returncode == 6
    assert "head" in done.stderr
    assert "ROS_DOMAIN_ID" in done.stderr


@pytest.mark.slow
def test_a_second_node_of_a_name_is_refused_in_the_same_domain_only(
    short_bag: Path, tmp_path: Path, onlooker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nodes of the same names in another domain neither stop a replay nor reach it."""
    graph = detector_graph("Detector", tmp_path)
    graph.write_text(graph.read_text().replace("  detector:", "  head:"))
    replay = ("replay", short_bag, "--runner", "ros", "--no-video", "--composed", "--graph", graph)
    with running("node", "head"):
        assert eventually(lambda: "head" in onlooker.get_node_names())
        node = socialbot("node", "head")
        joined = socialbot_here(*replay, "--out", tmp_path / "joined", "--domain", os.environ["ROS_DOMAIN_ID"])
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        alone = socialbot_here(*replay, "--out", tmp_path / "alone", "-v")
    assert node.returncode == 6
    assert "running already: head" in node.stderr
    assert joined.returncode == 6
    assert "head" in joined.stderr
    assert "ROS_DOMAIN_ID" in joined.stderr
    assert alone.returncode == 0
    assert re.search(r"^ROS domain (6\d|7\d|8\d|9\d|100);", alone.stdout, re.MULTILINE)


@pytest.mark.parametrize("options", [("--domain", "7"), ("--composed",), ("--no-pace",), ("--rate", "2")])
def test_an_inline_replay_refuses_options_of_ros(short_bag: Path, options: tuple[str, ...]) -> None:
    done = socialbot_here("replay", short_bag, *options)
    name = options[0].replace("--no-", "--")
    assert (done.returncode, f"{name}: without effect without --runner ros" in done.stderr) == (4, True), done.stderr


@pytest.mark.slow
def test_a_killed_node_can_be_restarted_at_once(onlooker: Any) -> None:
    with running("node", "head") as head:
        assert eventually(lambda: endpoints(onlooker, "head"))
        before = endpoints(onlooker, "head")
        head.kill()
        head.wait()
    with running("node", "head") as head:
        assert eventually(lambda: endpoints(onlooker, "head") - before)
        assert head.poll() is None


def endpoints(onlooker: Any, node: str) -> set[bytes]:
    """Return the ids of the publishers of a node, perhaps with those of a killed one of its name."""
    found = onlooker.get_publishers_info_by_topic("/parameter_events")
    return {bytes(info.endpoint_gid) for info in found if info.node_name == node}


@pytest.mark.slow
def test_counts_failures_of_a_detector_and_continues(corridor: Path, tmp_path: Path) -> None:
    bag, out = cut(corridor, tmp_path / "bag", 0.0, 0.4), tmp_path / "run"
    graph = detector_graph("RaisingDetector", tmp_path)
    done = socialbot_here(
        "replay", bag, "--runner", "ros", "--graph", graph, "--out", out, "--rate", 3, "--no-video", "--composed"
    )
    assert done.returncode == 0, done.stderr
    assert "failed 2 of 4 times; first: RuntimeError: no idea" in done.stdout
    assert results(out)["frames"] == 2
    assert results(out)["nodes"]["detector"]["failures"] == 2


def test_a_crash_ends_a_replay_and_keeps_its_record(short_bag: Path, tmp_path: Path) -> None:
    graph, out = detector_graph("DyingDetector", tmp_path), tmp_path / "run"
    done = socialbot_here("replay", short_bag, "--runner", "ros", "--graph", graph, "--out", out, "--no-video")
    assert done.returncode == 6
    assert "detector" in done.stderr
    assert "remedy" in done.stderr
    assert "Traceback" not in done.stderr
    assert len((out / "trace.jsonl").read_text().splitlines()) == 2
    assert results(out)["frames"] == 2
    assert "detector" in results(out)["ended"]


NEWER = 3
"""Number of images that arrive while a slow detector looks at one."""


@pytest.mark.parametrize(
    "hosting",
    [pytest.param((), id="process a node", marks=pytest.mark.slow), pytest.param(("--composed",), id="composed")],
)
def test_a_slow_detector_processes_the_newest_images(corridor: Path, tmp_path: Path, hosting: tuple[str, ...]) -> None:
    bag, graph, looks = cut(corridor, tmp_path / "bag", 0.0, 3.0), tmp_path / "graph.yaml", tmp_path / "looks.jsonl"
    with open_bag(bag) as images:
        end = images.end
    graph.write_text(
        "name: slow\n"
        "inputs: [/camera/image_raw, /camera/image_raw/compressed]\n"
        "nodes:\n"
        "  image_converter: {type: image_converter}\n"
        "  detector: {type: 'tests.system.nodes:SlowDetector', "
        f"parameters: {{newer: {NEWER}, end: {end}, record: '{looks}'}}}}\n"
    )
    out = tmp_path / "run"
    done = socialbot_here(
        *("replay", bag, "--runner", "ros", "--graph", graph, "--out", out, "--no-video"),
        *("--no-pace", "--rate", 0.5, *hosting),
    )
    assert done.returncode == 0, done.stderr
    looked = [json.loads(line) for line in looks.read_text().splitlines()]
    stamps = [look["stamp"] for look in looked]
    assert stamps == sorted(set(stamps))
    # An image of a look may wait for newer ones only while the node is as fast as they arrive.
    waiting = [look["waiting"] for look in looked if look["is_slower"]]
    assert waiting, looked
    assert median(waiting) < 1
    assert results(out)["nodes"]["detector"]["skipped"] > 0
