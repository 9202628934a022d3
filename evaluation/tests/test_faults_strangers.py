from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from evaluation.faults_strangers import Effects, Stranger, refusals, say, with_keys
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.keys import load_keys, new_key
from socialbot.bridge.security import REASONS, Seal, SealError
from socialbot.core.messages import SpeechStatus

REALM, TOPIC = "ROS domain 7", "/speech/say"


@pytest.mark.parametrize("reason", REASONS)
def test_a_real_receiver_refuses_each_attack_for_its_stated_reason(tmp_path: Path, reason: str):
    new_key("robot", tmp_path)
    keys = load_keys(tmp_path)
    seal = Seal(keys, realm=REALM, window_s=5.0)
    opener, genuine = seal.opener(TOPIC), seal.stream(TOPIC).seal('"genuine"')
    assert opener.open(genuine) == '"genuine"'
    attack = Stranger(TOPIC, REALM, keys, genuine, '"strange"').attacks()[reason]
    for number in range(4):
        with pytest.raises(SealError) as error:
            opener.open(attack(number))
        assert error.value.reason == reason


def test_refusals_of_all_nodes_are_added_up():
    latest = {"a": {"refusals": "3 forged, 1 unknown sender"}, "b": {"refusals": "2 forged"}, "c": {"refusals": ""}}
    assert refusals(latest) == Counter({"forged": 5, "unknown sender": 1})


def test_there_is_something_to_say_on_each_topic():
    assert list(say("friend")) == list(say("strange"))
    assert all(say("friend")[topic] != message for topic, message in say("strange").items())


def test_effects_are_counted_by_their_text():
    effects = Effects()
    for _ in range(2):
        effects.note("/speech/status", SpeechStatus(stamp=1, utterance_id="u", state="started", text="friend"))
    assert effects.seen == {("/speech/status", "started friend"): 2}
    assert effects.told() == {"/speech/status"}


def test_keys_are_set_for_as_long_as_the_block_lasts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(KEYS_VARIABLE, raising=False)
    new_key("robot", tmp_path)
    with with_keys(tmp_path) as keys:
        assert keys.name == "robot"
    assert KEYS_VARIABLE not in os.environ
