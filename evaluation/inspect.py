"""Inspector benchmark: cost for the agents and speed of its page, ``python -m evaluation.inspect``.

The first part measures the first image and the scrubbing of a ten-minute run, in the server and in headless Chromium.
The second part records 100 agents in one process, and alternates runs with and without a listening page to compare the
cost of a decision. It also measures the update rate in Chromium. The exit code is 10 if a requirement is not met.
"""

from __future__ import annotations

import json as json_text
import os
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import httpx
import msgspec
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from evaluation.inspect_browser import first_picture_ms, page, steps_ms, update_ms
from socialbot.bags.reader import BagWriter
from socialbot.bridge.graph_observer import observe_graph
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import CompressedImage, PersonDetection, PersonDetections
from socialbot.graph.files import parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.runs.record import RunRecord
from socialbot.runtime.run import observed_topics

AS_REQUIRED, NOT_AS_REQUIRED = 0, 10
START = 1_700_000_000 * SECOND
AGENTS = 100
PICTURES = "/camera/image_raw/compressed"
DETECTIONS = "/humans/bodies/detections"
BEHIND_THE_DETECTOR = f"""
name: waldo
inputs: [{DETECTIONS}]
nodes:
  bdi_engine: {{type: waldo}}
  listener:   {{type: listener}}
  speech:
    type: speaker
    parameters: {{engine: bdi_engine, playback: "off"}}
    remap: {{health: /bdi_engine/health}}
  head:       {{type: head, parameters: {{engine: bdi_engine}}, remap: {{health: /bdi_engine/health}}}}
"""
"""Waldo's graph without perception."""
BEGINS_WITHIN_S = 120.0
SETTLE_S = 5.0


@dataclass(frozen=True)
class Row:
    """Figure with its upper limit."""

    what: str
    value: float
    most: float
    unit: str

    @property
    def well(self) -> bool:
        return self.value < self.most


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
        process.send_signal(signal.SIGINT)
        process.wait(60)


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


def cpu_s(pid: int) -> float:
    """Return the processor time (s) of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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


def cost(folder: Path, agents: int, seconds: float, turns: int) -> list[Row]:
    """Compare the cost of a record with and without a listening page."""
    alone, watched = [], []
    for _ in range(turns):
        alone.append(turn(folder, agents, seconds, inspected=False))
        watched.append(turn(folder, agents, seconds, inspected=True))
    (cpu, hz), (cpu_watched, hz_watched) = (
        [statistics.median(column) for column in zip(*figures, strict=True)] for figures in (alone, watched)
    )
    return [
        Row(f"{agents} agents: more processor time a decision", 100 * (cpu_watched / cpu - 1.0), 3.0, "%"),
        Row(f"{agents} agents: fewer decisions a second", 100 * (1.0 - hz_watched / hz), 3.0, "%"),
    ]


def update(folder: Path, agents: int, seconds: float) -> Row:
    """Measure the update rate of a live page in a browser."""
    with crowd(folder, agents, inspected=True) as (_, _, address), page() as visit:
        time.sleep(SETTLE_S)
        return Row(
            f"{agents} agents: from one update of the page to the next", update_ms(visit, address, seconds), 110.0, "ms"
        )


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
    graph = parse_graph(BEHIND_THE_DETECTOR, where="evaluation.inspect")
    runner = InlineRunner(graph, start=START)
    with RunRecord(folder / "run") as record:
        record.describe(graph)
        for topic in observed_topics(graph):
            runner.tap(topic, record.observe)
        runner.start()
        for stamp in stamps:
            runner.feed(DETECTIONS, people(stamp))
        runner.close()
        record.write_results(
            {"graph": "waldo", "bag": {"path": str(bag), "start": START, "topics": {PICTURES: PICTURES}}}
        )
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
        process.send_signal(signal.SIGINT)
        process.wait(60)


def speed(folder: Path, seconds: int, steps: int) -> list[Row]:
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
        moments = sorted(timed(f"api/moment?t={at}") for at in times)
        pictures = sorted(timed(f"api/picture?t={at}") for at in times)
        both = sorted(timed(f"api/moment?t={at + 0.05}", f"api/picture?t={at + 0.05}") for at in times)
        with page() as visit:
            seen = first_picture_ms(visit, url)
            shown = sorted(steps_ms(visit, times))

    def p99(found: list[float]) -> float:
        return found[min(len(found) - 1, int(0.99 * len(found)))]

    return [
        Row("page to first picture", first, 1000.0, "ms"),
        Row(f"a moment of {seconds / 60:g} min, p99", p99(moments), 20.0, "ms"),
        Row(f"a picture of {seconds / 60:g} min, p99", p99(pictures), 50.0, "ms"),
        Row("a step of the scrubber, p99", p99(both), 100.0, "ms"),
        Row("page to first picture, in a browser", seen, 1000.0, "ms"),
        Row("a step of the scrubber, in a browser, median", statistics.median(shown), 100.0, "ms"),
        Row("a step of the scrubber, in a browser, p99", p99(shown), 100.0, "ms"),
    ]


def main(
    json: Annotated[Path | None, typer.Option(help="Write the figures to this file.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few agents and a short run, as a smoke test.")] = False,
) -> None:
    """Measure the cost of the inspector for the agents, and the speed of its page."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = speed(folder, 20 if quick else 600, 20 if quick else 200)
        agents, listened_s = (5, 2.0) if quick else (AGENTS, 15.0)
        rows += cost(folder, agents, listened_s, 1 if quick else 3)
        rows.append(update(folder, agents, listened_s))
    table = Table("", "measured", "required", "")
    for row in rows:
        figures = f"{row.value:.1f} {row.unit}", f"< {row.most:g} {row.unit}"
        table.add_row(row.what, *figures, "ok" if row.well else "above")
    Console().print(table)
    if json is not None:
        json.write_text(json_text.dumps(msgspec.to_builtins(rows), indent=2) + "\n", encoding="utf-8")
    raise typer.Exit(AS_REQUIRED if quick or all(row.well for row in rows) else NOT_AS_REQUIRED)


if __name__ == "__main__":
    typer.run(main)
