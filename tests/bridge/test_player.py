"""Play bags into ROS."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from socialbot.bridge.player import PlaybackOptions, play_bag
from socialbot.core.errors import BagError
from tests.bags.making_bags import make_mcap
from tests.bags.test_bags import channel

STRING = ("std_msgs/msg/String", "ros2msg", b"string data", "cdr", [b"\0\1\0\0\3\0\0\0hi\0"] * 3)
OTHERS = [
    ("/arm/state", "p/msg/A", "ros2msg", b"uint8 b", "cdr", [b"\0\1\0\0\7"] * 3),
    ("/sensor_0/Depth Units/value", *STRING),
    ("/my-topic", *STRING),
]


def play(path: Path) -> int:
    with open_bag(path) as bag:
        topics = {topic.name: topic.name for topic in bag.topics}
        return play_bag(bag, topics, PlaybackOptions(rate=100.0, tail_s=0.0)).sent


@pytest.mark.parametrize("played", [channel("cdr"), ("said", *STRING)], ids=lambda each: each[0])
def test_topics_that_ros_cannot_have_are_named_and_the_others_are_played(
    played: tuple[str, str, str, bytes, str, list[bytes]], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_mcap(tmp_path / "robot.mcap", "ros2", [played, *OTHERS])
    with caplog.at_level(logging.WARNING):
        assert play(path) == len(played[-1])
    told = [record.getMessage() for record in caplog.records if "not played" in record.getMessage()]
    assert len(told) == len(OTHERS)
    for (topic, *_), message in zip(sorted(OTHERS), sorted(told), strict=True):
        assert topic in message
    assert "the ROS type p/msg/A is not installed" in " ".join(told)


def test_a_bag_without_a_topic_that_ros_can_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no topic can be played"):
        play(make_mcap(tmp_path / "robot.mcap", "ros2", OTHERS))
