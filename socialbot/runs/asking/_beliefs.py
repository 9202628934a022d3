"""Answers about beliefs and the places of things."""

from __future__ import annotations

from socialbot.runs.asking._facts import Held
from socialbot.runs.asking._named_beliefs import tells_place
from socialbot.runs.asking._people import whereabouts
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told
from socialbot.runs.asking._sentences import Clause
from socialbot.runs.asking._topics import arguments_of


def believed(scope: Scope) -> Told | None:
    """Return what was believed at the time that the question asks about, or since when, if it asks when."""
    question = scope.question
    named = {*question.things, *([question.agent] if question.agent else [])}
    held = [
        each
        for each in scope.facts.held(question.belief)
        if named <= {*arguments_of(each.what), each.agent} and scope.agent in ("", each.agent, *named)
    ]
    if scope.persons:
        held = [each for each in held if {*scope.persons} & {*arguments_of(each.what)}]
    seconds, stamp = scope.moment()
    if question.asks_when:
        begun = [each for each in held if each.begin <= scope.now]
        chosen = [one for one in [scope.numbered(begun)] if one is not None]
        clauses = [
            scope.speech.at(scope.speech.believed(each, each.begin), scope.facts.seconds(each.begin)) for each in chosen
        ]
    else:
        chosen = [each for each in held if each.at(stamp)] or _last(held, stamp, has_time=question.at_s is not None)
        clauses = [_at(scope, each, seconds, stamp) for each in chosen[:MOST_NAMED]]
    return (scope.joined(clauses), clauses) if clauses else None


def placed(scope: Scope) -> Told | None:
    """Return the last known place of a thing or agent, or where people were seen.

    The place of a thing is the one that is believed now. Without such a belief, it is told by the last deed with it.
    """
    if scope.topic is not None or scope.persons:
        return whereabouts(scope)
    named = {*scope.question.things, *([scope.question.agent] if scope.question.agent else [])}
    seconds, stamp = scope.moment()
    held = [each for each in scope.facts.beliefs if each.at(stamp) and named == {_placed_thing(each)}]
    if held:
        clauses = [_at(scope, each, seconds, stamp) for each in held[-MOST_NAMED:]]
        return scope.joined(clauses), clauses
    done = [each for each in scope.subjects.deeds if each.stamp <= stamp and named <= {*arguments_of(each.what)}]
    clauses = [scope.speech.did(each, scope.subjects.topic_of(each)) for each in done[-1:]]
    return (scope.joined(clauses), clauses) if clauses else None


def _placed_thing(belief: Held) -> str:
    """Return the thing whose place a belief tells, or the agent that believes it of itself; empty for other beliefs."""
    if not tells_place(belief.what.partition("(")[0]):
        return ""
    first, *others = [*arguments_of(belief.what), ""]
    return first if any(others) else belief.agent


def _last(held: list[Held], stamp: int, *, has_time: bool) -> list[Held]:
    """Return the last belief before a time; none if the question names the time."""
    before = [each for each in held if each.begin <= stamp]
    return before[-1:] if before and not has_time else []


def _at(scope: Scope, held: Held, seconds: float, stamp: int) -> Clause:
    if not held.at(stamp):
        seconds, stamp = scope.facts.seconds(held.begin), held.begin
    return scope.speech.at(scope.speech.believed(held, stamp), seconds)
