"""Sign and verify messages: Ed25519 keys, seals, and protection against replayed messages."""

from __future__ import annotations

import base64
import enum
import hashlib
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
from cryptography.exceptions import InternalError, InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)

from socialbot.core.clock import SECOND
from socialbot.core.errors import MessageError, SocialbotError

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,63}")
PRIVATE, PUBLIC = ".key", ".pub"
LARGEST_FILE = 10_000
"""Bytes; the file of a key has about a hundred."""


class SecurityError(SocialbotError):
    """A key or a setting of security that cannot be used."""

    exit_code = 4


@dataclass(frozen=True)
class Keys:
    """One's own key and name, and the public keys of all who are believed, by name; oneself is one of them."""

    name: str
    private: Ed25519PrivateKey = field(repr=False)
    trusted: Mapping[str, Ed25519PublicKey]


def new_key(name: str, folder: Path) -> tuple[Path, Path]:
    """Makes a key called ``name`` in ``folder``, which is made too; returns its private and its public file.

    Raises SecurityError when there is one of that name, or it cannot be written.
    """
    _check_name(name)
    secret, public = _files(name, folder)
    key = Ed25519PrivateKey.generate()
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        _keep_out_of_git(folder)
        if public.exists():
            raise FileExistsError(None, "it is there already")
        _write_new(secret, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), 0o600)
        _write_new(public, _pem(key.public_key()), 0o644)
    except OSError as error:
        raise SecurityError(
            f"no new key {name!r}: {error.strerror}", where=str(folder), remedy="choose another name or folder"
        ) from error
    return secret, public


def load_keys(folder: Path, name: str = "") -> Keys:
    """The keys in ``folder``, with that of ``name`` as one's own; without a name the only private one there.

    Raises SecurityError for keys that are missing, damaged, do not belong together, or that others may read or change.
    """
    name = name or _only_private(folder)
    _check_name(name)
    trusted = load_public_keys(folder)
    private = load_private_key(folder / f"{name}{PRIVATE}")
    if name not in trusted:
        raise SecurityError(f"there is no {name}{PUBLIC}", where=str(folder), remedy="copy the public key there, too")
    if _pem(private.public_key()) != _pem(trusted[name]):
        raise SecurityError(
            f"{name}{PRIVATE} and {name}{PUBLIC} do not belong together",
            where=str(folder),
            remedy="copy the public key from where the private one was made",
        )
    return Keys(name, private, trusted)


def load_public_keys(folder: Path) -> dict[str, Ed25519PublicKey]:
    """The public keys in ``folder`` by name. Raises SecurityError when one cannot be used."""
    if not folder.is_dir():
        raise SecurityError("no such folder", where=str(folder), remedy="make a key: socialbot key new NAME --folder")
    _refuse_mode(folder, 0o002, "anybody may add keys", "chmod o-w")
    keys = {}
    for path in sorted(folder.glob(f"*{PUBLIC}")):
        _check_name(path.stem)
        _refuse_mode(path, 0o002, "anybody may change this key", "chmod o-w")
        key = _loaded(path, load_pem_public_key)
        if not isinstance(key, Ed25519PublicKey):
            raise SecurityError("no public Ed25519 key", where=str(path), remedy="make one: socialbot key new NAME")
        keys[path.stem] = key
    return keys


def load_private_key(path: Path) -> Ed25519PrivateKey:
    """The private key at ``path``. Raises SecurityError, also when others than its owner may read it."""
    key = _loaded(path, lambda data: load_pem_private_key(data, None))
    _refuse_mode(path, 0o077, "others may read or change this private key", "chmod 600")
    if not isinstance(key, Ed25519PrivateKey):
        raise SecurityError("no private Ed25519 key", where=str(path), remedy="make one: socialbot key new NAME")
    return key


def private_names(folder: Path) -> list[str]:
    """The names of the private keys in ``folder``."""
    return sorted(path.stem for path in folder.glob(f"*{PRIVATE}"))


def fingerprint(key: Ed25519PublicKey) -> str:
    """A short text by which two people can see that they have the same key."""
    digest = hashlib.sha256(key.public_bytes(Encoding.Raw, PublicFormat.Raw)).digest()
    return base64.b32encode(digest[:15]).decode().lower()


def _files(name: str, folder: Path) -> tuple[Path, Path]:
    return folder / f"{name}{PRIVATE}", folder / f"{name}{PUBLIC}"


def _check_name(name: str) -> None:
    if not NAME.fullmatch(name):
        raise SecurityError(f"no name for a key: {name!r}", remedy="use up to 64 letters, digits, _ and -")


def _only_private(folder: Path) -> str:
    names = private_names(folder)
    if len(names) != 1:
        found = f"several private keys: {', '.join(names)}" if names else "no private key"
        remedy = "name one: FOLDER:NAME" if names else f"make one: socialbot key new NAME --folder {folder}"
        raise SecurityError(found, where=str(folder), remedy=remedy)
    return names[0]


def _loaded(path: Path, load: object) -> object:
    try:
        with path.open("rb") as file:
            return load(file.read(LARGEST_FILE))  # type: ignore[operator]
    except OSError as error:
        raise SecurityError(
            f"cannot be read: {error.strerror}", where=str(path), remedy="see docs/security.md"
        ) from error
    except (ValueError, TypeError, UnsupportedAlgorithm, InternalError) as error:
        raise SecurityError(
            "it holds no key that can be used", where=str(path), remedy="copy or make it anew"
        ) from error


def _refuse_mode(path: Path, bits: int, what: str, remedy: str) -> None:
    if stat.S_IMODE(path.stat().st_mode) & bits:
        raise SecurityError(what, where=str(path), remedy=f"{remedy} {path}")


def _write_new(path: Path, data: bytes, mode: int) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)


def _keep_out_of_git(folder: Path) -> None:
    ignored = folder / ".gitignore"
    if not ignored.exists():
        ignored.write_text(f"*{PRIVATE}\n", "utf-8")


def _pem(key: Ed25519PublicKey) -> bytes:
    return key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


MOST_STREAMS = 256
"""So many streams are remembered before those are forgotten whose messages would be late anyway."""


class FreshnessVerdict(enum.Enum):
    """What `Freshness` thinks of a message."""

    NEW = "new"
    RENEWED = "renewed"
    """Said before and sealed anew, for who joins late."""
    LATE = "late"
    EARLY = "early"
    """From the future: the clocks differ."""
    REPLAYED = "replayed"


@dataclass(frozen=True, slots=True)
class _Last:
    number: int
    time: int


class Freshness:
    """Judges the messages that come to one receiver. ``window_s``: how far (s) a message's time may be from ours.

    Nothing is believed that was sealed before the receiver began, because an earlier one, which has crashed since, may
    have heard it already; unless it ``joins_late`` to hear the last state. Times are the computer's, as simulated time
    may stand still. ``wall`` (ns) may be set right at any time; ``steady`` (ns) counts how long the receiver is there.
    """

    def __init__(
        self,
        window_s: float,
        *,
        joins_late: bool = False,
        wall: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._window = round(window_s * SECOND)
        self._joins_late = joins_late
        self.now = wall
        self._steady = steady
        self._begun = steady()
        self._streams: dict[tuple[str, str], _Last] = {}

    @property
    def remembered(self) -> int:
        """How many streams it remembers."""
        return len(self._streams)

    def judge(self, sender: str, stream: str, number: int, time: int) -> FreshnessVerdict:
        """What to think of a message, whose signature is right, that was sealed at ``time`` (ns); remembers it."""
        now = self.now()
        last = self._streams.get((sender, stream))
        if last is not None and (number < last.number or (number == last.number and _was_heard(time, last.time, now))):
            return FreshnessVerdict.REPLAYED
        if time - now > self._window:
            return FreshnessVerdict.EARLY
        if now - time > self._patience():
            return FreshnessVerdict.LATE
        self._remember((sender, stream), _Last(number, time), now)
        return FreshnessVerdict.RENEWED if last is not None and number == last.number else FreshnessVerdict.NEW

    def _patience(self) -> int:
        return self._window if self._joins_late else min(self._window, self._steady() - self._begun)

    def _remember(self, stream: tuple[str, str], last: _Last, now: int) -> None:
        if stream not in self._streams and len(self._streams) >= MOST_STREAMS:
            self._streams = {key: one for key, one in self._streams.items() if now - one.time <= self._window}
        self._streams[stream] = last


def _was_heard(time: int, last: int, now: int) -> bool:
    """Whether the last message, sealed anew at ``time``, was heard then or later: at ``last``, unless a clock was set.

    After that ``last`` lies in the future.
    """
    return time == last or time < last <= now


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
        if verdict is FreshnessVerdict.NEW:
            return sealed.payload
        if verdict is FreshnessVerdict.RENEWED:
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
