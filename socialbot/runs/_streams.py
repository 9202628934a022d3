"""Runs as streams by time for export: persons, sentences, minds and head poses."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from typing import NamedTuple

from socialbot.core.clock import SECOND
from socialbot.core.messages import Mind, MindBelief, PersonDetections, TraceRecord
from socialbot.runs.history import OF_TOPICS
from socialbot.runs.narration import Narrator
from socialbot.runs.run import RunView
from socialbot.runs.state import AgentMind, persons_of

FAILURES = frozenset({"failure", "desire_refused", "refused", "silent"})
LEAP = 3600 * SECOND
_POSE = re.compile(r"\b(?P<joint>\w+) (?P<angle>-?\d+\.\d+) rad")


class EventSentence(NamedTuple):
    """Event at a time (ns) with its source."""

    stamp: int
    source: str
    text: str
    is_failure: bool


class HeadTarget(NamedTuple):
    """Target pose of the head at a time (ns), in rad: pan left, tilt up."""

    stamp: int
    pan: float
    tilt: float
    duration_s: float


def beats(run: RunView, period: int) -> Iterator[int]:
    """Yield times ``period`` (ns) apart; jumps of the clock are skipped."""
    stamp = run.history.start
    for record in run.history:
        if record.stamp - stamp > LEAP:
            stamp = record.stamp
        while stamp <= record.stamp:
            yield stamp
            stamp += period


def detections_of(run: RunView, frame_id: str = "camera") -> Iterator[PersonDetections]:
    """Yield the detections; the frame size is 0 if it is not recorded."""
    for record in run.history:
        if record.kind == "detection":
            size = {side: record.detail.get(side, 0) for side in ("width", "height")}
            yield PersonDetections(stamp=record.stamp, frame_id=frame_id, persons=persons_of(record), **size)


def sentences_of(run: RunView) -> Iterator[EventSentence]:
    """Yield all events except detections as sentences."""
    narrator = Narrator(run.wording, run.history)
    for record in run.history:
        if (sentence := sentence_of(narrator, record)) is not None:
            yield sentence


def sentence_of(narrator: Narrator, record: TraceRecord) -> EventSentence | None:
    """Return the event as a sentence; None for a detection or motion."""
    if record.kind in ("detection", "motion"):
        return None
    told = narrator.clause(record).sentence()
    return EventSentence(record.stamp, record.source, told[:1].upper() + told[1:] + ".", record.kind in FAILURES)


def minds_of(run: RunView) -> Iterator[Mind]:
    """Yield the mind of each agent at each change."""
    before: dict[str, tuple[object, ...]] = {}
    records = [record for record in run.history if record.kind not in OF_TOPICS]
    for record, following in itertools.zip_longest(records, records[1:]):
        if following is not None and following.stamp == record.stamp:
            continue
        for agent in run.states.at(record.stamp).agents:
            mind = mind_of(run, agent, record.stamp)
            content = (mind.beliefs, mind.desires, mind.intentions)
            if before.get(agent.name) != content:
                before[agent.name] = content
                yield mind


def poses_of(run: RunView) -> Iterator[HeadTarget]:
    """Yield the target poses of the head."""
    for record in run.history:
        angles = {found["joint"]: float(found["angle"]) for found in _POSE.finditer(record.what)}
        if record.kind == "motion" and len(angles) == 2:
            pan, tilt = angles.values()
            yield HeadTarget(record.stamp, pan, tilt, float(record.detail.get("duration_s", 0.0)))


def mind_of(run: RunView, agent: AgentMind, stamp: int) -> Mind:
    """Return the mind of an agent as a message."""
    wants = tuple(want.text for want in agent.desires) or tuple(goal.text for goal in agent.goals if not goal.depth)
    plans = tuple(f"{plan.desire}: {plan.done} of {plan.steps} steps" for plan in agent.plans)
    steps = tuple(f"{goal.text}: {goal.step}" if goal.step else goal.text for goal in agent.goals)
    return Mind(
        stamp=stamp,
        agent=agent.name,
        beliefs=tuple(
            MindBelief(text=held.text, source=held.source, since=run.history.stamp(held.since_s))
            for held in agent.beliefs
        ),
        desires=wants,
        intentions=(*plans, *steps, *(doing.text for doing in agent.actions)),
    )
