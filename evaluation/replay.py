"""Replay benchmark: inline against a bare loop of decoding and detecting, and ROS against inline.

``python -m evaluation.replay BAG`` alternates the inline runner and the bare loop in this process. It compares the
traces of inline runs byte by byte, and their actions with those of a replay through ROS.
"""

from __future__ import annotations

import itertools
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from unittest import mock

import cv2
import typer

from evaluation.report import DomainOption, JsonOption, QuickOption, Report, run
from socialbot.bags.reader import Bag, open_bag
from socialbot.bags.writer import BagWriter
from socialbot.bridge import environment
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError
from socialbot.core.messages import ActionRequest, CompressedImage, Image
from socialbot.graph.files import load_graph
from socialbot.runs.record import RunRecord
from socialbot.runtime.bag_source import BagSource, find_truth
from socialbot.runtime.run import Runner
from socialbot.runtime.run import run as run_graph
from socialbot.vision.detector import Detector
from socialbot.vision.detectors import DETECTORS, DetectorSettings
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.person_detector import PersonDetector

BAG = Path("data/synthetic/corridor")
PASSES = 2
QUICK_S = 4.0
"""Length of the bag in a quick run."""

OUTSIDE_LIMIT = 0.10


@dataclass
class Meter:
    """Wall and processor time (s) accumulated inside ``with meter:``."""

    wall_s: float = 0.0
    cpu_s: float = 0.0

    def __enter__(self) -> Meter:
        self.wall_s -= time.perf_counter()
        self.cpu_s -= time.process_time()
        return self

    def __exit__(self, *_: object) -> None:
        self.wall_s += time.perf_counter()
        self.cpu_s += time.process_time()


@dataclass
class Pass:
    """Pass over the bag: total time and detector time."""

    whole: Meter
    detector: Meter

    @property
    def outside_cpu(self) -> float:
        """Share of processor time outside the detector."""
        return 1 - self.detector.cpu_s / self.whole.cpu_s

    @property
    def outside_wall(self) -> float:
        """Share of wall time outside the detector."""
        return 1 - self.detector.wall_s / self.whole.wall_s


@dataclass
class InlinePass(Pass):
    """Inline replay with its trace and actions."""

    trace: bytes
    actions: list[ActionRequest]
    stamps: list[int]


def bare_pass(bag: Bag) -> Pass:
    """Decode every image and detect persons in one thread, as a lower bound."""
    topic = bag.choose_image_topic().name
    cv2.setNumThreads(1)
    with metered_detector() as detector, Meter() as whole:
        people = usual_detector()
        people.threshold = DETECTORS[PersonDetector.detector.default].weak  # as for tracking
        for _, message in bag.messages({topic: topic}):
            assert isinstance(message, (Image, CompressedImage))
            people.detect(bgr_from_image(message) if isinstance(message, Image) else bgr_from_compressed(message))
    return Pass(whole, detector)


def inline_pass(bag: Bag, folder: Path) -> InlinePass:
    """Run the equivalent of ``socialbot replay BAG --runner inline --no-video``."""
    with metered_detector() as detector, Meter() as whole:
        record = _replay(bag, "inline", folder)
    trace = (folder / "trace.jsonl").read_bytes()
    return InlinePass(whole, detector, trace, record.actions, [message.stamp for message in record.detections])


def ros_actions(bag: Bag, folder: Path) -> list[ActionRequest]:
    """Return the actions of a replay with one process per node."""
    return _replay(bag, "ros", folder).actions


def command_cpu_s(bag: Path, folder: Path) -> float:
    """Return the processor time (s) of the whole command, including startup and video."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "socialbot", "replay", str(bag), "--runner", "inline", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _replay(bag: Bag, runner: Runner, folder: Path) -> RunRecord:
    with RunRecord(folder) as record:
        run_graph(load_graph("waldo"), BagSource(bag, truth=find_truth(bag)), record, runner=runner)
    return record


def usual_detector() -> Detector:
    """Return the default detector of a graph."""
    return DETECTORS[PersonDetector.detector.default].make(DetectorSettings())


@contextmanager
def metered_detector() -> Iterator[Meter]:
    """Measure the time in the default detector during the block."""
    meter = Meter()
    kind = type(usual_detector())
    detect: Callable[..., Any] = kind.detect

    def metered(detector: Detector, image: Any) -> Any:
        with meter:
            return detect(detector, image)

    with mock.patch.object(kind, "detect", metered):
        yield meter


def shortened(bag: Bag, path: Path, seconds: float) -> Path:
    """Write the first ``seconds`` of ``bag`` to a new bag."""
    end = bag.start + round(seconds * SECOND)
    names = {topic.name: topic.name for topic in bag.topics if topic.count}
    with BagWriter(path) as writer:
        for topic, at, type_name, data in itertools.takewhile(lambda item: item[1] < end, bag.raw_messages(names)):
            writer.write_raw(topic, type_name, data, at)
    return path


def measure(bag_path: Path, domain: int, *, quick: bool) -> Report:
    """Replay the bag, or its beginning, in every way.

    Raises:
        BagError: The bag has no images.
    """
    environment.prepare(domain=domain)
    report = Report("replay", quick)
    with tempfile.TemporaryDirectory(prefix="replay-") as scratch:
        folder = Path(scratch)
        if quick:
            with open_bag(bag_path) as whole:
                bag_path = shortened(whole, folder / "short", QUICK_S)
        with open_bag(bag_path) as bag:
            bare: list[Pass] = []
            inline: list[InlinePass] = []
            for turn in range(PASSES):
                bare.append(bare_pass(bag))
                inline.append(inline_pass(bag, folder / f"inline-{turn}"))
            actions = ros_actions(bag, folder / "ros")
        command_s = None if quick else command_cpu_s(bag_path, folder / "command")
    if len(inline[0].stamps) < 2:
        raise BagError("too few pictures to measure with", where=str(bag_path))
    add_speed(report, bare, inline)
    if command_s is not None:
        outside = round(1 - min(one.detector.cpu_s for one in inline) / command_s, 4)
        report.add("command_outside_detector_share", "the whole command, with start and video: share outside", outside)
    add_faith(report, inline, actions)
    return report


def add_speed(report: Report, bare: list[Pass], inline: list[InlinePass]) -> None:
    """Add the overhead of inline replay over the detector and the bare loop."""
    frames = len(inline[0].stamps)
    bare_cpu, inline_cpu = (min(one.whole.cpu_s for one in passes) for passes in (bare, inline))
    bare_wall, inline_wall = (min(one.whole.wall_s for one in passes) for passes in (bare, inline))
    add = report.add
    add("frames", "frames", frames)
    add("passes", "alternating passes of each kind; the fastest counts", PASSES)
    add("bare_ms_per_frame", "bare loop of decode and detect: processor time, ms a frame", _ms(bare_cpu / frames))
    add("inline_ms_per_frame", "inline replay: processor time, ms a frame", _ms(inline_cpu / frames))
    add("inline_to_bare", "inline against bare, processor time", round(inline_cpu / bare_cpu, 4))
    add("inline_to_bare_wall", "inline against bare, wall clock", round(inline_wall / bare_wall, 4))
    outside = round(min(one.outside_cpu for one in inline), 4)
    add("outside_detector_share", "inline: share of processor time outside the detector", outside, OUTSIDE_LIMIT)
    outside = round(min(one.outside_wall for one in inline), 4)
    add("outside_detector_share_wall", "inline: share of the wall clock outside the detector", outside, OUTSIDE_LIMIT)
    outside = round(min(one.outside_cpu for one in bare), 4)
    add("bare_outside_detector_share", "bare loop: share of processor time outside the detector", outside)


def add_faith(report: Report, inline: list[InlinePass], ros: list[ActionRequest]) -> None:
    """Add the agreement of inline replays with each other and with ROS."""
    first = inline[0]
    period = statistics.median(later - earlier for earlier, later in itertools.pairwise(first.stamps))
    apart = [abs(a.stamp - b.stamp) / period for a, b in zip(first.actions, ros, strict=False)]
    same = [(a.name, a.arguments) for a in first.actions] == [(b.name, b.arguments) for b in ros]
    identical = all(one.trace == first.trace for one in inline)
    add = report.add
    add("traces_identical", "inline replays give byte-identical traces", identical, True)
    add("trace_bytes", "length of the trace, bytes", len(first.trace))
    add("actions", "actions of the agent", len(first.actions))
    add("ros_actions_same", "the ROS replay gives the same actions in the same order", same, True)
    add(
        "ros_apart_periods", "largest difference of action times, frame periods", round(max(apart, default=0.0), 3), 1.0
    )


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)


def main(
    bag: Annotated[Path, typer.Argument(help="The bag to replay.")] = BAG,
    json: JsonOption = None,
    quick: QuickOption = False,
    domain: DomainOption = None,
) -> None:
    """Measure inline replay against a bare loop, and compare a replay through ROS with it."""
    with environment.own_domain(domain) as own:
        measure(bag, own, quick=quick).finish(json)


if __name__ == "__main__":
    run(main)
