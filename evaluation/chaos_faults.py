"""Random faults: kills, pauses, lost packets, clock changes, a full disk, busy processes."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from evaluation.chaos_checks import Subject
from evaluation.faults_clocks import set_clock
from evaluation.faults_load import busy_processes
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
    """Kind of fault: how it is caused, described, and whether it needs namespaces."""

    cause: Callable[[Fault, Site], None]
    text: Callable[[Fault], str]
    needs_isolation: bool = False


def cause(fault: Fault, site: Site) -> None:
    """Cause a fault, and wait for its end."""
    FAULTS[fault.kind].cause(fault, site)


MOST_KILLS = RestartPolicy().times - 1
"""Most kills of a node in a period of the restart policy, after which a supervisor gives it up, as it should."""


def _kill(fault: Fault, site: Site) -> None:
    kills, now = site.kills.setdefault((fault.subject.name, fault.node), []), time.monotonic()
    kills[:] = [at for at in kills if at > now - RestartPolicy().within_s]
    if len(kills) >= MOST_KILLS:
        return
    kills.append(now)
    if pid := fault.subject.pid(fault.node):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        fault.subject.reported.pop(fault.node, None)


def _pause(fault: Fault, site: Site) -> None:
    if pid := fault.subject.pid(fault.node):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
            time.sleep(fault.seconds)
            os.kill(pid, signal.SIGCONT)


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


def _processes(fault: Fault) -> int:
    return 2 + fault.size % 7


def _percent(fault: Fault) -> int:
    return (5, 20, 50, 100)[fault.size % 4]


def _seconds(fault: Fault) -> int:
    return (-86400, -3600, -2, 0, 2, 3600, 86400)[fault.size % 7]


FAULTS: Mapping[str, Kind] = {
    "kill": Kind(_kill, lambda fault: f"kill of {fault.subject.name}/{fault.node}"),
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
}
