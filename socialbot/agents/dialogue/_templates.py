"""Phrase templates: ``where is [the] {place}``, with optional parts, alternatives and slots."""

from __future__ import annotations

import functools
import itertools
import re
import unicodedata
from collections.abc import Iterator
from typing import NamedTuple

from socialbot.core.errors import RuleError

MOST_VARIANTS = 512
"""Maximum number of word sequences of one phrase."""

MOST_BRACKETS = 20
"""Maximum number of brackets in each other."""

_PART = re.compile(r"\s*(?:(?P<slot>\{(\w+)\})|(?P<sign>[][()|])|(?P<word>[^][(){}|\s]+)|(?P<bad>.))")
_SHORT_FORMS = {
    "n't": " not", "'re": " are", "'m": " am", "'ll": " will", "'ve": " have", "'d": " would", "'s": " is",
}  # fmt: skip
_ENGLISH_SHORT = re.compile(r"(?<=\w)(n't|'re|'m|'ll|'ve|'d|'s)\b")
_WORD = re.compile(r"\d+(?:[.,:]\d+)+|\w+")  # a time, decimal or room such as 2.15 is one word
_CLAUSE_END = re.compile(
    r"(?:(?<!\d)[.,:]|[.,:](?!\d)|[;!?\u00bf\u00a1\u2026])[,.;:!?\u00bf\u00a1\u2026]*|\s[-\u2013\u2014]+\s"
)
_IRREGULAR = {"can't": "can not", "won't": "will not", "cannot": "can not"}
_TITLES = {
    "en": {"dr": "doctor", "mr": "mister", "mrs": "missis", "ms": "miss", "prof": "professor"},
    "de": {"dr": "doktor", "prof": "professor"},
    "es": {"dr": "doctor", "dra": "doctora", "sr": "senor", "sra": "senora"},
    "fr": {"dr": "docteur", "m": "monsieur", "mr": "monsieur", "mme": "madame", "pr": "professeur"},
}
_NUMBERS: dict[str, str] = {
    word: str(number)
    for line in (
        "two three four five six seven eight nine ten eleven twelve",
        "zwei drei vier funf sechs sieben acht neun zehn elf zwolf",
        "dos tres cuatro cinco seis siete ocho nueve diez once doce",
        "deux trois quatre cinq six sept huit neuf dix onze douze",
    )
    for number, word in enumerate(line.split(), 2)
}


class Slot(NamedTuple):
    """Place of a value in a phrase."""

    name: str


class Extra(str):
    """Optional word of a phrase. It does not count toward the share of the phrase that matches."""

    __slots__ = ()


Part = str | Slot
"""Word or slot of a phrase."""


def words(text: str, language: str = "") -> list[list[str]]:
    """Split ``text`` into clauses of normalized words, as people write and recognisers spell the same speech.

    Words are in lower case, without accents, punctuation and short forms. Titles are written out, small numbers are
    digits.

    >>> words("No, where's the Café?", "en")
    [['no'], ['where', 'is', 'the', 'cafe']]
    >>> words("Dr. Miller, room twelve", "en")
    [['doctor', 'miller'], ['room', '12']]
    """
    text = unicodedata.normalize("NFKC", text).casefold().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    titles = _TITLES.get(language, {})
    if titles:
        # A single letter is only a title with its dot.
        known = rf"(?<![\w'])({'|'.join(titles)})(?:\.\s*|(?<=\w\w)\s+)(?=\w)"
        text = re.sub(known, lambda found: f"{titles[found[1]]} ", text)
    if language in ("en", ""):
        text = re.sub(r"\b(can't|won't|cannot)\b", lambda found: _IRREGULAR[found[1]], text)
        text = _ENGLISH_SHORT.sub(lambda found: _SHORT_FORMS[found[1]], text)
    flat = "".join(one for one in unicodedata.normalize("NFKD", text) if not unicodedata.combining(one))
    clauses = (_WORD.findall(clause) for clause in _CLAUSE_END.split(flat))
    return [[_NUMBERS.get(word) or word for word in clause] for clause in clauses if clause]


@functools.lru_cache(10_000)  # each script that extends another one expands its phrases again
def expand(phrase: str, language: str, where: str) -> tuple[tuple[Part, ...], ...]:
    """Return all word sequences of a phrase.

    Args:
        phrase: Words, ``{slot}``, ``[optional]`` and ``(one|other)``.
        language: The language of its words.
        where: The place of the phrase, for errors.

    Raises:
        RuleError: The phrase has no words, unbalanced brackets, or too many variants.

    >>> expand("where is [the] {place}", "en", "")
    (('where', 'is', Slot(name='place')), ('where', 'is', 'the', Slot(name='place')))
    """
    # Short forms would be split at the apostrophe only after brackets are read.
    found = [match for match in _PART.finditer(phrase) if match[0].strip()]
    reader = _Reader(found, phrase, language, where)
    variants = tuple(dict.fromkeys(itertools.islice(reader.read(), MOST_VARIANTS + 1)))
    if len(variants) > MOST_VARIANTS:
        raise RuleError(f"phrase {phrase!r} has too many variants", where=where, remedy="split it into several phrases")
    if not all(variants):
        remedy = "leave a word or a slot outside of the brackets"
        raise RuleError(f"phrase {phrase!r} can be empty", where=where, remedy=remedy)
    return variants


class _Reader:
    """Recursive reader of one phrase."""

    def __init__(self, parts: list[re.Match[str]], phrase: str, language: str, where: str) -> None:
        self._parts, self._phrase, self._language, self._where = parts, phrase, language, where
        self._at = self._depth = 0

    def read(self) -> Iterator[tuple[Part, ...]]:
        variants = self._alternatives("")
        if self._at < len(self._parts):
            raise self._error(f"has {self._parts[self._at][0].strip()!r} without its other bracket")
        return iter(variants)

    def _alternatives(self, end: str) -> list[tuple[Part, ...]]:
        self._depth += 1
        if self._depth > MOST_BRACKETS:
            raise self._error(f"nests brackets more than {MOST_BRACKETS} deep")
        found: list[tuple[Part, ...]] = []
        while True:
            found += self._sequence()
            sign = self._next_sign()
            if sign != "|":
                break
            self._at += 1
        if end:
            if sign != end:
                raise self._error(f"lacks {end!r}")
            self._at += 1
        self._depth -= 1
        return found

    def _sequence(self) -> list[tuple[Part, ...]]:
        variants: list[tuple[Part, ...]] = [()]
        while self._at < len(self._parts) and self._next_sign() not in ("|", ")", "]"):
            match = self._parts[self._at]
            self._at += 1
            if match["bad"]:
                raise self._error(f"has an invalid {match['bad']!r}")
            if match["slot"]:
                options: list[tuple[Part, ...]] = [(Slot(match[2]),)]
            elif match["sign"]:
                options = self._alternatives(")" if match["sign"] == "(" else "]")
                if match["sign"] == "[":
                    options = [
                        (),
                        *(tuple(Extra(one) if isinstance(one, str) else one for one in each) for each in options),
                    ]
            else:
                options = [tuple(itertools.chain(*words(match["word"], self._language)))]
            variants = [(*before, *more) for before in variants for more in options]
            if len(variants) > MOST_VARIANTS:
                raise self._error("has too many variants", "split it into several phrases")
        return variants

    def _next_sign(self) -> str:
        return self._parts[self._at]["sign"] or "" if self._at < len(self._parts) else ""

    def _error(self, what: str, remedy: str = "write it as in: where is [the] (lift|elevator)") -> RuleError:
        return RuleError(f"phrase {self._phrase!r} {what}", where=self._where, remedy=remedy)
