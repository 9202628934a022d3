"""Images from a robot to a workstation: by the adaptive link, and as CompressedImage as ROS programs publish them.

``python -m evaluation.picture_links`` compares both on good and bad networks. A plain publisher sends a JPEG of each
image, best effort, and keeps the last one only.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Generic

import cv2
import numpy as np
import typer

from evaluation.faults_plan import cpu_s
from evaluation.hosts import ROBOT, ROOT, WORKSTATION, Host, N, SwitchedHosts, switched_hosts
from evaluation.report import JsonOption, QuickOption, Report, Value, run
from evaluation.switch import Quality
from socialbot.bridge.environment import Across, prepare
from socialbot.core.clock import SECOND

GRAPH = """
name: far
nodes:
  camera: {{type: camera, parameters: {{source: '{film}', rate_hz: 30.0, loop: true}}}}
  picture_sender: {{type: picture_sender}}
  publishing: {{type: 'evaluation.transport_nodes:ImageTimes', parameters: {{record: '{sent}'}}}}
  picture_receiver: {{type: picture_receiver}}
  arriving:
    type: evaluation.transport_nodes:ImageTimes
    parameters: {{record: '{arrived}'}}
    remap: {{image: /camera/image_raw/received}}
"""
QUALITIES: Mapping[str, Quality] = {
    "clear": Quality(),
    "20 Mbit/s, 5 % lost": Quality(mbit_s=20, loss=0.05),
    "40 +- 30 ms, out of order": Quality(delay_ms=40, jitter_ms=30),
    "200 ms": Quality(delay_ms=200),
    "20 % lost in bursts": Quality(loss=0.2, burst=5),
    "5 Mbit/s": Quality(mbit_s=5.0, queue_ms=200),
    "1 Mbit/s": Quality(mbit_s=1.0, queue_ms=200),
}
STARTED_WITHIN_S = 120.0
STILL_COMING_S = 1.0
QUICK_SETTLE_S = 3.0
SETTLE_S = 15.0  # Time to adapt to a network.
AS_GOOD = 0.1


@dataclass(frozen=True)
class Film(Generic[N]):
    """Images of the camera, and the images that reach the other host."""

    hosts: N
    sent: Path
    arrived: Path
    cpu: Mapping[str, int] = field(default_factory=dict)

    def arrivals(self) -> list[tuple[int, int]]:
        """Stamp and time of arrival (ns) of each image so far."""
        return rows(self.arrived)

    def ages(self, seconds: float) -> tuple[int, list[float]]:
        """The number of images of the next ``seconds``, and the ages (s) of those that arrive."""
        begin = time.time_ns()
        time.sleep(seconds)
        end = time.time_ns()
        time.sleep(STILL_COMING_S)
        taken = {stamp for stamp, _ in rows(self.sent) if begin <= stamp < end}
        return len(taken), [(when - stamp) / SECOND for stamp, when in rows(self.arrived) if stamp in taken]

    def judge(self, seconds: float) -> tuple[float, float]:
        """The share of the next images that arrive, and the latency (s) that 99 % of them stay below."""
        taken, ages = self.ages(seconds)
        return len(ages) / taken, float(np.percentile(ages, 99))

    def cpu_s(self) -> float:
        """Processor seconds that camera and sender have used."""
        return sum(map(cpu_s, self.cpu.values()))


def rows(path: Path) -> list[tuple[int, int]]:
    """Stamp and time (ns) of each image in a file; an incomplete last line is left out."""
    if not path.exists():
        return []
    lines = (line.split() for line in path.read_text().splitlines())
    return [(int(line[0]), int(line[1])) for line in lines if len(line) == 2]


def write_film(path: Path) -> None:
    """Write two seconds of a moving camera."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (640, 480))
    rng = np.random.default_rng(1)
    scene = cv2.resize(rng.integers(0, 255, (60, 80, 3), np.uint8), (700, 540), interpolation=cv2.INTER_CUBIC)
    for shift in range(60):
        writer.write(np.ascontiguousarray(scene[shift : shift + 480, shift : shift + 640]))
    writer.release()


@contextmanager
def adaptive_link(hosts: N, folder: Path) -> Iterator[Film[N]]:
    """Send the film over the link of a deployment, from its first images on."""
    film, sent, arrived = folder / "film.avi", folder / "sent", folder / "arrived"
    write_film(film)
    graph = folder / "graph.yaml"
    graph.write_text(GRAPH.format(film=film, sent=sent, arrived=arrived))
    with _Processes(folder) as processes:
        here, there = hosts.machines["robot"], hosts.machines["workstation"]
        for host, peer, name, raw in (
            (here, there, "camera", True),
            (here, there, "publishing", True),
            (here, there, "picture_sender", False),
            (there, here, "picture_receiver", True),
            (there, here, "arriving", True),
        ):
            command = ("-m", "socialbot", "node", "--graph", graph, name)
            processes.start(name, host, *command, across=Across(peers=(peer.address,)), raw_pictures=raw)
        processes.await_images(arrived)
        pids = processes.pids
        yield Film(hosts, sent, arrived, {name: pids[name] for name in ("camera", "picture_sender")})


@contextmanager
def plain(hosts: N, folder: Path) -> Iterator[Film[N]]:
    """Send the film as CompressedImage, from its first images on."""
    film, sent, arrived = folder / "film.avi", folder / "sent", folder / "arrived"
    write_film(film)
    with _Processes(folder) as processes:
        here, there = hosts.machines["robot"], hosts.machines["workstation"]
        for host, peer, name, record in ((here, there, "send", sent), (there, here, "receive", arrived)):
            command = ("-m", "evaluation.plain_images", name, film, record)
            processes.start(name, host, *command, across=Across(peers=(peer.address,)), raw_pictures=True)
        processes.await_images(arrived)
        yield Film(hosts, sent, arrived)


class _Processes(ExitStack):
    """Python processes on hosts, with logs in ``folder``; they end with the block."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.pids: dict[str, int] = {}

    def start(self, name: str, host: Host, *command: object, across: Across, raw_pictures: bool) -> None:
        variables: dict[str, str] = {"PYTHONPATH": str(ROOT)}
        prepare(variables, domain=0, log_folder=self.folder, across=across, raw_pictures=raw_pictures)
        with (self.folder / f"{name}.log").open("w") as log:
            process = host.start(sys.executable, *command, variables=variables, stdout=log, stderr=log)
        self.callback(_end, process)
        self.pids[name] = process.pid

    def await_images(self, arrived: Path) -> None:
        """Wait for the first images. Raises RuntimeError, with the logs, if they do not come."""
        end = time.monotonic() + STARTED_WITHIN_S
        while len(rows(arrived)) <= 30:
            if time.monotonic() > end:
                logs = "\n".join(f"{log.name}: {log.read_text()}" for log in self.folder.glob("*.log"))
                raise RuntimeError(f"no images within {STARTED_WITHIN_S:g} s\n{logs}")
            time.sleep(0.05)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


WAYS: Mapping[str, Callable[[SwitchedHosts, Path], AbstractContextManager[Film[SwitchedHosts]]]] = {
    "adaptive link": adaptive_link,
    "plain CompressedImage": plain,
}


def measure(seconds: float, *, quick: bool) -> Report:
    """Compare the ways on all networks."""
    report = Report("Images over a network", quick)
    found: dict[str, dict[str, tuple[int, list[float]]]] = {}
    for way, start in WAYS.items():
        with (
            tempfile.TemporaryDirectory() as folder,
            switched_hosts(ROBOT, WORKSTATION) as hosts,
            start(hosts, Path(folder)) as film,
        ):
            for name, quality in QUALITIES.items():
                hosts.set(quality)
                time.sleep(QUICK_SETTLE_S if quick else SETTLE_S)
                found.setdefault(name, {})[way] = film.ages(seconds)
                hosts.set(Quality())
                time.sleep(QUICK_SETTLE_S)
    as_good = 0
    for name, by_way in found.items():
        report.tables[name] = {way: _row(*measured) for way, measured in by_way.items()}
        link, other = (by_way[way] for way in WAYS)
        as_good += _is_as_good(other, link)
    report.add("networks", "networks", len(found))
    report.add("plain_as_good", "networks where plain images are as good within 10 %", as_good, len(found) - 1)
    return report


def _row(taken: int, ages: list[float]) -> dict[str, Value]:
    share = round(len(ages) / taken, 3) if taken else None
    p50, p99 = (round(1000 * float(np.percentile(ages, q))) if ages else None for q in (50, 99))
    return {"images": taken, "share that arrives": share, "median, ms": p50, "p99, ms": p99}


def _is_as_good(one: tuple[int, list[float]], other: tuple[int, list[float]]) -> bool:
    (taken, ages), (other_taken, other_ages) = one, other
    if not ages or not other_ages:
        return not other_ages
    share, other_share = len(ages) / taken, len(other_ages) / other_taken
    late, other_late = np.percentile(ages, 99), np.percentile(other_ages, 99)
    return bool(share >= (1 - AS_GOOD) * other_share and late <= (1 + AS_GOOD) * other_late)


def main(
    json: JsonOption = None,
    quick: QuickOption = False,
    seconds: Annotated[float, typer.Option(min=1.0, help="Seconds on each network.")] = 20.0,
) -> None:
    """Compare the adaptive link with plain CompressedImage on good and bad networks."""
    report = measure(min(seconds, 5.0) if quick else seconds, quick=quick)
    report.finish(json)


if __name__ == "__main__":
    run(main)
