"""Row late: the robot runs alone until its workstation joins."""

from __future__ import annotations

import time

from evaluation.faults_outage import after_s, is_centred
from evaluation.faults_plan import Plan
from evaluation.faults_scene import ACTIONS, FRAME_HZ, HEALTH, MOTION, READY_S, TAKEN, scene
from evaluation.report import Report
from socialbot.core.clock import SECOND

SAYS_S = 10.0
"""Limit (s) from the robot's start to its report of a missing workstation: nodes start, then wait for others."""

JOINED_S = 30.0
"""Limit (s) from the workstation's start until the robot follows it, including the start of all nodes."""


def late(report: Report, plan: Plan) -> str:
    """Observe the robot alone, and measure the time until the workstation controls it."""
    alone_s = plan.of(60.0, 10.0)
    with scene(plan.records("late")) as here:
        begin = time.time_ns()
        with here.up("robot") as robot:
            here.await_(lambda: len(here.heard("robot", TAKEN)) > FRAME_HZ, READY_S, "the robot took no pictures")
            time.sleep(max(0.0, alone_s - (time.time_ns() - begin) / SECOND))
            lives = robot.poll() is None
            complaints = [one for one in here.heard("robot", HEALTH) if one.said["state"] in ("waiting", "degraded")]
            says = sorted({f"{one.said['node']}: {one.said['reason']}" for one in complaints})
            spoken, motions = len(here.spoken()), here.heard("robot", MOTION)
            came = time.time_ns()
            with here.up("workstation"):
                plan.tell(f"late: the workstation is started after {alone_s:g} s")
                here.await_greeting()
            joined_s = after_s(here.heard("robot", ACTIONS), came)
            greeted_s = after_s(here.spoken(), came)
    says_s = after_s(complaints, begin)
    for text in says:
        plan.tell(f"late: the robot said: {text}")
    away = sum(not is_centred(one) for one in motions)
    report.add("late_lives", "late: the robot runs alone", lives, True)
    report.add("late_spoke", "late: sentences started alone", spoken, 0)
    report.add("late_moved", "late: head movements from the centre alone", away, 0)
    report.add("late_says_s", "late: robot start to its report of the missing workstation, s", _r(says_s), SAYS_S)
    report.add("late_joined_s", "late: workstation start to the first action, s", _r(joined_s), JOINED_S)
    report.add("late_greeted_s", "late: workstation start to the greeting, s", _r(greeted_s), JOINED_S)
    return (
        f"alone for {alone_s:g} s: {spoken} sentences, {away} turns, says so after {_r(says_s)} s; "
        f"joined {_r(joined_s)} s and greeted {_r(greeted_s)} s after the workstation's start"
    )


def _r(value: float | None) -> float | None:
    return None if value is None else round(value, 1)
