"""The trace: small records of what the agent believed, wanted and did, each with what caused it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

KINDS = {
    "belief": "a belief was added; its cause is a percept, or the plan that added it",
    "unbelief": "a belief was removed",
    "event": "a Reactor came",
    "held": "a belief has been held for the time that a rule asks for",
    "goal": "a goal was adopted",
    "plan": "a rule was chosen for an event: the agent intends to do its steps; detail: rule, rejected",
    "action": "an action was executed",
    "achieved": "all steps of the plan for a goal are done",
    "failure": "an action, a goal or a sensor failed; detail: reason, message",
    "dropped": "an intention ended because nothing handles the failure",
}
"""The kinds of records and what each says."""


@dataclass(frozen=True, slots=True)
class Record:
    """One step of reasoning at ``time`` (ns). ``cause`` is the id of the record, or percept, it follows from."""

    id: str
    time: int
    kind: str
    what: str
    cause: str
    detail: dict[str, object] = field(default_factory=dict)


Sink = Callable[[Record], None]
"""Takes the records in order."""
