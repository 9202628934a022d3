"""Events that subordinate clauses name: ``after t2 had left``, ``between the kitchen and the bathroom``."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from socialbot.runs.asking._clauses import Parts, Relation
from socialbot.runs.asking._doer import is_done_by_people
from socialbot.runs.asking._parts import NAMED, Found
from socialbot.runs.asking._question import Event, Question
from socialbot.runs.asking._references import PersonReference
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._word_classes import tells

ARTICLES = {"the", "a", "an"}
_AWAY = {"away", "off", "weg", "fort"}
"""Particles of verbs of leaving."""


def bound_of(found: Found, other: Found, subjects: Subjects, relation: Relation) -> Event | None:
    """Return one of two events that a time is between: a deed, something done to a thing, or a visit.

    ``The second one`` is the same deed as the ``other`` event.
    """
    what, words, language = subordinate(found, subjects), found.reading.words, found.reading.language
    if what.topics or what.things or what.agent:
        return Event(relation, what, leaves=False)
    like = subordinate(other, subjects)
    if like.topics and (what.person is not None or what.ordinal is not None):
        order = what.ordinal if what.person is None else what.person.ordinal
        person = None if order is not None else what.person  # "the second one"
        return Event(relation, replace(what, topics=like.topics, ordinal=order, person=person), leaves=False)
    if what.person is None and what.ordinal is not None and like.person is not None:
        what = replace(what, person=PersonReference(ordinal=what.ordinal))  # "the second visitor and the third"
    leaves, comes = tells(words, language, "leaves"), tells(words, language, "comes")
    is_over = leaves or (relation == "after" and not comes)
    return None if what.person is None else Event(relation, what, leaves=is_over)


def places_of_event(found: Found) -> Set[int]:
    return found.deeds[0].places if found.deeds else set()


def are_doers(found: Found, places: Set[int], subjects: Subjects) -> bool:
    """Return whether people do what the words at these places name: ``Did t1 greet you?``."""
    is_robot_you = bool(subjects.persons) or len(subjects.agents) == 1
    if found.agents or found.asks_for:
        return False
    return is_done_by_people(found.reading, places, found.verb, is_robot_you=is_robot_you)


def subordinate(found: Found, subjects: Subjects) -> Question:
    """Return the question of a subordinate clause: its people and things, and the deed that it names surely."""
    named = [each for each in found.deeds if each.fit >= NAMED]
    deed = max(named, key=lambda each: each.evidence.get("thing", 0.0), default=None)  # the first one of the best
    agent = min(found.agents, key=lambda each: each[1], default=("", 0))[0]
    if deed is not None and agent and agent not in {each.source for each in subjects.done(deed.topic)}:
        agent = ""  # "after loading the box onto carrier b"
    things = dict(found.question.things) | {name: "" for name, _ in found.agents if name != agent}
    topics = () if deed is None else (deed.topic,)
    by_people = deed is not None and are_doers(found, deed.places, subjects)
    is_synonym = deed is not None and deed.is_synonym
    return replace(
        found.question, topics=topics, agent=agent, things=things, by_people=by_people, is_synonym=is_synonym
    )


def event_of(parts: Parts, found: Found, main: Question, subjects: Subjects) -> Event | None:
    what, words, language = subordinate(found, subjects), parts.event, found.reading.language
    if what.topics and what.person is None and found.reading.has("them"):
        what = replace(what, person=main.person)  # "How far away was t1 when you greeted them?"
    if not what.agent and what.person is None and main.agent and found.reading.has("them"):
        what = replace(what, agent=main.agent)  # "What did carrier c do after it unloaded?"
    if what.topics and not what.things and main.things and found.reading.has("them"):
        what = replace(what, things=dict.fromkeys(main.things, ""))  # "What did you do with box a2 after you took it?"
    leaves, comes = tells(words, language, "leaves"), tells(words, language, "comes")
    people = (*language.phrases["me"], *language.phrases["them"], *language.phrases["people"])
    begin = words[1:2] if words[0] in ARTICLES else words[:1]
    mine = language.voices.first.intersection(words)
    is_by_person = what.person is not None or begin in people or bool(mine)
    told = (word for n, word in enumerate(words) if n not in found.referred and word not in mine)
    heard = tuple(word for word in told if word not in language.known_words)
    is_heard = bool(heard) and all(subjects.is_heard(word) for word in heard)  # "when I thanked you"
    if (what.about_speech or is_heard) and is_by_person and (words[0],) not in language.phrases["you"]:
        return Event(parts.relation, what, leaves=False, heard=heard)
    if main.topics and not what.topics and (what.things or what.agent):
        # The same deed with another thing or of another agent: "before carrier b"
        names = {*what.things, *([what.agent] if what.agent else [])}
        done = (one for topic in main.topics for one in subjects.done(topic))
        if any(names <= {*arguments_of(one.what), one.source} for one in done):
            return Event(parts.relation, replace(what, topics=main.topics), leaves=False)
        return Event(parts.relation, what, leaves=False)
    leaves = leaves and (not comes or bool(_AWAY.intersection(words)))  # "walked off"
    if what.person is None and not what.agent and found.reading.has("people"):
        what = replace(what, about_all=True)  # "before anybody came"
    is_visit = (what.person is not None or what.about_all) and (leaves or comes)
    if not is_visit and main.topics and not what.topics and what.person is not None:
        return Event(parts.relation, replace(what, topics=main.topics), leaves=False)  # "before t1"
    if not is_visit and not main.topics and not what.topics and (what.things or what.agent):
        return Event(parts.relation, what, leaves=False)  # "after the bedroom"
    is_order = main.kind == "who" and parts.relation != "when" and what.person is not None
    if not is_visit and not what.topics:
        return Event(parts.relation, what, leaves=False) if is_order and not main.topics else None
    return Event(parts.relation, replace(what, topics=()) if is_visit else what, leaves)
