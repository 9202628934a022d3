"""Row outage: behaviour of robot and workstation during and after a cut link."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

from evaluation.faults_plan import Plan
from evaluation.faults_scene import ACTIONS, ARRIVED, GREETING, HEAD, MOTION, TRACE, Scene, scene
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


def _r(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
