"""Run page as data: the server answers of a self-contained page, compressed."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.core.registry import WorldView
from socialbot.runs.distances import distances_of
from socialbot.runs.folder import RecordedRun
from socialbot.runs.heard_sounds import heard_sound
from socialbot.runs.narration import log_lines
from socialbot.runs.pages import thumbnail
from socialbot.runs.plan_trees import PlanTrees
from socialbot.runs.run import NoCommands, node_views, overview
from socialbot.runs.why import actions, considered, explain

MAX_RECORDS = 20_000
"""Older records of a long run are left out of the page."""

MAX_EXPLANATIONS = 1500
MAX_REJECTIONS = 20
MAX_PICTURES = 40
MAX_PICTURE_BYTES = 1_500_000
MAX_SOUND_BYTES = 1_000_000
NODE_SAMPLES = 200

_MIND = ("beliefs", "desires", "goals", "plans", "actions", "ended", "paused")
_SHARED = ("sight", "speech", "head")

Track = list[tuple[float, Any]]


def frozen(run: RecordedRun, world: WorldView | None, stamps: Iterable[int], shut: str) -> str:
    """Return the server answers for a page as JSON, gzip and base64.

    Args:
        run: The run to show.
        world: World view of the run, if it has one.
        stamps: Times (ns) of mandatory images.
        shut: Reason for refusing commands.
    """
    history = run.history
    records = history.part(max(0, len(history) - MAX_RECORDS), len(history))
    begin = records[0].stamp if len(records) < len(history) else history.start
    pictures = _pictures(run, stamps, records)
    shown = overview(run, NoCommands(shut))
    has = msgspec.structs.replace(shown.has, pictures=bool(pictures), world=world is not None and bool(world))
    content = {
        "run": msgspec.structs.replace(shown, has=has, problems=(), results={}, since_s=history.seconds(begin)),
        "timeline": {"lanes": run.timeline.lanes(), "distances": distances_of(run)},
        "sounds": _sounds(run, records),
        "log": log_lines(run, records),
        "tracks": _tracks(run, records),
        "trees": _trees(run, begin),
        "nodes": _nodes(run, begin),
        "why": _explanations(run, records),
        "plans": [
            msgspec.structs.replace(each, rejected=each.rejected[-MAX_REJECTIONS:]) for each in considered(history)
        ],
        "pictures": pictures,
        "film": world.film(history.start) if world else None,
    }
    return base64.b64encode(gzip.compress(msgspec.json.encode(content), 6, mtime=0)).decode()


def _pictures(run: RecordedRun, stamps: Iterable[int], records: Sequence[TraceRecord]) -> list[tuple[float, str]]:
    """Return images at the given times, then evenly spaced ones up to the limits, by time."""
    if not run.has_images:
        return []
    seen = [record.stamp for record in records if record.kind == "detection"]
    step = max(1, len(seen) // MAX_PICTURES)
    found: dict[int, str] = {}
    size = 0
    for stamp in dict.fromkeys([*stamps, *seen[::step], *seen[-1:]]):
        picture = run.picture(stamp)
        if picture is None or picture.stamp in found:
            continue
        if size > MAX_PICTURE_BYTES or len(found) >= 2 * MAX_PICTURES:
            break
        small = thumbnail(picture.jpeg)
        if small is not None:
            found[picture.stamp] = small.picture
            size += len(small.picture)
    return [(run.history.seconds(stamp), found[stamp]) for stamp in sorted(found)]


def _sounds(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, str]:
    """Return the sounds of utterances by file name, up to the limit: a data URL, or the name of an equal file."""
    found: dict[str, str] = {}
    known: dict[bytes, str] = {}
    size = 0
    for record in records:
        name = str(record.detail.get("detail", "")) if record.kind == "speech" and record.what == "started" else ""
        name = heard_sound(record.id) if record.kind == "hearing" else name
        sound = run.sound(name) if name else None
        if sound is None or name in found:
            continue
        if sound in known:
            found[name] = known[sound]
        elif size + len(sound) <= MAX_SOUND_BYTES:
            size += len(sound)
            known[sound] = name
            found[name] = f"data:audio/wav;base64,{base64.b64encode(sound).decode()}"
    return found


def _tracks(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, Any]:
    """Return the changes of the shared state and of each agent's mind."""
    agents: dict[str, dict[str, Track]] = {}
    shared: dict[str, Track] = {name: [] for name in _SHARED}
    last: dict[str, Any] = {}
    for number, record in enumerate(records):
        if number + 1 < len(records) and records[number + 1].stamp == record.stamp:
            continue
        moment = run.states.at(record.stamp)
        for name in _SHARED:
            _note(shared[name], moment.at_s, getattr(moment, name))
        for agent in moment.agents:
            if last.get(agent.name) is not agent:
                last[agent.name] = agent
                parts = agents.setdefault(agent.name, {part: [] for part in _MIND})
                for part in _MIND:
                    _note(parts[part], moment.at_s, getattr(agent, part))
    return {"agents": agents, **shared}


def _note(track: Track, at_s: float, value: Any) -> None:
    if not track or track[-1][1] != value:
        track.append((at_s, value))


def _trees(run: RecordedRun, begin: int) -> list[Track]:
    history, trees = run.history, PlanTrees(run.history, run.wording)
    tracks: dict[tuple[str, str], Track] = {}
    for record in history:
        if trees.take(record) and record.stamp >= begin:
            at_s = history.seconds(record.stamp)
            for desire, tree in trees.trees().items():
                _note(tracks.setdefault(desire, []), at_s, tree)
    return list(tracks.values())


def _nodes(run: RecordedRun, begin: int) -> dict[str, Track]:
    tracks: dict[str, Track] = {}
    history = run.history
    for number in range(NODE_SAMPLES + 1):
        stamp = begin + (run.end - begin) * number // NODE_SAMPLES
        for status in node_views(run, stamp):
            _note(tracks.setdefault(status["name"], []), history.seconds(stamp), status)
    return tracks


def _explanations(run: RecordedRun, records: Sequence[TraceRecord]) -> dict[str, Any]:
    """Explain actions first, then other records, evenly chosen up to the limit."""
    acted = {id(record) for record in actions(run.history)}
    others = [record for record in records if id(record) not in acted and record.kind != "detection"]
    found: dict[str, Any] = {}
    for meant in ([record for record in records if id(record) in acted], others):
        free = MAX_EXPLANATIONS - len(found)
        first = len(meant) if len(meant) <= free else free // 2
        for record in (*meant[:first], *meant[max(first, len(meant) - free + first) :]):
            found[record.id] = explain(run.history, run.wording, record)
    return found
