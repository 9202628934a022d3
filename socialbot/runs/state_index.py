"""A run as moments: what held at any time, found from the nearest checkpoint before it."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import OF_TOPICS, History
from socialbot.runs.names import Wording
from socialbot.runs.state_at import HeadNow, MindThen, Moment, Seen, Sight, Spoken

APART = 256
"""So many records lie between two checkpoints."""

SENTENCES = 3
"""So many sentences that were said last are told."""


@dataclass
class _Scene:
    """Everything at some point of a history. Minds are shared with earlier scenes until they change."""

    minds: dict[str, MindThen] = field(default_factory=dict)
    own: set[str] = field(default_factory=set)
    sight: TraceRecord | None = None
    speech: tuple[Spoken, ...] = ()
    head: HeadNow | None = None

    def fork(self) -> _Scene:
        """Another one that goes on from here; this one is not to be changed any more."""
        return _Scene(dict(self.minds), set(), self.sight, self.speech, self.head)

    def mind(self, name: str) -> MindThen:
        """The mind of an agent, to be changed."""
        if name not in self.own:
            self.own.add(name)
            self.minds[name] = self.minds[name].copy() if name in self.minds else MindThen(name)
        return self.minds[name]


class Course:
    """The moments of a history, which may grow."""

    def __init__(self, history: History, wording: Wording | None = None) -> None:
        self._history = history
        self._wording = wording or Wording()
        self._checkpoints: list[tuple[int, _Scene]] = [(0, _Scene())]
        self._latest: tuple[int, _Scene] = (0, _Scene())
        self._late = 0

    def at(self, stamp: int) -> Moment:
        """What held at ``stamp`` (ns), all records of that stamp included."""
        count = self._history.until(stamp)
        self._forget_what_has_changed()
        scene = self._scene(count)
        return Moment(
            at_s=self._history.seconds(stamp),
            records=self._history.forgotten + count,
            agents=tuple(mind.moment() for mind in scene.minds.values()),
            sight=self._sight(scene.sight),
            speech=scene.speech,
            head=scene.head,
        )

    def prepare(self) -> None:
        """Goes through the history once, so that every moment is found fast from now on."""
        self.at(self._history.end)

    def forget(self, count: int) -> int:
        """Has the history forget ``count`` of its first records, or some fewer, and says how many.

        What held then is where everything goes on from. The last record is kept, as a history without one has no end.
        """
        self.prepare()
        parts = min(count, len(self._history) - 1) // APART
        if parts <= 0:
            return 0
        del self._checkpoints[:parts]
        count = parts * APART
        self._checkpoints = [(place - count, scene) for place, scene in self._checkpoints]
        done, scene = self._latest
        self._latest = done - count, scene
        scenes = (self._checkpoints[0][1], scene)
        self._history.forget(count, {id: None for each in scenes for mind in each.minds.values() for id in mind.ids()})
        self._late = 0
        return count

    def _scene(self, count: int) -> _Scene:
        done, scene = self._latest
        last = min(count // APART, len(self._checkpoints) - 1)
        if not last * APART <= done <= count:
            done, scene = self._checkpoints[last]
            scene = scene.fork()
        while done < count:
            until = min(count, (done // APART + 1) * APART)
            for record in self._history.part(done, until):
                self._take(scene, record)
            done = until
            if done == len(self._checkpoints) * APART:
                self._checkpoints.append((done, scene))
                scene = scene.fork()
        self._latest = done, scene
        return scene

    def _forget_what_has_changed(self) -> None:
        """Records that came late change all that was found out about later moments."""
        late = self._history.late(self._late)
        if late:
            self._late += len(late)
            del self._checkpoints[max(1, min(late) // APART + 1) :]
            if self._latest[0] > min(late):
                self._latest = 0, self._checkpoints[0][1].fork()

    def _take(self, scene: _Scene, record: TraceRecord) -> None:
        if record.kind not in OF_TOPICS:
            scene.mind(record.source).take(record, self._history, self._wording)
            if record.kind == "step_end" and record.detail.get("outcome") == "successful":
                step = self._history.find(record.cause) or record
                scene.mind(step.detail.get("directed_by", record.source)).note_done(step)
            return
        since = self._history.seconds(record.stamp)
        match record.kind:
            case "detection":
                scene.sight = record
            case "utterance":
                spoken = Spoken(record.id, record.what, since, "waiting")
                scene.speech = (*scene.speech, spoken)[-SENTENCES:]
            case "speech":
                scene.speech = tuple(
                    msgspec.structs.replace(spoken, state=record.what, since_s=since)
                    if spoken.id == record.cause
                    else spoken
                    for spoken in scene.speech
                )
            case "head":
                scene.head = HeadNow(record.id, record.what, since, scene.head.joints if scene.head else "")
            case "motion":
                head = scene.head or HeadNow(record.id, "", since)
                scene.head = msgspec.structs.replace(head, joints=record.what)

    def _sight(self, record: TraceRecord | None) -> Sight | None:
        if record is None:
            return None
        detail = record.detail
        return Sight(
            record.id,
            self._history.seconds(record.stamp),
            persons_of(record),
            detail.get("width", 0),
            detail.get("height", 0),
        )


def persons_of(record: TraceRecord) -> tuple[Seen, ...]:
    """The persons that a detection tells of."""
    return msgspec.convert(record.detail.get("persons", ()), tuple[Seen, ...])
