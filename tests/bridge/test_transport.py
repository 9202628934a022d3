from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from socialbot.bags.codec import STRING, encode
from socialbot.bags.types import PACKAGE, RosbagsTypes, field_types, own_types, type_name
from socialbot.bridge import ros_checks, transport
from socialbot.bridge.detached_seals import padded
from socialbot.bridge.environment import KEYS_VARIABLE, has_keys, reach, warn_if_open
from socialbot.bridge.keys import SecurityError, load_keys, new_key
from socialbot.bridge.security import SCHEMA, Seal, SealError
from socialbot.bridge.stream_watch import BEACON_S
from socialbot.bridge.transport import WINDOW_VARIABLE, Transport, open_transport, refusal_reason, split_keys
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.installation import interfaces_command
from socialbot.core.messages import CompressedImage, HeadCommand, Image, Message, PointCloud, Utterance

TOPIC = "/speech/say"
WORD = Utterance(stamp=7, id="u1", text="Good morning")


class Types:
    """Makes messages that are plain namespaces."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        return SimpleNamespace(**fields)

    def owns(self, ros_message: Any) -> bool:
        return isinstance(ros_message, SimpleNamespace)


class Publisher:
    """Record the published messages."""

    def __init__(self, topic_name: str = TOPIC) -> None:
        self.topic_name = topic_name
        self.sent: list[Any] = []

    def publish(self, ros_message: Any) -> None:
        self.sent.append(ros_message)


@pytest.fixture
def keys(tmp_path):
    new_key("robot", tmp_path / "keys")
    return tmp_path / "keys"


@pytest.fixture
def sealed(keys) -> Transport:
    return Transport(Types(), Seal(load_keys(keys), realm="here"))


_PIXELS = np.arange(7, dtype=np.uint8)


@pytest.mark.parametrize(
    "message",
    [
        Image.from_bgr(np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3), stamp=7, frame_id="camera"),
        CompressedImage(stamp=7, frame_id="camera_1", format="jpeg", data=_PIXELS),
        CompressedImage(stamp=7, frame_id="", format="png", data=_PIXELS[:0]),
        CompressedImage(stamp=7, frame_id="camera", format="png", data=_PIXELS[::2]),
        PointCloud(
            stamp=7,
            frame_id="",
            height=1,
            width=7,
            fields=(),
            is_bigendian=False,
            point_step=1,
            row_step=7,
            data=_PIXELS,
        ),
    ],
)
def test_large_messages_with_keys_are_serialised_as_by_rosbags(sealed: Transport, message: Message):
    publisher = Publisher()
    sealed.sender(publisher, standard=True, seals=Publisher()).publish(message)
    types = RosbagsTypes()
    assert publisher.sent == [padded(types.serialize(encode(message, types)))]


def test_data_of_another_type_is_refused(sealed: Transport):
    wide = CompressedImage(stamp=7, frame_id="camera", format="png", data=np.arange(7.0))
    with pytest.raises(MessageError):
        sealed.sender(Publisher(), standard=True, seals=Publisher()).publish(wide)


def test_messages_are_plain_without_keys():
    bare, publisher = Transport(Types()), Publisher()
    sender = bare.sender(publisher, latched=True)
    sender.publish(WORD)
    bare.renew()
    assert [one.data for one in publisher.sent] == [encode(WORD, Types()).data]
    assert bare.receiver(TOPIC).decode(Utterance, publisher.sent[0]) == WORD
    assert (bare.sealed, bare.renewal_s) == (False, math.inf)


def test_structured_messages_are_sealed_with_keys(sealed):
    publisher = Publisher()
    sealed.sender(publisher).publish(WORD)
    assert publisher.sent[0].data.startswith(f'{{"schema":"{SCHEMA}","sender":"robot"')
    receiver = sealed.receiver(TOPIC, latched=True)
    assert receiver.decode(Utterance, publisher.sent[0]) == WORD
    with pytest.raises(SealError) as caught:
        receiver.decode(Utterance, publisher.sent[0])
    assert refusal_reason(caught.value) == "replayed"


def test_refuses_unsealed_messages_with_keys(sealed):
    for text in (encode(WORD, Types()).data, "Hello"):
        with pytest.raises(SealError) as caught:
            sealed.receiver(TOPIC).decode(Utterance, SimpleNamespace(data=text))
        assert refusal_reason(caught.value) == "unsealed"
    with pytest.raises(MessageError, match="holds no text") as none:
        sealed.receiver(TOPIC).decode(Utterance, SimpleNamespace(data=3))
    assert refusal_reason(none.value) == "unfit"


def test_recognises_sealed_messages_without_keys(sealed):
    publisher = Publisher()
    sealed.sender(publisher).publish(WORD)
    with pytest.raises(SealError, match="set SOCIALBOT_KEYS") as caught:
        Transport(Types()).receiver(TOPIC).decode(Utterance, publisher.sent[0])
    assert refusal_reason(caught.value) == "sealed"


def test_a_seal_is_bound_to_its_topic(sealed):
    publisher = Publisher("/head/command")
    sealed.sender(publisher).publish(HeadCommand(stamp=1, mode="centre"))
    with pytest.raises(SealError, match="moved: from 'robot', sealed for /head/command"):
        sealed.receiver("/other/command", latched=True).decode(HeadCommand, publisher.sent[0])


def test_a_valid_seal_does_not_make_content_valid(sealed):
    publisher = Publisher()
    sealed.sender(publisher).publish(WORD)
    with pytest.raises(MessageError, match="does not fit socialbot/HeadCommand/1") as caught:
        sealed.receiver(TOPIC, latched=True).decode(HeadCommand, publisher.sent[0])
    assert refusal_reason(caught.value) == "unfit"


def test_each_subscription_accepts_a_message(sealed):
    publisher = Publisher()
    sealed.sender(publisher).publish(WORD)
    for _ in range(2):
        assert sealed.receiver(TOPIC, latched=True).decode(Utterance, publisher.sent[0]) == WORD


def test_renews_only_latched_messages(sealed):
    latched, other = Publisher(), Publisher()
    sender, volatile = sealed.sender(latched, latched=True), sealed.sender(other)
    sender.publish(WORD)
    volatile.publish(WORD)
    sealed.renew()
    assert (len(latched.sent), len(other.sent)) == (2, 1)
    receiver = sealed.receiver(TOPIC, latched=True)
    assert [receiver.decode(Utterance, one) for one in latched.sent] == [WORD, None]
    assert sealed.receiver(TOPIC, latched=True).decode(Utterance, latched.sent[1]) == WORD


def test_idle_senders_publish_beacons_that_are_no_messages(sealed):
    publisher, now = Publisher(), [100.0]
    sender = sealed.sender(publisher)
    sender.clock = lambda: now[0]
    receiver = sealed.receiver(TOPIC)
    sealed.renew()  # nothing was published yet
    sender.publish(WORD)
    sealed.renew()  # too early
    now[0] += BEACON_S
    sealed.renew()
    assert [receiver.decode(Utterance, one) for one in publisher.sent] == [None, WORD, None]
    assert sender.sent == 1
    sender.destroy(SimpleNamespace(destroy_publisher=lambda publisher: None))
    now[0] += BEACON_S
    sealed.renew()
    assert len(publisher.sent) == 3


def test_messages_without_keys_have_no_beacons():
    bare, publisher = Transport(Types()), Publisher()
    sender = bare.sender(publisher)
    bare.renew()
    assert (publisher.sent, sender.sent) == ([], 0)


def test_seals_strings_from_a_bag(sealed):
    publisher = Publisher()
    for text in ('{"any": "json"}', "plain text"):
        sealed.sender(publisher).forward(Types().make(STRING, data=text))
        assert sealed.receiver(TOPIC, latched=True).open(publisher.sent[-1]).data == text


class TestEnvironment:
    def test_selects_the_keys(self, keys):
        assert not open_transport({}).sealed
        assert open_transport({KEYS_VARIABLE: str(keys)}).sealed
        assert open_transport({KEYS_VARIABLE: f"{keys}:robot", WINDOW_VARIABLE: "1.0"}).renewal_s == 0.5
        assert open_transport({KEYS_VARIABLE: str(keys), WINDOW_VARIABLE: "60.0"}).renewal_s == BEACON_S

    def test_refuses_unusable_keys(self, keys):
        for value in ("", f"{keys}:other", str(keys / "none")):
            assert has_keys({KEYS_VARIABLE: value})
            with pytest.raises(SecurityError):
                open_transport({KEYS_VARIABLE: value})

    @pytest.mark.parametrize("window", ["0", "nan", "-1", "1e9", "two"])
    def test_refuses_an_invalid_window(self, keys, window):
        with pytest.raises(ParameterError, match="valid window"):
            open_transport({KEYS_VARIABLE: str(keys), WINDOW_VARIABLE: window})

    def test_refuses_messages_of_another_domain(self, keys):
        publisher = Publisher()
        sender, other, same = (
            open_transport({KEYS_VARIABLE: str(keys), "ROS_DOMAIN_ID": domain}) for domain in ("42", "43", "042")
        )
        sender.sender(publisher).publish(WORD)
        assert same.receiver(TOPIC, latched=True).decode(Utterance, publisher.sent[0]) == WORD
        with pytest.raises(SealError, match="forged"):
            other.receiver(TOPIC, latched=True).decode(Utterance, publisher.sent[0])

    @pytest.mark.parametrize(
        ("text", "parts"),
        [
            ("keys", ("keys", "")),
            ("/a/keys:robot", ("/a/keys", "robot")),
            ("/a:b/keys", ("/a:b/keys", "")),
            ("", ("", "")),
        ],
    )
    def test_splits_folder_and_name(self, text, parts):
        assert split_keys(text) == parts

    @pytest.mark.parametrize(
        ("variables", "way"),
        [
            ({}, ""),
            ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, ""),
            ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_STATIC_PEERS": ""}, ""),
            ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"),
            ({"ROS_STATIC_PEERS": "10.0.0.2"}, "ROS_STATIC_PEERS"),
            ({"ROS_DISCOVERY_SERVER": "10.0.0.2:11811"}, "ROS_DISCOVERY_SERVER"),
        ],
    )
    def test_warns_of_an_open_graph_without_keys(self, variables, way, keys, caplog):
        caplog.set_level(logging.WARNING)
        assert reach(variables) == way
        warn_if_open(variables)
        assert [way in record.getMessage() for record in caplog.records] == ([True] if way else [])
        assert ros_checks.strangers(variables).state == ("warning" if way else "ok")
        caplog.clear()
        warn_if_open(variables | {KEYS_VARIABLE: str(keys)})
        assert not caplog.records
        finding = ros_checks.strangers(variables | {KEYS_VARIABLE: str(keys)})
        assert finding.state == "ok"
        assert ("DDS needs a firewall" in finding.text) == bool(way)

    def test_doctor_finds_unusable_keys(self, keys):
        (keys / "robot.key").chmod(0o644)
        finding = ros_checks.strangers({KEYS_VARIABLE: str(keys)})
        assert (finding.state, "chmod 600" in finding.remedy) == ("error", True)


class TestMessageClass:
    """Names of types come from the network and from bags."""

    @pytest.mark.parametrize("name", ["trap/msg/Note", "trap_package/msg/Note", "trap_package.deep/msg/Note"])
    def test_imports_no_package_without_ros_types(self, name, tmp_path, monkeypatch):
        (tmp_path / "trap_package" / "deep" / "msg").mkdir(parents=True)
        for file in ("trap.py", "trap_package/__init__.py", "trap_package/deep/__init__.py"):
            (tmp_path / file).write_text("from pathlib import Path\nPath(__file__).with_suffix('.imported').touch()\n")
        (tmp_path / "trap_package" / "deep" / "msg" / "__init__.py").touch()
        monkeypatch.syspath_prepend(tmp_path)
        with pytest.raises(InstallationError):
            transport.message_class(name)
        assert list(tmp_path.rglob("*.imported")) == []

    @pytest.mark.parametrize(
        "name", ["", "/", "std_msgs", "std_msgs/String", "std_msgs/msg/../String", "a/b/\n", "/m/S"]
    )
    def test_refuses_what_is_no_name_of_a_type(self, name):
        with pytest.raises(InstallationError, match="not a name of a type"):
            transport.message_class(name)

    @pytest.mark.ros
    def test_finds_installed_types(self):
        assert transport.message_class("std_msgs/msg/String")().data == ""
        with pytest.raises(InstallationError):
            transport.message_class("std_msgs/msg/Strings")


def test_renewals_of_another_thread_keep_the_order(sealed):
    publisher = Publisher()
    sender = sealed.sender(publisher, latched=True)
    with ThreadPoolExecutor(2) as threads:
        renewing = threads.submit(lambda: [sealed.renew() for _ in range(100)])
        telling = threads.submit(lambda: [sender.publish(WORD) for _ in range(100)])
        renewing.result()
        telling.result()
    receiver = sealed.receiver(TOPIC, latched=True)
    assert [receiver.decode(Utterance, one) for one in publisher.sent].count(WORD) == 100  # and none is refused


def _installed(changes: dict[str, dict[str, str]]) -> Callable[[str], Any]:
    """The lookup of generated classes in a package in which the fields of some types differ."""

    def lookup(type_name: str) -> Any:
        fields = changes.get(type_name, field_types(own_types()[type_name]))
        return SimpleNamespace(get_fields_and_field_types=lambda: fields)

    return lookup


@pytest.mark.parametrize("change", ["missing", "additional", "other type"])
def test_typed_transport_needs_the_own_types_of_this_version(monkeypatch, change):
    name = type_name(Utterance)
    fields = dict(field_types(Utterance))
    if change == "missing":
        del fields["text"]
    else:
        fields["old" if change == "additional" else "text"] = "int64"
    monkeypatch.setattr(transport, "message_class", _installed({name: fields}))
    with pytest.raises(InstallationError, match="another version") as caught:
        open_transport({}, form="typed")
    assert "socialbot_msgs" in str(caught.value)
    assert name in str(caught.value)
    assert interfaces_command(PACKAGE) in str(caught.value.remedy)


def test_typed_transport_opens_with_the_own_types_of_this_version(monkeypatch):
    monkeypatch.setattr(transport, "message_class", _installed({}))
    assert not open_transport({}, form="typed").sealed
