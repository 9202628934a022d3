"""Play bags into ROS."""

from __future__ import annotations

import logging
from pathlib import Path
from threading import Timer

import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from socialbot.bags.reader import open_bag
from socialbot.bags.writer import qos_of
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.player import Answers, BagPlayer, PlaybackOptions, play_bag
from socialbot.core.errors import BagError
from socialbot.core.process import Ending
from tests.bags.making_bags import START, make_mcap
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


def test_topics_that_were_latched_are_played_latched(tmp_path: Path) -> None:
    """Maps, descriptions of robots, and static transforms of a robot with a namespace: viewers start later."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "robot", version=9) as writer:
        for topic, latched in (("/robot_description", True), ("/chatter", False)):
            qos = [qos_of(latched=latched)]
            connection = writer.add_connection(topic, STRING[0], typestore=store, offered_qos_profiles=qos)
            writer.write(connection, START, STRING[-1][0])
    with open_bag(tmp_path / "robot") as bag, Ending(None).on_signals() as ending, spinning_node("player") as ros:
        topics = {topic.name: topic.name for topic in bag.topics}
        BagPlayer(ros, bag, topics, PlaybackOptions(), ending)
        offered = {topic: ros.get_publishers_info_by_topic(topic)[0].qos_profile.durability.name for topic in topics}
    assert offered == {"/robot_description": "TRANSIENT_LOCAL", "/chatter": "VOLATILE"}


def test_a_slow_graph_gets_the_time_that_it_takes() -> None:
    """Else a replay on a slow machine would go on without its answers, and differ."""
    answers = Answers(0.01, Ending())
    for number in (1, 2):
        Timer(0.3, answers.note, (number,)).start()
        assert answers.wait(number)
    late = Answers(0.01, Ending())
    late.note(1)
    assert not any(late.wait(number) for number in (2, 3, 4, 5)), "nobody answers"
    late.note(5)  # now it is known how long it takes
    Timer(0.1, late.note, (6,)).start()
    assert late.wait(6)


def test_a_stop_ends_the_wait_for_an_answer() -> None:
    ending = Ending()
    Timer(0.2, ending.ask).start()
    assert not Answers(1e6, ending).wait(1)
