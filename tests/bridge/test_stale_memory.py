from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from socialbot.bridge import environment as stale_memory
from socialbot.bridge.environment import YOUNG_S, remove_stale, stale_locks

DEAD, ALIVE, YOUNG = "0123456789abcdef", "fedcba9876543210", "00000000deadbeef"


def segment(folder: Path, name: str, age_s: float = YOUNG_S + 60) -> Path:
    (folder / f"fastrtps_{name}").write_bytes(bytes(5000))
    lock = folder / f"fastrtps_{name}_el"
    lock.touch()
    then = time.time() - age_s
    os.utime(lock, (then, then))
    return lock


def test_what_the_dead_have_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    segment(tmp_path, DEAD)
    segment(tmp_path, YOUNG, age_s=0.0)
    port = segment(tmp_path, "port7411")
    notes = tmp_path / "notes_el"
    notes.touch()
    with segment(tmp_path, ALIVE).open("rb") as alive:
        fcntl.flock(alive, fcntl.LOCK_EX)
        assert remove_stale(tmp_path) == 1
        assert remove_stale(tmp_path) == 0
    assert port.exists()
    assert notes.exists()
    assert {path.name for path in tmp_path.glob("fastrtps_*")} == {
        f"fastrtps_{name}{end}" for name in (YOUNG, ALIVE, "port7411") for end in ("", "_el")
    }


def test_a_lock_without_its_segment_is_removed_as_well(tmp_path: Path) -> None:
    segment(tmp_path, DEAD)
    (tmp_path / f"fastrtps_{DEAD}").unlink()
    assert remove_stale(tmp_path) == 1
    assert list(stale_locks(tmp_path)) == []


def test_where_there_is_no_shared_memory_nothing_is_stale(tmp_path: Path) -> None:
    assert remove_stale(tmp_path / "none") == 0


@pytest.mark.parametrize("look", [remove_stale, lambda folder: list(stale_locks(folder))])
def test_locks_that_somebody_may_be_about_to_take_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, look: Callable[[Path], object]
) -> None:
    tried: list[str] = []
    monkeypatch.setattr(stale_memory, "is_free", lambda path: bool(tried.append(path.name)))
    for name in ("port7400", "port7411", DEAD):
        segment(tmp_path, name)
    segment(tmp_path, YOUNG, age_s=0.0)
    look(tmp_path)
    assert tried == [f"fastrtps_{DEAD}_el"]
