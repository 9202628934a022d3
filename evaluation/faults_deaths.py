"""Kill row: Waldo's behaviour while each of his processes is killed (SIGKILL) in turn.

``socialbot up`` runs the whole graph. Its camera repeats a scene: one person comes, stays until help is offered, and
leaves. In each pass one process is killed at a random time.

A node is *back* when a new process reports health and works again: detections of a frame after the kill (camera,
converter, detector), or a mind (agent).

A *gap* lasts from the kill of the agent, or of a node of its perception, until the node is back and Waldo is sure
again. Passes outside of gaps must have the same actions in the same order as the pass before the first kill. A gap may
add ``stayIdle`` and ``attend``, and may delay or suppress an offer. In every pass the person must be greeted and asked,
each exactly once, by actions and by voice.

A restarted camera begins the scene again. The interrupted pass counts only for repeated greetings.
"""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from evaluation.faults_plan import Plan, await_, beside, write_pictures
from evaluation.report import Report, Value
from socialbot.bridge import environment
from socialbot.bridge.graph_observer import LatestStatistics, observe_graph
from socialbot.core.clock import SECOND
from socialbot.core.messages import ActionRequest, CameraInfo, Health, Message, Mind, PersonDetections, SpeechStatus
from socialbot.graph.files import load_graph
from socialbot.graph.health import HEALTH_TOPIC

TIMES, QUICK_TIMES = 20, 1
BACK_S = 2.0
GIVEN_UP_S = 30.0
"""Limit (s) for a node to be back."""

RATE_HZ = 10
EMPTY, COMING, STAYING, LEAVING = [0] * 50, range(95, 115), [*range(115, 135)] * 2, [0] * 30
SCENE = (*EMPTY, *COMING, *STAYING, *LEAVING)
PASS_S = len(SCENE) / RATE_HZ
SETTINGS = {
    "camera.loop": "true",
    "camera.rate_hz": f"{RATE_HZ}",
    "bdi_engine.vanish_s": "1.0",
    "bdi_engine.help_after_s": "3.0",
    "bdi_engine.forget_after_s": "2.0",
    "bdi_engine.greeting": "Hello!",
    "speech.playback": "off",
}
SURE_S = 1.5
"""Time (s) after a node is back in which Waldo may lose and regain sight."""
CLEAR_PASSES = 2
"""Passes before the first kill; the last one is the reference."""

DETECTIONS, ACTIONS, MIND, INFO = "/humans/bodies/detections", "/waldo/actions", "/waldo/mind", "/camera/camera_info"
SPEECH = "/speech/status"
TOPICS: dict[str, type[Message]] = {
    DETECTIONS: PersonDetections,
    ACTIONS: ActionRequest,
    MIND: Mind,
    INFO: CameraInfo,
    SPEECH: SpeechStatus,
    HEALTH_TOPIC: Health,
}
WORK = {"camera": DETECTIONS, "image_converter": DETECTIONS, "person_detector": DETECTIONS, "bdi_engine": MIND}
"""Topics that show that a node works; other nodes only report their health. Waldo's behaviour depends on these nodes
only.
"""
GREETING = "Hello!"


@dataclass(frozen=True)
class Kill:
    """Kill of a node: its time (ns), and when the node was back; None if it never was."""

    node: str
    at: int
    back: int | None

    @property
    def took_s(self) -> float:
        return (self.back - self.at) / SECOND if self.back is not None else float("inf")

    def touches(self, begin: int, end: int) -> bool:
        return self.at < end and (self.back is None or self.back + round(SURE_S * SECOND) > begin)


@dataclass(frozen=True)
class Pass:
    """Pass of the scene: begin and end (ns), and whether it was completed."""

    begin: int
    end: int
    whole: bool


@dataclass(frozen=True)
class Judged:
    """Evaluated passes: their number, and the deviating ones."""

    passes: int = 0
    clear: int = 0
    changed: int = 0
    not_greeted: int = 0
    greeted_twice: int = 0
    asked_twice: int = 0
    odd: tuple[str, ...] = ()
    """Actions and killed nodes of the changed passes."""


@dataclass
class Witness:
    """Messages received from the graph."""

    actions: list[ActionRequest] = field(default_factory=list)
    greetings: list[int] = field(default_factory=list)
    """Times (ns) of spoken greetings."""
    begun: list[int] = field(default_factory=list)
    """Times (ns) when a camera began the scene."""
    latest: dict[str, int] = field(default_factory=dict)
    """Stamps (ns) of the latest detections and mind."""
    well: dict[str, int] = field(default_factory=dict)
    """Time (ns) of the last health report of each node."""

    def note(self, topic: str, message: Message) -> None:
        match message:
            case ActionRequest():
                self.actions.append(message)
            case SpeechStatus():
                if message.state == "started" and message.text == GREETING:
                    self.greetings.append(message.stamp)
            case CameraInfo():
                if message.stamp not in self.begun:
                    self.begun.append(message.stamp)
            case Health():
                if message.state != "failed":
                    self.well[message.node] = message.stamp
            case _:
                self.latest[topic] = message.stamp

    def is_back(self, node: str, since: int) -> bool:
        """Return whether ``node`` is healthy and works since ``since`` (ns)."""
        return self.well.get(node, 0) > since and self.latest.get(WORK.get(node, ""), since + 1) > since


def passes(begun: Sequence[int], until: int) -> list[Pass]:
    """Return the passes of the scene with the given begins, shown ``until`` (ns)."""
    found, length = [], round(PASS_S * SECOND)
    for begin, end in zip(begun, [*begun[1:], until], strict=True):
        found += [Pass(at, min(at + length, end), at + length <= end) for at in range(begin, end, length)]
    return found


def deeds(actions: Sequence[ActionRequest], begin: int, end: int) -> list[str]:
    """Return the actions in an interval (ns): situations of utterances, names of other actions."""
    return [str(one.arguments[0]) if one.arguments else one.name for one in actions if begin <= one.stamp < end]


def judge(shown: Sequence[Pass], witness: Witness, kills: Sequence[Kill], usual: list[str]) -> Judged:
    """Compare each pass with the ``usual`` actions, as far as gaps allow."""
    clear = not_greeted = greeted_twice = asked_twice = 0
    odd: list[str] = []
    for one in shown:
        did = deeds(witness.actions, one.begin, one.end)
        spoken = sum(one.begin <= at < one.end for at in witness.greetings)
        greeted_twice += did.count("greeting") > 1 or spoken > 1
        asked_twice += did.count("offer") > 1
        if not one.whole:
            continue
        not_greeted += "greeting" not in did
        touching = [kill for kill in kills if kill.touches(one.begin, one.end)]
        if any(kill.node in WORK for kill in touching):
            said = [deed for deed in did if deed not in ("stayIdle", "attend")]
            as_ever = said in (["greeting", "offer"], ["greeting"])
        else:
            clear += 1
            as_ever = did == usual
        if not as_ever:
            odd.append(f"{', '.join(did)} (killed: {', '.join(kill.node for kill in touching)})")
    whole = sum(one.whole for one in shown)
    return Judged(whole, clear, len(odd), not_greeted, greeted_twice, asked_twice, tuple(odd))


def kills(report: Report, plan: Plan) -> str:
    """Kill each node in turn, and compare Waldo's behaviour with the reference."""
    environment.prepare(domain=plan.domain)
    folder = plan.records("kills")
    pictures = write_pictures(folder / "pictures", SCENE)
    graph = load_graph("waldo")
    witness, fates, chance = Witness(), LatestStatistics(graph), random.Random(9)
    changes = [word for setting, value in SETTINGS.items() for word in ("--set", f"{setting}={value}")]
    killed: list[Kill] = []
    with (
        observe_graph(TOPICS, witness.note, fates.note, latched=(MIND, INFO)),
        beside(plan, folder, "up", "up", "--camera", pictures, "--out", folder / "run", *changes),
    ):
        await_(lambda: bool(witness.begun and witness.latest.get(DETECTIONS)), 120.0, "no detections", folder)
        clear_from = witness.begun[-1]
        clear_until = clear_from + round(CLEAR_PASSES * PASS_S * SECOND)
        await_(lambda: time.time_ns() > clear_until, 2 * CLEAR_PASSES * PASS_S, "no time", folder)
        usual = deeds(witness.actions, clear_until - round(PASS_S * SECOND), clear_until)
        plan.tell(f"kills: undisturbed, Waldo does {', '.join(usual)}")
        for number in range(plan.of(TIMES, QUICK_TIMES)):
            for node in (config.name for config in graph.nodes):
                time.sleep(chance.uniform(0.7, 1.3) * PASS_S - BACK_S)
                killed.append(kill(node, witness, fates))
            slowest = max(killed, key=lambda one: one.took_s)
            plan.tell(f"kills: {number + 1} of each; at most {slowest.took_s:.2f} s ({slowest.node})")
        time.sleep(PASS_S)
        until = time.time_ns()
    shown = [one for one in passes(witness.begun, until) if one.begin >= clear_until]
    found = judge(shown, witness, killed, usual)
    for odd in found.odd:
        plan.tell(f"kills: not as ever: {odd}")
    return _report(report, killed, found, usual)


def kill(node: str, witness: Witness, fates: LatestStatistics) -> Kill:
    """Kill the process of ``node``, and wait until it is back."""
    before = fates.latest[node]["pid"]
    at = time.time_ns()
    os.kill(int(before), signal.SIGKILL)
    deadline = time.monotonic() + GIVEN_UP_S
    while not witness.is_back(node, at):
        if time.monotonic() > deadline:
            return Kill(node, at, None)
        time.sleep(0.005)
    back = time.time_ns()
    # Reports of a supervisor on ended nodes have no process.
    while fates.latest[node].get("pid", before) == before and time.monotonic() < deadline:
        time.sleep(0.02)
    return Kill(node, at, back)


def _report(report: Report, killed: Sequence[Kill], found: Judged, usual: list[str]) -> str:
    times = {node: [one.took_s for one in killed if one.node == node] for node in dict.fromkeys(k.node for k in killed)}
    longest = max(one.took_s for one in killed)
    report.add("kills_count", "kills: killed nodes", len(killed))
    report.add("kills_usual", "kills: actions of Waldo in each pass", ", ".join(usual))
    report.add("kills_greets", "kills: Waldo greets, offers help and idles without kills", _is_usual(usual), True)
    report.add("kills_back_s_max", "kills: time until a node is back, maximum, s", round(longest, 2), BACK_S)
    report.add("kills_passes", "kills: complete passes of the scene", found.passes)
    report.add("kills_clear", "kills: complete passes without a gap", found.clear)
    report.add("kills_changed", "kills: passes with actions that gaps do not explain", found.changed, 0)
    report.add("kills_not_greeted", "kills: passes without a greeting", found.not_greeted, 0)
    report.add("kills_greeted_twice", "kills: passes with a repeated greeting", found.greeted_twice, 0)
    report.add("kills_asked_twice", "kills: passes with a repeated offer", found.asked_twice, 0)
    rows: dict[str, dict[str, Value]] = {
        node: {
            "kills": len(took),
            "least s": round(min(took), 2),
            "median s": round(sorted(took)[len(took) // 2], 2),
            "most s": round(max(took), 2),
            "over 2 s": sum(one > BACK_S for one in took),
        }
        for node, took in times.items()
    }
    report.tables["kills"] = rows
    return (
        f"{len(killed)} kills, back in {longest:.2f} s at most; {found.passes} passes, {found.changed} changed, "
        f"{found.not_greeted} not greeted, {found.greeted_twice} greeted twice"
    )


def _is_usual(usual: Sequence[str]) -> bool:
    return sorted(usual) == ["greeting", "offer", "stayIdle"]
