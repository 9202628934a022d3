"""Run the command line as a user does, and wait for its effects."""

from __future__ import annotations

import logging
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Thread
from time import monotonic, sleep
from typing import Any
from unittest.mock import patch

import msgspec
import psutil

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.cli.main import main

PATIENCE_S = 180.0
"""Time for a command to end after a signal, also on a busy machine."""

CALIBRATION_PERIOD_S = 1.0
"""Period of the camera calibration in the corridor bag."""


def socialbot(*arguments: object, timeout_s: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run ``socialbot`` to its end."""
    command = [sys.executable, "-m", "socialbot", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL)


@contextmanager
def logging_of_its_own() -> Iterator[None]:
    """Reset the logging configuration for one command, and restore it afterwards."""
    loggers = [logging.getLogger(name) for name in ("socialbot", "socialbot.bdi")]
    before = [(logger, logger.level, logger.handlers[:]) for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.NOTSET)
        logger.handlers[:] = []
    try:
        yield
    finally:
        for logger, level, handlers in before:
            logger.setLevel(level)
            logger.handlers[:] = handlers


def socialbot_here(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run ``socialbot`` in this process, which is faster."""
    command, output, errors, code = ["socialbot", *map(str, arguments)], StringIO(), StringIO(), 0
    given = patch.multiple(sys, argv=command, stdin=StringIO())
    with given, redirect_stdout(output), redirect_stderr(errors), logging_of_its_own():
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(command, code, output.getvalue(), errors.getvalue())


class BackgroundCommand(subprocess.Popen[str]):
    """A command whose output goes to a file: a pipe that nobody reads would block it."""

    def __init__(self, command: Sequence[str], file: Any) -> None:
        super().__init__(command, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True)
        self._path = Path(file.name)

    def output(self) -> str:
        """Return the output so far."""
        return self._path.read_text("utf-8")


@contextmanager
def running(*arguments: object) -> Iterator[BackgroundCommand]:
    """``socialbot`` in the background, ended by SIGINT. Its output is printed if the block fails."""
    command = [sys.executable, "-m", "socialbot", *map(str, arguments)]
    with NamedTemporaryFile("w") as file:
        process = BackgroundCommand(command, file)
        try:
            yield process
        except BaseException:
            print(process.output())
            raise
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def eventually(holds: Callable[[], object], timeout_s: float = PATIENCE_S) -> bool:
    """Wait until ``holds`` returns true, or for ``timeout_s``; return whether it did."""
    deadline = monotonic() + timeout_s
    while not holds():
        if monotonic() > deadline:
            return False
        sleep(0.02)
    return True


def children(pid: int) -> list[int]:
    """Return the child processes of a process."""
    return [each.pid for each in psutil.Process(pid).children()]


@contextmanager
def limited(what: int, limit: int) -> Iterator[None]:
    """A limit of this process in the block: with ``resource.RLIMIT_FSIZE``, writes fail as on a full disk."""
    before = resource.getrlimit(what)
    resource.setrlimit(what, (limit, before[1]))
    try:
        with patch.object(sys, "dont_write_bytecode", True):  # a short write leaves a part
            yield
    finally:
        resource.setrlimit(what, before)


def is_alive(pid: int) -> bool:
    """Return whether there is such a process; one that has ended and waits for its parent to notice is none."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def next_line(process: subprocess.Popen[Any]) -> str:
    """Return the next line that a process prints, without those of Fast DDS; empty if none comes in time."""
    lines: list[str] = []

    def read(pipe: Any) -> None:
        texts = (line.decode() if isinstance(line, bytes) else line for line in iter(pipe.readline, pipe.read(0)))
        lines.append(next((text for text in texts if "RTPS_" not in text), ""))

    reader = Thread(target=read, args=(process.stdout,), daemon=True)
    reader.start()
    reader.join(PATIENCE_S)
    return lines[0] if lines else ""


def cut(bag: Path, out: Path, begin_s: float, end_s: float, *, every: int = 1) -> Path:
    """Copy a part of ``bag`` to a new bag, with the camera calibration. ``every`` 3 keeps one image of three."""
    with open_bag(bag) as source, BagWriter(out) as target:
        images = 0
        for topic, message in source.messages({topic.name: topic.name for topic in source.topics}):
            time_s = (message.stamp - source.start) / 1e9
            is_image = not topic.endswith("camera_info")
            if time_s >= end_s or time_s < (begin_s if is_image else begin_s - CALIBRATION_PERIOD_S):
                continue
            images += is_image
            if not is_image or (images - 1) % every == 0:
                target.write(topic, message, message.stamp)
    return out


def results(folder: Path) -> dict[str, Any]:
    """The results of a run."""
    return msgspec.json.decode((folder / "results.json").read_bytes())


def actions(folder: Path) -> list[tuple[float, str, tuple[str, ...]]]:
    """Actions of a run: seconds, name, arguments."""
    return [(one["t_s"], one["name"], tuple(one["arguments"])) for one in results(folder)["actions"]]
