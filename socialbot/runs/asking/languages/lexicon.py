"""Words and phrases of the same meaning, in the languages of questions: deeds of robots, things and states.

An agent names its deeds and things in English, as programs do. The lexicon finds them in the words of a question: a
robot with an action ``inspect`` understands "Have you examined Bob?" and "Hast du Bob kontrolliert?".

The forms of German, French and Spanish verbs and nouns are not all forms: questions to a robot have infinitives,
participles, and forms of the second and third person. Some of the forms do not exist. They do no harm, since nobody
writes them. Words have no accents.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from socialbot.runs.asking._words import folded, stem, tokens
from socialbot.runs.asking.languages import LANGUAGES

Phrase = tuple[str, ...]

_SEPARABLE = (
    "hinterher", "zusammen", "herunter", "hinunter", "stehen", "zuruck", "vorbei", "herein", "hinein", "heraus",
    "hinaus", "herbei", "bereit", "sauber", "kaputt", "herum", "runter", "weiter", "wieder", "schief", "fehl", "nach",
    "rein", "raus", "rum", "auf", "aus", "ab", "an", "ein", "vor", "zu", "weg", "her", "hin", "los", "mit", "um",
    "fest", "frei", "hoch", "fort", "still", "voran", "teil",
)  # fmt: skip
"""Prefixes of German verbs that are words of their own in a main clause, longer ones first."""
_INSEPARABLE = ("uber", "unter", "wider", "hinter", "miss", "emp", "ent", "ver", "zer", "be", "ge", "er")
_WHOLE = {"antworten", "horen", "holen", "warten", "hinken", "losen", "ankern", "arbeiten", "ernten", "erben", "essen"}
"""German verbs that only seem to have a prefix."""
_SHORTEST_VERB = 4
_BEFORE_E = re.compile(r".*([td]|[^aeioulrmnh][mn])")
"""Stems of German verbs with an *e* before the endings *t* and *te*."""
_STRONG = LANGUAGES["de"].verbs


def german(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a German word, or of a phrase that ends with a verb."""
    *before, word = phrase
    if not is_verb:
        yield from ((*before, word + ending) for ending in ("", "s", "es", "e", "en", "n", "er", "ern"))
        return
    prefix = "" if word in _WHOLE else next((one for one in _SEPARABLE if _begins(word, one)), "")
    for form, is_finite in _german_forms(word.removeprefix(prefix)):
        yield (*before, prefix + form)
        if is_finite:
            rest = (*before, prefix) if prefix else tuple(before)
            yield (form, *rest)
        elif prefix:
            yield (*before, f"{prefix}zu{form}")


def _begins(word: str, prefix: str) -> bool:
    rest = word.removeprefix(prefix)
    return rest != word and len(rest) >= _SHORTEST_VERB and any(vowel in rest[:-2] for vowel in "aeiou")


def _german_forms(verb: str) -> Iterator[tuple[str, bool]]:
    """Yield the forms of a verb without separable prefix, and whether they are finite."""
    inseparable = "" if verb in _WHOLE else next((one for one in _INSEPARABLE if _begins(verb, one)), "")
    base = verb.removeprefix(inseparable)
    stem = base.removesuffix("n").removesuffix("e")
    if base in _STRONG:
        past, participle, *third = _STRONG[base]
        if inseparable:
            participle = participle.removeprefix("ge")
        stems = {stem, *third}
    else:
        past = f"{stem}e" if _BEFORE_E.fullmatch(stem) else stem  # "geredet", "geöffnet", but "gelernt"
        participle = f"{past}t" if inseparable or verb.endswith("ieren") else f"ge{past}t"
        past, stems = f"{past}te", {stem}
    yield verb, False
    yield inseparable + participle, False
    for ending in ("", "e", "st", "est", "t", "et", "en"):
        yield from ((inseparable + each + ending, True) for each in stems)
        yield inseparable + past.removesuffix("e" if ending.startswith("e") else "") + ending, True


_FRENCH = LANGUAGES["fr"].verbs


def french(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a French word, or of a phrase that begins with it."""
    word, *rest = phrase
    forms = {word + ending for ending in ("", "s", "x", "e", "es")}
    if is_verb:
        ending = max((one for one in _FRENCH if word.endswith(one)), key=len, default="")
        stem = word[:-2]
        if ending:
            begin = word.removesuffix(ending)
            participle, imperfect, present = (begin + each for each in _FRENCH[ending])
            forms |= {present + one for one in ("", "s", "t", "d", "ds")}
        elif word.endswith("ir"):
            participle, imperfect = f"{stem}i", f"{stem}iss"
            forms |= {f"{stem}{one}" for one in ("is", "it", "ira", "iras")}
        elif word.endswith("re"):
            participle, imperfect = f"{stem}u", stem
            forms |= {f"{stem}{one}" for one in ("", "s", "t")}
        else:
            participle, imperfect = f"{stem}e", stem.removesuffix("g") + ("ge" if stem.endswith("g") else "")
            forms |= {f"{stem}{one}" for one in ("e", "es", "a", "as", "era", "eras")}
        forms |= {participle + one for one in ("", "e", "s", "es")}
        forms |= {imperfect + one for one in ("ais", "ait", "aient", "ant", "ent", "ez", "iez", "ons", "e", "es")}
    yield from ((form, *rest) for form in forms)


_SPANISH = LANGUAGES["es"].verbs
_CLITICS = ("lo", "la", "los", "las", "le", "les", "me", "te", "se", "nos")
_SPELLED = (("c", "qu"), ("g", "gu"), ("z", "c"))
"""Last letters of a stem before a and before e."""


def spanish(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a Spanish word, or of a phrase that begins with it."""
    word, *rest = phrase
    forms = {word, f"{word}s", f"{word}es"}
    if word[-1] in "oae" and not is_verb:
        forms |= {word[:-1] + ending for ending in ("o", "a", "os", "as")}
    if is_verb:
        verb = word.removesuffix("se")
        irregular = max((one for one in _SPANISH if verb.endswith(one)), key=len, default="")
        if irregular in ("ir", "dar", "ver") and irregular != verb:
            irregular = ""
        stem, is_first = verb[:-2], verb.endswith("ar")
        stems, participle = {stem}, stem + ("ado" if is_first else "ido")
        if irregular:
            begin = verb.removesuffix(irregular)
            participle, *others = (begin + each for each in _SPANISH[irregular])
            stems |= set(others)
        forms |= {verb} | {verb + clitic for clitic in _CLITICS}
        forms |= {participle[:-1] + ending for ending in ("o", "a", "os", "as")}
        gerunds = {stem + ("ando" if is_first else "iendo"), f"{stem}yendo"}
        forms |= gerunds | {gerund + clitic for gerund in gerunds for clitic in _CLITICS}
        endings = (
            "o a as an e es en aste amos aron aba abas aban ara aras aran"
            if is_first
            else "o e es en a as an i io iste imos ieron eron ia ias ian iera ieras ieran era eras"
        )
        both = "e o iste imos ieron eron a"  # of an irregular past tense
        for each in stems:
            found = f"{endings} {both}".split() if each != stem else endings.split()
            forms |= {each + ending for ending in found}
            before_e = next((each[: -len(one)] + other for one, other in _SPELLED if each.endswith(one)), each)
            forms |= {before_e + ending for ending in found if ending.startswith("e") and is_first}
        forms |= {verb + ending for ending in ("a", "as", "an", "ia", "ias")}
    yield from ((form, *rest) for form in forms)


Meaning = int
"""Number of a paragraph of the lexicon."""

_ENGLISH = "en"
_FORMS: Mapping[str, Callable[[Phrase, bool], Iterator[Phrase]]] = {
    "de": german, "fr": french, "es": spanish,
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
def words(language: str) -> frozenset[str]:
    """Return the words of all phrases: they are written as they are meant, and resemble others by chance only."""
    if language == _ENGLISH:
        return frozenset(word for each in _paragraphs() for one in each.phrases[_ENGLISH] for word in tokens(one))
    return frozenset(word for forms in _entries(language).values() for form in forms for word in form)


def section_of(meaning: Meaning) -> str:
    """Return what a meaning is one of: ``deeds``, ``things`` or words that are ``said``."""
    return _paragraphs()[meaning].section


def is_deed(word: str, language: str) -> bool:
    """Return whether a word may be a form of a deed."""
    return any(section_of(each) == "deeds" for each in meanings((word,), language))


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
