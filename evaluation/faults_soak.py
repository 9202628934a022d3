"""Soak row: Waldo's graph over ROS for four hours, with checks of memory, threads, files, shared memory and actions.

A bag repeats one lap of 50 s: people come, stay and go, and then nobody is present. ``socialbot replay`` plays it at
the speed of the detector, with every image processed. Each process is sampled once a second. Laps have one image a
second, as four hours must fit into 30 minutes at about ten detections a second on one core.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from glob import glob
from itertools import pairwise
from pathlib import Path

import msgspec

from evaluation.faults_plan import CORRIDOR, Plan, Skipped, beside, descendants, process_name
from evaluation.report import Report, Value
from evaluation.soak import growth
from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import CameraInfo, CompressedImage

PICTURES, INFO = "/camera/image_raw/compressed", "/camera/camera_info"
EVERY = 10
"""Subsampling of the ten images a second in the bag."""
EMPTY = 8
"""Images (s) without people at the end of a lap, so that all laps begin alike."""
LAPS, QUICK_LAPS = 288, 12
RATE = 12.0
"""Maximum playback speed, with some reserve to catch up."""
WALL_MIN = 30.0
GROWTH_LIMIT, QUICK_GROWTH_LIMIT = 0.01, 0.1
"""Allowed memory growth of a process over the last two thirds of the time. Processes of a quick run still warm up."""
APART_S = 2.0
"""Tolerance (s) for the time of an action in another lap: two images."""
LOOK_S = 1.0
PLAYER = {"bag_player", "bag play"}
"""Names of the player process from `process_name`, forked or started separately."""
SEGMENTS = "/dev/shm/fastrtps_"
"""Name prefix of Fast DDS' shared-memory segments."""
KIB = 1024

Deed = tuple[float, str, tuple[object, ...]]
"""Time in the lap (s), action and arguments."""


@dataclass(frozen=True)
class Look:
    """Resources of a process at one time; ``segments`` is its mapped shared memory: bytes by name."""

    rss_kib: int
    threads: int
    files: int
    segments: Mapping[str, int]


@dataclass
class Course:
    """Resource samples of all processes by name."""

    looks: dict[str, list[Look]] = field(default_factory=lambda: defaultdict(list))
    shared: list[tuple[int, float]] = field(default_factory=list)
    """Number and size (MiB) of the mapped shared-memory segments."""
    segments: set[str] = field(default_factory=set)
    """Mapped segments except for the ``found`` ones."""
    found: frozenset[str] = field(default_factory=lambda: frozenset(glob(f"{SEGMENTS}*")))
    """Segments left by earlier killed processes."""

    def note(self, looks: Mapping[str, Look]) -> None:
        mapped: dict[str, int] = {}
        for name, look in looks.items():
            self.looks[name].append(look)
            mapped |= look.segments
        self.shared.append((len(mapped), sum(mapped.values()) / KIB / KIB))
        self.segments |= mapped.keys() - self.found


def write_laps(path: Path, laps: int) -> float:
    """Write the bag with ``laps`` laps; return the duration of a lap (s)."""
    with open_bag(CORRIDOR) as bag:
        start = bag.start
        messages = list(bag.messages({PICTURES: PICTURES, INFO: INFO}))
    pictures = [message for _, message in messages if isinstance(message, CompressedImage)][::EVERY]
    lap = [*pictures, *[pictures[0]] * EMPTY]
    info = next(message for _, message in messages if isinstance(message, CameraInfo))
    with BagWriter(path) as writer:
        writer.write(INFO, msgspec.structs.replace(info, stamp=start), start)
        for number in range(laps * len(lap)):
            at = start + number * SECOND
            writer.write(PICTURES, msgspec.structs.replace(lap[number % len(lap)], stamp=at), at)
    return float(len(lap))


def look(pid: int) -> Look | None:
    """Return the current resources of a process; None after its end."""
    process = Path(f"/proc/{pid}")
    try:
        status = dict(line.split(":", 1) for line in (process / "status").read_text("utf-8").splitlines())
        files = len(list((process / "fd").iterdir()))
        lines = (process / "maps").read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return None
    if "VmRSS" not in status:
        return None
    segments: dict[str, int] = defaultdict(int)
    for line in lines:
        extent, _, path = line.partition(" ")
        if SEGMENTS in path and "(deleted)" not in path:
            begin, end = (int(number, 16) for number in extent.split("-"))
            segments[path[path.index(SEGMENTS) :]] += end - begin
    return Look(int(status["VmRSS"].split()[0]), int(status["Threads"]), files, segments)


def deeds_of_laps(actions: Iterable[Mapping[str, object]], lap_s: float, laps: int) -> list[list[Deed]]:
    """Return the actions in each lap, from ``actions`` of results.json."""
    found: list[list[Deed]] = [[] for _ in range(laps)]
    for action in actions:
        number, within_s = divmod(float(str(action["t_s"])), lap_s)
        arguments = action["arguments"]
        assert isinstance(arguments, list)
        found[min(int(number), laps - 1)].append((within_s, str(action["name"]), tuple(arguments)))
    return found


def same(deeds: Sequence[Deed], others: Sequence[Deed]) -> bool:
    """Return whether the actions are equal, at the same times within `APART_S`."""
    return len(deeds) == len(others) and all(
        one[1:] == other[1:] and abs(one[0] - other[0]) <= APART_S for one, other in zip(deeds, others, strict=True)
    )


def more(counts: Sequence[float]) -> float:
    """Return the excess of the maximum of the last third over that of the middle third."""
    third = len(counts) // 3
    return max(counts[2 * third :]) - max(counts[third : 2 * third]) if third else 0.0


def steady(counts: Sequence[int]) -> list[int]:
    """Return the counts present in two consecutive samples, without transient files."""
    return [min(pair) for pair in pairwise(counts)]


def soak(report: Report, plan: Plan) -> str:
    """Replay hours of laps, and check resources and actions."""
    if not CORRIDOR.is_dir():
        raise Skipped(f"there is no {CORRIDOR}")
    folder = plan.records("soak")
    laps = plan.of(LAPS, QUICK_LAPS)
    lap_s = write_laps(folder / "laps", laps)
    begun = time.monotonic()
    course = replayed(folder, laps * lap_s, plan)
    wall_s = time.monotonic() - begun
    results = msgspec.json.decode((folder / "run" / "results.json").read_bytes())
    (folder / "laps" / "laps.mcap").unlink()  # large, and easy to recreate
    report.add("soak_hours", "soak: bag time, h", round(laps * lap_s / 3600, 2))
    report.add("soak_wall_min", "soak: duration, min", round(wall_s / 60, 1), plan.of(WALL_MIN, None))
    judge_deeds(report, deeds_of_laps(results["actions"], lap_s, laps), results["frames"], int(laps * lap_s))
    judge_course(report, course, plan.of(GROWTH_LIMIT, QUICK_GROWTH_LIMIT))
    found = {figure.key: figure.value for figure in report.figures}
    return (
        f"{found['soak_hours']} h in {found['soak_wall_min']} min; memory {found['soak_memory_growth']:+.2%} at most, "
        f"threads {found['soak_threads_more']:+.0f}, files {found['soak_files_more']:+.0f}, "
        f"shared memory {found['soak_shared_more_mib']:+.1f} MiB; {found['soak_lost']} of {found['soak_actions']} "
        "actions lost"
    )


def replayed(folder: Path, bag_s: float, plan: Plan) -> Course:
    """Replay the bag of laps and return all resource samples.

    Raises:
        NodeError: The replay fails.
    """
    command = ["replay", folder / "laps", "--runner", "ros", "--rate", RATE, "--no-video", "--out", folder / "run"]
    settings = ("speech.playback=off", "person_detector.threads=2")
    command += [word for setting in settings for word in ("--set", setting)]
    course, told, begun = Course(), 0, time.monotonic()
    with beside(plan, folder, "replay", *command) as process, (folder / "looks.jsonl").open("wb") as kept:
        while process.poll() is None:
            looks = {process_name(pid): found for pid in descendants(process.pid) if (found := look(pid))}
            looks.pop("", None)
            if looks.keys() & PLAYER:  # all others start before the player
                course.note(looks)
                kept.write(msgspec.json.encode(looks) + b"\n")
            minutes = int((time.monotonic() - begun) / 60)
            if minutes > told:
                told = minutes
                total = sum(one.rss_kib for one in looks.values()) / KIB
                plan.tell(f"soak: {minutes} min of about {bag_s / RATE / 60:.0f}, {total:.0f} MiB in all")
            time.sleep(LOOK_S)
    if process.returncode:
        where = "socialbot replay"
        raise NodeError(f"ended with {process.returncode}", where=where, remedy=f"see {folder / 'replay.log'}")
    return course


def judge_deeds(report: Report, laps: Sequence[Sequence[Deed]], frames: int, pictures: int) -> None:
    """Add whether all images were processed, and whether each lap had the actions of the second.

    Only after the first lap does the agent believe that nobody is present.
    """
    first, others = laps[1], laps[2:]
    lost = sum(max(0, len(first) - len(lap)) for lap in others)
    report.add("soak_pictures", "soak: images", pictures)
    report.add("soak_pictures_lost", "soak: images not processed", pictures - frames, 0)
    report.add("soak_actions", "soak: actions", sum(map(len, laps)))
    report.add("soak_lost", "soak: actions of the second lap missing in later laps", lost, 0)
    differing = sum(not same(first, lap) for lap in others)
    report.add("soak_laps_differ", f"soak: laps of {len(others)} unlike the second", differing, 0)


def judge_course(report: Report, course: Course, limit: float) -> None:
    """Add the growth of all resources."""
    rows: dict[str, dict[str, Value]] = {}
    for name, looks in course.looks.items():
        memory = [one.rss_kib / KIB for one in looks]
        rows[name] = {
            "MiB begin": round(memory[len(memory) // 3], 1),
            "MiB end": round(memory[-1], 1),
            "growth": round(growth(memory), 4),
            "threads": max(one.threads for one in looks),
            "more threads": more([one.threads for one in looks]),
            "files": max(one.files for one in looks),
            "more files": more(steady([one.files for one in looks])),
        }
    # The replay process keeps all detections for scores and drawings.
    judged = {name: row for name, row in rows.items() if name != "replay"}
    text = "soak: growth of the memory of a process over the last two thirds, share, at most"
    report.add("soak_memory_growth", text, _most(judged, "growth"), limit)
    report.add(
        "soak_threads_more", "soak: additional threads in the last third, maximum", _most(rows, "more threads"), 0
    )
    report.add(
        "soak_files_more", "soak: additional open files in the last third, maximum", _most(rows, "more files"), 0
    )
    segments = more([count for count, _ in course.shared])
    report.add("soak_segments_more", "soak: additional shared memory segments in the last third", segments, 0)
    mib = round(more([size for _, size in course.shared]), 2)
    report.add("soak_shared_more_mib", "soak: additional shared memory in the last third, MiB", mib, 0)
    left = sum(Path(name).exists() for name in course.segments)
    report.add("soak_segments_left", "soak: shared memory segments left at the end", left, 0)
    report.tables["soak"] = rows


def _most(rows: Mapping[str, Mapping[str, Value]], column: str) -> float:
    return max((float(row[column] or 0) for row in rows.values()), default=float("inf"))
