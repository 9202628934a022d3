"""Announce a run of ``socialbot up`` over ROS and in a run lock, and end it on request."""

from __future__ import annotations

import logging
import os
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from socialbot.bridge.diagnostics import machine
from socialbot.bridge.environment import ros_domain
from socialbot.bridge.transport import is_power_of_ten, open_transport
from socialbot.core.clock import WallClock
from socialbot.core.messages import DownRequest, UpState, UpStatus
from socialbot.core.process import proc_stat

UP_TOPIC, DOWN_TOPIC = "/socialbot/up", "/socialbot/down"

ANNOUNCE_PERIOD_S = 1.0
LAST_STATUS_TIMEOUT_S = 2.0

MAX_RUNS = 1000  # maximum number of stored runs, in case of forged run ids
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

log = logging.getLogger("socialbot.up")


class RunAnnouncer:
    """Announce that ``graph`` is up, and call ``on_down`` on a request to end it.

    Leaving the context announces the end of the run, and its error if there is one. ``on_down`` is called in the thread
    that spins ``ros``. ``run`` is the id of the run.
    """

    def __init__(self, ros: Any, graph: str, on_down: Callable[[], None], run: str) -> None:
        self.run = run
        self._graph = graph
        self._on_down = on_down
        self._boot = boot_id()
        self._announced_at = 0.0
        self._asked = False
        self._ended = False
        self._lock = threading.Lock()
        self._duplicates: set[str] = set()
        transport = open_transport()
        self._sender = transport.advertise(ros, UP_TOPIC, UpStatus)
        self._requests = transport.subscribe(ros, DOWN_TOPIC, DownRequest, self._on_request)
        self._statuses = transport.subscribe(ros, UP_TOPIC, UpStatus, self._on_status)

    def __enter__(self) -> RunAnnouncer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        from rclpy.duration import Duration

        self._publish("ended", str(error) if error is not None else "")
        self._sender.publisher.wait_for_all_acked(Duration(seconds=LAST_STATUS_TIMEOUT_S))

    def announce(self) -> None:
        """Publish the status if it is due."""
        now = time.monotonic()
        if now >= self._announced_at + ANNOUNCE_PERIOD_S:
            self._announced_at = now
            self._publish("ending" if self._asked else "up")

    def _on_request(self, request: DownRequest) -> None:
        if request.run != self.run:
            return
        if not self._asked:
            log.warning("asked to end by socialbot down")
        self._asked = True
        self._publish("ending")
        self._on_down()

    def _on_status(self, status: UpStatus) -> None:
        """Log another run with the same nodes once, such as one that was unreachable at the start."""
        same = (status.graph, status.machine, status.state) == (self._graph, machine(), "up")
        if not same or status.run in self._duplicates | {self.run} or len(self._duplicates) >= MAX_RUNS:
            return
        self._duplicates.add(status.run)
        if is_power_of_ten(len(self._duplicates)):
            where = f"here, process {status.pid}" if is_here(status) else "on another computer"
            log.error("%s on %s is up twice, the other %s: end one of them", status.graph, status.machine, where)

    def _publish(self, state: UpState, reason: str = "") -> None:
        status = UpStatus(
            stamp=WallClock().now(),
            run=self.run,
            graph=self._graph,
            machine=machine(),
            boot=self._boot,
            pid=os.getpid(),
            state=state,
            reason=reason,
        )
        with self._lock:
            if not self._ended:  # "ended" is the last status
                self._ended = state == "ended"
                self._sender.publish(status)


class RunStatuses:
    """Last status of each run of ``socialbot up`` in the ROS domain, by run id (``statuses``)."""

    def __init__(self, ros: Any) -> None:
        self.statuses: dict[str, UpStatus] = {}
        self._ros = ros
        transport = open_transport()
        self._sender = transport.advertise(ros, DOWN_TOPIC, DownRequest)
        self._statuses = transport.subscribe(ros, UP_TOPIC, UpStatus, self.note)

    @property
    def incomplete(self) -> bool:
        """Whether a status of a discovered publisher is still missing."""
        live = sum(one.state != "ended" for one in tuple(self.statuses.values()))
        return self._ros.count_publishers(UP_TOPIC) > live

    @property
    def refused(self) -> int:
        """Number of statuses without a valid seal."""
        return self._statuses.refused

    def ask_to_end(self, run: str) -> None:
        """Ask a run to end. Repeat the call: a run that is not connected yet does not receive the request."""
        self._sender.publish(DownRequest(stamp=WallClock().now(), run=run))

    def note(self, status: UpStatus) -> None:
        if status.run in self.statuses or len(self.statuses) < MAX_RUNS:
            self.statuses[status.run] = status


def is_here(status: UpStatus) -> bool:
    """Whether a run is on this computer."""
    return status.boot == boot_id()


def is_gone(status: UpStatus, *, vanished: bool = False) -> bool:
    """Whether a run has ended, by its status or because it ``vanished``. A local run must also have no process."""
    return (vanished or status.state == "ended") and not (is_here(status) and _is_alive(status.pid))


def _is_alive(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        return proc_stat(Path(f"/proc/{pid}"))[0] not in ("Z", "X")
    except OSError:
        return False


def boot_id() -> str:
    """Id of this computer since its last boot."""
    return BOOT_ID.read_text("ascii").strip()


SOCKETS = Path("/proc/net/unix")
_NAME = re.compile(r"@socialbot/up/(\d+)/([\da-f]+)/(\d+)$", re.MULTILINE)


@contextmanager
def run_lock(run: str) -> Iterator[None]:
    """Hold the lock of ``run`` in the ROS domain of this process. The kernel releases it if the process ends."""
    with closing(socket.socket(socket.AF_UNIX)) as lock:
        lock.bind(f"\0socialbot/up/{ros_domain()}/{run}/{os.getpid()}")
        yield


def locked_runs() -> Mapping[str, int]:
    """Process ids of the live runs in this ROS domain and computer, by run id."""
    found = _NAME.findall(SOCKETS.read_text("utf-8", errors="replace"))
    return {run: int(pid) for domain, run, pid in found if int(domain) == ros_domain()}
