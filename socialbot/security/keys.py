"""Keys: Ed25519 pairs in a folder, ``NAME.key`` (private) and ``NAME.pub`` (public), both PEM.

Whoever has a ``.pub`` in the folder is believed by all who use that folder. Each machine keeps its own ``.key`` only.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cryptography.exceptions import InternalError, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)

from socialbot.errors import SocialbotError

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
