"""Rows outage and late: behaviour without a link between robot and workstation, and before the workstation joins."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

from evaluation.faults_plan import Plan
from evaluation.faults_scene import (
    ACTIONS,
    ARRIVED,
    FRAME_HZ,
    GREETING,
    HEAD,
    HEALTH,
    MOTION,
    READY_S,
    TAKEN,
    TRACE,
    Scene,
    scene,
)
from evaluation.faults_watch import Heard
from evaluation.hosts import TwoHosts
from evaluation.report import Report
from socialbot.core.clock import SECOND

BELIEVED_S = 0.5
"""Limit (s) for the workstation to believe that it sees nothing."""

AT_REST_S = 1.0
"""Limit (s) for the robot to centre its head and begin no new speech; current speech may end."""

OUTAGES = ((5.0, 1.0), (30.0, 3.0))
"""Duration of each outage, and limit for the recovery of data and behaviour (s)."""

PATIENCE_S = 20.0
CALM_S = 8.0
CENTRED_RAD = 0.01


@dataclass(frozen=True)
class Outage:
    """Outage with its begin and end (ns) and observations; times in s, None without a message."""

    begin: int
    end: int
    believed_s: float | None
    centred_s: float | None
    spoke: int
    moved: int
    data_s: float | None
    acted_s: float | None
    follows_s: float | None


def after_s(heard: Iterable[Heard], begin: int) -> float | None:
    """Return the time (s) from ``begin`` (ns) to the first of ``heard``; None without one."""
    return min(((one.at - begin) / SECOND for one in heard if one.at >= begin), default=None)


def is_centred(motion: Heard) -> bool:
    """Return whether a head command looks straight ahead."""
    return all(abs(position) < CENTRED_RAD for position in motion.said["positions"])


def judged(scene: Scene[TwoHosts], begin: int, end: int) -> Outage:
    """Return the current observations of the outage from ``begin`` to ``end``."""
    silences = [
        one.stamp
        for one in scene.heard("workstation", TRACE)
        if one.stamp >= begin and one.said["kind"] == "belief" and one.said["what"].startswith("silent(")
    ]
    motions = [one for one in scene.heard("robot", MOTION) if one.at >= begin]
    rest = begin + round(AT_REST_S * SECOND)
    return Outage(
        begin,
        end,
        believed_s=min(((stamp - begin) / SECOND for stamp in silences), default=None),
        centred_s=after_s(filter(is_centred, motions), begin),
        spoke=sum(one.at < end for one in scene.spoken(rest)),
        moved=sum(rest <= one.at < end and not is_centred(one) for one in motions),
        # Ignore messages in transit when the link failed.
        data_s=after_s((one for one in scene.heard("workstation", ARRIVED) if one.stamp >= end), end),
        acted_s=after_s((one for one in scene.heard("robot", ACTIONS) if one.said["arguments"][0] >= end), end),
        follows_s=after_s((one for one in scene.heard("robot", HEAD) if one.said["mode"] == "track"), end),
    )


def suffer(scene: Scene[TwoHosts], seconds: float) -> Outage:
    """Cut the link for ``seconds``, and wait until the head follows people again, up to a limit."""
    begin = time.time_ns()
    scene.hosts.cut()
    time.sleep(max(0.0, seconds - (time.time_ns() - begin) / SECOND))
    scene.hosts.mend()
    end = time.time_ns()
    deadline = time.monotonic() + PATIENCE_S
    while (outage := judged(scene, begin, end)).follows_s is None and time.monotonic() < deadline:
        time.sleep(0.2)
    return outage


def outage(report: Report, plan: Plan) -> str:
    """Run two outages while a greeted person is present."""
    texts = []
    with scene(plan.records("outage")) as here, here.up("robot"), here.up("workstation"):
        here.await_greeting()
        for down_s, back_s in plan.of(OUTAGES, OUTAGES[:1]):
            time.sleep(CALM_S)
            found = suffer(here, down_s)
            _add(report, found, f"{down_s:g}", back_s)
            texts.append(
                f"{down_s:g} s: believed {_text(found.believed_s)}, centred {_text(found.centred_s)}, "
                f"data back {_text(found.data_s)}, behaviour {_text(found.follows_s)} s"
            )
            plan.tell(f"outage: {texts[-1]}")
        time.sleep(CALM_S)
        greetings = sum(one.said["text"] == GREETING for one in here.spoken())
    report.add("outage_greetings", "outage: greetings of the one visitor", greetings, 1)
    return f"{'; '.join(texts)}; greeted {greetings} time{'' if greetings == 1 else 's'}"


def _add(report: Report, found: Outage, name: str, back_s: float) -> None:
    key, text = f"outage_{name}s", f"outage of {name} s"
    report.add(
        f"{key}_believed_s", f"{text}: time until the workstation believes it, s", _r(found.believed_s), BELIEVED_S
    )
    report.add(f"{key}_centred_s", f"{text}: time until the head is centred, s", _r(found.centred_s), AT_REST_S)
    report.add(f"{key}_spoke", f"{text}: sentences started during the outage", found.spoke, 0)
    report.add(f"{key}_moved", f"{text}: head movements during the outage", found.moved, 0)
    report.add(f"{key}_data_s", f"{text}: time until a new image, s", _r(found.data_s), back_s)
    report.add(f"{key}_acted_s", f"{text}: time until the robot receives an action, s", _r(found.acted_s), back_s)
    report.add(f"{key}_follows_s", f"{text}: time until the head follows people again, s", _r(found.follows_s), back_s)


def _r(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


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
    report.add("late_says_s", "late: robot start to its report of the missing workstation, s", _r(says_s, 1), SAYS_S)
    report.add("late_joined_s", "late: workstation start to the first action, s", _r(joined_s, 1), JOINED_S)
    report.add("late_greeted_s", "late: workstation start to the greeting, s", _r(greeted_s, 1), JOINED_S)
    return (
        f"alone for {alone_s:g} s: {spoken} sentences, {away} turns, says so after {_r(says_s, 1)} s; "
        f"joined {_r(joined_s, 1)} s and greeted {_r(greeted_s, 1)} s after the workstation's start"
    )
