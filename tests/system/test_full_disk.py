"""A running graph whose record cannot be written: the disk is full, or the folder was removed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from socialbot.bridge.environment import spinning_node
from socialbot.core.messages import TraceRecord
from socialbot.runs.folder import open_run
from tests.system.running import PATIENCE_S, BackgroundCommand, eventually, running, socialbot

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 8 MB. Skips the test where it cannot be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", folder], capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"no disk of 8 MB: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def fill(folder: Path) -> Path:
    """Write a file until the disk is full."""
    path = folder / "filling"
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return path


@pytest.mark.parametrize("fault", ["full", "removed"])
def test_a_graph_goes_on_without_its_record_and_records_again(pictures: Path, disk: Path, fault: str) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    told: list[tuple[str, dict[str, str]]] = []

    def note(array: DiagnosticArray) -> None:
        told.extend((one.name, {pair.key: pair.value for pair in one.values}) for one in array.status)

    def newest(name: str, key: str) -> str:
        return next((values[key] for node, values in reversed(told) if node == name and key in values), "")

    run = disk / "run"
    with spinning_node("onlooker") as ros:
        ros.create_subscription(DiagnosticArray, "/diagnostics", note, 100)
        with running("up", "--camera", pictures, "--out", run, "--set", "camera.loop=true") as process:
            assert eventually(lambda: newest("head", "state") == "active", PATIENCE_S)
            assert eventually(lambda: (run / "trace.jsonl").stat().st_size > 10_000, PATIENCE_S)
            if fault == "full":
                filling = fill(disk)
                assert eventually(lambda: newest("waldo record", "problem") == "No space left on device", PATIENCE_S)
                # A node is restarted without a log, and its agents and images go on.
                os.kill(int(newest("head", "pid")), signal.SIGKILL)
                assert eventually(lambda: newest("head", "restarts") == "1", PATIENCE_S)
                assert eventually(lambda: newest("head", "state") == "active", PATIENCE_S)
                filling.unlink()
                assert eventually(lambda: newest("waldo record", "problem") == "", PATIENCE_S)
                assert int(newest("waldo record", "lost")) > 0
            else:
                shutil.rmtree(run)
                assert eventually(lambda: (run / "trace.jsonl").exists(), PATIENCE_S)
                os.kill(int(newest("head", "pid")), signal.SIGKILL)
                assert eventually(lambda: newest("head", "restarts") == "1", PATIENCE_S)
                assert eventually(lambda: newest("head", "state") == "active", PATIENCE_S)
            size = (run / "trace.jsonl").stat().st_size
            assert eventually(lambda: (run / "trace.jsonl").stat().st_size > size + 5_000, PATIENCE_S)
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE_S) == 0, process
    lines = (run / "trace.jsonl").read_bytes().splitlines()
    assert [msgspec.json.decode(line, type=TraceRecord) for line in lines]
    assert open_run(run).problems == []


def test_missing_shared_memory_is_named_at_the_start(pictures: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "socialbot", "up", "--camera", str(pictures), "--out", str(tmp_path / "run")]
    script = 'mount -t tmpfs -o ro none /dev/shm && exec "$@"'
    with (tmp_path / "output").open("w") as file:
        process = BackgroundCommand(["unshare", "-m", "sh", "-c", script, "sh", *command], file)
        try:
            if not eventually(lambda: "pictures go by UDP" in process.output() or process.poll() is not None):
                pytest.fail(process.output())
            if "ermi" in process.output() and process.poll() is not None:
                pytest.skip(f"no own mounts: {process.output().strip()}")
            assert "/dev/shm cannot be written; pictures go by UDP: mount it writable" in process.output()
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def test_a_disk_that_cannot_be_written_is_named_at_the_start(pictures: Path, disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    done = socialbot("up", "--camera", pictures, "--out", disk / "run")
    assert done.returncode == 4
    assert "cannot be written: Read-only file system" in done.stderr
    subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
    fill(disk)
    done = socialbot("up", "--camera", pictures, "--out", disk / "run")
    assert done.returncode == 4
    assert "No space left on device" in done.stderr
