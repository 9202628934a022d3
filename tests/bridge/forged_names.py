"""A program that announces a node and publishers with odd names: ``python -m tests.bridge.forged_names TOPIC KIND``.

It prints ``ready``, and repeats its announcements until it is killed. ``KIND`` is one of `NODES` or
`PUBLISHERS`.
"""

from __future__ import annotations

import itertools
import os
import socket
import sys
import time
from pathlib import Path

from evaluation.rtps_attack import NAMES_PORTS, node_list, ports, publisher
from socialbot.bridge.environment import spinning_node, wait_for

FIRST_DOMAIN_PORT = 7400

NODES: dict[str, list[bytes]] = {
    "node": [b"head", b"\xff\xfe"],
    "controls": [b"head", b"\x1b[2J" + b"x" * 200],
    "many": [b"%d" % number for number in range(1500)],
}
"""Names of nodes, by kind."""

PUBLISHERS: dict[str, tuple[bytes, bytes]] = {
    "topic": (b"rt/\xff\xfe", b"std_msgs::msg::dds_::String_"),
    "topic_controls": (b"rt/\x1b[2J", b"std_msgs::msg::dds_::String_"),
    "type": (b"TOPIC", b"std_msgs::msg::dds_::\xff\xfe_"),
    "other_type": (b"TOPIC", b"std_msgs::msg::dds_::Bool_"),
    "module": (b"TOPIC", b"forged_module::msg::dds_::String_"),
}
"""Name in DDS of the topic of a publisher, and of its type, by kind."""


def names_ports() -> list[int]:
    """Ports of `ros_discovery_info` in use, in all domains: each process of the machine takes the next free one."""
    used = (int(line.split()[1].rpartition(":")[2], 16) for line in Path("/proc/net/udp").read_text().splitlines()[1:])
    return sorted(set(used) & set(range(NAMES_PORTS.start, FIRST_DOMAIN_PORT)))


def main(topic: str, kind: str) -> None:
    """Announce a publisher on ``topic`` under odd names."""
    from std_msgs.msg import String

    domain = int(os.environ["ROS_DOMAIN_ID"])
    with spinning_node("stranger") as ros, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        ros.create_publisher(String, topic, 1)

        def own() -> bytes:
            found = ros.get_publishers_info_by_topic(topic)
            return next((bytes(one.endpoint_gid) for one in found if one.node_name == "stranger"), b"")

        wait_for(own, 60.0)
        endpoint = own()
        print("ready", flush=True)
        for number in itertools.count(1000):
            if kind in NODES:
                packet = node_list(endpoint, NODES[kind], number)
            else:
                name, type_name = PUBLISHERS[kind]
                packet = publisher(endpoint[:12], name.replace(b"TOPIC", b"rt" + topic.encode()), type_name, number)
            for port in (*names_ports(), *ports(domain)):
                sender.sendto(packet, ("127.0.0.1", port))
            time.sleep(0.3)


if __name__ == "__main__":
    main(*sys.argv[1:])
