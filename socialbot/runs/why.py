"""Explanations: the chain of causes of a record down to the frame, and rejected plans."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import groupby, islice
from typing import Literal

import msgspec

from socialbot.core.clock import nanoseconds
from socialbot.core.errors import RunError
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Narrator, Wording, plan_name, plan_of, rejected_plans

REPEATING = {"planning", "asked"}
"""Kinds of records that repeat the records around them."""

SILENT = {"plan", "percept", *REPEATING}
"""Kinds of records that are no effects or actions of their own."""

DEEDS = {"action", "step"}
ACTED = {"goal", *DEEDS}

NEAR_S = 0.5
"""Tolerance (s) of a time that a person asks about."""

MOST_LINKS = 500
MOST_EFFECTS = 100
LEFT_OUT = f"of earlier causes, which are left out after {MOST_LINKS} links"


class Reason(msgspec.Struct, frozen=True):
    """Link of a chain of causes, as a clause; ``id`` is empty if the cause is no record.

    ``link`` relates it to the link before: its cause (``because``), the rule that was chosen (``by``) or an earlier
    action (``after``). ``rule`` is the text of a rule and ``where`` its file and line; both are empty for other links.
    """

    id: str
    at_s: float
    kind: str
    agent: str
    sentence: str
    link: Literal["because", "after", "by"] = "because"
    rule: str = ""
    where: str = ""


class Rejected(msgspec.Struct, frozen=True):
    """Plan for an event that was not chosen; ``id`` is that of the record."""

    id: str
    at_s: float
    event: str
    plan: str
    because: str


class Explanation(msgspec.Struct, frozen=True):
    """Why a record exists: the record, its cause, and so on.

    Args:
        chain: The record and its causes.
        rejected: Plans that were not chosen on the way.
        effects: Effects of the record.
        frame_s: Time of the frame at the end of the chain.
        is_cut: Whether the chain goes on.
        effects_left_out: Number of further effects.
    """

    chain: tuple[Reason, ...]
    rejected: tuple[Rejected, ...]
    effects: tuple[Reason, ...]
    frame_s: float | None
    is_cut: bool = False
    effects_left_out: int = 0

    def text(self) -> str:
        """Return the chain as a sentence, one line per link; of consecutive earlier actions only the last."""
        lines = [f"At {self.chain[0].at_s:.2f} s {self.chain[0].sentence}"]
        for link, reasons in groupby(self.chain[1:], key=lambda reason: reason.link):
            clauses = [f"  {link} {reason.sentence}" for reason in reasons]
            if link == "after" and len(clauses) > 1:
                clauses = [f"{clauses[0]} and {len(clauses) - 1} {'step' if len(clauses) == 2 else 'steps'} before"]
            lines += clauses
        return ",\n".join(lines) + "."


def explain(history: History, wording: Wording, record: TraceRecord) -> Explanation:
    """Return why ``record`` exists."""
    narrator = Narrator(wording, history)
    whole = [record, *islice(history.before(record), MOST_LINKS)]
    chain: list[Reason] = []
    subject, effect = "", None
    for each in _without_repetition(history, whole):
        clause = narrator.clause(each, effect)
        sentence = clause.sentence(subject)
        if effect is not None and each.stamp != effect.stamp and each.kind != "detection":
            sentence += f" (at {narrator.when(each.stamp)})"
        is_earlier_action = effect is not None and {each.kind, effect.kind} <= DEEDS and each.source == effect.source
        link = "by" if each.kind == "plan" else "after" if is_earlier_action else "because"
        if each.kind == "plan" and effect is not None:
            sentence = f"its rule {rule_of(each)}{matched(history, each)}"
        rule, where = (str(each.detail.get(name, "")) for name in ("rule", "where"))
        at_s = history.seconds(each.stamp)
        chain.append(Reason(each.id, at_s, each.kind, clause.subject, sentence, link, rule, where))
        subject, effect = clause.subject or subject, effect if each.kind == "plan" and effect is not None else each
    is_cut = len(whole) > MOST_LINKS and history.cause(whole[-1]) is not None
    outside = LEFT_OUT if is_cut else narrator.external_cause(whole[-1])
    if outside:
        chain.append(Reason("", history.seconds(whole[-1].stamp), "outside", "", outside))
    frame = next((history.seconds(each.stamp) for each in reversed(whole) if each.kind == "detection"), None)
    rejected = tuple(reason for each in whole for reason in _rejected(history, each))
    came = [each for each in history.effects(record) if each.kind not in SILENT]
    effects = tuple(
        Reason(each.id, history.seconds(each.stamp), each.kind, narrator.agent(each), narrator.clause(each).sentence())
        for each in came[:MOST_EFFECTS]
    )
    return Explanation(tuple(chain), rejected, effects, frame, is_cut, len(came) - len(effects))


def _without_repetition(history: History, chain: Sequence[TraceRecord]) -> Iterator[TraceRecord]:
    """Yield the chain without repetition; a step replaces its goal and action."""
    kept: TraceRecord | None = None
    rest = deque(chain)
    while rest:
        record = rest.popleft()
        if kept is not None and (record.kind in REPEATING or _says_it(history, kept, record)):
            continue
        if record.kind in ACTED:
            call = call_of(record)
            while rest and (rest[0].kind in REPEATING or call in [call_of(each) for each in _after_plan(rest)]):
                other = rest.popleft()
                record = other if other.kind == "step" and record.kind != "step" else record
        kept = record
        yield record


def _after_plan(rest: Sequence[TraceRecord]) -> Sequence[TraceRecord]:
    """Return the next record; after a chosen plan also the one behind, since an action's plan may only carry it out."""
    return [rest[n] for n in range(min(2 if rest[0].kind == "plan" else 1, len(rest)))]


def rule_of(record: TraceRecord) -> str:
    """Return the head or label of the rule of a ``plan`` record, with its file and line if known."""
    place, _, line = str(record.detail.get("where", "")).rpartition("/")[2].rpartition(":")
    return f"'{head_of(plan_name(record))}'" + (f" ({place}:{line})" if place else "")


def matched(history: History, record: TraceRecord) -> str:
    """Return what the condition of the rule of a ``plan`` record matched, as a clause; empty without a condition."""
    found = [(str(each["what"]), each.get("since")) for each in record.detail.get("matched", ())]
    held = [f"{what} held" + (f" since {history.seconds(since):.2f} s" if since else "") for what, since in found]
    return f", where {' and '.join(held)}" if held else ""


def head_of(plan: str) -> str:
    """Return the event and condition of a plan in Python or AgentSpeak; a label is returned unchanged."""
    head = re.split(r" >> \[| <- ", plan, maxsplit=1)[0]
    return " ".join(head.split())


def _says_it(history: History, kept: TraceRecord, record: TraceRecord) -> bool:
    match kept.kind, record.kind:
        case "step", "plan_start":
            return plan_of(history, kept) is record
        case "plan_end", "step_end":
            return str(record.detail.get("message")) in str(kept.detail.get("reason"))
        case "said", "message":
            return True
        case "belief", "said":
            return kept.detail.get("source") == record.source and record.what.endswith(kept.what)
        case (("step_end" | "plan_end"), "plan_start"):
            return kept.detail.get("plan") in (None, record.detail.get("plan"))
    return False


def call_of(record: TraceRecord) -> str:
    """Return the call of a goal, action or plan step as ``name(argument, ...)`` without quotes; empty for others."""
    if record.kind == "step":
        action, *args = record.what.strip("()").split() or [""]
        return f"{action}({', '.join(args)})"
    return record.what.replace('"', "") if record.kind in ACTED else ""


def _rejected(history: History, record: TraceRecord) -> Iterator[Rejected]:
    for plan, because in rejected_plans(record):
        yield Rejected(record.id, history.seconds(record.stamp), record.what, plan, because)


# Actions in order


def actions(history: History) -> list[TraceRecord]:
    """Return the actions of agents in order: utterances, plan steps and other actions.

    Actions that only produce one of these are omitted.
    """
    return [
        record
        for record in history
        if record.kind in ("step", "utterance") or (record.kind == "action" and _stands_alone(history, record))
    ]


def _stands_alone(history: History, action: TraceRecord) -> bool:
    if action.what.startswith("."):
        return False
    behind = islice((each for each in history.before(action) if each.kind not in SILENT), 2)
    if any(each.kind == "step" and call_of(each) == call_of(action) for each in behind):
        return False
    after = history.between(action.stamp, action.stamp)
    led_to = (each for each in after if each.kind in ("utterance", "step"))
    return not any(history.cause(each) is action for each in led_to)


DECIDED = {"desire", "desire_refused", "desire_dropped", "plan_start", "plan_end"}


def decided_at(history: History, stamp: int) -> list[TraceRecord]:
    """Return the decisions nearest to ``stamp`` (ns), at most `NEAR_S` away: actions, or else desires and plans."""
    decisions = list(_decisions(history))
    near = min(decisions, key=lambda record: abs(record.stamp - stamp), default=None)
    if near is None or abs(near.stamp - stamp) > nanoseconds(NEAR_S):
        return []
    found = [record for record in decisions if record.stamp == near.stamp]
    return [record for record in found if record.kind not in DECIDED] or found


def decisions_around(history: History, stamp: int) -> tuple[int | None, int | None]:
    """Return the stamps (ns) of the last decision before ``stamp`` and of the first one after it."""
    stamps = [record.stamp for record in _decisions(history)]
    before, after = [each for each in stamps if each <= stamp], [each for each in stamps if each > stamp]
    return max(before, default=None), min(after, default=None)


def _decisions(history: History) -> Iterator[TraceRecord]:
    taken = {id(record) for record in actions(history)}
    return (record for record in history if id(record) in taken or record.kind in DECIDED)


# Rejected plans


class Considered(msgspec.Struct, frozen=True):
    """Plan with the times (s) when it was chosen, and when and why it was not.

    ``leads_to`` is the plan in question whose goal this plan adopts; empty for that plan itself.
    """

    plan: str
    chosen_s: tuple[float, ...]
    rejected: tuple[Rejected, ...]
    leads_to: str = ""

    def near(self, at_s: float) -> Considered:
        """Return the plan with only what was decided at the moment nearest to ``at_s``, at most `NEAR_S` away."""
        times = (*self.chosen_s, *(no.at_s for no in self.rejected))
        nearest = min(times, key=lambda each: abs(each - at_s), default=math.inf)
        if abs(nearest - at_s) > NEAR_S:
            return msgspec.structs.replace(self, chosen_s=(), rejected=())
        chosen = tuple(each for each in self.chosen_s if each == nearest)
        rejected = tuple(no for no in self.rejected if no.at_s == nearest)
        return msgspec.structs.replace(self, chosen_s=chosen, rejected=rejected)


def considered(history: History) -> tuple[Considered, ...]:
    """Return all plans that were chosen or rejected, by name."""
    chosen: dict[str, list[float]] = {}
    rejected: dict[str, list[Rejected]] = {}
    for record in history:
        if record.kind == "plan":
            chosen.setdefault(plan_name(record), []).append(history.seconds(record.stamp))
        for each in _against(history, record):
            rejected.setdefault(each.plan, []).append(each)
    return tuple(
        Considered(plan, tuple(chosen.get(plan, ())), tuple(rejected.get(plan, ())))
        for plan in sorted(chosen.keys() | rejected.keys())
    )


def why_not(history: History, plan: str) -> tuple[Considered, ...]:
    """Return when a plan was chosen and rejected, followed by the plans that adopt its goal.

    Args:
        history: The records of the run.
        plan: Label of a plan, or a part of its text.

    Raises:
        RunError: No such plan was considered; the error names the known plans.
    """
    wanted, known = plan.casefold(), considered(history)
    found = [each for each in known if each.plan.casefold() == wanted]
    found = found or [each for each in known if wanted in each.plan.casefold()]
    if not found:
        names = "".join(f"\n    {each.plan}" for each in known)
        remedy = f"give one of these, or some of its text:{names}" if names else "the run has no plans"
        raise RunError(f"no plan {plan!r} was ever considered", remedy=remedy)
    rules = {plan_name(record): str(record.detail.get("rule", "")) for record in history if record.kind == "plan"}
    named = {each.plan for each in found}
    for goal in found:  # grows
        name = _GOAL.match(rules.get(goal.plan) or goal.plan)
        if name is None:
            continue
        adopts = re.compile(rf"\b{re.escape(name[1])}\b")
        for each in known:
            if each.plan not in named and adopts.search(_body(rules.get(each.plan) or each.plan)):
                named.add(each.plan)
                found.append(msgspec.structs.replace(each, leads_to=goal.plan))
    return tuple(found)


_GOAL = re.compile(r"(?:@\S+\s+)?(?:\+!)?([A-Za-z]\w*)\b")
"""Start of a plan for a goal, in Python or AgentSpeak."""


def _body(plan: str) -> str:
    return plan[len(head_of(plan)) :]


def _against(history: History, record: TraceRecord) -> Iterator[Rejected]:
    yield from _rejected(history, record)
    detail, at_s = record.detail, history.seconds(record.stamp)
    reason = str(detail.get("message") or detail.get("reason") or "")
    if record.kind == "plan":
        because = f"not considered: the rule {rule_of(record)} was chosen{matched(history, record)}"
        for plan in detail.get("later", ()):
            yield Rejected(record.id, at_s, record.what, plan, because)
    elif record.kind in ("planning", "desire_refused", "desire_dropped") and reason:
        yield Rejected(record.id, at_s, record.what, record.what, reason)
    elif record.kind == "plan_end" and detail.get("outcome") != "succeeded":
        yield Rejected(record.id, at_s, record.what, f"plan {detail.get('plan', '')} for {record.what}", reason)
