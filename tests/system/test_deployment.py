"""A deployment on two hosts: camera, speech and head on the robot, all else on the workstation."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep

import cv2
import msgspec
import psutil
import pytest

from socialbot.bags.reader import open_bag
from socialbot.bridge.keys import new_key
from socialbot.core.messages import CompressedImage, TraceRecord
from socialbot.vision.images import bgr_from_compressed
from tests.runtime.deployments import PLACES
from tests.system.running import PATIENCE_S, eventually
from tests.system.two_hosts import ROBOT, WORKSTATION, Host, TwoHosts, two_hosts

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]
RATE_HZ = 5
PAGE = f"""
graph: waldo
{PLACES}\
parameters:
  camera: {{source: film.avi, rate_hz: {RATE_HZ}, loop: true}}
  bdi_engine: {{greeting: Hallo}}
  speech: {{playback: 'off'}}
"""
LIMIT_S = 600.0
"""Time for both halves to start, to see a person and to speak, on a busy machine."""
FILM_S = (8.0, 12.0)
"""The part of the corridor in which a person is near; it is played at half its speed."""


@pytest.fixture
def folder(corridor: Path, tmp_path: Path) -> Path:
    writer = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, (640, 480))
    begin_s, end_s = FILM_S
    with open_bag(corridor) as bag:
        topics = {topic.name: topic.name for topic in bag.image_topics}
        for _, message in bag.messages(topics):
            if isinstance(message, CompressedImage) and begin_s <= (message.stamp - bag.start) / 1e9 < end_s:
                writer.write(bgr_from_compressed(message))
    writer.release()
    (tmp_path / "waldo.yaml").write_text(PAGE.replace("film.avi", str(tmp_path / "film.avi")))
    return tmp_path


@contextmanager
def half(host: Host, folder: Path, *options: object) -> Iterator[subprocess.Popen[str]]:
    """The half of the deployment that belongs on ``host``; it ends with the block, with exit code 0."""
    with (folder / f"{host.name}.log").open("w") as log:
        process = host.start(
            *(sys.executable, "-m", "socialbot", "up", folder / "waldo.yaml", "--out", folder / host.address, *options),
            variables={"PYTHONPATH": str(ROOT)},
            stdout=log,
            stderr=log,
        )
    try:
        yield process
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0, (folder / f"{host.name}.log").read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def records(folder: Path, address: str, kind: str = "") -> list[TraceRecord]:
    """Records of one kind in the trace of one machine, or all."""
    trace = folder / address / "trace.jsonl"
    lines = trace.read_bytes().splitlines() if trace.exists() else []
    found = (msgspec.json.decode(line, type=TraceRecord) for line in lines)
    return [record for record in found if kind in ("", record.kind)]


def logs(folder: Path) -> str:
    return "\n".join(f"{log.name}: {log.read_text()}" for log in sorted(folder.rglob("*.log")))


def speaks_and_sees(folder: Path) -> bool:
    spoken = any(one.what == "finished" for one in records(folder, ROBOT, "speech"))
    return spoken and len(records(folder, WORKSTATION, "detection")) > 10


def check_run(folder: Path, hosts: TwoHosts) -> None:
    """The robot has greeted by what the workstation has seen and decided; no raw picture is on the cable."""
    assert records(folder, ROBOT, "utterance")[0].what == "Hallo"
    assert list((folder / ROBOT / "speech").glob("001-hallo.wav"))
    assert not list((folder / WORKSTATION / "speech").glob("*"))
    frames = records(folder, WORKSTATION, "detection")
    assert any(frame.what == "1 person" for frame in frames)
    # Both machines send about as much while they find each other.
    robot_before, workstation_before = hosts.sent_bytes()
    seen = len(frames)
    wanted = seen + 6 * RATE_HZ
    assert eventually(lambda: len(records(folder, WORKSTATION, "detection")) > wanted, LIMIT_S), logs(folder)
    robot, workstation = hosts.sent_bytes()
    new = records(folder, WORKSTATION, "detection")[seen - 1 :]
    raw = 640 * 480 * RATE_HZ * (new[-1].stamp - new[0].stamp) / 1e9
    assert workstation - workstation_before < robot - robot_before < raw


@pytest.mark.slow  # make test-pages runs it
def test_two_machines_run_one_graph(folder: Path) -> None:
    """The workstation comes first, and finds out by itself which machine it is."""
    for name in ("robot", "workstation"):
        new_key(name, folder / "keys")
    with (folder / "waldo.yaml").open("a") as page:
        page.write("security: {keys: keys}\n")
    with two_hosts() as hosts, half(hosts.workstation, folder), half(hosts.robot, folder, "--machine", "robot"):
        assert eventually(lambda: speaks_and_sees(folder), LIMIT_S), logs(folder)
        check_run(folder, hosts)


@pytest.mark.slow
def test_the_workstation_may_start_later(folder: Path) -> None:
    with two_hosts() as hosts, half(hosts.robot, folder) as robot:
        sleep(20.0)
        assert robot.poll() is None
        with half(hosts.workstation, folder):
            assert eventually(lambda: speaks_and_sees(folder), LIMIT_S), logs(folder)
            check_run(folder, hosts)


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["cable", "address"])
def test_the_network_of_the_robot_may_start_later(folder: Path, missing: str) -> None:
    """Processes that started without the network know only the loopback."""
    with two_hosts() as hosts:
        address = ("address", "{}", f"{ROBOT}/24", "dev", hosts.robot.device)
        if missing == "cable":
            hosts.cut()
        else:
            hosts.robot.run("ip", *(word.format("delete") for word in address))
        with half(hosts.workstation, folder), half(hosts.robot, folder, "--machine", "robot"):
            log = folder / f"{hosts.robot.name}.log"
            assert eventually(lambda: "is down on this machine" in log.read_text(), LIMIT_S), logs(folder)
            sleep(5.0)
            assert records(folder, WORKSTATION, "detection") == []
            if missing == "cable":
                hosts.mend()
            else:
                hosts.robot.run("ip", *(word.format("add") for word in address))
            assert eventually(lambda: speaks_and_sees(folder), LIMIT_S), logs(folder)
            assert "restart everything" in log.read_text()
            assert list((folder / ROBOT / "speech").glob("001-hallo.wav"))


@pytest.mark.slow
def test_finds_nodes_restarted_while_the_link_was_down(folder: Path) -> None:
    with two_hosts() as hosts, half(hosts.workstation, folder), half(hosts.robot, folder) as robot:
        assert eventually(lambda: speaks_and_sees(folder), LIMIT_S), logs(folder)
        hosts.cut()
        sleep(2.0)
        [camera] = [child for child in psutil.Process(robot.pid).children(recursive=True) if child.name() == "camera"]
        camera.kill()
        log = folder / f"{hosts.robot.name}.log"
        assert eventually(lambda: "camera is back" in log.read_text(), LIMIT_S), logs(folder)
        before = len(records(folder, WORKSTATION, "detection"))
        hosts.mend()
        assert eventually(lambda: len(records(folder, WORKSTATION, "detection")) > before + 10, 30), logs(folder)
        assert "camera is started again, because a service came up after it" in log.read_text()
        assert "restart everything" not in log.read_text()


def servers(up: subprocess.Popen[str]) -> list[int]:
    """The discovery servers that a half has started."""
    found = []
    for child in psutil.Process(up.pid).children():
        with suppress(psutil.NoSuchProcess):  # it has just ended
            if any("fast-discovery-server" in argument for argument in child.cmdline()):
                found.append(child.pid)
    return found


@pytest.mark.slow
def test_the_machine_of_the_discovery_server_runs_it(folder: Path) -> None:
    """The server is killed once, before the other machine starts; it ends with its own machine."""
    with (folder / "waldo.yaml").open("a") as page:
        page.write("discovery: {server: robot}\n")
    with two_hosts() as hosts:
        with half(hosts.robot, folder) as robot:
            assert eventually(lambda: bool(servers(robot)), 60), logs(folder)
            [first] = servers(robot)
            os.kill(first, signal.SIGKILL)
            assert eventually(lambda: bool(servers(robot)) and servers(robot) != [first]), logs(folder)
            with half(hosts.workstation, folder) as workstation:
                assert eventually(lambda: speaks_and_sees(folder), LIMIT_S), logs(folder)
                assert records(folder, ROBOT, "utterance")[0].what == "Hallo"
                assert servers(workstation) == []
            [last] = servers(robot)
        assert not Path(f"/proc/{last}").exists()
