"""Files of a cache: checked, bounded in size, and safe for several processes."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

from socialbot.core.errors import ParameterError
from socialbot.core.limits import DATA_BYTES
from socialbot.core.reading import open_file, read_bytes

log = logging.getLogger("socialbot.cache")

SUFFIX = ".percepts"
_TEMPORARY = ".part"
_MAGIC = b"socialbot percepts 1\n"
_DIGEST = hashlib.sha256().digest_size
_READ_BYTES = 1 << 20
_ABANDONED_S = 24 * 3600.0  # Temporary files of killed processes are removed at this age.


@dataclass(frozen=True)
class CacheFile:
    """Entry of a cache: its key, size on disk, and the time (s since 1970) of its last use."""

    key: str
    path: Path
    size: int
    used: float


class CacheFolder:
    """Folder of entries, of which the least recently used are removed above ``max_bytes``.

    Entries are written to a temporary file and renamed, so that other processes see whole ones only.
    """

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

    def write(self, key: str) -> CacheWriter:
        """Begin an entry. Raises OSError if the folder cannot be written."""
        self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
        return CacheWriter(self, self._path(key))

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
        """Remove the least recently used entries above the limit, and files that killed processes left behind."""
        left = self.max_bytes
        newest = 0.0
        for each in self.files():
            newest = max(newest, each.used)
            left -= each.size
            if left < 0:
                each.path.unlink(missing_ok=True)
        for path in self.path.glob(f"*{_TEMPORARY}"):
            try:
                if newest - path.stat().st_mtime > _ABANDONED_S:
                    path.unlink(missing_ok=True)
            except FileNotFoundError:
                continue

    def _path(self, key: str) -> Path:
        return self.path / f"{key}{SUFFIX}"


class CacheWriter:
    """Entry that is being written; it exists after `commit` only."""

    def __init__(self, folder: CacheFolder, path: Path) -> None:
        self._folder = folder
        self._path = path
        handle, name = tempfile.mkstemp(suffix=_TEMPORARY, dir=folder.path)
        self._temporary = Path(name)
        self._file: IO[bytes] = os.fdopen(handle, "wb")
        self._file.write(_MAGIC + bytes(_DIGEST))
        self._digest = hashlib.sha256()
        self._packed = zlib.compressobj(6)
        self._size = len(_MAGIC) + _DIGEST

    def __enter__(self) -> CacheWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.drop()

    def add(self, data: bytes) -> None:
        """Append ``data``. Raises OSError."""
        self._put(self._packed.compress(data))

    def commit(self) -> bool:
        """Finish the entry; return False if it is larger than the whole cache may be. Raises OSError."""
        self._put(self._packed.flush())
        if self._size > self._folder.max_bytes:
            self.drop()
            return False
        self._file.seek(len(_MAGIC))
        self._file.write(self._digest.digest())
        self._file.close()
        self._temporary.replace(self._path)
        self._folder.shrink()
        return True

    def drop(self) -> None:
        """Give the entry up; no effect after `commit`."""
        if not self._file.closed:
            self._file.close()
            self._temporary.unlink(missing_ok=True)

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._digest.update(data)
        self._size += len(data)


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
