"""What any recorded run has to tell, as sections of a page: who was there, what was done and why, nodes, settings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from typing import Any

from socialbot.core.messages import Health, TraceRecord
from socialbot.graph.status import NodeStatus
from socialbot.runs.difference import PLACES
from socialbot.runs.folder import RecordedRun
from socialbot.runs.history import OF_TOPICS
from socialbot.runs.report_curves import Plot
from socialbot.runs.report_frames import figures, shots_of
from socialbot.runs.report_lanes import Lane, Lanes, Mark, Stripe
from socialbot.runs.report_page import Section, folded, settings, table
from socialbot.runs.report_rates import rates_chart
from socialbot.runs.report_vitals import vitals_charts
from socialbot.runs.run import Run
from socialbot.runs.sentences import Teller
from socialbot.runs.timeline import Bar
from socialbot.runs.why import Explanation, Reason, actions, explain

MOST_STRIPES = 1500
"""So many bars are drawn at most, the last ones: of a run of many hours that is its end."""
MOST_DEEDS = 150
"""So many actions are told with what led to them, at most: the first and the last ones."""
MOST_EVENTS = 300

LANES_NOTE = "Each bar is as long as it lasted; dots took no time. A pointer that rests on a bar is told more."
DEEDS_NOTE = "Each action unfolds: what led to it, down to the frame that was seen, and what else could have been done."
FRAMES_NOTE = "What the camera saw at the turning points; boxes are who was found there, with the distance."
PRESENT = frozenset({"people", "head", "speech"})
PLANNED = PRESENT | {"desires", "plans", "steps"}
REACTIVE = PRESENT | {"beliefs", "goals", "actions"}
"""Lanes: of who is there and what is said; with what agents do that plan; or that do not."""
VITALS_NOTE = (
    "The charts go from the start of the run to its end; those of processor and memory have the same scale. A line is "
    "broken where a node was silent; red, dashed: it was started again."
)
CURVES_NOTE = (
    "The curves tell, by the ground truth, how many people were there and how many were found, and the rates over the "
    "seconds around each moment; red lines mark the frames with the most errors."
)
FAILED = {"failed", "dropped", "replaced", "expired", "aborted", "lost"}


def lanes_of(
    run: Run,
    names: Collection[str],
    *,
    marks: Sequence[Mark] = (),
    plots: Sequence[Plot] = (),
    until_s: float = 0.0,
) -> str:
    """Who was there, what was believed, wanted, done and said, as a chart of the lanes called ``names``.

    Below them are the curves of ``plots``. It goes on until ``until_s`` if the run ends before.
    """
    end_s = run.history.seconds(run.end)
    lanes = []
    believed = _beliefs(run, end_s) if "beliefs" in names else {}
    for agent, name, bars in ((lane.agent, lane.name, lane.bars) for lane in run.timeline.lanes()):
        if name in names:
            if agent in believed:  # what it believes stands above what it wants
                lanes.append(_lane(run, agent, "beliefs", believed.pop(agent)))
            lanes.append(_lane(run, agent, name, [_stripe(bar, end_s) for bar in bars]))
    lanes += [_lane(run, agent, "beliefs", stripes) for agent, stripes in believed.items()]
    lanes, begin_s = _latest([lane for lane in lanes if lane.stripes])
    chart = Lanes(lanes, max(end_s, until_s), begin_s=begin_s, marks=marks, plots=plots)
    earlier = f'<p class="note">What was before {begin_s:.0f} s is left out here.</p>' if begin_s else ""
    return earlier + chart.html(f"What went on when in {run.title}")


def frames(run: Run) -> Section:
    """The frames at the turning points."""
    return Section("What was seen", figures(run, shots_of(run)), FRAMES_NOTE)


def deeds(run: Run) -> Section:
    """What was done, each with the chain of its causes."""
    done = actions(run.history)
    first = len(done) if len(done) <= MOST_DEEDS else MOST_DEEDS // 2
    told = [explanation(explain(run.history, run.wording, record)) for record in done[:first]]
    if first < len(done):
        left_out = len(done) - 2 * first
        told.append(f'<p class="note">{left_out} actions are left out here; socialbot why --list tells them all.</p>')
        told += [explanation(explain(run.history, run.wording, record)) for record in done[-first:]]
    return Section("What was done, and why", "".join(told), DEEDS_NOTE)


def explanation(why: Explanation, *, opened: bool = False) -> str:
    """A chain of causes that unfolds."""
    head = why.chain[0]
    chain = "".join(f"<li>{escape(reason.link)} {_reason(reason)}</li>" for reason in why.chain[1:])
    parts = [f'<ol class="chain">{chain or "<li>nothing is known of why</li>"}</ol>']
    if why.rejected:
        others = "".join(f"<li><code>{escape(each.plan)}</code>: {escape(each.because)}</li>" for each in why.rejected)
        parts.append(f"<p>Considered, and not chosen:</p><ul>{others}</ul>")
    if why.effects:
        parts.append(f"<p>What came of it:</p><ul>{''.join(f'<li>{_reason(each)}</li>' for each in why.effects)}</ul>")
    summary = f"{head.at_s:.2f} s  {head.sentence}"
    return f'<div class="deed">{folded(summary, "".join(parts), opened=opened)}</div>'


def events(run: Run) -> Section:
    """What went wrong or came from outside, in sentences."""
    teller = Teller(run.history, run.wording)
    kinds = {"failure", "desire_refused", "refused", "silent", "heard", "command", "dropped"}
    found = [(record.stamp, teller.clause(record).told()) for record in run.history if record.kind in kinds]
    shown = found[-MOST_EVENTS:]
    rows = [[(f"{run.history.seconds(stamp):.2f} s", "r"), (told, "")] for stamp, told in shown]
    note = "" if len(shown) == len(found) else f"The last {len(shown)} of {len(found)}."
    return Section("What went wrong, or was asked", table(("at", "what"), rows, right=(0,)) if rows else "", note)


def seen_well(results: Mapping[str, Any]) -> Section:
    """How well people were seen, by distance, where the truth is known."""
    bands: Mapping[str, Any] = (results.get("scores") or {}).get("bands", {})
    told = {name: band for name, band in bands.items() if "-" in name or any(band[key] for key in ("tp", "fp", "fn"))}
    if not told:
        return Section("How well people were seen", "")
    rows = [
        [
            (name, ""),
            *((str(band[key]), "r") for key in ("tp", "fp", "fn")),
            *(("-" if band[key] is None else f"{band[key]:.3f}", "r") for key in ("precision", "recall", "f1")),
        ]
        for name, band in told.items()
    ]
    heads = ("distance", "found", "false", "missed", "precision", "recall", "F1")
    content = rates_chart({name: band for name, band in told.items() if "-" in name})
    content += table(heads, rows, right=range(1, 7))
    frames = results["scores"].get("frames", 0)
    return Section("How well people were seen", content, f"{frames} frames beside the truth, at an IoU of 0.5.")


def nodes(run: RecordedRun) -> Section:
    """What nodes cost, and how they fared."""
    fates: Mapping[str, Any] = run.results.get("nodes", {})
    statuses = {status.name: status for status in run.nodes(run.end)}
    rows = [
        {"node": name, **_fate(fates.get(name, {})), **_status(statuses.get(name))}
        for name in dict.fromkeys([*fates, *statuses])
    ]
    used = [key for key in _NODE_COLUMNS if any(row.get(key) for row in rows)]
    cells = [[(str(row.get(key) or ""), "" if key in _WORDS else "r") for key in used] for row in rows]
    content = table(used, cells, right=[n for n, key in enumerate(used) if key not in _WORDS]) if rows else ""
    heard = run.told
    content += vitals_charts({name: heard[name] for row in rows if (name := row["node"]) in heard})
    unwell = {health.node for _, health in run.health if health.state not in ("ok", "ended")}
    told = [
        [(f"{at_s:.2f} s", "r"), (health.node, ""), (health.state, _HEALTHY.get(health.state, "")), (_why(health), "")]
        for at_s, health in run.health
        if health.state != "ok" or health.node in unwell
    ]
    if told:
        content += folded(
            f"What they said of their health: {len(told)} changes",
            table(("at", "node", "is", "why"), told[-MOST_EVENTS:], right=(0,)),
            opened=any(health.state in ("failed", "degraded") for _, health in run.health),
        )
    return Section("How the nodes fared", content, VITALS_NOTE if heard else "")


def setting(run: RecordedRun) -> Section:
    """How it was run: only parameters that are not as their nodes have them by default."""
    results = run.results
    told: dict[str, object] = {
        "graph": results.get("graph", ""),
        "runner": results.get("runner", ""),
        "bag": results.get("bag", {}).get("path", ""),
        "ended": results.get("ended", ""),
        "in real time": f"{results['wall_s']:.1f} s" if "wall_s" in results else "",
    }
    graph = run.described
    parameters: Mapping[str, Mapping[str, Any]] = results.get("parameters", {})
    for placement in graph.placements if graph is not None else ():
        known = placement.type.parameters()
        for name, value in {**placement.parameters, **parameters.get(placement.name, {})}.items():
            if name in known and name not in PLACES and value != known[name].default:
                told[f"{placement.name}.{name}"] = value
    told |= results.get("versions", {})
    return Section("How it was run", settings({name: value for name, value in told.items() if value != ""}))


# Bars


def _lane(run: Run, agent: str, name: str, stripes: Sequence[Stripe]) -> Lane:
    alone = len(run.history.agents) < 2
    return Lane(name if alone or not agent else f"{run.wording.name(agent)}: {name}", stripes)


def _stripe(bar: Bar, end_s: float) -> Stripe:
    to_s = end_s if bar.to_s is None else bar.to_s
    return Stripe(bar.text, bar.from_s, to_s, bar.kind, bar.outcome, bar.outcome in FAILED)


def _beliefs(run: Run, end_s: float) -> dict[str, list[Stripe]]:
    """What each agent believed from when to when."""
    held: dict[tuple[str, str], TraceRecord] = {}
    found: dict[str, list[Stripe]] = {}

    def close(record: TraceRecord, to_s: float) -> None:
        source = str(record.detail.get("source", ""))
        told = {"": "", "percept": "told by a sensor", "self": "its own conclusion"}.get(source, f"told by {source}")
        stripe = Stripe(record.what, run.history.seconds(record.stamp), to_s, "belief", told)
        found.setdefault(record.source, []).append(stripe)

    for record in run.history:
        if record.kind in OF_TOPICS:
            continue
        key = (record.source, record.what)
        if record.kind == "belief":
            held.setdefault(key, record)
        elif record.kind == "unbelief" and not record.detail.get("left") and key in held:
            close(held.pop(key), run.history.seconds(record.stamp))
    for record in held.values():
        close(record, end_s)
    return found


def _latest(lanes: Sequence[Lane]) -> tuple[list[Lane], float]:
    """The last bars of all, and the time (s) from which on these are; 0 where that is all of them."""
    every = sorted((stripe for lane in lanes for stripe in lane.stripes), key=lambda stripe: stripe.to_s)
    if len(every) <= MOST_STRIPES:
        return list(lanes), 0.0
    begin_s = every[-MOST_STRIPES].to_s
    return [Lane(each.name, [one for one in each.stripes if one.to_s >= begin_s]) for each in lanes], begin_s


def _reason(reason: Reason) -> str:
    return f'<span class="at">{reason.at_s:.2f} s</span> {escape(reason.sentence)}'


# Nodes

_NODE_COLUMNS = (
    "node", "machine", "is", "calls", "failures", "skipped", "restarts", "processor", "memory", "a call takes", "why",
)  # fmt: skip
_WORDS = {"node", "machine", "is", "why"}
_HEALTHY = {"failed": "bad", "degraded": "bad", "ok": "good"}


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
    told = {
        "machine": status.machine,
        "is": "" if status.condition == "active" else status.condition,
        "restarts": str(status.restarts or ""),
        "processor": "" if status.cpu_percent is None else f"{status.cpu_percent:.0f} %",
        "memory": "" if status.memory_mb is None else f"{status.memory_mb:.0f} MB",
        "a call takes": "" if status.call is None else f"{status.call.mean_ms:.1f} ms",
        "failures": str(status.failures or ""),
        "why": status.last_error or status.first_failure or status.reason,
    }
    return {key: value for key, value in told.items() if value}


def _why(health: Health) -> str:
    return health.reason or (f"nothing on {', '.join(health.silent)}" if health.silent else "")
