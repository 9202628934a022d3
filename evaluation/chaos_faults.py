"""Faults of `evaluation.chaos`: what they do to running graphs."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from evaluation.chaos_checks import Subject
from evaluation.faults_clocks import set_clock
from evaluation.faults_plan import GUARD, busy_processes, children, process_name
from socialbot.runtime._processes import RestartPolicy

LOSS = """
add table inet chaos
add chain inet chaos arriving {{ type filter hook input priority 0; }}
add rule inet chaos arriving meta l4proto udp {chance}drop
"""


@dataclass(frozen=True)
class Site:
    """Graphs under test; ``isolated`` if network and disks are their own."""

    subjects: Sequence[Subject]
    isolated: bool
    kills: dict[tuple[str, str], list[float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """Fault of a ``kind`` on one graph and node, of a ``size`` and a duration (s)."""

    kind: str
    subject: Subject
    node: str
    size: int
    seconds: float

    @classmethod
    def drawn(cls, kinds: Sequence[str], subjects: Sequence[Subject], chance: random.Random) -> Fault:
        """Draw a fault. The number of draws does not depend on the result."""
        kind, subject = chance.choice(list(kinds)), chance.choice(list(subjects))
        node, size = chance.choice(subject.nodes), chance.randrange(1000)
        return cls(kind, subject, node, size, round(chance.uniform(0.5, 3.0), 2))

    def __str__(self) -> str:
        return FAULTS[self.kind].text(self)


@dataclass(frozen=True)
class Kind:
    """Kind of fault: how it is caused and described.

    Attributes:
        ends_node: Whether the process of the node may end.
        needs_isolation: Whether it needs namespaces of its own.
    """

    cause: Callable[[Fault, Site], None]
    text: Callable[[Fault], str]
    ends_node: bool = False
    needs_isolation: bool = False


def cause(fault: Fault, site: Site) -> None:
    """Cause a fault, and wait for its end."""
    FAULTS[fault.kind].cause(fault, site)


SPARE_BYTES = 1 << 20  # memory left to a node that gets no more

MOST_KILLS = RestartPolicy().times - 1
"""Most kills of a node in a period of the restart policy, after which a supervisor gives it up, as it should."""


def _kill(fault: Fault, site: Site) -> None:
    if _may_end(fault, site):
        _send(signal.SIGKILL, fault.subject.pid(fault.node))
        fault.subject.reported.pop(fault.node, None)


def _may_end(fault: Fault, site: Site) -> bool:
    """Whether the process of the node may end once more; note that it does."""
    kills, now = site.kills.setdefault((fault.subject.name, fault.node), []), time.monotonic()
    kills[:] = [at for at in kills if at > now - RestartPolicy().within_s]
    if len(kills) >= MOST_KILLS:
        return False
    kills.append(now)
    return True


def _send(number: signal.Signals, pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        if pid:
            os.kill(pid, number)


def _pause(fault: Fault, site: Site) -> None:
    _stop(fault.subject.pid(fault.node), fault.seconds)


def _stop(pid: int, seconds: float) -> None:
    _send(signal.SIGSTOP, pid)
    time.sleep(seconds)
    _send(signal.SIGCONT, pid)


def _suspend(fault: Fault, site: Site) -> None:
    _stop(fault.subject.process.pid, _suspended_s(fault))


def _deplete(fault: Fault, site: Site) -> None:
    """Refuse memory to a node. It may end, or make do with what it has."""
    pid = fault.subject.pid(fault.node)
    if not pid or not _may_end(fault, site):
        return
    with contextlib.suppress(OSError):  # it has ended
        used = _data_bytes(pid)
        before = resource.prlimit(pid, resource.RLIMIT_DATA)
        resource.prlimit(pid, resource.RLIMIT_DATA, (used + SPARE_BYTES, before[1]))
        time.sleep(fault.seconds)
        resource.prlimit(pid, resource.RLIMIT_DATA, before)


def _data_bytes(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text("utf-8").splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith("VmData:"))


def _end_helper(name: str) -> Callable[[Fault, Site], None]:
    """Kill a process that helps ``up``."""

    def end(fault: Fault, site: Site) -> None:
        for child in children(fault.subject.process.pid):
            if process_name(child) == name:
                _send(signal.SIGKILL, child)

    return end


def _load(fault: Fault, site: Site) -> None:
    with busy_processes(_processes(fault)):
        time.sleep(2 * fault.seconds)


def _lose(fault: Fault, site: Site) -> None:
    percent = _percent(fault)
    chance = f"numgen random mod 100 < {percent} " if percent < 100 else ""
    subprocess.run(["nft", "-f", "-"], input=LOSS.format(chance=chance), text=True, check=True)
    try:
        time.sleep(2 * fault.seconds)
    finally:
        subprocess.run(["nft", "delete", "table", "inet", "chaos"], check=True)


def _take_down(fault: Fault, site: Site) -> None:
    subprocess.run(["ip", "link", "set", "lo", "down"], check=True)
    try:
        time.sleep(2 * fault.seconds)
    finally:
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)


def _lock_log(fault: Fault, site: Site) -> None:
    """Make the folder of the logs read-only, and kill a node meanwhile."""
    folder = fault.subject.disk / "run" / "log"
    if not folder.exists():
        return
    subprocess.run(["mount", "--bind", folder, folder], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,bind,ro", folder], check=True)
        _kill(fault, site)
        time.sleep(fault.seconds)
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)


def _fill(fault: Fault, site: Site) -> None:
    path = fault.subject.disk / "filling"
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    time.sleep(fault.seconds)
    path.unlink()


def _remove(fault: Fault, site: Site) -> None:
    shutil.rmtree(fault.subject.disk / "run", ignore_errors=True)
    time.sleep(fault.seconds)


def _shift(fault: Fault, site: Site) -> None:
    if fault.subject.clock is not None:
        set_clock(fault.subject.clock, _seconds(fault))


def _suspended_s(fault: Fault) -> float:
    return (fault.seconds, fault.seconds, 5 * fault.seconds)[fault.size % 3]


def _processes(fault: Fault) -> int:
    return 2 + fault.size % 7


def _percent(fault: Fault) -> int:
    return (5, 20, 50, 100)[fault.size % 4]


def _seconds(fault: Fault) -> int:
    return (-86400, -3600, -2, 0, 2, 3600, 86400)[fault.size % 7]


FAULTS: Mapping[str, Kind] = {
    "kill": Kind(_kill, lambda fault: f"kill of {fault.subject.name}/{fault.node}", ends_node=True),
    "pause": Kind(_pause, lambda fault: f"pause of {fault.subject.name}/{fault.node} for {fault.seconds} s"),
    "load": Kind(_load, lambda fault: f"{_processes(fault)} busy processes for {2 * fault.seconds:.1f} s"),
    "loss": Kind(
        _lose,
        lambda fault: f"{_percent(fault)} % of all packets lost for {2 * fault.seconds:.1f} s",
        needs_isolation=True,
    ),
    "full": Kind(_fill, lambda fault: f"disk of {fault.subject.name} full for {fault.seconds} s", needs_isolation=True),
    "removed": Kind(_remove, lambda fault: f"run folder of {fault.subject.name} removed", needs_isolation=True),
    "clock": Kind(_shift, lambda fault: f"clock of {fault.subject.name} set to {_seconds(fault):+d} s"),
    "suspend": Kind(_suspend, lambda fault: f"pause of up of {fault.subject.name} for {_suspended_s(fault):.2f} s"),
    "memory": Kind(
        _deplete,
        lambda fault: f"no memory for {fault.subject.name}/{fault.node} for {fault.seconds} s",
        ends_node=True,
    ),
    "server": Kind(_end_helper("fork server"), lambda fault: f"kill of the fork server of {fault.subject.name}"),
    "guard": Kind(_end_helper(GUARD), lambda fault: f"kill of the guard of {fault.subject.name}"),
    "link": Kind(
        _take_down, lambda fault: f"network interface down for {2 * fault.seconds:.1f} s", needs_isolation=True
    ),
    "log": Kind(
        _lock_log,
        lambda fault: f"logs of {fault.subject.name} read-only for {fault.seconds} s, kill of {fault.node}",
        ends_node=True,
        needs_isolation=True,
    ),
}
