"""Tags of large messages of standard types, each for one machine."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from socialbot.bridge.detached_seals import DIGEST, SealMatcher, digest
from socialbot.bridge.keys import Keys, begin_rotation, finish_rotation, load_keys, new_key
from socialbot.bridge.message_tags import LEAST_BYTES, MOST_MACHINES, Tags, _agreed
from socialbot.bridge.security import Seal, Stream, read

TOPIC, REALM = "/camera/image_raw", "ROS domain 42"

PICTURE = bytes(range(256)) * (LEAST_BYTES // 256)
ALTERED = PICTURE[:-1] + b"\0"
"""A picture of the same beginning."""


class Machine:
    """A machine with keys in a folder of its own, and the messages that its matcher delivers and refuses."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder / name
        new_key(name, self.folder)
        self.got: list[bytes] = []
        self.refused: list[str] = []

    @property
    def keys(self) -> Keys:
        return load_keys(self.folder, self.name)

    def trust(self, *others: Machine) -> None:
        for other in others:
            for public in other.folder.glob(f"{other.name}*.pub"):
                (self.folder / public.name).write_bytes(public.read_bytes())

    def stream(self) -> Stream:
        return Seal(self.keys, REALM).stream(TOPIC)

    def matcher(self, topic: str = TOPIC) -> SealMatcher:
        def refuse(error: Exception) -> None:
            self.refused.append(getattr(error, "reason", "unfit"))

        # One that joins late takes the seals of before, too.
        opener = Seal(self.keys, REALM).opener(topic, joins_late=True)
        return SealMatcher(opener, lambda cdr, _: self.got.append(cdr), refuse)


@pytest.fixture
def machines(tmp_path: Path) -> tuple[Machine, Machine, Machine]:
    robot, workstation, second = (Machine(name, tmp_path) for name in ("robot", "workstation", "second"))
    robot.trust(workstation, second)
    workstation.trust(robot, second)
    second.trust(robot, workstation)
    return robot, workstation, second


def tags(text: str) -> Tags:
    return msgspec.json.decode(read(text).payload, type=Tags)


def test_each_machine_takes_a_large_message_with_the_tag_for_it(machines):
    robot = machines[0]
    _, seal = robot.stream().seal_detached(PICTURE)
    for machine in machines:
        matcher = machine.matcher()
        matcher.take_seal(seal)
        matcher.take_message(PICTURE)
        matcher.take_message(PICTURE)
        matcher.close()
        assert (machine.got, machine.refused) == ([PICTURE], ["unsealed"]), machine.name


@pytest.mark.parametrize("seal_first", [True, False])
def test_an_altered_message_is_refused_and_the_true_one_delivered(machines, seal_first):
    robot, workstation, _ = machines
    _, seal = robot.stream().seal_detached(PICTURE)
    matcher = workstation.matcher()
    if seal_first:
        matcher.take_seal(seal)
    matcher.take_message(ALTERED)
    matcher.take_message(PICTURE)
    matcher.take_message(PICTURE + bytes(4))
    if not seal_first:
        matcher.take_seal(seal)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([PICTURE], ["unsealed", "unsealed"])


@pytest.mark.parametrize("of", ["waiting", "delivered"])
def test_an_altered_message_stands_for_no_copy_while_subscriptions_overlap(machines, of):
    robot, workstation, _ = machines
    matcher, stream = workstation.matcher(), robot.stream()
    for watch in (matcher.watch, matcher.opener.watch):
        watch.is_copy = True
    if of == "waiting":
        matcher.take_message(ALTERED)
        matcher.take_message(PICTURE)
        matcher.take_seal(stream.seal_detached(PICTURE)[1])
    else:
        matcher.take_seal(stream.seal_detached(ALTERED)[1])
        matcher.take_message(ALTERED)
        matcher.take_message(PICTURE)
        matcher.take_seal(stream.seal_detached(PICTURE)[1])
    assert workstation.got[-1] == PICTURE


def test_a_copy_is_dropped_while_subscriptions_overlap(machines):
    robot, workstation, _ = machines
    matcher = workstation.matcher()
    _, seal = robot.stream().seal_detached(PICTURE)
    for is_copy in (False, True):
        for watch in (matcher.watch, matcher.opener.watch):
            watch.is_copy = is_copy
        matcher.take_seal(seal)
        matcher.take_message(PICTURE)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([PICTURE], [])


def test_the_tag_of_one_machine_tells_nothing_of_those_of_others(machines):
    """No machine can alter a message of another one for a third."""
    robot = machines[0]
    found = tags(robot.stream().seal_detached(PICTURE)[1]).tags
    assert len(set(found.values())) == len(found) == 3


def test_no_number_of_a_stream_is_used_twice_and_each_stream_has_keys_of_its_own(machines):
    """A tag tells the key if another message has the same number under it."""
    streams = [machines[0].stream() for _ in range(2)]
    seals = [stream.seal_detached(PICTURE)[1] for stream in (*streams, *streams)]
    assert len({(read(seal).stream, read(seal).number) for seal in seals}) == 4
    found = [value for seal in seals for value in tags(seal).tags.values()]
    assert len(set(found)) == len(found)


@pytest.mark.parametrize("change", ["none", "sender", "receiver", "new receiver"])
def test_a_late_subscriber_gets_a_latched_large_message_after_a_change_of_keys(machines, tmp_path, change):
    robot, workstation, _ = machines
    stream = robot.stream()
    text, _ = stream.seal_detached(PICTURE, latched=True)
    if change in ("sender", "receiver"):
        owner, other = (robot, workstation) if change == "sender" else (workstation, robot)
        begin_rotation(owner.name, owner.folder)
        finish_rotation(owner.name, owner.folder, pause=lambda _: None)
        other.trust(owner)
    elif change == "new receiver":
        workstation = Machine("fourth", tmp_path)
        workstation.trust(robot)
        robot.trust(workstation)
    stream.keys = robot.keys
    late = workstation.matcher()
    late.take_message(PICTURE)
    late.take_seal(stream.seal(text, renew=True))
    assert (workstation.got, workstation.refused) == ([PICTURE], [])


def test_a_machine_that_the_sender_does_not_trust_is_told(machines):
    robot, workstation, _ = machines
    (robot.folder / "workstation.pub").unlink()
    matcher = workstation.matcher()
    matcher.take_seal(robot.stream().seal_detached(PICTURE)[1])
    matcher.take_message(PICTURE)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([], ["unsealed", "unsealed"])


def test_a_seal_of_a_machine_that_the_receiver_does_not_trust_is_refused(machines):
    robot, workstation, _ = machines
    (workstation.folder / "robot.pub").unlink()
    matcher = workstation.matcher()
    matcher.take_seal(robot.stream().seal_detached(PICTURE)[1])
    matcher.take_message(PICTURE)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([], ["unknown sender", "unsealed"])


def test_tags_of_another_topic_are_refused(machines):
    robot, workstation, _ = machines
    matcher = workstation.matcher("/other")
    matcher.take_seal(robot.stream().seal_detached(PICTURE)[1])
    matcher.take_message(PICTURE)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([], ["moved", "unsealed"])


def test_a_small_message_and_one_for_many_machines_has_a_digest(machines, tmp_path):
    robot = machines[0]
    assert read(robot.stream().seal_detached(PICTURE[:-1])[1]).payload == digest(PICTURE[:-1])
    robot.trust(*(Machine(f"m{number}", tmp_path) for number in range(MOST_MACHINES - 2)))
    assert DIGEST.fullmatch(read(robot.stream().seal_detached(PICTURE)[1]).payload)


def test_a_digest_serves_for_a_large_message(machines):
    robot, workstation, _ = machines
    matcher, stream = workstation.matcher(), robot.stream()
    matcher.take_seal(stream.seal(digest(PICTURE)))
    matcher.take_message(ALTERED)
    matcher.take_message(PICTURE)
    matcher.close()
    assert (workstation.got, workstation.refused) == ([PICTURE], ["unsealed"])


@pytest.mark.parametrize("payload", ["", "null", '{"schema":"socialbot/Tags/2"}', digest(b"")[:-1]])
def test_a_sealed_text_that_is_neither_digest_nor_tags_is_refused(machines, payload):
    robot, workstation, _ = machines
    workstation.matcher().take_seal(robot.stream().seal(payload))
    assert workstation.refused == ["unsealed"]


@pytest.mark.parametrize("rotating", ["robot", "workstation"])
def test_no_large_message_is_refused_in_a_rotation(machines, rotating):
    robot, workstation, _ = machines
    owner, other = (robot, workstation) if rotating == "robot" else (workstation, robot)

    def send() -> None:
        matcher = workstation.matcher()
        matcher.take_seal(robot.stream().seal_detached(PICTURE)[1])
        matcher.take_message(PICTURE)

    begin_rotation(rotating, owner.folder)
    send()
    other.trust(owner)
    send()
    finish_rotation(rotating, owner.folder, pause=lambda _: send())
    send()
    other.trust(owner)
    (other.folder / f"{rotating}.next.pub").unlink()
    send()
    assert (len(workstation.got), workstation.refused) == (6, [])


@pytest.mark.parametrize("point", [1, 0, 2**255 - 20], ids=["neutral", "order 4", "order 2"])
def test_a_public_key_that_is_no_usable_point_stops_nobody(machines, point):
    robot = machines[0]
    weak = Ed25519PublicKey.from_public_bytes(point.to_bytes(32, "little"))
    assert _agreed(robot.keys.private, weak.public_bytes_raw()) == b""
    keys = Keys("robot", robot.keys.private, {**robot.keys.trusted, "weak": weak})
    assert len(tags(Seal(keys, REALM).stream(TOPIC).seal_detached(PICTURE)[1]).tags) == 3


def test_two_machines_agree():
    """The public keys of X25519 that follow from those of Ed25519 are those of the private ones."""
    for _ in range(20):
        one, other = Ed25519PrivateKey.generate(), Ed25519PrivateKey.generate()
        secrets = {
            _agreed(private, public.public_key().public_bytes_raw()) for private, public in ((one, other), (other, one))
        }
        (secret,) = secrets
        assert len(secret) == 32
