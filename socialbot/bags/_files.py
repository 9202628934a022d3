"""Open the files of a bag with rosbags: folders, single files, and the intact part of a truncated file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader

from socialbot.bags import _decompression
from socialbot.bags.repair import salvage
from socialbot.core.errors import BagError
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.paths import decoded, read_bytes
from socialbot.core.yaml import check_depth

Reader = Ros1Reader | Ros2Reader

_decompression.install()

_STORAGE = (".mcap", ".db3")
_REPAIRS = {
    ".mcap": "copy the file again, or repair it with `mcap recover`",
    ".db3": "copy the file again, or repair it with `sqlite3 FILE .recover | sqlite3 NEW.db3`",
    ".bag": "copy the file again, or repair it with `rosbag reindex` of ROS 1",
}

_LFS_POINTER = b"version https://git-lfs.github.com/"


def open_folder(path: Path, damage: list[str]) -> list[Reader]:
    """Open the files of a rosbag2 folder, and add missing parts to ``damage``. Raises BagError."""
    metadata = path / "metadata.yaml"
    files = sorted((file for file in path.iterdir() if file.suffix in _STORAGE), key=natural)
    if not metadata.exists() and not files:
        what = "not a bag: the folder has no metadata.yaml and no .mcap or .db3 file"
        remedy = "give the folder that `bag record` made; for a folder of images use `bag import`"
        raise BagError(what, where=str(path), remedy=remedy)
    if metadata.exists():
        try:
            return [_open(path)]
        except BagError as error:
            if not files:
                raise
            damage.append(f"{metadata}: {error.what}")
    else:
        damage.append(f"{metadata}: missing; the .mcap and .db3 files are read")
    return [open_file(file, damage) for file in files]


def open_file(path: Path, damage: list[str]) -> Reader:
    """Open one file, or the intact part of a truncated one, which is added to ``damage``. Raises BagError."""
    if path.suffix not in _REPAIRS:
        remedy = "give a bag folder, or an .mcap, .db3 or .bag file; `bag import` makes one of a video or images"
        raise BagError(f"not a bag: {path.suffix or 'no suffix'}", where=str(path), remedy=remedy)
    try:
        return _open(path)
    except BagError:
        salvaged = salvage(path) if path.suffix == ".mcap" else None
        if salvaged is None:
            raise
    damage.append(f"{path}: truncated; the first {salvaged.whole} of {salvaged.size} bytes are intact and are read")
    return _open(salvaged)


def _open(path: Any) -> Reader:
    try:
        is_folder = isinstance(path, Path) and path.is_dir()
        if is_folder:
            check_depth(decoded(read_bytes(path / "metadata.yaml", TEXT_BYTES)))
        reader = Ros2Reader(path) if is_folder or path.suffix != ".bag" else Ros1Reader(path)
        reader.open()
        # Rosbags does not check the types.
        texts = [text for each in reader.connections for text in (each.topic, each.msgtype)]
        numbers = [each.msgcount for each in reader.connections]
        numbers += [reader.message_count, reader.start_time, reader.end_time]
        if not all(isinstance(text, str) for text in texts) or not all(type(number) is int for number in numbers):
            raise ValueError("a topic name or type is not a text, or a count is not a number")
    except Exception as error:
        raise broken(path, error) from error
    return reader


def broken(path: Any, error: Exception) -> BagError:
    """Return the error for a failure of rosbags to read ``path``, with the remedy for its format."""
    if isinstance(error, PermissionError):
        return BagError("permission denied", where=str(path), remedy="ask its owner for read permission")
    if isinstance(path, Path) and path.is_file() and _is_lfs_pointer(path):
        return BagError("not a bag, but a pointer of Git LFS to one", where=str(path), remedy="run `git lfs pull`")
    what = str(error) or type(error).__name__
    return BagError(f"the bag is damaged: {what}", where=str(path), remedy=_REPAIRS.get(path.suffix, "copy it again"))


def _is_lfs_pointer(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_LFS_POINTER)) == _LFS_POINTER


def natural(path: Path) -> list[tuple[int, str]]:
    """Sort key for natural order: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]
