"""The command line run beside an evaluation, with all processes that come of it, and pictures for its camera."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from evaluation.faults_plan import Plan
from socialbot.bags.reader import open_bag
from socialbot.core.errors import NodeError
from socialbot.core.messages import CompressedImage

CORRIDOR = Path(__file__).parents[1] / "data" / "synthetic" / "corridor"
LOOK_S = 0.02
ENDED_S = 20.0


@contextlib.contextmanager
def beside(
    plan: Plan, folder: Path, name: str, *arguments: object, variables: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """``socialbot *arguments`` for as long as the block lasts; what it prints goes to NAME.log in ``folder``.

    ``variables`` are added to its environment.
    """
    own = {"ROS_DOMAIN_ID": str(plan.domain), "SOCIALBOT_FOLDERS": str(plan.folder), **(variables or {})}
    command = [sys.executable, "-m", "socialbot", *map(str, arguments)]
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(command, env={**os.environ, **own}, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(ENDED_S)
        except subprocess.TimeoutExpired:
            kill_all([process.pid])
            process.wait()


def await_(holds: Callable[[], bool], timeout_s: float, lack: str, where: Path) -> float:
    """Waits until ``holds`` does; returns how long it took (s). Raises NodeError when it takes too long."""
    begun = time.monotonic()
    while not holds():
        if time.monotonic() > begun + timeout_s:
            raise NodeError(f"{lack} within {timeout_s:g} s", where=str(where), remedy="see the logs there")
        time.sleep(LOOK_S)
    return time.monotonic() - begun


def descendants(pid: int) -> list[int]:
    """``pid`` and the processes that descend from it."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with contextlib.suppress(OSError):
                # The name of the program, in brackets, may hold anything.
                parents[int(entry.name)] = int((entry / "stat").read_text("utf-8").rpartition(")")[2].split()[1])
    found, fresh = {pid}, {pid}
    while fresh := {child for child, parent in parents.items() if parent in fresh} - found:
        found |= fresh
    return sorted(found)


def kill_all(roots: Sequence[int]) -> int:
    """Kills these processes and all that descend from them, at once; returns when (ns)."""
    doomed = {pid for root in roots for pid in descendants(root)}
    at = time.time_ns()
    for pid in doomed:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return at


def process_name(pid: int) -> str:
    """The node of a process of socialbot, or else its command; empty when it has ended or is none of socialbot's."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
        title = Path(f"/proc/{pid}/comm").read_text("utf-8").strip()
    except OSError:
        return ""
    if "socialbot.runtime.fork_server" in words:
        return "fork server" if title.startswith("python") else title
    arguments = words[words.index("socialbot") + 1 :] if "socialbot" in words else []
    if arguments[:1] == ["node"] and "--parent" in arguments:
        return arguments[arguments.index("--parent") - 1]
    return " ".join(arguments[:2]) if arguments[:1] == ["bag"] else " ".join(arguments[:1])


def write_pictures(folder: Path, numbers: Sequence[int]) -> Path:
    """These pictures of the corridor, in this order, as a folder for a camera."""
    folder.mkdir()
    with open_bag(CORRIDOR) as bag:
        topic = bag.choose_image_topic().name
        pictures = [message for _, message in bag.messages({topic: topic}) if isinstance(message, CompressedImage)]
    for place, number in enumerate(numbers):
        (folder / f"{place:04d}.jpg").write_bytes(pictures[number].data.tobytes())
    return folder
