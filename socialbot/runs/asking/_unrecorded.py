"""What a question names and no record has."""

from __future__ import annotations

import itertools
import re
from collections.abc import Set

from socialbot.runs.asking._named_deeds import NamedDeed, meanings_of
from socialbot.runs.asking._parts import CAPITAL, Found
from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._sentences import kind_of_name
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._words import NUMBER_WORDS, stem, tokens
from socialbot.runs.asking.languages import lexicon

_TO_THE = {"al", "au", "aux", "ins", "zum", "zur"}
"""Prepositions with an article."""
_POSSESSIVE = {
    "its", "your", "his", "their", "sein", "seine", "seinen", "dein", "deine", "deinen", "sa", "son", "ton", "ta", "su",
    "tu",
}  # fmt: skip
"""Possessive determiners before a thing."""


_ID = re.compile(r"(?<!\w)([^\W\d_])(\d{1,4})(?!\w)")
"""Id of a letter and a number, as trackers give: ``t9``."""


def ids_without_records(text: str, subjects: Subjects) -> list[str]:
    """Return ids of people and things in a text that nothing has: ``t9`` in a run with t1 and t2."""
    names = (*subjects.persons, *subjects.things, *subjects.agents, *subjects.argument_names.values())
    known = {pair for name in names for pair in itertools.pairwise(tokens(name))}
    found = (match.groups() for match in _ID.finditer(text.lower()))
    return [letter + number for letter, number in found if (letter, number) not in known]


def names_without_records(reading: Reading, referred: Set[int], subjects: Subjects) -> list[tuple[str, str]]:
    """Return kinds of names with a number or letter that makes a name that nothing has: ``room 7``."""
    words = reading.words
    pairs = [(words[place - 1], words[place]) for place in reading.free() if place]
    # "la caisse d1": a letter in front of a number is no French word.
    pairs += [pair for n, pair in enumerate(itertools.pairwise(words), 1) if n not in referred and len(pair[1]) == 1
              and pair[1].isalpha() and "".join(words[n + 1 : n + 2]).isdigit()]  # fmt: skip
    numbers = {words[n]: "".join(words[n + 1 : n + 2]) for n in range(len(words)) if len(words[n]) == 1}  # the 1 of d1
    return [
        (kind, part + number)
        for kind, part in pairs
        if kind in subjects.kinds and (len(part) == 1 or part.isdigit())
        for number in [numbers.get(part, "") if part.isalpha() and numbers.get(part, "").isdigit() else ""]
    ]


def has_other_object(deed: NamedDeed, found: Found, subjects: Subjects) -> bool:
    """Return whether a noun behind a determiner names something that no record has.

    ``clean the garage``, ``how many kilos``, ``which crane``.
    """
    words, language = found.reading.words, found.reading.language
    free = [place for place in found.reading.free() if place not in deed.places and len(words[place]) > 2]
    named = _named(found)
    arguments = [arguments_of(one.what) for one in subjects.done(deed.topic)]
    # "How many badges did you check?" may ask for check("Ann").
    to_people = all(arguments) and not any(kind_of_name(name) in subjects.kinds for one in arguments for name in one)
    asked = {
        place
        for place in free
        if not to_people
        and found.reading.is_asked_for(place)
        and not _is_deed(lexicon.meanings((words[place],), language.code))
    }
    nouns = [
        words[place]
        for place in free
        if place and place + 1 not in named  # "the big box"
        if place in asked or words[place - 1] in _TO_THE or (words[place - 1],) in language.phrases["article"]
    ]
    nouns = [word for word in nouns if not lexicon.is_general(word, language.code)]  # "go to a place"
    return any(not subjects.is_recorded(word, language.code) and word not in NUMBER_WORDS for word in nouns)


def unrecorded(found: Found, subjects: Subjects, text: str) -> list[str]:
    """Return what a question names and no record does: things behind an article, names, and deeds.

    Args:
        found: Parts of the question.
        subjects: What the run can be asked about.
        text: The question as it was written, with its capital letters.
    """
    reading, words, verb = found.reading, found.reading.words, found.question.verb
    names = {word for _, name in CAPITAL.findall(text) for word in tokens(name)}
    articles = reading.language.first_words("article") | _TO_THE | _POSSESSIVE
    # "Ann" resembles "any", but is a name. German nouns have capital letters, too.
    certain = {word for word in names if reading.language.code != "de" and word not in reading.language.known_words}
    free = [place for place, word in enumerate(words) if len(word) > 2 and (place in reading.free() or word in certain)]
    numbered = [f"{kind} {part}" for kind, part in names_without_records(reading, found.referred, subjects)]
    numbered = [one for one in dict.fromkeys(numbered) if not subjects.begins_name(one)]
    code = reading.language.code
    nouns = {
        words[place]
        for place in free
        if words[place] in names
        or words[place - 1] in articles
        or (reading.is_asked_for(place) and place + 1 not in _named(found))
    }
    deeds = {words[place] for place in free if _is_deed(lexicon.meanings((words[place],), code))}
    known, unknown = meanings_of(subjects), set(reading.free())
    phrases = [
        " ".join(words[n] for n in each.places)
        for each in lexicon.found_in(words, code)
        if len(each.places) > 1 and unknown.issuperset(each.places) and _is_deed({each.meaning} - known)
    ]  # "fallen lassen"
    within = {word for phrase in phrases for word in phrase.split()}
    others: list[str] = []
    for place, word in enumerate(words):
        is_done = word in deeds and known.isdisjoint(lexicon.meanings((word,), code))
        is_done = is_done and stem(word) not in subjects.recorded_stems
        is_other = (word in nouns or word == verb) and not subjects.is_recorded(word, code)
        if (is_done or is_other) and word not in NUMBER_WORDS | within:
            noun = next(iter(words[place + 1 : place + 2]), "")
            others.append(f"{word} {noun}" if word in nouns and noun in subjects.kinds else word)  # "living room"
    ids = [one for one in ids_without_records(text, subjects) if not any(each.endswith(one) for each in numbered)]
    return list(dict.fromkeys([*numbered, *ids, *phrases, *others]))


def _named(found: Found) -> set[int]:
    """Return the places of words for names, people, times and seeing."""
    return {*found.referred, *(n for name in ("people", "time", "see") for n in found.reading.places(name))}


def _is_deed(meant: Set[lexicon.Meaning]) -> bool:
    return any(lexicon.section_of(one) == "deeds" for one in meant)
