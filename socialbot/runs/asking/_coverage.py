"""How much of a question is explained."""

from __future__ import annotations

from collections.abc import Set

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._roles import ARTICLES
from socialbot.runs.asking._topics import Subjects, Topic
from socialbot.runs.asking._words import FORM, stem
from socialbot.runs.asking.languages import INTERROGATIVES

_UNKNOWN_NEAR, _UNKNOWN_ASIDE, _UNKNOWN_FAR = 0.5, 0.25, 0.1
"""What an unknown word costs: near the deed, behind a preposition, and far away."""
_OTHER_DEED = 0.25
"""What a word costs that belongs to other deeds."""
_GUESSED = 0.24
"""What a word costs that only resembles one of the grammar."""
_PREPOSITIONS = {"behind", "with", "during", "through", "auf", "mit", "dans", "sur", "avec", "con", "sobre"}
_POSSESSIVE = {"its", "their", "his", "her"}
_SHORTEST_NAME = 3
"""Length of words below which they are a part of a name: room 2, carrier d."""
_NEAR = 3
"""Most words between a deed and an unknown word near it."""


def coverage(reading: Reading, topic: Topic | None, subjects: Subjects, deeds: Set[str], verb: int | None) -> float:
    """Return how much of the question is explained.

    An unexplained ``verb``, an unknown object of the deed, and a name that nothing has ("room 7") count most. Words
    of other ``deeds``, words behind a preposition, adverbs, and words far away count less.
    """
    places: tuple[int, ...] = reading.found["topic"][0][1] if topic is not None else ()
    aside = {one[0] for name in ("at", "here") for one in reading.language.phrases[name]} | _PREPOSITIONS
    known, of_deeds = set(map(stem, subjects.known_words)), set(map(stem, deeds))
    penalty = 0.0 if verb is None else _UNKNOWN_NEAR
    for place in reading.free():
        word = reading.words[place]
        if place == verb:
            continue
        if place and len(word) < _SHORTEST_NAME and reading.words[place - 1] in subjects.kinds:
            penalty += _UNKNOWN_NEAR  # "room 2", of which nobody knows
            continue
        if stem(word) in known | of_deeds:
            penalty += 0.0 if stem(word) in known else _OTHER_DEED
            continue
        before = [each for each in reading.words[max(0, place - 2) : place] if each not in ARTICLES]
        is_aside = bool(before) and before[-1] in aside and reading.words[place - 1] != "to"
        is_aside |= topic is not None and reading.words[max(0, place - 1)] in _POSSESSIVE  # "empty its load"
        near = not places or any(abs(place - at) <= _NEAR for at in places)
        far = word.endswith("ly") or len(word) < 3 or not near
        penalty += _UNKNOWN_FAR if far else _UNKNOWN_ASIDE if is_aside else _UNKNOWN_NEAR
    guessed = {
        place
        for name, found in reading.found.items()
        if name not in (*INTERROGATIVES, "topic", "past", "present", "future")
        for alike, places in found
        for place in places
        if alike < FORM
    }
    return 1.0 / (1.0 + penalty + _GUESSED * len(guessed))
