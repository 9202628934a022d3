"""How a run calls things: agents by their names, steps as sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from socialbot.core.messages import TraceRecord
from socialbot.runs.narration import Phrases


@dataclass(frozen=True)
class Wording:
    """Names of agents, where they are called otherwise than their nodes, and phrases for the steps of their plans."""

    names: Mapping[str, str] = field(default_factory=dict)
    phrases: Phrases = field(default_factory=dict)

    def name(self, agent: str) -> str:
        """What people call an agent."""
        return self.names.get(agent, agent)

    def step(self, record: TraceRecord) -> str:
        """What the step of a record does: ``moves from start to base_1``."""
        action, *args = record.what.strip("()").split() or [""]
        return self.call(action, args)

    def call(self, action: str, args: Sequence[str]) -> str:
        """What an action does; as plans write it where nobody has said how."""
        try:
            return self.phrases[action].format(*args)
        except (KeyError, IndexError):
            return " ".join((action, *args))


def plan_name(record: TraceRecord) -> str:
    """What the plan of a record of the kind ``plan`` is called: its label, or else its text."""
    detail = record.detail
    return str(detail.get("label") or detail.get("rule") or record.what)


_PAST = {
    "begins": "began", "does": "did", "drives": "drove", "gives": "gave", "goes": "went", "has": "had", "is": "was",
    "patrols": "patrolled", "puts": "put", "says": "said", "sends": "sent", "takes": "took", "tells": "told",
    "wants": "wanted",
}  # fmt: skip


def past(sentence: str) -> str:
    """A sentence without subject, such as ``goes to room1``, told of the past: ``went to room1``."""
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
