"""Pictures from a robot to a workstation over real DDS: all of them, in time, and back at once after an outage."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bridge.environment import Across, prepare
from socialbot.core.clock import SECOND
from tests.system.running import eventually
from tests.system.two_hosts import ROBOT, WORKSTATION, Host, TwoHosts, two_hosts

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
GRAPH = """
name: far
nodes:
  camera: {{type: camera, parameters: {{source: '{film}', rate_hz: 30.0, loop: true}}}}
  picture_sender: {{type: picture_sender}}
  publishing: {{type: 'tests.system.nodes:Watch', parameters: {{record: '{sent}'}}}}
  picture_receiver: {{type: picture_receiver}}
  arriving:
    type: tests.system.nodes:Watch
    parameters: {{record: '{arrived}'}}
    remap: {{image: /camera/image_raw/received}}
"""


@dataclass(frozen=True)
class Film:
    """Images of the camera, and the images that reach the other host."""

    hosts: TwoHosts
    sent: Path
    arrived: Path
    cpu: Mapping[str, int]

    def judge(self, seconds: float) -> tuple[float, float]:
        """The share of the next pictures that arrive, and the latency (s) that 99 % of them stay below."""
        begin = time.time_ns()
        time.sleep(seconds)
        end = time.time_ns()
        time.sleep(1.0)
        taken = {stamp for stamp, _ in rows(self.sent) if begin <= stamp < end}
        ages = [(when - stamp) / SECOND for stamp, when in rows(self.arrived) if stamp in taken]
        return len(ages) / len(taken), float(np.percentile(ages, 99))

    def cpu_s(self) -> float:
        """Processor seconds that camera and sender have used."""
        ticks = (Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13] for pid in self.cpu.values())
        return sum(int(user) + int(system) for user, system in ticks) / os.sysconf("SC_CLK_TCK")


def rows(path: Path) -> list[tuple[int, int]]:
    """Stamp and time of arrival (ns) of each picture."""
    lines = (line.split() for line in path.read_text().splitlines())
    return [(int(line[0]), int(line[1])) for line in lines if len(line) == 2]


@contextmanager
def film_over(hosts: TwoHosts, folder: Path) -> Iterator[Film]:
    writer = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (640, 480))
    rng = np.random.default_rng(1)
    scene = cv2.resize(rng.integers(0, 255, (60, 80, 3), np.uint8), (700, 540), interpolation=cv2.INTER_CUBIC)
    for shift in range(60):
        writer.write(np.ascontiguousarray(scene[shift : shift + 480, shift : shift + 640]))
    writer.release()
    sent, arrived = folder / "sent", folder / "arrived"
    graph = folder / "graph.yaml"
    graph.write_text(GRAPH.format(film=folder / "film.avi", sent=sent, arrived=arrived))
    processes = {}
    with ExitStack() as undo:

        def start(host: Host, peer: str, name: str, *, raw: bool) -> None:
            variables: dict[str, str] = {"PYTHONPATH": str(ROOT)}
            prepare(variables, domain=0, log_folder=folder, across=Across(peers=(peer,)), raw_pictures=raw)
            with (folder / f"{name}.log").open("w") as log:
                command = (sys.executable, "-m", "socialbot", "node", "--graph", graph, name)
                processes[name] = process = host.start(*command, variables=variables, stdout=log, stderr=log)
            undo.callback(process.wait, 20)
            undo.callback(process.terminate)

        for name, raw in (("camera", True), ("publishing", True), ("picture_sender", False)):
            start(hosts.robot, WORKSTATION, name, raw=raw)
        for name, raw in (("picture_receiver", True), ("arriving", True)):
            start(hosts.workstation, ROBOT, name, raw=raw)
        assert eventually(lambda: arrived.exists() and len(rows(arrived)) > 30, 60), logs(folder)
        yield Film(hosts, sent, arrived, {name: processes[name].pid for name in ("camera", "picture_sender")})


def logs(folder: Path) -> str:
    return "\n".join(f"{log.name}: {log.read_text()}" for log in folder.glob("*.log"))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Film]:
    with two_hosts() as hosts, film_over(hosts, tmp_path_factory.mktemp("film")) as film:
        yield film


@pytest.fixture(autouse=True)
def clear(film: Film) -> None:
    film.hosts.clear()
    time.sleep(2.0)


def test_a_good_link_delivers_every_image_with_few_bytes(film: Film) -> None:
    before, begin = film.cpu_s(), time.monotonic()
    share, late_s = film.judge(6.0)
    load = (film.cpu_s() - before) / (time.monotonic() - begin)
    assert share >= 0.99
    assert late_s < 0.25
    assert load < 0.3


def test_a_slow_and_lossy_link_delivers_most_images(film: Film) -> None:
    film.hosts.limit(20)
    film.hosts.lose(5)
    share, late_s = film.judge(10.0)
    assert share >= 0.95
    assert late_s <= 0.25


@pytest.mark.parametrize(("down_s", "back_s"), [(5.0, 1.0), (30.0, 3.0)])
def test_images_resume_soon_after_an_outage(film: Film, down_s: float, back_s: float) -> None:
    film.hosts.cut()
    time.sleep(down_s)
    film.hosts.mend()
    up = time.time_ns()
    time.sleep(back_s + 1.0)
    after = [(stamp, when) for stamp, when in rows(film.arrived) if when > up]
    assert after
    assert after[0][1] - up < back_s * SECOND
    assert all(when - stamp < SECOND for stamp, when in after)


def test_discovery_uses_little_of_the_link(film: Film) -> None:
    """The workstation sends only acknowledgements and announcements."""
    before = film.hosts.sent_bytes()[1]
    time.sleep(3.0)
    assert (film.hosts.sent_bytes()[1] - before) * 8 / 3.0 < 600e3
