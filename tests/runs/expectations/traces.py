"""Small histories for tests of expectations."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.expectations._observation import Observation
from socialbot.runs.expectations.checking import Verdict, judge
from socialbot.runs.expectations.expectations import Expectation
from socialbot.runs.history import History

_NUMBERS = count()


def record(at_s: float, kind: str, what: str, source: str = "robot", cause: str = "", **detail: object) -> TraceRecord:
    name = str(detail.pop("id", f"{source}-{next(_NUMBERS)}"))
    return TraceRecord(
        stamp=nanoseconds(at_s), id=name, source=source, kind=kind, what=what, cause=cause, detail=detail
    )


def frame(at_s: float, **distances_m: float) -> TraceRecord:
    """A frame with persons at distances."""
    box = {"x": 0, "y": 0, "w": 1, "h": 2, "score": 1}
    persons = [{**box, "track_id": name, "distance_m": distance} for name, distance in distances_m.items()]
    return record(at_s, "detection", "persons", "/humans/bodies/detections", persons=persons)


def says(at_s: float, text: str, about: str = "") -> list[TraceRecord]:
    """An utterance with its action, perhaps because of a belief about a person."""
    belief = record(at_s, "belief", f'engages("{about}")')
    action = record(at_s, "action", f'speak("{text}")', cause=belief.id if about else "")
    spoken = record(at_s, "utterance", f"{text.capitalize()}!", "/speech/say", cause=action.id)
    return [*([belief] if about else []), action, spoken]


def check(expectation: Expectation, *records: TraceRecord | Iterable[TraceRecord], end_s: float = 20.0) -> Verdict:
    """Judge a run from 0 s to ``end_s``."""
    flat = [each for one in records for each in ([one] if isinstance(one, TraceRecord) else one)]
    history = History(sorted(flat, key=lambda each: each.stamp), start=0)
    observation = Observation([expectation.formula], history)
    for each in history:
        observation.take_record(each)
    observation.read(nanoseconds(end_s))
    return judge(expectation, observation)
