"""Rows jitter, bursts, narrow, subnets, server and three: networks that are harder than one cable."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass

from evaluation.faults_network import STILL_COMING_S, frames, measure
from evaluation.faults_plan import Plan
from evaluation.faults_scene import ARRIVED, GREETING, HEALTH, TAKEN, Scene, scene_over
from evaluation.hosts import ROBOT, SECOND_ROBOT, WORKSTATION, N, routed_hosts, switched_hosts
from evaluation.report import Report, percentile
from evaluation.switch import Quality
from socialbot.core.clock import SECOND

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
