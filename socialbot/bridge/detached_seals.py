"""Seals of messages of standard ROS types, on a topic of their own.

An image, a transform or a time of ``/clock`` has no field for a signature. Its publisher sends a sealed digest of the
serialised message on ``TOPIC/_seal`` first, or sealed tags of a large one. Tools without keys read the message as
usual. A receiver with keys passes a message on when it has both, and refuses it otherwise.
"""

from __future__ import annotations

import functools
import hashlib
import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from socialbot.bridge.stream_watch import LOST_S, MAX_STREAMS, StreamKey
from socialbot.core.errors import MessageError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    from socialbot.bridge.message_tags import Tag
    from socialbot.bridge.security import Opener

SEAL_SUFFIX = "/_seal"

MAX_SEALS = 256  # seals that wait for their message; best-effort messages may be lost
MAX_WAITING = 64  # messages that wait for their seal
MAX_WAITING_BYTES = 64 * 2**20
MISSING_S = 1.0  # time after which the message of a seal is missing
LOST_MESSAGES = 5  # successive messages after which their publisher may be lost
LOST_MATCHED_S = 60.0  # time for which those of a matched publisher must be missing: a bad link may lose images alone
WORD_BYTES = 4
HEAD_BYTES = 1024
DIGEST = re.compile("[0-9a-f]{64}")


def seal_topic(topic: str) -> str:
    """Topic of the seals of messages on the fully qualified ``topic``."""
    return topic + SEAL_SUFFIX


def digest(cdr: bytes) -> str:
    """Return the SHA-256 digest of a serialised message, whose last word is filled up with zeros."""
    return hashlib.sha256(padded(cdr)).hexdigest()


def head(cdr: bytes) -> str:
    """Size of a serialised message, and digest of its beginning: a cheap way to find its seal."""
    return f"{len(cdr)}:{hashlib.sha256(cdr[:HEAD_BYTES]).hexdigest()}"


def padded(cdr: bytes) -> bytes:
    """Fill up the last word of a serialised message with zeros, as DDS does on the way."""
    return cdr + bytes(-len(cdr) % WORD_BYTES)


@dataclass(eq=False)
class MessageWatch:
    """Watch over the messages of a subscription, each of which has a seal on another topic.

    Attributes:
        clock: Steady clock (s).
    """

    clock: Callable[[], float] = time.monotonic
    is_copy: bool = field(default=False, init=False)
    _missed_at: dict[StreamKey, float] = field(default_factory=dict, init=False)
    """Time of the first seal of a stream that came without a message."""
    _missed: dict[StreamKey, tuple[float, float, int]] = field(default_factory=dict, init=False)
    """First and last time of such seals since the last message of a stream, and their number."""

    def expect(self, stream: StreamKey) -> None:
        """Record a seal whose message has not arrived."""
        now = self.clock()
        self._missed_at.setdefault(stream, now)
        first, _, count = self._missed.pop(stream, (now, now, 0))
        self._missed[stream] = first, now, count + 1
        if len(self._missed) > MAX_STREAMS:
            del self._missed[next(iter(self._missed))]

    def note(self, stream: StreamKey) -> None:
        """Record a message with its seal."""
        self._missed_at.pop(stream, None)
        self._missed.pop(stream, None)

    @property
    def is_sure(self) -> bool:
        return True  # each seal is valid

    def fault(self, publishers: int) -> str:
        missed = sum(self.clock() - at > MISSING_S for at in self._missed_at.values())
        return f"messages of {missed} publishers do not arrive, but their seals do" if missed else ""

    def lost(self, publishers: int, wanted: int) -> int:
        least_s, now = LOST_S if publishers < wanted else LOST_MATCHED_S, self.clock()
        return sum(
            last - first >= least_s and count >= LOST_MESSAGES and now - last < LOST_S
            for first, last, count in self._missed.values()
        )

    def begin_again(self) -> None:
        self._missed_at.clear()


class _Message:
    """Serialised message, its information from rclpy and its time of arrival (s)."""

    def __init__(self, cdr: bytes, info: Any, at: float) -> None:
        self.cdr, self.info, self.at = cdr, info, at
        self._padded = padded(cdr)

    @functools.cached_property
    def digest(self) -> str:
        return digest(self._padded)

    @functools.cached_property
    def head(self) -> str:
        return head(self._padded)

    def has(self, tag: Tag) -> bool:
        return self.head == tag.head and tag.fits(self._padded)


@dataclass(frozen=True)
class _WaitingSeal:
    """Seal of the ``number``th message of a ``stream`` with a key, by its digest or a tag, valid until ``end`` (s)."""

    end: float
    proof: str | Tag
    stream: StreamKey
    number: int
    signer: Ed25519PublicKey | None

    def fits(self, message: _Message) -> bool:
        return message.digest == self.proof if isinstance(self.proof, str) else message.has(self.proof)


@dataclass(eq=False)
class SealMatcher:
    """Match of messages with their seals, for one subscription. Not thread-safe.

    Messages wait for their seals as long as the time window of the keys, and seals for their messages until they are
    too old. A message of a stream is refused after a later one: DDS keeps the order, so a stranger has withheld it.

    Attributes:
        opener: Verifies the seals.
        deliver: Gets each sealed message once, and its information from rclpy.
        refuse: Gets the reason for each invalid seal, and for each message without one.
        clock: Steady clock (s).
    """

    opener: Opener
    deliver: Callable[[bytes, Any], None]
    refuse: Callable[[MessageError], None]
    clock: Callable[[], float] = time.monotonic
    watch: MessageWatch = field(init=False)
    _seals: deque[_WaitingSeal] = field(default_factory=deque, init=False)
    _waiting: deque[_Message] = field(default_factory=deque, init=False)
    _bytes: int = field(default=0, init=False)
    _delivered: deque[_WaitingSeal] = field(default_factory=lambda: deque(maxlen=MAX_SEALS), init=False)

    def __post_init__(self) -> None:
        self.watch = MessageWatch(self.clock)

    def take_message(self, cdr: bytes, info: Any = None) -> None:
        """Deliver a serialised message if its seal has arrived; otherwise keep it."""
        self.expire()
        message = _Message(cdr, info, self.clock())
        for seal in self._seals:
            if seal.fits(message) and self.opener.trusts(seal.stream[0], seal.signer):
                self._deliver(seal, message)
                return
        if self.watch.is_copy and (
            any(seal.fits(message) for seal in self._delivered) or any(cdr == waiting.cdr for waiting in self._waiting)
        ):
            return
        self._waiting.append(message)
        self._bytes += len(cdr)
        while len(self._waiting) > MAX_WAITING or (self._bytes > MAX_WAITING_BYTES and len(self._waiting) > 1):
            self._give_up()

    def take_seal(self, text: str) -> None:
        """Verify a seal. Deliver its message if it has arrived; otherwise keep the seal."""
        self.expire()
        try:
            payload = self.opener.open(text)
            if payload is None:
                return
            proof = payload if DIGEST.fullmatch(payload) else self.opener.tag(payload)
        except MessageError as error:
            self.refuse(error)
            return
        opener = self.opener
        seal = _WaitingSeal(self.clock() + opener.left_s, proof, opener.stream, opener.number, opener.signer)
        for place, message in enumerate(self._waiting):
            if seal.fits(message):
                del self._waiting[place]
                self._bytes -= len(message.cdr)
                self._deliver(seal, message)
                return
        self._seals.append(seal)
        self.watch.expect(self.opener.stream)
        if len(self._seals) > MAX_SEALS:
            self._seals.popleft()

    def expire(self) -> None:
        """Refuse messages that have waited too long for a seal, and forget old seals."""
        now = self.clock()
        oldest = now - self.opener.freshness.window_s
        if any(seal.end < now for seal in self._seals):
            self._seals = deque(seal for seal in self._seals if seal.end >= now)
        while self._waiting and self._waiting[0].at < oldest:
            self._give_up()

    def close(self) -> None:
        """Refuse all messages that wait."""
        while self._waiting:
            self._give_up()

    def _deliver(self, seal: _WaitingSeal, message: _Message) -> None:
        self._seals = deque(each for each in self._seals if each.stream != seal.stream or each.number > seal.number)
        self.watch.note(seal.stream)
        self._delivered.append(seal)
        self.deliver(message.cdr, message.info)

    def _give_up(self) -> None:
        from socialbot.bridge.security import SealError

        self._bytes -= len(self._waiting.popleft().cdr)
        self.refuse(SealError("unsealed", f"no seal on {seal_topic(self.opener.topic)}"))
