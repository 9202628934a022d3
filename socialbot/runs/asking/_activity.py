"""Answers about what the robot said, did and intended, and about the steps of plans and how they ended."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import islice

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._clauses import is_question
from socialbot.runs.asking._facts import near, near_or_later
from socialbot.runs.asking._question import NEAR_S
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told, fitting_words
from socialbot.runs.asking._sentences import Claim, Clause, infinitive
from socialbot.runs.asking._words import name_tokens, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, LANGUAGES
from socialbot.runs.narration import plan_of, step_in
from socialbot.runs.why import call_of

_WANTED = {"desire", "goal"}


def said(scope: Scope) -> Told | None:
    deeds = [each for each in scope.subjects.deeds if scope.subjects.words_said(each)]
    spoken = scope.until_now(deeds) or deeds
    spoken = scope.in_time(scope.of_persons(each for each in spoken if scope.is_meant(each)))
    at_s, event = scope.question.at_s, scope.question.event
    if scope.question.says:
        spoken = scope.quoted(spoken, scope.question.says)
    if at_s is not None:
        spoken = _near(scope, spoken, at_s) or (spoken[:1] if at_s == 0.0 else [])
    elif event is not None and event.heard is not None:
        spoken = spoken[:1] if event.relation != "before" else spoken[-1:]  # the reply
    elif event is not None and event.relation == "after" and scope.question.ordinal is None:
        spoken = spoken[: 1 if event.is_near else MOST_NAMED]
    elif scope.question.ordinal is not None or not (scope.persons or scope.question.agent):
        spoken = scope.one_of(spoken)
    deed = scope.event_deed
    if not spoken and event is not None and event.relation == "when" and deed is not None:
        spoken = [deed] if scope.subjects.words_said(deed) else []  # "when you asked Ann in": those words
    if not spoken and (scope.question.things or scope.question.says):
        return None
    if not spoken:
        clause = _silence(scope, *scope.span())
        return clause.text, [clause]
    return scope.told([scope.speech.did(each, None) for each in spoken[-MOST_NAMED:]])


def _near(scope: Scope, records: Sequence[TraceRecord], at_s: float) -> list[TraceRecord]:
    """Return the records nearest to a time (s). If the question says ``after``, return the next ones."""
    stamp = scope.history.stamp(at_s)
    if not scope.question.is_later:
        return near(records, stamp, NEAR_S)
    return near_or_later(records, stamp, NEAR_S, scope.facts.end_of)[:MOST_NAMED]


def heard(scope: Scope) -> Told | None:
    """Return what people said: the words in question, or else all of it, with the reply to a single utterance."""
    found = scope.in_time(scope.heard())
    if scope.question.reported:
        found = [each for each in found if _is_reported(scope, each)]
    elif scope.question.says:
        content = set(scope.question.says) - LANGUAGES[scope.question.language].known_words
        if not all(map(scope.subjects.is_heard, content)):
            return None  # "Did t1 ask you for money?": nobody said that word
        found = fitting_words(found, scope.question.says)
    if scope.question.at_s is not None:
        found = _near(scope, found, scope.question.at_s)
    elif scope.question.ordinal is not None:
        found = scope.one_of(found)
    elif scope.question.event is not None and scope.question.event.is_near:
        found = found[-1:] if scope.question.event.relation == "before" else found[:1]
    clauses = [scope.speech.heard(each) for each in found[-MOST_NAMED:]]
    if len(found) == 1:
        replies = (
            each
            for each in scope.subjects.deeds
            if each.kind == "utterance" and scope.facts.heard_before(each) is found[0]
        )
        clauses += [scope.speech.did(each, None) for each in islice(replies, 1)]
    return scope.told(clauses)


def _is_reported(scope: Scope, utterance: TraceRecord) -> bool:
    """Return whether an utterance has the content of an indirect question.

    In another language, only what it was understood as tells that: ``ask_why``.
    """
    question, language = scope.question, LANGUAGES[scope.question.language]
    said = {stem(word) for word in tokens(utterance.what)}
    if utterance.detail.get("language") not in (None, "", language.code):
        return any(question.reported in name_tokens(one) for one in scope.facts.intents(utterance))
    names = {stem(word) for name in scope.subjects.persons for word in tokens(name)}
    content = {stem(word) for word in question.says if word not in language.known_words} - names
    asked = {stem(word) for word in question.says[:1]}
    return bool(content) and content | asked <= said


def count_heard(scope: Scope) -> Told | None:
    """Return how often people spoke, or asked something, and what they said."""
    told = scope.in_time(scope.heard())
    if scope.question.asks:
        told = [each for each in told if _is_question(each)]
    if not told:
        return None
    begin_s, end_s = (0.0, scope.now_s) if scope.question.event is None else scope.span()
    text = scope.speech.say("times_one") if len(told) == 1 else scope.speech.say("times", count=len(told))
    claim = Claim(
        "count_heard", at_s=begin_s, until_s=end_s, persons=tuple(scope.persons), value=float(len(told)),
        what=("?",) if scope.question.asks else (),
    )  # fmt: skip
    shown = [scope.speech.heard(each) for each in told[:MOST_NAMED]]
    return f"{text}: {scope.joined(shown)}", [Clause(text, tuple(each.id for each in told), claim), *shown]


def _is_question(utterance: TraceRecord) -> bool:
    language = LANGUAGES.get(str(utterance.detail.get("language")), ENGLISH)
    return "?" in utterance.what or is_question(tokens(utterance.what), language)


def heard_as(scope: Scope) -> Told | None:
    """Return what people said that was understood as the deed in question: no record tells what else they did."""
    assert scope.topic is not None
    phrases = scope.topic.words.get(ENGLISH.code, ()) + scope.topic.loose
    words = {stem(word) for phrase in phrases for word in phrase}
    found = [each for each in scope.in_time(scope.heard()) if words.intersection(map(stem, scope.facts.intents(each)))]
    return scope.told([scope.speech.heard(each) for each in found[-MOST_NAMED:]])


def failed(scope: Scope) -> Told | None:
    """Return the failures in question; that there was none, if the question is about no deed or thing."""
    found = scope.until_now(scope.in_time(scope.facts.failures))
    if scope.question.at_s is not None:
        found = near(found, scope.history.stamp(scope.question.at_s), NEAR_S)
    things, topic = set(scope.question.things), scope.topic
    is_faultless = not scope.facts.failures and all(
        each.detail.get("outcome") != "failed" for each in scope.facts.plan_ends
    )
    is_about_all = not things and topic is None
    is_all = scope.question.at_s is None and (is_about_all or (is_faultless and bool(scope.deeds or topic is None)))
    chains = [(each, [each, *scope.history.before(each)]) for each in found if scope.agent in ("", each.source)]
    if topic is not None:
        chains = [each for each in chains if any(topic.covers(call_of(one) or one.what) for one in each[1])]
    found = [each for each, _ in chains if things <= scope.things_behind(each)]
    if scope.question.ordinal is not None:
        found = scope.one_of(found)
    clauses = [scope.speech.failed(each) for each in found[:MOST_NAMED]]
    if is_all:
        ends = [each for each in scope.in_time(scope.facts.plan_ends) if each.detail.get("outcome") == "failed"]
        ends = [each for each in scope.until_now(ends) if scope.agent in ("", each.source)]
        clauses += [scope.speech.ended(each) for each in ends[:MOST_NAMED]]
    if not clauses and is_all:
        begin_s, end_s = scope.span()
        text = scope.speech.about(scope.agent, scope.speech.say("nothing_failed"))
        clause = Clause(text, (), Claim("nothing_failed", scope.agent, at_s=begin_s, until_s=end_s))
        clauses = [clause if scope.question.event is None else scope.speech.within(clause, begin_s, end_s)]
    return scope.told(clauses)


def doing(scope: Scope) -> Told | None:
    seconds, stamp = scope.moment()
    deeds = [each for each in scope.subjects.deeds if scope.is_meant(each)]
    if scope.question.span_s is not None:
        return scope.told_deeds(scope.up_to_now()[-MOST_NAMED:]) or _idle_in(scope, scope.question.span_s)
    if scope.question.event is not None:
        deeds = scope.in_time(scope.until_now(deeds))
        if deeds:
            return scope.told_deeds([deeds[-1 if scope.question.event.relation == "before" else 0]])
        deeds = [each for each in scope.subjects.deeds if scope.is_meant(each)]
    if scope.question.ordinal is not None:
        deed = scope.numbered(scope.up_to_now())
        if deed is not None or scope.question.event is None:
            return None if deed is None else scope.told_deeds([deed])
    if scope.question.at_s is None and scope.question.is_past:
        return scope.told_deeds(scope.of_persons(scope.until_now(deeds))[-MOST_NAMED:])
    under_way = [each for each in deeds if each.stamp <= stamp and _is_under_way(scope, each, stamp)]
    if not under_way and scope.question.at_s is not None:
        under_way = scope.until_now(near(deeds, stamp, 1.0))
    if not under_way and scope.question.is_later:
        under_way = [each for each in deeds if stamp < each.stamp <= scope.now][:MOST_NAMED]
    if under_way:
        return scope.told_deeds(under_way[-MOST_NAMED:])
    before = [each for each in deeds if each.stamp <= stamp]
    text = scope.speech.about(scope.agent, scope.speech.say("nothing_done"))
    nothing = Clause(text, (), Claim("did_not", scope.only_agent(), (), seconds, seconds))
    nothing = scope.speech.at(nothing, seconds)
    if not before:
        return nothing.text, [nothing]
    last = scope.speech.did(before[-1], scope.subjects.topic_of(before[-1]), at=False)
    told = scope.speech.say("last_was", when=_when_done(scope, before[-1]), clause=last.text)
    return f"{nothing.text}; {told}", [nothing, last]


def ahead(scope: Scope) -> Told | None:
    seconds, stamp = scope.moment()
    planned = steps_ahead(scope, stamp)
    if planned:
        told = scope.joined(planned)
        return scope.speech.then(seconds, told), planned
    state = scope.run.states.at(stamp)
    wanted = [
        Clause(
            scope.speech.about(mind.name, scope.speech.say("wanted", what=goal.text)),
            (goal.id,),
            Claim("wanted", mind.name, (goal.text,), seconds),
        )
        for mind in state.agents
        if scope.agent in ("", mind.name)
        for goal in (*mind.desires, *mind.goals)
        if not scope.facts.has_failed(goal.id, stamp)
    ][:MOST_NAMED]
    question = scope.question
    if not wanted and question.is_past and question.event is None:
        had = scope.told(_had_wanted(scope))  # "What was your goal?", "What was your goal at 11 s?"
        if had:
            return had
    nothing = scope.speech.about(scope.agent, scope.speech.say("nothing_next"))
    clauses = wanted or [Clause(nothing, (), Claim("nothing_wanted", scope.only_agent(), at_s=seconds))]
    told = scope.speech.then(seconds, scope.joined(clauses))
    later = next((each for each in scope.subjects.deeds if each.stamp > stamp and scope.is_meant(each)), None)
    if later is None or later.stamp > scope.now:
        return told, clauses
    done = scope.speech.did(later, scope.subjects.topic_of(later), at=False)
    following = scope.speech.say("next_was", when=_when_done(scope, later), clause=done.text)
    return f"{told}; {following}", [*clauses, done]


def _had_wanted(scope: Scope) -> list[Clause]:
    """Return the last desires and goals that served no other one, each with the time of its adoption.

    At a time, they are those adopted nearest to it: a goal may end as soon as it is adopted.
    """
    adopted = [each for each in scope.history if each.kind in _WANTED and scope.agent in ("", each.source)]
    adopted = scope.until_now(scope.in_time(adopted))
    own = [each for each in adopted if not any(one.kind in _WANTED for one in scope.history.before(each))]
    if scope.question.at_s is not None:
        own = near(own, scope.history.stamp(scope.question.at_s), NEAR_S)
    clauses = []
    for each in own[-MOST_NAMED:]:
        text = scope.speech.about(each.source, scope.speech.say("wanted", what=each.what))
        seconds = scope.history.seconds(each.stamp)
        clauses.append(
            scope.speech.at(Clause(text, (each.id,), Claim("wanted", each.source, (each.what,), seconds)), seconds)
        )
    return clauses


def _idle_in(scope: Scope, span_s: tuple[float, float]) -> Told:
    """Return that nothing was said in a span of time without deeds."""
    begin_s, end_s = span_s[0], min(scope.now_s, span_s[1])
    clause = scope.speech.within(_silence(scope, begin_s, end_s), begin_s, end_s)
    return clause.text, [clause]


def _silence(scope: Scope, begin_s: float, end_s: float) -> Clause:
    claim = Claim("said_not", scope.agent, at_s=begin_s, until_s=end_s, persons=tuple(scope.persons))
    return Clause(scope.speech.say("said_nothing"), (), claim)


def _when_done(scope: Scope, deed: TraceRecord) -> str:
    return scope.speech.when(scope.history.seconds(deed.stamp))


def _is_under_way(scope: Scope, record: TraceRecord, stamp: int) -> bool:
    """Return whether a step, an action or an utterance that began had not ended at ``stamp``."""
    end = scope.facts.end_of(record)
    return end is not None and end.stamp > stamp


# Plans


def steps(scope: Scope) -> Told | None:
    """Return the step of a number of the plans in question, or the number of steps and the first ones."""
    _, stamp = scope.moment()
    started = [
        each
        for each in scope.facts.plan_starts
        if each.stamp <= stamp and scope.agent in ("", each.source) and _is_named(each, scope)
    ]
    newest = {(each.source, each.what): each for each in _named(scope, started)}
    longest = sorted(newest.values(), key=lambda each: -len(each.detail["steps"]))
    return scope.told([clause for plan in longest for clause in _steps_of(scope, plan)][:MOST_NAMED])


def _steps_of(scope: Scope, plan: TraceRecord) -> list[Clause]:
    lines, order = [step_in(each) for each in plan.detail["steps"]], scope.question.ordinal
    whose = _owner(scope, plan.source)
    if order is not None:
        place = order if order > 0 else len(lines) + 1 + order
        text = f"step {{}} of {len(lines)} of {whose} plan for {plan.what} was to {{}}"
        return [_step(scope, plan, place, text)] if 0 < place <= len(lines) else []
    claim = Claim("step_count", plan.source, (plan.what,), scope.history.seconds(plan.stamp), value=float(len(lines)))
    number = "1 step" if len(lines) == 1 else f"{len(lines)} steps"
    counted = Clause(f"{whose} plan for {plan.what} had {number}", (plan.id,), claim)
    shown = [_step(scope, plan, place, "step {} was to {}") for place in range(1, min(len(lines), MOST_NAMED) + 1)]
    return [counted, *shown]


def _step(scope: Scope, plan: TraceRecord, place: int, text: str) -> Clause:
    step = step_in(plan.detail["steps"][place - 1])
    action, *arguments = step.strip("()").split()
    claim = Claim("step", plan.source, (step, plan.what), scope.history.seconds(plan.stamp), value=float(place))
    return Clause(text.format(place, infinitive(scope.subjects.wording.call(action, arguments))), (plan.id,), claim)


def _owner(scope: Scope, agent: str) -> str:
    return "my" if scope.speech.is_single else f"{scope.subjects.wording.name(agent)}'s"


def replanned(scope: Scope) -> Told | None:
    """Return how the plans ended that a new plan for the same goal followed; without one, the failures in question."""
    last = {(each.source, each.what): each.stamp for each in scope.facts.plan_starts}
    found = [
        each
        for each in _ends(scope)
        if each.detail.get("outcome") != "succeeded" and last.get((each.source, each.what), -1) >= each.stamp
    ]
    if scope.question.ordinal is not None:
        found = scope.one_of(found)
    return scope.told([scope.speech.ended(each) for each in found[-MOST_NAMED:]])


def ended(scope: Scope) -> Told | None:
    """Return how the plans in question ended: those whose goal or desire the words name, or else the last one."""
    return scope.told([scope.speech.ended(each) for each in scope.one_of(_ends(scope))])


def _ends(scope: Scope) -> list[TraceRecord]:
    """Return the ends of plans of the agent, things, goal and time in question."""
    found = [each for each in scope.until_now(scope.facts.plan_ends) if scope.agent in ("", each.source)]
    found = _named(scope, [each for each in found if _is_named(each, scope)])
    if scope.question.at_s is not None:
        found = near(found, scope.history.stamp(scope.question.at_s), NEAR_S)
    return found


def _named(scope: Scope, plans: Sequence[TraceRecord]) -> list[TraceRecord]:
    """Return the records of the plan that the question names, or whose goal or desire has words of it, or else all."""
    if scope.question.plan:
        return [each for each in plans if each.what == scope.question.plan]
    asked = {stem(word) for word in scope.question.unknown}
    named = [each for each in plans if asked.intersection(map(stem, tokens(each.what)))]
    return named or list(plans)


def _is_named(end: TraceRecord, scope: Scope) -> bool:
    things = set(scope.question.things) - {end.source}
    return things <= {*re.findall(r"\w+", end.what)}


def steps_ahead(scope: Scope, stamp: int) -> list[Clause]:
    """Return the next step of each plan in execution."""
    found = []
    for mind in scope.run.states.at(stamp).agents:
        for plan in mind.plans if scope.agent in ("", mind.name) else ():
            record = scope.history.find(plan.id)
            if record is not None:
                found.append(_step_ahead(scope, record, mind.name, stamp))
    return [each for each in found if each is not None][:MOST_NAMED]


def _step_ahead(scope: Scope, plan: TraceRecord, agent: str, stamp: int) -> Clause | None:
    """Return the first step of a plan that had not begun at ``stamp``; None if all had."""
    between = scope.history.between(plan.stamp, stamp)
    begun = Counter(each.what for each in between if each.kind == "step" and plan_of(scope.history, each) is plan)
    for place, line in enumerate(plan.detail.get("steps", ()), 1):
        step = step_in(line)
        if begun[step]:
            begun[step] -= 1
            continue
        action, *arguments = step.strip("()").split()
        sentence = scope.subjects.wording.call(action, arguments)
        text = f"step {place} of {_owner(scope, agent)} plan for {plan.what} was next: {sentence}"
        claim = Claim("planned", agent, (step, plan.what), scope.history.seconds(stamp), value=float(place))
        return Clause(text, (plan.id,), claim)
    return None
