"""Records of a run as sentences."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Any

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.history import OF_TOPICS, History
from socialbot.runs.names import Wording, past
from socialbot.runs.narration import in_words
from socialbot.runs.run import Told

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
"""The ids of what people ask for begin with that."""

_STAMPED = re.compile(r"(.+)-(\d{6,})")
_SPOKEN_BY_TOPIC = re.compile(r"(add|del)_(belief|desire)(_set)?")


@dataclass(frozen=True)
class Clause:
    """What ``subject`` did: the name of an agent, or empty where ``text`` says that, too."""

    subject: str
    text: str

    def told(self, before: str = "") -> str:
        """In words; who was spoken of ``before`` is ``it``."""
        subject = "it" if self.subject and self.subject == before else self.subject
        return f"{subject} {self.text}".strip()


class Teller:
    """Tells the records of a history."""

    def __init__(self, history: History, wording: Wording) -> None:
        self._history = history
        self._wording = wording

    def when(self, stamp: int) -> str:
        """A time as people read it."""
        return f"{self._history.seconds(stamp):.2f} s"

    def agent(self, record: TraceRecord) -> str:
        """The agent that a record is of, as people call it; empty for what no agent did."""
        chain = itertools.chain([record], self._history.before(record))
        of = next((each for each in chain if each.kind not in OF_TOPICS), None)
        return "" if record.kind == "detection" or of is None else self._wording.name(of.source)

    def clause(self, record: TraceRecord, about: TraceRecord | None = None) -> Clause:
        """What a record says. ``about`` is what it led to: of the people in a frame those matter that it speaks of."""
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
        """An action in words, where somebody has said how."""
        return past(self._wording.call(action, args)) if action in self._wording.phrases else f"did {what}"

    def _place(self, step: TraceRecord) -> str:
        """Which step of which plan it is."""
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
        """Who is in a frame: whom ``about`` names, or else all."""
        everybody = list(record.detail.get("persons", ()))
        named = [one for one in everybody if about and one.get("track_id") and f'"{one["track_id"]}"' in about.what]
        people = [_person(one) for one in named or everybody]
        shown = " and ".join(filter(None, (", ".join(people[:-1]), people[-1]))) if people else "nobody"
        return f"the frame at {self.when(record.stamp)} showed {shown}"

    def outside(self, record: TraceRecord) -> str:
        """What led to a record and is no record itself, as a clause; empty when nothing is known of it."""
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
    """The plan that a step belongs to; another agent's, where that directs it."""
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
"""Kinds of records that come again and again, or say what those around them say."""


class LogLine(msgspec.Struct, frozen=True):
    """A record in words; ``t`` is in s from the start, ``source`` the agent or topic, ``id`` that of the record."""

    id: str
    t: float
    kind: str
    source: str
    text: str


def told(run: Told, records: Iterable[TraceRecord]) -> list[LogLine]:
    """Those of ``records`` that are worth telling."""
    teller = Teller(run.history, run.wording)
    return [
        LogLine(each.id, run.history.seconds(each.stamp), each.kind, each.source, teller.clause(each).told())
        for each in records
        if each.kind not in UNTOLD
    ]


def told_between(run: Told, begin: int, end: int, most: int) -> list[LogLine]:
    """The last lines, at most so many, from ``begin`` to ``end`` (ns)."""
    newest = (each for each in run.history.back(begin, end) if each.kind not in UNTOLD)
    return told(run, reversed(list(islice(newest, most))))
