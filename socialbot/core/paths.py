"""File paths that come from parameters, graphs or messages: they stay in folders that the user has chosen.

These are the working directory, and what ``SOCIALBOT_FOLDERS`` lists besides (separated as in PATH).
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping, Sequence
from pathlib import Path

from socialbot.core.errors import ParameterError

FOLDERS_VARIABLE = "SOCIALBOT_FOLDERS"


def within(path: str | Path, folders: Sequence[Path], *, where: str) -> Path:
    """``path``, which is taken relative to the first of ``folders``, in full, and inside one of them.

    Links are followed first, so none leads out. Raises ParameterError for one that is outside; ``where`` names the
    parameter.
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
    """``path`` in full, taken relative to the working directory. Raises ParameterError as `within` does."""
    return within(path, workspace(), where=where)


def workspace(environment: MutableMapping[str, str] = os.environ) -> tuple[Path, ...]:
    """The folders in which nodes may keep files: the working directory, then those that are allowed besides."""
    listed = environment.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    return (Path.cwd(), *(Path(folder) for folder in listed if folder))


def allow(folder: Path, environment: MutableMapping[str, str] = os.environ) -> None:
    """Lets nodes of this process, and of those that it starts, keep files in ``folder``, as the user has asked for.

    It may be a single file. One with a colon in its name cannot be told to others, and is not allowed.
    """
    full = folder.expanduser().resolve()
    if os.pathsep not in str(full) and not any(full.is_relative_to(each.resolve()) for each in workspace(environment)):
        listed = environment.get(FOLDERS_VARIABLE, "")
        environment[FOLDERS_VARIABLE] = os.pathsep.join(filter(None, [listed, str(full)]))
