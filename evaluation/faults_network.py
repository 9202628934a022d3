"""Rows of the network: clear, lossy, jitter, bursts, narrow, subnets, server and three machines."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

from evaluation.faults_plan import Plan
from evaluation.faults_scene import ACTIONS, ARRIVED, DETECTIONS, GREETING, HEALTH, TAKEN, Scene, scene, scene_over
from evaluation.faults_watch import DIAGNOSTICS, Heard
from evaluation.hosts import ROBOT, SECOND_ROBOT, WORKSTATION, N, routed_hosts, switched_hosts
from evaluation.report import Report, percentile
from evaluation.switch import Quality
from socialbot.core.clock import SECOND

MS = 1e6
MOST_OVERHEAD_MS = 40.0
MOST_ROBOT_SHARE = 0.30
MOST_LOST_SHARE = 0.05
MOST_FRAME_P99_MS = 250.0
MOST_BLOCKED_MS = 10.0
"""Requirements of the figures."""

LINK_MBIT_S, LOST_PERCENT = 20.0, 5
STILL_COMING_S = 1.5
"""Longest delivery time of earlier messages; diagnostics come once a second."""


@dataclass(frozen=True)
class Frames:
    """Stamps of the captured frames, and the arrival time (ns) of each arrived one."""

    taken: tuple[int, ...]
    came: Mapping[int, int]

    @property
    def arrived(self) -> int:
        return len(self.came)

    @property
    def lost_share(self) -> float:
        return 1 - len(self.came) / len(self.taken) if self.taken else 1.0

    def ages_ms(self) -> list[float]:
        return [(at - stamp) / MS for stamp, at in self.came.items()]


def frames(taken: Iterable[Heard], came: Iterable[Heard], begin: int, end: int) -> Frames:
    """Return the frames captured from ``begin`` until ``end`` (ns); the first arrival of each counts."""
    stamps = tuple(sorted({one.stamp for one in taken if begin <= one.stamp < end}))
    first: dict[int, int] = {}
    for one in came:
        first[one.stamp] = min(one.at, first.get(one.stamp, one.at))
    return Frames(stamps, {stamp: first[stamp] for stamp in stamps if stamp in first})


def overheads_ms(acted: Mapping[int, int], there: Mapping[int, int], seen: Mapping[int, int]) -> list[float]:
    """Return the latency of each action without the detector: from frame to image, and from detection to action.

    All arguments map the stamp of a frame (ns) to the time (ns) of the action, the image and the detection.
    """
    both = acted.keys() & there.keys() & seen.keys()
    return [(acted[stamp] - stamp - max(0, seen[stamp] - there[stamp])) / MS for stamp in both]


def highest(told: Iterable[Heard], figure: str, begin: int, end: int) -> dict[str, float]:
    """Return the maximum of ``figure`` on /diagnostics by node from ``begin`` until ``end`` (ns)."""
    most: dict[str, float] = {}
    for one in told:
        if begin <= one.at < end and figure in one.said:
            node = str(one.said["node"])
            most[node] = max(most.get(node, 0.0), float(one.said[figure]))
    return most


@dataclass(frozen=True)
class Stretch:
    """Measurements of one interval."""

    frames: Frames
    answered: Frames
    overheads_ms: list[float]
    robot_share: float
    publish_ms: dict[str, float]
    blocked_ms: dict[str, float]
    detector_p99_ms: float


def measure(scene: Scene[N], seconds: float) -> Stretch:
    """Measure for ``seconds``."""
    cpu_s, clock_s, begin = scene.cpu_s("robot"), time.monotonic(), time.time_ns()
    time.sleep(seconds)
    share = (scene.cpu_s("robot") - cpu_s) / (time.monotonic() - clock_s)
    end = time.time_ns()
    time.sleep(STILL_COMING_S)
    taken, told = scene.heard("robot", TAKEN), scene.heard("robot", DIAGNOSTICS)
    came = frames(taken, scene.heard("workstation", ARRIVED), begin, end)
    seen = frames(taken, scene.heard("workstation", DETECTIONS), begin, end)
    # The argument of an answer is the stamp of its frame.
    answers = [Heard(one.at, one.topic, one.said["arguments"][0]) for one in scene.heard("robot", ACTIONS)]
    acted = frames(taken, answers, begin, end)
    busy = [one.said["call_p99_ms"] for one in told if one.said.get("node") == "person_detector" and "pid" in one.said]
    return Stretch(
        came,
        acted,
        overheads_ms(acted.came, came.came, seen.came),
        share,
        highest(told, "publish_max_ms", begin, end),
        highest(told, "publish_blocked_max_ms", begin, end),
        float(busy[-1]) if busy else 0.0,
    )


def clear(report: Report, plan: Plan) -> str:
    """Measure on an unlimited link."""
    with scene(plan.records("clear")) as here, here.up("robot"), here.up("workstation"):
        here.await_greeting()
        plan.tell("clear: the robot has greeted")
        time.sleep(plan.of(5.0, 2.0))
        stretch = measure(here, plan.of(60.0, 10.0))
    frames, answered = stretch.frames, stretch.answered.ages_ms()
    overhead = percentile(stretch.overheads_ms, 0.99)
    report.add("clear_frames", "clear: captured frames", len(frames.taken))
    report.add("clear_frames_lost", "clear: lost frames", len(frames.taken) - frames.arrived, 0)
    report.add("clear_frame_p99_ms", "clear: frame to workstation, p99, ms", _round(percentile(frames.ages_ms(), 0.99)))
    report.add("clear_looked_at", "clear: processed frames with an action", len(answered))
    report.add("clear_detector_p99_ms", "clear: detector time per frame, p99, ms", stretch.detector_p99_ms)
    report.add(
        "clear_action_p50_ms", "clear: frame to action at the robot, median, ms", _round(percentile(answered, 0.5))
    )
    report.add(
        "clear_action_p99_ms", "clear: frame to action at the robot, p99, ms", _round(percentile(answered, 0.99))
    )
    report.add(
        "clear_overhead_p99_ms",
        "clear: frame to action without detector time, p99, ms",
        _round(overhead),
        MOST_OVERHEAD_MS,
    )
    report.add(
        "clear_robot_share",
        "clear: processor time on the robot, share of a core",
        round(stretch.robot_share, 3),
        MOST_ROBOT_SHARE,
    )
    return (
        f"{frames.arrived} of {len(frames.taken)} frames; action within the detector's time + {_text(overhead)} ms "
        f"(p99); robot {stretch.robot_share:.0%} of a core"
    )


def lossy(report: Report, plan: Plan) -> str:
    """Measure on a slow link with packet loss."""
    with scene(plan.records("lossy")) as here, here.up("robot"), here.up("workstation"):
        here.await_greeting()
        here.hosts.limit(LINK_MBIT_S)
        here.hosts.lose(LOST_PERCENT)
        plan.tell(f"lossy: {LINK_MBIT_S:g} Mbit/s and {LOST_PERCENT} % lost from now on")
        stretch = measure(here, plan.of(60.0, 10.0))
    frames = stretch.frames
    late_ms = percentile(frames.ages_ms(), 0.99)
    node, blocked_ms = _most(stretch.blocked_ms)
    slowest, publish_ms = _most(stretch.publish_ms)
    report.add("lossy_frames", "lossy: captured frames", len(frames.taken))
    report.add(
        "lossy_lost_share",
        "lossy: share of lost frames",
        round(frames.lost_share, 4),
        MOST_LOST_SHARE,
    )
    report.add("lossy_frame_p99_ms", "lossy: frame to workstation, p99, ms", _round(late_ms), MOST_FRAME_P99_MS)
    report.add(
        "lossy_blocked_max_ms",
        f"lossy: longest block of a node by publishing, ms ({node})",
        _round(blocked_ms),
        MOST_BLOCKED_MS,
    )
    report.add(
        "lossy_publish_max_ms",
        f"lossy: longest publishing call in wall time, ms ({slowest})",
        _round(publish_ms),
    )
    action_ms = percentile(stretch.answered.ages_ms(), 0.99)
    report.add("lossy_action_p99_ms", "lossy: frame to action at the robot, p99, ms", _round(action_ms))
    return (
        f"{frames.arrived} of {len(frames.taken)} frames ({1 - frames.lost_share:.1%}), p99 {_text(late_ms)} ms; "
        f"no publisher blocked for more than {_text(blocked_ms, 1)} ms"
    )


def _round(value: float | None) -> float | None:
    return None if value is None else round(value, 1)


def _text(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _most(told: Mapping[str, float]) -> tuple[str, float | None]:
    return max(told.items(), key=lambda one: one[1], default=("nobody told", None))


JITTER = Quality(delay_ms=40, jitter_ms=30)
BURSTS = Quality(loss=0.2, burst=5)
NARROW, NARROW_S = Quality(mbit_s=1.0, queue_ms=200), 10.0
SMALL_PACKETS = 1280
CUT_S = 5.0
BACK_S = 3.0


@dataclass(frozen=True)
class Limits:
    """Requirements of a row: most frames lost, and the latency that 99 % of the others stay below."""

    lost: float
    late_ms: float


def jitter(report: Report, plan: Plan) -> str:
    """Measure on a link that delays packets by 10 to 70 ms, so that they overtake each other."""
    with scene_over(switched_hosts(ROBOT, WORKSTATION), plan.records("jitter")) as here, _up(here):
        here.hosts.set(JITTER)
        return _judge(report, plan, here, "jitter", Limits(0.05, 250.0))


def bursts(report: Report, plan: Plan) -> str:
    """Measure on a link that loses a fifth of the packets, five after one another."""
    with scene_over(switched_hosts(ROBOT, WORKSTATION), plan.records("bursts")) as here, _up(here):
        here.hosts.set(BURSTS)
        return _judge(report, plan, here, "bursts", Limits(0.5, 1000.0))


def narrow(report: Report, plan: Plan) -> str:
    """Measure while the link carries 1 Mbit/s, and how soon images are there as before."""
    with scene_over(switched_hosts(ROBOT, WORKSTATION), plan.records("narrow")) as here, _up(here):
        here.hosts.set(NARROW)
        said = _judge(report, plan, here, "narrow", Limits(0.97, 2000.0), NARROW_S)
        here.hosts.set(Quality())
        begin = time.time_ns()
        time.sleep(BACK_S + STILL_COMING_S)
        came = frames(here.heard("robot", TAKEN), here.heard("workstation", ARRIVED), begin, time.time_ns())
        soon = [at for stamp, at in came.came.items() if at - stamp < SECOND // 4]
        back_s = (min(soon) - begin) / SECOND if soon else None
    report.add("narrow_back_s", "narrow: first image of less than 0.25 s afterwards, s", back_s, BACK_S)
    return f"{said}; images are new again after {'-' if back_s is None else f'{back_s:.2f}'} s"


def subnets(report: Report, plan: Plan) -> str:
    """Measure between two subnets, with a router whose other link takes small packets only."""
    with scene_over(routed_hosts(mtu=SMALL_PACKETS), plan.records("subnets")) as here, _up(here):
        return _judge(report, plan, here, "subnets", Limits(0.01, 250.0))


def server(report: Report, plan: Plan) -> str:
    """Measure between two subnets whose machines ask a discovery server."""
    with scene_over(routed_hosts(), plan.records("server"), discovery="{server: robot}") as here, _up(here):
        return _judge(report, plan, here, "server", Limits(0.01, 250.0))


def three(report: Report, plan: Plan) -> str:
    """Measure with a second robot that speaks, and cut that off for a while."""
    network = switched_hosts(ROBOT, WORKSTATION, SECOND_ROBOT)
    with scene_over(network, plan.records("three"), speaker="second") as here, _up(here):
        here.hosts.machines["second"].cut()
        said = _judge(report, plan, here, "three", Limits(0.01, 250.0), CUT_S)
        here.hosts.machines["second"].mend()
        begin = time.time_ns()
        here.await_(lambda: bool(_reports(here, "speech", begin)), 30.0, "the second robot did not come back")
        back_s = (_reports(here, "speech", begin)[0] - begin) / SECOND
    report.add("three_back_s", "three: report of the second robot after it is back, s", round(back_s, 2), BACK_S)
    return f"{said}, with the second robot cut off; it is back after {back_s:.2f} s"


def _up(here: Scene[N]) -> ExitStack:
    """Start all machines, and wait until somebody is greeted."""
    with ExitStack() as undo:
        for machine in here.hosts.machines:
            undo.enter_context(here.up(machine))
        here.await_greeting()
        return undo.pop_all()


def _judge(report: Report, plan: Plan, here: Scene[N], row: str, limits: Limits, seconds: float = 30.0) -> str:
    stretch = measure(here, plan.of(seconds, min(seconds, 10.0)))
    came, late_ms = stretch.frames, percentile(stretch.frames.ages_ms(), 0.99)
    greetings = sum(one.said["text"] == GREETING for one in here.spoken())
    report.add(f"{row}_frames", f"{row}: captured frames", len(came.taken))
    report.add(f"{row}_lost_share", f"{row}: share of lost frames", round(came.lost_share, 4), limits.lost)
    late = None if late_ms is None else round(late_ms, 1)
    report.add(f"{row}_frame_p99_ms", f"{row}: frame to workstation, p99, ms", late, limits.late_ms)
    report.add(f"{row}_greetings", f"{row}: greetings of the one visitor", greetings, 1)
    arrived = f"{came.arrived} of {len(came.taken)} frames ({1 - came.lost_share:.1%})"
    return f"{arrived}, p99 {'-' if late is None else f'{late:.0f}'} ms; greeted {greetings} time(s)"


def _reports(here: Scene[N], node: str, begin: int) -> list[int]:
    """Arrival times (ns) at the workstation of health of a node that was sent since ``begin``."""
    return [one.at for one in here.heard("workstation", HEALTH) if one.said["node"] == node and one.stamp >= begin]
