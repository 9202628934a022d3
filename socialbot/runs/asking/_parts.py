"""Parts of a clause of a question: its words by class, names, people, times, deeds, and the events of clauses."""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from typing import Literal

from socialbot.core.clock import nanoseconds
from socialbot.runs.asking._clauses import Parts, Relation, without_matrix
from socialbot.runs.asking._doer import clause_verb, is_done_by_people
from socialbot.runs.asking._named_deeds import NamedDeed, meanings_of, named_deeds
from socialbot.runs.asking._question import Event, Question
from socialbot.runs.asking._references import (
    PersonReference,
    Reading,
    digits_after_names,
    take_limit,
    take_names,
    take_ordinal,
    take_person,
    take_quantity,
    take_span,
    take_time,
)
from socialbot.runs.asking._sentences import kind_of_name
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._word_classes import (
    COMPARED,
    EXTREMES,
    classify,
    guess_interrogative,
    places_of_class,
    tells,
    tells_exactly,
    words_of_deeds,
)
from socialbot.runs.asking._words import FORM, NUMBER_WORDS, corrected, occurrences, starts, stem, tokens
from socialbot.runs.asking.languages import INTERROGATIVES, LANGUAGES, Language, lexicon

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


VERBS = (
    *INTERROGATIVES, "see", "say", "do", "happen", "next", "plan", "here", "not", "longest", "silent", "waits",
)  # fmt: skip
"""Classes of words that say what somebody does."""
_CONJUNCTIONS = {"that", "if", "whether"}
CAPITAL = re.compile(r"([^\W\d_]+) (?=([A-Z\u00c0-\u00de]\w+))")
"""Word before one with a capital letter; one behind a comma may address the robot."""
GREETINGS = {"hey", "hi", "hello", "hallo", "bonjour", "salut", "hola"}
"""Words of greeting."""
_BEFORE_ROBOT = GREETINGS | {"dear", "ok", "okay", "lieber", "cher"}
"""Words before the name of the robot."""
_BEFORE_GERMAN_NOUN = re.compile(
    r"[a-z\u00e4\u00f6\u00fc]+e[nmrs]?|d[ae]s|a[mn]|auf|aus|beim|durch|i[mns]+|mit|nach|um|vo[mnr]|zu[mr]|k?ein"
)
"""Lower-case word that a German noun may follow, beside its name."""
_SHORT_NAME = 5
"""Length from which on a word with a capital letter may be an inflected one."""
NAMED = 0.85
"""Least fit of a deed in a subordinate clause."""
_PASSING = {"in", "by", "past", "off", "away", "out", "along", "through"}
"""Particles of verbs of coming and leaving: ``stroll in``."""
INDEFINITE = {"anybody", "anyone", "somebody", "someone", "jemand", "jemanden", "quelqu", "alguien"}
_LONG_PHRASE, _ASKING = 3, 3
"""Least words of a phrase, and least letters of a word of a short one, that is expected in a question."""
_MOST_BETWEEN = 2
"""Most words between the parts of a verb: ``leave anyone out``."""
_BECOMING = {"go", "fall", "turn", "grow", "return", "switch"}
"""Verbs before a state: ``go idle``."""
_BACK_TO = {"back", "to", "into", "being"}
"""Words between such a verb and a state."""
_STILL_TO_DO = {
    "have", "has", "left", "done", "hast", "habe", "hat", "haben", "as", "avez", "a", "ai", "ont", "he", "ha", "han"
}  # fmt: skip
"""Words of the past that also ask for intentions: ``Do you have anything left that you want done?``"""
_BEFORE_DEPARTURE = {"to", "who", "that", "der", "die", "zu", "qui", "a", "que", "en"}
"""Words between a person and the verb of leaving that describes them: ``the first person to leave``."""
_LEXICON_WORD = 7
"""Least length of a mistyped word that is spelled as the lexicon has it: shorter ones resemble too many."""
_LONG = 5
"""Least length of a word that is heard as two."""


@dataclass(frozen=True)
class Found:
    """Parts of a clause: its classified words, the question without kind and deed, agents with their places, deeds.

    ``referred`` are the places of names, people and times, and ``verb`` is that of the main verb, if it is known.
    ``asks_for`` tells that a person is asked for by the order of the deeds: ``Who was the last person you greeted?``.
    """

    reading: Reading
    question: Question
    agents: Sequence[tuple[str, int]]
    deeds: Sequence[NamedDeed]
    referred: Set[int]
    verb: int | None
    asks_for: bool = False


def names_in(text: str, languages: Sequence[str], subjects: Subjects) -> set[str]:
    """Return words with a capital letter inside a sentence that nothing has: names, beside nouns in German."""
    found = [(before, word) for before, name in CAPITAL.findall(text) for word in tokens(name)]
    found = [(before, word) for before, word in found if before.lower() not in _BEFORE_ROBOT]
    if not found or 2 * len(found) >= len(text.split()):
        return set()  # a title has many
    if "de" in languages:
        found = [(before, word) for before, word in found if not _BEFORE_GERMAN_NOUN.fullmatch(before)]
    known = {word for code in languages for word in (*LANGUAGES[code].known_words, *lexicon.words(code))}
    return {
        word
        for word in {word for _, word in found} - known
        if subjects.recorded_words.isdisjoint((word, word.removesuffix("s")))
        and (len(word) < _SHORT_NAME or word[:-1] not in known)
        and not any(subjects.begins_agent(word, LANGUAGES[code]) for code in languages)
    }


def known_words(subjects: Subjects, language: Language) -> Set[str]:
    """Return the words of a language, and those of the deeds and names in it."""
    return language.known_words | words_of_deeds(subjects, language.code) | subjects.words_of_names(language.code)


def prepared(words: Sequence[str], names: Set[str], subjects: Subjects, language: Language) -> list[str]:
    """Return the words of the question itself, spelled as the language and the deeds have them, but for ``names``."""
    known = frozenset(known_words(subjects, language) | NUMBER_WORDS)
    alternatives = (one for name in INTERROGATIVES for one in language.phrases[name])
    asking = {word for one in alternatives if len(one) < _LONG_PHRASE for word in one if len(word) >= _ASKING}
    asking -= language.auxiliaries
    meant = lexicon.words(language.code)
    spelled = [corrected(word, known, subjects.names | meant | names, asking) for word in words]
    spelled = [
        corrected(word, meant, subjects.names | names) if word not in known and len(word) >= _LEXICON_WORD else word
        for word in spelled
    ]
    spelled = subjects.without_kind(subjects.named_in(language.code, spelled), language)
    return without_matrix(_joined(_without_called(spelled, subjects, language), known), language)


def _without_called(words: Sequence[str], subjects: Subjects, language: Language) -> list[str]:
    """Return words with only the name of ``a person called Ann``."""
    names, people = subjects.names | subjects.argument_names.keys(), language.phrases["people"]
    for phrase in language.phrases["called"]:
        for n in starts(phrase, words):
            end = n + len(phrase)
            if n > 0 and end < len(words) and (words[n - 1],) in people and words[end] in names:
                begin = n - 2 if n > 1 and (words[n - 2],) in language.phrases["article"] else n - 1
                return [*words[:begin], *words[end:]]
    return list(words)


def _joined(words: Sequence[str], known: Set[str]) -> list[str]:
    """Join pairs of words that are one known word: a recogniser may hear ``of ten`` for ``often``."""
    result: list[str] = []
    for word in words:
        is_whole = bool(result) and result[-1] in known and word in known
        if result and not is_whole and len(result[-1]) + len(word) >= _LONG and result[-1] + word in known:
            result[-1] += word
        else:
            result.append(word)
    return result


def parts_of(words: Sequence[str], subjects: Subjects, language: Language) -> Found:
    """Return the parts of a clause."""
    reading = Reading(language, digits_after_names(list(words), subjects, language))
    limit = take_limit(reading)
    span_s = take_span(reading) if limit is None else None
    has_time = span_s is None and limit is None
    at_s, ago, person = take_time(reading, subjects) if has_time else (None, False, None)
    things, agents = take_names(reading, subjects)
    named = take_person(reading, subjects)
    if named is not None and person is not None:
        at_s = person.at_s  # "the second visitor at 24 s"
    person = named or person
    referred = frozenset(reading.taken)
    classify(reading, words_of_deeds(subjects, language.code))
    if not subjects.persons and not subjects.argument_names.keys() & {*reading.words}:
        _release_deeds(reading, subjects)  # "Did Ann come?" is about a visit
    for name in ("silent", "waits", "talk"):
        places = places_of_class(reading.words, language, name) - referred
        if places:
            reading.found[name] = [(1.0, tuple(sorted(places)))]
            reading.taken |= places if name == "silent" else set()
    if person is None and reading.has("me"):
        person = PersonReference(me=True)
    is_left_out = person is None and _take_left_out(reading)
    quantity = take_quantity(reading, is_named=person is not None)
    ordinal = take_ordinal(reading, referred) if span_s is None else None
    names = [*things, *(name for name, _ in agents)]
    at = None if at_s is None or ago else subjects.history.start + nanoseconds(at_s)
    deeds = named_deeds(reading, subjects, names, at)
    guess_interrogative(reading, bool(deeds), {place for each in deeds if each.fit >= NAMED for place in each.places})
    verb = clause_verb(reading, referred)
    explained = {place for name in VERBS for place in reading.places(name)} | {n for each in deeds for n in each.places}
    # "Would you say ...?", "Which carrier did it end up on?"
    light = {n for _, places in reading.found.get("filler", ()) if len(places) > 1 for n in places}
    explained |= light
    # "Why did you go idle?", "go back to doing nothing"
    if verb is not None and stem(reading.words[verb]) in _BECOMING:
        begin = verb + 1
        while reading.words[begin : begin + 1] and reading.words[begin] in _BACK_TO:
            begin += 1
        became = set(range(verb, begin))
        if any(became.isdisjoint(each.places) and begin in each.places for each in deeds):
            light |= became
    verb = None if verb is not None and (reading.words[verb] in _CONJUNCTIONS or verb in light) else verb
    asks_for = person is not None and bool(deeds) and _is_asked_for(reading, person, referred)
    if person is not None and asks_for:
        person, ordinal = None, person.ordinal
    people = {n for name in ("named", "people", "them", "me") for n in reading.places(name)} | referred
    if verb is not None and verb - 1 in people and person is not None and _PASSING.intersection(
        reading.words[verb + 1 : verb + 2]
    ):  # fmt: skip
        reading.take("here", verb, verb + 1)  # "When did t1 stroll in?"
        explained |= {verb}
    for place in reading.free():
        name = subjects.argument_names.get(reading.words[place])
        if name is not None:  # "Why did you let Ann in?" is about Ann, even if the name belongs to another deed.
            things[name] = reading.words[place - 1] if place else ""
            reading.take("thing", place)
    kinds = {stem(kind) for kind in subjects.kinds if len(kind) > 1}
    for place in reading.free():  # "Did you drop a box?" says what kind of thing it is.
        if stem(reading.words[place]) in kinds and not "".join(reading.words[place + 1 : place + 2]).isdigit():
            reading.take("kind", place)
    leaves = tells(reading.words, language, "leaves") and not tells(reading.words, language, "comes")
    if person is not None and person.ordinal is not None and leaves and _is_by_departure(reading, person.ordinal):
        person = replace(person, leaves=True)
    stems = [stem(word) for word in words]
    question = Question(
        None, language.code, (), person, "", "", things, at_s, ago, reading.is_later, span_s, ordinal,
        is_past=_is_past(reading), quantity=quantity,
        is_open=any(tells_exactly(words, language, name) for name in ("or", "qualified")),
        is_negative=reading.has("not", "nobody", "silent"), about_all=reading.has("all"),
        extreme=_extreme(reading, person), is_compared=not reading.has("who", "what"),
        limit=limit, is_shared=reading.has("same time"),
        leaves=leaves,
        about_left_out=is_left_out or _is_about_left_out(reading), about_speech=reading.has("say", "silent"),
        asks=any((reading.words[place],) in language.phrases["asks"] for place in reading.places("say")),
        unknown=tuple(reading.words[place] for place in reading.free()),
        verb="" if verb is None or verb in explained else reading.words[verb],
        thing_kind=_thing_kind(reading, subjects),
        plan=next((plan for name, plan in subjects.plan_names.items() if starts(name, stems)), ""),
    )  # fmt: skip
    return Found(reading, question, agents, deeds, referred, verb, asks_for)


def _extreme(
    reading: Reading, person: PersonReference | None
) -> Literal["longest", "shortest", "nearest", "farthest", ""]:
    """Return which visit is asked for; words that compare need several people: ``Who stayed longer, t3 or t5?``."""
    if person is not None and len(person.names) > 1:
        for name, extreme in COMPARED.items():
            places = places_of_class(reading.words, reading.language, name) - {*reading.places("limit")}
            if places:
                reading.take(extreme, *places)
    return next((name for name in EXTREMES if reading.has(name)), "")  # type: ignore[return-value]


def _is_past(reading: Reading) -> bool:
    words = {reading.words[place] for place in reading.places("past")}
    return bool(words - _STILL_TO_DO if reading.has("plan") else words) and not reading.has("future")


def _is_asked_for(reading: Reading, person: PersonReference, referred: Set[int]) -> bool:
    """Return whether a question begins by asking who the first, second or last person was."""
    if person.ordinal is None or not referred:
        return False
    phrases, before = reading.language.phrases, reading.words[: min(referred)]
    asking = reading.language.single_words("who", "what", "which")
    others = {word for name in ("being", "article") for phrase in phrases[name] for word in phrase}
    return not asking.isdisjoint(before) and (asking | others).issuperset(before)


def _is_by_departure(reading: Reading, ordinal: int) -> bool:
    """Return whether people are counted as they leave: ``the last visitor left``, ``the first person to leave``."""
    leaving, words = reading.language.single_words("leaves"), reading.words
    return ordinal < 0 or any(words[n] in leaving and words[n - 1] in _BEFORE_DEPARTURE for n in range(1, len(words)))


def _release_deeds(reading: Reading, subjects: Subjects) -> None:
    """Take words of visits as deeds that agents declare: in a run without people only agents come and leave."""
    phrases = (one for topic in subjects.topics for one in topic.words.get(reading.language.code, ()))
    declared = {stem(phrase[0]) for phrase in phrases if len(phrase) == 1} - set(
        map(stem, reading.language.auxiliaries)
    )
    code, meant = reading.language.code, meanings_of(subjects)
    here = reading.found.get("here", ())
    kept = [each for each in here if not any(
        stem(reading.words[n]) in declared or not meant.isdisjoint(lexicon.meanings((reading.words[n],), code))
        for n in each[1])]  # fmt: skip
    reading.taken -= set(reading.places("here")) - {n for _, places in kept for n in places}
    reading.found["here"] = kept


def _thing_kind(reading: Reading, subjects: Subjects) -> str:
    """Return the kind of things of ``which box``; empty for agents and other words."""
    words, asking = reading.words, reading.language.single_words("which", "what")
    asked = next((stem(words[n + 1]) for n in range(len(words) - 1) if words[n] in asking), "")
    agents = {kind_of_name(agent) for agent in subjects.agents}
    return next((kind for kind in sorted(subjects.kinds - agents) if stem(kind) == asked), "")


def _take_left_out(reading: Reading) -> bool:
    """Take words for people for whom nothing was done: ``Who got nothing?``. Return whether there are any."""
    places = {
        place
        for phrase in reading.language.phrases["left out"]
        for alike, places in occurrences(phrase, reading.words, _MOST_BETWEEN)
        if alike >= FORM
        for place in places
    }
    others = reading.has("why", "say", "see", "happen", "fail")
    if not places or others or not reading.has("who", "people"):
        return False
    reading.take("not", *sorted(places))
    return True


def _is_about_left_out(reading: Reading) -> bool:
    """Return whether a negation is about people in front of it: ``was there anybody you did not greet``."""
    people = reading.places("people")
    denied = [places for _, places in reading.found.get("not", ())]
    if any(one < places[0] for one in people for places in denied):
        return True
    # "Did you forget to greet anyone?"
    return any(
        places[0] < one and len(places) > 1 and reading.words[one] in INDEFINITE for one in people for places in denied
    )
