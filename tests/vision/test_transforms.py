"""Transforms of strangers and of people who left."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import Transform
from socialbot.vision.transforms import TransformTree

STILL = (0.0, 0.0, 0.0, 1.0)


def link(parent: str, child: str, x: float = 1.0, stamp: int = 0, rotation: tuple[float, ...] = STILL) -> Transform:
    turn = rotation[0], rotation[1], rotation[2], rotation[3]
    return Transform(stamp=stamp, parent=parent, child=child, translation=(x, 0.0, 0.0), rotation=turn)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308])
def test_a_transform_without_finite_numbers_changes_nothing(value: float) -> None:
    tree = TransformTree()
    tree.add([link("base", "camera")])
    tree.add([link("base", "camera", value), link("base", "camera", rotation=(0.0, 0.0, value, 1.0))])
    tree.add([link("base", "hand", value)])
    assert tree.lookup("base", "camera", 0) == pytest.approx(np.eye(4) + np.eye(4, k=3))
    assert tree.frames() == {"base", "camera"}


def test_circles_of_frames_end() -> None:
    tree = TransformTree()
    tree.add([link("a", "b"), link("b", "c"), link("c", "a"), link("d", "d")])
    assert tree.lookup("a", "c", 0) is not None
    assert tree.lookup("base", "c", 0) is None
    assert tree.frames() == {"a", "b", "c"}


def test_a_long_chain_of_frames_costs_little_for_many_people() -> None:
    tree = TransformTree()
    chain = [link(f"{number}", f"{number + 1}") for number in range(1000)]
    for _ in range(200):
        tree.add([*chain, *(link("1000", f"body_{number}") for number in range(900))])
    begin = time.process_time()
    for number in range(900):
        assert tree.lookup("0", f"body_{number}", 0) is None
    assert time.process_time() - begin < 3.0
    assert tree.moved_at("0", "1000") is None
    near = tree.lookup("950", "body_1", 0)
    assert near is not None
    assert near[0, 3] == pytest.approx(51.0)


def test_transforms_that_arrive_between_two_lookups_count() -> None:
    tree = TransformTree()
    for x, stamp in ((1.0, 0), (2.0, 5), (3.0, 7)):
        tree.add([link("base", "camera", x, stamp)], moving=True)
        found = tree.lookup("base", "camera", 7)
        assert found is not None
        assert found[0, 3] == pytest.approx(x)
    found = tree.lookup("base", "camera", 5)
    assert found is not None
    assert found[0, 3] == pytest.approx(2.0)


def test_frames_of_people_who_left_are_forgotten() -> None:
    tree = TransformTree()
    tree.add([link("base", "camera")])
    for number in range(5000):
        stamp = number * SECOND
        tree.add([link("base", f"body_{number}", 1.0, stamp), link("odom", "base", 2.0, stamp)], moving=True)
    assert len(tree.frames()) < 300
    assert tree.newest("body_0") is None
    assert tree.newest("body_4999") == 4999 * SECOND
    assert tree.lookup("odom", "camera", 0) is not None


def test_a_frame_is_taken_again_after_a_flood() -> None:
    tree = TransformTree()
    for stamp in (0, 59 * SECOND, 3600 * SECOND):  # one of them from the future
        tree.add([link("base", f"flood_{stamp}_{number}", 0.0, stamp) for number in range(2500)], moving=True)
    for second in range(61, 64):
        tree.add([link("base", "camera", 1.0, second * SECOND)], moving=True)
    assert tree.newest("camera") is None  # the last flood still counts
    tree.add([link("base", "camera", 1.0, 3661 * SECOND)], moving=True)
    assert tree.newest("camera") == 3661 * SECOND


@pytest.mark.parametrize("moving", [False, True])
def test_a_flood_of_frames_is_bounded_and_replaces_none(moving: bool) -> None:
    tree = TransformTree()
    tree.add([link("base", "camera")])
    flood = [link(f"{number}", f"{number + 1}") for number in range(20_000)]
    begin = time.process_time()
    tree.add(flood, moving=moving)
    assert time.process_time() - begin < 2.0
    assert len(tree.frames()) < 3000
    assert tree.lookup("base", "camera", 0) is not None
    begin = time.process_time()
    tree.lookup("0", "1500", 0)
    assert time.process_time() - begin < 1.0
