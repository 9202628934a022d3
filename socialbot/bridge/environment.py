"""Environment of ROS: DDS profile, discovery range, logs, keys, rclpy contexts and stale shared memory."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import logging
import os
import re
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, MutableMapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from socialbot.core.errors import GraphError, InstallationError, ParameterError

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node


SHARED = Path("/dev/shm")

YOUNG_S = 3.0
"""A segment that is as young may not have been locked yet."""

_LOCK = re.compile(r"fastrtps_[\da-z]{16}_el")
"""Of segments only. Ports are taken over by whoever comes next, perhaps in this moment: a process that is refused its
port because somebody tries the lock hears by UDP only, and so no pictures at all."""


def stale_locks(folder: Path = SHARED) -> Iterator[Path]:
    """The lock files in ``folder`` of segments that no process holds."""
    youngest = time.time() - YOUNG_S
    for path in sorted(folder.glob("fastrtps_*_el")):
        with contextlib.suppress(OSError):  # gone by now, or another user's
            if _LOCK.fullmatch(path.name) and path.stat().st_mtime < youngest and is_free(path):
                yield path


def is_free(path: Path) -> bool:
    """Whether no process holds the lock file ``path``; whoever wants to take it in this moment is refused it."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False  # Held, gone by now, or another user's.
    return True


def remove_stale(folder: Path = SHARED) -> int:
    """Removes the segments of dead processes; returns how many."""
    removed = 0
    for lock in stale_locks(folder):
        with contextlib.suppress(OSError):
            lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
            lock.unlink()
            removed += 1
    return removed


PROFILE = Path(__file__).with_name("dds_profile.xml")
"""The Fast DDS profile for nodes of one machine: closed to others, with a shared-memory segment that holds pictures."""

WIFI_PROFILE = Path(__file__).with_name("dds_wifi.xml")
"""The Fast DDS profile for nodes that talk to other machines."""

HIGHEST_DOMAIN = 232
PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"

DATAGRAM_VARIABLE = "SOCIALBOT_DATAGRAM_BYTES"
PACKET_BYTES, UNBOUNDED_BYTES = 1400, 2**32 - 1
"""What `DATAGRAM_VARIABLE`, which the Wi-Fi profile reads, may be: what fits into a packet, or anything."""


_UDP_READER = """<data_reader profile_name="{topic}">
  <unicastLocatorList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></unicastLocatorList>
</data_reader>
"""


@dataclass(frozen=True)
class Across:
    """How nodes find those of other machines: by the addresses of these, or by a discovery server (address:port)."""

    peers: tuple[str, ...] = ()
    server: str = ""


def prepare(
    environment: MutableMapping[str, str] = os.environ,
    *,
    log_folder: Path | None = None,
    domain: int | None = None,
    across: Across | None = None,
    raw_pictures: bool = False,
) -> None:
    """Fills in what is not set, or empty; call it before rclpy starts. What is given by name does override.

    With ``across`` nodes talk to other machines, in messages of one packet each; with ``raw_pictures``, for processes
    that publish such on their own machine, of any size. So they are where the user has opened the graph to others. A
    DDS profile of the user's own is left alone.
    """
    if across:
        environment[DATAGRAM_VARIABLE] = str(UNBOUNDED_BYTES if raw_pictures else PACKET_BYTES)
        environment["ROS_STATIC_PEERS"] = ";".join(across.peers)
        environment["ROS_DISCOVERY_SERVER"] = across.server
        # With LOCALHOST and peers Fast DDS opens two sockets and sends every packet by both.
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
    opened = bool(reach(environment))
    environment[DATAGRAM_VARIABLE] = environment.get(DATAGRAM_VARIABLE) or str(
        UNBOUNDED_BYTES if opened else PACKET_BYTES
    )
    if environment.get(PROFILE_VARIABLE, "") in ("", str(PROFILE), str(WIFI_PROFILE)):
        environment[PROFILE_VARIABLE] = str(WIFI_PROFILE if opened else PROFILE)
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    if log_folder is not None:
        environment["ROS_LOG_DIR"] = str(log_folder)
    elif "ROS_LOG_DIR" not in environment and "ROS_HOME" not in environment:
        environment["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / "socialbot-ros-log")


def read_by_udp(topics: Iterable[str], file: Path, environment: MutableMapping[str, str] = os.environ) -> None:
    """Has readers of ``topics`` in this process take messages by UDP, for which a profile is written to ``file``.

    Call it after `prepare` and before rclpy starts. When a process is killed while somebody puts a message into its
    shared memory, all who do so wait there for a second; UDP waits for nobody. Pictures are worth that risk. Only
    `PROFILE` is changed like this.
    """
    if environment.get(PROFILE_VARIABLE) != str(PROFILE):
        return
    readers = "".join(_UDP_READER.format(topic=topic) for topic in sorted(set(topics)))
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(PROFILE.read_text("utf-8").replace("</profiles>", f"{readers}</profiles>"), "utf-8")
    environment[PROFILE_VARIABLE] = str(file)


def reach(environment: MutableMapping[str, str] = os.environ) -> str:
    """By what this process can be reached from other machines, as far as settings say; empty: by nothing."""
    discovery = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
    open_by = [] if discovery.upper() in ("LOCALHOST", "OFF") else [f"ROS_AUTOMATIC_DISCOVERY_RANGE={discovery}"]
    open_by += [name for name in ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER") if environment.get(name)]
    return ", ".join(open_by)


def check_domain(environment: MutableMapping[str, str] = os.environ) -> None:
    """Raises GraphError when ROS_DOMAIN_ID is no number that ROS can use."""
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdigit() and int(domain) <= HIGHEST_DOMAIN):
        raise GraphError(
            f"no ROS domain: {domain!r}", where="ROS_DOMAIN_ID", remedy=f"set it to a number from 0 to {HIGHEST_DOMAIN}"
        )


def require_ros() -> None:
    """Raises InstallationError when there is no ROS 2 for Python here, GraphError when its domain is none."""
    check_domain()
    if importlib.util.find_spec("rclpy") is None:
        raise InstallationError(
            "ROS 2 is not installed for this Python",
            remedy="on x86-64 Linux: pip install socialbot (brings the ROS wheels); elsewhere: source a ROS 2 Jazzy "
            "installation; or use --runner inline, which needs no ROS",
        )


KEYS_VARIABLE = "SOCIALBOT_KEYS"
"""Names the folder of keys, and one's own among them: FOLDER or FOLDER:NAME."""

log = logging.getLogger("socialbot.security")


def has_keys(environment: MutableMapping[str, str] = os.environ) -> bool:
    """Whether messages are to be sealed."""
    return KEYS_VARIABLE in environment


def warn_if_open(environment: MutableMapping[str, str] = os.environ) -> None:
    """Warns when strangers in the network could command the graph."""
    if (way := reach(environment)) and not has_keys(environment):
        log.warning("open to the network (%s) without keys: anybody there can command it; see docs/security.md", way)


_LOOKS_AGAIN_S = 0.5
"""So long an executor waits at most until it asks its node again what there is to wait for."""


@contextmanager
def ros_context(args: list[str] | None = None) -> Iterator[Context]:
    """A context of its own, with signals left to the caller. Raises ParameterError for ``args`` that ROS refuses."""
    require_ros()
    import rclpy
    from rclpy.context import Context
    from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import try_shutdown

    prepare()
    warn_if_open()
    context = Context()
    try:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except (rcl.RCLError, rcl.RCLInvalidROSArgsError, rcl.UnknownROSArgsError) as error:
        if not args:
            raise
        remedy = "write -p NAME:=VALUE, -r FROM:=TO or --params-file FILE"
        raise ParameterError(f"ROS cannot use them: {error}", where="--ros-args", remedy=remedy) from error
    try:
        yield context
    finally:
        try_shutdown(context=context)


@contextmanager
def spinning_node(name: str, args: list[str] | None = None) -> Iterator[Node]:
    """A node of its own, without parameters to set, whose callbacks run in a thread.

    Raises ParameterError for ``args`` that ROS refuses.
    """
    require_ros()
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    with ros_context(args) as context:
        node = Node(name, context=context, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        ended = threading.Event()
        thread = threading.Thread(target=_spin, args=(executor, ended), name=name, daemon=True)
        thread.start()
        try:
            yield node
        finally:
            ended.set()
            executor.shutdown()
            thread.join(2.0)
            node.destroy_node()


def _spin(executor: SingleThreadedExecutor, ended: threading.Event) -> None:
    from rclpy.executors import ExternalShutdownException

    # On a busy machine an executor may sleep through what was added to its node as it began to spin, for ever.
    try:
        while not ended.is_set():
            executor.spin_once(timeout_sec=_LOOKS_AGAIN_S)
    except ExternalShutdownException:
        return


BEGIN, END = "--ros-args", "--"


def divided(arguments: Iterable[str]) -> tuple[list[str], list[str]]:
    """The arguments that are ours, and those for ROS: from each ``--ros-args`` to ``--`` or the end."""
    ours: list[str] = []
    ros: list[str] = []
    for argument in arguments:
        inside = bool(ros) and ros[-1] != END
        (ros if inside or argument == BEGIN else ours).append(argument)
    return ours, ros
