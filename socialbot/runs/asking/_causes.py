"""Reasons for a deed, reasons against one, and the contrast with the moment before."""

from __future__ import annotations

import re
from collections.abc import Sequence

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._facts import Facts, record_agent
from socialbot.runs.asking._sentences import Claim, ClaimKind, Clause, Speech
from socialbot.runs.asking._subjects import Subjects, goal_of
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.narration import place_in_plan, plan_of, rejected_plans
from socialbot.runs.why import call_of, explain, head_of

_OWN = {"plan", "goal", "action", "step", "utterance"}
"""Records of a chain of causes that only repeat the deed."""


def reasons(speech: Speech, deed: TraceRecord) -> list[Clause]:
    """Return why a deed was done.

    That is its place in a plan, what a person said, the belief that it came from, or its nearest known cause.
    """
    facts = speech.facts
    planned = _place_in_plan(speech, deed)
    if planned:
        return planned
    heard = facts.heard_before(deed)
    if heard is not None:
        return [speech.heard(heard)]
    trigger = facts.trigger(deed)
    if trigger is not None:
        held = next((each for each in facts.beliefs if each.record is trigger), None)
        held = held or next(
            (each for each in facts.held(trigger.what, agent=trigger.source) if each.at(trigger.stamp)), None
        )
        if held is not None:
            return [speech.believed(held, deed.stamp if held.at(deed.stamp) else trigger.stamp)]
    return _nearest_cause(speech, deed)


def _place_in_plan(speech: Speech, deed: TraceRecord) -> list[Clause]:
    """Return that a step belongs to a plan, and what the plan is for."""
    facts = speech.facts
    if deed.kind not in ("step", "desire", "goal"):
        return []
    plan = plan_of(facts.history, deed) if deed.kind == "step" else None
    clauses = []
    if plan is not None:
        place, count = place_in_plan(facts.history, plan, deed), len(plan.detail.get("steps", ()))
        whose = speech.facts.subjects.wording.name(plan.source)
        text = f"that was step {place} of {count}" if place else "that was a step"
        owner = "my" if speech.is_single and plan.source == deed.source else f"{whose}'s"
        text += f" of {owner} plan for {plan.what}"
        value = float(place) if place else None
        what = (deed.what, plan.what)
        claim = Claim("planned", plan.source, what, facts.history.seconds(deed.stamp), value=value)
        clauses.append(Clause(text, (deed.id, plan.id), claim))
    wanted = plan if plan is not None else deed
    desire = next((each for each in facts.history.before(wanted) if each.kind == "desire"), None)
    asked = next((each for each in facts.history.before(desire or wanted) if each.kind in ("request", "asked")), None)
    if asked is not None:
        clauses.append(speech.narrated(asked, "asked"))
    elif desire is not None and " " in desire.cause and facts.history.cause(desire) is None:
        claim = Claim("outside", desire.source, (desire.cause,), facts.history.seconds(desire.stamp))
        clauses.append(Clause(desire.cause, (desire.id,), claim))
    return clauses


def _nearest_cause(speech: Speech, deed: TraceRecord) -> list[Clause]:
    """Return the first link of the chain of causes that says something new."""
    facts = speech.facts
    explained = explain(facts.history, speech.facts.subjects.wording, deed)
    for reason in explained.chain[1:]:
        record = facts.history.find(reason.id) if reason.id else None
        if record is None:
            if reason.kind == "outside":
                claim = Claim("outside", record_agent(facts.history, deed), (reason.sentence,), reason.at_s)
                return [Clause(reason.sentence, (deed.id,), claim)]
            continue
        if record.kind not in _OWN and record.kind != "detection":
            return [speech.narrated(record, _claim_of(record))]
    plan = next((each for each in facts.history.before(deed) if each.kind == "plan"), None)
    if plan is None:
        return []
    rule = str(plan.detail.get("label") or head_of(str(plan.detail.get("rule") or plan.what)))
    text = f"{'my' if speech.is_single else 'its'} rule '{rule}' was chosen"
    return [Clause(text, (plan.id,), Claim("chose", plan.source, (rule,), facts.history.seconds(plan.stamp)))]


def _claim_of(record: TraceRecord) -> ClaimKind:
    if record.kind in ("request", "asked", "command"):
        return "asked"
    return "percept" if record.kind == "percept" else "believed" if record.kind == "belief" else "message"


# Contrast


def contrast(speech: Speech, deed: TraceRecord) -> Clause | None:
    """Return what was different before.

    At the deed before, the belief that this one came from was not held; or the plan had a step to finish first. None if
    no sentence says so, nothing was done before, or somebody asked for it.
    """
    facts = speech.facts
    if deed.kind == "step":
        return _step_before(speech, deed)
    trigger = facts.trigger(deed)
    if trigger is None or facts.heard_before(deed) is not None:
        return None
    agent = record_agent(facts.history, deed)
    before = (each for each in reversed(facts.subjects.deeds) if each.stamp < trigger.stamp)
    foil = next((each for each in before if record_agent(facts.history, each) == agent), None)
    if foil is None:
        return None
    name = trigger.what.partition("(")[0]
    persons = [one for one in facts.concerned(deed) if f'"{one}"' in trigger.what]
    if any(each.at(foil.stamp) for each in facts.held(trigger.what, agent=trigger.source)):
        return None
    clause = speech.lacked(name, persons, agent, foil.stamp)
    if clause is None or clause.claim.value is None:
        other = facts.trigger(foil)
        held = next((each for each in facts.beliefs if each.record is other), None)
        if held is not None and held.what != trigger.what and held.at(foil.stamp):
            clause = speech.believed(held, foil.stamp)
    return None if clause is None else speech.at(clause, facts.history.seconds(foil.stamp))


def _step_before(speech: Speech, deed: TraceRecord) -> Clause | None:
    """Return the step of the same plan that a step had to wait for."""
    plan = plan_of(speech.facts.history, deed)
    chain = (each for each in speech.facts.history.before(deed) if each.kind == "step")
    before = next(chain, None)
    if plan is None or before is None or plan_of(speech.facts.history, before) is not plan:
        return None
    return speech.did(before, speech.facts.subjects.topic_of(before))


# Reasons against


def reasons_against(
    speech: Speech,
    topic: Topic,
    persons: Sequence[str],
    agent: str,
    span: tuple[float, float],
    at_s: float | None = None,
) -> list[Clause]:
    """Return why a deed was left undone in a span of time (s): a belief was missing, or its plan was rejected.

    Args:
        speech: Puts facts into words.
        topic: The deed.
        persons: The people whom it would have concerned; empty for anybody.
        agent: The agent; empty for any.
        span: Begin and end of the time.
        at_s: Time for which a missing belief is stated; by default the last one with the person believed to be here.
    """
    facts, history = speech.facts, speech.facts.history
    begin, end = history.stamp(span[0]), history.stamp(span[1])
    plans = plans_of(facts.subjects, topic)
    at = _moment(facts, persons, begin, end) if at_s is None else history.stamp(at_s)
    events = {call_of(each).partition("(")[0] for each in history if each.kind == "event"}
    entries = [name for plan in plans if (name := _belief_event(plan)) and name not in events]
    for person in persons or [""]:
        missing = [
            name for name in entries if not any(each.within(begin, end) for each in facts.held(name, person, agent))
        ]
        if person and missing:
            clause = speech.lacked("present", [person], agent, at)
            if clause is not None and not any(each.within(begin, end) for each in facts.held("present", person, agent)):
                return [clause]
            waited = _waited_for(speech, plans, person, agent, (begin, end))
            if waited is not None:
                return [waited]
        for name in missing:
            clause = speech.lacked(name, [person] if person else [], agent, at)
            if clause is not None:
                return [clause]
    rejected = _rejected(speech, plans, persons, begin, end, agent)
    if rejected is not None:
        return [rejected]
    if entries:
        names = [name for name in entries if not any(each.within(begin, end) for each in facts.held(name, "", agent))]
        if names:
            text = speech.say("no_belief", what=names[0])
            return [Clause(text, (), Claim("not_believed", agent, (names[0],), span[0], span[1]))]
    return []


def _waited_for(speech: Speech, plans: Sequence[str], person: str, agent: str, span: tuple[int, int]) -> Clause | None:
    """Return the belief about a person with whose end a plan would have done the deed: ``-converses(Who)``."""
    names = {found[1] for plan in plans if (found := re.match(r"(?:@\S+\s+)?-(?!!)(\w+)\(", plan))}
    held = [each for name in names for each in speech.facts.held(name, person, agent) if each.within(*span)]
    if not held:
        return None
    last = max(held, key=lambda each: each.begin)
    clause = speech.believed(last, max(span[0], last.begin))
    return clause if speech.has_sentence(last.what) else None


def _moment(facts: Facts, persons: Sequence[str], begin: int, end: int) -> int:
    """Return the stamp for which a missing belief is stated: the last one with the person believed to be here."""
    stays = [each for person in persons for each in facts.held("present", person) if each.within(begin, end)]
    if not stays:
        return end
    last = max(stays, key=lambda each: each.begin)
    return min(end, (last.end.stamp - 1) if last.end is not None else end)


def plans_of(subjects: Subjects, topic: Topic) -> list[str]:
    """Return the plans that do a deed, and those that adopt their goals, in order."""
    names = {call for call in topic.calls if "(" not in call}
    calls = {call.removesuffix(")") for call in topic.calls if "(" in call}
    found: list[str] = []
    grew = True
    while grew:
        grew = False
        for plan in subjects.plans:
            if plan in found:
                continue
            goal, body = goal_of(plan), plan[len(head_of(plan)) :] if "\n" not in plan else plan
            does = goal in names or any(call in body for call in calls) or any(
                re.search(rf"(?<![\w+\-~]){re.escape(name)}\b", body) for name in names
            )  # fmt: skip
            if does:
                found.append(plan)
                grew = True
                if goal:
                    names.add(goal)
    return found


def _belief_event(plan: str) -> str:
    """Return the belief whose addition triggers a plan, as a name, or as a literal if it has text arguments."""
    found = re.match(r"(?:@\S+\s+)?\+(?!!)(\w+)(\([^()]*\))?", plan)
    if found is None:
        return ""
    arguments = found[2] or ""
    return f"{found[1]}{arguments}" if '"' in arguments else found[1]


def _rejected(
    speech: Speech, plans: Sequence[str], persons: Sequence[str], begin: int, end: int, agent: str
) -> Clause | None:
    """Return the last rejection of one of the plans in a span of time, but none that only concerns other people."""
    facts = speech.facts
    for record in reversed(facts.history.between(begin, end)):
        if agent and record.source != agent:
            continue
        for plan, because in rejected_plans(record):
            named = {*arguments_of(because.partition(")")[0] + ")")} & {*facts.subjects.persons}
            is_meant = not persons or not named or not named.isdisjoint(persons)
            if plan in plans and because and is_meant:
                seconds = facts.history.seconds(record.stamp)
                claim = Claim("rejected", record.source, (plan, because), seconds)
                clause = Clause(f'a rule for it was rejected: "{because}"', (record.id,), claim)
                return speech.at(clause, seconds)
    return None
