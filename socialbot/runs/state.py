"""State of a run at any time: agents, persons in view, speech and head."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec
from msgspec.structs import replace

from socialbot.core.decoding import from_builtins
from socialbot.core.messages import PersonDetection, TraceRecord
from socialbot.runs.history import OF_TOPICS, History
from socialbot.runs.narration import Wording, plan_name


class BeliefView(msgspec.Struct, frozen=True):
    """Belief with its source; ``since_s`` counts from the start of the run, ``id`` is that of its record."""

    id: str
    text: str
    source: str
    since_s: float


class DesireView(msgspec.Struct, frozen=True):
    """Desire with its priority (0 to 1) and deadline (s from the start)."""

    id: str
    text: str
    since_s: float
    priority: float | None = None
    due_s: float | None = None


class GoalView(msgspec.Struct, frozen=True):
    """Goal of the engine, ``depth`` goals below the first one, with its plan and current step.

    ``acted`` is true once an action was carried out for it, also for goals below it.
    """

    id: str
    text: str
    since_s: float
    depth: int = 0
    plan: str = ""
    step: str = ""
    acted: bool = False


class ActivePlan(msgspec.Struct, frozen=True):
    """Plan in execution for a desire."""

    id: str
    desire: str
    number: int
    since_s: float
    steps: int
    done: int = 0


class ActiveAction(msgspec.Struct, frozen=True):
    """Action or plan step in execution; ``done`` is the fraction, if known."""

    id: str
    text: str
    since_s: float
    done: float | None = None


class ResultView(msgspec.Struct, frozen=True):
    """Result of a ``desire``, ``goal``, ``plan`` or ``action``."""

    id: str
    kind: str
    text: str
    at_s: float
    outcome: str


class AgentMind(msgspec.Struct, frozen=True):
    """State of an agent. ``ended`` lists the latest results first; ``paused`` by a person."""

    name: str
    beliefs: tuple[BeliefView, ...]
    desires: tuple[DesireView, ...]
    goals: tuple[GoalView, ...]
    plans: tuple[ActivePlan, ...]
    actions: tuple[ActiveAction, ...]
    ended: tuple[ResultView, ...]
    paused: bool = False


class FrameView(msgspec.Struct, frozen=True):
    """Persons in the latest frame; its size (pixels) is 0 if unknown."""

    id: str
    at_s: float
    persons: tuple[PersonDetection, ...]
    width: int = 0
    height: int = 0


class SpokenUtterance(msgspec.Struct, frozen=True):
    """Utterance with its state: waiting, started, finished, replaced, expired or failed.

    ``agent`` is the speaker, if known; ``sound`` the name of its sound file.
    """

    id: str
    text: str
    since_s: float
    state: str
    agent: str = ""
    sound: str = ""


class HeadView(msgspec.Struct, frozen=True):
    """Head mode (track, centre or look) and joint targets.

    The head moves until ``moves_until_s``; ``agent`` gave the last command, if known.
    """

    id: str
    mode: str
    since_s: float
    joints: str = ""
    moves_until_s: float = 0.0
    agent: str = ""


class RunState(msgspec.Struct, frozen=True):
    """State of a run at ``at_s``; times are seconds from its start. ``records`` counts the records until then."""

    at_s: float
    records: int
    agents: tuple[AgentMind, ...]
    sight: FrameView | None = None
    speech: tuple[SpokenUtterance, ...] = ()
    head: HeadView | None = None


WITHOUT_ACTION = "achieved without any action"
"""Outcome of a goal whose plan had nothing to do, such as greeting people who were greeted."""

ENDED = 5


@dataclass
class MindState:
    """State of an agent that `take` advances record by record."""

    name: str
    beliefs: dict[str, BeliefView] = field(default_factory=dict)
    desires: dict[str, DesireView] = field(default_factory=dict)
    goals: dict[str, GoalView] = field(default_factory=dict)
    plans: dict[int, ActivePlan] = field(default_factory=dict)
    actions: dict[str, ActiveAction] = field(default_factory=dict)
    ended: tuple[ResultView, ...] = ()
    paused: bool = False
    _shown: AgentMind | None = None

    def copy(self) -> MindState:
        return MindState(self.name, *map(dict, self._parts()), self.ended, self.paused, self._shown)  # type: ignore[arg-type]

    def _parts(self) -> tuple[dict[Any, Any], ...]:
        return self.beliefs, self.desires, self.goals, self.plans, self.actions

    def moment(self) -> AgentMind:
        if self._shown is None:
            self._shown = AgentMind(
                self.name,
                *(tuple(part.values()) for part in self._parts()),  # type: ignore[arg-type]
                ended=self.ended,
                paused=self.paused,
            )
        return self._shown

    def ids(self) -> Iterator[str]:
        return (item.id for part in self._parts() for item in part.values())

    def take(self, record: TraceRecord, history: History, wording: Wording) -> None:
        """Process the next record of this agent."""
        self._shown = None
        since = history.seconds(record.stamp)
        what, detail = record.what, record.detail
        match record.kind:
            case "command" if what in ("pause", "resume"):
                self.paused = what == "pause"
            case "belief":
                self._believe(record, since)
            case "unbelief":
                known = self.beliefs.pop(what, None)
                if known is not None and detail.get("left"):
                    self.beliefs[what] = replace(known, source=str(detail["left"]))
            case "desire":
                deadline = detail.get("deadline")
                due = None if deadline is None else round(since + deadline, 6)
                self.desires[what] = DesireView(record.id, what, since, detail.get("priority"), due)
            case "desire_fulfilled" | "desire_dropped":
                self.desires.pop(what, None)
                self._end(record, "desire", what, since, record.kind.removeprefix("desire_"))
            case "goal":
                above = self._goal_above(record, history)
                self.goals[record.id] = GoalView(record.id, what, since, 0 if above is None else above.depth + 1)
            case "plan":
                goal = self.goals.get(record.cause)
                if goal is not None:
                    self.goals[goal.id] = replace(goal, plan=plan_name(record), step="")
            case "achieved" | "continued":
                goal = self.goals.pop(record.cause, None)
                if goal is not None and record.kind == "achieved":
                    self._end(record, "goal", what, since, "achieved" if goal.acted else WITHOUT_ACTION)
            case "dropped":
                self._drop(record, since, history)
            case "plan_start":
                if not detail.get("beside"):
                    self.plans.clear()
                number = detail.get("plan", 0)
                self.plans[number] = ActivePlan(record.id, what, number, since, len(detail.get("steps", ())))
            case "plan_end":
                self.plans.pop(detail.get("plan", 0), None)
                self._end(record, "plan", what, since, str(detail.get("outcome", "")))
            case "step":
                self.actions[record.id] = ActiveAction(record.id, wording.step(record), since)
            case "step_end":
                self._step_end(record, since, history, wording)
            case "action" | "progress" | "action_end":
                self._act(record, since, history)

    def note_done(self, step: TraceRecord) -> None:
        """Process the end of a successful step of one of this agent's plans, also one that another agent executed."""
        number = step.detail.get("plan", next(iter(self.plans), 0))
        plan = self.plans.get(number)
        if plan is not None:
            self._shown = None
            self.plans[number] = replace(plan, done=min(plan.done + 1, plan.steps))

    def _believe(self, record: TraceRecord, since: float) -> None:
        source, known = str(record.detail.get("source", "")), self.beliefs.get(record.what)
        if known is None:
            self.beliefs[record.what] = BeliefView(record.id, record.what, source, since)
        elif source not in known.source.split(", "):
            self.beliefs[record.what] = replace(known, source=f"{known.source}, {source}")

    def _goal_above(self, record: TraceRecord, history: History) -> GoalView | None:
        cause = history.cause(record)
        while cause is not None and cause.kind in ("plan", "action", "failure"):
            cause = history.cause(cause)
        return None if cause is None else self.goals.get(cause.id)

    def _act(self, record: TraceRecord, since: float, history: History) -> None:
        """Process an action of the engine; an action that carries out a plan step is shown as that step."""
        action = record if record.kind == "action" else history.find(record.cause)
        if action is None:
            return
        goal = self._goal_above(action, history)
        if record.kind == "action":
            if goal is not None:
                self.goals[goal.id] = replace(goal, step=record.what)
                self._note_acted(goal, history)
            return
        goal_record = None if goal is None else history.find(goal.id)
        step = None if goal_record is None else self.actions.get(goal_record.cause)
        if record.kind == "progress":
            begun = ActiveAction(action.id, action.what, history.seconds(action.stamp))
            doing = step or self.actions.get(action.id) or begun
            self.actions[doing.id] = replace(doing, done=record.detail.get("fraction"))
        elif step is None:
            self.actions.pop(action.id, None)
            self._end(record, "action", action.what, since, str(record.detail.get("outcome", "finished")))

    def _note_acted(self, goal: GoalView | None, history: History) -> None:
        while goal is not None and not self.goals[goal.id].acted:
            self.goals[goal.id] = replace(self.goals[goal.id], acted=True)
            begun = history.find(goal.id)
            goal = None if begun is None else self._goal_above(begun, history)

    def _step_end(self, record: TraceRecord, since: float, history: History, wording: Wording) -> None:
        step = history.find(record.cause)
        doing = self.actions.pop(record.cause, None)
        text = doing.text if doing else wording.step(record) if step is None else wording.step(step)
        self._end(record, "action", text, since, str(record.detail.get("outcome", "")))

    def _drop(self, record: TraceRecord, since: float, history: History) -> None:
        for each in history.before(record):
            if each.kind not in ("goal", "plan", "action", "failure"):
                break
            goal = self.goals.pop(each.id, None)
            if goal is not None:
                reason = record.detail.get("message") or record.detail.get("reason") or "dropped"
                self._end(record, "goal", goal.text, since, str(reason))

    def _end(self, record: TraceRecord, kind: str, text: str, at_s: float, outcome: str) -> None:
        self.ended = (ResultView(record.id, kind, text, at_s, outcome), *self.ended)[:ENDED]


APART = 256
"""Number of records between two checkpoints."""

SENTENCES = 3


@dataclass
class _Scene:
    """State of the run at one record. Minds are shared with earlier scenes until they change."""

    minds: dict[str, MindState] = field(default_factory=dict)
    own: set[str] = field(default_factory=set)
    sight: TraceRecord | None = None
    speech: tuple[SpokenUtterance, ...] = ()
    head: HeadView | None = None

    def fork(self) -> _Scene:
        """Return a scene that continues from here; this one must not change any more."""
        return _Scene(dict(self.minds), set(), self.sight, self.speech, self.head)

    def mind(self, name: str) -> MindState:
        """Return the mind of an agent for changes."""
        if name not in self.own:
            self.own.add(name)
            self.minds[name] = self.minds[name].copy() if name in self.minds else MindState(name)
        return self.minds[name]


class StateIndex:
    """States of a history, which may grow, found from checkpoints."""

    def __init__(self, history: History, wording: Wording | None = None) -> None:
        self._history = history
        self._wording = wording or Wording()
        self._checkpoints: list[tuple[int, _Scene]] = [(0, _Scene())]
        self._latest: tuple[int, _Scene] = (0, _Scene())
        self._late = 0

    def at(self, stamp: int) -> RunState:
        """Return the state at ``stamp`` (ns), including all records of that stamp."""
        count = self._history.until(stamp)
        self._drop_late_checkpoints()
        scene = self._scene(count)
        return RunState(
            at_s=self._history.seconds(stamp),
            records=self._history.forgotten + count,
            agents=tuple(mind.moment() for mind in scene.minds.values()),
            sight=self._sight(scene.sight),
            speech=scene.speech,
            head=scene.head,
        )

    def prepare(self) -> None:
        """Build all checkpoints."""
        self.at(self._history.end)

    def forget(self, count: int) -> int:
        """Drop about ``count`` of the first records of the history and return how many.

        The state after them becomes the first checkpoint. The last record is kept, as a history needs an end.
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

    def _drop_late_checkpoints(self) -> None:
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
                spoken = SpokenUtterance(record.id, record.what, since, "waiting", self._agent(record))
                scene.speech = (*scene.speech, spoken)[-SENTENCES:]
            case "speech":
                changed = {"state": record.what, "since_s": since}
                if record.what == "started":
                    changed["sound"] = str(record.detail.get("detail", ""))
                scene.speech = tuple(replace(x, **changed) if x.id == record.cause else x for x in scene.speech)
            case "head":
                head = scene.head or HeadView(record.id, "", since)
                scene.head = replace(head, id=record.id, mode=record.what, since_s=since, agent=self._agent(record))
            case "motion":
                head = scene.head or HeadView(record.id, "", since)
                until_s = round(since + float(record.detail.get("duration_s") or 0.0), 6)
                scene.head = replace(head, joints=record.what, moves_until_s=until_s)

    def _agent(self, record: TraceRecord) -> str:
        """Return the agent behind a record of a topic; empty if unknown."""
        return next((each.source for each in self._history.before(record) if each.kind not in OF_TOPICS), "")

    def _sight(self, record: TraceRecord | None) -> FrameView | None:
        if record is None:
            return None
        at_s, size = self._history.seconds(record.stamp), [record.detail.get(side, 0) for side in ("width", "height")]
        return FrameView(record.id, at_s, persons_of(record), *size)


def persons_of(record: TraceRecord) -> tuple[PersonDetection, ...]:
    """Return the persons of a detection record."""
    return from_builtins(record.detail.get("persons", ()), tuple[PersonDetection, ...])
