"""Desires, plans, messages and results of deliberating agents, derived from their trace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.narration import Narrator, Origin, Phrases, Wording, in_words

SHORT_S = 20.0


@dataclass(eq=False)
class PlanRecord:
    """Execution of a plan of ``steps`` steps; ``makespan_s`` is None for plans without times.

    ``again``: it replaces a plan that was given up. ``outcome``: succeeded, failed, aborted, lost, or empty.
    """

    agent: str
    number: int
    desire: str
    began: int
    makespan_s: float | None
    steps: int
    again: bool
    ended: int | None = None
    outcome: str = ""
    reason: str = ""

    @property
    def given_up(self) -> bool:
        return self.outcome in ("failed", "aborted", "lost")


@dataclass(eq=False)
class StepRecord:
    """Execution of a plan step. Times are ns; ``began`` is None for a step that could not begin."""

    agent: str
    plan: PlanRecord | None
    call: str
    text: str
    began: int | None
    ended: int | None = None
    outcome: str = ""
    message: str = ""


@dataclass(eq=False)
class RequestRecord:
    """Request between agents; ``state`` is the last answer. Times are ns."""

    id: str
    sender: str
    receiver: str
    text: str
    asked: int
    about_desire: bool
    ended: int | None = None
    state: str = "waiting"
    reason: str = ""


@dataclass(eq=False)
class DesireRecord:
    """Desire with its origin and result.

    ``how``: fulfilled, dropped, refused, needless (its parent desire has ended), or empty.
    """

    agent: str
    name: str
    why: str
    origin: Origin
    adopted: int
    priority: float | None = None
    deadline_s: float | None = None
    ended: int | None = None
    how: str = ""
    reason: str = ""


T = TypeVar("T", DesireRecord, PlanRecord, StepRecord)


@dataclass
class Story:
    """Desires, plans, steps and messages of a run by agents in order of appearance. Times are ns.

    ``words`` are the records of messages, ``world`` the results of the world view.
    """

    start: int = 0
    end: int = 0
    agents: list[str] = field(default_factory=list)
    desires: list[DesireRecord] = field(default_factory=list)
    plans: list[PlanRecord] = field(default_factory=list)
    steps: list[StepRecord] = field(default_factory=list)
    requests: list[RequestRecord] = field(default_factory=list)
    words: list[TraceRecord] = field(default_factory=list)
    world: Mapping[str, Any] = field(default_factory=dict)

    def seconds(self, time: int) -> float:
        """Convert a time (ns) to seconds from the start."""
        return (time - self.start) / SECOND

    @property
    def duration_s(self) -> float:
        return self.seconds(self.end)

    @property
    def aims(self) -> list[DesireRecord]:
        """Main desires of the run: the agents' own ones, or else those from rules."""
        own = [desire for desire in self.desires if desire.origin == "own"]
        return own or [desire for desire in self.desires if desire.origin == "rule"]

    @property
    def reached(self) -> bool:
        """Whether all main desires were fulfilled, and the world shows it."""
        return {desire.how for desire in self.aims} == {"fulfilled"} and not self.unfinished

    @property
    def unfinished(self) -> list[str]:
        """Parts of the goal that do not hold at the end."""
        return list(self.world.get("unfinished", ()))

    @property
    def first(self) -> DesireRecord | None:
        return next(iter(self.aims), None)

    def makespans_s(self, desire: DesireRecord) -> tuple[float | None, float | None]:
        """Return the makespan of the first plan for a desire, and the actual duration (s)."""
        plans = self.plans_for(desire)
        if not plans:
            return None, None
        real = None if desire.how != "fulfilled" or desire.ended is None else (desire.ended - plans[0].began) / SECOND
        return plans[0].makespan_s, real

    def when(self, stamp: int | None) -> str:
        """Return a time (ns) in words, empty for none."""
        digits = 2 if self.duration_s < SHORT_S else 1
        return "" if stamp is None else f"{self.seconds(stamp):.{digits}f} s"

    def plans_for(self, desire: DesireRecord) -> list[PlanRecord]:
        """Return the plans for ``desire`` while it was held."""
        until = self.end if desire.ended is None else desire.ended
        return [
            plan
            for plan in self.plans
            if (plan.agent, plan.desire) == (desire.agent, desire.name) and desire.adopted <= plan.began <= until
        ]

    def lead(self) -> str:
        """Return the result of the run in two or three sentences."""
        first = self.first
        if first is None:
            return "Nobody wanted anything."
        planned_s, took_s = self.makespans_s(first)
        text = f"{first.agent} wanted {first.name}"
        if first.how == "fulfilled" and took_s is not None:
            planned = "." if planned_s is None else f"; its first plan said {planned_s:.1f} s."
            text += f" and reached it after {took_s:.1f} s{planned}"
        elif first.how:
            text += f", which was {first.how}: {first.reason}."
        else:
            text += " and still pursued it when the run ended."
        if len(self.aims) > 1:
            reached = sum(desire.how == "fulfilled" for desire in self.aims)
            text += f" Of {len(self.aims)} desires, {reached} were fulfilled."
        if self.unfinished:
            text += f" But {'; '.join(self.unfinished)}."
        given_up = [plan for plan in self.plans if plan.given_up]
        if not given_up:
            return f"{text} No plan was given up."
        at = f"{self.seconds(given_up[0].ended or 0):.1f} s: {self._failure(given_up[0])}."
        if len(given_up) == 1:
            return f"{text} One plan was given up, at {at}"
        return f"{text} {len(given_up)} plans were given up, first at {at}"

    def _failure(self, plan: PlanRecord) -> str:
        failed = (step for step in self.steps if step.plan is plan and step.outcome == "failed")
        step = next((step for step in failed if step.ended == plan.ended), None)
        return plan.reason if step is None else f"{step.agent} {step.text}, {step.message}"

    def results(self) -> dict[str, Any]:
        """Return the figures for results.json."""
        return {
            "reached": self.reached,
            "duration_s": round(self.duration_s, 3),
            "agents": {
                agent: {
                    "plans": sum(plan.agent == agent for plan in self.plans),
                    "given_up": sum(plan.agent == agent and plan.given_up for plan in self.plans),
                    "steps": sum(step.agent == agent for step in self.steps),
                    "requests": sum(request.sender == agent for request in self.requests),
                }
                for agent in self.agents
            },
            "desires": [
                {
                    "agent": desire.agent,
                    "name": desire.name,
                    "why": desire.why,
                    "from_s": round(self.seconds(desire.adopted), 3),
                    "to_s": None if desire.ended is None else round(self.seconds(desire.ended), 3),
                    "planned_s": planned_s,
                    "took_s": None if took_s is None else round(took_s, 3),
                    "how": desire.how,
                    "reason": desire.reason,
                }
                for desire in self.desires
                for planned_s, took_s in [self.makespans_s(desire)]
            ],
            "requests_for_desires": sum(request.about_desire for request in self.requests),
            **self.world,
        }


def story_of(records: Iterable[TraceRecord], phrases: Phrases | None = None) -> Story:
    """Return the story of ``records``; ``phrases`` describe actions."""
    builder = _StoryBuilder(Wording(phrases=phrases or {}))
    for record in records:
        builder.take(record)
    return builder.story


class _StoryBuilder:
    def __init__(self, wording: Wording) -> None:
        self.story = Story()
        self._wording = wording
        self._narrator = Narrator(wording)
        self._asked: dict[str, RequestRecord] = {}

    def take(self, record: TraceRecord) -> None:
        story, detail = self.story, record.detail
        if not story.agents:
            story.start = record.stamp
        if record.source not in story.agents:
            story.agents.append(record.source)
        story.end = max(story.end, record.stamp)
        sentence = self._narrator.story(record)
        match record.kind:
            case "desire" | "desire_refused":
                self._desire(record)
            case "desire_fulfilled" | "desire_dropped":
                how = "needless" if self._narrator.is_needless(record) else record.kind.removeprefix("desire_")
                for desire in _open(story.desires, record):
                    if desire.name == record.what:
                        desire.ended, desire.how, desire.reason = record.stamp, how, in_words(detail.get("reason", ""))
            case "plan_start":
                self._plan(record)
            case "plan_end":
                for plan in _open(story.plans, record):
                    if plan.number == detail.get("plan", 0):
                        plan.ended, plan.outcome = record.stamp, detail.get("outcome", "")
                        plan.reason = in_words(detail.get("reason", ""))
            case "step":
                self._step(record, record.stamp)
            case "step_end":
                begun = (step for step in _open(story.steps, record) if step.call == record.what)
                step = next(begun, None) or self._step(record, None)
                step.ended, step.outcome = record.stamp, detail.get("outcome", "")
                step.message = detail.get("message", "")
            case "request":
                receiver = record.what.partition(" asks ")[2].partition(" ")[0]
                text = sentence[1] if sentence else ""
                is_desire = " desire " in record.what
                request = RequestRecord(detail.get("id", ""), record.source, receiver, text, record.stamp, is_desire)
                story.requests.append(request)
                self._asked[request.id] = request
            case "reply" if record.cause in self._asked:
                request = self._asked[record.cause]
                request.state, request.reason = record.what.rpartition(": ")[2], detail.get("reason", "")
                request.ended = record.stamp
            case "said":
                story.words.append(record)

    def _desire(self, record: TraceRecord) -> None:
        origin, why, _ = self._narrator.reason(record.cause)
        desire = DesireRecord(record.source, record.what, why, origin, record.stamp)
        if record.kind == "desire":
            desire.priority, desire.deadline_s = record.detail.get("priority"), record.detail.get("deadline")
        else:
            desire.ended, desire.how, desire.reason = record.stamp, "refused", record.detail.get("reason", "")
        self.story.desires.append(desire)

    def _plan(self, record: TraceRecord) -> None:
        detail, story = record.detail, self.story
        left = [] if detail.get("beside") else _open(story.plans, record)  # from a killed agent
        for plan in left:
            plan.ended, plan.outcome, plan.reason = record.stamp, "lost", "the agent was restarted"
            for step in _open(story.steps, record):
                step.ended, step.outcome = record.stamp, "lost"
        pursued = next((one for one in _open(story.desires, record) if one.name == record.what), None)
        since = story.start if pursued is None else pursued.adopted
        again = any(
            (plan.agent, plan.desire) == (record.source, record.what) and plan.reason and plan.began >= since
            for plan in story.plans
        )
        makespan_s, steps = detail.get("makespan_s"), len(detail.get("steps", ()))
        story.plans.append(
            PlanRecord(record.source, detail.get("plan", 0), record.what, record.stamp, makespan_s, steps, again)
        )

    def _step(self, record: TraceRecord, began: int | None) -> StepRecord:
        director, number = record.detail.get("directed_by", record.source), record.detail.get("plan")
        of_agent = (plan for plan in reversed(self.story.plans) if plan.agent == director)
        plan = next((plan for plan in of_agent if number in (None, plan.number)), None)
        step = StepRecord(record.source, plan, record.what, self._wording.step(record), began)
        self.story.steps.append(step)
        return step


def _open(records: list[T], record: TraceRecord) -> list[T]:
    return [each for each in records if each.agent == record.source and each.ended is None]
