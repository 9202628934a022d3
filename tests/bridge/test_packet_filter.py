"""Packets that the kernel drops: a GAP to the lists of nodes would leave a freed message in their queue."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from evaluation.rtps_attack import DATA, GAP, HEADER, HEARTBEAT, submessage
from socialbot.bridge.driver_domain import DriverDomain
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.packet_filter import MAX_SUBMESSAGES, NAMES_PORTS, drop_gaps
from socialbot.bridge.topics import observer_node
from socialbot.graph.node import Graph, NodeConfig
from tests.bridge.hosting import node_hosts
from tests.system.nodes import Talker
from tests.system.running import PATIENCE_S

INFO_TS, PAD = 0x09, 0x01
SO_GET_FILTER = 26
BEGIN = HEADER + bytes(12)
TIME, SAMPLE, BEAT, GONE = (
    submessage(kind, bytes(size)) for kind, size in ((INFO_TS, 8), (DATA, 40), (HEARTBEAT, 28), (GAP, 28))
)
UP_TO_THE_END = struct.pack("<BBH", DATA, 5, 0) + bytes(500)
EMPTY = struct.pack("<BBH", INFO_TS, 3, 0)

ENDLESS_READS = """
import os, socket, sys, time
from std_msgs.msg import String
from evaluation.rtps_attack import NAMES_WRITER, freed
from socialbot.bridge.environment import ros_context
from socialbot.bridge.wait_sets import FilteredNode, OneThreadExecutor
from tests.bridge.forged_names import names_ports
from tests.system.running import eventually
def node(context, name):
    made = FilteredNode(name, context=context, enable_rosout=False, start_parameter_services=False)
    executor = OneThreadExecutor(context=context)
    executor.add_node(made)
    return made
with ros_context() as one, ros_context() as two:
    reader, writer = node(one, "reader"), node(two, "writer")
    writer.create_publisher(String, "/said", 1)
    assert eventually(lambda: any(each.node_name == "writer" for each in reader.get_publishers_info_by_topic("/said")))
    prefix = bytes(reader.get_publishers_info_by_topic("/said")[0].endpoint_gid)[:12]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(1, 40):
            for port in names_ports():
                sender.sendto(freed(prefix + NAMES_WRITER, number), ("127.0.0.1", port))
    for number in range(50):
        writer.create_publisher(String, f"/number_{number}", 1)
    def is_known():
        found = reader.get_publishers_info_by_topic("/number_49")
        return found and found[0].node_name == "writer"
    assert eventually(is_known)
    made = node(two, "third")
    assert eventually(lambda: "third" in reader.get_node_names())
"""

GROWTH = """
import os, random, socket, time
from pathlib import Path
from rclpy.node import Node
from std_msgs.msg import String
from evaluation.rtps_attack import distant_gap, ports
from socialbot.bridge.environment import HALT_AFTER_S, give_up, ros_context, spinning_node
from tests.system.running import eventually
heard, sizes = [], []
def memory_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
with spinning_node("reader") as reader, ros_context() as context:
    writer = Node("writer", context=context, enable_rosout=False, start_parameter_services=False)
    publisher = writer.create_publisher(String, "/said", 10)
    reader.create_subscription(String, "/said", heard.append, 10)
    def hears():
        publisher.publish(String(data="word"))
        return heard
    assert eventually(hears)
    known = bytes(reader.get_publishers_info_by_topic("/said")[0].endpoint_gid)
    before = memory_mb()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for port in ports(int(os.environ["ROS_DOMAIN_ID"])):
            sender.sendto(distant_gap(random.Random(1), known), ("127.0.0.1", port))
    assert eventually(lambda: memory_mb() > before + 50), "one packet takes memory without end"
    give_up(reader)
    for thread in os.listdir("/proc/self/task"):  # as if processors were idle
        os.sched_setscheduler(int(thread), os.SCHED_OTHER, os.sched_param(0))
    time.sleep(HALT_AFTER_S + 2)
    for _ in range(4):
        sizes.append(memory_mb())
        time.sleep(0.5)
    print(sizes, flush=True)
    os._exit(sizes[-1] - sizes[0] > 5)  # DDS would not end
"""

BUSY = """
import hashlib, os
from pathlib import Path
from threading import Thread
from socialbot.bridge import environment
from tests.system.running import eventually
environment.HALT_AFTER_S = 0.1
def works():  # or waits for a processor
    return Path(f"/proc/self/task/{busy.native_id}/stat").read_text().rpartition(")")[2].split()[0] == "R"
with environment.spinning_node("reader") as reader:
    busy = Thread(target=hashlib.pbkdf2_hmac, args=("sha256", b"a", b"b", 2**31 - 1), daemon=True)
    busy.start()
    environment._threads_of[reader] |= {busy.native_id}  # as if DDS had started it
    assert eventually(works)
    environment.give_up(reader)
    os._exit(not eventually(lambda: not works()))
"""


@contextmanager
def receiving() -> Iterator[tuple[socket.socket, socket.socket]]:
    """A socket whose GAPs are dropped, and one that sends to it."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to,
    ):
        one.bind(("127.0.0.1", 0))
        one.setblocking(False)
        drop_gaps(one)
        to.connect(one.getsockname())
        yield one, to


def passes(packet: bytes) -> bool:
    """Whether ``packet`` comes through. The loopback device delivers it at once."""
    with receiving() as (one, sender):
        sender.send(packet)
        try:
            return one.recv(65536) == packet
        except BlockingIOError:
            return False


@pytest.mark.parametrize(
    "packet",
    [
        BEGIN + TIME + SAMPLE + BEAT,
        BEGIN + UP_TO_THE_END,
        BEGIN + EMPTY + SAMPLE,
        BEGIN + submessage(DATA, bytes(40_000)) + BEAT,
        BEGIN + SAMPLE * (MAX_SUBMESSAGES - 1),
        BEGIN,
        b"of another program",
        b"",
    ],
)
def test_packets_without_gaps_pass(packet: bytes):
    assert passes(packet)


@pytest.mark.parametrize(
    "packet",
    [
        BEGIN + GONE,
        BEGIN + TIME + SAMPLE + GONE,
        BEGIN + EMPTY + GONE,
        BEGIN + submessage(PAD, b"") + GONE,
        BEGIN + submessage(DATA, bytes(40_000)) + GONE,
        BEGIN + SAMPLE * MAX_SUBMESSAGES + GONE,
        BEGIN + struct.pack(">BBH", GAP, 0, 28) + bytes(28),
        BEGIN + struct.pack(">BBH", INFO_TS, 0, 8) + bytes(8) + GONE,
        BEGIN + SAMPLE[:-3],
    ],
)
def test_packets_that_may_have_a_gap_are_dropped(packet: bytes):
    assert not passes(packet)


@pytest.mark.ros
def test_lists_of_nodes_that_dds_has_freed_stop_nothing():
    """Else rclpy never returns, with Python's lock held: so this is a process."""
    program = subprocess.run([sys.executable, "-c", ENDLESS_READS], timeout=PATIENCE_S, check=False)
    assert program.returncode == 0


@pytest.mark.ros
def test_each_node_is_protected_from_its_first_moment(monkeypatch: pytest.MonkeyPatch, other_domain: int) -> None:
    """A process that starts while such packets arrive would never end its first call."""
    from rclpy.node import Node

    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))
    found: dict[str, list[bool]] = {}
    create_publisher = Node.create_publisher

    def look(self: Node, *args: Any, **options: Any) -> Any:
        found.setdefault(self.get_name(), filters())
        return create_publisher(self, *args, **options)

    monkeypatch.setattr(Node, "create_publisher", look)
    graph = Graph("g", (NodeConfig("talker", Talker),))
    with node_hosts(graph) as host:
        host("talker")
    with spinning_node("spinning") as ros:
        DriverDomain(other_domain, frozenset()).node(ros)
    with observer_node("observing"):
        pass
    assert len(found) == 4
    assert all(each and all(each) for each in found.values()), found


def filters() -> list[bool]:
    """Whether each socket for lists of nodes of this process has a filter."""
    found = []
    for path in list(Path("/proc/self/fd").iterdir()):
        if not path.is_socket():
            continue
        with socket.socket(fileno=os.dup(int(path.name))) as one:
            if one.family == socket.AF_INET and one.type == socket.SOCK_DGRAM and one.getsockname()[1] in NAMES_PORTS:
                try:
                    one.getsockopt(socket.SOL_SOCKET, SO_GET_FILTER)
                    found.append(False)
                except OSError:  # it has one, with more instructions than the space that was given
                    found.append(True)
    return found


@pytest.mark.ros
def test_what_works_without_end_for_a_given_up_node_is_stopped():
    program = subprocess.run([sys.executable, "-c", BUSY], timeout=PATIENCE_S, check=False)
    assert program.returncode == 0


@pytest.mark.slow
@pytest.mark.ros
def test_a_given_up_node_takes_no_more_memory():
    """Its DDS stores the numbers of a false packet one by one; the process goes on with another participant."""
    program = subprocess.run([sys.executable, "-c", GROWTH], timeout=PATIENCE_S, check=False)
    assert program.returncode == 0
