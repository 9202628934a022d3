from __future__ import annotations

import contextlib

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bridge.security import REASONS, SCHEMA, Freshness, Keys, Opener, Sealed, SealError, Stream, read
from socialbot.core.clock import SECOND

PRIVATE = {name: Ed25519PrivateKey.generate() for name in ("robot", "workstation", "stranger")}
TRUSTED = {name: PRIVATE[name].public_key() for name in ("robot", "workstation")}
REALM, TOPIC = "ROS domain 42", "/speech/say"
NOW = 1_800_000_000 * SECOND


def keys(name: str, private: str = "") -> Keys:
    return Keys(name, PRIVATE[private or name], TRUSTED)


def stream(name: str = "robot", private: str = "", *, realm: str = REALM, topic: str = TOPIC, at: int = NOW) -> Stream:
    return Stream(keys(name, private), realm, topic, wall=lambda: at)


def opener(topic: str = TOPIC) -> Opener:
    return Opener(keys("workstation"), REALM, topic, Freshness(2.0, joins_late=True, wall=lambda: NOW, steady=int))


def reason(text: str, by: Opener | None = None) -> str:
    with pytest.raises(SealError) as caught:
        (by or opener()).open(text)
    assert caught.value.reason in REASONS
    assert caught.value.what.startswith(caught.value.reason)
    return caught.value.reason


@given(st.lists(st.text(st.characters(exclude_categories=["Cs"])), min_size=1, max_size=4))
def test_what_was_sealed_is_opened_as_it_was(texts):
    sender, receiver = stream(), opener()
    assert [receiver.open(sender.seal(text)) for text in texts] == texts


def test_every_change_of_a_sealed_message_is_noticed():
    sealed = msgspec.to_builtins(read(stream().seal('{"text":"left"}')))
    changes = {
        "sender": "workstation",
        "stream": "0" * 16,
        "number": 2,
        "time": NOW + 1,
        "topic": "/head/command",
        "payload": '{"text":"right"}',
        "signature": "A" * 86 + "==",
    }
    assert set(changes) == {field.name for field in msgspec.structs.fields(Sealed)}
    for name, value in changes.items():
        assert reason(msgspec.json.encode({**sealed, name: value}).decode()) == "forged"


@given(st.data())
def test_no_text_with_a_changed_character_says_something_else(data):
    text = stream().seal('{"text":"left"}')
    place = data.draw(st.integers(0, len(text) - 1))
    character = data.draw(st.characters(exclude_categories=["Cs"]).filter(lambda one: one != text[place]))
    with contextlib.suppress(SealError):
        assert opener().open(text[:place] + character + text[place + 1 :]) == '{"text":"left"}'


def test_a_seal_counts_for_its_topic_and_realm_only():
    assert reason(stream(topic="/speech/other").seal("a")) == "moved"
    assert reason(stream(realm="ROS domain 7").seal("a")) == "forged"


def test_a_stranger_with_a_key_of_their_own_is_not_believed():
    assert reason(stream("stranger").seal("a")) == "unknown sender"
    assert reason(stream("robot", "stranger").seal("a")) == "forged"


def test_one_sender_cannot_pass_for_another():
    assert reason(stream("robot", "workstation").seal("a")) == "forged"


@pytest.mark.parametrize(
    "text", ["", "Hello", "{}", '{"schema":"socialbot/Utterance/1"}', "[" * 100_000, "\ud800", "7"]
)
def test_plain_text_is_unsealed(text):
    assert reason(text) == "unsealed"


@pytest.mark.parametrize(
    "rest",
    [
        "}",
        ',"sender":3}',
        ',"sender":"robot","stream":"s","number":-1,"time":1,"topic":"/t","payload":"","signature":""}',
        f',"sender":"robot","stream":"s","number":{2**70},"time":1,"topic":"/t","payload":"","signature":""}}',
        ',"sender":"robot","stream":"s","number":1,"time":1,"topic":"/t","payload":{},"signature":""}',
        ',"sender":"robot","stream":"s","number":1,"time":1,"topic":"/t","payload":"","signature":"?"}',
        ',"sender":"robot","stream":"s","number":1,"time":1,"topic":"/t","payload":"","signature":"","more":'
        + "[" * 9999,
        ',"sender":"' + "r" * 300 + '","stream":"s","number":1,"time":1,"topic":"/t","payload":"","signature":""}',
    ],
)
def test_a_seal_that_is_none_is_unreadable(rest):
    assert reason(f'{{"schema":"{SCHEMA}"{rest}') == "unreadable"


def test_a_signature_of_wrong_length_is_forged():
    rest = '"sender":"robot","stream":"s","number":1,"time":1,"topic":"/t","payload":"","signature":""'
    assert reason(f'{{"schema":"{SCHEMA}",{rest}}}') == "forged"


def test_a_message_is_believed_once():
    sender, receiver = stream(), opener()
    first, second = sender.seal("a"), sender.seal("b")
    assert receiver.open(first) == "a"
    assert reason(first, receiver) == "replayed"
    assert receiver.open(second) == "b"
    assert reason(first, receiver) == "replayed"


def test_late_and_early_messages_are_refused_with_what_the_clocks_differ():
    assert reason(stream(at=NOW - 3 * SECOND).seal("a")) == "late"
    with pytest.raises(SealError, match=r"3.000 s ahead of our clock\n  remedy: set the clocks") as caught:
        opener().open(stream(at=NOW + 3 * SECOND).seal("a"))
    assert caught.value.reason == "early"


def test_what_is_sealed_anew_is_heard_by_who_has_not_heard_it():
    sender, receiver = stream(), opener()
    first = sender.seal("a")
    again = sender.seal("a", anew=True)
    assert (receiver.open(first), receiver.open(again)) == ("a", None)
    assert opener().open(again) == "a"
    assert reason(again, receiver) == "replayed"


def test_a_refusal_shows_little_of_what_a_stranger_says():
    for text in ("x" * 10**6, stream().seal("a").replace("robot", "r" * 200)):
        with pytest.raises(SealError) as caught:
            opener().open(text)
        assert len(str(caught.value)) < 200


def test_messages_of_one_stream_are_sealed_in_order_when_the_clock_is_set_back():
    times = iter([NOW, NOW - SECOND, NOW - SECOND])
    sender = Stream(keys("robot"), REALM, TOPIC, wall=lambda: next(times))
    receiver = opener()
    assert [receiver.open(sender.seal(text)) for text in "abc"] == ["a", "b", "c"]


def test_who_starts_again_after_the_clock_was_set_back_believes_who_has_not():
    times = iter([NOW, NOW - 3600 * SECOND])
    sender = Stream(keys("robot"), REALM, TOPIC, wall=lambda: next(times))
    sender.seal("a")
    fresh = Freshness(2.0, joins_late=True, wall=lambda: NOW - 3600 * SECOND, steady=int)
    assert Opener(keys("workstation"), REALM, TOPIC, fresh).open(sender.seal("b")) == "b"
