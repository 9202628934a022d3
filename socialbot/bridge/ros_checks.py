"""Checks of ROS 2 and DDS for ``socialbot doctor``.

The round trip sends images between two processes, best effort, as a camera driver does. The processes are
``python -m socialbot.bridge.ros_checks listen`` and ``send``.
"""

from __future__ import annotations

import array
import functools
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

from socialbot.bridge import environment
from socialbot.bridge.driver_domain import driver_domain
from socialbot.bridge.environment import KEYS_VARIABLE, WHEELS, has_keys, spinning_node, wait_for
from socialbot.bridge.shared_memory import stale_locks
from socialbot.bridge.transport import message_class, open_topics, open_transport
from socialbot.core.errors import InstallationError, NodeError, SocialbotError
from socialbot.core.installation import installed_version, pip_command
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.messages import RosMessage
from socialbot.core.process import python_command
from socialbot.core.reading import read_bytes
from socialbot.graph.node import Graph

State = Literal["ok", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """Result of one check: name, state, finding and remedy.

    A warning concerns only some graphs; with an error no graph runs.
    """

    name: str
    state: State
    text: str
    remedy: str = ""


Check = Callable[[], Finding | None]  # one check; it returns None if it does not apply to this computer


GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
"""Variable that the start-up file of the wheels sets together with LD_LIBRARY_PATH."""

TRANSLATED = ("visualization_msgs", "tf2_msgs", "vision_msgs", "hri_msgs")

MB = 1_000_000
SEGMENT_BYTES = 32 * MB  # shared memory of one process (bytes): several images of 0.9 MB in transit
SHARED_MEMORY_BYTES = 8 * SEGMENT_BYTES
RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
GOOD_SHARE = 0.95
LAST_SAFE_DOMAIN = 101  # highest domain whose ports are outside the ephemeral range of Linux


def ros(variables: Mapping[str, str] = os.environ) -> Finding:
    """Check that rclpy can be imported in the expected version."""
    name = "ROS 2"
    if importlib.util.find_spec("rclpy") is None:
        try:
            environment.require_ros()
        except InstallationError as error:
            return Finding(name, "error", error.what, error.remedy or "")
    try:  # in a child process, because mixed libraries may crash it
        _python("-c", "import rclpy, sensor_msgs.msg", timeout_s=60.0)
    except NodeError as error:
        again = pip_command("install", "--force-reinstall", *_pins())
        remedy = f"see the other findings on ROS; or reinstall the wheels: {again}"
        return Finding(name, "error", f"rclpy cannot be imported: {error.what}", remedy)
    found = {wheel: version for wheel in WHEELS if (version := installed_version(wheel)) is not None}
    if not found:
        distribution = variables.get("ROS_DISTRO", "of unknown name")
        if distribution == "jazzy":
            return Finding(name, "ok", "the system's ROS 2 Jazzy")
        return Finding(name, "warning", f"the system's ROS {distribution}", "source /opt/ros/jazzy/setup.bash instead")
    if found != dict(WHEELS):
        listed = ", ".join(f"{wheel} {found.get(wheel, 'missing')}" for wheel in WHEELS)
        return Finding(
            name, "warning", f"other wheels than the tested ones: {listed}", pip_command("install", *_pins())
        )
    return Finding(name, "ok", f"Jazzy from wheels: rclpy {found['ros-jazzy-rclpy']}, Fast DDS, common interfaces")


def library_path(variables: Mapping[str, str] = os.environ, prefix: Path = Path(sys.prefix)) -> Finding | None:
    """Check that the wheels load their own libraries, and none of another installation."""
    name = "library path"
    if not environment.wheels_installed():
        return None
    entries = [Path(entry) for entry in variables.get("LD_LIBRARY_PATH", "").split(os.pathsep) if entry]
    if GUARD not in variables:
        remedy = "install them into a venv (not with --target or --user), and start Python without -S"
        return Finding(name, "error", "the start-up file of the ROS wheels has not run", remedy)
    if prefix / "lib" not in entries:
        text = f"{GUARD} is set, but LD_LIBRARY_PATH does not name the wheels' libraries: the environment was cleaned"
        return Finding(name, "error", text, f"start it with: env -u {GUARD} socialbot ...")
    foreign = [entry for entry in entries if not entry.is_relative_to(prefix) and _holds_ros(entry)]
    if foreign:
        text = f"ROS libraries of another installation come in: {', '.join(map(str, foreign))}"
        return Finding(name, "warning", text, f"start it with: env -u LD_LIBRARY_PATH -u {GUARD} socialbot ...")
    return Finding(name, "ok", "set by the wheels")


def other_ros(variables: Mapping[str, str] = os.environ) -> Finding | None:
    """Check that no second ROS installation is sourced beside the wheels."""
    name = "other ROS"
    remedy = "use a shell that does not source /opt/ros/*/setup.bash (see ~/.bashrc), or a venv without the wheels"
    if not environment.wheels_installed():
        return None
    spec = importlib.util.find_spec("rclpy")
    if spec is not None and spec.origin is not None and not Path(spec.origin).is_relative_to(sys.prefix):
        return Finding(name, "error", f"rclpy is taken from {Path(spec.origin).parent}, not from the wheels", remedy)
    sourced = [each for each in ("ROS_DISTRO", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH") if variables.get(each)]
    if sourced:
        listed = ", ".join(f"{each}={variables[each]}" for each in sourced)
        return Finding(name, "warning", f"sourced beside the wheels: {listed}", remedy)
    return Finding(name, "ok", "none sourced beside the wheels")


def settings(variables: Mapping[str, str] = os.environ) -> Finding:
    """Check the discovery variables of ROS."""
    name = "ROS settings"
    domain = variables.get("ROS_DOMAIN_ID") or "0"
    reach = variables.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
    middleware = variables.get("RMW_IMPLEMENTATION") or "rmw_fastrtps_cpp"
    text = f"domain {domain}, discovery {reach}, {middleware}"
    number = environment.domain_number(domain)
    if number is None:
        return Finding(name, "error", text, "set ROS_DOMAIN_ID to a number from 0 to 101, or unset it")
    if middleware != "rmw_fastrtps_cpp" and environment.wheels_installed():
        return Finding(name, "error", f"{text}, which is not among the wheels", "unset RMW_IMPLEMENTATION")
    if environment.lacks_security(variables):
        lack = f"{text}, with security, which the wheels are made without"
        return Finding(name, "error", lack, environment.SECURITY_REMEDY)
    if number > LAST_SAFE_DOMAIN:
        return Finding(name, "warning", f"{text}: its ports may be taken", "set ROS_DOMAIN_ID to 101 or less")
    if variables.get("ROS_LOCALHOST_ONLY") == "1":
        remedy = "unset it; ROS_AUTOMATIC_DISCOVERY_RANGE has replaced it"
        return Finding(name, "warning", f"{text}, ROS_LOCALHOST_ONLY", remedy)
    return Finding(name, "ok", text)


def strangers(variables: MutableMapping[str, str] = os.environ) -> Finding:
    """Check that a graph which is open to the network is protected by keys."""
    name = "strangers"
    way = environment.reach(variables)
    if has_keys(variables):
        try:
            open_transport(variables)
            unsealed = sorted(open_topics(variables))
            drivers = driver_domain(variables)
        except SocialbotError as error:
            return Finding(name, "error", str(error.what), f"{error.remedy}; socialbot key check")
        reachable = f"open by {way}, so DDS needs a firewall: docs/security.md"
        text = f"messages are sealed; {reachable if way else 'this machine only'}"
        if drivers is not None:
            text += f"; also in domain {drivers.domain}: {', '.join(sorted(drivers.topics))}"
        return Finding(name, "ok", f"{text}; need no seal: {', '.join(unsealed)}" if unsealed else text)
    if way:
        text = f"open to the network ({way}) without keys: anybody there can command the robot"
        remedy = f"make keys and set {KEYS_VARIABLE}: docs/security.md; or keep others off by a firewall or VPN"
        return Finding(name, "warning", text, remedy)
    return Finding(name, "ok", "not open to the network")


NETWORKS = Path("/proc/sys/net/ipv4/conf")


def loopback(folder: Path = NETWORKS) -> Finding | None:
    """Check that Linux drops packets of the network whose target is 127.0.0.1; None if all is well."""
    paths = sorted(path for path in folder.glob("*/route_localnet") if path.parent.name != "lo")
    if not (opened := [path.parent.name for path in paths if path.read_text().strip() != "0"]):
        return None
    text = f"packets of the network can reach 127.0.0.1: route_localnet is set for {', '.join(opened)}"
    settings = " ".join(f"net.ipv4.conf.{name}.route_localnet=0" for name in opened)
    remedy = f"sysctl -w {settings}; if Docker or kube-proxy needs it, a firewall: docs/security.md"
    return Finding("loopback", "warning", text, remedy)


def profile(variables: Mapping[str, str] = os.environ) -> Finding:
    """Check that the active DDS profile reserves enough shared memory for images."""
    name = "DDS profile"
    variable = environment.PROFILE_VARIABLE
    if not variables.get(variable) or Path(variables[variable]) == environment.PROFILE:
        return Finding(name, "ok", "socialbot's own")
    path = Path(variables[variable])
    unset = f"unset {variable}; socialbot then uses its own profile"
    try:
        size = segment_size(path)
    except OSError as error:
        return Finding(name, "error", f"{variable}={variables[variable]} cannot be read: {error.strerror}", unset)
    except (ElementTree.ParseError, ValueError) as error:
        return Finding(name, "error", f"{path} is no DDS profile: {error}", unset)
    if size is None or size < SEGMENT_BYTES:
        lack = "sets no shared-memory segment" if size is None else f"gives shared memory of {size / MB:.1f} MB only"
        text = f"{path} {lack}; best-effort subscribers lose raw images without an error"
        return Finding(
            name, "warning", text, f"set segment_size to {SEGMENT_BYTES} or more in an SHM transport, or {unset}"
        )
    return Finding(name, "ok", f"{path}, with shared memory of {size / MB:.0f} MB")


def segment_size(path: Path) -> int | None:
    """Return the smallest shared-memory segment (bytes) in the profile at ``path``, if it sets one.

    Raises:
        OSError, ElementTree.ParseError, ValueError: The profile cannot be read.
    """
    sizes: list[int] = []
    for element in ElementTree.fromstring(read_bytes(path, TEXT_BYTES)).iter():
        if _tag(element) == "transport_descriptor":
            values = {_tag(child): (child.text or "").strip() for child in element}
            if values.get("type") == "SHM" and "segment_size" in values:
                sizes.append(int(values["segment_size"]))
    return min(sizes, default=None)


def shared_memory(folder: Path = Path("/dev/shm")) -> Finding | None:
    """Check that shared memory is writable and has free space."""
    name = "shared memory"
    if sys.platform != "linux":
        return None
    if not folder.is_dir():
        return Finding(name, "warning", f"there is no {folder}; pictures go by UDP", f"mount a tmpfs on {folder}")
    if not os.access(folder, os.W_OK | os.X_OK):
        remedy = f"mount it writable, and chmod 1777 {folder}"
        return Finding(name, "warning", f"{folder} cannot be written; pictures go by UDP", remedy)
    free = shutil.disk_usage(folder).free
    if free < SHARED_MEMORY_BYTES:
        text = f"{free / MB:.0f} MB free in {folder}; each process takes {SEGMENT_BYTES // MB} MB"
        remedy = "in a container: docker run --shm-size=512m; elsewhere end programs, or remove stale segments"
        return Finding(name, "warning", text, remedy)
    return Finding(name, "ok", f"{free / MB:,.0f} MB free in {folder}")


def stale_memory(folder: Path = Path("/dev/shm")) -> Finding | None:
    """Check for shared memory of killed processes."""
    name = "stale memory"
    if sys.platform != "linux" or not folder.is_dir():
        return None
    stale = list(stale_locks(folder))
    if not stale:
        return Finding(name, "ok", "no shared memory of ended processes")
    segments = [lock.with_name(lock.name[:-3]) for lock in stale]
    size = sum(segment.stat().st_blocks * 512 for segment in segments if segment.exists())
    script = Path(sys.prefix) / "tools" / "fastdds" / "fastdds.py"
    tool = f"{sys.executable} {script}" if script.exists() else "fastdds"
    count = f"{len(stale)} segment{'s' if len(stale) > 1 else ''}"
    text = f"{count} of ended processes hold {size / MB:.1f} MB of {folder}"
    return Finding(name, "warning", text, f"{tool} shm clean")


def receive_buffer(path: Path = Path("/proc/sys/net/core/rmem_max")) -> Finding | None:
    """Check that the receive buffer of a socket can hold one image sent over UDP."""
    name = "UDP buffer"
    if not path.exists():
        return None
    size = int(path.read_text())
    text = f"net.core.rmem_max is {size / MB:.1f} MB"
    if size < RECEIVE_BUFFER_BYTES:
        remedy = f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}; keep it in /etc/sysctl.d/60-socialbot.conf"
        return Finding(name, "warning", f"{text}; raw images from other machines get lost", remedy)
    return Finding(name, "ok", text)


def round_trip() -> Finding | None:
    """Check that images arrive from one process at another."""
    name = "DDS round trip"
    if importlib.util.find_spec("rclpy") is None:
        return None
    try:
        trial = try_round_trip()
    except NodeError as error:
        return Finding(name, "error", error.what, error.remedy or "see the other findings on ROS and DDS")
    text = f"{trial.received} of {trial.sent} pictures of 0.9 MB arrived in another process"
    if trial.received == 0:
        return Finding(name, "error", text, "see the findings on DDS and shared memory; is a firewall on 'lo'?")
    if trial.received < GOOD_SHARE * trial.sent:
        return Finding(name, "warning", text, "see the findings on the DDS profile and shared memory; is it very busy?")
    return Finding(name, "ok", text)


def viewers() -> Finding:
    """List the installed optional message packages of `socialbot translate`."""
    missing = [package for package in TRANSLATED if importlib.util.find_spec(package) is None]
    text = f"publishes {', '.join(each for each in TRANSLATED if each not in missing) or 'none of its packages'}"
    return Finding("translate", "ok", f"{text}; not installed: {', '.join(missing)}" if missing else text)


CHECKS: tuple[Check, ...] = (
    ros, library_path, other_ros, settings, viewers, strangers, loopback, profile, shared_memory, stale_memory,
    receive_buffer, round_trip,
)  # fmt: skip


def _pins() -> list[str]:
    return [f"{wheel}=={version}" for wheel, version in WHEELS.items()]


def _holds_ros(folder: Path) -> bool:
    return any(folder.glob("librcl.so*")) or re.fullmatch(r"ros_.*\.libs", folder.name) is not None


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _python(*arguments: str, timeout_s: float, variables: Mapping[str, str] | None = None) -> str:
    """Output of a Python process. Raises NodeError with the cause of a failure."""
    command = python_command(*arguments)
    try:
        done = subprocess.run(
            command, env=variables, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=timeout_s
        )
    except subprocess.TimeoutExpired as error:
        raise NodeError("the process hangs") from error
    if done.returncode:
        raise NodeError(cause(done.stderr, done.returncode))
    return done.stdout


def cause(errors: str, exit_code: int) -> str:
    """Return the line of ``errors``, the stderr of a process, that best explains its exit."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if not lines:
        return f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    # Of a chain of exceptions, the first is the cause.
    return next((line for line in lines if re.match(r"[\w.]*(Error|Exception)\b", line)), lines[-1])[:LONGEST_CAUSE]


TOPIC = "/socialbot_trial/image"
IMAGES = 30
RATE_HZ = 30.0
WIDTH, HEIGHT = 640, 480
DISCOVERY_S = 8.0
LIMIT_S = 25.0
LONGEST_CAUSE = 300
_SETTLE_S = 0.3


class Trial(NamedTuple):
    """Result of a round trip: the numbers of images sent and received."""

    sent: int
    received: int


def try_round_trip() -> Trial:
    """Send ``IMAGES`` images of 0.9 MB between two processes of this computer, in an unused domain.

    With the security of DDS they use the domain of the graph, as their enclave is for no other.

    Raises:
        NodeError: A process failed.
    """
    of_networks = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "ROS_LOCALHOST_ONLY")
    variables = {name: value for name, value in os.environ.items() if name not in of_networks}
    variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    domain = environment.ros_domain() if environment.asks_security() else environment.free_domain()
    environment.prepare(variables, domain=domain)
    with ThreadPoolExecutor(2) as threads:
        return Trial(*threads.map(functools.partial(_count, variables), ("send", "listen")))


def _count(variables: Mapping[str, str], part: str) -> int:
    """Run a part of the round trip in a process; return the count that it prints."""
    try:
        # Fast DDS logs errors to stdout, too.
        return int(_python("-m", __name__, part, timeout_s=LIMIT_S, variables=variables).split()[-1])
    except NodeError as error:
        raise NodeError(f"cannot {part}: {error.what}") from error


def main(part: str) -> int:
    """Run one part of the round trip; return the number of images."""
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    qos = QoSProfile(depth=IMAGES, reliability=ReliabilityPolicy.BEST_EFFORT)
    received: list[Any] = []
    with spinning_node(f"trial_{part}") as ros:
        if part == "listen":
            ros.create_subscription(Image, TOPIC, lambda image: received.append(image), qos)
            wait_for(lambda: ros.count_publishers(TOPIC), DISCOVERY_S)
            period_s = DISCOVERY_S + IMAGES / RATE_HZ
            wait_for(lambda: len(received) >= IMAGES or not ros.count_publishers(TOPIC), period_s)
            return len(received)
        data = array.array("B", bytes(3 * WIDTH * HEIGHT))
        image = Image(height=HEIGHT, width=WIDTH, encoding="bgr8", step=3 * WIDTH, data=data)
        publisher = ros.create_publisher(Image, TOPIC, qos)
        if not wait_for(publisher.get_subscription_count, DISCOVERY_S):
            return IMAGES
        # Discovery may finish at different times on the two sides.
        time.sleep(_SETTLE_S)
        for _ in range(IMAGES):
            publisher.publish(image)
            time.sleep(1 / RATE_HZ)
        time.sleep(_SETTLE_S)
    return IMAGES


def missing_types(graph: Graph, nodes: Collection[str] | None = None) -> Iterator[tuple[str, InstallationError]]:
    """Yield the topics, services and actions of a graph whose ROS type is not installed, with the error.

    ``nodes`` limits them to those of some nodes, such as the nodes of one machine.
    """
    used: dict[str, str] = {}
    for config in graph.nodes:
        if nodes is None or config.name in nodes:
            topics = {topic: port.message_type for topic, port in (*config.subscriptions, *config.publications)}
            used |= {topic: kind.ros_type for topic, kind in topics.items() if issubclass(kind, RosMessage)}
            used |= {topic: port.interface.name for topic, port in (*config.servers, *config.clients)}
    for topic, name in sorted(used.items()):
        try:
            message_class(name)
        except InstallationError as error:
            yield topic, error


def expect_types(graph: Graph, nodes: Collection[str] | None = None) -> None:
    """Refuse a graph that ROS nodes cannot run. Raises InstallationError for a ROS type that is not installed."""
    for topic, error in missing_types(graph, nodes):
        raise InstallationError(error.what, where=topic, remedy=error.remedy)


if __name__ == "__main__":
    print(main(sys.argv[1]))
