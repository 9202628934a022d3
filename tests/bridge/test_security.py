"""Keys, freshness and seals."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import stat
import time
from concurrent.futures import ThreadPoolExecutor
from typing import get_args

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from socialbot.bridge.accepted_times import AcceptedTimes
from socialbot.bridge.keys import Keys, SecurityError, fingerprint, load_keys, load_private_key, new_key, private_names
from socialbot.bridge.security import (
    MAX_STREAMS,
    REASONS,
    SCHEMA,
    Freshness,
    FreshnessVerdict,
    Opener,
    Sealed,
    SealError,
    Stream,
    read,
)
from socialbot.cli.key import key
from socialbot.core.clock import SECOND
from socialbot.core.limits import TEXT_BYTES


@pytest.fixture
def folder(tmp_path):
    new_key("robot", tmp_path / "keys")
    return tmp_path / "keys"


def complaint(folder, name="") -> str:
    with pytest.raises(SecurityError) as caught:
        load_keys(folder, name)
    return str(caught.value)


def test_a_new_key_is_trusted(folder):
    keys = load_keys(folder)
    assert (keys.name, set(keys.trusted)) == ("robot", {"robot"})
    keys.trusted["robot"].verify(keys.private.sign(b"word"), b"word")


def test_a_private_key_is_hidden_from_users_and_git(folder):
    assert stat.S_IMODE((folder / "robot.key").stat().st_mode) == 0o600
    assert (folder / ".gitignore").read_text() == "*.key\n"
    assert "PrivateKey" not in repr(load_keys(folder))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_refuses_a_readable_private_key(folder, mode):
    (folder / "robot.key").chmod(mode)
    text = complaint(folder)
    assert "other users can read or change this private key" in text
    assert f"chmod 600 {folder / 'robot.key'}" in text


@pytest.mark.parametrize("name", [".", "robot.pub"])
def test_refuses_writable_public_keys(folder, name):
    (folder / name).chmod(0o757 if name == "." else 0o646)
    assert "other users can" in complaint(folder)


def test_several_private_keys_need_a_name(folder):
    new_key("workstation", folder)
    assert "several private keys: robot, workstation" in complaint(folder)
    assert load_keys(folder, "workstation").name == "workstation"
    assert private_names(folder) == ["robot", "workstation"]


def test_a_private_key_is_required(folder):
    (folder / "robot.key").unlink()
    assert "no private key" in complaint(folder)


def test_refuses_a_mismatched_pair(folder, tmp_path):
    new_key("robot", tmp_path / "other")
    shutil.copy(tmp_path / "other" / "robot.pub", folder)
    assert "are not a pair" in complaint(folder)
    (folder / "robot.pub").unlink()
    assert "there is no robot.pub" in complaint(folder, "robot")


def test_never_overwrites_a_key(folder):
    before = (folder / "robot.key").read_bytes()
    (folder / "robot.pub").unlink()
    with pytest.raises(SecurityError, match="cannot create the key 'robot'"):
        new_key("robot", folder)
    assert (folder / "robot.key").read_bytes() == before


@pytest.mark.parametrize("name", ["", "../robot", "a/b", ".robot", "-robot", "r" * 65, "robot\n", "róbot"])
def test_refuses_names_outside_of_the_folder(folder, name):
    with pytest.raises(SecurityError, match="is not a valid key name"):
        new_key(name, folder)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"rubbish",
        b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n",
        # The length of a part is wrong, of which OpenSSL complains in a way of its own.
        b"-----BEGIN PRIVATE KEY-----\nMC4CAQAwBQYDK2VvBCIEIAABAgMEBQYHCAkKCwwNDg8QERITFBUWFxgZGhscHR4f\n"
        b"-----END PRIVATE KEY-----\n",
    ],
)
def test_refuses_damaged_keys(folder, text):
    (folder / "robot.pub").write_bytes(text)
    assert "the file holds no usable key" in complaint(folder)
    (folder / "robot.key").write_bytes(text)
    with pytest.raises(SecurityError, match="the file holds no usable key"):
        load_private_key(folder / "robot.key")


def test_refuses_keys_of_another_kind(folder):
    from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    public = generate_private_key(SECP256R1()).public_key()
    (folder / "robot.pub").write_bytes(public.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    assert "not a public Ed25519 key" in complaint(folder)


def test_a_missing_folder_is_an_error(tmp_path):
    assert "no such folder" in complaint(tmp_path / "none", "robot")


class TestCommands:
    def run(self, *arguments: object) -> str:
        result = CliRunner().invoke(key, [str(one) for one in arguments], catch_exceptions=False)
        assert result.exit_code == 0
        return result.output

    def test_new_list_and_check_print_the_same_fingerprint(self, folder):
        made = self.run("new", "workstation", "--folder", folder)
        shown = fingerprint(load_keys(folder, "robot").trusted["workstation"])
        assert shown in made
        assert shown in self.run("list", "--folder", folder)
        assert "signs as robot, trusts workstation" in self.run("check", "robot", "--folder", folder)

    def test_the_folder_comes_from_the_variable(self, folder, monkeypatch):
        monkeypatch.setenv("SOCIALBOT_KEYS", f"{folder}:robot")
        assert "robot" in self.run("list")
        monkeypatch.delenv("SOCIALBOT_KEYS")
        monkeypatch.chdir(folder.parent)
        assert "signs as robot" in self.run("check")

    def test_check_fails_for_unusable_keys(self, folder):
        os.chmod(folder / "robot.key", 0o644)
        with pytest.raises(SecurityError):
            self.run("check", "--folder", folder)


NEW, RENEWED, LATE, EARLY, REPLAYED = get_args(FreshnessVerdict)


class Clocks:
    """A wall clock that can be set, and one that only goes on."""

    def __init__(self) -> None:
        self.wall = 1_800_000_000 * SECOND
        self.steady = 7 * SECOND

    def go_on(self, seconds: float) -> None:
        self.wall += round(seconds * SECOND)
        self.steady += round(seconds * SECOND)

    def receiver(self, *, joins_late: bool = False, accepted: AcceptedTimes | None = None) -> Freshness:
        return Freshness(2.0, joins_late, lambda: self.wall, lambda: self.steady, accepted)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def test_a_stream_must_advance(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    times = [clocks.wall + step for step in (1, 3, 2, 3, 4)]
    assert [receiver.judge("a", "s", number, time) for number, time in zip((1, 3, 2, 3, 4), times, strict=True)] == [
        NEW, NEW, REPLAYED, REPLAYED, NEW,
    ]  # fmt: skip


def test_senders_and_streams_are_independent(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    for sender, stream in (("a", "s"), ("a", "t"), ("b", "s")):
        assert receiver.judge(sender, stream, 1, clocks.wall) == NEW
        assert receiver.judge(sender, stream, 1, clocks.wall) == REPLAYED


@pytest.mark.parametrize(("age_s", "verdict"), [(-2.1, EARLY), (-1.9, NEW), (0.0, NEW), (1.9, NEW), (2.1, LATE)])
def test_accepts_messages_within_the_window(clocks, age_s, verdict):
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 1, clocks.wall - round(age_s * SECOND)) == verdict


def test_a_new_receiver_refuses_older_messages(clocks):
    first = clocks.receiver()
    clocks.go_on(5)
    said = clocks.wall
    assert first.judge("a", "s", 9, said) == NEW
    clocks.go_on(0.5)
    again = clocks.receiver()
    clocks.go_on(0.5)
    assert again.judge("a", "s", 9, said) == LATE
    assert again.judge("a", "s", 10, clocks.wall) == NEW


@pytest.mark.parametrize("ahead_s", [-1.0, 0.0, 0.6, 1.9])
def test_a_restart_opens_no_replay_whatever_the_clock_of_the_sender(clocks, tmp_path, ahead_s):
    first = clocks.receiver(accepted=AcceptedTimes(tmp_path / "accepted"))
    clocks.go_on(5)
    said = clocks.wall + round(ahead_s * SECOND)
    assert first.judge("a", "s", 9, said) == NEW
    clocks.go_on(0.5)
    again = clocks.receiver(accepted=AcceptedTimes(tmp_path / "accepted"))
    clocks.go_on(0.1)
    assert again.judge("a", "s", 9, said) == LATE
    clocks.go_on(max(0.0, -ahead_s))
    assert again.judge("a", "s", 10, clocks.wall + round(ahead_s * SECOND)) == NEW
    assert again.judge("b", "t", 1, clocks.wall) == NEW


def test_accepted_times_of_a_clock_that_was_set_back_do_not_count(clocks, tmp_path):
    first = clocks.receiver(accepted=AcceptedTimes(tmp_path))
    clocks.go_on(5)
    assert first.judge("a", "s", 9, clocks.wall) == NEW
    clocks.wall -= 3600 * SECOND
    again = clocks.receiver(accepted=AcceptedTimes(tmp_path))
    clocks.go_on(1)
    assert again.judge("a", "s", 10, clocks.wall) == NEW
    assert again.judge("a", "s", 9, clocks.wall + 3600 * SECOND) == REPLAYED


@pytest.mark.parametrize("back_s", [1, 4, 5, 30, 3600, 86400])
def test_a_restart_after_the_clock_was_set_back_opens_no_replay(clocks, tmp_path, back_s):
    """The clock reaches the times of old messages again, as on a computer whose clock stops with its power."""
    first = clocks.receiver(accepted=AcceptedTimes(tmp_path))
    clocks.go_on(5)
    said = [(number, clocks.wall + number * SECOND) for number in range(1, 9)]
    for number, at in said:
        clocks.go_on(1)
        assert first.judge("a", "s", number, at) == NEW
    clocks.wall -= back_s * SECOND
    clocks.go_on(0.5)
    again = clocks.receiver(accepted=AcceptedTimes(tmp_path))
    heard = []
    for _ in range(2 * back_s if back_s < 60 else 0):
        clocks.go_on(0.5)
        heard += [again.judge("a", "s", number, at) for number, at in said]
    clocks.wall = said[0][1]
    heard += [again.judge("a", "s", number, at) for number, at in said]
    assert NEW not in heard
    clocks.go_on(10)
    assert again.judge("a", "s", 9, clocks.wall) == NEW


def test_a_late_subscriber_takes_the_last_state_of_an_earlier_one_but_no_older_one(clocks, tmp_path):
    first = clocks.receiver(joins_late=True, accepted=AcceptedTimes(tmp_path))
    assert [first.judge("a", "s", number, clocks.wall) for number in (4, 5)] == [NEW, NEW]
    clocks.go_on(0.1)
    again = clocks.receiver(joins_late=True, accepted=AcceptedTimes(tmp_path))
    assert NEW not in [again.judge("a", "s", number, clocks.wall) for number in (3, 4)]
    assert again.judge("a", "s", 5, clocks.wall) == NEW


def test_a_stopped_process_does_not_block_the_others(tmp_path, caplog):
    """It may hold the lock of a file while it is stopped."""
    times = AcceptedTimes(tmp_path)
    times.note("a", "s", 1, SECOND)
    with (tmp_path / ".streams").open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        begun = time.monotonic()
        for number in range(2, 100):
            times.note("a", "s", number, number * SECOND)
        assert time.monotonic() - begun < 2.0
        assert caplog.text.count("cannot note accepted messages") == 1
    times.note("a", "s", 100, 100 * SECOND)
    assert AcceptedTimes(tmp_path).number("a", "s") == 100


def test_threads_that_note_messages_at_once_lose_none(tmp_path):
    times = AcceptedTimes(tmp_path)

    def note(thread: int) -> None:
        for number in range(200):
            times.note("a", f"{thread}-{number}", number, number)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(note, range(8)))
    kept = AcceptedTimes(tmp_path)
    assert all(kept.number("a", f"{thread}-{number}") == number for thread in range(8) for number in range(200))


def test_the_numbers_of_many_streams_are_kept_in_a_file_of_limited_size(tmp_path):
    times = AcceptedTimes(tmp_path)
    for number in range(5000):
        times.note("a", f"s{number}", number, number)
    times.note("a", "s4999", 1, 5000)
    kept = AcceptedTimes(tmp_path)
    assert [kept.number("a", f"s{number}") for number in range(4990, 5000)] == list(range(4990, 5000))
    assert (kept.number("b", "s4999"), kept.number("a", "s5000")) == (-1, -1)
    assert (tmp_path / ".streams").stat().st_size <= 100_000
    (tmp_path / ".streams").write_bytes(b"damaged")
    assert AcceptedTimes(tmp_path).number("a", "s4999") == -1


def test_processes_share_the_accepted_times(tmp_path):
    one, other = AcceptedTimes(tmp_path / "x"), AcceptedTimes(tmp_path / "x")
    one.note("a", "s", 1, 9 * SECOND)
    other.note("a", "s", 1, 5 * SECOND)
    other.note("b", "s", 1, 5 * SECOND)
    read = AcceptedTimes(tmp_path / "x")
    assert (read.before("a"), read.before("b"), read.before("c")) == (9_050_000_000, 5_050_000_000, 0)
    (tmp_path / "x" / "a").write_bytes(b"damaged")
    assert AcceptedTimes(tmp_path / "x").before("a") == 0


def test_a_folder_that_cannot_be_written_is_reported_once(tmp_path, caplog):
    (tmp_path / "file").touch()
    times = AcceptedTimes(tmp_path / "file" / "inside")
    times.note("a", "s", 1, SECOND)
    times.note("a", "s", 2, 2 * SECOND)
    assert caplog.text.count("cannot note accepted messages") == 1


@pytest.mark.parametrize("name", ["a", ".streams"])
def test_times_are_not_written_through_a_link(name, tmp_path, caplog):
    """Another user may have prepared the folder, as below /tmp."""
    (tmp_path / "elsewhere").write_bytes(b"precious")
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / name).symlink_to(tmp_path / "elsewhere")
    AcceptedTimes(tmp_path / "state").note("a", "s", 1, SECOND)
    assert (tmp_path / "elsewhere").read_bytes() == b"precious"
    assert "cannot note accepted messages" in caplog.text


@pytest.mark.parametrize("prepared", ["mode", "owner"])
def test_times_in_a_folder_that_others_can_change_are_not_trusted(prepared, tmp_path, caplog, monkeypatch):
    folder = tmp_path / "state"
    folder.mkdir(mode=0o755)
    if prepared == "mode":
        folder.chmod(0o777)
    else:
        monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    AcceptedTimes(folder).note("a", "s", 1, SECOND)
    assert not list(folder.iterdir())
    assert "other users can change the folder" in caplog.text


def test_times_are_noted_again_once_the_folder_can_be_written(tmp_path, caplog):
    """A full disk, or one that is mounted late."""
    (tmp_path / "file").touch()
    times = AcceptedTimes(tmp_path / "file")
    times.note("a", "s", 1, SECOND)
    (tmp_path / "file").unlink()
    times.note("a", "s", 2, 2 * SECOND)
    assert AcceptedTimes(tmp_path / "file").before("a") == 2_050_000_000
    (tmp_path / "file" / "b").mkdir()
    times.note("b", "s", 1, SECOND)
    assert caplog.text.count("cannot note accepted messages") == 2


def test_a_late_receiver_accepts_messages_within_the_window(clocks):
    said = clocks.wall
    clocks.go_on(1.5)
    assert clocks.receiver(joins_late=True).judge("a", "s", 4, said) == NEW
    clocks.go_on(1.0)
    receiver = clocks.receiver(joins_late=True)
    assert receiver.judge("a", "s", 4, said) == LATE
    assert receiver.judge("a", "s", 4, clocks.wall) == NEW
    assert receiver.judge("a", "s", 4, clocks.wall + 1) == RENEWED


def test_refuses_an_old_message_after_a_newer_one(clocks):
    receiver = clocks.receiver(joins_late=True)
    old = clocks.wall
    assert receiver.judge("a", "s", 1, old) == NEW
    assert receiver.judge("a", "s", 2, old + 5) == NEW
    assert receiver.judge("a", "s", 1, old) == REPLAYED
    assert receiver.judge("a", "s", 1, old + 6) == REPLAYED


def test_a_refused_message_is_not_remembered(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 10**6, clocks.wall + 10 * SECOND) == EARLY
    assert receiver.judge("a", "s", 1, clocks.wall) == NEW


def test_a_changed_wall_clock_is_no_problem(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    clocks.wall -= 3600 * SECOND
    assert receiver.judge("a", "s", 1, clocks.wall - SECOND) == NEW
    clocks.wall += 7200 * SECOND
    assert receiver.judge("a", "s", 2, clocks.wall - SECOND) == NEW


def test_memory_is_limited(clocks):
    receiver = clocks.receiver()
    clocks.go_on(5)
    first = clocks.wall
    for number in range(20 * MAX_STREAMS):
        assert receiver.judge("a", f"s{number}", 1, clocks.wall) == NEW
        clocks.go_on(0.05)
    assert receiver.stream_count <= MAX_STREAMS
    assert receiver.judge("a", "s0", 1, first) == LATE


@pytest.mark.parametrize("seconds", [-3600, -1, 1, 3600])
def test_sender_and_receiver_survive_a_change_of_their_clock(clocks, seconds):
    """Both run on the changed clock; latched messages are resealed meanwhile."""
    receiver = clocks.receiver()
    clocks.go_on(5)
    assert receiver.judge("a", "s", 1, clocks.wall) == NEW
    said = clocks.wall
    clocks.wall += seconds * SECOND
    for _ in range(5):
        clocks.go_on(0.4)
        assert receiver.judge("a", "s", 1, clocks.wall) == RENEWED
        assert receiver.judge("a", "s", 1, clocks.wall) == REPLAYED
    for number in range(2, 7):
        clocks.go_on(0.4)
        assert receiver.judge("a", "s", number, clocks.wall) == NEW
        assert receiver.judge("a", "s", number, clocks.wall) == REPLAYED
        assert receiver.judge("a", "s", 1, said) == REPLAYED


PRIVATE = {name: Ed25519PrivateKey.generate() for name in ("robot", "workstation", "stranger")}
TRUSTED = {name: PRIVATE[name].public_key() for name in ("robot", "workstation")}
REALM, TOPIC = "ROS domain 42", "/speech/say"
NOW = 1_800_000_000 * SECOND


def keys(name: str, private: str = "") -> Keys:
    return Keys(name, PRIVATE[private or name], TRUSTED)


def stream(name: str = "robot", private: str = "", *, realm: str = REALM, topic: str = TOPIC, at: int = NOW) -> Stream:
    return Stream(keys(name, private), realm, topic, now=lambda: at)


def opener(topic: str = TOPIC) -> Opener:
    return Opener(keys("workstation"), REALM, topic, Freshness(2.0, joins_late=True, now=lambda: NOW, steady=int))


def reason(text: str, by: Opener | None = None) -> str:
    with pytest.raises(SealError) as caught:
        (by or opener()).open(text)
    assert caught.value.reason in REASONS
    assert caught.value.what.startswith(caught.value.reason)
    return caught.value.reason


@given(st.lists(st.text(st.characters(exclude_categories=["Cs"])), min_size=1, max_size=4))
def test_opening_returns_the_sealed_text(texts):
    sender, receiver = stream(), opener()
    assert [receiver.open(sender.seal(text)) for text in texts] == texts


def test_detects_every_change_of_a_field():
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
def test_detects_every_changed_character(data):
    text = stream().seal('{"text":"left"}')
    place = data.draw(st.integers(0, len(text) - 1))
    character = data.draw(st.characters(exclude_categories=["Cs"]).filter(lambda one: one != text[place]))
    with contextlib.suppress(SealError):
        assert opener().open(text[:place] + character + text[place + 1 :]) == '{"text":"left"}'


def test_a_seal_is_valid_for_one_topic_and_realm():
    assert reason(stream(topic="/speech/other").seal("a")) == "moved"
    assert reason(stream(realm="ROS domain 7").seal("a")) == "forged"


def test_refuses_unknown_keys():
    assert reason(stream("stranger").seal("a")) == "unknown sender"
    assert reason(stream("robot", "stranger").seal("a")) == "forged"


def test_refuses_the_key_of_another_sender():
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
def test_an_invalid_seal_is_unreadable(rest):
    assert reason(f'{{"schema":"{SCHEMA}"{rest}') == "unreadable"


def test_a_text_that_is_too_long_is_not_verified():
    """A stranger can send gigabytes, of which no message may consist."""
    rest = '"number":1,"time":1,"topic":"/say","signature":""}'
    text = f'{{"schema":"{SCHEMA}","sender":"robot","stream":"a","payload":"%s",{rest}'
    assert read(text % (TEXT_BYTES * "a")).sender == "robot"
    assert reason(text % ((TEXT_BYTES + 1) * "a")) == "unreadable"


def test_a_signature_of_wrong_length_is_forged():
    rest = '"sender":"robot","stream":"s","number":1,"time":1,"topic":"/t","payload":"","signature":""'
    assert reason(f'{{"schema":"{SCHEMA}",{rest}}}') == "forged"


def test_accepts_a_message_once():
    sender, receiver = stream(), opener()
    first, second = sender.seal("a"), sender.seal("b")
    assert receiver.open(first) == "a"
    assert reason(first, receiver) == "replayed"
    assert receiver.open(second) == "b"
    assert reason(first, receiver) == "replayed"


def test_refuses_late_and_early_messages():
    assert reason(stream(at=NOW - 3 * SECOND).seal("a")) == "late"
    with pytest.raises(SealError, match=r"3.000 s ahead of our clock\n  remedy: set the clocks") as caught:
        opener().open(stream(at=NOW + 3 * SECOND).seal("a"))
    assert caught.value.reason == "early"


def test_a_renewed_message_is_new_to_late_receivers():
    sender, receiver = stream(), opener()
    first = sender.seal("a")
    again = sender.seal("a", renew=True)
    assert (receiver.open(first), receiver.open(again)) == ("a", None)
    assert opener().open(again) == "a"
    assert reason(again, receiver) == "replayed"


def test_a_refusal_shows_little_of_the_message():
    for text in ("x" * 10**6, stream().seal("a").replace("robot", "r" * 200)):
        with pytest.raises(SealError) as caught:
            opener().open(text)
        assert len(str(caught.value)) < 200


def test_a_stream_stays_ordered_when_the_clock_is_set_back():
    times = iter([NOW, NOW - SECOND, NOW - SECOND])
    sender = Stream(keys("robot"), REALM, TOPIC, now=lambda: next(times))
    receiver = opener()
    assert [receiver.open(sender.seal(text)) for text in "abc"] == ["a", "b", "c"]


def test_a_restarted_receiver_accepts_an_older_sender():
    times = iter([NOW, NOW - 3600 * SECOND])
    sender = Stream(keys("robot"), REALM, TOPIC, now=lambda: next(times))
    sender.seal("a")
    fresh = Freshness(2.0, joins_late=True, now=lambda: NOW - 3600 * SECOND, steady=int)
    assert Opener(keys("workstation"), REALM, TOPIC, fresh).open(sender.seal("b")) == "b"


def test_a_beacon_is_recorded_and_is_no_message():
    sender, receiver = stream(), opener()
    assert receiver.open(sender.beacon()) is None
    assert receiver.open(sender.seal("a")) == "a"
    assert receiver.open(sender.beacon()) is None
    assert receiver.watch.fault(1) == ""
    assert receiver.watch.fault(2) == "1 of 2 publishers are silent"
    sender.seal("lost")
    assert receiver.open(sender.beacon()) is None
    assert receiver.watch.fault(1) == "1 messages did not arrive"


def test_a_forged_or_replayed_beacon_does_not_count():
    sender, late, receiver = stream(), stream(at=NOW - 3 * SECOND), opener()
    text = sender.beacon()
    for broken in (text.replace('"number":0', '"number":1'), text.replace(TOPIC, "/other")):
        with pytest.raises(SealError):
            receiver.open(broken)
    assert receiver.watch.fault(1) == "1 of 1 publishers are silent"
    receiver.open(text)
    receiver.watch.begin_again()
    refused = (text, "replayed"), (text.replace('"number":0', '"number":1'), "forged"), (late.seal("a"), "late")
    for invalid, why in refused:
        with pytest.raises(SealError, match=why):
            receiver.open(invalid)
        receiver.watch.is_copy = True
        assert receiver.open(invalid) is None  # it was refused when it arrived first
        receiver.watch.is_copy = False
    assert receiver.watch.fault(1) == "1 of 1 publishers are silent"
