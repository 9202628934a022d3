"""Desires, plans, messages and results of deliberating agents, derived from their trace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.planning.pddl.domain import PddlPlan, PlanStep, parse_plan
from socialbot.runs.narration import Origin, Phrases, StoryNarrator, Wording, in_words

SHORT_S = 20.0
"""Times of shorter runs have two decimal places."""


@dataclass(eq=False)
class PlanRecord:
    """Execution of a plan. ``outcome``: succeeded, failed, aborted, lost, or empty while it is executed.

    ``makespan_s`` is None for plans without times. ``tree`` and ``last_tree`` draw its tasks at the start and at the
    end.
    """

    agent: str
    number: int
    desire: str
    began: int
    makespan_s: float | None
    plan: PddlPlan
    again: bool
    """Whether it replaces a plan that was given up."""
    tree: str = ""
    last_tree: str = ""
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
    action: str
    args: tuple[str, ...]
    text: str
    began: int | None
    planned: PlanStep | None = None
    ended: int | None = None
    outcome: str = ""
    message: str = ""

    @property
    def call(self) -> str:
        return f"({' '.join((self.action, *self.args))})"


@dataclass(eq=False)
class RequestRecord:
    """Request between agents; ``state`` is the last answer. Times are ns."""

    id: str
    sender: str
    receiver: str
    text: str
    asked: int
    about_desire: bool
    answered: int | None = None
    ended: int | None = None
    state: str = "waiting"
    reason: str = ""


@dataclass(eq=False)
class MessageRecord:
    """Message between agents at ``stamp`` (ns).

    ``weight``: a ``plan``, a ``problem``, a ``word`` between partners, or empty.
    """

    id: str
    stamp: int
    sender: str
    receiver: str
    performative: str
    content: str
    text: str
    about: str
    weight: str


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
    """Desires, plans, steps and messages of a run by agents in order of appearance. Times are ns."""

    start: int = 0
    end: int = 0
    agents: list[str] = field(default_factory=list)
    desires: list[DesireRecord] = field(default_factory=list)
    plans: list[PlanRecord] = field(default_factory=list)
    steps: list[StepRecord] = field(default_factory=list)
    requests: list[RequestRecord] = field(default_factory=list)
    words: list[MessageRecord] = field(default_factory=list)

    def seconds(self, time: int) -> float:
        """Convert a time (ns) to seconds from the start."""
        return (time - self.start) / SECOND

    @property
    def duration_s(self) -> float:
        return self.seconds(self.end)

    @property
    def digits(self) -> int:
        """Decimal places that keep times of the run distinct."""
        return 2 if self.duration_s < SHORT_S else 1

    @property
    def aims(self) -> list[DesireRecord]:
        """Main desires of the run: the agents' own ones, or else those from rules."""
        own = [desire for desire in self.desires if desire.origin == "own"]
        return own or [desire for desire in self.desires if desire.origin == "rule"]

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
        return "" if stamp is None else f"{self.seconds(stamp):.{self.digits}f} s"

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


def story_of(records: Iterable[TraceRecord], phrases: Phrases | None = None) -> Story:
    """Return the story of ``records``; ``phrases`` describe actions."""
    teller = _Teller(phrases or {})
    for record in records:
        teller.take(record)
    return teller.story


class _Teller:
    def __init__(self, phrases: Phrases) -> None:
        self.story = Story()
        self._narrator = StoryNarrator(Wording(phrases=phrases))
        self._asked: dict[str, RequestRecord] = {}

    def take(self, record: TraceRecord) -> None:
        story = self.story
        if not story.agents:
            story.start = record.stamp
        if record.source not in story.agents:
            story.agents.append(record.source)
        story.end = max(story.end, record.stamp)
        sentence = self._narrator.tell(record)
        self._note(record, "" if sentence is None else sentence.text)

    def _note(self, record: TraceRecord, text: str) -> None:
        detail = record.detail
        match record.kind:
            case "desire" | "desire_refused":
                self._desire(record)
            case "desire_fulfilled" | "desire_dropped":
                for desire in _open(self.story.desires, record):
                    if desire.name == record.what:
                        desire.ended = record.stamp
                        desire.how, desire.reason = record.kind.removeprefix("desire_"), in_words(detail["reason"])
                        if self._narrator.is_needless(record):
                            desire.how = "needless"
            case "plan_start":
                self._plan(record)
            case "plan_end":
                for plan in _open(self.story.plans, record):
                    if plan.number == detail["plan"]:
                        plan.ended = record.stamp
                        plan.outcome, plan.reason = detail["outcome"], in_words(detail["reason"])
                        plan.last_tree = detail.get("tree", "")
            case "step":
                self._step(record, record.stamp)
            case "step_end":
                self._step_end(record)
            case "request":
                self._request(record, text)
            case "reply":
                self._reply(record)
            case "said":
                self._word(record)

    def _desire(self, record: TraceRecord) -> None:
        why, origin = self._narrator.why(record.cause), self._narrator.origin(record.cause)
        desire = DesireRecord(record.source, record.what, why, origin, record.stamp)
        if record.kind == "desire":
            desire.priority, desire.deadline_s = record.detail["priority"], record.detail.get("deadline")
        else:
            desire.ended, desire.how, desire.reason = record.stamp, "refused", record.detail["reason"]
        self.story.desires.append(desire)

    def _plan(self, record: TraceRecord) -> None:
        detail = record.detail
        left = [] if detail.get("beside") else _open(self.story.plans, record)  # from a killed agent
        for plan in left:
            plan.ended = record.stamp
            plan.outcome, plan.reason = "lost", "the agent was restarted"
            for step in _open(self.story.steps, record):
                step.ended = record.stamp
                step.outcome = "lost"
        pursued = next((one for one in _open(self.story.desires, record) if one.name == record.what), None)
        since = self.story.start if pursued is None else pursued.adopted
        again = any(
            (plan.agent, plan.desire) == (record.source, record.what) and plan.reason and plan.began >= since
            for plan in self.story.plans
        )
        steps = parse_plan("\n".join(detail["steps"]))
        plan = PlanRecord(record.source, detail["plan"], record.what, record.stamp, detail["makespan_s"], steps, again)
        plan.tree = detail.get("tree", "")
        self.story.plans.append(plan)

    def _step(self, record: TraceRecord, began: int | None) -> StepRecord:
        action, *args = record.what.strip("()").split()
        director, number = record.detail.get("directed_by", record.source), record.detail.get("plan")
        of_agent = (plan for plan in reversed(self.story.plans) if plan.agent == director)
        plan = next((plan for plan in of_agent if number in (None, plan.number)), None)
        timed = None if plan is None or plan.makespan_s is None else plan.plan
        planned = None if timed is None else _find(timed, action, tuple(args), record.detail)
        text = self._narrator.wording.call(action, args)
        step = StepRecord(record.source, plan, action, tuple(args), text, began, planned)
        self.story.steps.append(step)
        return step

    def _step_end(self, record: TraceRecord) -> None:
        open_ones = (step for step in _open(self.story.steps, record) if step.call == record.what)
        step = next(open_ones, None) or self._step(record, None)
        step.ended = record.stamp
        step.outcome, step.message = record.detail["outcome"], record.detail.get("message", "")

    def _request(self, record: TraceRecord, text: str) -> None:
        receiver = record.what.partition(" asks ")[2].partition(" ")[0]
        request = RequestRecord(
            record.detail["id"],
            record.source,
            receiver,
            text,
            record.stamp,
            " desire " in record.what,
        )
        self.story.requests.append(request)
        self._asked[request.id] = request

    def _word(self, record: TraceRecord) -> None:
        detail = record.detail
        self.story.words.append(
            MessageRecord(
                record.id,
                record.stamp,
                record.source,
                detail["receiver"],
                detail["performative"],
                detail["content"],
                record.what,
                detail["mission"],
                detail["weight"],
            )
        )

    def _reply(self, record: TraceRecord) -> None:
        request = self._asked.get(record.cause)
        if request is None:
            return
        request.state = record.what.rpartition(": ")[2]
        request.reason = record.detail.get("reason", "")
        if request.answered is None:
            request.answered = record.stamp
        request.ended = record.stamp


def _open(told: list[T], record: TraceRecord) -> list[T]:
    return [each for each in told if each.agent == record.source and each.ended is None]


def _find(plan: PddlPlan, action: str, args: tuple[str, ...], detail: Mapping[str, object]) -> PlanStep | None:
    found = [step for step in plan.steps if (step.action, step.args) == (action, args)]
    start = detail.get("planned_start")
    return next((step for step in found if step.start_s == start), next(iter(found), None))


@dataclass(frozen=True)
class Summary:
    """Figures of a run; ``world`` holds the results of the world view."""

    story: Story
    world: Mapping[str, Any]

    @property
    def reached(self) -> bool:
        return {desire.how for desire in self.story.aims} == {"fulfilled"}

    @property
    def given_up(self) -> int:
        return sum(plan.given_up for plan in self.story.plans)

    @property
    def requests_for_desires(self) -> int:
        return sum(request.about_desire for request in self.story.requests)

    def results(self) -> dict[str, Any]:
        story = self.story
        return {
            "reached": self.reached,
            "duration_s": round(story.duration_s, 3),
            "agents": {
                agent: {
                    "plans": sum(plan.agent == agent for plan in story.plans),
                    "given_up": sum(plan.agent == agent and plan.given_up for plan in story.plans),
                    "steps": sum(step.agent == agent for step in story.steps),
                    "requests": sum(request.sender == agent for request in story.requests),
                }
                for agent in story.agents
            },
            "desires": [
                {
                    "agent": desire.agent,
                    "name": desire.name,
                    "why": desire.why,
                    "from_s": round(story.seconds(desire.adopted), 3),
                    "to_s": None if desire.ended is None else round(story.seconds(desire.ended), 3),
                    "planned_s": planned_s,
                    "took_s": None if took_s is None else round(took_s, 3),
                    "how": desire.how,
                    "reason": desire.reason,
                }
                for desire in story.desires
                for planned_s, took_s in [story.makespans_s(desire)]
            ],
            "requests_for_desires": self.requests_for_desires,
            **self.world,
        }
