"""A sealed text: who says it, on which topic and when, signed with the sender's key (Ed25519).

What is signed begins with the schema and with the realm, such as a ROS domain, so that nothing signed for one purpose
or place can be used for another.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from typing import Annotated

import msgspec
from cryptography.exceptions import InvalidSignature

from socialbot.clock import SECOND
from socialbot.errors import MessageError
from socialbot.security.freshness import Freshness, Verdict
from socialbot.security.keys import Keys

SCHEMA = "socialbot/Sealed/1"

WINDOW_S = 5.0
"""How far (s) the time of a message may be from the receiver's: what the clocks differ, and how long it travels.

A message whose last packet was lost is sent again after three seconds by Fast DDS.
"""

STREAM_BYTES = 8
LONGEST_SHOWN = 40

Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Name = Annotated[str, msgspec.Meta(max_length=256)]


class Sealed(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag=SCHEMA, forbid_unknown_fields=True):
    """A text with its seal. ``stream`` and ``number`` are its id; ``time`` (ns) is when it was sealed."""

    sender: Name
    stream: Name
    number: Count
    time: Count
    topic: Name
    payload: str
    signature: bytes

    def signed(self, realm: str) -> bytes:
        """The bytes that the signature is for: JSON without a line break, a line break, the payload."""
        head = (SCHEMA, realm, self.sender, self.stream, self.number, self.time, self.topic)
        return msgspec.json.encode(head) + b"\n" + self.payload.encode()


REASONS = ("unsealed", "unreadable", "unknown sender", "forged", "moved", "late", "early", "replayed")
"""Why a message is refused.

``unsealed``: plain text. ``unreadable``: no valid seal at all. ``unknown sender``: without a key here. ``forged``: not
signed by whom it names, or altered since, or from another realm. ``moved``: for another topic. ``late``, ``early``:
outside of the window. ``replayed``: not newer than what that publisher has said already. The last four are told of
messages only whose signature is right.
"""

_DECODER = msgspec.json.Decoder(Sealed)
_REMEDIES = {
    "sealed": "set SOCIALBOT_KEYS to a key that its sender trusts, see docs/security.md",
    "unsealed": "give its sender a key: SOCIALBOT_KEYS, see docs/security.md",
    "unknown sender": "copy the sender's .pub into the folder of keys, if you trust it",
    "forged": "somebody may be pretending; or the sender has a new key or another ROS domain: socialbot key list",
    "late": "if all of a machine's messages are late, its clock is wrong or the link too slow",
    "early": "set the clocks of both machines: timedatectl",
}


class SealError(MessageError):
    """A message that is not to be believed; ``reason`` is one of `REASONS`, or ``sealed`` to who has no keys."""

    def __init__(self, reason: str, what: str) -> None:
        super().__init__(f"{reason}: {what}", remedy=_REMEDIES.get(reason))
        self.reason = reason


class Stream:
    """Seals what one publisher says on one ``topic``; what is sealed first has to be sent first."""

    def __init__(self, keys: Keys, realm: str, topic: str, *, wall: Callable[[], int] = time.time_ns) -> None:
        self._keys = keys
        self._realm = realm
        self._topic = topic
        self._wall = wall
        self._id = secrets.token_hex(STREAM_BYTES)
        self._number = 0
        self._time = 0

    def seal(self, text: str, *, anew: bool = False) -> str:
        """``text`` sealed; ``anew`` when it is the same as the last time, only sealed later."""
        self._number += not anew
        now = self._wall()
        # What is sealed anew is known by its time.
        self._time = now if now != self._time else now + 1
        blank = Sealed(
            sender=self._keys.name,
            stream=self._id,
            number=self._number,
            time=self._time,
            topic=self._topic,
            payload=text,
            signature=b"",
        )
        signature = self._keys.private.sign(blank.signed(self._realm))
        return msgspec.json.encode(msgspec.structs.replace(blank, signature=signature)).decode()


class Opener:
    """Opens what comes on one ``topic`` to one receiver; what cannot be believed it refuses."""

    def __init__(self, keys: Keys, realm: str, topic: str, freshness: Freshness) -> None:
        self._keys = keys
        self._realm = realm
        self._topic = topic
        self._freshness = freshness

    def open(self, text: str) -> str | None:
        """The payload of ``text``; None when it was only sealed anew since. Raises SealError."""
        sealed = read(text)
        self._verify(sealed)
        verdict = self._freshness.judge(sealed.sender, sealed.stream, sealed.number, sealed.time)
        if verdict is Verdict.NEW:
            return sealed.payload
        if verdict is Verdict.RENEWED:
            return None
        raise SealError(verdict.value, f"from {sealed.sender!r}, sealed {self._age(sealed)}")

    def _verify(self, sealed: Sealed) -> None:
        key = self._keys.trusted.get(sealed.sender)
        if key is None:
            raise SealError("unknown sender", repr(sealed.sender[:LONGEST_SHOWN]))
        try:
            key.verify(sealed.signature, sealed.signed(self._realm))
        except (InvalidSignature, UnicodeError) as error:
            raise SealError("forged", f"the seal is not {sealed.sender!r}'s, or it was altered") from error
        if sealed.topic != self._topic:
            raise SealError("moved", f"from {sealed.sender!r}, sealed for {sealed.topic}")

    def _age(self, sealed: Sealed) -> str:
        seconds = (self._freshness.now() - sealed.time) / SECOND
        return f"{seconds:.3f} s ago" if seconds >= 0 else f"{-seconds:.3f} s ahead of our clock"


def read(text: str) -> Sealed:
    """The seal that ``text`` is, not yet verified. Raises SealError."""
    try:
        return _DECODER.decode(text)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        reason = "unreadable" if SCHEMA in text[:LONGEST_SHOWN] else "unsealed"
        raise SealError(reason, str(error)[:LONGEST_SHOWN]) from error


class Seal:
    """What a process needs to seal and open: its keys, and where they count (``realm``)."""

    def __init__(self, keys: Keys, *, realm: str, window_s: float = WINDOW_S) -> None:
        self.window_s = window_s
        self._keys = keys
        self._realm = realm

    def stream(self, topic: str) -> Stream:
        """For one publisher on ``topic``."""
        return Stream(self._keys, self._realm, topic)

    def opener(self, topic: str, *, joins_late: bool = False) -> Opener:
        """For one subscription to ``topic``; ``joins_late`` where it hears the last state of a latched topic."""
        return Opener(self._keys, self._realm, topic, Freshness(self.window_s, joins_late=joins_late))
