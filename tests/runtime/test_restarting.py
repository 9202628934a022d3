"""The backoff of a supervisor, in seconds of an imagined clock."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from socialbot.runtime._processes import RestartBackoff, RestartPolicy

POLICY = RestartPolicy(times=3, within_s=60.0, first_s=0.2, longest_s=0.5)


def test_what_dies_at_once_is_left_alone_for_longer_and_longer_and_then_given_up():
    backoff = RestartBackoff(POLICY)
    pauses = []
    for now in (0.0, 1.0, 2.0, 3.0):
        backoff.started(now)
        pauses.append(backoff.crashed(now + 0.1))
    assert pauses == [0.2, 0.4, 0.5, None]


def test_what_has_lived_for_a_while_is_started_again_at_once():
    backoff = RestartBackoff(POLICY)
    backoff.started(0.0)
    assert backoff.crashed(0.1) == 0.2
    backoff.started(0.3)
    assert backoff.crashed(2.0) == 0.0
    backoff.started(2.0)
    assert backoff.crashed(2.1) == 0.2


def test_deaths_of_long_ago_are_forgotten():
    backoff = RestartBackoff(POLICY)
    for now in (0.0, 25.0, 50.0, 75.0, 100.0, 125.0):
        backoff.started(now)
        assert backoff.crashed(now + 20.0) == 0.0


@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=30))
def test_after_a_short_life_a_pause_is_never_shorter_than_the_first_nor_longer_than_the_longest(lives):
    backoff, now = RestartBackoff(POLICY), 0.0
    for life in lives:
        backoff.started(now)
        now += life
        pause = backoff.crashed(now)
        if pause is None:
            return
        assert POLICY.first_s <= pause <= POLICY.longest_s or (pause == 0.0 and life > 0.4)
        now += pause
