"""Power row: integrity of recordings after all processes are killed at once, repeatedly.

``socialbot up`` records the trace of Waldo's graph, ``socialbot bag record`` its messages and, every second time, its
images. This process subscribes as well. Messages that it received a second or more before the cut must be readable. The
computer keeps running, so data in the page cache survives, unlike in a real power cut.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from evaluation.faults_plan import Plan, await_, beside, kill_all, write_pictures
from evaluation.report import Report, Value
from socialbot.bags.reader import open_bag
from socialbot.bridge import environment
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, PersonDetections, TraceRecord

CUTS, QUICK_CUTS = 10, 2
LAST_S = 1.0
"""Longest time (s) before the cut whose messages may be lost."""
DETECTIONS, PICTURES = "/humans/bodies/detections", "/camera/image_raw"
TOPICS = ((DETECTIONS,), (DETECTIONS, PICTURES))
"""Recorded topics, in turn: images fill the file fast, messages slowly."""
FRAMES = range(90, 130)
"""Frames with a person who approaches and stays."""
LEAST_S, MOST_S = 3.0, 8.0
"""Range of the time (s) from the start of the recording to the cut."""
READY_S = 120.0
BEGINNING_BYTES = 256


@dataclass(frozen=True)
class Kept:
    """Readable data after a cut: stamps of detections, and the time of the newest message in the bag (ns)."""

    in_bag: frozenset[int]
    in_trace: frozenset[int]
    bag_until: int


def read(bag: Path, trace: Path) -> Kept:
    """Return the readable data of a killed recording.

    Raises:
        BagError: Nothing is readable.
    """
    with open_bag(bag) as opened:
        messages = [message for _, message in opened.messages({DETECTIONS: DETECTIONS})]
        bag_until = opened.end
    records = whole_lines(trace)
    seen = frozenset(record.stamp for record in records if record.kind == "detection")
    return Kept(frozenset(one.stamp for one in messages), seen, bag_until)


def whole_lines(trace: Path) -> list[TraceRecord]:
    """Return the records of a trace without a truncated last line.

    Raises:
        msgspec.MsgspecError: Another line is damaged.
    """
    decoder = msgspec.json.Decoder(TraceRecord)
    return [decoder.decode(line) for line in trace.read_bytes().split(b"\n")[:-1]]


def missing(heard: Iterable[tuple[int, int]], kept: frozenset[int], cut: int) -> int:
    """Return how many of ``heard`` (time, stamp; ns) long enough before the ``cut`` are missing in ``kept``."""
    due = cut - round(LAST_S * SECOND)
    return sum(at <= due and stamp not in kept for at, stamp in heard)


def power(report: Report, plan: Plan) -> str:
    """Kill recordings at different times, and read the remaining data."""
    environment.prepare(domain=plan.domain)
    folder = plan.records("power")
    pictures = write_pictures(folder / "pictures", FRAMES)
    moments = random.Random(7)
    rows: dict[str, dict[str, Value]] = {}
    for number in range(plan.of(CUTS, QUICK_CUTS)):
        begun = folder / f"cut-{number}"
        begun.mkdir()
        rows[str(number)] = row = _cut(plan, begun, pictures, moments.uniform(LEAST_S, MOST_S), TOPICS[number % 2])
        plan.tell(f"power: cut {number + 1}: {row}")
    lost = {what: sum(int(row[f"missing in {what}"] or 0) for row in rows.values()) for what in ("bag", "trace")}
    oldest = {what: max(float(row[f"{what} ends before, s"] or 0.0) for row in rows.values()) for what in lost}
    report.add("power_cuts", "power: recordings killed", len(rows))
    for what in lost:
        report.add(f"power_{what}_missing", f"power: detections from 1 s before, missing in the {what}", lost[what], 0)
        text = f"power: newest that can be read in the {what}, s before the cut, at most"
        report.add(f"power_{what}_end_s", text, round(oldest[what], 2), LAST_S)
    report.tables["power"] = rows
    return (
        f"{len(rows)} cuts: bag readable up to {oldest['bag']:.2f} s before, trace up to {oldest['trace']:.2f} s; "
        f"{sum(lost.values())} messages missing"
    )


def _cut(plan: Plan, folder: Path, pictures: Path, after_s: float, recorded: Sequence[str]) -> dict[str, Value]:
    from socialbot.bridge.graph_observer import observe_graph

    heard: list[tuple[int, int]] = []

    def note(topic: str, message: Message) -> None:
        heard.append((time.time_ns(), message.stamp))

    up = ("up", "--camera", pictures, "--out", folder / "run", "--set", "camera.loop=true")
    topics = [word for topic in recorded for word in ("--topics", topic)]
    with (
        observe_graph({DETECTIONS: PersonDetections}, note, lambda *_: None),
        beside(plan, folder, "up", *up, "--set", "speech.playback=off") as graph,
        beside(plan, folder, "record", "bag", "record", folder / "bag", *topics) as recorder,
    ):
        await_(lambda: len(heard) > 0, READY_S, "no detections", folder)
        await_(lambda: _size(folder / "bag") > 0, READY_S, "no recording", folder)
        settled = time.time_ns() + SECOND  # all subscriptions are connected by then
        time.sleep(1.0 + after_s)
        cut = kill_all([graph.pid, recorder.pid])
    kept = read(folder / "bag", folder / "run" / "trace.jsonl")
    since = [one for one in heard if one[0] >= settled]
    traced_until = max((at for at, stamp in heard if stamp in kept.in_trace), default=0)
    return {
        "heard": len(since),
        "missing in bag": missing(since, kept.in_bag, cut),
        "missing in trace": missing(since, kept.in_trace, cut),
        "bag ends before, s": round((cut - kept.bag_until) / SECOND, 2),
        "trace ends before, s": round((cut - traced_until) / SECOND, 2),
    }


def _size(bag: Path) -> int:
    """Return the bytes of the bag's messages without the fixed ones at its start."""
    return sum(max(0, file.stat().st_size - BEGINNING_BYTES) for file in bag.glob("*.mcap"))
