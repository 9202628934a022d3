"""Reading and replacing files, and confinement of file paths from parameters, graphs and messages to allowed folders.

The allowed folders are the working directory and the folders in ``SOCIALBOT_FOLDERS`` (separated as in PATH).
"""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator, MutableMapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from socialbot.core.errors import ParameterError, RunError, SocialbotError
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.reading import read_bytes

FOLDERS_VARIABLE = "SOCIALBOT_FOLDERS"


def decoded(data: bytes) -> str:
    """Decode UTF-8 text as an opened file does, with all line ends as one. Raises UnicodeDecodeError."""
    return io.TextIOWrapper(io.BytesIO(data), "utf-8").read()


def read_text(file: Path, error: type[SocialbotError], *, remedy: str = "check the path") -> str:
    """Return the text of a UTF-8 file. Raises an ``error`` if it cannot be read."""
    try:
        return decoded(read_bytes(file, TEXT_BYTES))
    except (OSError, UnicodeDecodeError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else "is not UTF-8 text"
        raise error(f"cannot be read: {reason}", where=str(file), remedy=remedy) from problem


def _resolved(path: Path) -> Path:
    """Follow all links. Raises RuntimeError for a link to itself, which Python 3.13 leaves as it is."""
    found = path.resolve()
    if any(each.is_symlink() for each in (found, *found.parents)):
        raise RuntimeError(f"{path} leads to itself")
    return found


def leads_inside(folder: Path, path: Path) -> bool:
    """Whether ``path`` is in ``folder``, and is no link to elsewhere or to itself."""
    try:
        return _resolved(path).is_relative_to(folder.resolve())
    except (OSError, RuntimeError):
        return False


def expect_inside(folder: Path, path: Path) -> Path:
    """Return ``path``, which is to be written in a folder.

    Raises:
        RunError: It is a link that leads out of the folder, or a pipe or a device, which may take nothing.
    """
    if not leads_inside(folder, path):
        raise RunError("is a link that leads out of its folder", where=str(path), remedy="remove the link")
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RunError("is a device or a pipe, not a file", where=str(path), remedy="remove it")
    return path


def expect_all_inside(folder: Path) -> None:
    """Check a folder whose files are to be written.

    Raises:
        RunError: It is a link that leads out of its own folder, or holds a link that leads there, a pipe or a device.
    """
    expect_inside(folder.parent, folder)
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            if not os.path.isfile(path := Path(parent, name)) or os.path.islink(path):
                expect_inside(folder.parent, path)


CHECK_DISK = "check the folder, its permissions and the disk"
"""Remedy for a file that cannot be written."""


@contextmanager
def writing(file: Path, error: type[SocialbotError] = ParameterError, *, remedy: str = CHECK_DISK) -> Iterator[None]:
    """Raise an ``error`` that ``file`` cannot be written instead of an OSError."""
    try:
        yield
    except OSError as problem:
        what = f"cannot be written: {problem.strerror or problem}"
        raise error(what, where=str(file), remedy=remedy) from problem


def create_like(file: Path, copy: Path) -> BinaryIO:
    """Create ``copy``, which nobody can open who cannot open ``file``, if that exists. Raises OSError."""
    mode = stat.S_IMODE(file.stat().st_mode) if file.exists() else 0o666
    return open(copy, "xb", opener=lambda name, flags: os.open(name, flags, mode))


def replace_file(file: Path, data: bytes, *, durable: bool = False) -> None:
    """Write a file in one step: readers find the old content or the new one, also if this fails or the process ends.

    The permissions stay, and so does a link to the file. A pipe or device, such as /dev/stdout, is written to. After a
    power cut, a ``durable`` file has the new content once this has returned; others may have the old one, or none.
    Raises OSError if it cannot be written.
    """
    if file.is_relative_to("/dev") or (file.exists() and not file.is_file() and not file.is_dir()):
        file.write_bytes(data)
        return
    file = file.resolve()
    draft = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
    try:
        with create_like(file, draft) as opened:
            opened.write(data)
            if durable:
                opened.flush()
                os.fsync(opened.fileno())
        if file.exists():
            shutil.copymode(file, draft)
        draft.replace(file)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    if durable:
        sync_folder(file.parent)


def sync_folder(folder: Path) -> None:
    """Write new names of files in ``folder`` to the disk, where the system can do so."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def temporary_folder(prefix: str) -> tempfile.TemporaryDirectory[str]:
    """Make a folder whose context removes it. Raises ParameterError if no disk can be written."""
    try:
        return tempfile.TemporaryDirectory(prefix=prefix)
    except OSError as error:
        what = f"cannot make a folder for temporary files: {error.strerror}"
        remedy = "free some space, or set TMPDIR to a folder on another disk"
        raise ParameterError(what, where=os.environ.get("TMPDIR", "TMPDIR"), remedy=remedy) from error


def within(path: str | Path, folders: Sequence[Path], *, where: str) -> Path:
    """Resolve ``path`` relative to the first of ``folders``, including links, and check that one of them contains it.

    Raises ParameterError for a path outside; ``where`` names the parameter.
    """
    try:
        found = _resolved(folders[0] / path)
        inside = any(found.is_relative_to(folder.resolve()) for folder in folders)
    except (OSError, ValueError, RuntimeError) as error:
        raise ParameterError(f"no path that can be used: {str(path)[:80]!r}", where=where) from error
    if not inside:
        raise ParameterError(
            f"{str(path)!r} is outside of {', '.join(map(str, folders))}",
            where=where,
            remedy=f"name one inside; or allow its folder: export {FOLDERS_VARIABLE}=FOLDER",
        )
    return found


def in_workspace(path: str | Path, *, where: str) -> Path:
    """Resolve ``path`` relative to the working directory. Raises ParameterError as `within` does."""
    return within(path, workspace(), where=where)


def user_folder(variable: str, default: str) -> Path:
    """Return the folder that ``variable`` names, or ``default`` in the home folder.

    A relative path in a variable of XDG is ignored, as its specification says: it would be another folder elsewhere.

    Raises:
        ParameterError: The user has no home folder, as in some containers.
    """
    if (named := os.environ.get(variable)) and (os.path.isabs(named) or not variable.startswith("XDG_")):
        return Path(named)
    try:
        return Path.home() / default
    except RuntimeError as error:
        remedy = f"set {variable} or HOME to a folder of yours"
        raise ParameterError("this user has no home folder", where=variable, remedy=remedy) from error


def workspace(environment: MutableMapping[str, str] = os.environ) -> tuple[Path, ...]:
    """Return the folders for files of nodes: the working directory and the allowed folders."""
    listed = environment.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    return (Path.cwd(), *(Path(folder) for folder in listed if folder))


def allow(folder: Path, environment: MutableMapping[str, str] = os.environ) -> None:
    """Allow nodes in this process and its child processes to use files in ``folder``, or a single file.

    A path that contains the separator of PATH is ignored.
    """
    full = folder.expanduser().resolve()
    if os.pathsep not in str(full) and not any(full.is_relative_to(each.resolve()) for each in workspace(environment)):
        listed = environment.get(FOLDERS_VARIABLE, "")
        environment[FOLDERS_VARIABLE] = os.pathsep.join(filter(None, [listed, str(full)]))
