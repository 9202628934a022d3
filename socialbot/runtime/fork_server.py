"""Fork server: starts node processes quickly, as forks of a process that has imported their modules.

``python -m socialbot.runtime.fork_server FILE`` imports what every node needs. Then it receives a `Setting` and serves
requests from file descriptor FILE until the connection breaks. The server has no threads, which a fork would lose. It
does not import rclpy, whose libraries start threads, but the modules that rclpy imports first.

Each fork is a child of the requesting process, so it outlives the server and keeps its exit code. This module imports
little, so that `started_early` works beside the other imports of a command.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import inspect
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from socialbot.bridge.environment import CHANNEL_VARIABLE, has_keys
from socialbot.core.decoding import from_json
from socialbot.core.process import python_command, replace_damaged_modules
from socialbot.core.process_guard import guard_child, report_alive
from socialbot.runtime._processes import (
    LOOK_S,
    Process,
    ProcessorWaits,
    blocked_signals,
    environment_of,
    is_late,
    opened_log,
    start_process,
    until_parent_ends,
)

if TYPE_CHECKING:
    from socialbot.graph.node import Graph

log = logging.getLogger("socialbot.fork_server")

ANSWER_S = 15.0
"""Time limit for the imports of the server, and for a fork."""
MAX_SERVERS = 3  # maximum number of server starts; later processes start without a server, as after a timeout
POLL_S = 0.005
MAX_ANSWER_BYTES = 64
MAX_REQUEST_BYTES = 2**17

PRELOADED = (
    "builtin_interfaces.msg",
    "lifecycle_msgs.msg",
    "lifecycle_msgs.srv",
    "rcl_interfaces.msg",
    "rcl_interfaces.srv",
    "rosgraph_msgs.msg",
    "rosidl_parser.definition",
    "sensor_msgs.msg",
    "socialbot.bags.types",
    "socialbot.bridge._node_thread",
    "socialbot.bridge.process",
    "rosidl_generator_py",  # without its generator after `socialbot.bridge`
    "socialbot.graph.files",
    "std_msgs.msg",
    "type_description_interfaces.srv",
    "yaml",
)
"""Modules that every node imports and that do not import rclpy."""

# From the headers of Linux.
PR_SET_NAME = 15
PR_SET_CHILD_SUBREAPER = 36


class Setting(NamedTuple):
    """What a server gets first: the module search ``path``, ``modules`` to import, and changes of its environment.

    A variable without a value is removed.
    """

    path: list[str]
    modules: list[str]
    variables: dict[str, str | None]


class ForkRequest(NamedTuple):
    """Request to fork ``socialbot *arguments`` with a process ``name`` and additional environment ``variables``.

    The file descriptors of the log and of any supervisor channel are attached.
    """

    name: str
    arguments: list[str]
    variables: dict[str, str]


class ForkedProcess:
    """A forked child of this process, with the interface of `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._code: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, or minus the signal that killed it; None while it runs."""
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._code = os.waitstatus_to_exitcode(status)
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit code. Raises subprocess.TimeoutExpired after ``timeout`` s."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            time.sleep(POLL_S)
        return code

    def send_signal(self, sig: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, sig)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class _Server:
    """Server process that is connected to this one, and has no setting yet."""

    def __init__(self) -> None:
        self.variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self.socket.settimeout(ANSWER_S)
            with theirs, blocked_signals():
                self.process = subprocess.Popen(
                    python_command("-m", "socialbot.runtime.fork_server", str(theirs.fileno())),
                    env=self.variables,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                    pass_fds=(theirs.fileno(),),
                )
        except OSError:
            self.socket.close()
            raise

    def set(self, modules: Sequence[str], variables: Mapping[str, str]) -> None:
        """Send the setting: ``variables`` become the environment."""
        changed: dict[str, str | None] = dict.fromkeys(self.variables.keys() - variables.keys())
        changed |= {name: value for name, value in variables.items() if self.variables.get(name) != value}
        self.socket.send(msgspec.json.encode(Setting(list(sys.path), list(modules), changed)))

    def answer(self, *, is_first: bool) -> bytes:
        """Wait for the answer to a request. Raises TimeoutError after `ANSWER_S`.

        For the ``is_first`` server of a graph, time in which it waits for a processor does not count: without it, all
        nodes would import the same. Later, nodes that run may have to be restarted meanwhile.
        """
        waits, begun = ProcessorWaits(self.process.pid), time.monotonic()
        waits.total_s(begun)
        while not wait([self.socket], LOOK_S):
            report_alive()
            now = time.monotonic()
            if is_late(now - begun, waits.total_s(now) if is_first else 0.0, ANSWER_S):
                raise TimeoutError("timed out")
        return self.socket.recv(MAX_ANSWER_BYTES)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.socket.close()


_early: _Server | None = None


@contextmanager
def started_early() -> Iterator[None]:
    """Start a server in the background, which the first `ForkServer` in this block takes."""
    global _early
    with contextlib.suppress(OSError):  # then it is tried again when there is a graph
        _early = _Server() if sys.platform == "linux" else None
    try:
        yield
    finally:
        if _early is not None:
            _early.close()
        _early = None


class ForkServer:
    """Client of a fork server for the nodes of ``graph``, with logs in ``folder``; call `close` at the end.

    Started processes outlive it. Without a working server they start without a fork.
    """

    def __init__(self, graph: Graph, folder: Path) -> None:
        # Modules of users may have side effects on import, such as threads.
        modules = {config.type.__module__ for config in graph.nodes}
        self._modules = sorted(module for module in modules if module.startswith("socialbot."))
        self._folder = folder
        self._servers_left = MAX_SERVERS if sys.platform == "linux" else 0
        self._server: _Server | None = None

    def prepare(self) -> None:
        """Start the server in the background."""
        global _early
        if self._server is not None or not self._servers_left:
            return
        self._servers_left -= 1
        try:
            self._server, _early = _early or _Server(), None
            guard_child(self._server.process.pid)
            self._server.set(self._modules, environment_of(self._folder))
        except OSError as error:
            log.warning("no fork server: %s", error)
            self.close()

    def start(
        self, arguments: list[str], log: Path, *, variables: Mapping[str, str] = {}, channel: int | None = None
    ) -> Process:
        """Start ``socialbot *arguments`` as `start_process` does."""
        self.prepare()
        pid = self._request(arguments, log, variables, channel)
        if pid is not None:
            guard_child(pid)
            return ForkedProcess(pid)
        return start_process(arguments, log, variables=variables, channel=channel)

    @property
    def server_pid(self) -> int | None:
        """The process id of the server, if it runs."""
        return None if self._server is None else self._server.process.pid

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
        self._server = None

    def _request(
        self, arguments: list[str], file: Path, variables: Mapping[str, str], channel: int | None
    ) -> int | None:
        """Return the process id of a fork; None without a working server."""
        if self._server is None:
            return None
        connection = self._server.socket
        request = msgspec.json.encode(ForkRequest(file.stem, until_parent_ends(arguments), dict(variables)))
        with opened_log(file) as output:
            files = [output.fileno(), *([] if channel is None else [channel])]
            try:
                with _adopting_orphans():
                    socket.send_fds(connection, [request], files)
                    if answer := self._server.answer(is_first=self._servers_left == MAX_SERVERS - 1):
                        return int(answer)
                error = "the fork server has stopped"
            except OSError as failure:
                error = str(failure)
                if isinstance(failure, TimeoutError):  # the machine is too busy: another server would be as slow
                    self._servers_left = 0
        log.warning("%s starts without a fork server: %s", file.stem, error)
        self.close()
        return None


@contextmanager
def _adopting_orphans() -> Iterator[None]:
    """Make orphaned descendants children of this process. Raises OSError if the kernel refuses."""
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    if prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "cannot adopt orphans")
    try:
        yield
    finally:
        prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)


def main() -> None:
    """Serve fork requests until the connection breaks."""
    connection = socket.socket(fileno=int(sys.argv[1]))
    replace_damaged_modules()
    for module in PRELOADED:
        importlib.import_module(module)
    from socialbot.__main__ import prepare, run

    prepare("node")
    if not (data := connection.recv(MAX_REQUEST_BYTES)):
        return
    apply(from_json(data, Setting))
    if threading.active_count() > 1 or "rclpy" in sys.modules:
        sys.exit("there are threads, which forks would lose")
    gc.collect()
    gc.freeze()
    if serve(connection):
        run()


def apply(setting: Setting) -> None:
    """Set up this process for the nodes of one graph."""
    sys.path[:] = setting.path
    for name, value in setting.variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    for module in setting.modules:
        importlib.import_module(module)
    if has_keys():
        from socialbot.bags.types import known_types

        known_types()  # of sealed images
    inspect.stack()  # the first call of a process looks at all modules


def serve(connection: socket.socket) -> bool:
    """Fork for each request. Returns True in a prepared fork, and False when the connection breaks."""
    while True:
        data, files, _, _ = socket.recv_fds(connection, MAX_REQUEST_BYTES, 2)
        if not data:
            return False
        request = from_json(data, ForkRequest)
        pid = fork_orphan()
        if pid == 0:
            connection.close()
            prepare_fork(request, files)
            return True
        for file in files:
            os.close(file)
        connection.send(str(pid).encode())


def fork_orphan() -> int:
    """Fork a process that becomes a child of the adopting ancestor. Returns its id; in it, 0."""
    reader, writer = os.pipe()
    between = os.fork()
    if between == 0:
        parent = os.getpid()
        try:
            pid = os.fork()
        except OSError:
            os._exit(1)
        if pid:
            os.write(writer, str(pid).encode())
            os._exit(0)
        os.close(reader)
        os.close(writer)
        while os.getppid() == parent:
            time.sleep(0.001)
        return 0
    os.close(writer)
    os.waitpid(between, 0)
    with open(reader, "rb") as pipe:
        pid = pipe.read()
    if not pid:
        sys.exit("cannot fork")
    return int(pid)


def prepare_fork(request: ForkRequest, files: Sequence[int]) -> None:
    """Give this fork its session, log, environment, arguments and name."""
    os.setsid()
    log_file, *channel = files
    os.dup2(log_file, 1)
    os.dup2(log_file, 2)
    os.close(log_file)
    os.environ.update(request.variables)
    for file in channel:
        os.environ[CHANNEL_VARIABLE] = str(file)
    sys.argv = ["socialbot", *request.arguments]
    ctypes.CDLL(None).prctl(PR_SET_NAME, request.name.encode(), 0, 0, 0)


if __name__ == "__main__":
    main()
