"""The trace of deliberating agents in sentences."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from socialbot.core.messages import TraceRecord

Verb = Literal["wants", "plans", "does", "asks", "tells", "reached", "fails", "drops", "rests", "refuses", "senses"]
Origin = Literal["own", "rule", "request", "desire"]

Phrases = Mapping[str, str]
"""How actions are said, by name: ``moves from {1} to {2}``, with the objects of the action by number."""

_CALLED = {
    "add_desire": "published on add_desire",
    "kept": "kept from an earlier run",
}
"""What desires come from, in words, where no record tells of it."""

ACTION_FAILED = "action_failed"
"""Why something failed of which the end of the action itself tells."""

_PROVED = re.compile(r"\S+: note: no plan: .*", re.DOTALL)
_SAID = re.compile(r"\b(?:note|error): ")
_ASKS = re.compile(r"\S+ asks (\S+) to (check|add|del) (belief|desire) (.*)")


@dataclass(frozen=True)
class Sentence:
    """What an agent does at ``stamp`` (ns), without its name. The turns of a run are ``main``."""

    stamp: int
    agent: str
    verb: Verb
    text: str
    main: bool = False


@dataclass(frozen=True)
class _Reason:
    """What desires came from; ``desire`` is the one that they prepare, if they do."""

    origin: Origin
    text: str
    desire: str = ""


class Narrator:
    """Tells the records of a run one after the other. ``phrases`` say actions; others are said as in the plan."""

    def __init__(self, phrases: Phrases) -> None:
        self._phrases = phrases
        self._reasons: dict[str, _Reason] = {}
        self._adopted: dict[tuple[str, str], int] = {}
        self._prepares: dict[tuple[str, str], str] = {}
        self._ends: dict[str, tuple[str, str]] = {}
        self._replans: set[tuple[str, str]] = set()
        self._no_plan: dict[tuple[str, str], str] = {}

    def tell(self, record: TraceRecord) -> Sentence | None:
        """The sentence for a record; None when there is nothing to say about it."""
        told = self._tell(record)
        if record.kind in ("desire_fulfilled", "desire_dropped"):
            self._end(record)
        if told is None:
            return None
        verb, text = told
        main = verb in ("fails", "drops", "reached", "refuses") or text.startswith("makes a new plan")
        return Sentence(record.stamp, record.source, verb, text, main)

    def why(self, cause: str) -> str:
        """What a desire came from, in words: the request, rule, other desire or file that ``cause`` names."""
        reason = self._reasons.get(cause)
        return _CALLED.get(cause, cause) if reason is None else reason.text

    def origin(self, cause: str) -> Origin:
        """What kind of thing a desire came from."""
        reason = self._reasons.get(cause)
        return "own" if reason is None else reason.origin

    def is_needless(self, record: TraceRecord) -> bool:
        """Whether a desire was dropped only because what it prepared has ended, or something else has prepared that."""
        kind, ended = self._ends.get(record.cause, ("", ""))
        prepared = self._prepares.get((record.source, record.what), "")
        while kind == "desire_dropped" and prepared not in ("", ended):
            prepared = self._prepares.get((record.source, prepared), "")
        return bool(kind and prepared)

    def phrase(self, action: str, args: Sequence[str]) -> str:
        """What an action does, in words."""
        try:
            return self._phrases[action].format(*args)
        except (KeyError, IndexError):  # nobody has said how, or it lacks an object
            return f"{action} {' '.join(args)}".strip()

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
                return "does", self.phrase(detail["action"], detail["args"])
            case "step_end" if detail["outcome"] in ("failed", "cancelled"):
                action, *args = what.strip("()").split()
                return "fails", f"{self.phrase(action, args)}: {detail['outcome']}, {detail['message']}"
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
        """Why there is no plan; the same reason is told once, however often it is tried again."""
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
    """How somebody was seen, or in how many pictures nobody was."""
    if detail.get("distance_m") is not None:
        return f", {detail['distance_m']} m away (score {detail['score']})"
    return f", in {detail['pictures']} pictures" if "pictures" in detail else ""


def in_words(reason: str) -> str:
    """A reason without what planners say to their makers."""
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
