"""Authentication tags of large serialised messages, a cheaper proof than a digest of all their bytes.

A tag is that of AES-256-GCM over the message, under a key that only its sender and one receiver can derive: by X25519
from their Ed25519 keys, then HKDF-SHA256 with domain, topic, stream and both public keys. So a seal holds a tag for
each machine whose public key the sender has, and no machine can alter a message of another one for a third.

The nonce is the number of the message. Each stream has its own keys and a random name of 128 bits, and repeats no
number, so no nonce is used twice.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from socialbot.bridge.detached_seals import head
from socialbot.bridge.keys import Keys, fingerprint
from socialbot.core.decoding import json_decoder
from socialbot.core.messages import NO_JSON

SCHEMA = "socialbot/Tags/1"

LEAST_BYTES, MOST_BYTES = 2**18, 2**30
"""Sizes of messages that have tags. The digest of a smaller one costs little."""
MOST_MACHINES = 8
"""Number of machines above which one digest costs less than a tag for each."""
MAX_STREAMS = 256

_PRIME = 2**255 - 19
_NONCE_BYTES, _KEY_BYTES, _TAG_BYTES = 12, 32, 16


class Tags(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag=SCHEMA, forbid_unknown_fields=True):
    """Payload of a seal: the `head` of a message, and its tags by the fingerprint of their receiver's key."""

    head: str
    tags: Mapping[str, Annotated[bytes, msgspec.Meta(min_length=_TAG_BYTES, max_length=_TAG_BYTES)]]


_DECODER = json_decoder(Tags)


@dataclass(frozen=True)
class Tag:
    """Tag of the message with this ``head`` for one receiver, and how to check it."""

    head: str
    value: bytes
    key: AESGCM
    nonce: bytes

    def fits(self, cdr: bytes) -> bool:
        try:
            self.key.decrypt(self.nonce, self.value, cdr)
        except InvalidTag:
            return False
        return True


@dataclass(eq=False)
class TagKeys:
    """Keys of the tags on one ``topic`` in one ``realm``, for a sender or a receiver. Not thread-safe."""

    realm: str
    topic: str
    _keys: Keys | None = field(default=None, init=False)
    _own: bytes = field(default=b"", init=False)
    _name: str = field(default="", init=False)
    _receivers: dict[str, bytes] = field(default_factory=dict, init=False)
    """Public keys of all trusted machines by fingerprint."""
    _found: dict[tuple[bytes, bytes, str], AESGCM | None] = field(default_factory=dict, init=False)

    def seal(self, keys: Keys, stream: str, number: int, cdr: bytes) -> str | None:
        """Make the payload of a seal; None if a digest is due. No other message has the ``number`` of ``stream``."""
        self._follow(keys)
        if not LEAST_BYTES <= len(cdr) <= MOST_BYTES or len(self._receivers) > MOST_MACHINES:
            return None
        found = {name: self._key(keys, self._own, receiver, stream) for name, receiver in self._receivers.items()}
        tags = {name: key.encrypt(_nonce(number), b"", cdr) for name, key in found.items() if key is not None}
        return msgspec.json.encode(Tags(head=head(cdr), tags=tags)).decode()

    def read(self, payload: str, keys: Keys, signer: Ed25519PublicKey, stream: str, number: int) -> Tag | None:
        """Read the payload of a seal by ``signer``; None if it has no tag for this machine, or is no `Tags`."""
        self._follow(keys)
        try:
            tags = _DECODER.decode(payload)
        except NO_JSON:
            return None
        value, key = tags.tags.get(self._name), self._key(keys, signer.public_bytes_raw(), self._own, stream)
        return None if value is None or key is None else Tag(tags.head, value, key, _nonce(number))

    def _follow(self, keys: Keys) -> None:
        """Forget what is known of earlier keys."""
        if keys is not self._keys:
            self._keys, self._found = keys, {}
            own = keys.private.public_key()
            self._own, self._name = own.public_bytes_raw(), fingerprint(own)
            trusted = (*keys.trusted.values(), *keys.successors.values())
            self._receivers = {fingerprint(key): key.public_bytes_raw() for key in trusted}

    def _key(self, keys: Keys, sender: bytes, receiver: bytes, stream: str) -> AESGCM | None:
        """Return the key of the tags of ``stream``; None if a public key is none of Curve25519."""
        name = sender, receiver, stream
        if name not in self._found:
            if len(self._found) >= MAX_STREAMS:
                self._found.clear()
            purpose = msgspec.json.encode((SCHEMA, self.realm, self.topic, stream)) + sender + receiver
            secret = _agreed(keys.private, receiver if sender == self._own else sender)
            derived = secret and HKDF(SHA256(), _KEY_BYTES, salt=None, info=purpose).derive(secret)
            self._found[name] = AESGCM(derived) if derived else None
        return self._found[name]


def _nonce(number: int) -> bytes:
    return number.to_bytes(_NONCE_BYTES, "big")


def _agreed(private: Ed25519PrivateKey, public: bytes) -> bytes:
    """Secret of two machines: X25519 with the points that are those of their Ed25519 keys (RFC 7748, 4.1).

    It is empty if ``public`` is no usable point.
    """
    scalar = hashlib.sha512(private.private_bytes_raw()).digest()[:32]
    y = int.from_bytes(public, "little") % 2**255
    try:
        point = (1 + y) * pow(1 - y, -1, _PRIME) % _PRIME
        other = X25519PublicKey.from_public_bytes(point.to_bytes(32, "little"))
        return X25519PrivateKey.from_private_bytes(scalar).exchange(other)
    except ValueError:
        return b""
