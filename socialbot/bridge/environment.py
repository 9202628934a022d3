"""ROS environment: DDS profile, discovery range, logs, keys and rclpy contexts."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import importlib.util
import logging
import os
import re
import secrets
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeVar
from weakref import WeakKeyDictionary

import msgspec

from socialbot.core.errors import GraphError, InstallationError, NodeError, ParameterError
from socialbot.core.installation import installed_version, pip_command
from socialbot.core.paths import read_text, replace_file, user_folder
from socialbot.core.process import halt_thread, proc_stat, skip_cleanup

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.timer import Timer

    from socialbot.bridge.wait_sets import OneThreadExecutor

T = TypeVar("T")

log = logging.getLogger("socialbot.security")

PROFILE = Path(__file__).with_name("dds_profile.xml")
"""Fast DDS profile for one machine, with shared memory for images and without network access."""

WIFI_PROFILE = Path(__file__).with_name("dds_wifi.xml")  # Fast DDS profile for several machines
HIGHEST_DOMAIN = 232
DomainNumber = Annotated[int, msgspec.Meta(ge=0, le=HIGHEST_DOMAIN)]
PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"

SKIP_VARIABLE = "SKIP_DEFAULT_XML_FILE"
"""Variable that keeps Fast DDS from a profile in the working directory, DEFAULT_FASTRTPS_PROFILES.xml, if it is 1."""

KEYS_VARIABLE = "SOCIALBOT_KEYS"
"""Variable with the key folder, and the name of the own key if there are several: FOLDER or FOLDER:NAME."""

OPEN_TOPICS_VARIABLE = "SOCIALBOT_OPEN_TOPICS"
"""Variable with topics of standard types, separated by colons, that need no seal: those of drivers without keys."""

DRIVERS_VARIABLE = "SOCIALBOT_DRIVERS"
"""Variable with the ROS domain of drivers and the topics of their commands: DOMAIN:TOPIC:TOPIC."""

WHEELS: Mapping[str, str] = MappingProxyType(
    {"ros-jazzy-rclpy": "7.1.6", "ros-jazzy-common-interfaces": "5.3.6", "ros-jazzy-rmw-fastrtps-cpp": "8.4.3"}
)
"""Tested versions of the ROS wheels, as in pyproject.toml."""

CHANNEL_VARIABLE = "SOCIALBOT_LIFELINE"
"""Variable of a node process with the file descriptor of the channel to its supervisor."""

DATAGRAM_VARIABLE = "SOCIALBOT_DATAGRAM_BYTES"  # variable with the maximum datagram size in the Wi-Fi profile
PACKET_BYTES, UNBOUNDED_BYTES = 1400, 2**32 - 1

PARTICIPANTS_VARIABLE = "SOCIALBOT_PARTICIPANTS"
"""Variable with the number of DDS participants on another machine that the Wi-Fi profile looks for."""

PARTICIPANTS = 32  # where nobody knows the processes of other machines

_FAST_WRITER = """<data_writer profile_name="{topic}">
  <times>
    <heartbeatPeriod><sec>0</sec><nanosec>20000000</nanosec></heartbeatPeriod>
    <nackSupressionDuration><sec>0</sec><nanosec>30000000</nanosec></nackSupressionDuration>
  </times>
</data_writer>
"""

_UDP_READER = """<data_reader profile_name="{topic}">
  <unicastLocatorList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></unicastLocatorList>
</data_reader>
"""


@dataclass(frozen=True)
class Across:
    """Discovery of other machines: by their addresses, or by a discovery server (address:port).

    At each address up to ``participants`` processes are found where there is no multicast.
    """

    peers: tuple[str, ...] = ()
    server: str = ""
    participants: int = PARTICIPANTS


def prepare(
    environment: MutableMapping[str, str] = os.environ,
    *,
    log_folder: Path | None = None,
    domain: int | None = None,
    across: Across | None = None,
    raw_pictures: bool = False,
) -> None:
    """Set the unset or empty variables of ROS and DDS. Call it before rclpy starts.

    A custom DDS profile is kept.

    Args:
        environment: The variables to change.
        log_folder: Overrides ROS_LOG_DIR.
        domain: Overrides ROS_DOMAIN_ID.
        across: Opens the graph to other machines, with datagrams of one packet.
        raw_pictures: Allow larger datagrams with ``across``, for processes that exchange raw images on one machine.
    """
    if across:
        environment[DATAGRAM_VARIABLE] = str(UNBOUNDED_BYTES if raw_pictures else PACKET_BYTES)
        environment[PARTICIPANTS_VARIABLE] = str(across.participants)
        environment["ROS_STATIC_PEERS"] = ";".join(across.peers)
        environment["ROS_DISCOVERY_SERVER"] = across.server
        # With LOCALHOST and peers Fast DDS opens two sockets and sends every packet through both.
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
    opened = bool(reach(environment))
    datagram_bytes = environment.get(DATAGRAM_VARIABLE) or str(UNBOUNDED_BYTES if opened else PACKET_BYTES)
    environment[DATAGRAM_VARIABLE] = datagram_bytes
    environment[PARTICIPANTS_VARIABLE] = environment.get(PARTICIPANTS_VARIABLE) or str(PARTICIPANTS)
    if environment.get(PROFILE_VARIABLE, "") in ("", str(PROFILE), str(WIFI_PROFILE)):
        environment[PROFILE_VARIABLE] = str(WIFI_PROFILE if opened else PROFILE)
    # Somebody else may have put a profile there, as in /tmp or a folder of theirs, that opens the graph to the network.
    environment[SKIP_VARIABLE] = environment.get(SKIP_VARIABLE) or "1"
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    if log_folder is not None:
        environment["ROS_LOG_DIR"] = str(log_folder)
    elif "ROS_LOG_DIR" not in environment and "ROS_HOME" not in environment:
        environment["ROS_LOG_DIR"] = str(_log_folder())


def _log_folder() -> Path:
    """Return a folder that only this user can change: any user can make one of a known name in /tmp, or a link."""
    name = f"socialbot-ros-log-{os.getuid()}"
    try:
        folder = Path(tempfile.gettempdir()) / name
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
            return folder
        return Path(tempfile.mkdtemp(prefix=f"{name}-"))
    except OSError:  # the disk is full or read-only, so ROS has no log; nobody can prepare a name that is not known
        return Path(tempfile.tempdir or "/tmp") / f"{name}-{secrets.token_hex(8)}"


def own_ros_logs(environment: Mapping[str, str] = os.environ) -> list[Path]:
    """Logs that ROS writes for this process: a stranger can cause a line a second for each subscription."""
    folder = environment.get("ROS_LOG_DIR", "")
    return sorted(Path(folder).glob(f"*_{os.getpid()}_*.log")) if folder else []


def use_topics(
    name: str,
    environment: MutableMapping[str, str] = os.environ,
    *,
    by_udp: Collection[str] = (),
    fresh: Collection[str] = (),
) -> None:
    """Write a DDS profile ``name`` of this process beside its logs, with the settings of its topics.

    Custom profiles are kept. So is the common one if this cannot be written: it has the same addresses. Call this after
    `prepare` and before rclpy starts.

    Args:
        name: Name of the file, without suffix.
        environment: The variables of this process.
        by_udp: Topics that it receives by UDP on one machine. If a process is killed while others write into its shared
            memory, they block for a second; UDP never blocks. Only images are worth that risk.
        fresh: Topics whose messages are soon out of date. On a network, their lost packets are sent again at once.
    """
    profile = environment.get(PROFILE_VARIABLE)
    own = {str(PROFILE): (_UDP_READER, by_udp), str(WIFI_PROFILE): (_FAST_WRITER, fresh)}
    template, topics = own.get(profile or "", ("", ()))
    if profile is None or not topics:
        return
    entries = "".join(template.format(topic=topic) for topic in sorted(set(topics)))
    text = read_text(Path(profile), ParameterError).replace("</profiles>", f"{entries}</profiles>").encode()
    file = Path(environment.get("ROS_LOG_DIR") or _log_folder()) / f"{name}.xml"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, text)
    except OSError:  # the disk is full or read-only
        return
    environment[PROFILE_VARIABLE] = str(file)


def reach(environment: MutableMapping[str, str] = os.environ) -> str:
    """Variables that open this process to other machines; empty if none are set."""
    discovery = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
    open_by = [] if discovery.upper() in ("LOCALHOST", "OFF") else [f"ROS_AUTOMATIC_DISCOVERY_RANGE={discovery}"]
    open_by += [name for name in ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER") if environment.get(name)]
    return ", ".join(open_by)


def has_keys(environment: MutableMapping[str, str] = os.environ) -> bool:
    """Whether messages are sealed."""
    return KEYS_VARIABLE in environment


def warn_if_open(environment: MutableMapping[str, str] = os.environ) -> None:
    """Warn about a graph that is open to the network without keys."""
    if (way := reach(environment)) and not has_keys(environment):
        log.warning("open to the network (%s) without keys: anybody there can command it; see docs/security.md", way)


def ros_domain(environment: Mapping[str, str] = os.environ) -> int:
    """Return the ROS domain. Raises GraphError unless ROS_DOMAIN_ID is a valid one."""
    text = environment.get("ROS_DOMAIN_ID") or "0"
    domain = domain_number(text)
    if domain is None:
        raise GraphError(
            f"{text!r} is not a ROS domain",
            where="ROS_DOMAIN_ID",
            remedy=f"set it to a number from 0 to {HIGHEST_DOMAIN}",
        )
    return domain


def domain_number(text: str) -> int | None:
    """The ROS domain that a text names; None if it names none."""
    number = int(text) if re.fullmatch("[0-9]{1,9}", text) else None
    return None if number is None or number > HIGHEST_DOMAIN else number


FREE_DOMAINS = range(60, 101)
"""ROS domains for isolated runs, below those whose ports the system gives to other programs."""


def free_domain(domains: Sequence[int] = FREE_DOMAINS) -> int:
    """Return an unused one of ``domains``. Raises NodeError when there is none."""
    return next(_unused(domains))


def _unused(domains: Sequence[int]) -> Iterator[int]:
    for domain in domains:
        # Each participant binds the discovery port of its domain.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * domain))
            except OSError:
                continue
        yield domain
    raise NodeError(f"the domains {domains[0]} to {domains[-1]} are all in use", remedy="end other ROS programs")


@contextmanager
def own_domain(
    domain: int | None = None,
    environment: MutableMapping[str, str] = os.environ,
    domains: Sequence[int] = FREE_DOMAINS,
) -> Iterator[int]:
    """Use a ROS domain within the block: ``domain``, or that of ROS_DOMAIN_ID, or else an unused one of ``domains``.

    Nobody else who calls this on the machine gets the same unused domain. Call it before rclpy starts.

    Raises:
        NodeError: All domains are in use.
        GraphError: ROS_DOMAIN_ID is not a domain.
    """
    before = environment.get("ROS_DOMAIN_ID")
    with contextlib.ExitStack() as claim:
        if domain is None:
            unclaimed = (one for one in _unused(domains) if _claimed(one, claim))
            domain = ros_domain(environment) if before else next(unclaimed)
        environment["ROS_DOMAIN_ID"] = str(domain)
        try:
            yield domain
        finally:
            environment.pop("ROS_DOMAIN_ID", None)
            if before is not None:
                environment["ROS_DOMAIN_ID"] = before


def _claimed(domain: int, claim: contextlib.ExitStack) -> bool:
    """Claim an unused domain until ``claim`` closes; return False if another run did, whose nodes may not be up yet.

    Where no disk can be written or has locks, nobody can claim a domain, and an unused one is as good.
    """
    try:
        file = _claim_file(Path(tempfile.gettempdir()) / f"socialbot-domain-{domain}.lock")
    except OSError as error:
        return error.errno in _NO_DISK
    claim.callback(os.close, file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, BlockingIOError)
    return True


_NO_DISK = (errno.ENOENT, errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors of making a file where no folder for temporary files can be written."""


def _claim_file(path: Path) -> int:
    """Open a file that other users may have made: a lock needs no more than reading."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    except FileExistsError:
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    os.fchmod(file, 0o644)
    return file


def require_ros() -> None:
    """Raise InstallationError if ROS 2 is missing or lacks the security asked for; GraphError for an invalid domain."""
    ros_domain()
    if lacks_security():
        raise InstallationError(
            "the wheels of ROS 2 are made without the security of DDS (SROS 2)",
            where=f"{SECURITY_VARIABLE}=true",
            remedy=SECURITY_REMEDY,
        )
    if importlib.util.find_spec("rclpy") is None:
        raise InstallationError(
            "ROS 2 is not installed for this Python",
            remedy=f"{ros_remedy()}; or use --runner inline, which needs no ROS",
        )


SECURITY_VARIABLE = "ROS_SECURITY_ENABLE"
SECURITY_REMEDY = "unset it, make keys (socialbot key new), and keep readers off by a VPN; or use a system ROS"


def wheels_installed() -> bool:
    """Whether ROS 2 comes from wheels of PyPI."""
    return installed_version("ros-rclpy") is not None


def asks_security(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether the security of DDS (SROS 2) is asked for."""
    return environment.get(SECURITY_VARIABLE, "").lower() == "true"


def lacks_security(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether the security of DDS is asked for and not there; the wheels would ignore it with Permissive."""
    return asks_security(environment) and wheels_installed()


def ros_remedy() -> str:
    """Return how to install ROS 2."""
    wheels = pip_command("install", *(f"{wheel}=={version}" for wheel, version in WHEELS.items()))
    return f"on x86-64 Linux: {wheels}; elsewhere: source a ROS 2 Jazzy installation"


POLL_S = 0.05


def wait_for(get: Callable[[], T], timeout_s: float, ended: Callable[[], bool] = lambda: False) -> T:
    """Poll ``get`` until its value is true, until ``ended``, or for ``timeout_s``; return the last value."""
    deadline = time.monotonic() + timeout_s
    while not (value := get()) and not ended() and time.monotonic() < deadline:
        time.sleep(POLL_S)
    return value


SPIN_TIMEOUT_S = 0.5


WITHOUT_LOG_FILES = ("--ros-args", "--disable-external-lib-logs")


def can_log(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether ROS can make a file in its log folder; otherwise, as on a full disk, it would not start."""
    try:
        folder = Path(environment.get("ROS_LOG_DIR") or user_folder("ROS_HOME", ".ros") / "log")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, ParameterError):  # or a user without a home folder
        return False


@contextmanager
def ros_context(args: list[str] | None = None) -> Iterator[Context]:
    """Open an rclpy context without signal handlers. Raises ParameterError for invalid ROS ``args``."""
    require_ros()
    import rclpy
    from rclpy.context import Context
    from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import try_shutdown

    prepare()
    warn_if_open()
    context = Context()
    words = args if can_log() else [*(sys.argv if args is None else args), *WITHOUT_LOG_FILES]
    try:
        rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except (rcl.RCLError, rcl.RCLInvalidROSArgsError, rcl.UnknownROSArgsError) as error:
        if not args:
            raise
        remedy = "write -p NAME:=VALUE, -r FROM:=TO or --params-file FILE"
        raise ParameterError(f"ROS rejects the arguments: {error}", where="--ros-args", remedy=remedy) from error
    try:
        yield context
    finally:
        if not _is_blocked:
            try_shutdown(context=context)


@contextmanager
def spinning_node(name: str, args: list[str] | None = None) -> Iterator[Node]:
    """Open an rclpy node in its own context, spun by a thread. Raises ParameterError for invalid ROS ``args``."""
    with ros_context(args) as context:
        from socialbot.bridge.wait_sets import FilteredNode, OneThreadExecutor

        others = _threads()
        node = FilteredNode(name, context=context, start_parameter_services=False)
        _threads_of[node] = _threads() - others
        executor = OneThreadExecutor(context=context)
        executor.add_node(node)
        thread = threading.Thread(target=spin, args=(executor,), name=name, daemon=True)
        thread.start()
        try:
            yield node
        finally:
            executor.shutdown()
            is_given_up = node not in _threads_of
            thread.join(0.0 if is_given_up else BLOCKED_S)
            if is_given_up or thread.is_alive():
                _note_blocked(name)
            elif not _is_blocked:
                node.destroy_node()


BLOCKED_S = 10.0
"""Time (s) after which an executor that does not end is blocked by DDS."""
_is_blocked = False
HALT_AFTER_S = 10.0
BUSY_LOOKS = 5
"""Number of looks at which a thread runs that does nothing else; others may hold locks of other processes."""
_threads_of: WeakKeyDictionary[Node, frozenset[int]] = WeakKeyDictionary()
"""Threads that were started with a node, mainly those of DDS."""


def _threads() -> frozenset[int]:
    return frozenset(int(path.name) for path in Path("/proc/self/task").glob("*"))


def give_up(node: Node) -> frozenset[int]:
    """Let the block of a `spinning_node` end without waiting for DDS; return the threads of DDS, by native id.

    Those that are still busy after `HALT_AFTER_S` are stopped: they would keep processors busy and take memory without
    end. They may hold locks of the process before, while they make room for a message of gigabytes.
    """
    threads = _threads_of.pop(node)
    later = threading.Timer(HALT_AFTER_S, _halt_busy, (threads,))
    later.daemon = True
    later.start()
    return threads


def _halt_busy(threads: frozenset[int]) -> None:
    for thread in frozenset.intersection(*(_running(threads) for _ in range(BUSY_LOOKS))):
        with contextlib.suppress(OSError):  # it has ended
            halt_thread(thread)


def _running(threads: frozenset[int]) -> frozenset[int]:
    """Those of ``threads`` that run or wait for a processor, a moment later."""
    time.sleep(POLL_S)
    found: set[int] = set()
    for thread in threads:
        with contextlib.suppress(OSError):  # it has ended
            if proc_stat(Path(f"/proc/self/task/{thread}"))[0] == "R":
                found.add(thread)
    return frozenset(found)


def _note_blocked(node: str) -> None:
    """Leave rclpy as it is: all its functions may wait for DDS, which a false packet can block without end."""
    global _is_blocked
    _is_blocked = True
    log.error("%s: DDS does not answer; see docs/attacks.md", node)
    skip_cleanup()


@contextmanager
def executor_of(node: Node) -> Iterator[OneThreadExecutor]:
    """Open an executor of an rclpy node, for the block to spin."""
    from socialbot.bridge.wait_sets import OneThreadExecutor

    executor = OneThreadExecutor(context=node.context)
    executor.add_node(node)
    try:
        yield executor
    finally:
        executor.shutdown()


def spin(executor: OneThreadExecutor) -> None:
    """Spin an executor until it is shut down."""
    from rclpy.executors import ExternalShutdownException

    # Without a timeout an executor on a busy machine may never notice entities that were added as it began to spin.
    with contextlib.suppress(ExternalShutdownException):
        while not executor._is_shutdown:
            executor.spin_once(timeout_sec=SPIN_TIMEOUT_S)


def steady_timer(ros: Node, period_s: float, callback: Callable[[], None], **options: Any) -> Timer:
    """Create a timer of an rclpy node that goes on in the same pace when the system time is set."""
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType

    return ros.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME), **options)


def split_ros_args(arguments: Iterable[str]) -> tuple[list[str], list[str]]:
    """Split off ROS arguments: from each ``--ros-args`` to ``--`` or the end. Returns (ours, ROS)."""
    ours: list[str] = []
    ros: list[str] = []
    for argument in arguments:
        inside = bool(ros) and ros[-1] != "--"
        (ros if inside or argument == "--ros-args" else ours).append(argument)
    return ours, ros
