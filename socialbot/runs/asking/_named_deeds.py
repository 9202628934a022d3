"""Deeds that the words of a question name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._topics import Phrase, Subjects, Topic
from socialbot.runs.asking._words import ALIKE, likeness, similarity
from socialbot.runs.asking.languages.synonyms import synonyms

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
    "place",
    "not",
    "people",
    "nobody",
    "what",
    "at",
)
_SAME = 0.06
"""Difference of fit within which several deeds have the same words."""
_FORM = 0.96
"""Least similarity of two forms of a word; synonyms are not recognised by their sound."""
_SYNONYM = 0.96
"""Fit of a synonym."""
_MOST_BETWEEN = 3
"""Most words between the parts of a synonym: ``let the visitor in``."""
_VERB = 0.78
"""Share of the first word of a loose phrase in its fit."""

_Fit = tuple[float, int, Topic, tuple[int, ...], bool]
"""Fit, number of words, deed, places of the words, and whether they name its opposite."""


def named_deeds(reading: Reading, subjects: Subjects) -> tuple[tuple[Topic, ...], float, bool]:
    """Return the deeds that the words name, how well the first one fits, and whether they name its opposite."""
    code, words = reading.language.code, reading.words
    free = set(reading.free())
    # Verbs of every agent may be parts of a deed: "do nothing", "say hello", "come to base".
    soft = {place for name in _SOFT for _, places in reading.found.get(name, ()) for place in places}
    found: list[_Fit] = []
    for topic in subjects.topics:
        fits: list[_Fit] = [
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
        if topic.declared is not None or subjects.done(topic):
            fits += _by_synonyms(topic, reading, free, soft)
        if fits:
            # "Skip greeting" is the opposite, too.
            best = max(fits, key=lambda each: each[:2])
            found.append((*best[:4], any(opposite and alike >= ALIKE for alike, _, _, _, opposite in fits)))
    if not found:
        return (), 1.0, False
    # Deeds that were done come first among those of the same fit.
    found.sort(key=lambda each: (-each[0], -each[1]))
    near = [each for each in found if each[0] >= found[0][0] - _SAME]
    near.sort(key=lambda each: (not subjects.done(each[2]), -each[1], -each[0]))
    fit, _, _, places, opposite = near[0]
    if fit < ALIKE - 0.04:
        return (), 1.0, False
    reading.found["topic"] = [(fit, places)]
    reading.taken |= set(places)
    named = {word for phrase in (*near[0][2].words.get(code, ()), *near[0][2].loose) for word in phrase}
    reading.taken |= {at for at in free if any(similarity(words[at], word) >= ALIKE for word in named)}
    # Other deeds have the same words, or some of them: "Bob" alone is no other deed for "let in".
    same = [each[2] for each in near if set(each[3]) & set(places)]
    return tuple(same), min(1.0, fit), opposite


def _by_synonyms(topic: Topic, reading: Reading, free: set[int], soft: set[int]) -> Iterator[_Fit]:
    """Yield how words name a deed by synonyms of its main phrase, or of the verbs that its loose phrases begin with.

    The first phrase that a vocabulary declares is the main one; others are words of a wider meaning.
    """
    code, words = reading.language.code, reading.words

    def places_of(other: Phrase) -> tuple[int, ...]:
        alike, places = likeness(other, words, _MOST_BETWEEN)
        is_named = bool(places) and (set(places) & free or len(places) > 1)
        return places if alike >= _FORM and is_named and _is_whole(other, places, words, free, soft) else ()

    for opposite, table in ((False, topic.words), (True, topic.opposites)):
        for other in {one for phrase in table.get(code, ())[:1] for one in synonyms(phrase, code)}:
            if places := places_of(other):
                yield _SYNONYM, len(places), topic, places, opposite
    if code != "en":
        return  # names of goals and actions are English
    for phrase in topic.loose:
        for other in synonyms(phrase[:1], code):
            if places := places_of(other):
                rest = (free | soft) - set(places)
                objects = tuple(at for at in rest if any(similarity(words[at], one) >= ALIKE for one in phrase[1:]))
                share = 1.0 if len(phrase) == 1 else _VERB + (1.0 - _VERB) * len(objects) / len(phrase[1:])
                yield _SYNONYM * min(1.0, share), len(places) + len(objects), topic, (*places, *objects), False


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
        share = 1.0 if len(phrase) == 1 else _VERB if n == 0 else (1.0 - _VERB) / (len(phrase) - 1)
        places = [at for at in free | soft if similarity(words[at], wanted) >= (ALIKE if at in free else 0.95)]
        place = max(places, key=lambda at: (similarity(words[at], wanted), -at), default=None)
        if place is not None:
            total += share * similarity(words[place], wanted)
            found.append(place)
        elif n == 0:
            return 0.0, ()
    return (total, tuple(found)) if set(found) & free else (0.0, ())
