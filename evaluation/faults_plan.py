"""Extent and records of the fault evaluation, and processes of its rows."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import psutil

from socialbot.bags.reader import open_bag
from socialbot.core.errors import NodeError
from socialbot.core.messages import CompressedImage

T = TypeVar("T")


class Skipped(Exception):  # noqa: N818 - it is none
    """Row that this machine cannot measure; the text gives the reason."""


@dataclass(frozen=True)
class Plan:
    """Settings of all rows: ``folder`` for records, ROS ``domain``, and ``tell`` for progress lines.

    With ``quick`` a row only checks that it works, instead of all requirements.
    """

    folder: Path
    domain: int
    tell: Callable[[str], None]
    quick: bool = False

    def of(self, full: T, quick: T) -> T:
        return quick if self.quick else full

    def records(self, name: str) -> Path:
        path = self.folder / name
        path.mkdir(parents=True, exist_ok=False)
        return path


BUSY = """
import os, sys
while os.getppid() == int(sys.argv[1]):
    sum(range(300_000))
"""


@contextmanager
def busy_processes(count: int) -> Iterator[list[int]]:
    """Run ``count`` processes that always use a processor core; yields their ids. They end with this process."""
    started = [
        subprocess.Popen([sys.executable, "-I", "-c", BUSY, str(os.getpid())], stdin=subprocess.DEVNULL)
        for _ in range(count)
    ]
    try:
        yield [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


CORRIDOR = Path(__file__).parents[1] / "data" / "synthetic" / "corridor"
LOOK_S = 0.02
ENDED_S = 20.0


@contextlib.contextmanager
def beside(
    plan: Plan, folder: Path, name: str, *arguments: object, variables: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``socialbot *arguments`` during the block, with its output in NAME.log in ``folder``.

    ``variables`` are added to its environment.
    """
    own = {"ROS_DOMAIN_ID": str(plan.domain), "SOCIALBOT_FOLDERS": str(plan.folder), **(variables or {})}
    command = [sys.executable, "-m", "socialbot", *map(str, arguments)]
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(command, env={**os.environ, **own}, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    try:
        yield process
    finally:
        interrupt(process)


def interrupt(process: subprocess.Popen[Any]) -> None:
    """End a process as Ctrl-C does; kill it with its descendants if it does not end in time."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(ENDED_S)
    except subprocess.TimeoutExpired:
        kill_all([process.pid])
        process.wait()


def await_(holds: Callable[[], bool], timeout_s: float, lack: str, where: Path) -> float:
    """Wait until ``holds`` returns true, and return the time taken (s).

    Raises:
        NodeError: It takes longer than ``timeout_s``.
    """
    begun = time.monotonic()
    while not holds():
        if time.monotonic() > begun + timeout_s:
            raise NodeError(f"{lack} within {timeout_s:g} s", where=str(where), remedy="see the logs there")
        time.sleep(LOOK_S)
    return time.monotonic() - begun


def children(pid: int) -> list[int]:
    """Return the children of ``pid``."""
    try:
        return [process.pid for process in psutil.Process(pid).children()]
    except psutil.NoSuchProcess:
        return []


def descendants(pid: int) -> list[int]:
    """Return ``pid`` and its descendants."""
    try:
        found = psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        found = []
    return sorted([pid, *(process.pid for process in found)])


def cpu_s(pid: int) -> float:
    """Return the processor time (s) of a process; 0 after its end."""
    try:
        user_s, system_s = psutil.Process(pid).cpu_times()[:2]
    except psutil.NoSuchProcess:
        return 0.0
    return user_s + system_s


def kill_all(roots: Sequence[int]) -> int:
    """Kill these processes and their descendants at once; return the time (ns)."""
    doomed = {pid for root in roots for pid in descendants(root)}
    at = time.time_ns()
    for pid in doomed:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return at


GUARD = "guard"
"""Name of the guard of a process."""


def process_name(pid: int) -> str:
    """Return the node of a socialbot process, or else its command; empty for other or ended processes."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
        title = Path(f"/proc/{pid}/comm").read_text("utf-8").strip()
    except OSError:
        return ""
    if any(word.endswith("/_process_guard.py") for word in words):
        return GUARD
    if "socialbot.runtime.fork_server" in words:
        return "fork server" if title.startswith("python") else title
    arguments = words[words.index("socialbot") + 1 :] if "socialbot" in words else []
    if arguments[:1] == ["node"] and "--parent" in arguments:
        return arguments[arguments.index("--parent") - 1]
    return " ".join(arguments[:2]) if arguments[:1] == ["bag"] else " ".join(arguments[:1])


def write_pictures(folder: Path, numbers: Sequence[int]) -> Path:
    """Write images of the corridor, in this order, to a folder for a camera."""
    folder.mkdir()
    with open_bag(CORRIDOR) as bag:
        topic = bag.choose_image_topic().name
        pictures = [message for _, message in bag.messages({topic: topic}) if isinstance(message, CompressedImage)]
    for place, number in enumerate(numbers):
        (folder / f"{place:04d}.jpg").write_bytes(pictures[number].data.tobytes())
    return folder
