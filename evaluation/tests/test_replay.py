import msgspec
import numpy as np
import pytest

from evaluation.replay import add_faith, add_speed, bare_pass, inline_pass, metered_detector, shortened, usual_detector
from evaluation.report import Report
from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import Image

PERIOD = SECOND // 5


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Three seconds of small images without people: Waldo is idle and reports it."""
    path = tmp_path_factory.mktemp("bags") / "empty"
    with BagWriter(path) as writer:
        for index in range(16):
            stamp = SECOND + index * PERIOD
            pixels = np.full((120, 160, 3), 100 + index, np.uint8)
            writer.write("/camera/image_raw", Image.from_bgr(pixels, stamp=stamp, frame_id="camera"), stamp)
    return path


def test_the_meter_knows_what_passes_in_the_detector():
    picture = np.zeros((240, 320, 3), np.uint8)
    with metered_detector() as meter:
        usual_detector().detect(picture)
    measured = meter.wall_s
    usual_detector().detect(picture)
    assert 0 < measured == meter.wall_s


def test_a_shortened_bag_has_the_first_seconds_unchanged(bag, tmp_path):
    with open_bag(bag) as whole, open_bag(shortened(whole, tmp_path / "short", 1.0)) as short:
        topics = {"/camera/image_raw": "/camera/image_raw"}
        assert list(short.raw_messages(topics)) == list(whole.raw_messages(topics))[:5]


@pytest.mark.slow
def test_inline_replay_is_compared_with_the_bare_loop_and_with_itself(bag, tmp_path):
    report = Report("replay", quick=True)
    with open_bag(bag) as opened:
        bare = [bare_pass(opened)]
        inline = [inline_pass(opened, tmp_path / str(turn)) for turn in range(2)]
    late = [msgspec.structs.replace(action, stamp=action.stamp + 3 * PERIOD // 2) for action in inline[0].actions]
    add_speed(report, bare, inline)
    add_faith(report, inline, late)
    content = report.content()
    assert content["frames"] == 16
    assert 0 < content["outside_detector_share"] < 1
    assert content["inline_ms_per_frame"] > 0
    assert content["traces_identical"] is True
    assert content["trace_bytes"] > 0
    assert content["actions"] == len(late) > 0
    assert content["ros_actions_same"] is True
    assert content["ros_apart_periods"] == pytest.approx(1.5)
    assert content["unmet"][-1] == "ros_apart_periods"


@pytest.mark.slow
def test_other_actions_or_traces_do_not_pass_as_the_same(bag, tmp_path):
    with open_bag(bag) as opened:
        inline = [inline_pass(opened, tmp_path / str(turn)) for turn in range(2)]
    inline[1].trace = inline[1].trace.replace(b"belief", b"relief", 1)
    report = Report("replay", quick=True)
    add_faith(report, inline, [])
    assert report.unmet == ["traces_identical", "ros_actions_same"]
