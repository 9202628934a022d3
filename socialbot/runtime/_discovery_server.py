"""Discovery server of Fast DDS: start it and restart it after a crash."""

from __future__ import annotations

import ipaddress
import logging
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

from socialbot.bridge.environment import PROFILE_VARIABLE
from socialbot.core.errors import InstallationError
from socialbot.runtime._processes import RestartBackoff, RestartPolicy, in_time
from socialbot.runtime.launch import how_it_ended

log = logging.getLogger("socialbot.discovery_server")

PROGRAM = "fast-discovery-server"
ENDED_S = 3.0
EXEC_WITH_PARENT = Path(__file__).with_name("exec_with_parent.py")
"""Script that ends a program with its parent process."""


class DiscoveryServer:
    """Discovery server at ``address`` and ``port``, as a context manager.

    It logs to the file ``output``. Entering raises InstallationError if the program is missing.
    """

    def __init__(self, address: str, port: int, output: Path, policy: RestartPolicy) -> None:
        self._arguments = ("-i", "0", "-l", listening(address), "-p", str(port))
        self._output = output
        self._policy = policy
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = threading.Event()
        self._one_at_a_time = threading.Lock()
        self._keeper = threading.Thread(target=self._keep, name="discovery server", daemon=True)

    @property
    def pid(self) -> int | None:
        """Process id of the running server, else None."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def __enter__(self) -> DiscoveryServer:
        self._program = program()
        self._output.parent.mkdir(parents=True, exist_ok=True)
        self._keeper.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._one_at_a_time:
            self._closed.set()
            if self._process is not None:
                self._process.terminate()
        self._keeper.join(ENDED_S)
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._keeper.join()

    def _keep(self) -> None:
        """Run and restart the server.

        This thread must outlive the server: the kernel kills it together with its parent thread.
        """
        backoff = RestartBackoff(self._policy)
        while (process := self._start()) is not None:
            backoff.started(time.monotonic())
            code = process.wait()
            if self._closed.is_set():
                return
            pause_s = backoff.crashed(time.monotonic())
            if pause_s is None:
                log.error("the discovery server is given up: it %s; its log: %s", how_it_ended(code), self._output)
                return
            log.warning("the discovery server %s; started again %s", how_it_ended(code), in_time(pause_s))
            self._closed.wait(pause_s)

    def _start(self) -> subprocess.Popen[bytes] | None:
        """Start the process, unless the server is closed."""
        with self._one_at_a_time, self._output.open("ab") as output:
            if self._closed.is_set():
                return None
            # Profiles apply to nodes only.
            variables = {name: value for name, value in os.environ.items() if name != PROFILE_VARIABLE}
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(EXEC_WITH_PARENT), str(os.getpid()), self._program, *self._arguments],
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
            return self._process


def listening(address: str) -> str:
    """Return the address to listen on; host names may resolve differently on other machines."""
    try:
        return str(ipaddress.IPv4Address(address))
    except ValueError:
        return "0.0.0.0"


def program() -> str:
    """Return the path of the server. Raises InstallationError when it is missing."""
    beside = str(Path(sys.executable).parent)
    found = shutil.which(PROGRAM, path=os.pathsep.join([beside, os.environ.get("PATH", "")]))
    if found is None:
        raise InstallationError(
            f"there is no {PROGRAM}",
            remedy="it comes with the ROS wheels and with ROS; without it, let machines find each other by `peers`",
        )
    return found
