"""Types of the ``detail`` of trace records, by their kind.

Whatever reads a record relies on them. Each entry may be missing. Further entries may be of any type, and so may all
entries of other kinds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import msgspec

from socialbot.core.decoding import from_builtins
from socialbot.core.messages import Int64, PersonDetection, Size, Stamp


class _RejectedPlan(msgspec.Struct, frozen=True):
    plan: str = ""
    because: str = ""


class _MatchedBelief(msgspec.Struct, frozen=True):
    what: str
    since: Stamp | None = None


class _Clause(msgspec.Struct, frozen=True):
    text: str
    records: tuple[str, ...]


_OF_ANY_KIND: dict[str, Any] = {"rejected": tuple[_RejectedPlan, ...]}
"""Entries of all records, also of kinds that an agent of a user invents."""

COMMON: Mapping[str, Any] = _OF_ANY_KIND | dict.fromkeys(("message", "reason", "outcome", "label", "text"), str)
"""Entries of the records of all kinds of socialbot."""

_ONLY_TEXTS = (
    "action_end", "asked", "desire_dropped", "desire_fulfilled", "desire_refused", "dropped", "refused", "reply",
    "step_end", "unhandled",
)  # fmt: skip


def _struct(entries: Mapping[str, Any]) -> type[msgspec.Struct]:
    return msgspec.defstruct("Detail", [(name, kind, None) for name, kind in entries.items()])


def _detail(**entries: Any) -> type[msgspec.Struct]:
    return _struct({**COMMON, **entries})


DETAILS: Mapping[str, type[msgspec.Struct]] = {
    **dict.fromkeys(_ONLY_TEXTS, _detail()),
    # Records of the engine
    "belief": _detail(source=str),
    "unbelief": _detail(left=str),
    "held": _detail(seconds=float),
    "plan": _detail(rule=str, where=str, matched=tuple[_MatchedBelief, ...], later=tuple[str, ...]),
    "progress": _detail(fraction=float | None),
    "failure": _detail(where=str),
    # Records of deliberation and of teams
    "desire": _detail(priority=float | None, deadline=float | None),
    "planning": _detail(verdict=str, steps=Int64, makespan_s=float | None),
    "plan_start": _detail(
        plan=Int64, steps=tuple[str, ...], makespan_s=float | None, beside=bool, mission=Int64 | str,
        team=tuple[str, ...], tree=str,
    ),
    "plan_end": _detail(plan=Int64, tree=str),
    "step": _detail(
        action=str, args=tuple[str, ...], plan=Int64 | None, directed_by=str, planned_start=float | None,
        conditions=tuple[str, ...],
    ),
    "request": _detail(id=str),
    "said": _detail(receiver=str, performative=str, content=str, mission=str, weight=str),
    # Records of topics, and of Waldo
    "detection": _detail(persons=tuple[PersonDetection, ...], width=Size, height=Size),
    "hearing": _detail(start=Int64 | None, person=str, language=str, voice=str, confidence=float),
    "speech": _detail(detail=str),
    "motion": _detail(duration_s=float),
    "sees": _detail(distance_m=float | None, score=float | None, pictures=Int64),
    "answer": _detail(question=str, known=bool, clauses=tuple[_Clause, ...]),
    "proposal": _detail(instructions=str, prompt=str, answer=str, refused=str, error=str),
}  # fmt: skip

_OTHER = _struct(_OF_ANY_KIND)
_AT = re.compile(r" - at `\$\.?(.*)`$")


def check_detail(kind: str, detail: Mapping[str, Any]) -> None:
    """Check the detail of a record.

    Raises:
        ValueError: An entry has another type than records of this kind have.
    """
    try:
        from_builtins(detail, DETAILS.get(kind, _OTHER))
    except msgspec.ValidationError as error:
        place = _AT.search(str(error))
        name = f"detail.{place[1]}" if place else "detail"
        raise ValueError(f"{name} of a record of kind {kind!r}: {_AT.sub('', str(error))}") from error
