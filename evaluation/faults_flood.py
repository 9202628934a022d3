"""Flood row: a whole graph with keys while a stranger on the same machine floods its topics and its discovery.

``socialbot up`` runs Waldo with a camera that repeats recorded pictures, and an agent that answers every frame that the
detector has processed. Each answer is a decision. One flood after the other begins while a person is in view. The row
compares the decisions before, during and after each flood.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation.faults_plan import Plan, await_, beside, cpu_s, descendants, write_pictures
from evaluation.faults_strangers import with_keys
from evaluation.report import Report, Value
from socialbot.bridge import environment
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.graph_observer import LatestStatistics, observe_graph
from socialbot.bridge.keys import new_key
from socialbot.core.clock import SECOND
from socialbot.core.messages import ActionRequest, Message
from socialbot.graph.files import load_graph

PARTICIPANTS = "participants"
FLOODS: Mapping[str, tuple[str, ...]] = {
    "2,000 sentences a second": ("evaluation.seal_flood", "--flood", "sentences"),
    "2,000 seals of images a second": ("evaluation.seal_flood", "--flood", "seals"),
    "30 pictures of 4K a second": ("evaluation.seal_flood", "--flood", "pictures"),
    "100 texts of 200 kB a second": ("evaluation.seal_flood", "--flood", "texts"),
    PARTICIPANTS: ("evaluation.rtps_attack", "participants", "127.0.0.1", "/speech/say"),
    "names": ("evaluation.rtps_attack", "names", "127.0.0.1", "/speech/say"),
}
RATE_HZ = 5
SCENE = [*range(115, 135)]
ACTIONS = "/agent/actions"
READY_S = 120.0
STEP_S = 3.0
"""Length (s) of the time in which decisions have to come as often as before."""
SHARE = 0.8
"""Share of the rate before a flood at which the graph is itself again."""
RECOVERED_S, FORGOTTEN_S = 20.0, 100.0
"""Limits (s) for that: a subscription is replaced after 6 s, and 12 s later again; DDS forgets false participants."""

GRAPH = """
name: flooded
nodes:
  camera:          {type: camera, parameters: {source: PICTURES, loop: true, rate_hz: RATE}}
  image_converter: {type: image_converter}
  person_detector: {type: person_detector}
  bdi_engine:      {type: waldo}
  listener:        {type: listener}
  speech:          {type: speaker, parameters: {playback: 'off', engine: bdi_engine}}
  head:            {type: head, parameters: {engine: bdi_engine}}
  answerer:        {type: 'evaluation.transport_nodes:Answerer'}
"""


@dataclass(frozen=True)
class Decision:
    """Time of arrival (s) of a decision, and the age (s) of its frame then."""

    at: float
    age_s: float


def rate_hz(decisions: Sequence[Decision], begin: float, end: float) -> float:
    """Decisions a second from ``begin`` to ``end``."""
    return sum(begin <= one.at < end for one in decisions) / (end - begin)


def recovered_s(decisions: Sequence[Decision], end: float, until: float, usual_hz: float) -> float:
    """Time (s) from the ``end`` of a flood to the first `STEP_S` with the usual rate; infinite if there is none.

    The decisions are known ``until`` a time (s).
    """
    for begin in np.arange(end, until - STEP_S, 0.1):
        if rate_hz(decisions, begin, begin + STEP_S) >= SHARE * usual_hz:
            return float(begin - end)
    return float("inf")


def flood(report: Report, plan: Plan) -> str:
    """Flood the graph in each way, and compare its decisions."""
    environment.prepare(domain=plan.domain)
    folder = plan.records("flood")
    pictures = write_pictures(folder / "pictures", SCENE)
    file = folder / "graph.yaml"
    file.write_text(GRAPH.replace("PICTURES", f"'{pictures}'").replace("RATE", str(RATE_HZ)))
    new_key("robot", folder / "keys")
    graph, decisions = load_graph(str(file)), []

    def note(topic: str, message: Message) -> None:
        if isinstance(message, ActionRequest):
            decisions.append(Decision(time.monotonic(), (time.time_ns() - int(message.arguments[0])) / SECOND))

    fates = LatestStatistics(graph)
    rows: dict[str, dict[str, Value]] = {}
    with (
        with_keys(folder / "keys"),
        observe_graph({ACTIONS: ActionRequest}, note, fates.note),
        beside(plan, folder, "up", "up", file, "--out", folder / "run") as up,
    ):
        await_(lambda: len(decisions) > 10 * RATE_HZ, READY_S, "too few decisions", folder)
        before = {name: values["pid"] for name, values in fates.latest.items()}
        for name, command in FLOODS.items():
            rows[name] = _flooded(plan, folder, command, decisions, fates, up.pid)
            plan.tell(f"flood: {name}: " + ", ".join(f"{key} {value}" for key, value in rows[name].items()))
        restarted = sum(values.get("pid") != before[name] for name, values in fates.latest.items())
    report.tables["flood"] = rows
    took = {name: float(str(row["again after, s"])) for name, row in rows.items()}
    forgotten_s = took.pop(PARTICIPANTS)
    longest = max(took.values())
    report.add("flood_again_s", "flood: decisions come as before after, s", longest, RECOVERED_S)
    text = "flood: the same after false participants, s"
    report.add("flood_participants_again_s", text, forgotten_s, FORGOTTEN_S)
    report.add("flood_restarted", "flood: restarted nodes", restarted, 0)
    least = min(float(str(row["share of decisions"])) for row in rows.values())
    return (
        f"{100 * least:.0f}% of the decisions at least; as before {longest:.1f} s after, {forgotten_s:.1f} s after "
        f"participants; {restarted} restarts"
    )


def _flooded(
    plan: Plan, folder: Path, command: tuple[str, ...], decisions: list[Decision], fates: LatestStatistics, up: int
) -> dict[str, Value]:
    """Measure one flood: the calm time before, the flood, and the time after."""
    calm_s, flood_s, after_s = plan.of((15.0, 20.0, 60.0), (8.0, 8.0, 30.0))
    refused, resubscribed = _count(fates, "refused"), _resubscribed(fates)
    calm = time.monotonic()
    spent = _cpu_s(up)
    time.sleep(calm_s)
    calm_cores = (_cpu_s(up) - spent) / (time.monotonic() - calm)
    with _stranger(folder, command, flood_s):
        time.sleep(2.0)  # it starts
        begun, spent = time.monotonic(), _cpu_s(up)
        time.sleep(flood_s)
        end = time.monotonic()
        cores = (_cpu_s(up) - spent) / (end - begun)
    time.sleep(after_s)
    usual_hz = rate_hz(decisions, calm, calm + calm_s)
    during_hz = rate_hz(decisions, begun, end)
    return {
        "decisions a second before": round(usual_hz, 1),
        "during": round(during_hz, 1),
        "share of decisions": round(during_hz / usual_hz, 2),
        "p99 before, ms": _p99_ms(decisions, calm, calm + calm_s),
        "p99 during, ms": _p99_ms(decisions, begun, end),
        "again after, s": round(recovered_s(decisions, end, end + after_s, usual_hz), 1),
        "cores before": round(calm_cores, 2),
        "cores during": round(cores, 2),
        "refused a second": round((_count(fates, "refused") - refused) / (end - begun)),
        "subscribed again": _resubscribed(fates) - resubscribed,
    }


@contextmanager
def _stranger(folder: Path, command: tuple[str, ...], seconds: float) -> Iterator[None]:
    """Run a flood without keys during the block."""
    module, *arguments = command
    if module.endswith("rtps_attack"):
        arguments.append(str(seconds + 60.0))
    with (folder / "stranger.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments], env={**os.environ, KEYS_VARIABLE: ""}, stdout=log, stderr=log
        )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def _cpu_s(up: int) -> float:
    return sum(map(cpu_s, descendants(up)))


def _count(fates: LatestStatistics, key: str) -> int:
    return sum(int(values.get(key, 0)) for values in fates.latest.values())


def _resubscribed(fates: LatestStatistics) -> int:
    texts = [values.get("resubscribed", "") for values in fates.latest.values()]
    return sum(int(part.split()[0]) for text in texts for part in text.split(", ") if part)


def _p99_ms(decisions: Sequence[Decision], begin: float, end: float) -> Value:
    ages = [one.age_s for one in decisions if begin <= one.at < end]
    return round(1000 * float(np.percentile(ages, 99))) if ages else None
