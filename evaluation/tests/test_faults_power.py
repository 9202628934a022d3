from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from evaluation.faults_power import DETECTIONS, missing, read, whole_lines
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetections
from socialbot.runs.record import RunRecord


def seen(stamp: int) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=())


def test_messages_up_to_a_second_before_the_cut_must_exist():
    heard = [(1 * SECOND, 10), (2 * SECOND, 20), (3 * SECOND, 30)]
    assert missing(heard, frozenset({10, 20}), 3 * SECOND) == 0
    assert missing(heard, frozenset({10}), 3 * SECOND) == 1
    assert missing(heard, frozenset(), 5 * SECOND) == 3


def test_a_recording_is_read_up_to_where_it_breaks_off(tmp_path: Path):
    with BagWriter(tmp_path / "bag") as bag, RunRecord(tmp_path / "run") as record:
        for stamp in (1, 2, 3):
            bag.write(DETECTIONS, seen(stamp), stamp * SECOND)
            record.observe(DETECTIONS, seen(stamp))
        trace = tmp_path / "run" / "trace.jsonl"
        trace.write_bytes(trace.read_bytes()[:-5])
    kept = read(tmp_path / "bag", trace)
    assert (kept.in_bag, kept.in_trace, kept.bag_until) == ({1, 2, 3}, {1, 2}, 3 * SECOND)


def test_a_trace_that_is_damaged_elsewhere_is_no_record(tmp_path: Path):
    (tmp_path / "trace.jsonl").write_text("{broken\n")
    with pytest.raises(msgspec.MsgspecError):
        whole_lines(tmp_path / "trace.jsonl")
