"""Files that must survive a power cut, on a disk that loses all data which nobody has asked it to keep."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from socialbot.bridge.keys import begin_rotation, finish_rotation, load_keys, new_key
from socialbot.core.paths import FOLDERS_VARIABLE, replace_file
from socialbot.deliberation.files import save_mind
from socialbot.vision.camera_pose import CameraPose, load_pose, save_pose
from tests.agents.hospital.test_runs import paper
from tests.agents.waldo.corridor import ANNA, Corridor
from tests.deliberation.office import Office

pytestmark = pytest.mark.slow

SHUTDOWN, WITHOUT_LOG = 0x8004587D, struct.pack("I", 2)  # EXT4_IOC_SHUTDOWN: no data and no journal are written


@dataclass
class Disk:
    """A disk of 64 MB with ext4, mounted at ``folder``."""

    image: Path
    folder: Path

    def mount(self) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["mount", "-o", "loop", self.image, self.folder], capture_output=True, text=True)

    def cut_power(self) -> None:
        """Lose all data that is not on the disk, and start again."""
        handle = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.ioctl(handle, SHUTDOWN, WITHOUT_LOG)
        finally:
            os.close(handle)
        subprocess.run(["umount", self.folder], check=True)
        self.mount().check_returncode()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """Skips the test where it cannot be mounted."""
    disk = Disk(tmp_path / "image", tmp_path / "disk")
    disk.folder.mkdir()
    with disk.image.open("wb") as file:
        file.truncate(64_000_000)
    made = subprocess.run(["mkfs.ext4", "-q", disk.image], capture_output=True, text=True)
    mounted = made if made.returncode else disk.mount()
    if mounted.returncode:
        pytest.skip(f"no disk: {mounted.stderr.strip()}")
    try:
        yield disk
    finally:
        subprocess.run(["umount", "-l", disk.folder], check=True)


@pytest.mark.parametrize("old", [None, b"old"])
def test_a_durable_file_has_its_new_content(disk: Disk, old: bytes | None) -> None:
    for name, durable in (("durable", True), ("other", False)):
        if old is not None:
            (disk.folder / name).write_bytes(old)
            os.sync()
        replace_file(disk.folder / name, b"new", durable=durable)
        disk.cut_power()
    assert (disk.folder / "durable").read_bytes() == b"new"
    other = disk.folder / "other"
    assert (other.read_bytes() if other.exists() else None) == old, "the disk keeps data that nobody asked for"


def test_a_new_key_pair_and_its_rotation_are_kept(disk: Disk) -> None:
    keys = disk.folder / "keys"
    new_key("robot", keys)
    disk.cut_power()
    first = load_keys(keys).private.public_key()
    begin_rotation("robot", keys)
    disk.cut_power()
    (successor,) = load_keys(keys).successors.values()
    finish_rotation("robot", keys, pause=lambda _: None)
    disk.cut_power()
    assert load_keys(keys).private.public_key() == successor != first


def test_the_pose_of_a_camera_is_kept(disk: Disk) -> None:
    file = disk.folder / "poses" / "camera.json"
    save_pose(CameraPose(height_m=1.3, pitch_rad=0.2), file)
    disk.cut_power()
    pose = load_pose(file)
    assert pose is not None
    assert pose.height_m == 1.3


def save_deliberator(file: Path) -> None:
    save_mind(Office().deliberator, file)


def save_coordinator(file: Path) -> None:
    paper(0, memory_file=str(file)).until(2.0)


def save_agent(file: Path) -> None:
    Corridor(mind_file=str(file)).see(ANNA, times=20)


@pytest.mark.parametrize("save", [save_deliberator, save_coordinator, save_agent])
def test_the_state_of_an_agent_is_kept(
    disk: Disk, save: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDERS_VARIABLE, str(disk.folder))
    file = disk.folder / "minds" / "agent.json"
    save(file)
    disk.cut_power()
    assert msgspec.json.decode(file.read_bytes()), "a damaged file would end the next start"
