"""Languages of questions and answers, English, German, French and Spanish: words by class, and sentences of answers.

The file of a language, such as en.ini, lists words by class. A class is a role in a question: an interrogative
(``why``, ``who``), a verb that every agent knows (``see``, ``do``), a reference (``me``, ``people``), a tense or a
negation. Its alternatives are separated by commas and may have several words: ``at/in what/which moment`` stands for
four of them. Words have no accents.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from configparser import ConfigParser
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from itertools import product

__all__ = ["ENGLISH", "INTERROGATIVES", "LANGUAGES", "Language"]

INTERROGATIVES = (
    "why", "what", "who", "when", "where", "how_often", "how_many", "how_long", "how_far", "unanswerable",
)  # fmt: skip


@dataclass(frozen=True)
class Voices:
    """Words that tell who does a deed, in the active and the passive voice.

    Args:
        you: The robot as a subject.
        to_you: The robot as an object.
        passive: Forms of the auxiliary of the passive voice.
        by: Prepositions before the one who does it.
        receive: Verbs of receiving, with a meaning like that of the passive voice.
        source: Prepositions behind them.
        third: Auxiliaries whose subject is a third person.
        first: Forms of verbs whose subject is the person who asks.
        participle: Form of the verb in the passive voice.
        second: Form of a verb whose subject is the robot, even if no word says so.
    """

    you: frozenset[str]
    to_you: frozenset[str]
    passive: frozenset[str]
    by: frozenset[str]
    receive: frozenset[str]
    source: frozenset[str]
    participle: re.Pattern[str]
    second: re.Pattern[str] = re.compile("(?!)")
    third: frozenset[str] = frozenset()
    first: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Language:
    """Words by class, and sentences of answers by name."""

    code: str
    phrases: Mapping[str, tuple[tuple[str, ...], ...]]
    """Alternatives of each class as tuples of words."""
    sentences: Mapping[str, str]
    voices: Voices
    numbers: Mapping[str, Sequence[str]]
    """Words for numbers: ``units`` from 0 on, other forms of ``one``, ``tens``, ``hundred`` and ``ordinals``."""
    verbs: Mapping[str, Sequence[str]]
    """Forms of irregular verbs."""
    ordinary_verbs: Set[str]
    """Verbs that are never misheard words."""
    letters: str
    """Letters and signs that no other language has."""

    @cached_property
    def known_words(self) -> frozenset[str]:
        return frozenset(word for alternatives in self.phrases.values() for phrase in alternatives for word in phrase)

    def first_words(self, *classes: str) -> set[str]:
        """Return the first words of the alternatives of classes."""
        return {one[0] for name in classes for one in self.phrases[name]}

    def single_words(self, *classes: str) -> set[str]:
        """Return the alternatives of classes that are one word."""
        return {one[0] for name in classes for one in self.phrases[name] if len(one) == 1}

    @cached_property
    def units(self) -> dict[str, float]:
        """Words for units of time with their length in seconds."""
        return {
            one[0]: seconds for name, seconds in (("seconds", 1.0), ("minutes", 60.0)) for one in self.phrases[name]
        }

    @property
    def auxiliaries(self) -> frozenset[str]:
        """First words of questions that are answered by yes or no."""
        return frozenset(self.first_words("auxiliary"))


def read_language(code: str) -> Language:
    """Read the file of a language (ISO 639-1)."""
    read = ConfigParser(delimiters=("=",), interpolation=None)
    read.read_dict({"verbs": {}, "language": {"ordinary_verbs": "", "letters": ""}})
    read.read_string((files("socialbot.runs.asking.languages") / f"{code}.ini").read_text("utf-8"))
    forms: dict[str, re.Pattern[str]] = {
        name: re.compile(read["voices"][name]) for name in ("participle", "second") if name in read["voices"]
    }
    words = {name: frozenset(text.split()) for name, text in read["voices"].items() if name not in forms}
    return Language(
        code,
        {name: tuple(_alternatives(text)) for name, text in read["words"].items()},
        {name: text.replace("\n", " ").strip() for name, text in read["sentences"].items()},
        Voices(**words, **forms),  # type: ignore[arg-type]
        {name: text.split() for name, text in read["numbers"].items()},
        {name: text.split() for name, text in read["verbs"].items()},
        frozenset(read["language"]["ordinary_verbs"].split()),
        read["language"]["letters"],
    )


def _alternatives(text: str) -> Iterator[tuple[str, ...]]:
    for each in text.split(","):
        yield from product(*(word.split("/") for word in each.split()))


LANGUAGES = {code: read_language(code) for code in ("en", "de", "fr", "es")}
ENGLISH = LANGUAGES["en"]
