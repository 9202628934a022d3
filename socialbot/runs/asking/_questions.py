"""Questions: from words to the kind of question, the deed, the persons, the things and the time that it is about."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from typing import Literal

from socialbot.runs.asking._clauses import Parts, Relation, tells, without_contrast, without_event
from socialbot.runs.asking._kinds import Kind, kind_of
from socialbot.runs.asking._references import (
    PersonReference,
    Reading,
    digits_after_names,
    take_names,
    take_ordinal,
    take_person,
    take_span,
    take_time,
)
from socialbot.runs.asking._topics import Phrase, Subjects, Topic, arguments_of
from socialbot.runs.asking._words import ALIKE, HEARD, likeness, occurrences, similarity, sound, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, INTERROGATIVES, LANGUAGES, Language
from socialbot.runs.why import call_of

SURE = 0.68
"""Confidence below which a question counts as not understood."""

_ONLY_EXACT = {
    "unanswerable",
    "not",
    "past",
    "present",
    "future",
    "filler",
    "you",
    "me",
    "them",
    "seconds",
    "minutes",
    "at",
    "time",
    "last",
    "first",
    "all",
    "where",
    "how_far",
    "how_long",
    "longest",
    "shortest",
}
_MISHEARD = {"past", "present", "future"}
_STEM = 0.96
"""Least similarity of two forms of a word."""
_SOUNDS, _FORM = 0.79, 0.9
"""Least similarity of a misheard auxiliary verb, and that of another form of a verb, which has another tense."""
_EXACT = 0.999
_TAKES_NOTHING = {"past", "present", "future", "auxiliary"}
_PARTS = ("but", "rather", "event after", "event before", "event when", "comes", "leaves", "waits", "auxiliary")
"""Classes of words that only divide a question into clauses."""
_UNKNOWN_NEAR, _UNKNOWN_ASIDE, _UNKNOWN_FAR = 0.5, 0.25, 0.1
_ARTICLES = {"the", "a", "an", "my", "your", "its", "der", "die", "das", "dem", "den", "la", "le", "les", "el", "los"}
_AGENT_OF_PASSIVE = {"by", "from"}
_ADDRESSING = {"to", "zu", "a", "an", "for"}
_PREPOSITIONS = {"behind", "with", "during", "through", "auf", "mit", "dans", "sur", "avec", "con", "sobre"}
_NEAR = 3
_LONG = 5
"""Least length of a word that is heard as two."""
_WRITTEN_ALIKE = 0.84
_SOUNDS_LIKE, _GUESSED = 0.6, 0.8
_SOFT = (
    "see",
    "do",
    "say",
    "here",
    "plan",
    "happen",
    "next",
    "time",
    "filler",
    "not",
    "people",
    "nobody",
    "what",
    "at",
)


@dataclass(frozen=True)
class Question:
    """Question as it was understood.

    Args:
        kind: What is asked.
        language: Its language (ISO 639-1).
        confidence: From 0 to 1; below `SURE` it was not understood.
        topics: The deed it is about; other deeds with the same words follow.
        person: The person it is about.
        agent: The agent that acted; empty for any.
        things: Names in it, such as box_a1, with the word before each, such as "to".
        at_s: Time in it, in seconds from the start; ``ago`` tells that it counts back from now.
        span_s: Span of time in it; with a negative begin it ends at the time of the question.
        ordinal: Which time a deed was done: 1 for the first, -1 for the last.
        is_past: Whether it asks about the past.
        says: Words that were said, in a question about an utterance.
        is_opposite: Whether it names the opposite of the deed: ``ignore`` for not to greet.
        is_negative: Whether it has a negation.
        about_all: Whether it is about all people.
        extreme: Whether it asks for the longest or the shortest visit.
        about_left_out: Whether it asks for people for whom the deed was not done.
        about_speech: Whether it is about speaking in general.
        contrast: Question about those with whom the deed is contrasted: ``and not t2``.
        event: Question about the event that tells the time: ``after t2 had left``.
        unknown: Its words that nothing explains.
    """

    kind: Kind | None
    language: str
    confidence: float
    topics: tuple[Topic, ...] = ()
    person: PersonReference | None = None
    agent: str = ""
    things: Mapping[str, str] = field(default_factory=dict)
    at_s: float | None = None
    ago: bool = False
    span_s: tuple[float, float] | None = None
    ordinal: int | None = None
    is_past: bool = False
    says: tuple[str, ...] = ()
    is_opposite: bool = False
    is_negative: bool = False
    about_all: bool = False
    extreme: Literal["longest", "shortest", ""] = ""
    about_left_out: bool = False
    about_speech: bool = False
    contrast: Question | None = None
    event: Event | None = None
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True)
class Event:
    """Event that tells a time: a person comes or ``leaves``, or a deed of the robot.

    Args:
        relation: Whether the time is after it, before it, or that of the event.
        what: The people and the deed, as a question.
        leaves: Whether the person leaves.
    """

    relation: Relation
    what: Question
    leaves: bool


def understand(text: str, subjects: Subjects, language: str = "") -> Question:
    """Return ``text`` as a question.

    Args:
        text: What a person wrote or said.
        subjects: What the run can be asked about.
        language: Language of the text (ISO 639-1), if it is known; else that which explains it best.
    """
    words = tokens(text)
    if not words:
        return Question(None, language if language in LANGUAGES else ENGLISH.code, 0.0)
    candidates = [language] if language in LANGUAGES else list(LANGUAGES)
    read = [_read(_joined(words, subjects, LANGUAGES[code]), subjects, LANGUAGES[code]) for code in candidates]
    exact = {question.language: _exact(words, LANGUAGES[question.language]) for question in read}
    # A question in one language may contain names and phrases of another.
    own = [question for question in read if exact[question.language] >= max(exact.values()) - 1]
    best = max(own, key=lambda question: (question.confidence, exact[question.language]))
    return best if best.confidence >= SURE else max(read, key=lambda question: exact[question.language])


def _joined(words: Sequence[str], subjects: Subjects, language: Language) -> list[str]:
    """Join pairs of words that are one known word: a recogniser may hear ``of ten`` for ``often``."""
    known = {word for alternatives in language.phrases.values() for phrase in alternatives for word in phrase}
    known |= _domain(subjects, language.code)
    result: list[str] = []
    for word in words:
        is_whole = bool(result) and result[-1] in known and word in known
        if result and not is_whole and len(result[-1]) + len(word) >= _LONG and result[-1] + word in known:
            result[-1] += word
        else:
            result.append(word)
    return result


def _exact(words: Sequence[str], language: Language) -> int:
    """Return how many words a language knows as they are."""
    known = {word for alternatives in language.phrases.values() for phrase in alternatives for word in phrase}
    return sum(word in known for word in words)


def _read(words: Sequence[str], subjects: Subjects, language: Language) -> Question:
    """Read a question with its contrast and its event; words that only look like one belong to the main clause."""
    contrast = None
    split = without_contrast(words, language)
    if split is not None:
        contrast = _read_clause(split.contrast, subjects, language)
        if contrast.person is None and contrast.ordinal is not None and subjects.persons:
            contrast = replace(contrast, person=PersonReference(ordinal=contrast.ordinal))  # "and the second not"
        if contrast.person is not None or contrast.things or not split.is_denied:
            words = split.main
        else:
            contrast = None
    split = without_event(words, language)
    main = None if split is None else _read_clause(split.main, subjects, language)
    if split is not None and main is not None and main.kind is not None:
        event = _event(split, main, subjects, language)
        if event is not None:
            return _with_event(replace(main, contrast=contrast), event, split.main, language)
    return replace(_read_clause(words, subjects, language), contrast=contrast)


def _event(parts: Parts, main: Question, subjects: Subjects, language: Language) -> Event | None:
    what = _read_clause(parts.event, subjects, language)
    leaves, comes = tells(parts.event, language, "leaves"), tells(parts.event, language, "comes")
    if main.topics and not what.topics and (what.things or what.agent):
        # The same deed with another thing or of another agent: "before carrier b"
        things = {name: before for name, before in what.things.items() if name not in subjects.agents}
        agent = what.agent or next((name for name in what.things if name in subjects.agents), "")
        return Event(parts.relation, replace(what, topics=main.topics, things=things, agent=agent), leaves=False)
    if what.says:
        return Event(parts.relation, what, leaves=False)
    is_visit = (what.person is not None or what.about_all) and (leaves or comes)
    if not is_visit and main.topics and not what.topics and what.person is not None:
        return Event(parts.relation, replace(what, topics=main.topics), leaves=False)  # "before t1"
    if not is_visit and (not what.topics or what.confidence < SURE):
        return None
    if is_visit and what.topics:
        what = replace(what, topics=())
    return Event(parts.relation, what, leaves and not comes)


def _with_event(question: Question, event: Event, words: Sequence[str], language: Language) -> Question:
    """Return a question whose time is told by an event; how long the robot waited with a deed is about that deed."""
    if question.kind in ("why", "why_not") and not question.topics and event.what.topics and event.relation == "when":
        # "What were you thinking when you greeted t1?"
        return replace(question, topics=event.what.topics, person=event.what.person, confidence=event.what.confidence)
    waited = event.relation == "before" and event.what.topics and tells(words, language, "waits")
    if not waited or (question.topics and question.kind not in ("why", "how_long", "count")):
        return replace(question, event=event)
    kind = "why" if question.kind in ("why", "why_not") else "how_long"
    what = event.what
    return replace(
        question, kind=kind, topics=what.topics, person=what.person, at_s=None, confidence=what.confidence, unknown=()
    )


def _read_clause(words: Sequence[str], subjects: Subjects, language: Language) -> Question:
    reading = Reading(language, digits_after_names(list(words), subjects))
    span_s = take_span(reading)
    at_s, ago, person = take_time(reading) if span_s is None else (None, False, None)
    things, agents = take_names(reading, subjects)
    person = take_person(reading, subjects) or person
    referred = frozenset(reading.taken)
    _classify(reading, _domain(subjects, language.code))
    if person is None and reading.has("me"):
        person = PersonReference(me=True)
    ordinal = take_ordinal(reading, referred) if span_s is None else None
    topics, fit, is_opposite = _topics(reading, subjects)
    topic = next(iter(topics), None)
    if topic is not None and reading.has("say") and reading.has("what") and (thing := _addressee(reading, topic)):
        things, topics, topic, fit = {**things, thing: "to"}, (), None, 1.0
    if topic is not None:
        deed = set(reading.found["topic"][0][1])
        reading.found["not"] = [each for each in reading.found.get("not", ()) if not deed.issuperset(each[1])]
    _guess_interrogative(reading, topic is not None)
    agent = _acting(reading, agents, topic is not None)
    things |= {name: words[place - 1] if place else "" for name, place in agents if name not in (agent, *things)}
    kind, sure = kind_of(reading, topic is not None, at_s is not None, span_s is not None)
    if topic is not None and (_is_for_robot(reading) or (reading.has("where") and not subjects.done(topic))):
        kind = None
    if kind in ("why", "why_not") and is_opposite:
        kind = "why_not" if kind == "why" else "why"
    says: tuple[str, ...] = ()
    if kind in ("why", "when", "did", "count") and reading.has("say"):
        says = _words_said(reading, referred, subjects, topic)
        if says:
            topics, topic, fit = (), None, 1.0
            person = None if person is not None and person.me else person  # "can I help you"
        elif topic is None and kind in ("when", "did"):
            kind = "said"
    if person is not None and person.at_s is not None and (kind == "said" or reading.has("how_far")):
        at_s = person.at_s
    unknown = tuple(reading.words[place] for place in reading.free())
    confidence = min(sure, fit) * _coverage(reading, topic, subjects.known_words | _domain(subjects, language.code))
    return Question(
        kind, language.code, round(confidence, 3), topics, person, agent, things, at_s, ago, span_s, ordinal,
        is_past=reading.has("past") and not reading.has("future"), says=says, is_opposite=is_opposite,
        is_negative=reading.has("not", "nobody"), about_all=reading.has("all"), extreme=_extreme(reading),
        about_left_out=_is_about_left_out(reading), about_speech=reading.has("say"),
        unknown=unknown,
    )  # fmt: skip


def _extreme(reading: Reading) -> Literal["longest", "shortest", ""]:
    return "longest" if reading.has("longest") else "shortest" if reading.has("shortest") else ""


def _is_about_left_out(reading: Reading) -> bool:
    """Return whether a negation is about people in front of it: ``was there anybody you did not greet``."""
    people = [places[0] for _, places in reading.found.get("people", ())]
    denied = [places[0] for _, places in reading.found.get("not", ())]
    return any(one < place for one in people for place in denied)


def _is_for_robot(reading: Reading) -> bool:
    """Return whether a person does the deed to the robot: ``did t1 greet you``, ``hat t1 dich begrüßt``."""
    verb = reading.found["topic"][0][1][0]
    persons = [places[0] for name in ("named", "people") for _, places in reading.found.get(name, ())]
    robot = [places[0] for _, places in reading.found.get("you", ())]
    if reading.language.code == "de":
        objects = [place for place in robot if reading.words[place] in ("dich", "dir")]
        return bool(objects) and objects == robot and any(place < objects[0] for place in persons)
    if reading.language.code != "en" or not any(place < verb for place in persons):
        return False
    return bool(robot) and min(robot) > verb and reading.words[min(robot) - 1] not in _AGENT_OF_PASSIVE


def _addressee(reading: Reading, topic: Topic) -> str:
    """Return the name in a deed if the words name nothing else of it: ``to Ann`` is no question about check("Ann")."""
    places = reading.found["topic"][0][1]
    names = {tokens(one)[0]: one for call in topic.calls for one in arguments_of(call) if len(tokens(one)) == 1}
    word = reading.words[places[0]]
    before = reading.words[places[0] - 1] if places[0] else ""
    return names.get(word, "") if len(places) == 1 and before in {*_ADDRESSING, "tell"} else ""


def _words_said(reading: Reading, referred: Set[int], subjects: Subjects, topic: Topic | None) -> tuple[str, ...]:
    """Take the words of an utterance, behind the verb: up to a person or a time; none if they only ask for words."""
    last = max(place for _, places in reading.found["say"] for place in places)
    end = next((place for place in range(last + 1, len(reading.words)) if place in referred), len(reading.words))
    others = {one[0] for name in ("people", "nobody", "all") for one in reading.language.phrases[name]}
    if end == len(reading.words) and reading.words[-2] in _ADDRESSING and reading.words[-1] in others:
        end -= 1  # "thank you to anybody"
    while end < len(reading.words) and end > last + 1 and reading.words[end - 1] in _ADDRESSING:
        end -= 1
    begin = last + 1
    if begin == len(reading.words) and reading.has("you"):  # the verb is the last word, as in German
        begin, end = max(place for _, places in reading.found["you"] for place in places) + 1, last
    said = tuple(reading.words[begin:end])
    is_quoted = subjects.is_quoted(said)
    if not said or (topic is not None and (topic.declared is not None or not is_quoted)):
        return ()
    if not is_quoted and reading.taken.issuperset(range(begin, end)):
        return ()
    reading.taken.update(range(begin, end))
    return said


# Words by class


def _acting(reading: Reading, agents: Sequence[tuple[str, int]], has_topic: bool) -> str:
    """Return the agent that is asked about: the one before the verb, unless the robot is addressed as ``you``."""
    if not agents:
        return ""
    name, place = min(agents, key=lambda each: each[1])
    keys = ("topic",) if has_topic else ("see", "do", "plan", "say", "happen")
    verbs = [at for key in keys for _, places in reading.found.get(key, ()) for at in places[:1]]
    if reading.has("you") and has_topic and verbs and place > min(verbs):
        return ""
    return name if not verbs or place < min(verbs) or reading.language.code == "de" or not has_topic else ""


# Classes of words


def _is_alike(alike: float) -> bool:
    """Return whether a word that is no form of a known one is written much like it, or sounds like it."""
    return alike >= _WRITTEN_ALIKE or alike == HEARD


def _domain(subjects: Subjects, language: str) -> set[str]:
    """Return the words of the deeds of the agents in a language."""
    phrases = (one for topic in subjects.topics for one in (*topic.words.get(language, ()), *topic.loose))
    return {word for phrase in phrases for word in phrase}


def _classify(reading: Reading, domain: Set[str]) -> None:
    """Find the classes of the words; longer phrases and better matches first.

    A word that only resembles one of a class is none of it if it is a form of a word of the ``domain``.
    """
    stems = {stem(word) for word in domain}
    deeds = {place for place, word in enumerate(reading.words) if stem(word) in stems}
    matches: list[tuple[float, int, str, tuple[int, ...]]] = []
    for name, alternatives in reading.language.phrases.items():
        for phrase in alternatives if name not in _PARTS else ():
            between = 1 if len(phrase) > 1 and name in ("why", "how_often", "see", "plan") else 0
            for alike, places in occurrences(phrase, reading.words, between):
                if (
                    alike > _EXACT
                    or (name in _MISHEARD and _SOUNDS < alike < _FORM)
                    or (name not in _ONLY_EXACT and len(next(iter(phrase))) > 2 and _is_alike(alike))
                ):
                    matches.append((alike, len(phrase), name, places))
    exact = {place for alike, _, _, places in matches if alike > _EXACT for place in places}
    matches = [each for each in matches if each[0] > _EXACT or not exact.intersection(each[3]) or each[1] > 1]
    matches.sort(key=lambda each: (each[0] < _EXACT, -each[1], -each[0]))
    claimed: dict[int, str] = {}
    for alike, _, name, places in matches:
        others = {claimed[place] for place in places if place in claimed}
        if any(claimed.get(place) == "polite" for place in places) or (alike < _STEM and deeds & set(places)):
            continue
        soft = name in _TAKES_NOTHING or name in (
            "filler",
            "next",
            "plan",
            "me",
            "you",
            "people",
            "last",
            "first",
            "all",
        )
        is_part = len(places) == 1 and places[0] in reading.taken and len(reading.words[places[0]]) == 1  # t, of t2
        if is_part or (reading.taken & set(places) and alike < _EXACT) or (alike < _EXACT and others):
            continue
        if (
            others
            and not soft
            and any(each in INTERROGATIVES or each == name for each in others)
            and name in INTERROGATIVES
        ):
            continue
        reading.found.setdefault(name, []).append((alike, places))
        if name not in _TAKES_NOTHING or name == "filler":
            claimed.update(dict.fromkeys(places, "polite" if name == "filler" and len(places) > 1 else name))
    for name, places in ((name, places) for name, found in reading.found.items() for _, places in found):
        if name != "named" and not name.startswith("person "):
            reading.taken |= set(places)


def _guess_interrogative(reading: Reading, has_topic: bool) -> None:
    """Take an unknown first word for the interrogative that it sounds like, as in ``wide did you ...``."""
    free = [place for place in reading.free() if place < 2]
    if reading.has(*INTERROGATIVES) or not free or not reading.has("you"):
        return
    heard = sound(reading.words[free[0]])
    names = ("why", "when", "who") if has_topic else ("what", "who")
    known = [(one[0], name) for name in names for one in reading.language.phrases[name] if len(one) == 1]
    alike, name = max((SequenceMatcher(None, heard, sound(word)).ratio(), name) for word, name in known)
    if alike >= _SOUNDS_LIKE:
        reading.found[name] = [(_GUESSED, (free[0],))]
        reading.taken.add(free[0])


# Deeds


_SAME = 0.06
"""Difference of fit within which several deeds have the same words."""


def _topics(reading: Reading, subjects: Subjects) -> tuple[tuple[Topic, ...], float, bool]:
    """Return the deeds that the words name, how well the first one fits, and whether they name its opposite."""
    code, words = reading.language.code, reading.words
    free = set(reading.free())
    # Verbs of every agent may be parts of a deed: "do nothing", "say hello", "come to base".
    soft = {place for name in _SOFT for _, places in reading.found.get(name, ()) for place in places}
    found: list[tuple[float, int, Topic, tuple[int, ...], bool]] = []
    for topic in subjects.topics:
        fits = [
            (alike, len(places), topic, places, opposite)
            for opposite, table in ((False, topic.words), (True, topic.opposites))
            for phrase in table.get(code, ())
            for alike, places in [likeness(phrase, words, 4)]
            if places and (set(places) & free or len(places) > 1) and _is_whole(phrase, places, words, free, soft)
        ]
        for phrase in topic.loose:
            fit, places = _loosely(phrase, words, free, soft)
            if places:
                fits.append((fit, len(places), topic, places, False))
        if fits:
            # "Skip greeting" is the opposite, too.
            best = max(fits, key=lambda each: each[:2])
            found.append((*best[:4], any(opposite and alike >= ALIKE for alike, _, _, _, opposite in fits)))
    if not found:
        return (), 1.0, False
    # Deeds that were done come first among those of the same fit.
    found.sort(key=lambda each: (-each[0], -each[1]))
    near = [each for each in found if each[0] >= found[0][0] - _SAME]
    near.sort(key=lambda each: (not subjects.done(each[2]), -each[0], -each[1]))
    fit, _, _, places, opposite = near[0]
    if fit < ALIKE - 0.04:
        return (), 1.0, False
    reading.found["topic"] = [(fit, places)]
    reading.taken |= set(places)
    named = {word for phrase in (*near[0][2].words.get(code, ()), *near[0][2].loose) for word in phrase}
    reading.taken |= {at for at in free if any(similarity(words[at], word) >= ALIKE for word in named)}
    return tuple(each[2] for each in near), min(1.0, fit), opposite


def _is_whole(phrase: Phrase, places: Sequence[int], words: Sequence[str], free: set[int], soft: set[int]) -> bool:
    """Return whether no word of a phrase has another role; words that only resemble theirs must have none."""
    return all(
        place in free or (place in soft and len(phrase) > 1 and similarity(words[place], wanted) > 0.95)
        for place, wanted in zip(places, phrase, strict=True)
    )


def _loosely(phrase: Phrase, words: Sequence[str], free: set[int], soft: set[int]) -> tuple[float, tuple[int, ...]]:
    """Return how well words name a deed by its phrase, whose first word counts most, and their places."""
    found: list[int] = []
    total = 0.0
    for n, wanted in enumerate(phrase):
        share = 1.0 if len(phrase) == 1 else 0.78 if n == 0 else 0.22 / (len(phrase) - 1)
        places = [at for at in free | soft if similarity(words[at], wanted) >= (ALIKE if at in free else 0.95)]
        place = max(places, key=lambda at: (similarity(words[at], wanted), -at), default=None)
        if place is not None:
            total += share * similarity(words[place], wanted)
            found.append(place)
        elif n == 0:
            return 0.0, ()
    return (total, tuple(found)) if set(found) & free else (0.0, ())


def _coverage(reading: Reading, topic: Topic | None, known: Set[str]) -> float:
    """Return how much of the question is explained.

    An unknown object of the deed counts most; less count words behind a preposition, adverbs, and words far away.
    """
    places: tuple[int, ...] = reading.found["topic"][0][1] if topic is not None else ()
    aside = {one[0] for name in ("at", "here") for one in reading.language.phrases[name]} | _PREPOSITIONS
    stems = {stem(word) for word in known}
    penalty = 0.0
    for place in reading.free():
        word = reading.words[place]
        if stem(word) in stems:
            continue
        before = [each for each in reading.words[max(0, place - 2) : place] if each not in _ARTICLES]
        is_aside = bool(before) and before[-1] in aside and reading.words[place - 1] != "to"
        near = not places or any(abs(place - at) <= _NEAR for at in places)
        far = word.endswith("ly") or len(word) < 3 or not near
        penalty += _UNKNOWN_FAR if far else _UNKNOWN_ASIDE if is_aside else _UNKNOWN_NEAR
    return 1.0 / (1.0 + penalty)


def with_time(question: Question, now_s: float) -> Question:
    """Return a question with a time that counts back as a time of the run."""
    if question.span_s is not None and question.span_s[0] < 0.0:
        question = replace(question, span_s=(max(0.0, now_s + question.span_s[0]), now_s))
    if not question.ago or question.at_s is None:
        return question
    return replace(question, at_s=max(0.0, now_s - question.at_s), ago=False)


def examples(subjects: Subjects, language: Language, at_s: float) -> tuple[str, ...]:
    """Return questions that this run can answer."""
    done = [topic for topic in subjects.topics if subjects.done(topic)]
    declared = (" ".join(topic.words[language.code][0]) for topic in done if language.code in topic.words)
    named = (_infinitive(topic, subjects) for topic in done if topic.loose and language.code == "en")
    deed = next(declared, None) or next(named, None)
    texts = language.sentences["examples"].split(" | ")
    return tuple(text.format(deed=deed, at=f"{at_s:.0f}") for text in texts if deed or "{deed}" not in text)


def _infinitive(topic: Topic, subjects: Subjects) -> str:
    return infinitive(subjects.wording.call(topic.name, arguments_of(call_of(subjects.done(topic)[0]))))


def infinitive(sentence: str) -> str:
    """Put a sentence without subject, such as ``goes to room1``, into the infinitive."""
    verb, space, rest = sentence.partition(" ")
    if verb.endswith("ies"):
        verb = f"{verb[:-3]}y"
    elif verb in ("has", "is", "does", "goes"):
        verb = {"has": "have", "is": "be", "does": "do", "goes": "go"}[verb]
    elif re.search(r"(ss|sh|ch|x)es$", verb):
        verb = verb[:-2]
    elif verb.endswith("s") and not verb.endswith("ss"):
        verb = verb[:-1]
    return f"{verb}{space}{rest}"
