"""Intents of spoken sentences, by phrases with slots in several languages.

>>> grammar = Grammar(
...     [Intent("directions", ("place",), {"en": ["where is [the] {place}"], "de": ["wo ist [die|das] {place}"]})],
...     {"place": {"library": {"en": ["library", "reading room"], "de": ["Bibliothek"]}}},
... )
>>> grammar.read("Excuse me, where's the libary?", "en").slots
('library',)
>>> grammar.read("Wo ist die Bibliothek?", "de").slots
('library',)
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from socialbot.agents.dialogue._templates import Extra, Part, Slot, expand, words
from socialbot.core.errors import RuleError, suggestion
from socialbot.core.limits import READ_WORDS

UNKNOWN = "unknown"
"""Intent of a sentence that no phrase matches."""

TEXT = "text"
"""Slot that takes any words up to the end of the clause; an intent may leave it out of its slots."""

LEAST_SIMILARITY = 0.8
"""Words and slot values match from this similarity on: one wrong letter in five."""

_WORDS_KEPT = 5_000  # words of people for which the similar words of phrases are remembered

LEAST_SCORE = 0.75
"""Phrases match from this share of their words on, each weighted by its similarity."""

LEAST_SCORE_FREE = 0.92
"""The same for phrases with a free text."""

LEAST_SCORE_URGENT = 0.88
"""The same for phrases of urgent intents: a false alarm sends people away."""

SHORT_WORDS, MUCH_LEFT = 2, 6
"""A match of so few words must be exact beside so many others, unless it is urgent or expected."""

_EXTRA_WORD = 0.25  # cost of a word between those of a phrase; a missing word costs 1
_FREE_WORD = 0.75  # what a word of a free text counts less than a word of a phrase
_JOINED = 0.05  # what a name counts less that is split or joined differently
_LONGEST_TEXT = 12

NEGATIONS = {
    "en": {"not", "never", "no"},
    "de": {"nicht", "kein", "keine", "keinen", "nie", "nein"},
    "es": {"no", "nunca", "tampoco"},
    "fr": {"pas", "jamais", "non", "ne"},
}
"""Words that exclude the phrase or slot value after them in the same clause."""

_BETWEEN = {
    "en": "the a an to at in into my your for want need mean looking go going",
    "de": "der die das den dem ein eine einen zu zum zur in im ins nach fur",
    "es": "el la los las un una al a de del en para quiero",
    "fr": "le la les l un une au aux a de du des en pour je veux",
}
"""Words that may stand between a negation and the value that it excludes."""

_COURTESIES = {
    "en": "please excuse me sorry um uh er well hello hi hey okay ok so and oh yes yeah no thanks thank you then",
    "de": "bitte entschuldigung entschuldigen sie ah also hallo okay ok und oh ja nein danke dann mal",
    "es": "por favor perdone perdon eh pues hola vale y oh si no gracias entonces",
    "fr": "s il vous plait excusez moi pardon euh alors bonjour d accord et oh oui non merci",
}
"""Words beside a phrase that is the whole sentence."""

_COURTEOUS = {language: frozenset(text.split()) for language, text in _COURTESIES.items()}

_TRANSPARENT = {language: frozenset(text.split()) for language, text in _BETWEEN.items()}


@dataclass(frozen=True)
class Intent:
    """Intention of a speaker that a rule can react to.

    Args:
        name: Its name in ``heard(Person, Intent, Slots)``.
        slots: Names of its slots; a slot that a phrase lacks is "".
        phrases: Phrases by language (ISO 639-1), as in ``{"en": ["where is [the] {place}"]}``.
        only_expected: Whether it is only understood as the reply to a question that expects it.
        fallback: Whether it is only understood if no other intent is.
        urgent: Whether it is understood before all others, as an emergency is.
    """

    name: str
    slots: tuple[str, ...] = ()
    phrases: Mapping[str, Sequence[str]] = field(default_factory=dict)
    only_expected: bool = False
    fallback: bool = False
    urgent: bool = False

    @functools.cached_property
    def variants(self) -> dict[str, tuple[Variant, ...]]:
        """Word sequences of the phrases by language. Raises RuleError for an invalid phrase or an unknown slot."""
        return {
            language: tuple(variant for phrase in phrases for variant in self._variants_of(phrase, language))
            for language, phrases in self.phrases.items()
        }

    def _variants_of(self, phrase: str, language: str) -> list[Variant]:
        where = f"intent {self.name}, {language}"
        is_whole = phrase.startswith("^") and phrase.endswith("$")
        variants = expand(phrase[1:-1] if is_whole else phrase, language, where)
        used = {part.name for variant in variants for part in variant if isinstance(part, Slot)}
        if unknown := sorted(used - {*self.slots, TEXT}):
            remedy = suggestion(unknown[0], self.slots)
            raise RuleError(f"phrase {phrase!r} has the unknown slot {unknown[0]!r}", where=where, remedy=remedy)
        return [Variant(self, phrase, variant, is_whole) for variant in variants]


@dataclass(frozen=True)
class Reading:
    """Interpretation of one sentence.

    ``slots`` are in the order of the intent. ``rejected`` are values that the speaker excluded, as in "not the
    library". ``score`` is the share of the ``phrase`` that matches, ``words`` the number of words of the sentence that
    it takes, and ``left`` that of the others, without courtesies and excluded values.
    """

    intent: str
    slots: tuple[str, ...] = ()
    language: str = ""
    score: float = 0.0
    words: int = 0
    phrase: str = ""
    rejected: tuple[str, ...] = ()
    left: int = 0

    def __bool__(self) -> bool:
        return self.intent != UNKNOWN


class _Span(NamedTuple):
    """Words of a sentence from ``start`` to ``end`` that name a value."""

    start: int
    end: int
    value: str
    similarity: float


@dataclass(frozen=True)
class Variant:
    """Word sequence of a phrase of an intent."""

    intent: Intent
    phrase: str
    parts: tuple[Part, ...]
    is_whole: bool = False

    @functools.cached_property
    def most_cost(self) -> float:
        """Highest cost of a match; a word that is missing costs 1."""
        free = LEAST_SCORE_FREE if Slot(TEXT) in self.parts else LEAST_SCORE
        return (1 - (LEAST_SCORE_URGENT if self.intent.urgent else free)) * _size(self.parts) + 1e-9


class _Match(NamedTuple):
    """Alignment of a phrase with a sentence; the order prefers low costs, then many words."""

    cost: float
    words: int
    start: int
    end: int
    slots: tuple[tuple[str, str], ...] = ()

    @property
    def rank(self) -> tuple[float, int]:
        return (self.cost, -self.words)


class Grammar:
    """Phrases of intents in several languages.

    Args:
        intents: The intents; of equally good ones the first counts.
        values: Values by slot: value to its names by language. The first name is shown.

    Raises:
        RuleError: A phrase is invalid, or a slot or value is not declared.
    """

    def __init__(
        self, intents: Iterable[Intent], values: Mapping[str, Mapping[str, Mapping[str, Sequence[str]]]] | None = None
    ) -> None:
        self.intents = {intent.name: intent for intent in intents}
        self.values = {name: dict(known) for name, known in (values or {}).items()}
        self._variants: dict[str, list[Variant]] = {}
        for intent in self.intents.values():
            self._check_slots(intent)
            for language, variants in intent.variants.items():
                self._variants.setdefault(language, []).extend(variants)
        self._alike = functools.lru_cache(_WORDS_KEPT)(self._like)

    @functools.cached_property
    def _words(self) -> dict[str, set[str]]:
        """Words of the phrases by language."""
        return {
            language: {part for variant in variants for part in variant.parts if isinstance(part, str)}
            for language, variants in self._variants.items()
        }

    @functools.cached_property
    def _names(self) -> dict[tuple[str, str], list[tuple[str, int, str]]]:
        """Names of the values by slot and language: without spaces, the number of words, and the value."""
        return {
            (slot, language): [
                ("".join(itertools.chain(*words(name, language))), len(name.split()), value)
                for value, by_language in known.items()
                for name in by_language.get(language, ())
            ]
            for slot, known in self.values.items()
            for language in self._variants
        }

    @property
    def languages(self) -> tuple[str, ...]:
        """Languages with at least one phrase."""
        return tuple(self._variants)

    def variants(self, language: str) -> tuple[Variant, ...]:
        """Word sequences of all phrases in a language."""
        return tuple(self._variants.get(language, ()))

    def name_of(self, value: str, language: str) -> str:
        """Return the first name of a slot value in a language, or else in any; other texts are returned as they are."""
        for known in self.values.values():
            if names := known.get(value):
                return next(iter(names.get(language) or next(iter(names.values()), ())), value)
        return value

    def is_urgent(self, name: str) -> bool:
        """Whether an intent of this name is urgent."""
        return name in self.intents and self.intents[name].urgent

    def read(self, text: str, language: str, expected: Collection[str] = ()) -> Reading:
        """Interpret a sentence.

        Args:
            text: The sentence, as recognized.
            language: Its language.
            expected: Intents that an open question expects; they win over equally good ones.

        Returns:
            The reading with the most matching words; its intent is `UNKNOWN` if none scores `LEAST_SCORE`, or if the
            sentence has more than `READ_WORDS` words.
        """
        clauses = words(text, language)
        if sum(map(len, clauses)) > READ_WORDS:
            return Reading(UNKNOWN, language=language)
        starts = set(itertools.accumulate(map(len, clauses)))
        sentence = [word for clause in clauses for word in clause]
        spans, excluded = self._spans(sentence, starts, language)
        rejected = tuple(dict.fromkeys(span.value for span in excluded))
        beside = _beside(sentence, excluded, language)
        best, best_rank = Reading(UNKNOWN, language=language, rejected=rejected), (False, False, 0.0, False, 0.0)
        unlike = self._words.get(language, set()).difference(*(self._alike(word, language) for word in sentence))
        for variant in self._variants.get(language, ()):
            if len(unlike.intersection(variant.parts)) > variant.most_cost:
                continue
            is_expected = variant.intent.name in expected
            if variant.intent.only_expected and not is_expected:
                continue
            match = _align(variant, sentence, starts, spans)
            if match is None:
                continue
            score = 1 - match.cost / _size(variant.parts)
            free = sum(len(value.split()) for name, value in match.slots if name == TEXT)
            taken = match.words - _FREE_WORD * free - match.cost
            rank = (variant.intent.urgent, not variant.intent.fallback, taken, is_expected, score)
            if rank <= best_rank or _is_negated(variant, match, sentence, starts, language):
                continue
            left = len(beside.difference(range(match.start, match.end)))
            if variant.is_whole and left:
                continue
            is_weak = score < 1 and match.words <= SHORT_WORDS and left >= MUCH_LEFT
            if is_weak and not variant.intent.urgent and not is_expected:
                continue
            slots = dict(match.slots)
            filled = tuple(slots.get(name, "") for name in variant.intent.slots)
            best, best_rank = (
                Reading(
                    variant.intent.name, filled, language, round(score, 3), match.words, variant.phrase, rejected, left
                ),
                rank,
            )  # fmt: skip
        affirmed = [clause for clause in clauses if not NEGATIONS.get(language, frozenset()).intersection(clause)]
        if not best and 0 < len(affirmed) < len(clauses):  # "Do not call Anna, call Thomas."
            return self.read(". ".join(map(" ".join, affirmed)), language, expected)
        return best

    def _like(self, word: str, language: str) -> frozenset[str]:
        """Words of phrases that resemble a word of a sentence."""
        known = self._words.get(language, ())
        return frozenset(each for each in known if similarity(each, word) >= LEAST_SIMILARITY)

    def _check_slots(self, intent: Intent) -> None:
        for name in intent.slots:
            if name != TEXT and name not in self.values:
                remedy = suggestion(name, (*self.values, TEXT))
                raise RuleError(f"slot {name!r} has no values", where=f"intent {intent.name}", remedy=remedy)

    def _spans(
        self, sentence: Sequence[str], starts: Collection[int], language: str
    ) -> tuple[dict[str, list[_Span]], list[_Span]]:
        """Values of each slot in a sentence, and those that it excludes."""
        found: dict[str, list[_Span]] = {}
        rejected: list[_Span] = []
        for slot in self.values:
            spans = _named(self._names.get((slot, language), ()), sentence, starts)
            found[slot] = [span for span in spans if not _follows_negation(span.start, sentence, starts, language)]
            rejected += (span for span in spans if span not in found[slot])
        return found, rejected


def negations_in(text: str, language: str) -> list[str]:
    """Return the negations in a text."""
    known = NEGATIONS.get(language, frozenset())
    return [word for clause in words(text, language) for word in clause if word in known]


def _beside(sentence: Sequence[str], excluded: Iterable[_Span], language: str) -> set[int]:
    """Places of the words that are no courtesies, no negations and no excluded values."""
    small = _COURTEOUS.get(language, frozenset()) | NEGATIONS.get(language, frozenset())
    small |= _TRANSPARENT.get(language, frozenset())
    out = {place for span in excluded for place in range(span.start, span.end)}
    return {place for place, word in enumerate(sentence) if word not in small and place not in out}


_DOUBLED = re.compile(r"(.)\1")


@functools.lru_cache(1_000)
def _undoubled(word: str) -> str:
    return _DOUBLED.sub(r"\1", word)


@functools.lru_cache(10_000)
def _letters(word: str) -> frozenset[str]:
    return frozenset(word)


@functools.lru_cache(100_000)
def similarity(one: str, other: str) -> float:
    """Similarity of two words from 0 to 1: the share of letters without an insertion, removal, change or swap.

    Doubled letters count once.

    >>> similarity("library", "libary") > 0.8
    True
    """
    one, other = _undoubled(one), _undoubled(other)
    longest = max(len(one), len(other))
    if one == other or not longest:
        return 1.0
    if abs(len(one) - len(other)) > (1 - LEAST_SIMILARITY) * longest + 1e-9:
        return 0.0
    most = (1 - LEAST_SIMILARITY + _JOINED) * longest + 1e-9
    if max(len(_letters(one) - _letters(other)), len(_letters(other) - _letters(one))) > most:
        return 0.0  # each change brings one missing letter at most
    before, row = [0] * (len(other) + 1), list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        previous, row = row, [i]
        for j, other_letter in enumerate(other, 1):
            cost = min(previous[j] + 1, row[-1] + 1, previous[j - 1] + (letter != other_letter))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == other_letter:
                cost = min(cost, before[j - 2] + 1)
            row.append(cost)
        before = previous
    return 1 - row[-1] / longest


def _named(names: Iterable[tuple[str, int, str]], sentence: Sequence[str], starts: Collection[int]) -> list[_Span]:
    """The most similar values in a sentence, without overlaps; names may be split or joined differently."""
    spans: list[tuple[float, _Span]] = []
    joined: dict[int, list[tuple[int, str]]] = {}  # by number of words
    for name, count, value in names:
        for length in range(max(1, count - 1), count + 2):
            if length not in joined:
                joined[length] = [
                    (start, "".join(sentence[start : start + length]))
                    for start in range(len(sentence) - length + 1)
                    if not any(start < at < start + length for at in starts)
                ]
            for start, text in joined[length]:
                alike = similarity(name, text) - (_JOINED if length != count else 0.0)
                if alike >= LEAST_SIMILARITY - _JOINED:
                    spans.append((-count * alike, _Span(start, start + length, value, alike)))
    chosen: list[_Span] = []
    for _, span in sorted(spans):
        if all(span.end <= other.start or span.start >= other.end for other in chosen):
            chosen.append(span)
    return sorted(chosen)


def _size(parts: Sequence[Part]) -> int:
    """Number of parts that a phrase must have: a value counts twice, an optional word or a free text not at all."""
    return max(sum(_weight(part) for part in parts), 1)


def _weight(part: Part) -> int:
    if isinstance(part, str):
        return 0 if isinstance(part, Extra) else 1
    return 0 if part.name == TEXT else 2


def _align(
    variant: Variant, sentence: Sequence[str], starts: Collection[int], spans: Mapping[str, Sequence[_Span]]
) -> _Match | None:
    """The best alignment of all parts with some words of the sentence, in order; None without one."""
    size, parts = len(sentence), variant.parts
    most = variant.most_cost
    row: list[_Match | None] = [_Match(0.0, 0, at, at) for at in range(size + 1)]  # at: number of words consumed
    for number, part in enumerate(parts):
        after: list[_Match | None] = [None] * (size + 1)
        for at, match in enumerate(row):
            if match is None or match.cost > most:
                continue
            for end, cost, slot in _steps(part, at, sentence, starts, spans):
                start = match.start if match.words else at if end > at else match.start
                filled = match.slots if slot is None else (*match.slots, slot)
                _keep(after, end, _Match(match.cost + cost, match.words + (end - at), start, end, filled))
        if number < len(parts) - 1:
            for at in range(size):  # extra words between the parts
                if (match := after[at]) is not None and match.words:
                    _keep(after, at + 1, match._replace(cost=match.cost + _EXTRA_WORD, end=at + 1))
        row = after
    ends = [match for match in row if match is not None and match.words and match.cost <= most]
    return min(ends, key=lambda match: match.rank, default=None)


def _keep(row: list[_Match | None], at: int, match: _Match) -> None:
    known = row[at]
    if known is None or match.rank < known.rank:
        row[at] = match


def _steps(
    part: Part, at: int, sentence: Sequence[str], starts: Collection[int], spans: Mapping[str, Sequence[_Span]]
) -> Iterator[tuple[int, float, tuple[str, str] | None]]:
    """Ways to continue an alignment with one part: number of words consumed then, cost, and filled slot."""
    if isinstance(part, str):
        yield at, 1.0, None
        if at < len(sentence) and (alike := similarity(part, sentence[at])) >= LEAST_SIMILARITY:
            yield at + 1, 1 - alike, None
    elif part.name == TEXT:
        for end in range(at + 1, min(at + _LONGEST_TEXT, len(sentence)) + 1):
            yield end, 0.0, (TEXT, " ".join(sentence[at:end]))
            if end in starts:
                break
    else:
        for span in spans.get(part.name, ()):
            if span.start == at:
                yield span.end, 1 - span.similarity, (part.name, span.value)


def _is_negated(
    variant: Variant, match: _Match, sentence: Sequence[str], starts: Collection[int], language: str
) -> bool:
    """Whether a negation that is no part of the phrase stands before it, in it, or directly after it.

    Examples: "do not call Anna", "n'appelez pas Anna", "rufen Sie Anna nicht an".
    """
    negations = NEGATIONS.get(language, frozenset())
    if any(part in negations for part in variant.parts if isinstance(part, str)):
        return False
    if _follows_negation(match.start, sentence, starts, language):
        return True
    texts = {value for name, value in match.slots if name == TEXT}
    inside = sentence[match.start : match.end] if not texts else ()
    after = sentence[match.end : match.end + 1] if match.end not in starts else ()
    return any(word in negations for word in (*inside, *after))


def _follows_negation(at: int, sentence: Sequence[str], starts: Collection[int], language: str) -> bool:
    """Whether a negation excludes the value that starts ``at``: only articles and the like stand between them."""
    negations, between = NEGATIONS.get(language, frozenset()), _TRANSPARENT.get(language, frozenset())
    while at > 0 and at not in starts:
        at -= 1
        if sentence[at] in negations:
            return True
        if sentence[at] not in between:
            return False
    return False
