"""Sign and verify messages: Ed25519 keys, seals, and protection against replayed messages."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from socialbot.bridge.accepted_times import AcceptedTimes
from socialbot.bridge.detached_seals import digest
from socialbot.bridge.keys import WINDOW_S, KeyRing, Keys
from socialbot.bridge.message_tags import Tag, TagKeys
from socialbot.bridge.stream_watch import StreamKey, StreamWatch
from socialbot.core.clock import SECOND
from socialbot.core.decoding import json_decoder
from socialbot.core.errors import MessageError
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.messages import NO_JSON

MAX_STREAMS = 256  # number of streams above which expired ones are removed


FreshnessVerdict = Literal["new", "renewed", "late", "early", "replayed"]
"""Result of a freshness check. "renewed": a known message with a new seal, for late subscribers. "early": a stamp in
the future, because the clocks differ."""


@dataclass
class Freshness:
    """Freshness check: order and age of the messages of one receiver.

    Messages older than the receiver are late: a crashed predecessor may have executed them. Times are system times,
    because simulated time may stand still.

    Attributes:
        window_s: The allowed difference (s) between the time of a message and the clock.
        joins_late: Accept messages older than the receiver, for latched topics.
        now: The wall clock (ns), which may be set at any time.
        steady: A steady clock (ns), for the age of the receiver.
        accepted: Times and numbers of messages that earlier receivers may have accepted.
    """

    window_s: float
    joins_late: bool = False
    now: Callable[[], int] = time.time_ns
    steady: Callable[[], int] = time.monotonic_ns
    accepted: AcceptedTimes | None = None

    def __post_init__(self) -> None:
        self._window = round(self.window_s * SECOND)
        self._begun = self.steady()
        self._last: dict[tuple[str, str], tuple[int, int]] = {}

    @property
    def stream_count(self) -> int:
        return len(self._last)

    def judge(self, sender: str, stream: str, number: int, time: int) -> FreshnessVerdict:
        """Check and remember a message with a valid signature from ``time`` (ns)."""
        now, key = self.now(), (sender, stream)
        last_number, last_time = self._last.get(key) or (self._number_before(sender, stream), 0)
        # Unless a clock was set back, a renewal is newer than the known one.
        is_old = time == last_time or time < last_time <= now
        if number < last_number or (number == last_number and is_old):
            return "replayed"
        if time - now > self._window:
            return "early"
        if now - time > (self._window if self.joins_late else min(self._window, self.steady() - self._begun)):
            return "late"
        if self._was_accepted(sender, time, now):
            return "late"
        if key not in self._last and len(self._last) >= MAX_STREAMS:
            self._last = {known: last for known, last in self._last.items() if now - last[1] <= self._window}
        if self.accepted is not None:
            self.accepted.note(sender, stream, number, time)
        self._last[key] = number, time
        return "renewed" if number == last_number else "new"

    def _number_before(self, sender: str, stream: str) -> int:
        """The number up to which an earlier receiver accepted messages; a late subscriber needs the last one again."""
        return -1 if self.accepted is None else self.accepted.number(sender, stream) - self.joins_late

    def _was_accepted(self, sender: str, time: int, now: int) -> bool:
        """Whether an earlier receiver may have accepted a message from ``time``."""
        if self.joins_late or self.accepted is None:
            return False
        before = self.accepted.before(sender)
        # If the clock was set back since, these times come once more: numbers tell the old messages.
        return time <= before <= now + self._window


SCHEMA = "socialbot/Sealed/1"

STREAM_BYTES = 16
BEACON = "socialbot/Beacon/1"  # text that is no message: its publisher is alive
LONGEST_SHOWN = 40

Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Name = Annotated[str, msgspec.Meta(max_length=256)]
Payload = Annotated[str, msgspec.Meta(max_length=TEXT_BYTES)]  # a longer one is refused before it is verified


class Sealed(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag=SCHEMA, forbid_unknown_fields=True):
    """Sealed text, identified by ``stream`` and ``number``; ``time`` (ns) is the time of the seal."""

    sender: Name
    stream: Name
    number: Count
    time: Count
    topic: Name
    payload: Payload
    signature: bytes

    def signed(self, realm: str) -> bytes:
        """Signed bytes: JSON in one line, a line break, the payload."""
        head = (SCHEMA, realm, self.sender, self.stream, self.number, self.time, self.topic)
        return msgspec.json.encode(head) + b"\n" + self.payload.encode()


REASONS = ("unsealed", "unreadable", "unknown sender", "forged", "moved", "late", "early", "replayed")
"""Refusal reasons.

``unsealed``: plain text. ``unreadable``: no valid seal. ``unknown sender``: unknown key. ``forged``: wrong signature
or realm. ``moved``: sealed for another topic. ``late``, ``early``: outside of the window. ``replayed``: not newer than
the last message of its stream. The last four have a valid signature.
"""

_DECODER = json_decoder(Sealed)
_REMEDIES = {
    "sealed": "set SOCIALBOT_KEYS to a key that its sender trusts, see docs/security.md",
    "unsealed": "give its sender a key: SOCIALBOT_KEYS, see docs/security.md",
    "unknown sender": "copy the sender's .pub into the folder of keys, if you trust it",
    "forged": "the sender is a stranger, or has a new key or another ROS domain: compare with socialbot key list",
    "late": "if all of a machine's messages are late, its clock is wrong or the link too slow",
    "early": "set the clocks of both machines: timedatectl",
}


class SealError(MessageError):
    """Refused message; ``reason`` is one of `REASONS`, or ``sealed`` in a process without keys."""

    def __init__(self, reason: str, what: str) -> None:
        super().__init__(f"{reason}: {what}", remedy=_REMEDIES.get(reason))
        self.reason = reason


@dataclass
class Stream:
    """Seals the messages of one publisher on one ``topic``, in the order of publication."""

    keys: Keys | KeyRing
    realm: str
    topic: str
    now: Callable[[], int] = time.time_ns

    def __post_init__(self) -> None:
        self._id = secrets.token_hex(STREAM_BYTES)
        self._number = self._time = 0
        self._tags = TagKeys(self.realm, self.topic)

    def seal(self, text: str, *, renew: bool = False) -> str:
        """Seal ``text``; with ``renew`` it is the previous text again."""
        self._number += not renew
        return self._sealed(text, self.keys.latest())

    def seal_detached(self, cdr: bytes, *, latched: bool = False) -> tuple[str, str]:
        """Seal a serialised message that is sent apart: the text for `seal` to renew, and its seal.

        That of a ``latched`` one is a digest. Tags serve only the keys of their time, which may change before a late
        subscriber comes.
        """
        self._number += 1
        keys = self.keys.latest()
        text = (None if latched else self._tags.seal(keys, self._id, self._number, cdr)) or digest(cdr)
        return text, self._sealed(text, keys)

    def beacon(self) -> str:
        """Seal `BEACON`, which says that this publisher is alive, and the number of its last message."""
        return self._sealed(BEACON, self.keys.latest())

    def _sealed(self, text: str, keys: Keys) -> str:
        now = self.now()
        # The time distinguishes renewed seals.
        self._time = now if now != self._time else now + 1
        blank = Sealed(
            sender=keys.name,
            stream=self._id,
            number=self._number,
            time=self._time,
            topic=self.topic,
            payload=text,
            signature=b"",
        )
        signature = keys.private.sign(blank.signed(self.realm))
        return msgspec.json.encode(msgspec.structs.replace(blank, signature=signature)).decode()


@dataclass
class Opener:
    """Verifier for the messages of one receiver on one ``topic``.

    Attributes:
        watch: Records the messages and beacons.
        stream: Sender and stream of the last valid message.
        number: Its number in the stream.
        time: The time (ns) of its seal.
        signer: The key of its seal; None before the first message.
    """

    keys: Keys | KeyRing
    realm: str
    topic: str
    freshness: Freshness
    watch: StreamWatch = field(default_factory=StreamWatch)
    stream: StreamKey = field(default=("", ""), init=False)
    number: int = field(default=0, init=False)
    time: int = field(default=0, init=False)
    signer: Ed25519PublicKey | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._tags = TagKeys(self.realm, self.topic)
        self._keys = self.keys.latest()

    @property
    def left_s(self) -> float:
        """Time (s) for which the last valid message stays inside the time window."""
        age_s = (self.freshness.now() - self.time) / SECOND
        return self.freshness.window_s - max(0.0, age_s)

    def open(self, text: str) -> str | None:
        """Return the payload of ``text``; None if it brings no new message. Raises SealError.

        A beacon brings none, nor does a renewed seal of a known message. A message that arrives again because its
        subscription is being replaced is not refused again.
        """
        try:
            return self._open(text)
        except SealError:
            if self.watch.is_copy:
                return None
            raise

    def _open(self, text: str) -> str | None:
        sealed = read(text)
        self._verify(sealed)
        verdict = self.freshness.judge(sealed.sender, sealed.stream, sealed.number, sealed.time)
        if verdict in ("new", "renewed"):
            self.stream, self.number, self.time = (sealed.sender, sealed.stream), sealed.number, sealed.time
            is_beacon = sealed.payload == BEACON
            self.watch.note(self.stream, sealed.number, is_beacon=is_beacon)
            return sealed.payload if verdict == "new" and not is_beacon else None
        raise SealError(verdict, f"from {sealed.sender!r}, sealed {self._age(sealed)}")

    def trusts(self, sender: str, signer: Ed25519PublicKey | None) -> bool:
        """Whether a key still belongs to ``sender``, a while after it has sealed a message."""
        return signer in self.keys.latest().of(sender)

    def tag(self, payload: str) -> Tag:
        """Return the tag for this machine in the ``payload`` of the last valid message.

        Raises:
            SealError: It has none.
        """
        sender, stream = self.stream
        tag = self._tags.read(payload, self._keys, self.signer, stream, self.number) if self.signer else None
        if tag is None:
            raise SealError("unsealed", f"{sender!r} has sealed it for other machines only: copy our .pub to it")
        return tag

    def _verify(self, sealed: Sealed) -> None:
        self._keys = self.keys.latest()
        keys = self._keys.of(sealed.sender)
        if not keys:
            raise SealError("unknown sender", repr(sealed.sender[:LONGEST_SHOWN]))
        self.signer = next((key for key in keys if _is_signed_by(key, sealed, self.realm)), None)
        if self.signer is None:
            raise SealError("forged", f"the seal is not {sealed.sender!r}'s, or it was altered")
        if sealed.topic != self.topic:
            raise SealError("moved", f"from {sealed.sender!r}, sealed for {sealed.topic}")

    def _age(self, sealed: Sealed) -> str:
        seconds = (self.freshness.now() - sealed.time) / SECOND
        return f"{seconds:.3f} s ago" if seconds >= 0 else f"{-seconds:.3f} s ahead of our clock"


def _is_signed_by(key: Ed25519PublicKey, sealed: Sealed, realm: str) -> bool:
    try:
        key.verify(sealed.signature, sealed.signed(realm))
    except (InvalidSignature, UnicodeError):
        return False
    return True


def read(text: str) -> Sealed:
    """Parse a sealed text without verification. Raises SealError."""
    try:
        return _DECODER.decode(text)
    except NO_JSON as error:
        reason = "unreadable" if SCHEMA in text[:LONGEST_SHOWN] else "unsealed"
        raise SealError(reason, str(error)[:LONGEST_SHOWN]) from error


@dataclass(frozen=True)
class Seal:
    """Factory of streams and openers with the keys of a process, valid in one ``realm``."""

    keys: Keys | KeyRing
    realm: str
    window_s: float = WINDOW_S
    accepted: AcceptedTimes | None = None

    def stream(self, topic: str) -> Stream:
        return Stream(self.keys, self.realm, topic)

    def opener(self, topic: str, *, joins_late: bool = False) -> Opener:
        """Opener of one subscription; ``joins_late`` for a latched topic."""
        return Opener(self.keys, self.realm, topic, Freshness(self.window_s, joins_late, accepted=self.accepted))
