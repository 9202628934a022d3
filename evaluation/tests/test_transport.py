import os

import msgspec
import pytest

from evaluation.transport import Cost, Trial, measure
from evaluation.transport_nodes import Begin, Look
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import ActionRequest, Message
from socialbot.graph.inline import InlineRunner


def test_the_share_of_a_processor_is_taken_within_the_time_of_the_run():
    cost = Cost()
    for second, cpu_s in enumerate([1.0, 1.1, 1.2, 1.4, 9.0]):
        cost.note(second * SECOND, {"cpu_s": str(cpu_s), "peak_rss_mb": "60.5"})
    assert cost.cpu_share(SECOND, 3 * SECOND) == pytest.approx(0.15)
    assert cost.cpu_share(SECOND, SECOND + 1) is None
    assert cost.peak_rss_mb == 60.5


def test_the_nodes_take_look_at_and_answer_every_frame_at_a_steady_rate(tmp_path):
    trial = Trial(frames=10, busy_s=0.001)
    runner = InlineRunner(trial.graph(tmp_path), start=SECOND)
    answers: list[Message] = []
    runner.tap("/agent/actions", lambda _, message: answers.append(message))
    runner.start()
    runner.feed("/evaluation/begin", Begin(stamp=2 * SECOND))
    runner.advance(4 * SECOND)
    runner.close()
    sent = msgspec.json.decode((tmp_path / "sent.json").read_bytes())
    looks = msgspec.json.decode((tmp_path / "looks.json").read_bytes(), type=list[Look])
    assert sent == [2 * SECOND + index * nanoseconds(1 / 30) for index in range(10)]
    assert [look.stamp for look in looks] == sent
    assert [answer.arguments for answer in answers if isinstance(answer, ActionRequest)] == [(stamp,) for stamp in sent]


@pytest.mark.slow
@pytest.mark.ros
def test_a_short_run_tells_latency_losses_age_and_cost():
    seconds = 1.2
    content = measure(seconds, int(os.environ["ROS_DOMAIN_ID"]), quick=True).content()
    assert content["frames_sent"] == round(30 * seconds)
    # A test does not measure: other tests may keep the machine busy.
    assert content["frames_lost"] <= 3
    assert content["actions_missing"] == 0
    assert 0 < content["arrival_p50_ms"] < content["latency_p50_ms"] <= content["latency_p99_ms"]
    assert content["latency_p50_ms"] < content["heard_p50_ms"]
    assert content["slow_detector_p50_ms"] >= 80
    assert content["stale_age_max_ms"] > content["stale_excess_max_ms"] > 0
    assert content["stale_dropped"] >= 10
    assert content["stale_dropped"] + content["stale_processed"] == content["frames_sent"]
    limited = {"latency_p99_ms", "frames_lost", "actions_missing", "stale_excess_max_ms", "executor_share"}
    assert set(content["required"]) == limited
    for nodes in ("nodes", "nodes_slow"):
        assert set(content[nodes]) == {"agent", "camera", "detector", "image_converter"}
        assert all(20 < node["peak_rss_mb"] < 500 for node in content[nodes].values())
