from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from evaluation.faults_plan import descendants, kill_all, process_name, write_pictures
from evaluation.faults_soak import (
    Course,
    Look,
    deeds_of_laps,
    judge_course,
    judge_deeds,
    look,
    more,
    same,
    steady,
    write_laps,
)
from evaluation.report import Report
from socialbot.bags.reader import open_bag

MIB = 1024
SLEEP = [sys.executable, "-c", "import subprocess, sys; subprocess.run(['sleep', '60'])"]


def values(report: Report) -> dict[str, object]:
    return {figure.key: figure.value for figure in report.figures}


def test_laps_follow_each_other_without_a_gap(tmp_path: Path):
    lap_s = write_laps(tmp_path / "laps", 2)
    with open_bag(tmp_path / "laps") as bag:
        assert (lap_s, bag.duration_s, bag.image_topics[0].count) == (50.0, 99.0, 100)


def test_deeds_go_by_laps_and_are_the_same_within_two_pictures():
    actions = [
        {"t_s": at, "name": "speak", "arguments": [what]}
        for at, what in ((9.0, "greeting"), (60.0, "greeting"), (112.5, "greeting"), (117.0, "offer"))
    ]
    first, second, third = deeds_of_laps(actions, 50.0, 3)
    assert same(first, second)
    assert not same(first, third)
    assert not same([(9.0, "speak", ("greeting",))], third[:1])  # 3.5 s later
    assert not same([(10.0, "speak", ("offer",))], second)


def test_laps_are_compared_with_the_second_lap():
    lap = [(9.0, "speak", ("greeting",)), (17.0, "speak", ("offer",))]
    report = Report("r", quick=True)
    judge_deeds(report, [[(1.0, "stayIdle", ()), *lap], lap, lap[:1], lap], frames=199, pictures=200)
    assert report.unmet == ["soak_pictures_lost", "soak_lost", "soak_laps_differ"]
    assert values(report)["soak_lost"] == 1


def course(rss: list[int], threads: list[int], segments: list[int]) -> Course:
    found = Course()
    for kib, number, mib in zip(rss, threads, segments, strict=True):
        found.note({"head": Look(kib, number, 20, {"/dev/shm/fastrtps_none": mib * MIB * MIB})})
    return found


def test_constant_usage_does_not_grow():
    report = Report("r", quick=True)
    judge_course(report, course([50_000, 100_000, *[100_100] * 7], [17] * 9, [32] * 9), 0.01)
    assert report.unmet == []


@pytest.mark.parametrize(
    ("rss", "threads", "segments", "unmet"),
    [
        (range(100_000, 190_000, 10_000), [17] * 9, [32] * 9, "soak_memory_growth"),
        ([100_000] * 9, [*[17] * 8, 18], [32] * 9, "soak_threads_more"),
        ([100_000] * 9, [17] * 9, [*[32] * 7, 64, 64], "soak_shared_more_mib"),
    ],
)
def test_growing_usage_is_found(rss, threads, segments, unmet):
    report = Report("r", quick=True)
    judge_course(report, course(list(rss), threads, segments), 0.01)
    assert report.unmet == [unmet]


def test_growth_compares_the_last_two_thirds():
    assert more([9, 9, 1, 2, 3, 1]) == 1
    assert more([1]) == 0


def test_processes_are_looked_at_from_outside_and_killed_with_all_that_descend_from_them():
    own = look(os.getpid())
    assert own is not None
    assert own.rss_kib > 1000
    assert own.threads >= 1
    assert own.files >= 3
    with subprocess.Popen(SLEEP) as parent:
        while len(family := descendants(parent.pid)) < 2:
            pass
        kill_all([parent.pid])
    assert parent.returncode == -9
    assert process_name(parent.pid) == ""
    assert look(parent.pid) is None
    assert not [pid for pid in family if pid != parent.pid and process_name(pid)]


def test_pictures_of_the_corridor_make_a_scene(tmp_path: Path):
    names = [path.name for path in sorted(write_pictures(tmp_path / "scene", [0, 100, 0]).iterdir())]
    assert names == ["0000.jpg", "0001.jpg", "0002.jpg"]


def test_a_briefly_open_file_is_no_leak():
    assert more(steady([3, 4, 3, 3, 3, 4, 3, 3, 3])) == 0
    assert more(steady([3, 3, 3, 3, 3, 3, 3, 4, 4])) == 1
