import json
import struct

import pytest

from evaluation.faults_network import frames, highest, overheads_ms
from evaluation.faults_outage import after_s, is_centred
from evaluation.faults_watch import DIAGNOSTICS, Heard, heard, stamp_of

MS, SECOND = 1_000_000, 1_000_000_000


def at(time, stamp=0, **said):
    return Heard(time, "/topic", stamp, said)


def test_frames_are_paired_by_stamp_within_the_time_of_the_test():
    taken = [at(0, stamp) for stamp in (5, 10, 20, 30, 40)]
    came = [at(stamp + 3 * MS, stamp) for stamp in (5, 10, 30, 40)] + [at(99 * MS, 30)]
    found = frames(taken, came, 10, 40)
    assert found.taken == (10, 20, 30)
    assert found.came == {10: 10 + 3 * MS, 30: 30 + 3 * MS}, "of two arrivals the first counts"
    assert found.arrived == 2
    assert found.lost_share == pytest.approx(1 / 3)
    assert found.ages_ms() == [3.0, 3.0]


def test_a_time_without_frames_counts_as_lost():
    assert frames([], [], 0, 1).lost_share == 1.0


def test_the_time_at_the_detector_is_none_of_the_overhead():
    there, seen, acted = {0: 10 * MS, 1: 10 * MS}, {0: 70 * MS}, {0: 85 * MS, 1: 99 * MS}
    assert overheads_ms(acted, there, seen) == [25.0], "of a frame that nobody looked at nothing is known"


def test_the_maximum_over_the_time_counts():
    told = [
        Heard(time, DIAGNOSTICS, 0, {"node": "camera", "publish_max_ms": most})
        for time, most in ((1, "90.0"), (5, "2.5"), (6, "3.5"), (9, "80.0"))
    ]
    told.append(Heard(5, DIAGNOSTICS, 0, {"node": "dead", "state": "waiting"}))
    assert highest(told, "publish_max_ms", 5, 9) == {"camera": 3.5}


def test_the_first_after_a_moment_counts():
    assert after_s([at(SECOND), at(4 * SECOND), at(3 * SECOND)], 2 * SECOND) == 1.0
    assert after_s([at(SECOND)], 2 * SECOND) is None


def test_a_head_that_looks_straight_on_is_centred():
    assert is_centred(at(0, positions=(0.0, -0.004)))
    assert not is_centred(at(0, positions=(0.0, 0.03)))


@pytest.mark.parametrize(("mark", "order"), [(1, "<"), (0, ">")])
def test_the_stamp_is_read_from_the_bytes_of_a_picture(mark, order):
    data = bytes([0, mark, 0, 0]) + struct.pack(f"{order}iI", 1_763_760_000, 7) + b"more"
    assert stamp_of(data) == 1_763_760_000 * SECOND + 7


def test_a_line_that_is_still_being_written_is_left_out(tmp_path):
    file = tmp_path / "heard.jsonl"
    assert list(heard(file)) == []
    file.write_text(json.dumps({"at": 1, "topic": "/a", "stamp": 2, "said": {"x": 3}}) + '\n{"at": 4')
    assert list(heard(file)) == [Heard(1, "/a", 2, {"x": 3})]
