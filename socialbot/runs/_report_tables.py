"""Tables and charts of the report: desires, plans, messages, detection by distance, events, nodes and settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from socialbot.core.messages import Health
from socialbot.graph.status import SILENT_S, NodeStatus
from socialbot.runs.difference import PLACES
from socialbot.runs.folder import RecordedRun
from socialbot.runs.narration import Narrator
from socialbot.runs.pages import Cells, Chart, Section, Series, charts, folded, settings, table
from socialbot.runs.record import NodeReport
from socialbot.runs.run import RunView
from socialbot.runs.story import DesireRecord, MessageRecord, PlanRecord, RequestRecord, Story

MAX_EVENTS = 300
EVENTS = {"failure", "desire_refused", "refused", "silent", "heard", "command", "dropped"}
NODES_NOTE = "A line is interrupted where a node was silent; red, dashed lines mark restarts."

_OUTCOMES = {
    "fulfilled": "good", "succeeded": "good", "dropped": "bad", "refused": "bad", "timeout": "bad", "failed": "bad",
    "aborted": "bad", "lost": "bad",
}  # fmt: skip
_HEALTH = {"failed": "bad", "degraded": "bad", "ok": "good"}
_NODE_COLUMNS = (
    "node", "machine", "is", "calls", "failures", "skipped", "restarts", "processor", "memory", "a call takes", "why",
)  # fmt: skip
_TEXT_COLUMNS = {"node", "machine", "is", "why"}
_FEWEST_REPORTS = 3
_CHART_POINTS = 600


def story_sections(story: Story) -> list[Section]:
    """Return desires, plans and messages of deliberating agents."""
    if not story.desires:
        return []
    words = Markup()
    if story.words:
        words = _words(story, [word for word in story.words if word.weight])
        words += folded(f"All {len(story.words)} messages", _words(story, story.words))
    about_desires = [request for request in story.requests if request.about_desire]
    others = [request for request in story.requests if not request.about_desire]
    requests = _requests(story, about_desires) if about_desires else Markup()
    if others:
        requests += folded(f"{len(others)} requests about beliefs", _requests(story, others))
    return [
        Section("Desires", _desires(story)),
        Section("Plans", _plans(story), "With planned and actual duration; ↻ replaces a plan that was given up."),
        Section("Messages between agents", words),
        Section("Requests between agents", Markup() if story.words else requests),
    ]


def band_section(results: Mapping[str, Any]) -> Section:
    """Return precision and recall by distance, where the ground truth is known."""
    bands: Mapping[str, Any] = (results.get("scores") or {}).get("bands", {})
    known = {name: band for name, band in bands.items() if "-" in name or any(band[key] for key in ("tp", "fp", "fn"))}
    if not known:
        return Section("Detection by distance", "")
    rows = [
        [
            (name, ""),
            *((str(band[key]), "r") for key in ("tp", "fp", "fn")),
            *(("-" if band[key] is None else f"{band[key]:.3f}", "r") for key in ("precision", "recall", "f1")),
        ]
        for name, band in known.items()
    ]
    heads = ("distance", "found", "false", "missed", "precision", "recall", "F1")
    drawn = {name: band for name, band in known.items() if "-" in name and band["tp"] + band["fn"] + band["fp"]}
    rates = tuple(
        Series("F1" if rate == "f1" else rate, [(n, band[rate]) for n, band in enumerate(drawn.values())], colour)
        for colour, rate in enumerate(("precision", "recall", "f1"))
    )
    chart = Chart("Precision, recall and F1 by distance", rates, y_range=(0.0, 1.02), categories=tuple(drawn))
    content = charts([chart] if len(drawn) > 1 else []) + table(heads, rows, right=range(1, 7))
    return Section(
        "Detection by distance",
        content,
        f"{results['scores'].get('frames', 0)} frames with ground truth, at an IoU of 0.5.",
    )


def event_section(run: RunView) -> Section:
    """Return failures, refusals and commands as sentences."""
    teller = Narrator(run.history, run.wording)
    found = [record for record in run.history if record.kind in EVENTS]
    rows = [
        [(f"{run.history.seconds(record.stamp):.2f} s", "r"), (teller.clause(record).told(), "")]
        for record in found[-MAX_EVENTS:]
    ]
    note = f"The last {MAX_EVENTS} of {len(found)}." if len(found) > MAX_EVENTS else ""
    return Section("Failures and commands", table(("at", "what"), rows, right=(0,)) if rows else "", note)


def node_section(run: RecordedRun) -> Section:
    """Return resource use, health and restarts of the nodes."""
    fates: Mapping[str, Any] = run.results.get("nodes", {})
    statuses = {status.name: status for status in run.nodes(run.end)}
    rows = [
        {"node": name, **_fate(fates.get(name, {})), **_status(statuses.get(name))}
        for name in dict.fromkeys([*fates, *statuses])
    ]
    used = [key for key in _NODE_COLUMNS if any(row.get(key) for row in rows)]
    cells = [[(str(row.get(key) or ""), "" if key in _TEXT_COLUMNS else "r") for key in used] for row in rows]
    right = [number for number, key in enumerate(used) if key not in _TEXT_COLUMNS]
    content = table(used, cells, right=right) if rows else Markup()
    content += charts(node_charts({name: run.told[name] for row in rows if (name := row["node"]) in run.told}))
    unhealthy = {health.node for _, health in run.health if health.state not in ("ok", "ended")}
    changes = [
        [
            (f"{at_s:.2f} s", "r"),
            (health.node, ""),
            (health.state, _HEALTH.get(health.state, "")),
            (_reason(health), ""),
        ]
        for at_s, health in run.health
        if health.state != "ok" or health.node in unhealthy
    ]
    if changes:
        content += folded(
            f"{len(changes)} changes of health",
            table(("at", "node", "is", "why"), changes[-MAX_EVENTS:], right=(0,)),
            opened=any(health.state in ("failed", "degraded") for _, health in run.health),
        )
    return Section("Node health", content, NODES_NOTE if run.told else "")


def settings_section(run: RecordedRun) -> Section:
    """Return graph, runner, bag, versions and the parameters that differ from their defaults."""
    results = run.results
    values: dict[str, object] = {
        "graph": results.get("graph", ""),
        "runner": results.get("runner", ""),
        "bag": results.get("bag", {}).get("path", ""),
        "ended": results.get("ended", ""),
        "in real time": f"{results['wall_s']:.1f} s" if "wall_s" in results else "",
    }
    parameters: Mapping[str, Mapping[str, Any]] = results.get("parameters", {})
    for placement in run.described.placements if run.described is not None else ():
        known = placement.type.parameters()
        for name, value in {**placement.parameters, **parameters.get(placement.name, {})}.items():
            if name in known and name not in PLACES and value != known[name].default:
                values[f"{placement.name}.{name}"] = value
    values |= results.get("versions", {})
    return Section("Settings", settings({name: value for name, value in values.items() if value != ""}))


# Deliberation


def _desires(story: Story) -> Markup:
    heads = ("agent", "desire", "came from", "priority", "deadline", "from", "to", "plans", "how it ended")
    return table(heads, [_desire(story, desire) for desire in story.desires], right=range(3, 8))


def _desire(story: Story, desire: DesireRecord) -> Cells:
    how = (desire.how or "still wanted") + (f": {desire.reason}" if desire.reason else "")
    return [
        (desire.agent, ""),
        (desire.name, ""),
        (desire.why, ""),
        ("" if desire.priority is None else f"{desire.priority:g}", "r"),
        ("" if desire.deadline_s is None else f"{desire.deadline_s:g} s", "r"),
        (story.when(desire.adopted), "r"),
        (story.when(desire.ended), "r"),
        (str(len(story.plans_for(desire))), "r"),
        (how, _OUTCOMES.get(desire.how, "")),
    ]


def _plans(story: Story) -> Markup:
    heads = ("agent", "plan", "desire", "steps", "from", "to", "planned", "took", "how it ended")
    return (
        table(heads, [_plan(story, plan) for plan in story.plans], right=(1, 3, 4, 5, 6, 7))
        if story.plans
        else Markup()
    )


def _plan(story: Story, plan: PlanRecord) -> Cells:
    how = (plan.outcome or "still executed") + (f": {plan.reason}" if plan.reason else "")
    return [
        (plan.agent, ""),
        (f"{'↻ ' if plan.again else ''}{plan.number}", "r"),
        (plan.desire, ""),
        (str(len(plan.plan.steps)), "r"),
        (story.when(plan.began), "r"),
        (story.when(plan.ended), "r"),
        ("" if plan.makespan_s is None else f"{plan.makespan_s:.1f} s", "r"),
        ("" if plan.ended is None else f"{story.seconds(plan.ended) - story.seconds(plan.began):.1f} s", "r"),
        (how, _OUTCOMES.get(plan.outcome, "")),
    ]


def _requests(story: Story, requests: Iterable[RequestRecord]) -> Markup:
    rows = [
        [
            (story.when(request.asked), "r"),
            (request.sender, ""),
            (request.text, ""),
            (story.when(request.ended), "r"),
            (request.state + (f": {request.reason}" if request.reason else ""), _OUTCOMES.get(request.state, "")),
            (request.id, ""),
        ]
        for request in requests
    ]
    return table(("asked", "agent", "what", "last answer", "result", "id"), rows, right=(0, 3))


def _words(story: Story, words: Iterable[MessageRecord]) -> Markup:
    rows = [
        [
            (story.when(word.stamp), "r"),
            (word.sender, ""),
            (word.receiver, ""),
            (f"{word.performative} {word.content}", "code"),
            (word.text, "bad" if word.weight == "problem" else ""),
            (word.about, ""),
        ]
        for word in words
    ]
    return table(("at", "from", "to", "speech act", "what", "about"), rows, right=(0,))


# Nodes


def _fate(fate: Mapping[str, Any]) -> dict[str, str]:
    cpu_s, peak = fate.get("cpu_s"), fate.get("peak_rss_mb")
    return {
        "calls": str(fate.get("calls") or ""),
        "failures": str(fate.get("failures") or ""),
        "skipped": str(fate.get("skipped") or ""),
        "processor": "" if cpu_s is None else f"{cpu_s:.1f} s",
        "memory": "" if peak is None else f"{peak:.0f} MB",
        "why": str(fate.get("first_failure") or ""),
    }


def _status(status: NodeStatus | None) -> dict[str, str]:
    if status is None:
        return {}
    values = {
        "machine": status.machine,
        "is": "" if status.condition == "active" else status.condition,
        "restarts": str(status.restarts or ""),
        "processor": "" if status.cpu_percent is None else f"{status.cpu_percent:.0f} %",
        "memory": "" if status.memory_mb is None else f"{status.memory_mb:.0f} MB",
        "a call takes": "" if status.call is None else f"{status.call.mean_ms:.1f} ms",
        "failures": str(status.failures or ""),
        "why": status.last_error or status.first_failure or status.reason,
    }
    return {key: value for key, value in values.items() if value}


def _reason(health: Health) -> str:
    return health.reason or (f"nothing on {', '.join(health.silent)}" if health.silent else "")


Reports = Mapping[str, Sequence[tuple[float, NodeReport]]]
"""Diagnostics of each node with their times (s), in order."""


@dataclass(frozen=True)
class Measure:
    """Quantity that nodes report: its unit and keys. ``of_process``: the same for all nodes of a process."""

    title: str
    unit: str
    keys: Mapping[str, str]
    of_process: bool = False


MEASURES = (
    Measure("Messages per second", "Hz", {"call_hz": "handled by", "publish_hz": "published by"}),
    Measure("Latency, 99th percentile", "ms", {"age_p99_ms": "message age at", "call_p99_ms": "callback of"}),
    Measure("Processor, of one core", "%", {"cpu_percent": ""}, of_process=True),
    Measure("Memory", "MB", {"rss_mb": ""}, of_process=True),
)


def node_charts(reports: Reports) -> list[Chart]:
    """Return a chart of each measure over time, with one line per node or process."""
    reports = {name: course for name, course in reports.items() if len(course) >= _FEWEST_REPORTS}
    return [chart for measure in MEASURES if (chart := _node_chart(measure, reports)) is not None]


def _node_chart(measure: Measure, reports: Reports) -> Chart | None:
    groups: dict[object, list[str]] = {}
    for name, course in reports.items():
        last = course[-1][1].values
        is_shared = measure.of_process and "pid" in last
        groups.setdefault((last.get("machine"), last["pid"]) if is_shared else name, []).append(name)
    series, marks = [], []
    for names in groups.values():
        course = reports[names[0]]
        for dashed, (key, prefix) in enumerate(measure.keys.items()):
            points = _thinned(list(_points(course, key)))
            if any(value for _, value in points):
                label = f"{prefix} {', '.join(names)}".strip()
                series.append(Series(label, points, len(series) // len(measure.keys) % 6, dash=bool(dashed)))
        marks += [(at_s, f"{', '.join(names)} restarted") for at_s in _restarts(course)]
    return Chart(measure.title, tuple(series), y_label=measure.unit, marks=marks) if series else None


def _points(course: Sequence[tuple[float, NodeReport]], key: str) -> Iterator[tuple[float, float | None]]:
    """Yield the values over time, None where reports are missing."""
    before_s = -math.inf
    for at_s, node in course:
        if SILENT_S < at_s - before_s < math.inf:
            yield (before_s + at_s) / 2, None
        try:
            number = float(node.values.get(key, ""))
        except ValueError:
            number = math.nan
        yield at_s, number if math.isfinite(number) else None
        before_s = at_s


def _thinned(points: Sequence[tuple[float, float | None]]) -> list[tuple[float, float | None]]:
    """Keep the extremes of each interval, to limit the size of long runs; gaps are kept."""
    if len(points) <= _CHART_POINTS:
        return list(points)
    size = -(-2 * len(points) // _CHART_POINTS)
    kept: list[tuple[float, float | None]] = []
    for first in range(0, len(points), size):
        step = points[first : first + size]
        known = [(value, at_s) for at_s, value in step if value is not None]
        gaps = [point for point in step if point[1] is None][:1]
        ends = {(at_s, value) for value, at_s in (min(known), max(known))} if known else set()
        kept += sorted([*ends, *gaps], key=lambda point: point[0])
    return kept


def _restarts(course: Iterable[tuple[float, NodeReport]]) -> Iterator[float]:
    known: str | None = None
    for at_s, node in course:
        process = node.values.get("pid")
        if process and known not in (None, process):
            yield at_s
        known = process or known
