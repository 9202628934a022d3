"""Deeds that the words of a question name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._topics import Phrase, Subjects, Topic, arguments_of
from socialbot.runs.asking._words import ALIKE, FORM, likeness, similarity, tokens
from socialbot.runs.asking.languages.synonyms import acts_of, synonyms

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
_SYNONYM = 0.96
"""Fit of a synonym."""
_BY_NAME = 0.9
"""Share of the fit of a deed that is named by its argument only."""
_MOST_BETWEEN = 3
"""Most words between the parts of a synonym: ``let the visitor in``."""
_VERB = 0.78
"""Share of the first word of a loose phrase in its fit."""


@dataclass(frozen=True)
class _Fit:
    """How words name a deed.

    Args:
        alike: How well they fit.
        places: Their places.
        topic: The deed.
        fixed: The places of words that name it together, as ``drop off`` does.
        is_opposite: Whether they name its opposite.
        is_synonym: Whether they are no words of the agent.
        is_by_name: Whether they name only its argument.
    """

    alike: float
    places: tuple[int, ...]
    topic: Topic
    fixed: tuple[int, ...] = ()
    is_opposite: bool = False
    is_synonym: bool = False
    is_by_name: bool = False

    def outdoes(self, other: _Fit) -> bool:
        """Return whether the other one knows only some words of a phrase: "go ahead" is not to go."""
        return len(self.fixed) > 1 and set(other.places) < set(self.fixed)


@dataclass(frozen=True)
class Named:
    """Deeds that the words of a question name.

    Args:
        topics: The deeds; those that were done come first.
        fit: How well the first one fits.
        is_opposite: Whether they name its opposite.
        is_synonym: Whether they are no words of the agent.
    """

    topics: tuple[Topic, ...] = ()
    fit: float = 1.0
    is_opposite: bool = False
    is_synonym: bool = False


def named_deeds(reading: Reading, subjects: Subjects, verb: int | None = None) -> Named:
    """Return the deeds that the words name.

    Of deeds that fit, those that the ``verb`` at that place names come first: "empty its load" is to unload.
    """
    code, words = reading.language.code, reading.words
    free = set(reading.free())
    # Verbs of every agent may be parts of a deed: "do nothing", "say hello", "come to base".
    soft = {place for name in _SOFT for place in reading.places(name)}
    found: list[_Fit] = []
    for topic in subjects.topics:
        fits = [
            _Fit(alike, places, topic, places, opposite)
            for opposite, table in ((False, topic.words), (True, topic.opposites))
            for phrase in table.get(code, ())
            for alike, places in [likeness(phrase, words, 4)]
            if places and (set(places) & free or len(places) > 1) and _is_whole(phrase, places, words, free, soft)
        ]
        for phrase in topic.loose:
            if verb is not None and verb not in reading.places("say") and phrase in topic.named_by_argument:
                continue  # "Did you meet Bob?" is not about every deed to Bob
            alike, places = _loosely(phrase, words, free, soft)
            if places:
                is_by_name = phrase in topic.named_by_argument
                fits.append(_Fit(alike * (_BY_NAME if is_by_name else 1.0), places, topic, is_by_name=is_by_name))
        if topic.declared is not None or subjects.done(topic):
            fits += _by_synonyms(topic, reading, free, soft)
        fits = [each for each in fits if not any(other.outdoes(each) for other in fits)]
        if fits:
            # "Skip greeting" is the opposite, too.
            is_opposite = any(each.is_opposite and each.alike >= ALIKE for each in fits)
            best = max(fits, key=lambda each: (each.alike, len(each.places), each.is_opposite))
            found.append(replace(best, is_opposite=is_opposite))
    found = [each for each in found if not any(other.outdoes(each) for other in found)]
    if not found:
        return Named()
    most = max(each.alike for each in found)
    near = [each for each in found if each.alike >= most - _SAME]
    near.sort(key=lambda each: (verb not in each.places, *_rank(each, subjects), -len(each.places), -each.alike))
    first = near[0]
    if first.alike < ALIKE - 0.04:
        return Named()
    places = set(first.places)
    reading.found["topic"] = [(first.alike, first.places)]
    reading.taken |= places
    named = {word for phrase in (*first.topic.words.get(code, ()), *first.topic.loose) for word in phrase}
    reading.found["deed"] = [(1.0, (at,)) for at in free if any(similarity(words[at], word) >= ALIKE for word in named)]
    reading.taken |= set(reading.places("deed"))
    # Other deeds have the same words, or some of them: "Bob" alone is no other deed for "let in".
    same = tuple(each.topic for each in near if places.intersection(each.places))
    return Named(same, min(1.0, first.alike), first.is_opposite, first.is_synonym)


def _rank(fit: _Fit, subjects: Subjects) -> tuple[bool, int]:
    """Return the order of deeds with the same words.

    Deeds that were done come first. Among the rest, deeds named by the agent's own words come before what was said to
    the same end, then others, and last deeds of which the words name only the argument.
    """
    is_saying = fit.is_synonym and fit.topic.is_saying
    acted = not is_saying and bool(subjects.acted(fit.topic))
    ranks = (fit.is_by_name, not acted and (is_saying or fit.is_synonym), not acted, fit.is_synonym and not is_saying)
    return not subjects.done(fit.topic), sum(weight * rank for weight, rank in zip((8, 4, 2, 1), ranks, strict=True))


def _by_synonyms(topic: Topic, reading: Reading, free: set[int], soft: set[int]) -> Iterator[_Fit]:
    """Yield how words name a deed by synonyms of its main phrase, or of the verbs that its loose phrases begin with.

    The first phrase that a vocabulary declares is the main one; others are words of a wider meaning.
    """
    code, words = reading.language.code, reading.words

    def places_of(other: Phrase) -> tuple[int, ...]:
        alike, places = likeness(other, words, _MOST_BETWEEN)
        is_named = bool(places) and (set(places) & free or len(places) > 1)
        return places if alike >= FORM and is_named and _is_whole(other, places, words, free, soft) else ()

    for opposite, table in ((False, topic.words), (True, topic.opposites)):
        for other in {one for phrase in table.get(code, ())[:1] for one in synonyms(phrase, code)}:
            if places := places_of(other):
                yield _Fit(_SYNONYM, places, topic, places, opposite, is_synonym=True)
    if code != "en":
        return  # names of goals and actions are English
    if topic.is_saying:
        for other in acts_of(tokens(" ".join(arguments_of(topic.name)))):
            if places := places_of(other):
                yield _Fit(_SYNONYM, places, topic, places, is_synonym=True)
        return
    for phrase in topic.loose:
        for other in synonyms(phrase[:1], code):
            if places := places_of(other):
                rest = (free | soft) - set(places)
                objects = tuple(at for at in rest if any(similarity(words[at], one) >= ALIKE for one in phrase[1:]))
                share = 1.0 if len(phrase) == 1 else _VERB + (1.0 - _VERB) * len(objects) / len(phrase[1:])
                yield _Fit(_SYNONYM * min(1.0, share), (*places, *objects), topic, places, is_synonym=True)


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
