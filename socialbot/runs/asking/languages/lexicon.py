"""Words and phrases of the same meaning, in the languages of questions: deeds of robots, things and states.

An agent names its deeds and things in English, as programs do. The lexicon finds them in the words of a question: a
robot with an action ``inspect`` understands "Have you examined Bob?" and "Hast du Bob kontrolliert?".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from socialbot.runs.asking._words import folded, stem, tokens
from socialbot.runs.asking.languages import inflection

Phrase = tuple[str, ...]
Meaning = int
"""Number of a paragraph of the lexicon."""

_ENGLISH = "en"
_FORMS: Mapping[str, Callable[[Phrase, bool], Iterator[Phrase]]] = {
    "de": inflection.german, "fr": inflection.french, "es": inflection.spanish,
}  # fmt: skip
_INFINITIVES = {"de": ("n",), "fr": ("er", "ir", "re"), "es": ("ar", "er", "ir", "se")}
_MOST_BETWEEN = {"en": 3, "de": 7, "fr": 4, "es": 4}
"""Most words between the words of a phrase: ``let the visitor in``, ``hob der Kran die erste Kiste hoch``."""
_SHORTEST_FORM = 3


@dataclass(frozen=True)
class Paragraph:
    """Meaning of the lexicon.

    Args:
        section: What it is a meaning of: ``deeds``, ``things``, words that are ``said``, or ``states``.
        phrases: Phrases by language, and under ``does`` and ``about`` other English words that it has to do with.
    """

    section: str
    phrases: dict[str, Sequence[str]]


@dataclass(frozen=True)
class Named:
    """Phrase in the words of a question, with the places of its words and its meaning."""

    phrase: Phrase
    places: tuple[int, ...]
    meaning: Meaning


@cache
def _paragraphs() -> Sequence[Paragraph]:
    text = (files("socialbot.runs.asking.languages") / "lexicon.txt").read_text("utf-8")
    found: list[Paragraph] = []
    section = ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip("[] ")
        elif line.startswith(" "):
            code, _, phrases = line.strip().partition(": ")
            found[-1].phrases[code] = phrases.split(", ")
        elif line and not line.startswith("#"):
            found.append(Paragraph(section, {_ENGLISH: line.split(", ")}))
    return found


def _forms(written: str, language: str, section: str) -> Iterator[Phrase]:
    """Yield the forms of a phrase of the lexicon."""
    phrase = tuple(tokens(written))
    if language == _ENGLISH:
        yield tuple(map(stem, phrase))
        return
    last = written.split()[-1 if language == "de" else 0]
    is_verb = section == "deeds" and last == last.lower() and folded(last).endswith(_INFINITIVES[language])
    yield phrase
    if section in ("deeds", "things"):
        yield from (
            one for one in _FORMS[language](phrase, is_verb) if len(one) > 1 or len("".join(one)) >= _SHORTEST_FORM
        )


@cache
def _entries(language: str) -> Mapping[str, Mapping[Phrase, Set[Meaning]]]:
    """Return the meanings of the forms of all phrases by their first word."""
    found: dict[str, dict[Phrase, set[Meaning]]] = {}
    for meaning, each in enumerate(_paragraphs()):
        for written in each.phrases.get(language, ()) if each.section != "states" else ():
            for form in _forms(written, language, each.section):
                found.setdefault(form[0], {}).setdefault(form, set()).add(meaning)
    return found


@cache
def words(language: str) -> Set[str]:
    """Return the words of all phrases: they are written as they are meant, and resemble others by chance only."""
    if language == _ENGLISH:
        return {word for each in _paragraphs() for one in each.phrases[_ENGLISH] for word in tokens(one)}
    return {word for forms in _entries(language).values() for form in forms for word in form}


def section_of(meaning: Meaning) -> str:
    """Return what a meaning is one of: ``deeds``, ``things`` or words that are ``said``."""
    return _paragraphs()[meaning].section


@cache
def meanings(phrase: Phrase, language: str = _ENGLISH) -> frozenset[Meaning]:
    """Return the meanings of a word or of a whole phrase; none if the lexicon lacks it."""
    found = tuple(map(stem, phrase)) if language == _ENGLISH else phrase
    return frozenset(_entries(language).get(found[0], {}).get(found, ())) if found else frozenset()


@cache
def is_general(word: str, language: str) -> bool:
    """Return whether a word is only a general one for any thing or place: ``go to another place``."""
    general = meanings(("thing",)) | meanings(("place",))
    return any(section_of(one) == "things" for one in meanings((word,), language) & general)


@cache
def named_meanings(word: str) -> frozenset[Meaning]:
    """Return the meanings of a word in a name, which programs write in English or else in another language."""
    return meanings((word,)) or frozenset().union(*(meanings((word,), code) for code in _FORMS))


def found_in(words: Sequence[str], language: str) -> list[Named]:
    """Return the phrases in the words of a question, the longest ones first."""
    read = [*map(stem, words)] if language == _ENGLISH else list(words)
    found: list[Named] = []
    for start, word in enumerate(read):
        for form, meant in _entries(language).get(word, {}).items():
            places = [start]
            for wanted in form[1:]:
                reach = range(places[-1] + 1, min(len(read), places[-1] + 2 + _MOST_BETWEEN[language]))
                place = next((n for n in reach if read[n] == wanted), None)
                if place is None:
                    break
                places.append(place)
            else:
                found += [Named(form, tuple(places), meaning) for meaning in sorted(meant)]
    return sorted(found, key=lambda each: -len(each.phrase))


def done_by(said: Sequence[str]) -> frozenset[Meaning]:
    """Return the deeds that words do when they are said: "Come in" admits somebody."""
    deeds = [
        one
        for code in (_ENGLISH, *_FORMS)
        for each in found_in(said, code)
        if len(each.places) == each.places[-1] - each.places[0] + 1
        for one in _paragraphs()[each.meaning].phrases.get("does", ())
    ]
    found = (meaning for one in deeds for meaning in meanings((*tokens(one),)))
    return frozenset(meaning for meaning in found if section_of(meaning) == "deeds")


@cache
def is_about(word: str, language: str, name: str) -> bool:
    """Return whether a word of a question may be about a belief that has a word in its name."""
    if stem(word) == stem(name):
        return True
    about = {other for each in _paragraphs() if each.section == "states" and stem(name) in map(stem, each.phrases["en"])
             for other in each.phrases["about"]}  # fmt: skip
    known = named_meanings(name).union(*(meanings((other,)) for other in about))
    return stem(word) in map(stem, about) or not known.isdisjoint(meanings((word,), language))
