"""Records as sentences: in the past tense for logs and explanations, in the present for the story of a run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, takewhile
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import msgspec

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import OF_TOPICS, History

if TYPE_CHECKING:
    from socialbot.runs.run import RunView


Verb = Literal["wants", "plans", "does", "asks", "tells", "reached", "fails", "drops", "rests", "refuses", "senses"]
Origin = Literal["own", "rule", "request", "desire"]

Phrases = Mapping[str, str]
"""Phrases by action name, such as ``moves from {1} to {2}`` with the numbers of the arguments."""


@dataclass(frozen=True)
class Wording:
    """Display names of agents and phrases for actions."""

    names: Mapping[str, str] = field(default_factory=dict)
    phrases: Phrases = field(default_factory=dict)

    def name(self, agent: str) -> str:
        return self.names.get(agent, agent)

    def step(self, record: TraceRecord) -> str:
        """Return the phrase for a step, such as ``moves from start to base_1``."""
        action, *args = record.what.strip("()").split() or [""]
        return self.call(action, args)

    def call(self, action: str, args: Sequence[str]) -> str:
        """Return the phrase for an action, or the action in plan notation."""
        try:
            return self.phrases[action].format(*args)
        except (KeyError, IndexError):
            return " ".join((action, *args))


def plan_name(record: TraceRecord) -> str:
    """Return the name of the plan in a ``plan`` record: its label, or else its text."""
    detail = record.detail
    return str(detail.get("label") or detail.get("rule") or record.what)


def rejected_plans(record: TraceRecord) -> list[tuple[str, str]]:
    """Return the plans that were rejected in a record, with the reasons."""
    found = record.detail.get("rejected")
    plans = found if isinstance(found, (list, tuple)) else ()
    return [(str(each.get("plan", "")), str(each.get("because", ""))) for each in plans]


_PAST = {
    "hears": "heard",
    "begins": "began", "chooses": "chose", "does": "did", "drives": "drove", "drops": "dropped", "finds": "found",
    "gets": "got", "gives": "gave", "goes": "went", "has": "had", "holds": "held", "is": "was", "makes": "made",
    "patrols": "patrolled", "plans": "planned", "puts": "put", "says": "said", "sees": "saw", "sends": "sent",
    "takes": "took", "tells": "told", "wants": "wanted",
}  # fmt: skip


def past(sentence: str) -> str:
    """Put a sentence without subject, such as ``goes to room1``, into the past tense."""
    adverb = "no longer " if sentence.startswith("no longer ") else ""
    first, space, rest = sentence.removeprefix(adverb).partition(" ")
    verb = first.rstrip(":")
    changed = _PAST.get(verb)
    if changed is None:
        if verb.endswith("ies"):
            changed = f"{verb[:-3]}ied"
        elif verb.endswith("s"):
            changed = f"{verb[:-1].removesuffix('e')}ed"
        else:
            changed = verb
    return f"{adverb}{changed}{first[len(verb) :]}{space}{rest}"


_TEXTS = {
    "achieved": "achieves {what}",
    "action_end": "ends {what}: {outcome}{because}",
    "asked": "is asked: {what}",
    "belief": "believes {what}{source}",
    "command": "is asked by a person: {what}",
    "continued": "continues after {what}",
    "desire": "wants {what}",
    "desire_dropped": "drops {what}{because}",
    "desire_fulfilled": "has reached {what}",
    "desire_refused": "does not take up {what}{because}",
    "dropped": "gives up its goal{because}",
    "event": "notices {what}",
    "failure": "fails at {what}{because}",
    "goal": "wants {what}",
    "answer": 'answers "{what}"',
    "hearing": 'hears "{what}"',
    "head centre": "looks straight ahead",
    "head look": "turns its head",
    "head track": "follows people with its head",
    "head": "holds its head: {what}",
    "heard": "receives data again from: {what}",
    "held": "has believed {what} for {seconds:g} s",
    "plan": "chooses a plan for {what}",
    "plan_end aborted": "aborts plan {plan} for {what}{because}",
    "plan_end succeeded": "finishes plan {plan} for {what}",
    "plan_end": "gives up plan {plan} for {what}{because}",
    "planning failed": "finds no plan for {what}{because}",
    "planning": "finds a plan for {what}",
    "progress": "is at {what}",
    "refused": "refuses: {what} ({reason})",
    "reply refused": "is refused by {sender}{because}",
    "reply timeout": "gets no answer from {sender}",
    "reply": "gets the answer {state} from {sender}{because}",
    "silent": "receives no more data from: {what}",
    "speech expired": 'is too late to say "{said}"',
    "speech failed": 'fails to say "{said}"',
    "speech finished": 'finishes saying "{said}"',
    "speech replaced": 'says something newer than "{said}"',
    "speech started": 'begins to say "{said}"',
    "speech waiting": 'has to wait with "{said}"',
    "speech": '{what} "{said}"',
    "step_end successful": "finishes a step: {step}",
    "step_end": "{step}: {outcome}{because}",
    "utterance": 'says "{what}"',
    "unbelief": "no longer believes {what}",
    "unhandled": "has no plan that applies to {what}",
}
"""Present-tense texts by kind of record, and by kind and outcome."""

_REQUESTS = {
    "add belief": "tells {0} to believe {1}",
    "add desire": "asks {0} for {1}",
    "check belief": "asks {0} whether {1}",
    "check desire": "asks {0} whether it wants {1}",
    "del belief": "tells {0} to forget {1}",
    "del desire": "asks {0} to drop {1}",
}
_REQUEST = re.compile(r"\S+ asks (\S+) to ((?:check|add|del) (?:belief|desire)) (.*)")

_VERBS: Mapping[str, Verb] = {
    "desire": "wants", "desire_refused": "refuses", "desire_fulfilled": "reached", "desire_dropped": "drops",
    "planning": "fails", "plan_start": "plans", "plan_end": "fails", "step": "does", "step_end": "fails",
    "sees": "senses", "request": "asks", "reply": "fails", "refused": "refuses", "silent": "senses",
    "heard": "senses", "said": "tells", "failure": "fails",
}  # fmt: skip
"""Kinds of records in the story."""

ACTION_FAILED = "action_failed"
PERSON = "person-"
"""Prefix of the ids of commands by people."""

_CALLED = {"add_desire": "published on add_desire", "kept": "kept from an earlier run"}
_EXTERNAL = {"at first": "it was there at the start", "kept": "it was kept from an earlier run"}
_PROVED = re.compile(r"(?<!\S)\S+: note: no plan: .*", re.DOTALL)
_SAID = re.compile(r"\b(?:note|error): ")
_STAMPED = re.compile(r"(.+)-(\d{6,19})")
_BELIEF_TOPIC = re.compile(r"(add|del)_(belief|desire)(_set)?")


def in_words(reason: str) -> str:
    """Remove the technical output of planners from a reason."""
    return _SAID.sub("", _PROVED.sub("no sequence of actions leads there", reason))


class DesireReason(NamedTuple):
    """Origin of a desire in words; ``desire`` is the one that it prepares."""

    origin: Origin
    text: str
    desire: str = ""


@dataclass(frozen=True)
class Clause:
    """Text about a ``subject``, the name of an agent; the subject may be empty."""

    subject: str
    text: str

    def sentence(self, before: str = "") -> str:
        """Return the sentence; "it" replaces the subject of the sentence ``before``."""
        subject = "it" if self.subject and self.subject == before else self.subject
        return f"{subject} {self.text}".strip()


class Narrator:
    """Describe records in words: any record as a `clause`, or records in order as a `story`."""

    def __init__(self, wording: Wording, history: History | None = None) -> None:
        self.wording = wording
        self._history = history or History()
        self._reasons: dict[str, DesireReason] = {}
        self._desires: dict[tuple[str, str], tuple[int, str]] = {}
        self._ends: dict[str, TraceRecord] = {}
        self._replans: set[tuple[str, str]] = set()
        self._no_plan: dict[tuple[str, str], str] = {}

    # Past tense

    def when(self, stamp: int) -> str:
        return f"{self._history.seconds(stamp):.2f} s"

    def agent(self, record: TraceRecord) -> str:
        """Return the display name of the agent behind a record; empty for detections."""
        chain = itertools.chain([record], self._history.before(record))
        of = next((each for each in chain if each.kind not in OF_TOPICS), None)
        return "" if record.kind == "detection" or of is None else self.wording.name(of.source)

    def clause(self, record: TraceRecord, about: TraceRecord | None = None) -> Clause:
        """Return the clause of a record. ``about`` is its effect, which names the relevant persons of a frame."""
        match record.kind:
            case "detection":
                return Clause("", self._frame(record, about))
            case "percept":
                return Clause("", record.what)
            case "hearing":
                return Clause("", f'{record.detail.get("person") or "somebody"} said "{record.what}"')
            case "rule":
                return Clause("", f"the rule {record.what} of {self.agent(record)} applied")
            case "utterance" if record.cause.startswith(PERSON):
                return Clause("", f'a person had the robot say "{record.what}"')
            case "step":
                return Clause(self.agent(record), f"{past(self._text(record))}{self._place(record)}")
        return Clause(self.agent(record), past(self._text(record)))

    def external_cause(self, record: TraceRecord) -> str:
        """Return the cause of a record as a clause if the cause is no record."""
        cause = record.cause
        stamped = _STAMPED.fullmatch(cause)
        if not cause or record.kind in ("detection", "command") or cause.startswith(PERSON):
            return ""
        if cause.startswith("health-"):
            return f"of the health of node {cause.removeprefix('health-')}"
        if stamped and stamped[1] not in self._history.agents:
            return f"{stamped[1]} reported it at {self.when(int(stamped[2]))}"
        if _BELIEF_TOPIC.fullmatch(cause):
            return f"it was published on {cause}"
        return _EXTERNAL.get(cause, cause if " " in cause else f"of {cause}")

    def _text(self, record: TraceRecord) -> str:
        what, detail, wording = record.what, record.detail, self.wording
        reason = in_words(str(detail.get("message") or detail.get("reason") or ""))
        values = {"outcome": "", "seconds": 0, "plan": "", **detail, "what": what or "something", "reason": reason}
        if record.kind == "failure" and detail.get("where"):  # the line of code that raised the exception
            reason += f" ({detail['where']})"
        values["because"] = f": {reason}" if reason else ""
        variant = detail.get("outcome", what)
        match record.kind:
            case "action":
                action, _, args = what.rstrip(")").partition("(")
                known = action in wording.phrases
                return wording.call(action, args.replace('"', "").split(", ")) if known else f"does {what}"
            case "step" | "step_end":
                known = what.strip("()").partition(" ")[0] in wording.phrases
                values["step"] = wording.step(record) if known else f"does {what}"
                if record.kind == "step":
                    return values["step"]
            case "belief":
                values["source"] = self._source(detail.get("source"))
            case "speech":
                said = self._history.find(record.cause)
                values["said"] = said.what if said else record.cause
            case "reply":
                values["sender"], _, variant = what.partition(": ")
                values["state"] = variant
            case "planning":
                variant = "failed" if reason else ""
            case "plan_start":
                return f"plans {what}: {_size(detail)}"
            case "sees":
                return f"sees {what}{_sight(detail)}"
            case "request":
                found = _REQUEST.fullmatch(what)
                return _REQUESTS[found[2]].format(found[1], found[3]) if found else what.removeprefix(record.source)
            case "message":
                return re.sub(r"^tell (\S+):", r"tells \1:", what)
            case "said":
                return what
        text = _TEXTS.get(f"{record.kind} {variant}") or _TEXTS.get(record.kind)
        return f"{record.kind} {values['what']}" if text is None else text.format_map(values).strip()

    def _source(self, source: object) -> str:
        if source in (None, "", "self"):
            return ""
        return f" (source: {'percept' if source == 'percept' else self.wording.name(str(source))})"

    def _place(self, step: TraceRecord) -> str:
        plan = plan_of(self._history, step)
        if plan is None:
            return ""
        place, count = place_in_plan(self._history, plan, step), len(plan.detail.get("steps", ()))
        number = f"step {place} of {count}" if place else "a step"
        whose = "" if plan.source == step.source else f"{self.wording.name(plan.source)}'s "
        return f", {number} of {whose}plan {plan.detail.get('plan', '')} for {plan.what}"

    def _frame(self, record: TraceRecord, about: TraceRecord | None) -> str:
        everybody = list(record.detail.get("persons", ()))
        named = [one for one in everybody if about and one.get("track_id") and f'"{one["track_id"]}"' in about.what]
        people = [_person(one) for one in named or everybody]
        shown = " and ".join(filter(None, (", ".join(people[:-1]), people[-1]))) if people else "nobody"
        return f"the frame at {self.when(record.stamp)} showed {shown}"

    # Present tense

    def story(self, record: TraceRecord) -> tuple[Verb, str] | None:
        """Return the sentence for the next record, without the name of the agent; None if it adds nothing."""
        key, what, detail = (record.source, record.what), record.what, record.detail
        verb: Verb | None = _VERBS.get(record.kind)
        text = self._text(record)
        match record.kind:
            case "rule":
                self._reasons[record.id] = DesireReason("rule", f"its rule {what}")
            case "asked":
                self._reasons[record.cause] = DesireReason("request", f"{what.partition(' asks ')[0]} asks for it")
            case "desire":
                reason = self.reason(record.cause)
                self._desires[key] = (record.stamp, reason.desire)
                self._reasons[record.id] = DesireReason("desire", f"to prepare {what}", what)
                within = "" if detail.get("deadline") is None else f" within {detail['deadline']:g} s"
                text += f"{within} ({reason.text})"
            case "desire_fulfilled":
                adopted, _ = self._desires.get(key, (record.stamp, ""))
                text += f" after {(record.stamp - adopted) / 1e9:.1f} s"
            case "desire_dropped" if self.is_needless(record):
                verb, text = "rests", f"no longer needs {what}: {detail.get('reason', '')}"
            case "planning":
                failed_before = self._no_plan.get(key) == text
                self._no_plan[key] = text
                verb = "fails" if detail.get("message") and not failed_before else None
            case "plan_start" if key in self._replans:
                self._replans.remove(key)
                text = f"makes a new plan for {what}: {_size(detail)}"
            case "plan_end":
                if detail.get("outcome") == "failed":  # its step has the reason
                    text = f"gives up plan {detail.get('plan', 0)} for {what}"
                verb = "fails" if detail.get("outcome") in ("failed", "aborted") else None
                if verb:
                    self._replans.add(key)
            case "step" | "step_end":
                text = text.replace(f"does {what}", self.wording.step(record), 1)
                verb = None if detail.get("outcome") == "successful" else verb
            case "request":
                verb = "tells" if text.startswith("tells") else "asks"
            case "reply" if what.rpartition(": ")[2] not in ("refused", "timeout", "dropped"):
                verb = None
            case "said":
                weight = detail.get("weight")
                verb = "fails" if weight == "problem" else "tells" if weight == "word" else None
            case "failure" if detail.get("reason") == ACTION_FAILED:
                verb = None
        if record.kind in ("desire_fulfilled", "desire_dropped"):
            self._ends[record.id] = record
        if record.kind in ("desire_fulfilled", "desire_dropped", "plan_start"):
            self._no_plan.pop(key, None)
        return (verb, text) if verb else None

    def reason(self, cause: str) -> DesireReason:
        """Return the origin of a desire with this cause."""
        return self._reasons.get(cause) or DesireReason("own", _CALLED.get(cause, cause))

    def is_needless(self, record: TraceRecord) -> bool:
        """Return whether a desire was dropped only because it is no longer needed."""
        end = self._ends.get(record.cause)
        prepared = self._prepared(record.source, record.what)
        while end and end.kind == "desire_dropped" and prepared not in ("", end.what):
            prepared = self._prepared(record.source, prepared)
        return bool(end and prepared)

    def _prepared(self, agent: str, desire: str) -> str:
        return self._desires.get((agent, desire), (0, ""))[1]


def _size(detail: Mapping[str, Any]) -> str:
    count, makespan_s = len(detail.get("steps", ())), detail.get("makespan_s")
    return f"{count} step{'' if count == 1 else 's'}{'' if makespan_s is None else f', {makespan_s:.1f} s'}"


def _sight(detail: Mapping[str, Any]) -> str:
    if detail.get("distance_m") is not None:
        return f", {detail['distance_m']} m away (score {detail.get('score')})"
    return f", in {detail['pictures']} pictures" if "pictures" in detail else ""


def plan_of(history: History, step: TraceRecord) -> TraceRecord | None:
    """Return the plan of a step, which may belong to another agent."""
    director, number = step.detail.get("directed_by", step.source), step.detail.get("plan")
    for each in history.before(step):
        if each.kind == "plan_start" and each.source == director and number in (None, each.detail.get("plan")):
            return each
    if isinstance(number, int) and isinstance(director, str):
        return history.plan(director, number, step.stamp)
    return None


def step_in(line: str) -> str:
    """Return the call of a step in a line of a plan, without its times."""
    return re.sub(r"^[\d.]+: | \[[\d.]+\]$", "", line)


def place_in_plan(history: History, plan: TraceRecord, step: TraceRecord) -> int | None:
    """Return the number of a step in its plan, which may contain an equal step before; None for a step outside it."""
    places = [n for n, line in enumerate(plan.detail.get("steps", ()), 1) if step_in(line) == step.what]
    if len(places) < 2:
        return places[0] if places else None
    begun = [each for each in history.between(plan.stamp, step.stamp) if each.kind == "step" and each.what == step.what]
    before = sum(each is not step and plan_of(history, each) is plan for each in begun)
    return places[min(before, len(places) - 1)]


def _person(person: dict[str, Any]) -> str:
    name = f"person {person['track_id']}" if person.get("track_id") else "a person"
    distance, unseen = person.get("distance_m"), person.get("unseen_s") or 0.0
    away = "" if distance is None else f" {distance:.1f} m away"
    return f"{name}{away}{f' (not seen for {unseen:.1f} s)' if unseen else ''}"


_NOT_LOGGED = {"detection", "motion", "percept", "plan", "planning", "mail", "progress"}


class LogLine(msgspec.Struct, frozen=True):
    """Record in words; ``t`` is in seconds from the start, ``source`` the agent or topic.

    Lines with the same ``decision`` come from one percept, command or other first cause.
    """

    id: str
    t: float
    kind: str
    source: str
    text: str
    decision: str = ""


_DECISION_NS = SECOND // 5
"""Longest time from the first cause of a decision to its last line."""


def log_lines(run: RunView, records: Iterable[TraceRecord]) -> list[LogLine]:
    """Return the lines of the log for ``records``; kinds without information of their own are left out."""
    narrator = Narrator(run.wording, run.history)
    return [
        LogLine(
            each.id,
            run.history.seconds(each.stamp),
            each.kind,
            each.source,
            narrator.clause(each).sentence(),
            _decision(run.history, each),
        )
        for each in records
        if each.kind not in _NOT_LOGGED
    ]


def _decision(history: History, record: TraceRecord) -> str:
    """Return the id of the first cause of ``record`` that is not older than `_DECISION_NS`."""
    near = takewhile(lambda each: record.stamp - each.stamp <= _DECISION_NS, history.before(record))
    return next(reversed([record, *near])).id


def last_log_lines(run: RunView, begin: int, end: int, most: int) -> list[LogLine]:
    """Return the last ``most`` lines from ``begin`` to ``end`` (ns)."""
    newest = (each for each in run.history.back(begin, end) if each.kind not in _NOT_LOGGED)
    return log_lines(run, reversed(list(islice(newest, most))))
