"""Inspector benchmark: cost for the agents and speed of its page, ``python -m evaluation.inspect``.

The first part measures the first image and the scrubbing of a ten-minute run, in the server and in headless Chromium.
The second part records 100 agents in one process, and alternates runs with and without a listening page to compare the
cost of a decision. It also measures the update rate in Chromium. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

import random
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import httpx
import numpy as np

from evaluation.faults_plan import cpu_s, interrupt
from evaluation.inspect_browser import first_picture_ms, page, steps_ms, update_ms
from evaluation.questions_runs import START, record_waldo
from evaluation.report import JsonOption, QuickOption, Report, percentile, run
from socialbot.bags.reader import BagWriter
from socialbot.bridge.graph_observer import observe_graph
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import CompressedImage, PersonDetection, PersonDetections

AGENTS = 100
PICTURES = "/camera/image_raw/compressed"
BEGINS_WITHIN_S = 120.0
SETTLE_S = 5.0


# Cost


@contextmanager
def crowd(folder: Path, agents: int, *, inspected: bool) -> Iterator[tuple[Path, int, str]]:
    """Run busy agents in one process; yield the record, the process id, and the page address, if any."""
    file, out = folder / "crowd.yaml", folder / f"run{time.monotonic_ns()}"
    names = [f"agent{number}" for number in range(agents)]
    nodes = "".join(f"  {name}: {{type: 'evaluation.inspect_agents:Walker'}}\n" for name in names)
    file.write_text(f"name: crowd\nnodes:\n{nodes}", encoding="utf-8")
    options = ["--composed", "--out", str(out), *(["--inspect", "--port", "0"] if inspected else [])]
    log = folder / "up.log"
    with log.open("w") as told:
        process = subprocess.Popen(
            [sys.executable, "-m", "socialbot", "up", str(file), *options], stdout=told, stderr=told
        )
    try:
        pid = host_of(names)
        found = re.search(r"Inspector: (\S+)", log.read_text())
        yield out, pid, found[1] if found else ""
    finally:
        interrupt(process)


def host_of(names: Sequence[str]) -> int:
    """Return the process of ``names`` as soon as all nodes are active."""
    hosts: dict[str, int] = {}

    def note(node: str, values: dict[str, str]) -> None:
        if node in names and values.get("state") == "active":
            hosts[node] = int(values["pid"])

    with observe_graph({}, lambda topic, message: None, note):
        until = time.monotonic() + BEGINS_WITHIN_S
        while len(hosts) < len(names) or len(set(hosts.values())) > 1:
            if time.monotonic() > until:
                raise NodeError(f"{len(hosts)} of {len(names)} agents are active after {BEGINS_WITHIN_S:g} s")
            time.sleep(0.1)
    return next(iter(hosts.values()))


def listen(address: str, got: list[int]) -> None:
    """Receive the events of a live run as a page, and count their bytes."""
    try:
        with httpx.stream("GET", f"{address}api/live", timeout=None) as events:
            for chunk in events.iter_bytes():
                got[0] += len(chunk)
    except httpx.HTTPError:
        pass  # the run has ended


def turn(folder: Path, agents: int, seconds: float, *, inspected: bool) -> tuple[float, float]:
    """Return the processor time (ms) per record of the agents, and the records per second."""
    with crowd(folder, agents, inspected=inspected) as (out, pid, address):
        got = [0]
        if inspected:
            threading.Thread(target=listen, args=(address, got), daemon=True).start()
        time.sleep(SETTLE_S)
        trace = out / "trace.jsonl"
        before, cpu, heard, begun = got[0], cpu_s(pid), trace.read_bytes().count(b"\n"), time.monotonic()
        time.sleep(seconds)
        spent, passed = cpu_s(pid) - cpu, time.monotonic() - begun
        records = trace.read_bytes().count(b"\n") - heard
        if inspected and got[0] == before:
            raise NodeError("the page heard nothing", where=address)
    return 1e3 * spent / max(1, records), records / passed


def add_cost(report: Report, folder: Path, agents: int, seconds: float, turns: int) -> None:
    """Compare the cost of a record with and without a listening page."""
    alone, watched = [], []
    for _ in range(turns):
        alone.append(turn(folder, agents, seconds, inspected=False))
        watched.append(turn(folder, agents, seconds, inspected=True))
    (cpu, hz), (cpu_watched, hz_watched) = (
        [statistics.median(column) for column in zip(*figures, strict=True)] for figures in (alone, watched)
    )
    more, fewer = 100 * (cpu_watched / cpu - 1.0), 100 * (1.0 - hz_watched / hz)
    report.add("processor_percent", f"{agents} agents: more processor time a decision, %", more, 3.0)
    report.add("decisions_percent", f"{agents} agents: fewer decisions a second, %", fewer, 3.0)


def add_updates(report: Report, folder: Path, agents: int, seconds: float) -> None:
    """Measure the update rate of a live page in a browser."""
    with crowd(folder, agents, inspected=True) as (_, _, address), page() as visit:
        time.sleep(SETTLE_S)
        text = f"{agents} agents: from one update of the page to the next, ms"
        report.add("update_ms", text, update_ms(visit, address, seconds), 110.0)


# Speed


def long_run(folder: Path, seconds: int) -> Path:
    """Create a run of Waldo with changing persons and a bag of ten images a second."""
    bag, stamps = folder / "bag", [START + tenth * SECOND // 10 for tenth in range(seconds * 10)]
    shades = np.add.outer(np.arange(480), np.arange(640)).astype(np.uint8)
    with BagWriter(bag) as writer:
        for stamp in stamps:
            data = cv2.imencode(".jpg", np.roll(shades, stamp // SECOND % 640, axis=1))[1].reshape(-1)
            picture = CompressedImage(stamp=stamp, frame_id="camera", format="jpeg", data=data)
            writer.write(PICTURES, picture, stamp)
    bag_entry = {"path": str(bag), "start": START, "topics": {PICTURES: PICTURES}}
    record_waldo(map(people, stamps), folder / "run", bag=bag_entry)
    return folder / "run"


def people(stamp: int) -> PersonDetections:
    """Return the persons at ``stamp``: each minute a new one comes and stays for half of it."""
    minute, within_s = divmod((stamp - START) / SECOND, 60.0)
    far_m = 3.0 + abs(within_s - 25.0) / 4.0
    one = PersonDetection(
        x=40.0 + 8.0 * within_s, y=60.0, w=160.0, h=380.0, score=0.9, track_id=f"t{minute:.0f}", distance_m=far_m
    )
    there = (one,) if 5.0 <= within_s < 40.0 else ()
    return PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=there)


@contextmanager
def inspector(run: Path) -> Iterator[str]:
    """Serve a page of ``run`` as users do; yield its address."""
    command = [sys.executable, "-m", "socialbot", "inspect", str(run), "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"Inspector: (\S+)", line):
                yield found[1]
                return
        raise NodeError(f"ended with {process.wait()}", where="socialbot inspect")
    finally:
        interrupt(process)


def add_speed(report: Report, folder: Path, seconds: int, steps: int) -> None:
    """Measure the time of the first image and of each step, from the server and in a browser."""
    with inspector(long_run(folder, seconds)) as url, httpx.Client() as client:

        def timed(*paths: str) -> float:
            begun = time.perf_counter()
            for path in paths:
                client.get(url + path, timeout=60).raise_for_status()
            return 1e3 * (time.perf_counter() - begun)

        first = timed("", "api/run", "api/moment?t=0", "api/picture?t=0")
        timed(f"api/picture?t={seconds}")  # the bag is fully indexed from here on
        chance = random.Random(7)
        times = [chance.uniform(0.0, seconds) for _ in range(steps)]
        moments = [timed(f"api/moment?t={at}") for at in times]
        pictures = [timed(f"api/picture?t={at}") for at in times]
        both = [timed(f"api/moment?t={at + 0.05}", f"api/picture?t={at + 0.05}") for at in times]
        with page() as visit:
            seen = first_picture_ms(visit, url)
            shown = steps_ms(visit, times)

    minutes = f"{seconds / 60:g} min"
    report.add("first_ms", "page to first picture, ms", first, 1000.0)
    report.add("moment_p99_ms", f"a moment of {minutes}, p99, ms", percentile(moments, 0.99), 20.0)
    report.add("picture_p99_ms", f"a picture of {minutes}, p99, ms", percentile(pictures, 0.99), 50.0)
    report.add("step_p99_ms", "a step of the scrubber, p99, ms", percentile(both, 0.99), 100.0)
    report.add("browser_first_ms", "page to first picture, in a browser, ms", seen, 1000.0)
    report.add("browser_step_ms", "a step of the scrubber, in a browser, median, ms", statistics.median(shown), 100.0)
    report.add("browser_step_p99_ms", "a step of the scrubber, in a browser, p99, ms", percentile(shown, 0.99), 100.0)


def main(json: JsonOption = None, quick: QuickOption = False) -> None:
    """Measure the cost of the inspector for the agents, and the speed of its page."""
    report = Report("inspector", quick)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        add_speed(report, folder, 20 if quick else 600, 20 if quick else 200)
        agents, listened_s = (5, 2.0) if quick else (AGENTS, 15.0)
        add_cost(report, folder, agents, listened_s, 1 if quick else 3)
        add_updates(report, folder, agents, listened_s)
    report.finish(json)
    if not quick:
        report.check()


if __name__ == "__main__":
    run(main)
