"""Distances of the people over the time of a run, with the ranges of its agents."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.run import RunView

GAP_S = 1.0
"""A person unseen for longer gets a new line."""

STEP_M = 0.05
"""Smaller changes are left out, except for one point each `GAP_S`."""

Point = tuple[float, float | None]
"""Time (s from the start) and distance (m); None interrupts the line."""


class Range(msgspec.Struct, frozen=True):
    """Distance up to which an agent attends to people, from its parameter ``range_m``."""

    agent: str
    range_m: float


class Distances(msgspec.Struct, frozen=True):
    """Distance of each tracked person over time, by track id."""

    ranges: tuple[Range, ...]
    tracks: dict[str, list[Point]]


def distances_of(run: RunView) -> Distances:
    """Return the distances of a run, without points that a line between others shows."""
    return Distances(tuple(ranges_of(run)), _tracks(run.history))


def ranges_of(run: RunView) -> Iterator[Range]:
    """Yield the range of each agent that has one: as recorded, else as the graph states it."""
    recorded = run.results.get("parameters", {})
    for node in run.graph.nodes if run.graph else ():
        declared = node.type.parameters().get("range_m")
        stated = {} if declared is None else {"range_m": declared.default, **node.parameters}
        recorded = {node.name: stated, **recorded}
    for agent, values in recorded.items():
        if isinstance(values.get("range_m"), int | float):
            yield Range(agent, float(values["range_m"]))


def _tracks(history: History) -> dict[str, list[Point]]:
    tracks: dict[str, list[Point]] = {}
    latest: dict[str, tuple[float, float]] = {}
    for record in history:
        if record.kind == "detection":
            at_s = history.seconds(record.stamp)
            for track, distance_m in _people(record):
                points, before = tracks.setdefault(track, []), latest.get(track)
                if before is not None and at_s - before[0] > GAP_S:
                    points += [*_unless_last(points, before), (before[0], None)]
                    before = None
                drawn = points[-1] if points else (at_s, None)
                if before is None or at_s - drawn[0] >= GAP_S or abs(distance_m - (drawn[1] or 0.0)) >= STEP_M:
                    points.append((at_s, distance_m))
                latest[track] = at_s, distance_m
    for track, last in latest.items():
        tracks[track] += _unless_last(tracks[track], last)
    return tracks


def _people(record: TraceRecord) -> Iterator[tuple[str, float]]:
    for person in record.detail.get("persons", ()):
        if person.get("track_id") and person.get("distance_m") is not None:
            yield str(person["track_id"]), round(float(person["distance_m"]), 2)


def _unless_last(points: list[Point], point: tuple[float, float]) -> list[Point]:
    return [] if points and points[-1] == point else [point]
