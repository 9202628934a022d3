"""Processes of a graph: arguments, logs, start, stop, and restart policy."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, Protocol

import msgspec

from socialbot.bridge import environment
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.core.paths import replace_file
from socialbot.core.process import ENDING_SIGNALS, proc_stat, python_command
from socialbot.core.process_guard import guard_child
from socialbot.core.reading import open_file

if TYPE_CHECKING:
    from socialbot.graph.node import Graph

log = logging.getLogger("socialbot.processes")

GRACE_S = 8.0  # time between SIGINT and SIGKILL
ASKED_AGAIN_S = 3.0  # time between the first and the second SIGINT


LOG_TAIL_LINES = 8
DOCUMENTED = frozenset({3, 4, 5, 7})  # exit codes with a documented meaning; any other failure of a node is 6
_ERROR = re.compile(r"^error: (.*(?:\n  remedy: .*)?)", re.MULTILINE)
_TAIL_BYTES = 20_000


class Process(Protocol):
    """A child of this process; a subset of `subprocess.Popen`."""

    @property
    def pid(self) -> int: ...

    def poll(self) -> int | None: ...

    def wait(self, timeout: float | None = None) -> int: ...

    def send_signal(self, sig: int) -> None: ...

    def kill(self) -> None: ...


def environment_of(log_folder: Path) -> dict[str, str]:
    """Return the environment of processes whose logs go to ``log_folder``."""
    inherited = dict(os.environ)
    environment.prepare(inherited, log_folder=log_folder / "ros")
    inherited["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    return inherited


def start_process(
    arguments: list[str], log_path: Path, *, variables: Mapping[str, str] = {}, channel: int | None = None
) -> subprocess.Popen[bytes]:
    """Start ``socialbot *arguments`` as a process that ends with this one.

    ``variables`` extend the environment; ``channel`` is the file descriptor of the supervisor channel.
    """
    inherited = {**environment_of(log_path.parent), **variables}
    if channel is not None:
        inherited[environment.CHANNEL_VARIABLE] = str(channel)
    with opened_log(log_path) as output, blocked_signals():
        process = subprocess.Popen(
            python_command("-m", "socialbot", *until_parent_ends(arguments)),
            env=inherited,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            pass_fds=() if channel is None else (channel,),
        )
    guard_child(process.pid)
    return process


def opened_log(path: Path) -> BinaryIO:
    """Open a log file, to append; without a disk that can be written, output is discarded."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("ab")
    except OSError as error:
        log.warning("%s cannot be written: %s", path, error.strerror)
        return open(os.devnull, "ab")


@dataclass
class _Wait:
    """What Linux counted of one thread of a process at two moments."""

    begun_s: float
    """Wait for a processor (s) up to the first look."""
    periods: int
    """Periods on a processor that had begun when the thread was first seen ready in this one, at ``since``."""
    ran_s: float
    """Time on a processor (s) up to ``since``."""
    since: float


class ProcessorWaits:
    """How long a process has waited for a processor, from the first look on.

    Its threads wait for each other, too: one after the other is ready and waits for a processor. So between two looks,
    the thread that waited longest counts.

    Linux adds a wait to its count when it ends. A wait that goes on is counted here: the time in which a thread was
    ready, began no new period on a processor, and did not run.
    """

    def __init__(self, pid: int, proc: Path = Path("/proc")) -> None:
        self._tasks = proc / str(pid) / "task"
        self._waits: dict[str, _Wait] = {}
        self._counted_s: dict[str, float] = {}
        self._total_s = 0.0

    def total_s(self, now: float) -> float:
        """Look once; return the wait of the process (s). It is 0 where Linux counts none."""
        waits_s = {task.name: self._wait_s(task, now) for task in self._tasks.glob("*")}
        self._total_s += max([0.0, *(wait_s - self._counted_s.get(name, 0.0) for name, wait_s in waits_s.items())])
        self._counted_s = waits_s
        return self._total_s

    def _wait_s(self, task: Path, now: float) -> float:
        try:
            state = proc_stat(task)[0]
            ran_ns, waited_ns, periods = map(int, (task / "schedstat").read_bytes().split())
        except (OSError, ValueError, IndexError):  # the thread has ended
            return 0.0
        ran_s, waited_s = ran_ns / 1e9, waited_ns / 1e9
        wait = self._waits.setdefault(task.name, _Wait(waited_s, periods, ran_s, now))
        if state != "R" or periods != wait.periods:
            wait.periods, wait.ran_s, wait.since = periods, ran_s, now
        return waited_s - wait.begun_s + max(0.0, (now - wait.since) - (ran_s - wait.ran_s))


STARVED_LIMITS = 6  # so many time limits are too many also for a process that waits for a processor


def is_late(silent_s: float, starved_s: float, limit_s: float) -> bool:
    """Whether a process has been silent for too long: for ``starved_s`` of that time, it waited for a processor."""
    return silent_s > STARVED_LIMITS * limit_s or silent_s - starved_s > limit_s


LOOK_S = 0.5


def until_parent_ends(arguments: list[str]) -> list[str]:
    """Return the arguments of a process that ends with this one."""
    return [*arguments, "--parent", str(os.getpid())]


@contextlib.contextmanager
def blocked_signals() -> Iterator[None]:
    """Block signals in children started here, until they install their handlers."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_processes(processes: Mapping[str, Process]) -> dict[str, int]:
    """End processes by SIGINT, after `GRACE_S` by SIGKILL; return their exit codes.

    A node process that had nothing left to do but to leave DDS, and ended itself by SIGALRM, ended with code 0.
    """
    # Twice: a process may lose a signal while it imports a module.
    for grace_s in (ASKED_AGAIN_S, GRACE_S - ASKED_AGAIN_S):
        running = [process for process in processes.values() if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + grace_s
        for process in running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
    for process in processes.values():
        if process.poll() is None:
            process.kill()
    codes = {name: process.wait() for name, process in processes.items()}
    return {name: 0 if code == -signal.SIGALRM else code for name, code in codes.items()}


def how_it_ended(code: int, error: str = "") -> str:
    """Describe an exit code, and the error behind it."""
    if code < 0:
        return f"was ended by signal {-code}"
    return f"ended with exit code {code}" + (f": {error}" if error else "")


def memory_kills() -> int:
    """How many processes Linux has killed for lack of memory, of the computer or of a cgroup; 0 if it does not say."""
    try:
        found = re.search(r"^oom_kill (\d+)$", Path("/proc/vmstat").read_text("ascii"), re.MULTILINE)
    except OSError:
        return 0
    return int(found[1]) if found else 0


def reported_error(log: Path) -> str:
    """Return the error with which a process has ended, on one line: that of its log, or the last line there."""
    lines = [line for line in _end_of(log).splitlines() if line.strip()]
    lines = lines[-LOG_TAIL_LINES:]  # not an error of an earlier start
    errors = _ERROR.findall("\n".join(lines)) or lines
    return errors[-1].replace("\n  remedy: ", "; ").strip() if errors else ""


def _end_of(log: Path) -> str:
    try:
        with open_file(log) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL_BYTES))
            return file.read(_TAIL_BYTES).decode("utf-8", errors="replace")
    except OSError:
        return ""


def write_graph(graph: Graph, folder: Path) -> Path:
    """Write ``graph`` to ``folder``, all of it or nothing; return the file. Raises OSError."""
    from socialbot.graph.files import dump_graph

    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "graph.yaml"
    replace_file(file, dump_graph(graph).encode())
    return file


def processes_of(graph: Graph, *, composed: bool) -> dict[str, list[str]]:
    """The nodes of each process by its name: one process for each node, or a single ``composed`` one."""
    names = [config.name for config in graph.nodes]
    return {graph.name: names} if composed else {name: [name] for name in names}


def node_arguments(graph_file: Path, nodes: list[str], *, sim_time: bool = False) -> list[str]:
    """The arguments of ``socialbot`` to run ``nodes``."""
    return ["node", "--graph", str(graph_file), *(["--sim-time"] if sim_time else []), *nodes]


def log_file(folder: Path, name: str) -> Path:
    """The log file of the process ``name``."""
    return folder / f"{name}.log"


def failure(name: str, code: int, log: Path) -> SocialbotError:
    """Return the error for a failed process, with its exit code and the end of its log."""
    lines = _end_of(log).splitlines()[-LOG_TAIL_LINES:]
    what = "\n    ".join([f"the process {how_it_ended(code)}", *lines])
    error = NodeError(what, where=name, remedy=f"the whole log: {log}")
    if code in DOCUMENTED:
        error.exit_code = code
    return error


_Seconds = Annotated[float, msgspec.Meta(ge=0.01, le=1e6)]


@dataclass(frozen=True)
class RestartPolicy:
    """Restart policy of a supervisor. Times are in s.

    A process that crashes after more than ``longest_s`` restarts at once. After an earlier crash the delay is
    ``first_s``, doubled for each further crash up to ``longest_s``. After more than ``times`` crashes within
    ``within_s`` the supervisor gives up. A node without a report for ``hung_s`` is hung and its process is killed;
    during startup the limit is ``ready_s``. It is never given up for that: messages of strangers can make DDS hang.
    """

    times: Annotated[int, msgspec.Meta(ge=0, le=10**6)] = 5
    within_s: _Seconds = 60.0
    first_s: _Seconds = 0.2
    longest_s: _Seconds = 5.0
    hung_s: _Seconds = 10.0
    ready_s: _Seconds = 60.0


class RestartBackoff:
    """Restart delays of one process. Times are those of a monotonic clock, in s."""

    def __init__(self, policy: RestartPolicy) -> None:
        self._policy = policy
        self._crashes: deque[float] = deque()
        self._started = 0.0
        self._pause_s = 0.0

    def started(self, now: float) -> None:
        self._started = now

    def crashed(self, now: float) -> float | None:
        """Note a crash. Return the delay (s) before the restart; None to give up."""
        policy = self._policy
        self._crashes.append(now)
        while self._crashes[0] < now - policy.within_s:
            self._crashes.popleft()
        return None if len(self._crashes) > policy.times else self.killed(now)

    def killed(self, now: float) -> float:
        """Note the end of a hung process. Return the delay (s) before the restart."""
        policy = self._policy
        lived_long = now - self._started > policy.longest_s
        self._pause_s = 0.0 if lived_long else min(max(policy.first_s, 2 * self._pause_s), policy.longest_s)
        return self._pause_s


def in_time(pause_s: float) -> str:
    """Describe a delay."""
    return f"in {pause_s:.1f} s" if pause_s else "at once"
