"""Processes of a running graph: they end well, come and go, and take parameters from ROS."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.bags.reader import BagWriter
from tests.system.running import eventually, results, running, socialbot

pytestmark = pytest.mark.ros


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(20):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((240, 320, 3), 10 * number, np.uint8))
    return folder


@pytest.fixture
def onlooker() -> Iterator[Any]:
    from socialbot.bridge.environment import spinning_node

    with spinning_node("onlooker") as ros:
        yield ros


def live(pictures: Path, out: Path, *more: object) -> list[object]:
    """Waldo on a folder of pictures, over and over."""
    return ["up", "--camera", pictures, "--out", out, "--set", "camera.loop=true", *more]


def stands(ros: Any) -> bool:
    from socialbot.bridge.graph_observer import await_graph
    from socialbot.graph.files import load_graph

    return not await_graph(ros, load_graph("waldo"), timeout_s=30.0)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("hosting", [(), ("--composed",)], ids=["process a node", "composed"])
def test_signals_end_every_process_with_code_0(
    pictures: Path, tmp_path: Path, onlooker: Any, how: signal.Signals, hosting: tuple[str, ...]
) -> None:
    with running(*live(pictures, tmp_path / "run", *hosting)) as process:
        assert stands(onlooker), process.stdout and process.stdout.read()
        process.send_signal(how)
        assert process.wait(15) == 0
    logs = tmp_path / "run" / "log"
    assert not [log for log in logs.glob("*.log") if "Traceback" in log.read_text()]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_node_leaves_and_joins_again(pictures: Path, tmp_path: Path, onlooker: Any, how: signal.Signals) -> None:
    def heads() -> int:
        return onlooker.get_node_names().count("head")

    with running("node", "head") as head:
        assert eventually(lambda: heads() == 1)
        head.send_signal(how)
        assert head.wait(15) == 0
    assert eventually(lambda: heads() == 0)
    with running("node", "head"):
        assert eventually(lambda: heads() == 1)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after_s", [0.35, 1.0, 2.0])
def test_signals_during_the_start_end_a_replay_with_code_0(
    short_bag: Path, tmp_path: Path, how: signal.Signals, after_s: float
) -> None:
    with running("replay", short_bag, "--out", tmp_path / "run", "--no-video") as process:
        sleep(after_s)
        process.send_signal(how)
        assert process.wait(15) == 0, process.stdout and process.stdout.read()


def test_a_node_refuses_what_only_it_can_judge_and_goes_on(onlooker: Any) -> None:
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    with running("node", "speech") as speech:
        client = AsyncParameterClient(onlooker, "speech")
        assert eventually(client.services_are_ready)
        future = client.set_parameters([Parameter("voice", value="no such voice")])
        assert eventually(future.done)
        answer = future.result()
        assert answer is not None
        assert not answer.results[0].successful
        assert "voice" in answer.results[0].reason
        assert speech.poll() is None


def test_a_node_that_raises_at_its_start_ends_the_replay(short_bag: Path, tmp_path: Path) -> None:
    graph = graph_with("StillbornDetector", tmp_path)
    done = socialbot("replay", short_bag, "--graph", graph, "--out", tmp_path / "run", "--no-video")
    assert done.returncode == 6
    assert "cannot start: RuntimeError: not today" in done.stderr


def test_damaged_messages_are_counted_through_ros_as_well(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for number in range(5):
            bag.write_raw("/camera/image_raw", "sensor_msgs/msg/Image", b"", 10**18 + number)
    done = socialbot("replay", tmp_path / "bag", "--out", tmp_path / "run", "--no-video")
    assert done.returncode == 3
    assert "5 damaged" in done.stderr
    assert results(tmp_path / "run")["bag"]["skipped"]["/camera/image_raw"]["count"] == 5


def test_two_graphs_in_one_domain_are_refused(short_bag: Path, tmp_path: Path, onlooker: Any) -> None:
    with running("node", "head"):
        assert eventually(lambda: "head" in onlooker.get_node_names())
        done = socialbot("replay", short_bag, "--out", tmp_path / "run", "--no-video")
    assert done.returncode == 6
    assert "head" in done.stderr
    assert "ROS_DOMAIN_ID" in done.stderr


def test_a_second_node_of_a_name_is_refused(onlooker: Any) -> None:
    with running("node", "head"):
        assert eventually(lambda: "head" in onlooker.get_node_names())
        done = socialbot("node", "head")
    assert done.returncode == 6
    assert "running already: head" in done.stderr


def test_a_node_that_was_killed_can_be_started_again_at_once(onlooker: Any) -> None:
    with running("node", "head") as head:
        assert eventually(lambda: "head" in onlooker.get_node_names())
        head.kill()
        head.wait()
    with running("node", "head") as head:
        assert eventually(lambda: onlooker.get_node_names().count("head") == 2)
        assert head.poll() is None


def test_parameters_have_ranges_and_change_at_run_time(onlooker: Any) -> None:
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    def ask(future: Any) -> Any:
        assert eventually(future.done)
        return future.result()

    with running("node", "bdi_engine", "--set", "bdi_engine.range_m=3.5"):
        client = AsyncParameterClient(onlooker, "bdi_engine")
        assert eventually(client.services_are_ready)
        described = ask(client.describe_parameters(["help_after_s"])).descriptors[0]
        assert "offered help" in described.description
        assert described.floating_point_range[0].from_value == 0.5
        assert ask(client.get_parameters(["range_m"])).values[0].double_value == 3.5
        too_short = [Parameter("help_after_s", value=0.1)]
        assert not ask(client.set_parameters(too_short)).results[0].successful
        assert ask(client.set_parameters([Parameter("help_after_s", value=4.0)])).results[0].successful
        assert ask(client.get_parameters(["help_after_s"])).values[0].double_value == 4.0
    with running("node", "speech"):
        client = AsyncParameterClient(onlooker, "speech")
        assert eventually(client.services_are_ready)
        fixed = ask(client.set_parameters([Parameter("playback", value="off")])).results[0]
        assert not fixed.successful
        assert "read" in fixed.reason.lower()


def graph_with(detector: str, folder: Path) -> Path:
    graph = folder / "graph.yaml"
    graph.write_text(
        "name: misbehaving\n"
        "inputs: [/camera/image_raw, /camera/image_raw/compressed]\n"
        "paced_by: /humans/bodies/detections\n"
        "nodes:\n"
        "  image_converter: {type: image_converter}\n"
        f"  detector: {{type: 'tests.system.nodes:{detector}'}}\n"
    )
    return graph


def test_a_detector_that_raises_is_counted_and_the_stream_goes_on(short_bag: Path, tmp_path: Path) -> None:
    graph, out = graph_with("RaisingDetector", tmp_path), tmp_path / "run"
    done = socialbot("replay", short_bag, "--graph", graph, "--out", out, "--rate", 3, "--no-video")
    assert done.returncode == 0, done.stderr
    assert "failed 5 of 10 times; first: RuntimeError: no idea" in done.stdout
    assert results(out)["frames"] == 5
    assert results(out)["nodes"]["detector"]["failures"] == 5


def test_a_process_that_dies_is_named_and_nothing_recorded_is_lost(short_bag: Path, tmp_path: Path) -> None:
    graph, out = graph_with("DyingDetector", tmp_path), tmp_path / "run"
    done = socialbot("replay", short_bag, "--graph", graph, "--out", out, "--no-video")
    assert done.returncode == 6
    assert "detector" in done.stderr
    assert "remedy" in done.stderr
    assert "Traceback" not in done.stderr
    assert len((out / "trace.jsonl").read_text().splitlines()) == 2
    assert results(out)["frames"] == 2
    assert "detector" in results(out)["ended"]
