"""Frames of the local network whose IP target is 127.0.0.1."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.system.running import next_line
from tests.system.two_hosts import WORKSTATION, two_hosts

pytestmark = pytest.mark.ros

RECEIVE = """
import socket
receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind(("127.0.0.1", 7400))
receiver.settimeout(1.0)
print("ready", flush=True)
try:
    print(receiver.recvfrom(100)[1][0])
except TimeoutError:
    print("nothing")
"""
SEND = """
import socket, struct, sys
device, receiver, source = sys.argv[1:]
sender = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
sender.bind((device, 0))
addresses = socket.inet_aton(source) + socket.inet_aton("127.0.0.1")
header = struct.pack("!BBHHHBBH", 0x45, 0, 33, 1, 0, 64, socket.IPPROTO_UDP, 0) + addresses
total = sum(struct.unpack("!10H", header))
checksum = ~((total >> 16) + (total & 0xFFFF)) & 0xFFFF
packet = header[:10] + struct.pack("!H", checksum) + header[12:] + struct.pack("!4H", 7400, 7400, 13, 0) + b"false"
sender.send(bytes.fromhex(receiver.replace(":", "")) + b"\\x02" + bytes(5) + b"\\x08\\x00" + packet)
"""


@pytest.mark.slow
def test_linux_drops_frames_to_the_loopback_address_unless_route_localnet_is_set() -> None:
    """With the setting they arrive at a socket that is bound to 127.0.0.1, so also at a graph of one machine."""
    with two_hosts() as hosts:
        robot, device = hosts.robot, hosts.robot.device
        address = robot.run("cat", f"/sys/class/net/{device}/address").strip()

        def arrives() -> str:
            """The source of a frame that arrives."""
            receiver = robot.start(sys.executable, "-c", RECEIVE, stdout=subprocess.PIPE, text=True)
            assert next_line(receiver) == "ready\n"
            hosts.workstation.run(sys.executable, "-c", SEND, hosts.workstation.device, address, WORKSTATION)
            return receiver.communicate(timeout=60)[0].strip()

        assert arrives() == "nothing"
        for name in ("all", device):
            robot.run("sysctl", "-qw", f"net.ipv4.conf.{name}.route_localnet=1")
            assert arrives() == WORKSTATION
            robot.run("sysctl", "-qw", f"net.ipv4.conf.{name}.route_localnet=0")
