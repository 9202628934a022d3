"""Beliefs that the words of a question may name, and answers about beliefs and the places of things."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from socialbot.runs.asking._facts import Held
from socialbot.runs.asking._people import whereabouts
from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told
from socialbot.runs.asking._sentences import Clause
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking.languages.lexicon import is_about

LEAST_FIT = 0.5
"""Least share of the words of a belief's name that a question has to have."""

_PLACES = {"in", "at", "on", "upon", "position", "location", "located", "place", "room"}
"""Words in the names of beliefs about places, which answer "where"."""


class AskedBelief(NamedTuple):
    """Name of a belief that a question may ask for, the share of its words, and the places of those in the question."""

    name: str
    fit: float
    places: frozenset[int]


def _parts(name: str) -> list[str]:
    return [part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def tells_place(name: str) -> bool:
    """Return whether a belief of this name tells where something is."""
    return bool(_PLACES.intersection(_parts(name)[:1]))


def asked_beliefs(reading: Reading, subjects: Subjects) -> Iterator[AskedBelief]:
    """Yield the beliefs that the words of a question may ask for."""
    is_where = reading.has("where") or {"which", "room"} <= set(reading.words)
    for name in subjects.belief_names:
        parts = _parts(name)
        if is_where and tells_place(name):
            yield AskedBelief(name, 1.0, frozenset(reading.places("where")))
            continue
        places: set[int] = set()
        matched = 0
        for part in parts:
            own = {n for n, word in enumerate(reading.words) if is_about(word, reading.language.code, part)}
            matched += bool(own)
            places |= own
        if parts and matched / len(parts) >= LEAST_FIT:
            yield AskedBelief(name, matched / len(parts), frozenset(places))


def believed(scope: Scope) -> Told | None:
    """Return what was believed at the time that the question asks about, or since when, if it asks when."""
    question = scope.question
    named = question.names
    held = [
        each
        for each in scope.facts.held(question.belief)
        if named <= {*arguments_of(each.what), each.agent} and scope.agent in ("", each.agent, *named)
    ]
    if scope.persons:
        held = [each for each in held if {*scope.persons} & {*arguments_of(each.what)}]
    seconds, stamp = scope.moment()
    if question.asks_when:
        chosen = scope.one_of([each for each in held if each.begin <= scope.now])
        clauses = [_at(scope, each, scope.history.seconds(each.begin), each.begin) for each in chosen]
    else:
        chosen = [each for each in held if each.at(stamp)] or _last(held, stamp, has_time=question.at_s is not None)
        clauses = [_at(scope, each, seconds, stamp) for each in chosen[:MOST_NAMED]]
    return scope.told(clauses)


def placed(scope: Scope) -> Told | None:
    """Return the last known place of a thing or agent, or where people were seen.

    The place of a thing is the one that is believed now. Without such a belief, it is told by the last deed with it.
    """
    if scope.topic is not None or scope.persons:
        return whereabouts(scope)
    named = scope.question.names
    seconds, stamp = scope.moment()
    held = [each for each in scope.facts.beliefs if each.at(stamp) and named == {_placed_thing(each)}]
    done = [each for each in scope.subjects.deeds if each.stamp <= stamp and named <= {*arguments_of(each.what)}]
    placed = scope.told([_at(scope, each, seconds, stamp) for each in held[-MOST_NAMED:]])
    return placed or scope.told_deeds(done[-1:])


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
        seconds, stamp = scope.history.seconds(held.begin), held.begin
    return scope.speech.at(scope.speech.believed(held, stamp), seconds)
