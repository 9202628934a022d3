"""A simulated place with Waldo over ROS 2: the same pictures, motions and decisions as inline."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from socialbot.bags.reader import open_bag
from socialbot.core.messages import CompressedImage, JointTrajectory, Message, TraceRecord, Transforms
from tests.system.running import socialbot

pytestmark = [pytest.mark.slow, pytest.mark.ros]


@pytest.fixture(scope="module", params=["processes", "composed"])
def over_ros(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Message]]:
    return recorded(tmp_path_factory.mktemp("ros"), *over_dds(request.param))


def over_dds(hosting: str) -> tuple[str, ...]:
    return ("--runner", "ros", *(("--composed",) if hosting == "composed" else ()))


@pytest.fixture(scope="module")
def inline(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Message]]:
    return recorded(tmp_path_factory.mktemp("inline"))


def recorded(folder: Path, *options: str) -> dict[str, list[Message]]:
    """Record 8 s at 5 pictures per second, unless the options differ; return the messages of the bag by topic."""
    done = socialbot(
        "sim", "foyer", "--seed", "0", "--visitors", "4", "--duration", "8", "--size", "320x240", "--fps", "5",
        "--record", folder / "bag", "--out", folder / "run", *options,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found: dict[str, list[Message]] = defaultdict(list)
    with open_bag(folder / "bag") as bag:
        # The truth is evaluated elsewhere; as a String it has no stamp.
        for topic, message in bag.messages({each.name: each.name for each in bag.topics if "truth" not in each.name}):
            found[topic].append(message)
    return found


def test_every_topic_of_the_place_is_published_at_its_rate(over_ros: dict[str, list[Message]]) -> None:
    assert {topic: len(messages) for topic, messages in over_ros.items() if "trace" not in topic} == {
        "/camera/image_raw/compressed": 41,
        "/camera/camera_info": 9,
        "/joint_states": 161,
        "/tf": 161,
        "/tf_static": 1,
        "/robot_description": 1,
        "/head_controller/joint_trajectory": len(over_ros["/head_controller/joint_trajectory"]),
    }
    stamps = [image.stamp for image in over_ros["/camera/image_raw/compressed"]]
    assert {later - sooner for sooner, later in pairwise(stamps)} == {200_000_000}


def test_commands_turn_the_head_and_the_picture(over_ros: dict[str, list[Message]]) -> None:
    (first, *_) = over_ros["/head_controller/joint_trajectory"]
    assert isinstance(first, JointTrajectory)
    last = over_ros["/tf"][-1]
    assert isinstance(last, Transforms)
    assert abs(first.positions[0]) > 0.1
    assert abs(last.transforms[0].rotation[2]) > 0.05


def test_the_runners_agree_on_pictures_motions_and_decisions(
    over_ros: dict[str, list[Message]], inline: dict[str, list[Message]]
) -> None:
    assert pictures(over_ros) == pictures(inline)
    motions = "/head_controller/joint_trajectory"
    assert over_ros[motions] == inline[motions]
    decisions = [record for record in over_ros["/waldo/trace"] if isinstance(record, TraceRecord)]
    assert decisions == inline["/waldo/trace"]
    assert any(record.kind == "belief" for record in decisions)


def test_no_picture_is_skipped_at_a_rate_above_the_usual_steps_of_the_clock(tmp_path: Path) -> None:
    fast = ("--duration", "3", "--fps", "20")
    here, there = recorded(tmp_path / "inline", *fast), recorded(tmp_path / "ros", *over_dds("composed"), *fast)
    assert len(pictures(there)) == 61
    assert pictures(there) == pictures(here)
    motions = "/head_controller/joint_trajectory"
    assert there[motions] == here[motions]


def pictures(messages: dict[str, list[Message]]) -> list[tuple[int, bytes]]:
    images = [each for each in messages["/camera/image_raw/compressed"] if isinstance(each, CompressedImage)]
    return [(image.stamp, image.data.tobytes()) for image in images]
