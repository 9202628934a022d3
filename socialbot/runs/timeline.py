"""Timeline lanes of a run: desires, plans, steps, goals, actions, speech and persons."""

from __future__ import annotations

from itertools import islice

import msgspec
from msgspec.structs import replace

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Wording

AWAY_S = 1.0
"""A person unseen for longer gets a new bar."""

ORDER = ("people", "desires", "plans", "steps", "goals", "actions", "head", "heard", "speech")


class Bar(msgspec.Struct, frozen=True, rename={"from_s": "from", "to_s": "to"}):
    """Interval in seconds from the start; ``to_s`` is None while it is open. ``id`` is that of its record."""

    id: str
    kind: str
    text: str
    from_s: float
    to_s: float | None = None
    outcome: str = ""


class Lane(msgspec.Struct, frozen=True):
    """Bars of one sort and one agent (empty for shared ones), by start; they may overlap."""

    agent: str
    name: str
    bars: tuple[Bar, ...]


class Changed(msgspec.Struct, frozen=True):
    """New or changed bar."""

    agent: str
    lane: str
    bar: Bar


class Timeline:
    """Bars of a run, updated record by record."""

    def __init__(self, history: History, wording: Wording | None = None) -> None:
        self._history = history
        self._wording = wording or Wording()
        self._lanes: dict[tuple[str, str], dict[str, Bar]] = {}
        self._at: dict[str, tuple[str, str]] = {}
        self._tracks: dict[str, str] = {}
        self._plans: dict[tuple[str, int], str] = {}
        self._changed: dict[str, None] = {}

    def lanes(self) -> tuple[Lane, ...]:
        keys = sorted(
            filter(self._lanes.get, self._lanes),
            key=lambda key: (key[0] != "" and 1 + self._place(key[0]), ORDER.index(key[1])),
        )
        return tuple(Lane(*key, tuple(self._lanes[key].values())) for key in keys)

    def changed(self) -> tuple[Changed, ...]:
        """Return the bars that changed since the last call."""
        found = tuple(Changed(*self._at[id], self._lanes[self._at[id]][id]) for id in self._changed)
        self._changed.clear()
        return found

    def forget(self, stamp: int) -> None:
        """Drop the bars that ended before ``stamp`` (ns)."""
        since = self._history.seconds(stamp)
        for bars in self._lanes.values():
            for bar in [bar for bar in bars.values() if bar.to_s is not None and bar.to_s < since]:
                del bars[bar.id], self._at[bar.id]
                self._changed.pop(bar.id, None)
        self._plans = {plan: id for plan, id in self._plans.items() if id in self._at}
        self._tracks = {track: id for track, id in self._tracks.items() if id in self._at}

    def take(self, record: TraceRecord) -> None:
        """Process the next record; a plan step replaces its own goal or action of an engine."""
        history, detail, what = self._history, record.detail, record.what
        match record.kind:
            case "detection":
                self._see(record)
            case "utterance":
                self._begin(record, "speech", what, agent="")
                self._close(record.id, record, "waiting", ends=False)
            case "speech":
                self._close(record.cause, record, what, ends=what not in ("waiting", "started"))
            case "hearing":
                begin_s = history.seconds(int(detail.get("start", record.stamp)))
                self._put(
                    ("", "heard"), Bar(record.id, "heard", what, max(begin_s, 0.0), history.seconds(record.stamp))
                )
            case "head":
                last = next(reversed(self._lanes.get(("", "head"), {}).values()), None)
                if last is not None:
                    self._close(last.id, record, last.outcome)
                self._begin(record, "head", what, agent="")
            case "desire":
                if self._open_desire(record) is None:
                    self._begin(record, "desires", what)
            case "desire_fulfilled" | "desire_dropped":
                self._close(self._open_desire(record), record, record.kind.removeprefix("desire_"))
            case "plan_start":
                number = detail.get("plan", 0)
                self._plans[record.source, number] = record.id
                self._begin(record, "plans", f"plan {number} for {what}")
            case "plan_end":
                number = detail.get("plan", 0)
                self._close(self._plans.get((record.source, number)), record, str(detail.get("outcome", "")))
            case "step":
                self._begin(record, "steps", self._wording.step(record))
                self._leave_out(history.cause(record))
            case "step_end" | "action_end":
                self._close(record.cause, record, str(detail.get("outcome", "")))
            case "goal":
                cause = history.cause(record)
                if cause is None or cause.kind != "step":
                    self._begin(record, "goals", what)
            case "achieved" | "continued":
                self._close(record.cause, record, record.kind)
            case "action":
                step = next((each for each in islice(history.before(record), 3) if each.kind == "step"), None)
                if step is None and not what.startswith("."):
                    self._begin(record, "actions", what)
                    self._close(record.id, record, "")
            case "progress":
                self._close(record.cause, record, "", ends=False)
            case "dropped":
                for each in history.before(record):
                    if each.kind == "goal":
                        self._close(each.id, record, str(detail.get("reason") or "dropped"))

    def _see(self, record: TraceRecord) -> None:
        now = self._history.seconds(record.stamp)
        for person in record.detail.get("persons", ()):
            track = str(person.get("track_id") or "somebody")
            bar = self._bar(self._tracks.get(track, ""))
            if bar is None or now - (bar.to_s or 0.0) > AWAY_S:
                id = f"{track}@{record.id}"
                self._tracks[track] = id
                self._put(("", "people"), Bar(id, "person", track, now, now))
            else:
                self._put(("", "people"), replace(bar, to_s=max(now, bar.to_s or 0.0)))

    def _begin(self, record: TraceRecord, lane: str, text: str, agent: str | None = None) -> None:
        key = (record.source if agent is None else agent, lane)
        self._put(key, Bar(record.id, lane.removesuffix("s"), text, self._history.seconds(record.stamp)))

    def _close(self, id: str | None, record: TraceRecord, outcome: str, *, ends: bool = True) -> None:
        bar = self._bar(id or "")
        if bar is not None:
            to_s = self._history.seconds(record.stamp) if ends else None
            self._put(self._at[bar.id], replace(bar, to_s=to_s, outcome=outcome))

    def _leave_out(self, record: TraceRecord | None) -> None:
        key = None if record is None or record.kind != "action" else self._at.pop(record.id, None)
        if record is not None and key is not None:
            del self._lanes[key][record.id]
            self._changed.pop(record.id, None)

    def _open_desire(self, record: TraceRecord) -> str | None:
        bars = self._lanes.get((record.source, "desires"), {})
        return next((bar.id for bar in bars.values() if bar.text == record.what and bar.to_s is None), None)

    def _bar(self, id: str) -> Bar | None:
        key = self._at.get(id)
        return None if key is None else self._lanes[key][id]

    def _put(self, key: tuple[str, str], bar: Bar) -> None:
        self._lanes.setdefault(key, {})[bar.id] = bar
        self._at[bar.id] = key
        self._changed[bar.id] = None

    def _place(self, agent: str) -> int:
        return self._history.agents.index(agent) if agent in self._history.agents else len(self._history.agents)


def timeline_of(history: History, wording: Wording | None = None) -> Timeline:
    """Return the timeline of a history."""
    timeline = Timeline(history, wording)
    for record in history:
        timeline.take(record)
    return timeline
