"""Files of a cache: checked, bounded in size, and safe for several processes."""

from __future__ import annotations

import hashlib
import logging
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from socialbot.core.errors import ParameterError
from socialbot.core.limits import DATA_BYTES
from socialbot.core.paths import replace_file
from socialbot.core.reading import open_file, read_bytes

log = logging.getLogger("socialbot.cache")

SUFFIX = ".percepts"
_MAGIC = b"socialbot percepts 1\n"
_DIGEST = hashlib.sha256().digest_size
_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class CacheFile:
    """Entry of a cache: its key, size on disk, and the time (s since 1970) of its last use."""

    key: str
    path: Path
    size: int
    used: float


class CacheFolder:
    """Folder of entries, of which the least recently used are removed above ``max_bytes``."""

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path = path
        self.max_bytes = max_bytes

    def read(self, key: str, *, use: bool = True) -> bytes | None:
        """Return the content of an entry; None if there is none, or a damaged one, which is reported.

        ``use`` counts as a use of the entry.
        """
        path = self._path(key)
        try:
            data = read_bytes(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            log.warning("%s: the cache entry cannot be read: %s", path, error.strerror)
            return None
        start = len(_MAGIC) + _DIGEST
        try:
            if data[: len(_MAGIC)] != _MAGIC or hashlib.sha256(data[start:]).digest() != data[len(_MAGIC) : start]:
                raise ValueError("wrong checksum")
            inflater = zlib.decompressobj()
            content = inflater.decompress(data[start:], DATA_BYTES)
            if not inflater.eof:
                raise ValueError("incomplete, or too much data")
        except (ValueError, zlib.error) as error:
            log.warning("%s: the cache entry is damaged (%s); it is ignored and written again", path, error)
            return None
        try:
            if use:
                os.utime(path)
        except OSError as error:  # another process has removed it, or the folder is read-only
            log.debug("%s: %s", path, error)
        return content

    def write(self, key: str, content: bytes) -> bool:
        """Write an entry in one step; return False if it is larger than the whole cache may be. Raises OSError."""
        packed = zlib.compress(content, 6)
        data = b"".join((_MAGIC, hashlib.sha256(packed).digest(), packed))
        if len(data) > self.max_bytes:
            return False
        self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
        replace_file(self._path(key), data)
        self.shrink()
        return True

    def remove(self, key: str) -> None:
        self._path(key).unlink(missing_ok=True)

    def files(self) -> list[CacheFile]:
        """Return the entries, the most recently used first."""
        found = []
        for path in self.path.glob(f"*{SUFFIX}"):
            try:
                state = path.stat()
            except FileNotFoundError:  # another process has removed it
                continue
            found.append(CacheFile(path.stem, path, state.st_size, state.st_mtime))
        return sorted(found, key=lambda each: (-each.used, each.key))

    def clear(self) -> tuple[int, int]:
        """Remove all entries; return their number and size."""
        files = self.files()
        for each in files:
            each.path.unlink(missing_ok=True)
        return len(files), sum(each.size for each in files)

    def shrink(self) -> None:
        """Remove the least recently used entries above the limit."""
        left = self.max_bytes
        for each in self.files():
            left -= each.size
            if left < 0:
                each.path.unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self.path / f"{key}{SUFFIX}"


def hash_file(path: Path, *, where: str) -> bytes:
    """Return the SHA-256 of a file. Raises ParameterError if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with open_file(path) as file:
            while block := file.read(_READ_BYTES):
                digest.update(block)
    except OSError as error:
        raise ParameterError(f"cannot be read: {error.strerror}", where=f"{where}: {path}") from error
    return digest.digest()


def files_below(folder: Path) -> Iterator[Path]:
    """Yield the files of a package in a fixed order, without compiled ones."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            yield path
