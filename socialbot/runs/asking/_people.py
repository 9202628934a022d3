"""Answers about people: who was here, for how long, how many, what was seen and believed, and where things are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._facts import Held, Presence
from socialbot.runs.asking._references import Limit, Reading
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told
from socialbot.runs.asking._sentences import Claim, Clause
from socialbot.runs.asking._subjects import Subjects, persons_in
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


SIDES = ("left", "middle", "right")
"""Thirds of a picture."""


def visitors(scope: Scope) -> Told | None:
    """Return who was here: at the time in question, or else all visits."""
    if not has_frames(scope):
        return _deeds_with_names(scope)
    event = scope.question.event
    if event is not None and event.relation != "when" and event.what.person is not None and not event.what.topics:
        if scope.question.person is None:
            return _neighbour(scope, after=event.relation == "after")
        # "Did t1 come before t2?": both visits
        compared = [each for each in scope.visits() if each.person in (*scope.persons, *scope.event_persons)]
        return scope.told([stay(scope, each) for each in compared])
    if event is not None and event.relation != "when" and scope.persons and scope.event_deed is not None:
        # "Did t1 leave before you greeted t2?": the visit and the deed
        clauses = [stay(scope, each) for each in _visits(scope)]
        clauses.append(scope.speech.did(scope.event_deed, scope.subjects.topic_of(scope.event_deed)))
        return scope.joined(clauses), clauses
    is_at_event = scope.event_s is not None and scope.question.kind == "who"
    if scope.question.at_s is not None or is_at_event:
        return seen(scope)
    stays = _visits(scope)
    if scope.question.extreme in ("nearest", "farthest"):
        return _by_distance(scope, stays)
    clauses = [stay(scope, each) for each in stays]
    if not clauses:
        return None if scope.question.limit is not None or scope.question.is_shared else _nobody(scope)
    shown = clauses[:MOST_NAMED]
    if len(clauses) > MOST_NAMED or scope.question.kind == "count":
        shown.insert(0, _people_counted(scope))
    return scope.joined(shown), shown


def _deeds_with_names(scope: Scope) -> Told | None:
    """Return the first deeds that name a person, in a run without a camera: ``Was Ann here?``; None without a name."""
    names = set(scope.question.things)
    if not names or scope.question.unknown or not names <= {*scope.subjects.argument_names.values()}:
        return None
    return scope.told_deeds(scope.in_time(scope.meant_until_now())[:MOST_NAMED])


def _neighbour(scope: Scope, *, after: bool) -> Told | None:
    """Return the visit that began next after the event of the question, or last before it."""
    assert scope.event_s is not None
    begun = [(scope.history.seconds(each.first.stamp), each) for each in scope.visits()]
    found = [each for at_s, each in begun if (at_s > scope.event_s if after else at_s < scope.event_s)]
    if not found:
        return None
    clause = stay(scope, found[0] if after else found[-1])
    return clause.text, [clause]


def seen(scope: Scope) -> Told | None:
    _, stamp = scope.moment()
    frame = scope.facts.frame(stamp)
    if frame is None or (scope.agent and not _sees(scope, scope.agent)):
        return _sensed(scope, stamp)
    if scope.persons and scope.question.at_s is None and scope.event_s is None:
        return visitors(scope)
    seconds = scope.history.seconds(frame.stamp)
    people = [each for each in frame.detail.get("persons", ()) if each.get("track_id") or not scope.subjects.persons]
    if not people:
        claim = Claim("saw_nobody", at_s=seconds)
        clause = scope.speech.at(Clause(scope.speech.say("saw_none"), (frame.id,), claim), seconds)
        return clause.text, [clause]
    return saw(scope, frame, [str(each.get("track_id") or "somebody") for each in people])


def saw(scope: Scope, frame: TraceRecord, persons: Sequence[str], *, has_side: bool = False) -> Told:
    """Return that these people were seen in a frame, with their distances and the sides of the picture."""
    seconds, clauses = scope.history.seconds(frame.stamp), []
    known = {str(each.get("track_id") or "somebody"): each for each in frame.detail.get("persons", ())}
    for name in persons[:MOST_NAMED]:
        shown, distance = scope.speech.people([name]), known[name].get("distance_m")
        if distance is not None:
            shown = scope.speech.say("away", person=shown, distance=scope.speech.number(distance))
        side = _side(known[name], frame.detail.get("width")) if has_side else None
        if side is not None:
            sides = scope.speech.say("sides").split("|")
            shown = scope.speech.say("side", person=shown, side=sides[SIDES.index(side)])
        claim = Claim("saw", what=() if side is None else (side,), at_s=seconds, persons=(name,), value=distance)
        clauses.append(Clause(shown, (frame.id,), claim))
    told = scope.speech.say("saw_one", people=scope.joined(clauses))
    return scope.speech.then(seconds, told), clauses


def _side(person: Mapping[str, float], width: float | None) -> str | None:
    """Return the third of the picture that the middle of a person is in; None if it is not recorded."""
    x, w = person.get("x"), person.get("w")
    if not width or x is None or w is None:
        return None
    return SIDES[min(2, max(0, int(3 * (x + w / 2) / width)))]


def whereabouts(scope: Scope) -> Told | None:
    """Return where people were seen: at the time in question, when a deed concerned them, or else last."""
    deed = scope.chosen() if scope.topic is not None else None
    if scope.topic is not None and deed is None:
        return None
    has_time = deed is None and (scope.question.at_s is not None or scope.event_s is not None)
    persons = scope.facts.concerned(deed) if deed is not None else scope.persons
    frame = scope.facts.frame(scope.moment()[1] if deed is None else deed.stamp)
    if deed is None and not has_time:
        stays = [each for each in scope.visits() if each.person in persons]
        frame = min((each.last for each in stays[-1:]), key=lambda last: last.stamp, default=None)
        if frame is not None and frame.stamp > scope.now:
            frame = scope.facts.frame(scope.now)
    inside = [] if frame is None else [each for each in persons if each in persons_in(frame)]
    if frame is None or not inside:
        return seen(scope) if has_time else None
    told, clauses = saw(scope, frame, inside, has_side=True)
    if deed is None:
        return told, clauses
    done = scope.speech.did(deed, scope.topic)
    return f"{done.text}; {told}", [done, *clauses]


def count_people(scope: Scope) -> Told | None:
    if scope.question.at_s is not None:
        return seen(scope)
    if not scope.visits():
        return _nobody(scope)
    if scope.question.limit is not None or scope.question.is_shared:
        clauses = [stay(scope, each) for each in _visits(scope)]
        return (scope.joined(clauses), clauses) if clauses else None
    clause = _people_counted(scope)
    return clause.text, [clause]


def _visits(scope: Scope) -> list[Presence]:
    """Return the visits in question, in order of arrival."""
    stays = scope.visits()
    if scope.question.is_shared and scope.persons:
        stays = _shared(scope, stays)
    elif scope.persons:
        stays = [each for each in stays if each.person in scope.persons]
    if scope.question.span_s is not None:
        begin, end = map(scope.history.stamp, scope.span())
        stays = [each for each in stays if each.first.stamp <= end and each.last.stamp >= begin]
    if scope.question.ordinal is not None and not scope.persons and stays:
        return _in_order(scope, stays)
    if scope.question.limit is not None:
        stays = [each for each in stays if _is_within(scope, each, scope.question.limit)]
    if scope.question.extreme in ("longest", "shortest") and stays and not _is_compared(scope):
        lengths = [_length_s(scope, each) for each in stays]
        wanted = max(lengths) if scope.question.extreme == "longest" else min(lengths)
        stays = [each for each, length in zip(stays, lengths, strict=True) if length == wanted]
    return stays


def _length_s(scope: Scope, visit: Presence) -> float:
    return round(scope.history.seconds(visit.last.stamp) - scope.history.seconds(visit.first.stamp), 1)


def _shared(scope: Scope, stays: Sequence[Presence]) -> list[Presence]:
    """Return the visits of others at the time of visits in question; with several people, their own visits."""
    own = [each for each in stays if each.person in scope.persons]
    if len(scope.persons) > 1:
        return own
    return [
        each
        for each in stays
        if each not in own
        and any(each.first.stamp <= one.last.stamp and one.first.stamp <= each.last.stamp for one in own)
    ]


def _is_within(scope: Scope, visit: Presence, limit: Limit) -> bool:
    if not limit.in_metres:
        return limit.holds(_length_s(scope, visit))
    nearest = _extreme_frame(scope, visit, is_nearest=True)
    return nearest is not None and limit.holds(nearest[0])


def _extreme_frame(scope: Scope, visit: Presence, *, is_nearest: bool) -> tuple[float, TraceRecord] | None:
    """Return the least or greatest distance (m) of a person during a visit, and the first frame that shows it."""
    frames = [each for each in scope.history.back(visit.first.stamp, visit.last.stamp) if each.kind == "detection"]
    found = [
        (float(one["distance_m"]), frame)
        for frame in reversed(frames)
        for one in frame.detail.get("persons", ())
        if str(one.get("track_id")) == visit.person and one.get("distance_m") is not None
    ]
    choose = min if is_nearest else max
    return choose(found, key=lambda each: each[0], default=None)


def _by_distance(scope: Scope, stays: Sequence[Presence]) -> Told | None:
    """Return the nearest or farthest people, each with the frame of that distance."""
    is_nearest = scope.question.extreme == "nearest"
    found = [
        (each.person, *extreme)
        for each in stays
        if (extreme := _extreme_frame(scope, each, is_nearest=is_nearest)) is not None
    ]
    if not found:
        return None
    best = (min if is_nearest else max)(distance for _, distance, _ in found)
    chosen = {
        person: frame
        for person, distance, frame in reversed(found)
        if _is_compared(scope) or round(distance - best, 1) == 0
    }
    told = [saw(scope, frame, [person]) for person, frame in list(chosen.items())[::-1][:MOST_NAMED]]
    return "; ".join(text for text, _ in told), [clause for _, clauses in told for clause in clauses]


def _is_compared(scope: Scope) -> bool:
    """Return whether all of the named people are told of: ``Did t3 stay longer than t5?``."""
    return scope.question.is_compared and len(scope.persons) > 1


def _in_order(scope: Scope, stays: Sequence[Presence]) -> list[Presence]:
    """Return the visits of a number in the order in which people came or left, with those at the same time."""
    came = {each.person: each for each in reversed(stays)}
    left = {each.person: each for each in stays}

    def at_s(visit: Presence) -> float:
        return round(scope.history.seconds((visit.last if scope.question.leaves else visit.first).stamp), 1)

    ordered = sorted((left if scope.question.leaves else came).values(), key=at_s)
    chosen = scope.numbered(ordered)
    return [] if chosen is None else [each for each in ordered if at_s(each) == at_s(chosen)]


def _people_counted(scope: Scope) -> Clause:
    begin_s, end_s = scope.span() if scope.question.span_s is not None else (0.0, scope.now_s)
    begin, end = scope.history.stamp(begin_s), scope.history.stamp(end_s)
    stays = [each for each in scope.facts.visits if each.first.stamp <= end and each.last.stamp >= begin]
    came = {each.person: each for each in reversed(stays)}
    text = scope.speech.say("counted_one") if len(came) == 1 else scope.speech.say("counted", count=len(came))
    claim = Claim("count_people", at_s=begin_s, until_s=end_s, value=float(len(came)))
    return Clause(text, tuple(each.first.id for each in came.values()), claim)


def _nobody(scope: Scope) -> Told:
    begin_s, end_s = scope.span() if scope.question.span_s is not None else (0.0, scope.now_s)
    claim = Claim("nobody_here", at_s=begin_s, until_s=end_s, persons=tuple(scope.persons))
    clause = Clause(scope.speech.say("nobody_came"), (), claim)
    if scope.question.span_s is not None:
        clause = scope.speech.within(clause, begin_s, end_s)
    return clause.text, [clause]


def stay(scope: Scope, visit: Presence) -> Clause:
    last = visit.last if visit.last.stamp <= scope.now else (scope.facts.frame(scope.now) or visit.last)
    at_s, until_s = scope.history.seconds(visit.first.stamp), scope.history.seconds(last.stamp)
    is_you = visit.person == scope.speech.you
    text = scope.speech.say(
        "here_you" if is_you else "here",
        person=scope.speech.people([visit.person]),
        at=scope.speech.number(at_s),
        until=scope.speech.number(until_s),
    )
    return Clause(text, (visit.first.id, last.id), Claim("here", at_s=at_s, until_s=until_s, persons=(visit.person,)))


def has_frames(scope: Scope) -> bool:
    return scope.facts.frame(scope.now) is not None


def _sees(scope: Scope, agent: str) -> bool:
    """Return whether the decisions of an agent come from detections."""
    return any(each.source == agent and each.cause.startswith("detection") for each in scope.history)


def _sensed(scope: Scope, stamp: int) -> Told | None:
    """Return the newest beliefs from sensors."""
    held = [
        each
        for each in scope.facts.beliefs
        if each.at(stamp) and each.record.detail.get("source") == "percept" and scope.agent in ("", each.agent)
    ]
    return scope.told([scope.speech.believed(each, stamp) for each in held[-3:]])
