from __future__ import annotations

import pytest

from socialbot.bridge.security import MAX_STREAMS, Freshness, FreshnessVerdict
from socialbot.core.clock import SECOND

NEW, RENEWED, LATE, EARLY, REPLAYED = FreshnessVerdict


class Clocks:
    """A wall clock that can be set, and one that only goes on."""

    def __init__(self) -> None:
        self.wall = 1_800_000_000 * SECOND
        self.steady = 7 * SECOND

    def go_on(self, seconds: float) -> None:
        self.wall += round(seconds * SECOND)
        self.steady += round(seconds * SECOND)

    def receiver(self, *, joins_late: bool = False) -> Freshness:
        return Freshness(2.0, joins_late=joins_late, wall=lambda: self.wall, steady=lambda: self.steady)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def test_a_stream_only_goes_on(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    times = [clocks.wall + step for step in (1, 3, 2, 3, 4)]
    assert [receiver.judge("a", "s", number, time) for number, time in zip((1, 3, 2, 3, 4), times, strict=True)] == [
        NEW, NEW, REPLAYED, REPLAYED, NEW,
    ]  # fmt: skip


def test_senders_and_streams_are_told_apart(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    for sender, stream in (("a", "s"), ("a", "t"), ("b", "s")):
        assert receiver.judge(sender, stream, 1, clocks.wall) is NEW
        assert receiver.judge(sender, stream, 1, clocks.wall) is REPLAYED


@pytest.mark.parametrize(("age_s", "verdict"), [(-2.1, EARLY), (-1.9, NEW), (0.0, NEW), (1.9, NEW), (2.1, LATE)])
def test_the_window_is_for_clocks_that_differ_and_for_the_way(clocks, age_s, verdict):
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 1, clocks.wall - round(age_s * SECOND)) is verdict


def test_a_receiver_that_has_begun_anew_believes_nothing_older_than_itself(clocks):
    first = clocks.receiver()
    clocks.go_on(5)
    said = clocks.wall
    assert first.judge("a", "s", 9, said) is NEW
    clocks.go_on(0.5)
    again = clocks.receiver()
    clocks.go_on(0.5)
    assert again.judge("a", "s", 9, said) is LATE
    assert again.judge("a", "s", 10, clocks.wall) is NEW


def test_who_joins_late_hears_the_last_state_but_none_from_before_the_window(clocks):
    said = clocks.wall
    clocks.go_on(1.5)
    assert clocks.receiver(joins_late=True).judge("a", "s", 4, said) is NEW
    clocks.go_on(1.0)
    receiver = clocks.receiver(joins_late=True)
    assert receiver.judge("a", "s", 4, said) is LATE
    assert receiver.judge("a", "s", 4, clocks.wall) is NEW
    assert receiver.judge("a", "s", 4, clocks.wall + 1) is RENEWED


def test_an_old_state_fails_after_a_newer_one(clocks):
    receiver = clocks.receiver(joins_late=True)
    old = clocks.wall
    assert receiver.judge("a", "s", 1, old) is NEW
    assert receiver.judge("a", "s", 2, old + 5) is NEW
    assert receiver.judge("a", "s", 1, old) is REPLAYED
    assert receiver.judge("a", "s", 1, old + 6) is REPLAYED


def test_a_refused_message_leaves_no_mark(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 10**6, clocks.wall + 10 * SECOND) is EARLY
    assert receiver.judge("a", "s", 1, clocks.wall) is NEW


def test_a_wall_clock_that_is_set_right_does_no_harm(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    clocks.wall -= 3600 * SECOND
    assert receiver.judge("a", "s", 1, clocks.wall - SECOND) is NEW
    clocks.wall += 7200 * SECOND
    assert receiver.judge("a", "s", 2, clocks.wall - SECOND) is NEW


def test_memory_is_bounded_and_what_is_forgotten_is_late(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    first = clocks.wall
    for number in range(20 * MAX_STREAMS):
        assert receiver.judge("a", f"s{number}", 1, clocks.wall) is NEW
        clocks.go_on(0.05)
    assert receiver.stream_count <= MAX_STREAMS
    assert receiver.judge("a", "s0", 1, first) is LATE


@pytest.mark.parametrize("seconds", [-3600, -1, 1, 3600])
def test_a_computer_whose_clock_is_set_goes_on_to_believe_itself(clocks, seconds):
    """Sender and receiver are on it; what is latched is sealed anew all the while."""
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 1, clocks.wall) is NEW
    said = clocks.wall
    clocks.wall += seconds * SECOND
    for _ in range(5):
        clocks.go_on(0.4)
        assert receiver.judge("a", "s", 1, clocks.wall) is RENEWED
        assert receiver.judge("a", "s", 1, clocks.wall) is REPLAYED
    for number in range(2, 7):
        clocks.go_on(0.4)
        assert receiver.judge("a", "s", number, clocks.wall) is NEW
        assert receiver.judge("a", "s", number, clocks.wall) is REPLAYED
        assert receiver.judge("a", "s", 1, said) is REPLAYED
