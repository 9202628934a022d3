"""Tables and charts of the report: desires, plans, messages, detection by distance, events, nodes and settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from socialbot.core.errors import TruthError
from socialbot.core.messages import Health, TraceRecord
from socialbot.graph.status import SILENT_S, NodeStatus
from socialbot.runs.difference import PLACES
from socialbot.runs.folder import RecordedRun
from socialbot.runs.narration import Narrator
from socialbot.runs.pages import Chart, Section, Series, charts, folded, rate, settings, table
from socialbot.runs.record import NodeReport
from socialbot.runs.run import RunView
from socialbot.runs.story import RequestRecord, Story
from socialbot.runs.visits import ADDRESS_S, SOURCES, visit_table, visits_of

MAX_EVENTS = 300
EVENTS = {"failure", "desire_refused", "refused", "silent", "heard", "command", "dropped"}
NODES_NOTE = "A line is interrupted where a node was silent; red, dashed lines mark restarts."

_OUTCOMES = {
    "fulfilled": "good", "succeeded": "good", "dropped": "bad", "refused": "bad", "timeout": "bad", "failed": "bad",
    "aborted": "bad", "lost": "bad",
}  # fmt: skip
_HEALTH = {"failed": "bad", "degraded": "bad", "ok": "good"}
_TEXT_COLUMNS = {"node", "machine", "state", "reason"}
_RATES = {"precision": "precision", "recall": "recall", "f1": "F1"}
_FEWEST_REPORTS = 3
_CHART_POINTS = 600


def story_sections(story: Story) -> list[Section]:
    """Return desires, plans and messages of deliberating agents."""
    if not story.desires:
        return []
    words, requests = Markup(), Markup()
    if story.words:
        words = _words(story, [word for word in story.words if word.detail.get("weight")])
        words += folded(f"All {len(story.words)} messages", _words(story, story.words))
    else:
        requests = _requests(story, [request for request in story.requests if request.about_desire])
        others = [request for request in story.requests if not request.about_desire]
        requests += folded(f"{len(others)} requests about beliefs", _requests(story, others)) if others else ""
    return [
        Section("Desires", _desires(story)),
        Section("Plans", _plans(story), "With planned and actual duration; ↻ replaces a plan that was given up."),
        Section("Messages between agents", words),
        Section("Requests between agents", requests),
    ]


def visit_section(run: RecordedRun) -> Section:
    """Return the table of visits, with times, distances, sentences and outcomes."""
    try:
        found, source = visits_of(run)
    except TruthError as error:
        return Section("Visits", "", str(error))
    note = (
        f"People from {SOURCES[source]}. The rule does not depend on the agents: a visitor engages by facing the "
        "robot, standing before it or walking up to it. "
        f"Words up to {ADDRESS_S:g} s later are in time, then late; without any, the visitor is missed."
    )
    return Section("Visits", visit_table(found).html(), note)


def band_section(results: Mapping[str, Any]) -> Section:
    """Return precision and recall by distance, where the ground truth is known."""
    bands: Mapping[str, Any] = (results.get("scores") or {}).get("bands", {})
    known = {name: band for name, band in bands.items() if "-" in name or any(band[key] for key in ("tp", "fp", "fn"))}
    if not known:
        return Section("Detection by distance", "")
    rows = [
        [name, *(band[key] for key in ("tp", "fp", "fn")), *((rate(band[key]), "r") for key in _RATES)]
        for name, band in known.items()
    ]
    heads = ("distance", "found", "false", "missed", *_RATES.values())
    drawn = {name: band for name, band in known.items() if "-" in name and band["tp"] + band["fn"] + band["fp"]}
    rates = tuple(
        Series(label, [(n, band[key]) for n, band in enumerate(drawn.values())], colour)
        for colour, (key, label) in enumerate(_RATES.items())
    )
    chart = Chart("Precision, recall and F1 by distance", rates, y_range=(0.0, 1.02), categories=tuple(drawn))
    note = f"{results['scores'].get('frames', 0)} frames with ground truth, at an IoU of 0.5."
    return Section("Detection by distance", charts([chart] if len(drawn) > 1 else []) + table(heads, rows), note)


def event_section(run: RunView) -> Section:
    """Return failures, refusals and commands as sentences."""
    narrator = Narrator(run.wording, run.history)
    found = [record for record in run.history if record.kind in EVENTS]
    rows = [[(narrator.when(each.stamp), "r"), narrator.clause(each).sentence()] for each in found[-MAX_EVENTS:]]
    note = f"The last {MAX_EVENTS} of {len(found)}." if len(found) > MAX_EVENTS else ""
    return Section("Failures and commands", table(("at", "what"), rows), note)


def node_section(run: RecordedRun) -> Section:
    """Return resource use, health and restarts of the nodes."""
    results: Mapping[str, Any] = run.results.get("nodes", {})
    statuses = {status.name: status for status in run.nodes(run.end)}
    names = dict.fromkeys([*results, *statuses])
    rows = [_node_row(name, results.get(name, {}), statuses.get(name)) for name in names]
    used = [key for key in (rows[0] if rows else ()) if any(row[key] for row in rows)]
    cells = [[(row[key], "" if key in _TEXT_COLUMNS else "r") for key in used] for row in rows]
    reports, health = run.node_history.reports, run.node_history.health
    content = table(used, cells) + charts(node_charts({row["node"]: reports.get(row["node"], ()) for row in rows}))
    unhealthy = {each.node for _, each in health if each.state not in ("ok", "ended")}
    changes = [
        [(f"{at_s:.2f} s", "r"), each.node, (each.state, _HEALTH.get(each.state, "")), _reason(each)]
        for at_s, each in health
        if each.state != "ok" or each.node in unhealthy
    ]
    if changes:
        changes_table = table(("at", "node", "state", "reason"), changes[-MAX_EVENTS:])
        is_open = any(each.state in ("failed", "degraded") for _, each in health)
        content += folded(f"{len(changes)} changes of health", changes_table, opened=is_open)
    return Section("Node health", content, NODES_NOTE if reports else "")


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
    for config in run.graph.nodes if run.graph is not None else ():
        known = config.type.parameters()
        for name, value in {**config.parameters, **parameters.get(config.name, {})}.items():
            if name in known and name not in PLACES and value != known[name].default:
                values[f"{config.name}.{name}"] = value
    values |= results.get("versions", {})
    return Section("Settings", settings({name: value for name, value in values.items() if value != ""}))


# Deliberation


def _desires(story: Story) -> Markup:
    rows = [
        [
            desire.agent,
            desire.name,
            desire.why,
            ("" if desire.priority is None else f"{desire.priority:g}", "r"),
            ("" if desire.deadline_s is None else f"{desire.deadline_s:g} s", "r"),
            (story.when(desire.adopted), "r"),
            (story.when(desire.ended), "r"),
            len(story.plans_for(desire)),
            _result(desire.how or "still wanted", desire.reason),
        ]
        for desire in story.desires
    ]
    return table(("agent", "desire", "reason", "priority", "deadline", "from", "to", "plans", "result"), rows)


def _plans(story: Story) -> Markup:
    rows = [
        [
            plan.agent,
            (f"{'↻ ' if plan.again else ''}{plan.number}", "r"),
            plan.desire,
            plan.steps,
            (story.when(plan.began), "r"),
            (story.when(plan.ended), "r"),
            ("" if plan.makespan_s is None else f"{plan.makespan_s:.1f} s", "r"),
            ("" if plan.ended is None else f"{story.seconds(plan.ended) - story.seconds(plan.began):.1f} s", "r"),
            _result(plan.outcome or "still executed", plan.reason),
        ]
        for plan in story.plans
    ]
    return table(("agent", "plan", "desire", "steps", "from", "to", "planned", "took", "result"), rows)


def _requests(story: Story, requests: Iterable[RequestRecord]) -> Markup:
    rows = [
        [
            (story.when(request.asked), "r"),
            request.sender,
            request.text,
            (story.when(request.ended), "r"),
            _result(request.state, request.reason),
            request.id,
        ]
        for request in requests
    ]
    return table(("asked", "agent", "what", "last answer", "result", "id"), rows)


def _words(story: Story, words: Iterable[TraceRecord]) -> Markup:
    rows = [
        [
            (story.when(word.stamp), "r"),
            word.source,
            word.detail.get("receiver", ""),
            (f"{word.detail.get('performative', '')} {word.detail.get('content', '')}", "code"),
            (word.what, "bad" if word.detail.get("weight") == "problem" else ""),
            word.detail.get("mission", ""),
        ]
        for word in words
    ]
    return table(("at", "from", "to", "speech act", "what", "about"), rows)


def _result(outcome: str, reason: str) -> tuple[str, str]:
    return f"{outcome}: {reason}" if reason else outcome, _OUTCOMES.get(outcome, "")


# Nodes


def _node_row(name: str, totals: Mapping[str, Any], status: NodeStatus | None) -> dict[str, str]:
    """Return the figures of a node: its status at the end, or else the totals of an inline run."""
    one = status or NodeStatus(name)
    cpu_s, peak_mb = totals.get("cpu_s"), totals.get("peak_rss_mb")
    processor = (one.cpu_percent, "{:.0f} %") if one.cpu_percent is not None else (cpu_s, "{:.1f} s")
    memory_mb = peak_mb if one.memory_mb is None else one.memory_mb
    return {
        "node": name,
        "machine": one.machine,
        "state": "" if status is None or one.condition == "active" else one.condition,
        "calls": str(totals.get("calls") or ""),
        "failures": str(one.failures or totals.get("failures") or ""),
        "skipped": str(totals.get("skipped") or ""),
        "restarts": str(one.restarts or ""),
        "processor": "" if processor[0] is None else processor[1].format(processor[0]),
        "memory": "" if memory_mb is None else f"{memory_mb:.0f} MB",
        "time per call": "" if one.call is None else f"{one.call.mean_ms:.1f} ms",
        "reason": one.last_error or one.first_failure or one.reason or str(totals.get("first_failure") or ""),
    }


def _reason(health: Health) -> str:
    return health.reason or (f"no message on {', '.join(health.silent)}" if health.silent else "")


Reports = Mapping[str, Sequence[tuple[float, NodeReport]]]


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
