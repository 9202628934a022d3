"""Detached seals: the match of messages of standard types with the seals of their digests."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from socialbot.bridge import detached_seals
from socialbot.bridge.detached_seals import MAX_SEALS, MAX_WAITING, SealMatcher, digest, padded
from socialbot.bridge.keys import Keys, load_keys, new_key
from socialbot.bridge.security import Seal, Stream
from socialbot.core.clock import SECOND

TOPIC = "/camera/image_raw"


@pytest.fixture
def keys(tmp_path: Path) -> Keys:
    new_key("robot", tmp_path)
    return load_keys(tmp_path)


class Receiving:
    """A matcher with its clock (s); records delivered messages and reasons of refusals."""

    def __init__(self, keys: Keys, *, joins_late: bool = True) -> None:
        self.now = 100.0
        self.got: list[bytes] = []
        self.refused: list[str] = []
        opener = Seal(keys, "here").opener(TOPIC, joins_late=joins_late)
        self.matcher = SealMatcher(
            opener,
            lambda cdr, _: self.got.append(cdr),
            lambda error: self.refused.append(getattr(error, "reason", "unfit")),
            lambda: self.now,
        )


@pytest.fixture
def receiving(keys: Keys) -> Receiving:
    return Receiving(keys)


@pytest.fixture
def stream(keys: Keys) -> Stream:
    return Seal(keys, "here").stream(TOPIC)


def test_delivers_a_message_after_its_seal_or_before(receiving, stream):
    receiving.matcher.take_seal(stream.seal(digest(b"one")))
    receiving.matcher.take_message(b"one")
    receiving.matcher.take_message(b"two")
    assert receiving.got == [b"one"]
    receiving.matcher.take_seal(stream.seal(digest(b"two")))
    assert (receiving.got, receiving.refused) == ([b"one", b"two"], [])


def test_delivers_a_sealed_message_once(receiving, stream):
    receiving.matcher.take_seal(stream.seal(digest(b"one")))
    receiving.matcher.take_message(b"one")
    receiving.matcher.take_message(b"one")
    receiving.matcher.close()
    assert (receiving.got, receiving.refused) == ([b"one"], ["unsealed"])


def test_a_withheld_message_does_not_arrive_after_a_later_one(receiving, stream, keys):
    """A stranger who stops messages but not their seals could otherwise change the order of commands."""
    other = Seal(keys, "here").stream(TOPIC)
    receiving.matcher.take_seal(other.seal(digest(b"other")))
    for cdr in (b"one", b"two", b"three"):
        receiving.matcher.take_seal(stream.seal(digest(cdr)))
    for cdr in (b"two", b"one", b"three", b"other"):
        receiving.matcher.take_message(cdr)
    receiving.matcher.close()
    assert (receiving.got, receiving.refused) == ([b"two", b"three", b"other"], ["unsealed"])


def test_a_withheld_message_arrives_within_the_time_window_of_its_seal(receiving, stream):
    """The time of the seal counts, not that of its arrival."""
    wall = time.time_ns() - 4 * SECOND
    stream.now = lambda: wall
    for cdr in (b"one", b"two"):
        receiving.matcher.take_seal(stream.seal(digest(cdr)))
    receiving.now += 0.9
    receiving.matcher.take_message(b"one")
    receiving.now += 0.2
    receiving.matcher.take_message(b"two")
    receiving.matcher.close()
    assert (receiving.got, receiving.refused) == ([b"one"], ["unsealed"])


def test_equal_messages_need_a_seal_each(receiving, stream):
    for _ in range(2):
        receiving.matcher.take_seal(stream.seal(digest(b"one")))
    for _ in range(3):
        receiving.matcher.take_message(b"one")
    assert receiving.got == [b"one", b"one"]


@pytest.mark.parametrize("size", range(8))
def test_dds_may_fill_up_the_last_word(size: int):
    word = bytes(range(size))
    assert len(padded(word)) % 4 == 0
    assert padded(word)[:size] == word
    assert digest(word) == digest(padded(word)) != digest(padded(word) + bytes(4))


def test_refuses_replayed_seals(receiving, stream):
    seal = stream.seal(digest(b"one"))
    receiving.matcher.take_seal(seal)
    receiving.matcher.take_message(b"one")
    receiving.matcher.take_seal(seal)
    receiving.matcher.take_message(b"one")
    assert (receiving.got, receiving.refused) == ([b"one"], ["replayed"])


def test_refuses_seals_of_other_topics_and_altered_messages(receiving, keys):
    receiving.matcher.take_seal(Seal(keys, "here").stream("/other").seal(digest(b"one")))
    receiving.matcher.take_message(b"one")
    receiving.matcher.take_seal("no seal")
    receiving.matcher.close()
    assert (receiving.got, receiving.refused) == ([], ["moved", "unsealed", "unsealed"])


def test_a_renewed_seal_delivers_nothing_again_but_serves_a_late_receiver(receiving, stream, keys):
    receiving.matcher.take_seal(stream.seal(digest(b"one")))
    receiving.matcher.take_message(b"one")
    renewed = stream.seal(digest(b"one"), renew=True)
    receiving.matcher.take_seal(renewed)
    receiving.matcher.take_message(b"one")
    assert receiving.got == [b"one"]
    late = Receiving(keys)
    late.matcher.take_message(b"one")
    late.matcher.take_seal(renewed)
    assert late.got == [b"one"]


def test_a_message_and_a_seal_wait_for_the_time_window(receiving, stream):
    receiving.matcher.take_message(b"one")
    receiving.matcher.take_seal(stream.seal(digest(b"two")))
    receiving.now += 5.1
    receiving.matcher.take_seal(stream.seal(digest(b"one")))
    receiving.matcher.take_message(b"two")
    assert (receiving.got, receiving.refused) == ([], ["unsealed"])


def test_memory_is_bounded_in_a_flood(receiving, stream, monkeypatch):
    for number in range(3 * MAX_WAITING):
        receiving.matcher.take_message(b"%d" % number)
    assert receiving.refused == 2 * MAX_WAITING * ["unsealed"]
    for number in range(MAX_SEALS + 1):
        receiving.matcher.take_seal(stream.seal(digest(b"seal %d" % number)))
    receiving.matcher.take_message(b"seal 0")
    assert receiving.got == []
    receiving.matcher.take_message(b"seal 1")
    assert receiving.got == [b"seal 1"]
    monkeypatch.setattr(detached_seals, "MAX_WAITING_BYTES", 10)
    receiving.matcher.take_message(20 * b"x")
    receiving.matcher.take_seal(stream.seal(digest(20 * b"x")))
    assert receiving.got[1:] == [20 * b"x"]


def test_a_replaced_subscription_and_its_successor_deliver_a_message_once(receiving, stream):
    matcher = receiving.matcher
    matcher.opener.watch.clock = matcher.clock
    watches = matcher.watch, matcher.opener.watch
    one, two = (stream.seal(digest(cdr)) for cdr in (b"one", b"two"))
    matcher.take_seal(one)
    matcher.take_message(b"one")
    for watch in watches:
        watch.begin_again()
    matcher.take_seal(two)
    matcher.take_message(b"two")
    for are_copies in (True, False):
        for watch in watches:
            watch.is_copy = are_copies
        for seal, cdr in ((one, b"one"), (two, b"two")):
            matcher.take_seal(seal)
            matcher.take_message(cdr)
        matcher.close()
        assert receiving.refused == ([] if are_copies else ["replayed", "replayed", "unsealed", "unsealed"])
    assert receiving.got == [b"one", b"two"]


def test_an_unsealed_message_that_arrives_twice_is_refused_once(receiving):
    matcher = receiving.matcher
    matcher.watch.begin_again()
    for is_copy in (False, True):
        matcher.watch.is_copy = is_copy
        matcher.take_message(b"unsealed")
    matcher.close()
    assert receiving.refused == ["unsealed"]


def test_knows_which_publishers_messages_do_not_arrive(keys, receiving, stream):
    matcher, other = receiving.matcher, Seal(keys, "here").stream(TOPIC)
    matcher.take_seal(stream.beacon())
    receiving.now += 10.0
    assert matcher.watch.fault(2) == ""
    for each, cdr in ((stream, b"one"), (other, b"other")):
        matcher.take_seal(each.seal(digest(cdr)))
    matcher.take_message(b"other")
    receiving.now += 2.0
    assert matcher.watch.fault(2) == "messages of 1 publishers do not arrive, but their seals do"
    matcher.take_message(b"one")
    assert matcher.watch.fault(2) == ""
    matcher.take_message(b"two")
    matcher.take_seal(stream.seal(digest(b"two")))
    receiving.now += 2.0
    assert matcher.watch.fault(2) == ""
