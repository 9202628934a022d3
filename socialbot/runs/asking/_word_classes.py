"""Classes of the words of a question, exact or as they were heard."""

from __future__ import annotations

from collections.abc import Sequence, Set
from difflib import SequenceMatcher

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._words import HEARD, occurrences, sound, starts, stem
from socialbot.runs.asking.languages import INTERROGATIVES, Language, lexicon

EXTREMES = ("longest", "shortest", "nearest", "farthest")
"""Classes of words that ask for the visitor with the longest or nearest visit."""
COMPARED = {"longer": "longest", "shorter": "shortest", "nearer": "nearest", "farther": "farthest"}
"""Classes of words that compare named visitors, with the extreme that decides."""
_ONLY_EXACT = {
    "fail", "outcome", "wish", "unanswerable", "not", "past", "present", "future", "filler", "place", "you", "me",
    "them", "seconds", "minutes", "at", "time", "last", "first", "all", "where", "how_far", "how_long", "metres",
    "same time", *EXTREMES, *COMPARED,
}  # fmt: skip
_IMPERATIVES = {"name", "list", "count", "explain"}
_ASKING = {"can", "could", "would", "will"}
"""Auxiliaries in front of an imperative: ``Can you name the visitors?``."""
_TENSES = {"past", "present", "future"}
"""Classes of words that may have another class, too; misheard ones are recognised by their sound alone."""
_STEM = 0.96
"""Least similarity of two forms of a word."""
_SOUNDS, _FORM = 0.79, 0.9
"""Least similarity of a misheard auxiliary verb, and that of another form of a verb, which has another tense."""
_EXACT = 0.999
_PARTS = (
    "matrix", "complement", "or", "which", "why not", "but", "rather", "event after", "event before", "event when",
    "comes", "leaves", "waits", "auxiliary",
    "silent", "request", "end", "overall", "talk", "group", "times", "others", "hypothetical", "qualified",
    "left out", "between", "to", "from", "article", "asks", "replies", "being", "at place",
    "step", "replan", "called", "more than", "less than", "within", "metres", *COMPARED,
)  # fmt: skip
"""Classes of words that only divide a question into clauses."""
_VERBS = {"see", "do", "say", "here", "plan"}
_WRITTEN_ALIKE = 0.88
_SOUNDS_LIKE, _GUESSED = 0.6, 0.8


def _is_alike(alike: float) -> bool:
    """Return whether a word that is no form of a known one is written much like it, or sounds like it."""
    return alike >= _WRITTEN_ALIKE or alike == HEARD


def words_of_deeds(subjects: Subjects, language: str) -> set[str]:
    """Return the words of the deeds of the agents in a language."""
    phrases = (one for topic in subjects.topics for one in (*topic.words.get(language, ()), *topic.loose))
    return {word for phrase in phrases for word in phrase}


def classify(reading: Reading, domain: Set[str]) -> None:
    """Find the classes of the words; longer phrases and better matches first.

    A word that only resembles one of a class is none of it if it is a form of a word of the ``domain``.
    """
    stems = {stem(word) for word in domain}
    deeds = {place for place, word in enumerate(reading.words) if stem(word) in stems}
    matches: list[tuple[float, int, str, tuple[int, ...]]] = []
    for name, alternatives in reading.language.phrases.items():
        if name in _PARTS:
            continue
        for phrase in alternatives:
            between = 1 if phrase[1:] and name in ("why", "how_often", "see", "plan") else 0
            for alike, places in occurrences(phrase, reading.words, between):
                if (
                    alike > _EXACT
                    or (name in _TENSES and _SOUNDS < alike < _FORM)
                    or (name not in _ONLY_EXACT and len(phrase[0]) > 2 and _is_alike(alike))
                ):
                    matches.append((alike, len(phrase), name, places))
    meant = {place for place, word in enumerate(reading.words) if word in lexicon.words(reading.language.code)}
    matches = [each for each in matches if each[0] >= _STEM or not meant.intersection(each[3])]
    exact = {place for alike, _, _, places in matches if alike > _EXACT for place in places}
    matches = [each for each in matches if each[0] > _EXACT or not exact.intersection(each[3]) or each[1] > 1]
    matches.sort(key=lambda each: (each[0] < _EXACT, -each[1], -each[0]))
    claimed: dict[int, str] = {}
    for alike, _, name, places in matches:
        others = {claimed[place] for place in places if place in claimed}
        if "polite" in others or (alike < _STEM and deeds & set(places)):
            continue
        if name in _VERBS and set(places) <= reading.taken:
            continue  # "spot" is a robot
        is_part = len(places) == 1 and places[0] in reading.taken and len(reading.words[places[0]]) == 1  # t, of t2
        if is_part or (reading.taken & set(places) and alike < _EXACT) or (alike < _EXACT and others):
            continue
        if name in INTERROGATIVES and others.intersection(INTERROGATIVES):
            continue
        if name in INTERROGATIVES and alike < _STEM and reading.words[0] in reading.language.auxiliaries:
            continue  # "Did you water the plants?" does not ask what
        reading.found.setdefault(name, []).append((alike, places))
        if name not in _TENSES:
            claimed.update(dict.fromkeys(places, "polite" if name == "filler" and len(places) > 1 else name))
    for name, places in ((name, places) for name, found in reading.found.items() for _, places in found):
        if name != "named" and not name.startswith("person "):
            reading.taken |= set(places)
    _drop_nouns(reading)
    _drop_relatives(reading)


def _drop_relatives(reading: Reading) -> None:
    """Drop interrogatives that are relative pronouns: ``Did you help the man who was here?``."""
    people = {places[-1] for name in ("people", "named") for _, places in reading.found.get(name, ())}
    asking = {places[0] for name in INTERROGATIVES for _, places in reading.found.get(name, ())}
    auxiliaries = {place for place, word in enumerate(reading.words) if word in reading.language.auxiliaries}
    for name in ("who", "what"):
        kept = [
            each
            for each in reading.found.get(name, ())
            if not (len(each[1]) == 1 and each[1][0] - 1 in people and min(asking | auxiliaries) < each[1][0] - 1)
        ]
        if name in reading.found:
            reading.found[name] = kept


def _drop_nouns(reading: Reading) -> None:
    """Drop imperatives that are none behind another interrogative or an auxiliary: ``What is the name of t1?``."""
    asking = {places[0] for name in INTERROGATIVES for _, places in reading.found.get(name, ())}
    auxiliaries = {n for n, word in enumerate(reading.words) if word in reading.language.auxiliaries}
    first = min(asking | auxiliaries, default=0)
    if reading.words[first] in _ASKING:
        return
    for name in ("who", "how_many", "why"):
        found = reading.found.get(name, ())
        nouns = [each for each in found if len(each[1]) == 1 and each[1][0] > first
                 and reading.words[each[1][0]] in _IMPERATIVES]  # fmt: skip
        if nouns:
            reading.found[name] = [each for each in found if each not in nouns]
            reading.taken -= {place for _, places in nouns for place in places}


def tells(words: Sequence[str], language: Language, name: str) -> bool:
    """Return whether a phrase of a class occurs, in any form of its words."""
    return bool(places_of_class(words, language, name))


def tells_exactly(words: Sequence[str], language: Language, name: str) -> bool:
    """Return whether a phrase of a class occurs in these very words."""
    return any(starts(one, words) for one in language.phrases[name])


def places_of_class(words: Sequence[str], language: Language, name: str) -> set[int]:
    """Return the places of the phrases of a class, in any form of their words."""
    found = (each for phrase in language.phrases[name] for each in occurrences(phrase, words, 0))
    return {place for alike, places in found if alike >= _STEM for place in places}


def guess_interrogative(reading: Reading, has_deed: bool, named: Set[int]) -> None:
    """Take an unknown first word for the interrogative that it sounds like, as in ``wide did you ...``.

    ``named`` are the places of words that name a deed.
    """
    free = [place for place in reading.free() if place < 2 and place not in named]
    if reading.has(*INTERROGATIVES) or not free or not reading.has("you"):
        return
    heard = sound(reading.words[free[0]])
    names = ("why", "when", "who") if has_deed else ("what", "who")
    known = [(one[0], name) for name in names for one in reading.language.phrases[name] if len(one) == 1]
    alike, name = max((SequenceMatcher(None, heard, sound(word)).ratio(), name) for word, name in known)
    if alike >= _SOUNDS_LIKE:
        reading.found[name] = [(_GUESSED, (free[0],))]
        reading.taken.add(free[0])
