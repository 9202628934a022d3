"""Reading files that may be anything: a device without end, a pipe without a writer, gigabytes.

Whether a path exists that a file names is asked by `os.path`: `pathlib.Path` raises OSError for a long name.
"""

from __future__ import annotations

import errno
import os
import stat
from os import PathLike
from typing import BinaryIO

from socialbot.core.limits import DATA_BYTES

_BLOCK = 1 << 20


def open_file(file: str | PathLike[str]) -> BinaryIO:
    """Open a file for reading. Raises OSError if it cannot be read, or is a device or a pipe: these may never end."""
    try:
        opened = open(file, "rb", opener=_open_at_once)  # noqa: SIM115 - the caller closes it
    except ValueError as error:  # a null character in the name
        raise OSError(errno.EINVAL, "is no name of a file", os.fspath(file)) from error
    if stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
        return opened
    opened.close()
    raise OSError(errno.EINVAL, "is a device or a pipe, not a file", os.fspath(file))


def _open_at_once(file: str, flags: int) -> int:
    return os.open(file, flags | os.O_NONBLOCK)  # otherwise a pipe is opened when somebody writes to it


def read_bytes(file: str | PathLike[str], most: int = DATA_BYTES) -> bytes:
    """Return the content of a file. Raises OSError as `open_file` does, and if it has more than ``most`` bytes."""
    parts, left = [], most + 1
    with open_file(file) as opened:
        expected = os.fstat(opened.fileno()).st_size + 1  # a read allocates as much as it asks for
        while left and (part := opened.read(min(left, expected))):
            parts.append(part)
            left, expected = left - len(part), _BLOCK
    if not left:
        raise OSError(errno.EFBIG, f"larger than {most >> 20} MiB", os.fspath(file))
    return b"".join(parts)


def check_size(file: str | PathLike[str], most: int) -> None:
    """Check a file that a library opens by its path. Raises OSError as `read_bytes` does."""
    with open_file(file) as opened:
        if os.fstat(opened.fileno()).st_size > most:
            raise OSError(errno.EFBIG, f"larger than {most >> 20} MiB", os.fspath(file))
