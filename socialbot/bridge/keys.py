"""Keys of machines: files, rotation, and changes while a process runs."""

from __future__ import annotations

import base64
import contextlib
import grp
import hashlib
import logging
import os
import pwd
import re
import stat
import threading
import time
from collections.abc import Callable, Iterator, Mapping
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

from socialbot.core.errors import SocialbotError
from socialbot.core.paths import replace_file, sync_folder
from socialbot.core.reading import open_file

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,63}")
PRIVATE, PUBLIC = ".key", ".pub"
NEXT = ".next"
"""Before the suffix of the files of a successor."""

MAX_KEY_BYTES = 10_000

WINDOW_S = 5.0
"""Default window (s): clock difference plus travel time. Fast DDS repeats a lost packet after three seconds."""

log = logging.getLogger("socialbot.security")


class SecurityError(SocialbotError):
    """Invalid key or security setting."""

    exit_code = 4


@dataclass(frozen=True)
class Keys:
    """Own name and private key, and the trusted public keys by name, including the own one.

    ``successors`` are also trusted: the next keys of names whose keys are being rotated.
    """

    name: str
    private: Ed25519PrivateKey = field(repr=False)
    trusted: Mapping[str, Ed25519PublicKey]
    successors: Mapping[str, Ed25519PublicKey] = field(default_factory=dict)

    def latest(self) -> Keys:
        """Return these keys, which do not change; `KeyRing.latest` follows the folder."""
        return self

    def of(self, name: str) -> list[Ed25519PublicKey]:
        """Trusted keys of ``name``."""
        return [keys[name] for keys in (self.trusted, self.successors) if name in keys]


def new_key(name: str, folder: Path) -> tuple[Path, Path]:
    """Create a key pair in ``folder``, and the folder if needed; return the private and the public file.

    Raises:
        SecurityError: A key of that name exists, or the files cannot be written.
    """
    _check_name(name)
    return _write_pair(name, name, folder)


def begin_rotation(name: str, folder: Path) -> tuple[Path, Path]:
    """Create the next key pair of ``name``, beside the present one; return the private and the public file.

    Raises:
        SecurityError: There is no usable key of that name, a rotation has begun already, or files cannot be written.
    """
    load_keys(folder, name)
    return _write_pair(name, name + NEXT, folder)


def finish_rotation(
    name: str, folder: Path, pause: Callable[[float], None] = time.sleep, window_s: float = WINDOW_S
) -> Path:
    """Replace the key pair of ``name`` by the next one; return the public file.

    ``pause`` waits (s) before each of two steps, so that all running processes on this machine follow. First the next
    key signs, which they all trust by then. Then the last key is no longer trusted: none of them signs with it, and the
    messages that it has sealed have arrived, or are older than ``window_s``. If this is interrupted, call it again.

    Raises:
        SecurityError: No rotation has begun, or files cannot be written.
    """
    _check_name(name)
    private, public = folder / f"{name}{PRIVATE}", folder / f"{name}{NEXT}{PUBLIC}"
    secret = folder / f"{name}{NEXT}{PRIVATE}"
    if os.path.lexists(public) and not os.path.lexists(secret):
        secret = private  # an earlier call ended after the first step
    if _pem(load_private_key(secret).public_key()) != _pem(_load_public_key(public, name)):
        remedy = "delete both files and begin again: socialbot key rotate NAME"
        raise SecurityError(f"{secret.name} and {public.name} are not a pair", where=str(folder), remedy=remedy)
    try:
        if secret != private:
            pause(2 * RELOAD_PERIOD_S)
            secret.replace(private)
            sync_folder(folder)  # a power cut after the second step must not undo the first
        pause(2 * RELOAD_PERIOD_S + window_s)
        replaced = public.replace(folder / f"{name}{PUBLIC}")
        sync_folder(folder)
        return replaced
    except OSError as error:
        what = f"cannot replace the key {name!r}: {error.strerror}"
        raise SecurityError(what, where=str(folder), remedy="make the folder writable") from error


def _write_pair(name: str, stem: str, folder: Path) -> tuple[Path, Path]:
    secret, public = folder / f"{stem}{PRIVATE}", folder / f"{stem}{PUBLIC}"
    key = Ed25519PrivateKey.generate()
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        if not (folder / ".gitignore").exists():
            replace_file(folder / ".gitignore", f"*{PRIVATE}\n".encode())  # an empty one would not be completed
        if public.exists():
            raise FileExistsError(None, "it exists already")
        _write_new(secret, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), 0o600)
        try:
            _write_new(public, _pem(key.public_key()), 0o644)
        except OSError:
            secret.unlink()
            raise
        sync_folder(folder)
    except OSError as error:
        what = f"cannot create the key {name!r}: {error.strerror}"
        raise SecurityError(what, where=str(folder), remedy="choose another name or folder") from error
    return secret, public


def load_keys(folder: Path, name: str = "") -> Keys:
    """Load the keys in ``folder``. The own key is that of ``name``, or the only private one.

    Raises:
        SecurityError: Keys are missing, damaged, do not form a pair, or other users can read or change them.
    """
    if not name:
        found = private_names(folder)
        if len(found) != 1:
            what = f"several private keys: {', '.join(found)}" if found else "no private key"
            remedy = "name one: FOLDER:NAME" if found else f"make one: socialbot key new NAME --folder {folder}"
            raise SecurityError(what, where=str(folder), remedy=remedy)
        name = found[0]
    _check_name(name)
    trusted, successors = load_public_keys(folder), load_successors(folder)
    private = load_private_key(folder / f"{name}{PRIVATE}")
    if name not in trusted:
        raise SecurityError(f"there is no {name}{PUBLIC}", where=str(folder), remedy="copy the public key there, too")
    keys = Keys(name, private, trusted, successors)
    if _pem(private.public_key()) not in map(_pem, keys.of(name)):
        remedy = "copy the public key from the machine of the private one"
        raise SecurityError(f"{name}{PRIVATE} and {name}{PUBLIC} are not a pair", where=str(folder), remedy=remedy)
    return keys


def load_public_keys(folder: Path) -> dict[str, Ed25519PublicKey]:
    """Load the public keys in ``folder`` by name, without successors. Raises SecurityError for an invalid one."""
    _check_folder(folder)
    paths = sorted(path for path in folder.glob(f"*{PUBLIC}") if not path.stem.endswith(NEXT))
    return {path.stem: _load_public_key(path, path.stem) for path in paths}


def load_successors(folder: Path) -> dict[str, Ed25519PublicKey]:
    """Load the next public keys in ``folder`` by name. Raises SecurityError for an invalid one.

    Without the file of the present key, the machine was removed, and its next key is not trusted either.
    """
    _check_folder(folder)
    return {name: _load_public_key(path, name) for name, path in _successor_files(folder).items()}


def _successor_files(folder: Path) -> dict[str, Path]:
    found = {path.stem.removesuffix(NEXT): path for path in sorted(folder.glob(f"*{NEXT}{PUBLIC}"))}
    return {name: path for name, path in found.items() if os.path.lexists(folder / f"{name}{PUBLIC}")}


def _check_folder(folder: Path) -> None:
    if not os.path.isdir(folder):  # unlike Path.is_dir, false for a folder that cannot be reached
        raise SecurityError("no such folder", where=str(folder), remedy="make a key: socialbot key new NAME --folder")
    _refuse_writers(folder, "other users can add keys")


def _load_public_key(path: Path, name: str) -> Ed25519PublicKey:
    _check_name(name)
    _refuse_writers(path, "other users can change this key")
    key = _loaded(path, load_pem_public_key)
    if not isinstance(key, Ed25519PublicKey):
        raise SecurityError("not a public Ed25519 key", where=str(path), remedy="make one: socialbot key new NAME")
    return key


def load_private_key(path: Path) -> Ed25519PrivateKey:
    """Load the private key at ``path``. Raises SecurityError if it is invalid, or other users can read it."""
    key = _loaded(path, lambda data: load_pem_private_key(data, None))
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
    except OSError as error:
        raise _unreadable(path, error) from error
    if mode & 0o077:
        what = "other users can read or change this private key"
        raise SecurityError(what, where=str(path), remedy=f"chmod 600 {path}")
    _refuse_writers(path, "other users can change this private key")
    if not isinstance(key, Ed25519PrivateKey):
        raise SecurityError("not a private Ed25519 key", where=str(path), remedy="make one: socialbot key new NAME")
    return key


def private_names(folder: Path) -> list[str]:
    """Names of the private keys in ``folder``."""
    return sorted(path.stem for path in folder.glob(f"*{PRIVATE}") if not path.stem.endswith(NEXT))


def fingerprint(key: Ed25519PublicKey) -> str:
    """Short text for the visual comparison of keys."""
    digest = hashlib.sha256(key.public_bytes(Encoding.Raw, PublicFormat.Raw)).digest()
    return base64.b32encode(digest[:15]).decode().lower()


def _check_name(name: str) -> None:
    if not NAME.fullmatch(name):
        raise SecurityError(f"{name!r} is not a valid key name", remedy="use up to 64 letters, digits, _ and -")


def _loaded(path: Path, load: Callable[[bytes], object]) -> object:
    try:
        with open_file(path) as file:
            return load(file.read(MAX_KEY_BYTES))
    except OSError as error:
        raise _unreadable(path, error) from error
    except (ValueError, TypeError, UnsupportedAlgorithm, InternalError) as error:
        remedy = "copy it again, or make a new key"
        raise SecurityError("the file holds no usable key", where=str(path), remedy=remedy) from error


def _refuse_writers(path: Path, what: str) -> None:
    """Raise SecurityError if others can change a file or folder, or put another one in its place.

    A part of its path, or of a link on the way, may belong to another user, or a group or others may change it.
    """
    try:
        real = Path(os.path.realpath(path, strict=True))
        own = _owners(path)
        for part in (*_parts(path), real):
            found = part.lstat()
            if found.st_uid not in own:
                raise SecurityError(what, where=str(part), remedy=f"chown {os.getuid()} {part}")
            # Only its owner can change a link, or replace a file in a sticky folder such as /tmp.
            if stat.S_ISLNK(found.st_mode) or (found.st_mode & stat.S_ISVTX and part != real):
                continue
            if found.st_mode & 0o002 or (found.st_mode & 0o020 and not _is_private(found.st_gid, found.st_uid)):
                raise SecurityError(what, where=str(part), remedy=f"chmod go-w {part}")
    except OSError as error:
        raise _unreadable(path, error) from error


def _parts(path: Path) -> Iterator[Path]:
    """Yield the folders and links in which a part of ``path`` is looked up, also the parts of links on the way."""
    place, left = Path("/"), [*reversed(path.absolute().parts)]
    while left:
        name = left.pop()
        if name == "..":
            place = place.parent
            continue
        yield place
        if os.path.islink(place / name):
            yield place / name
            left += reversed(Path(os.readlink(place / name)).parts)
        else:
            place /= name


def _owners(path: Path) -> set[int]:
    """Users who may change keys: root and this one. Root trusts the owner of a folder by using its keys."""
    folder = path if path.is_dir() else path.parent
    return {0, os.getuid(), *([] if os.getuid() else [folder.stat().st_uid])}


def _is_private(group: int, owner: int) -> bool:
    """Whether nobody but the ``owner``, this user and root is in a ``group``. Some systems give each user one."""
    own = {owner, os.getuid(), 0}
    try:
        members = {pwd.getpwnam(name).pw_uid for name in grp.getgrgid(group).gr_mem}
    except KeyError:  # it is not known here
        return False
    return members | {user.pw_uid for user in pwd.getpwall() if user.pw_gid == group} <= own


def _unreadable(path: Path, error: OSError) -> SecurityError:
    return SecurityError(f"cannot be read: {error.strerror}", where=str(path), remedy="see docs/security.md")


def _write_new(path: Path, data: bytes, mode: int) -> None:
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError:  # a full disk: an empty key would make the folder unusable
        path.unlink()
        raise


def _pem(key: Ed25519PublicKey) -> bytes:
    return key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


RELOAD_PERIOD_S = 0.25
"""Time (s) after which a change in the folder of keys counts, while messages are signed or verified."""


class KeyRing:
    """Keys in ``folder``, which follow its changes while the process runs. Thread-safe.

    Removed and unusable public keys are not trusted. The last usable private key signs.

    Raises:
        SecurityError: The keys cannot be used; see `load_keys`.
    """

    def __init__(self, folder: Path, name: str = "", steady: Callable[[], float] = time.monotonic) -> None:
        self._folder = folder
        self._steady = steady
        self._state = self._read_state()
        self._keys = load_keys(folder, name)
        self._checked = steady()
        self._lock = threading.Lock()

    def latest(self) -> Keys:
        """Return the keys in the folder, which are at most `RELOAD_PERIOD_S` old."""
        if self._steady() - self._checked >= RELOAD_PERIOD_S and self._lock.acquire(blocking=False):
            try:
                self._reload()
                self._checked = self._steady()
            finally:
                self._lock.release()
        return self._keys

    def _reload(self) -> None:
        state = self._read_state()
        if state == self._state:
            return
        self._state = state
        before, name = self._keys, self._keys.name
        try:
            self._keys = load_keys(self._folder, name)
        except SecurityError as error:
            self._keys = Keys(name, before.private, *_usable_keys(self._folder))
            log.error("keys: %s", error)
        removed = sorted(before.trusted.keys() - self._keys.trusted.keys())
        added = sorted(self._keys.trusted.keys() - before.trusted.keys())
        log.warning("keys have changed: trusts %s", ", ".join(sorted(self._keys.trusted)) or "nobody")
        if removed or added:
            log.warning("keys removed: %s; added: %s", ", ".join(removed) or "none", ", ".join(added) or "none")

    def _read_state(self) -> object:
        """Names, sizes, modes and times of the files of keys; None if the folder cannot be read."""
        try:
            folder = self._folder.stat().st_mode
            with os.scandir(self._folder) as entries:
                files = [(each.name, _file_state(each)) for each in entries if each.name.endswith((PRIVATE, PUBLIC))]
        except OSError:
            return None
        return folder, sorted(files)


def _file_state(entry: os.DirEntry[str]) -> tuple[int, ...]:
    """Identity, size, mode and time of a file; empty if it cannot be read."""
    try:
        found = entry.stat()
    except OSError:
        return ()
    return found.st_ino, found.st_size, found.st_mode, found.st_mtime_ns


def _usable_keys(folder: Path) -> tuple[dict[str, Ed25519PublicKey], dict[str, Ed25519PublicKey]]:
    """Usable public keys in ``folder`` by name, and usable successors."""
    trusted: dict[str, Ed25519PublicKey] = {}
    successors: dict[str, Ed25519PublicKey] = {}
    with contextlib.suppress(SecurityError):
        _check_folder(folder)
        present = {path.stem: path for path in sorted(folder.glob(f"*{PUBLIC}")) if not path.stem.endswith(NEXT)}
        for found, paths in ((trusted, present), (successors, _successor_files(folder))):
            for name, path in paths.items():
                with contextlib.suppress(SecurityError):
                    found[name] = _load_public_key(path, name)
    return trusted, successors
