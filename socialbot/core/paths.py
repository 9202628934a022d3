"""Text files, and confinement of file paths from parameters, graphs and messages to allowed folders.

The allowed folders are the working directory and the folders in ``SOCIALBOT_FOLDERS`` (separated as in PATH).
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping, Sequence
from pathlib import Path

from socialbot.core.errors import ParameterError, SocialbotError

FOLDERS_VARIABLE = "SOCIALBOT_FOLDERS"


def read_text(file: Path, error: type[SocialbotError], *, remedy: str = "check the path") -> str:
    """Return the text of a UTF-8 file. Raises an ``error`` if it cannot be read."""
    try:
        return file.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else "is not UTF-8 text"
        raise error(f"cannot be read: {reason}", where=str(file), remedy=remedy) from problem


def within(path: str | Path, folders: Sequence[Path], *, where: str) -> Path:
    """Resolve ``path`` relative to the first of ``folders``, including links, and check that one of them contains it.

    Raises ParameterError for a path outside; ``where`` names the parameter.
    """
    try:
        found = (folders[0] / path).resolve()
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
