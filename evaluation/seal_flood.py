"""Cost of invalid seals: ``python -m evaluation.seal_flood [--rate 2000] [--seconds 10] [--repeats 3]``.

A node of its own process hears 20 sentences and 10 images of 640x480 a second from a sender with a key. A stranger
floods it with messages of the right form: sentences whose signature is wrong, seals of images whose signature is
wrong, and images of 4K without a seal. The table shows the processor time of the node, how many messages it refused,
and how late those of the sender were handled.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialbot.bridge.detached_seals import digest, seal_topic
from socialbot.bridge.diagnostics import DiagnosticsSubscriber
from socialbot.bridge.environment import KEYS_VARIABLE, own_domain, spinning_node, wait_for
from socialbot.bridge.keys import load_keys, new_key
from socialbot.bridge.security import Stream
from socialbot.bridge.transport import open_transport
from socialbot.core.clock import SECOND
from socialbot.core.messages import Image, Utterance
from socialbot.graph.node import Node
from socialbot.graph.ports import Delivery, Input, Parameter

SAY, IMAGES = "/speech/say", "/camera/image_raw"
SENTENCES_HZ, IMAGES_HZ = 20, 10
SETTLE_S = 3.0
FLOODS = ("none", "sentences", "seals", "pictures")
TEXTS = "texts"
"""Flood of a whole graph: sealed texts of 200 kB with a wrong signature, on topics that many nodes hear."""
TEXTS_TO = (SAY, "/health", "/waldo/actions", "/humans/bodies/detections", "/head/command")
PICTURES_HZ, TEXTS_HZ, TEXT_BYTES = 30, 20, 200_000
GRAPH = """
name: flooded
inputs: [/speech/say, /camera/image_raw]
nodes:
  hearer: {type: 'evaluation.seal_flood:Hearer', parameters: {file: FILE}}
"""


class Hearer(Node):
    """Writes the topic, the time stamp (ns) and the delay (ns) of each message to a file."""

    said = Input(Utterance, SAY, Delivery.EVERY)
    image = Input(Image, IMAGES, Delivery.NEWEST)
    file = Parameter("", "file of the delays")

    def start(self) -> None:
        self._lines = Path(self.file).open("w", buffering=1)  # noqa: SIM115 - closed with the process

    @said
    def on_said(self, utterance: Utterance) -> None:
        self._note(SAY, utterance.stamp)

    @image
    def on_image(self, image: Image) -> None:
        self._note(IMAGES, image.stamp)

    def _note(self, topic: str, stamp: int) -> None:
        self._lines.write(f"{topic} {stamp} {time.time_ns() - stamp}\n")


def flood(kind: str, rate_hz: float) -> None:
    """Send invalid messages until the process is ended."""
    from sensor_msgs.msg import Image as RosImage
    from std_msgs.msg import String

    with tempfile.TemporaryDirectory() as folder, spinning_node("stranger") as ros:
        new_key("robot", Path(folder))  # the name of the sender, with another key
        keys = load_keys(Path(folder))
        if kind == TEXTS:
            publishers, rate_hz = [ros.create_publisher(String, topic, 2) for topic in TEXTS_TO], TEXTS_HZ
            texts = [Stream(keys, "ROS domain 0", topic).seal(TEXT_BYTES * "x") for topic in TEXTS_TO]
            messages: list[Any] = [String(data=text) for text in texts]
        elif kind == "pictures":
            publishers, rate_hz = [ros.create_publisher(RosImage, IMAGES, 2)], PICTURES_HZ
            size = 3840 * 2160 * 3
            messages = [RosImage(width=3840, height=2160, step=3840 * 3, encoding="bgr8", data=bytes(size))]
        else:
            topic = SAY if kind == "sentences" else seal_topic(IMAGES)
            publishers = [ros.create_publisher(String, topic, 100)]
            text = 88 * "x" if kind == "sentences" else digest(b"an image")
            messages = [String(data=Stream(keys, "ROS domain 0", topic).seal(text))]
        begun, sent = time.monotonic(), 0
        while True:
            for _ in range(round((time.monotonic() - begun) * rate_hz) - sent):
                for publisher, message in zip(publishers, messages, strict=True):
                    publisher.publish(message)
                sent += 1
            time.sleep(0.002)


def processor_s(pid: int) -> float:
    """Processor time of a process so far (s)."""
    values = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Cost:
    """What a flood costs: processor time (share of a core), refused messages a second, and the delays (s) of others."""

    cores: float
    refused_hz: float
    delays: dict[str, list[float]]
    lost: int


def measure(kind: str, rate_hz: float, seconds: float) -> Cost:
    """Run the node, the sender and a flood of one ``kind`` in a domain of their own."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        own, folder = str(stack.enter_context(own_domain(environment={}))), Path(name)
        new_key("robot", folder / "keys")
        (folder / "graph.yaml").write_text(GRAPH.replace("FILE", str(folder / "delays")))
        os.environ["ROS_DOMAIN_ID"] = own
        os.environ[KEYS_VARIABLE] = str(folder / "keys")

        def start(*command: str, **variables: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen([sys.executable, *command], env={**os.environ, **variables})
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return process

        node = start("-m", "socialbot", "node", "--graph", str(folder / "graph.yaml"), "hearer")
        refused: list[tuple[float, int]] = []
        with spinning_node("sender") as ros:
            DiagnosticsSubscriber(
                ros, lambda who, values: refused.append((time.monotonic(), int(values.get("refused", 0))))
            )
            transport = open_transport()
            say, show = transport.advertise(ros, SAY, Utterance), transport.advertise(ros, IMAGES, Image)
            senders = (say.publisher, show.publisher)
            if not wait_for(lambda: all(each.get_subscription_count() for each in senders), 60.0):
                raise RuntimeError("the node does not start")
            if kind != "none":
                start("-m", "evaluation.seal_flood", "--flood", kind, "--rate", str(rate_hz), **{KEYS_VARIABLE: ""})
            pixels = np.zeros((480, 640, 3), np.uint8)

            def send(until: float) -> list[int]:
                stamps = []
                while time.monotonic() < until:
                    for _ in range(SENTENCES_HZ // IMAGES_HZ):
                        stamps.append(time.time_ns())
                        say.publish(Utterance(stamp=stamps[-1], id=str(stamps[-1]), text="word"))
                        time.sleep(1 / SENTENCES_HZ)
                    show.publish(Image.from_bgr(pixels, stamp=time.time_ns(), frame_id="camera"))
                return stamps

            send(time.monotonic() + SETTLE_S)
            spent, begun = processor_s(node.pid), time.monotonic()
            stamps = send(begun + seconds)
            took = time.monotonic() - begun
            spent = processor_s(node.pid) - spent
            send(time.monotonic() + SETTLE_S)  # the last messages arrive, and the diagnostics
            counts = [(at, count) for at, count in refused if at >= begun]
            (first, before), (last, after) = counts[0], counts[-1]
        delays: dict[str, list[float]] = {SAY: [], IMAGES: []}
        heard = set()
        for line in (folder / "delays").read_text().splitlines():
            topic, stamp, delay = line.split()
            heard.add(int(stamp))
            if stamps[0] <= int(stamp) <= stamps[-1]:
                delays[topic].append(int(delay) / SECOND)
    return Cost(spent / took, (after - before) / (last - first), delays, sum(stamp not in heard for stamp in stamps))


def main() -> None:
    """Measure each flood and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=2000.0, help="invalid texts a second")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--flood", choices=(*FLOODS, TEXTS), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.flood:
        flood(options.flood, options.rate)
    print("| flood | cores | refused a second | sentences p50, p99, max (ms) | images p50, p99, max (ms) | lost |")
    print("|---|---|---|---|---|---|")
    for kind in FLOODS:
        runs = [measure(kind, options.rate, options.seconds) for _ in range(options.repeats)]
        best = sorted(runs, key=lambda run: run.cores)[len(runs) // 2]
        shown = (", ".join(f"{1000 * each:.0f}" for each in _spread(best.delays[topic])) for topic in (SAY, IMAGES))
        lost = max(run.lost for run in runs)
        print("|", kind, f"| {best.cores:.2f} | {best.refused_hz:.0f} |", " | ".join(shown), f"| {lost} |", flush=True)


def _spread(values: list[float]) -> tuple[float, ...]:
    return tuple(np.percentile(values, (50, 99, 100))) if values else ()


if __name__ == "__main__":
    main()
