"""Types of the ``detail`` of trace records, by their kind.

Whatever reads a record relies on them. Each entry may be missing. Further entries may be of any type, and so may all
entries of other kinds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import msgspec

from socialbot.core.messages import Int64, PersonDetection, Size, Stamp


class _RejectedPlan(msgspec.Struct, frozen=True):
    plan: str = ""
    because: str = ""


class _AnyDetail(msgspec.Struct, frozen=True, kw_only=True):
    """Detail of a record of any kind, also of one that an agent of a user invents."""

    rejected: tuple[_RejectedPlan, ...] = ()


class DetailOfKind(_AnyDetail, frozen=True, kw_only=True):
    """Detail of a record of a kind of socialbot."""

    message: str = ""
    reason: str = ""
    outcome: str = ""
    label: str = ""
    text: str = ""


# Records of the engine


class _Belief(DetailOfKind, frozen=True, kw_only=True):
    source: str = ""


class _Unbelief(DetailOfKind, frozen=True, kw_only=True):
    left: str = ""


class _Held(DetailOfKind, frozen=True, kw_only=True):
    seconds: float = 0.0


class _MatchedBelief(msgspec.Struct, frozen=True):
    what: str
    since: Stamp | None = None


class _Plan(DetailOfKind, frozen=True, kw_only=True):
    rule: str = ""
    where: str = ""
    matched: tuple[_MatchedBelief, ...] = ()
    later: tuple[str, ...] = ()


class _Progress(DetailOfKind, frozen=True, kw_only=True):
    fraction: float | None = None


class _Failure(DetailOfKind, frozen=True, kw_only=True):
    where: str = ""


# Records of deliberation and of teams


class _Desire(DetailOfKind, frozen=True, kw_only=True):
    priority: float | None = None
    deadline: float | None = None


class _Planning(DetailOfKind, frozen=True, kw_only=True):
    verdict: str = ""
    steps: Int64 = 0
    makespan_s: float | None = None


class _PlanStart(DetailOfKind, frozen=True, kw_only=True):
    plan: Int64 = 0
    steps: tuple[str, ...] = ()
    makespan_s: float | None = None
    beside: bool = False
    mission: Int64 | str = ""
    team: tuple[str, ...] = ()
    tree: str = ""


class _PlanEnd(DetailOfKind, frozen=True, kw_only=True):
    plan: Int64 = 0
    tree: str = ""


class _Step(DetailOfKind, frozen=True, kw_only=True):
    action: str = ""
    args: tuple[str, ...] = ()
    plan: Int64 | None = None
    directed_by: str = ""
    planned_start: float | None = None
    conditions: tuple[str, ...] = ()


class _Request(DetailOfKind, frozen=True, kw_only=True):
    id: str = ""


class _Said(DetailOfKind, frozen=True, kw_only=True):
    receiver: str = ""
    performative: str = ""
    content: str = ""
    mission: str = ""
    weight: str = ""


# Records of topics, and of Waldo


class _DetectedPersons(DetailOfKind, frozen=True, kw_only=True):
    persons: tuple[PersonDetection, ...] = ()
    width: Size = 0
    height: Size = 0


class _Hearing(DetailOfKind, frozen=True, kw_only=True):
    start: Int64 | None = None
    person: str = ""
    language: str = ""
    voice: str = ""
    confidence: float = 0.0


class _Speech(DetailOfKind, frozen=True, kw_only=True):
    detail: str = ""


class _Motion(DetailOfKind, frozen=True, kw_only=True):
    duration_s: float = 0.0


class _Clause(msgspec.Struct, frozen=True):
    text: str
    records: tuple[str, ...]


class _Sighting(DetailOfKind, frozen=True, kw_only=True):
    distance_m: float | None = None
    score: float | None = None
    pictures: Int64 = 0


class _Answer(DetailOfKind, frozen=True, kw_only=True):
    question: str = ""
    known: bool = False
    clauses: tuple[_Clause, ...] = ()


class _Proposal(DetailOfKind, frozen=True, kw_only=True):
    instructions: str = ""
    prompt: str = ""
    answer: str = ""
    refused: str = ""
    error: str = ""


_ONLY_TEXTS = (
    "action_end", "asked", "desire_dropped", "desire_fulfilled", "desire_refused", "dropped", "refused", "reply",
    "step_end", "unhandled",
)  # fmt: skip

DETAILS: Mapping[str, type[_AnyDetail]] = {
    **dict.fromkeys(_ONLY_TEXTS, DetailOfKind),
    "belief": _Belief,
    "unbelief": _Unbelief,
    "held": _Held,
    "plan": _Plan,
    "progress": _Progress,
    "failure": _Failure,
    "desire": _Desire,
    "planning": _Planning,
    "plan_start": _PlanStart,
    "plan_end": _PlanEnd,
    "step": _Step,
    "request": _Request,
    "said": _Said,
    "detection": _DetectedPersons,
    "hearing": _Hearing,
    "speech": _Speech,
    "motion": _Motion,
    "sees": _Sighting,
    "answer": _Answer,
    "proposal": _Proposal,
}

_AT = re.compile(r" - at `\$\.?(.*)`$")


def check_detail(kind: str, detail: Mapping[str, Any]) -> None:
    """Check the detail of a record.

    Raises:
        ValueError: An entry has another type than records of this kind have.
    """
    try:
        msgspec.convert(detail, DETAILS.get(kind, _AnyDetail))
    except msgspec.ValidationError as error:
        place = _AT.search(str(error))
        name = f"detail.{place[1]}" if place else "detail"
        raise ValueError(f"{name} of a record of kind {kind!r}: {_AT.sub('', str(error))}") from error
