"""Records as sentences: names and phrases, log clauses, and the story of agents with plans."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import OF_TOPICS, History

if TYPE_CHECKING:
    from socialbot.runs.run import RunRecords


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
        """Return the display name of an agent."""
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


_PAST = {
    "begins": "began", "does": "did", "drives": "drove", "gives": "gave", "goes": "went", "has": "had", "is": "was",
    "patrols": "patrolled", "puts": "put", "says": "said", "sends": "sent", "takes": "took", "tells": "told",
    "wants": "wanted",
}  # fmt: skip


def past(sentence: str) -> str:
    """Put a sentence without subject, such as ``goes to room1``, into the past tense."""
    first, space, rest = sentence.partition(" ")
    verb = first.rstrip(":")
    told = _PAST.get(verb)
    if told is None:
        if verb.endswith("ies"):
            told = f"{verb[:-3]}ied"
        elif verb.endswith("s"):
            told = f"{verb[:-1].removesuffix('e')}ed"
        else:
            told = verb
    return f"{told}{first[len(verb) :]}{space}{rest}"


_CALLED = {
    "add_desire": "published on add_desire",
    "kept": "kept from an earlier run",
}

ACTION_FAILED = "action_failed"
"""Failure reason that repeats the end of the action."""

_PROVED = re.compile(r"\S+: note: no plan: .*", re.DOTALL)
_SAID = re.compile(r"\b(?:note|error): ")
_ASKS = re.compile(r"\S+ asks (\S+) to (check|add|del) (belief|desire) (.*)")


@dataclass(frozen=True)
class StorySentence:
    """Sentence about an agent, without its name."""

    stamp: int
    agent: str
    verb: Verb
    text: str


@dataclass(frozen=True)
class _Reason:
    """Origin of desires; ``desire`` is the prepared one."""

    origin: Origin
    text: str
    desire: str = ""


class StoryNarrator:
    """Narrate agents with plans in the present tense, record by record."""

    def __init__(self, wording: Wording) -> None:
        self.wording = wording
        self._reasons: dict[str, _Reason] = {}
        self._adopted: dict[tuple[str, str], int] = {}
        self._prepares: dict[tuple[str, str], str] = {}
        self._ends: dict[str, tuple[str, str]] = {}
        self._replans: set[tuple[str, str]] = set()
        self._no_plan: dict[tuple[str, str], str] = {}

    def tell(self, record: TraceRecord) -> StorySentence | None:
        """Return the sentence for a record, if there is one."""
        told = self._tell(record)
        if record.kind in ("desire_fulfilled", "desire_dropped"):
            self._end(record)
        if told is None:
            return None
        return StorySentence(record.stamp, record.source, *told)

    def why(self, cause: str) -> str:
        """Return the origin of a desire in words."""
        reason = self._reasons.get(cause)
        return _CALLED.get(cause, cause) if reason is None else reason.text

    def origin(self, cause: str) -> Origin:
        """Return the kind of origin of a desire."""
        reason = self._reasons.get(cause)
        return "own" if reason is None else reason.origin

    def is_needless(self, record: TraceRecord) -> bool:
        """Return whether a desire was dropped only because it is no longer needed."""
        kind, ended = self._ends.get(record.cause, ("", ""))
        prepared = self._prepares.get((record.source, record.what), "")
        while kind == "desire_dropped" and prepared not in ("", ended):
            prepared = self._prepares.get((record.source, prepared), "")
        return bool(kind and prepared)

    def _tell(self, record: TraceRecord) -> tuple[Verb, str] | None:
        detail, what = record.detail, record.what
        match record.kind:
            case "rule":
                self._reasons[record.id] = _Reason("rule", f"its rule {what}")
            case "asked":
                self._reasons[record.cause] = _Reason("request", f"{what.partition(' asks ')[0]} asks for it")
            case "desire":
                self._adopt(record)
                within = "" if detail.get("deadline") is None else f" within {detail['deadline']:g} s"
                return "wants", f"wants {what}{within} ({self.why(record.cause)})"
            case "desire_refused":
                return "refuses", f"does not take up {what}: {detail['reason']}"
            case "desire_fulfilled":
                adopted = self._adopted.pop((record.source, what), record.stamp)
                return "reached", f"has reached {what} after {(record.stamp - adopted) / 1e9:.1f} s"
            case "desire_dropped":
                self._adopted.pop((record.source, what), None)
                if self.is_needless(record):
                    return "rests", f"needs {what} no more: {detail['reason']}"
                return "drops", f"drops {what}: {in_words(detail['reason'])}"
            case "planning" if detail["message"]:
                return self._planned_nothing(record)
            case "plan_start":
                self._no_plan.pop((record.source, what), None)
                return "plans", self._plan(record)
            case "plan_end" if detail["outcome"] == "failed":
                self._replans.add((record.source, what))
                return "fails", f"gives up plan {detail['plan']} for {what}"
            case "plan_end" if detail["outcome"] == "aborted":
                self._replans.add((record.source, what))
                return "fails", f"aborts plan {detail['plan']} for {what}: {in_words(detail['reason'])}"
            case "step":
                return "does", self.wording.call(detail["action"], detail["args"])
            case "step_end" if detail["outcome"] in ("failed", "cancelled"):
                action, *args = what.strip("()").split()
                return "fails", f"{self.wording.call(action, args)}: {detail['outcome']}, {detail['message']}"
            case "sees":
                return "senses", f"sees {what}{_sight(detail)}"
            case "request":
                return self._request(what)
            case "reply":
                return _reply(what, detail.get("reason", ""))
            case "refused":
                return "refuses", f"refuses: {what} ({detail['reason']})"
            case "silent":
                return "senses", f"hears no more from: {what}"
            case "heard":
                return "senses", f"hears again from: {what}"
            case "said" if detail["weight"] in ("problem", "word"):
                return "fails" if detail["weight"] == "problem" else "tells", what
            case "failure" if detail.get("reason") != ACTION_FAILED:
                return "fails", f"{what}: {detail.get('message') or detail.get('reason', '')}"
        return None

    def _adopt(self, record: TraceRecord) -> None:
        name = (record.source, record.what)
        self._adopted[name] = record.stamp
        self._reasons[record.id] = _Reason("desire", f"to prepare {record.what}", record.what)
        reason = self._reasons.get(record.cause)
        self._prepares[name] = "" if reason is None else reason.desire

    def _end(self, record: TraceRecord) -> None:
        name = (record.source, record.what)
        self._ends[record.id] = (record.kind, record.what)
        self._no_plan.pop(name, None)

    def _planned_nothing(self, record: TraceRecord) -> tuple[Verb, str] | None:
        name, message = (record.source, record.what), in_words(record.detail["message"])
        if self._no_plan.get(name) == message:
            return None
        self._no_plan[name] = message
        return "fails", f"finds no plan for {record.what}: {message}"

    def _plan(self, record: TraceRecord) -> str:
        count, makespan_s = len(record.detail["steps"]), record.detail["makespan_s"]
        size = f"{count} step{'' if count == 1 else 's'}{'' if makespan_s is None else f', {makespan_s:.1f} s'}"
        if (record.source, record.what) in self._replans:
            self._replans.discard((record.source, record.what))
            return f"makes a new plan for {record.what}: {size}"
        return f"plans {record.what}: {size}"

    def _request(self, what: str) -> tuple[Verb, str]:
        found = _ASKS.fullmatch(what)
        if found is None:
            return "asks", what
        receiver, operation, kind, about = found.groups()
        if kind == "desire":
            doing = {"add": "asks {0} for {1}", "del": "asks {0} to drop {1}", "check": "asks {0} whether it wants {1}"}
            return "asks", doing[operation].format(receiver, about)
        doing = {"add": "tells {0} to believe {1}", "del": "tells {0} to forget {1}", "check": "asks {0} whether {1}"}
        return "tells", doing[operation].format(receiver, about)


def _sight(detail: Mapping[str, Any]) -> str:
    if detail.get("distance_m") is not None:
        return f", {detail['distance_m']} m away (score {detail['score']})"
    return f", in {detail['pictures']} pictures" if "pictures" in detail else ""


def in_words(reason: str) -> str:
    """Remove the technical output of planners from a reason."""
    return _SAID.sub("", _PROVED.sub("nothing that can be done leads there", reason))


def _reply(what: str, reason: str) -> tuple[Verb, str] | None:
    sender, _, state = what.partition(": ")
    match state:
        case "refused":
            return "fails", f"is refused by {sender}: {reason}"
        case "timeout":
            return "fails", f"gets no answer from {sender}"
        case "dropped":
            return "fails", f"hears from {sender} that it is dropped: {in_words(reason)}"
    return None


HEAD = {"track": "followed people with its head", "centre": "looked straight on", "look": "turned its head"}
SPEECH = {
    "waiting": "had to wait with",
    "started": "began to say",
    "finished": "finished saying",
    "replaced": "said something newer than",
    "expired": "was too late to say",
    "failed": "failed to say",
}
PLAIN = {
    "unbelief": "no longer believed",
    "event": "noticed",
    "goal": "wanted",
    "plan": "chose a plan for",
    "continued": "went on from",
    "achieved": "achieved",
    "progress": "was at",
    "desire": "wanted",
    "desire_fulfilled": "had reached",
    "asked": "was asked:",
    "command": "was asked by a person:",
    "reply": "heard from",
    "refused": "refused:",
    "silent": "heard no more from",
    "heard": "heard again from",
}
PERSON = "person-"
"""Prefix of the ids of commands by people."""

_STAMPED = re.compile(r"(.+)-(\d{6,})")
_SPOKEN_BY_TOPIC = re.compile(r"(add|del)_(belief|desire)(_set)?")


@dataclass(frozen=True)
class Clause:
    """Text about a ``subject``, the name of an agent; the subject may be empty."""

    subject: str
    text: str

    def told(self, before: str = "") -> str:
        """Return the sentence; "it" replaces the subject of the sentence ``before``."""
        subject = "it" if self.subject and self.subject == before else self.subject
        return f"{subject} {self.text}".strip()


class Narrator:
    """Convert the records of a history to clauses in the past tense."""

    def __init__(self, history: History, wording: Wording) -> None:
        self._history = history
        self._wording = wording

    def when(self, stamp: int) -> str:
        return f"{self._history.seconds(stamp):.2f} s"

    def agent(self, record: TraceRecord) -> str:
        """Return the display name of the agent behind a record; empty for detections."""
        chain = itertools.chain([record], self._history.before(record))
        of = next((each for each in chain if each.kind not in OF_TOPICS), None)
        return "" if record.kind == "detection" or of is None else self._wording.name(of.source)

    def clause(self, record: TraceRecord, about: TraceRecord | None = None) -> Clause:
        """Return the clause of a record. ``about`` is its effect, which names the relevant persons of a frame."""
        if record.kind == "detection":
            return Clause("", self._frame(record, about))
        if record.kind == "rule":
            return Clause("", f"the rule {record.what} of {self.agent(record)} applied")
        return Clause(self.agent(record), self._did(record))

    def _did(self, record: TraceRecord) -> str:
        what, detail = record.what, record.detail
        reason = in_words(str(detail.get("message") or detail.get("reason") or ""))
        because = f": {reason}" if reason else ""
        match record.kind:
            case "utterance":
                return f'said "{what}"'
            case "speech":
                said = self._history.find(record.cause)
                return f'{SPEECH.get(what, what)} "{said.what if said else record.cause}"'
            case "head":
                return HEAD.get(what, f"held its head: {what}")
            case "action":
                action, _, args = what.rstrip(")").partition("(")
                return self._deed(action, args.replace('"', "").split(", "), what)
            case "step":
                action, *args = what.strip("()").split() or [""]
                return f"{self._deed(action, args, what)}{self._place(record)}"
            case "step_end" if detail.get("outcome") == "successful":
                return f"was done with a step: {self._wording.step(record)}"
            case "step_end":
                return f"failed in a step: {self._wording.step(record)}{because}"
            case "belief":
                return f"believed {what}{self._told_by(detail)}"
            case "held":
                return f"had believed {what} for {detail.get('seconds', 0):g} s"
            case "message":
                return past(re.sub(r"^tell (\S+):", r"tells \1:", what))
            case "action_end":
                return f"ended {what}: {detail.get('outcome', '')}{because}"
            case "failure":
                return f"failed at {what or 'something'}{because}"
            case "dropped":
                return f"gave up what it was at{because}"
            case "desire_dropped":
                return f"dropped {what}{because}"
            case "desire_refused":
                return f"did not take up {what}{because}"
            case "plan_start":
                count = len(detail.get("steps", ()))
                return f"had plan {detail.get('plan', '')} for {what}, of {count} step{'' if count == 1 else 's'}"
            case "plan_end" if detail.get("outcome") == "succeeded":
                return f"was done with plan {detail.get('plan', '')} for {what}"
            case "plan_end":
                return f"gave up plan {detail.get('plan', '')} for {what}{because}"
            case "planning":
                return f"looked for a plan for {what}: {in_words(detail.get('message') or 'found')}"
            case "request":
                return past(what.removeprefix(record.source).strip())
            case "said":
                return past(what)
        return f"{PLAIN.get(record.kind, record.kind)} {what}".rstrip()

    def _deed(self, action: str, args: list[str], what: str) -> str:
        return past(self._wording.call(action, args)) if action in self._wording.phrases else f"did {what}"

    def _place(self, step: TraceRecord) -> str:
        plan = plan_of(self._history, step)
        if plan is None:
            return ""
        steps = [re.sub(r"^[\d.]+: | \[[\d.]+\]$", "", line) for line in plan.detail.get("steps", ())]
        number = f"step {steps.index(step.what) + 1} of {len(steps)}" if step.what in steps else "a step"
        whose = "" if plan.source == step.source else f"{self._wording.name(plan.source)}'s "
        return f", {number} of {whose}plan {plan.detail.get('plan', '')} for {plan.what}"

    def _told_by(self, detail: dict[str, Any]) -> str:
        match detail.get("source"):
            case None | "" | "self":
                return ""
            case "percept":
                return ", told by its sensor"
            case str(source):
                return f", told by {self._wording.name(source)}"
        return ""

    def _frame(self, record: TraceRecord, about: TraceRecord | None) -> str:
        everybody = list(record.detail.get("persons", ()))
        named = [one for one in everybody if about and one.get("track_id") and f'"{one["track_id"]}"' in about.what]
        people = [_person(one) for one in named or everybody]
        shown = " and ".join(filter(None, (", ".join(people[:-1]), people[-1]))) if people else "nobody"
        return f"the frame at {self.when(record.stamp)} showed {shown}"

    def outside(self, record: TraceRecord) -> str:
        """Return the cause of a record as a clause if the cause is no record."""
        cause = record.cause
        stamped, by_topic = _STAMPED.fullmatch(cause), _SPOKEN_BY_TOPIC.fullmatch(cause)
        if not cause or record.kind == "detection":
            return ""
        if record.kind == "command" or cause.startswith(PERSON):
            return ""
        if cause.startswith("health-"):
            return f"the node {cause.removeprefix('health-')} said so of its health"
        if stamped and stamped[1] not in self._history.agents:
            return f"{stamped[1]} told it at {self.when(int(stamped[2]))}"
        if by_topic:
            return f"somebody published it on {cause}"
        if cause.endswith((".yaml", ".yml", ".asl")):
            return f"{cause} says so"
        known = {"at first": "it began with that", "kept": "it was left from an earlier run"}
        return known.get(cause, cause if " " in cause else f"of {cause}")


def plan_of(history: History, step: TraceRecord) -> TraceRecord | None:
    """Return the plan of a step, which may belong to another agent."""
    director, number = step.detail.get("directed_by", step.source), step.detail.get("plan")
    for each in history.before(step):
        if each.kind == "plan_start" and each.source == director and number in (None, each.detail.get("plan")):
            return each
    if number is None:
        return None
    before = history.back(history.start, step.stamp)
    numbered = (each for each in before if each.kind == "plan_start" and each.source == director)
    return next((each for each in numbered if each.detail.get("plan") == number), None)


def _person(person: dict[str, Any]) -> str:
    name = f"person {person['track_id']}" if person.get("track_id") else "a person"
    distance, unseen = person.get("distance_m"), person.get("unseen_s") or 0.0
    away = "" if distance is None else f" {distance:.1f} m away"
    return f"{name}{away}{f' (not seen for {unseen:.1f} s)' if unseen else ''}"


UNTOLD = {"detection", "motion", "plan", "planning", "mail", "progress"}
"""Kinds of records that are frequent or repeat others."""


class LogLine(msgspec.Struct, frozen=True):
    """Record in words; ``t`` is in seconds from the start, ``source`` the agent or topic."""

    id: str
    t: float
    kind: str
    source: str
    text: str


def told(run: RunRecords, records: Iterable[TraceRecord]) -> list[LogLine]:
    """Return the lines of the log for ``records``; kinds without information of their own are left out."""
    teller = Narrator(run.history, run.wording)
    return [
        LogLine(each.id, run.history.seconds(each.stamp), each.kind, each.source, teller.clause(each).told())
        for each in records
        if each.kind not in UNTOLD
    ]


def told_between(run: RunRecords, begin: int, end: int, most: int) -> list[LogLine]:
    """Return the last ``most`` lines from ``begin`` to ``end`` (ns)."""
    newest = (each for each in run.history.back(begin, end) if each.kind not in UNTOLD)
    return told(run, reversed(list(islice(newest, most))))
