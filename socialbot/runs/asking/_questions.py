"""Questions: from words to the kind of question, the deed, the persons, the things and the time that it is about."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from typing import Literal

from socialbot.runs.asking._languages import ENGLISH, INTERROGATIVES, LANGUAGES, Language
from socialbot.runs.asking._references import (
    PersonReference,
    Reading,
    digits_after_names,
    take_names,
    take_ordinal,
    take_person,
    take_time,
)
from socialbot.runs.asking._topics import Phrase, Subjects, Topic, arguments_of
from socialbot.runs.asking._words import ALIKE, HEARD, likeness, occurrences, similarity, sound, stem, tokens
from socialbot.runs.why import call_of

Kind = Literal["why", "why_not", "see", "next", "doing", "said", "who", "when", "count", "did"]

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
}
_MISHEARD = {"past", "present", "future"}
_STEM = 0.96
"""Least similarity of two forms of a word."""
_SOUNDS, _FORM = 0.79, 0.9
"""Least similarity of a misheard auxiliary verb, and that of another form of a verb, which has another tense."""
_EXACT = 0.999
_TAKES_NOTHING = {"past", "present", "future"}
_UNKNOWN_NEAR, _UNKNOWN_ASIDE, _UNKNOWN_FAR = 0.5, 0.25, 0.1
_ARTICLES = {"the", "a", "an", "my", "your", "its", "der", "die", "das", "dem", "den", "la", "le", "les", "el", "los"}
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
        ordinal: Which time a deed was done: 1 for the first, -1 for the last.
        is_past: Whether it asks about the past.
        says: Words that were said, in a question about an utterance.
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
    ordinal: int | None = None
    is_past: bool = False
    says: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


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
    reading = Reading(language, digits_after_names(list(words), subjects))
    at_s, ago, person = take_time(reading)
    things, agents = take_names(reading, subjects)
    person = take_person(reading, subjects) or person
    _classify(reading, _domain(subjects, language.code))
    if person is None and reading.has("me"):
        person = PersonReference(me=True)
    ordinal = take_ordinal(reading)
    topics, fit, is_opposite = _topics(reading, subjects)
    topic = next(iter(topics), None)
    if topic is not None:
        deed = set(reading.found["topic"][0][1])
        reading.found["not"] = [each for each in reading.found.get("not", ()) if not deed.issuperset(each[1])]
    _guess_interrogative(reading, topic is not None)
    agent = _acting(reading, agents, topic is not None)
    things |= {name: words[place - 1] if place else "" for name, place in agents if name not in (agent, *things)}
    kind, sure = _kind(reading, topic is not None, at_s is not None)
    if kind in ("why", "why_not", "did") and is_opposite:
        kind = "why_not" if kind == "why" else "why" if kind == "why_not" else kind
    says: tuple[str, ...] = ()
    if kind in ("why", "when", "did", "count") and reading.has("say"):
        last = max(place for _, places in reading.found["say"] for place in places)
        words_said = tuple(reading.words[last + 1 :])
        if words_said and (topic is None or (topic.declared is None and subjects.is_quoted(words_said))):
            says, topics, topic, fit = words_said, (), None, 1.0
            reading.taken.update(range(last + 1, len(reading.words)))
    unknown = tuple(reading.words[place] for place in reading.free())
    confidence = min(sure, fit) * _coverage(reading, topic, subjects.known_words | _domain(subjects, language.code))
    return Question(
        kind, language.code, round(confidence, 3), topics, person, agent, things, at_s, ago, ordinal,
        is_past=reading.has("past") and not reading.has("future"), says=says, unknown=unknown,
    )  # fmt: skip


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
        for phrase in alternatives:
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
        soft = name in _TAKES_NOTHING or name in ("filler", "next", "plan", "me", "you", "people", "last", "first")
        if (reading.taken & set(places) and alike < _EXACT) or (alike < _EXACT and others):
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
            found.append(max(fits, key=lambda each: each[:2]))
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
    penalty = 0.0
    for place in reading.free():
        word = reading.words[place]
        if word in known:
            continue
        before = [each for each in reading.words[max(0, place - 2) : place] if each not in _ARTICLES]
        is_aside = bool(before) and before[-1] in aside and reading.words[place - 1] != "to"
        near = not places or any(abs(place - at) <= _NEAR for at in places)
        far = word.endswith("ly") or len(word) < 3 or not near
        penalty += _UNKNOWN_FAR if far else _UNKNOWN_ASIDE if is_aside else _UNKNOWN_NEAR
    return 1.0 / (1.0 + penalty)


# Kinds


def _kind(reading: Reading, has_topic: bool, has_time: bool) -> tuple[Kind | None, float]:
    """Return the kind of question by the classes of its words, and how sure it is."""
    has = reading.has
    sure = min((max(alike for alike, _ in reading.found[name]) for name in INTERROGATIVES if has(name)), default=1.0)
    past = has("past") or has_time
    if has("unanswerable") and not has("why", "how_often", "how_many", "what", "when"):
        return None, 0.0
    if has("why"):
        return ("why_not" if has("not") else "why"), sure
    if has("how_often"):
        return "count", sure
    if has("when"):
        return ("when", sure) if has_topic or has("here", "see", "say", "people", "me") else (None, 0.0)
    if has("how_many"):
        if has("people"):
            return ("count" if has("past") or (has("here") and not has("see")) else "see"), sure
        return ("count", sure) if has_topic else (None, 0.0)
    if has("who"):
        if has_topic:
            return "who", sure
        if has("see") or (has("here") and not has("past") and not has_time):
            return "see", sure
        return ("who", sure) if has("here", "people") or past else (None, 0.0)
    if has("what"):
        return _what(reading, has_topic, sure)
    if has_topic:
        return ("next" if has("future", "plan") and not has("past") else "did"), 1.0
    if has("see"):
        return "see", 0.95
    if has("here") and has("people", "nobody", "me", "named"):
        return ("who" if has("past") else "see"), 0.9
    if has("people", "nobody") and has("present", "past"):
        return ("who" if has("past") else "see"), 0.8
    if has("plan", "next") and len(reading.words) <= 4:
        return "next", 0.8
    return None, 0.0


def _what(reading: Reading, has_topic: bool, sure: float) -> tuple[Kind | None, float]:
    has = reading.has
    if has("see") and not has_topic:
        return "see", sure
    if has("say") and not has_topic and not has("future"):
        return "said", sure
    if has("next") and not has("past"):
        return "next", sure
    if has("plan", "future") and not has("past"):
        return "next", sure
    if has("do", "happen", "plan"):
        return "doing", sure
    if has("people", "here") and not has_topic:
        return "see", sure * 0.9
    return ("did" if has_topic and has("you", "past") else None), sure * 0.7


def with_time(question: Question, now_s: float) -> Question:
    """Return a question with a time that counts back as a time of the run."""
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
