"""Image transport benchmark: camera, converter, detector and agent, one process per node.

``python -m evaluation.transport`` runs the graph with a fast and with a slow detector. It prints the latency without
the detector, lost frames, and the age of the slow detector's frames.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from evaluation.report import DomainOption, JsonOption, QuickOption, Report, Value, percentile, run
from evaluation.transport_nodes import Answerer, Begin, Camera, IdleDetector, Look
from socialbot.bags.codec import encode, ros_type
from socialbot.bridge import environment
from socialbot.bridge.diagnostics import Connection, publisher_connection
from socialbot.bridge.graph_observer import GraphObserver, await_graph, observe_graph
from socialbot.bridge.qos import publisher_qos
from socialbot.bridge.transport import RclpyTypes, message_class
from socialbot.core.clock import SECOND, WallClock
from socialbot.core.errors import NodeError
from socialbot.core.messages import ActionRequest, Message
from socialbot.graph.node import Graph, NodeConfig
from socialbot.graph.ports import Delivery
from socialbot.runtime.launch import Launch
from socialbot.vision.images import ImageConverter

RATE_HZ = 30.0
PERIOD_MS = 1000 / RATE_HZ
SLOW_S = 0.08
"""Processing time of the slow detector: more than two frame periods."""

LATENCY_LIMIT_MS = 15.0
GRAPH_TIMEOUT_S = 30.0
SETTLE_S = 1.0
"""Delay of the camera, to exclude the start of the processes."""

MOST_EXECUTOR_SHARE = 0.5
ENDPOINTS = 12, 8
"""Subscriptions and publishers of the node with an executor."""

DRAIN_S = 1.0
PATIENCE_S = 10.0
"""Allowed delay of the camera."""


@dataclass(frozen=True)
class Answer:
    """Times (ns) of the agent's decision for a frame, and of its arrival in another process."""

    decided: int
    heard: int


@dataclass
class Cost:
    """Processor time (s) of a node at some times (ns), and its memory, from /diagnostics."""

    samples: list[tuple[int, float]] = field(default_factory=list)
    peak_rss_mb: float = 0.0

    def note(self, now: int, values: dict[str, str]) -> None:
        self.samples.append((now, float(values["cpu_s"])))
        self.peak_rss_mb = float(values["peak_rss_mb"])

    def cpu_share(self, begin: int, end: int) -> float | None:
        """Return the processor share between two times; None for too few samples."""
        within = [sample for sample in self.samples if begin <= sample[0] <= end]
        if len(within) < 2:
            return None
        (first, used_before), *_, (last, used) = within
        return round((used - used_before) / ((last - first) / SECOND), 3)


@dataclass
class Trial:
    """Run of the graph with a detector that takes ``busy_s``, and its results."""

    frames: int
    busy_s: float
    clock: WallClock = field(default_factory=WallClock)
    sent: list[int] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    answers: dict[int, Answer] = field(default_factory=dict)
    costs: dict[str, Cost] = field(default_factory=dict)
    begun: int = 0
    ended: int = 0

    def run(self, folder: Path) -> Trial:
        """Run the graph and collect the results.

        Raises:
            NodeError: The graph fails.
        """
        graph = self.graph(folder)
        topics = {"/agent/actions": ActionRequest}
        with observe_graph(topics, self._hear, self._note) as onlooker, Launch(graph, folder) as launch:
            self._begin(graph, onlooker, launch)
            self._await_pictures(launch, folder / "sent.json")
            self.ended = self.clock.now()
            time.sleep(DRAIN_S)
        self.sent = msgspec.json.decode((folder / "sent.json").read_bytes(), type=list[int])
        self.looks = msgspec.json.decode((folder / "looks.json").read_bytes(), type=list[Look])
        return self

    def overhead_ms(self) -> list[float]:
        """Latency of each frame from stamp to action, without the detector's time."""
        return [(answer.decided - look.stamp - (look.ended - look.began)) / 1e6 for look, answer in self._answered()]

    def heard_ms(self) -> list[float]:
        """Latency of each frame until another process receives the action, without the detector's time."""
        return [(answer.heard - look.stamp - (look.ended - look.began)) / 1e6 for look, answer in self._answered()]

    def arrival_ms(self) -> list[float]:
        """Latency of each frame until the detector begins, while the camera runs."""
        return [(look.began - look.stamp) / 1e6 for look in self._steady()]

    def age_ms(self) -> list[float]:
        """Age of each frame when the detector ends, while the camera runs."""
        return [(look.ended - look.stamp) / 1e6 for look in self._steady()]

    def work_ms(self) -> list[float]:
        return [(look.ended - look.began) / 1e6 for look in self.looks]

    def skipped(self) -> int:
        """Number of sent frames without processing."""
        return len(set(self.sent) - {look.stamp for look in self.looks})

    def nodes(self) -> dict[str, dict[str, Value]]:
        return {
            name: {"peak_rss_mb": cost.peak_rss_mb, "cpu_share": cost.cpu_share(self.begun, self.ended)}
            for name, cost in sorted(self.costs.items())
        }

    def _steady(self) -> list[Look]:
        return [look for look in self.looks if look.began <= self.sent[-1]]

    def _answered(self) -> Iterable[tuple[Look, Answer]]:
        return ((look, self.answers[look.stamp]) for look in self.looks if look.stamp in self.answers)

    def graph(self, folder: Path) -> Graph:
        """Return camera, converter, detector and agent; camera and detector write their records to ``folder``."""
        camera = {"rate_hz": RATE_HZ, "frames": self.frames, "record": str(folder / "sent.json")}
        detector = {"busy_s": self.busy_s, "record": str(folder / "looks.json")}
        return Graph(
            name="transport",
            nodes=(
                NodeConfig("camera", Camera, camera),
                NodeConfig("image_converter", ImageConverter),
                NodeConfig("detector", IdleDetector, detector),
                NodeConfig("agent", Answerer),
            ),
            inputs=frozenset({"/evaluation/begin", "/camera/image_raw/compressed"}),
        )

    def _hear(self, topic: str, message: Message) -> None:
        if isinstance(message, ActionRequest):
            self.answers[int(message.arguments[0])] = Answer(decided=message.stamp, heard=self.clock.now())

    def _note(self, name: str, values: dict[str, str]) -> None:
        self.costs.setdefault(name, Cost()).note(self.clock.now(), values)

    def _begin(self, graph: Graph, onlooker: GraphObserver, launch: Launch) -> None:
        """Wait for all connections, then start the camera."""
        begin = _Topic(onlooker.ros, "/evaluation/begin", Begin)

        def ended() -> bool:
            launch.check()
            return False

        own = [*onlooker.connections(graph), begin.connection(graph)]
        missing = await_graph(onlooker.ros, graph, own, timeout_s=GRAPH_TIMEOUT_S, ended=ended)
        if missing:
            raise NodeError(f"the graph does not stand after {GRAPH_TIMEOUT_S:.0f} s; missing {'; '.join(missing)}")
        time.sleep(SETTLE_S)
        _expect_nobody_else(onlooker.ros, graph)
        self.begun = self.clock.now()
        begin.publish(Begin(stamp=self.begun))

    def _await_pictures(self, launch: Launch, file: Path) -> None:
        deadline = time.monotonic() + self.frames / RATE_HZ + PATIENCE_S
        while not file.exists():
            launch.check()
            if time.monotonic() > deadline:
                raise NodeError("the camera does not come to an end", remedy="the machine is too busy to measure")
            time.sleep(0.1)


def _expect_nobody_else(ros: Any, graph: Graph) -> None:
    known = {ros.get_name(), *(config.name for config in graph.nodes)}
    strangers = sorted(set(ros.get_node_names()) - known)
    if strangers:
        raise NodeError(f"other nodes are in this domain: {', '.join(strangers)}", remedy="choose another --domain")


class _Topic:
    def __init__(self, ros: Any, name: str, kind: type[Message]) -> None:
        self._name = name
        self._types = RclpyTypes()
        self._publisher = ros.create_publisher(message_class(ros_type(kind)), name, publisher_qos(Delivery.EVERY))

    def connection(self, graph: Graph) -> Connection:
        return publisher_connection(graph, self._name, self._publisher)

    def publish(self, message: Message) -> None:
        self._publisher.publish(encode(message, self._types))


def measure(seconds: float, domain: int, *, quick: bool = False) -> Report:
    """Run both trials for ``seconds`` each."""
    environment.prepare(domain=domain)
    report = Report("transport", quick)
    frames = round(seconds * RATE_HZ)
    with tempfile.TemporaryDirectory(prefix="transport-") as folder:
        fast = Trial(frames, busy_s=0.0).run(Path(folder, "fast"))
        slow = Trial(frames, busy_s=SLOW_S).run(Path(folder, "slow"))
    _add_fast(report, fast)
    _add_slow(report, slow)
    _add_executors(report, round(10 * seconds))
    report.tables = {"nodes": fast.nodes(), "nodes_slow": slow.nodes()}
    return report


def _add_fast(report: Report, trial: Trial) -> None:
    add, overhead, heard, arrival = report.add, trial.overhead_ms(), trial.heard_ms(), trial.arrival_ms()
    add("latency_p50_ms", "frame stamp to action without detector time, p50, ms", _ms(overhead, 0.5))
    add("latency_p99_ms", "frame stamp to action without detector time, p99, ms", _ms(overhead, 0.99), LATENCY_LIMIT_MS)
    add("latency_max_ms", "frame stamp to action without detector time, maximum, ms", _ms(overhead, 1.0))
    add("arrival_p50_ms", "frame stamp to detector, p50, ms", _ms(arrival, 0.5))
    add("arrival_p99_ms", "frame stamp to detector, p99, ms", _ms(arrival, 0.99))
    add("heard_p50_ms", "frame stamp to action in another process, p50, ms", _ms(heard, 0.5))
    add("heard_p99_ms", "frame stamp to action in another process, p99, ms", _ms(heard, 0.99))
    add("frames_sent", "frames sent at 30 Hz, 640x480, to a fast detector", len(trial.sent))
    add("frames_lost", "frames lost between camera and detector", trial.skipped(), 0)
    add("actions_missing", "frames seen by the detector without an action", len(trial.looks) - len(trial.answers), 0)


def _add_slow(report: Report, trial: Trial) -> None:
    add, own = report.add, trial.work_ms()
    add("slow_detector_p50_ms", "slow detector: time per frame, p50, ms", _ms(own, 0.5))
    add("slow_detector_max_ms", "slow detector: time per frame, maximum, ms", _ms(own, 1.0))
    add("stale_age_max_ms", "slow detector: age of a processed frame, maximum, ms", _ms(trial.age_ms(), 1.0))
    # The age at the begin of processing is the age at its end less the processing time.
    text = "slow detector: age of a frame without detector time, maximum, ms"
    add("stale_excess_max_ms", text, _ms(trial.arrival_ms(), 1.0), round(PERIOD_MS, 2))
    add(
        "stale_excess_p99_ms",
        "slow detector: age of a frame without detector time, p99, ms",
        _ms(trial.arrival_ms(), 0.99),
    )
    add("stale_dropped", "slow detector: frames dropped", trial.skipped())
    add("stale_processed", "slow detector: frames processed", len(trial.looks))


def _add_executors(report: Report, messages: int) -> None:
    """Compare the executor of a node's process with that of rclpy, by `messages` of each."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge.wait_sets import OneThreadExecutor

    ours_us, rclpy_us = executor_us(OneThreadExecutor, messages), executor_us(SingleThreadedExecutor, messages)
    report.add("executor_us", "processor time for a message between the endpoints of a node, us", round(ours_us, 1))
    report.add("executor_rclpy_us", "the same with the executor of rclpy, us", round(rclpy_us, 1))
    report.add("executor_share", "share of the time of rclpy", round(ours_us / rclpy_us, 2), MOST_EXECUTOR_SHARE)


def executor_us(kind: Callable[..., Any], messages: int) -> float:
    """Processor time (us) for a message to a node with 12 subscriptions and 8 publishers that a ``kind`` spins."""
    from rclpy.node import Node

    heard: list[Any] = []
    string = message_class("std_msgs/msg/String")
    with environment.ros_context() as context:
        node, executor = Node("executor", context=context), kind(context=context)
        executor.add_node(node)
        for number in range(ENDPOINTS[0]):
            node.create_subscription(string, f"/topic_{number}", lambda message: heard.append(message), 10)
        senders = [node.create_publisher(string, f"/topic_{number}", 10) for number in range(ENDPOINTS[1])]
        while not all(each.get_subscription_count() for each in senders):
            executor.spin_once(timeout_sec=0.05)
        begun = time.process_time()
        for number in range(messages):
            senders[number % len(senders)].publish(string(data="word"))
            while len(heard) <= number:
                executor.spin_once(timeout_sec=PATIENCE_S)
        spent = time.process_time() - begun
        executor.shutdown()
        node.destroy_node()
    return 1e6 * spent / messages


def _ms(values: list[float], share: float) -> float | None:
    found = percentile(values, share)
    return None if found is None else round(found, 2)


def main(json: JsonOption = None, quick: QuickOption = False, domain: DomainOption = None) -> None:
    """Measure the way from camera to action: latency, lost and stale frames, memory and processor time."""
    with environment.own_domain(domain) as own:
        measure(8.0 if quick else 30.0, own, quick=quick).finish(json)


if __name__ == "__main__":
    run(main)
