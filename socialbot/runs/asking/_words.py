"""Words of questions: tokens, stems, spelling, numbers, and how alike two words look and sound."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence, Set
from difflib import SequenceMatcher
from functools import cache, lru_cache

from socialbot.runs.asking.languages import ENGLISH, LANGUAGES

ALIKE = 0.72
"""Least similarity of a word that a person wrote or a recogniser heard to a known word."""
FORM = 0.96
"""Least similarity of two forms of a word."""

HEARD = 0.8
"""Similarity of words that sound alike."""

_LETTERS = str.maketrans(
    {"ß": "ss", "æ": "ae", "œ": "oe", "ø": "o", "\u2019": "'", "`": "'", "\u2212": "-", "º": "th", "ª": "th"}
)
_TOKEN = re.compile(r"\d+th\b|(?:(?<!\S)-)?\d+(?::\d\d)?(?:[.,]\d+)?|[a-z]+(?:'[a-z]+)?|[^\W\d_]+")
_CONTRACTIONS = (
    ("can't", "can not"), ("cannot", "can not"), ("won't", "will not"), ("n't", " not"), ("'ve", " have"),
    ("'ll", " will"), ("'d", " would"),
    ("'re", " are"), ("i'm", "i am"), ("gonna", "going to"), ("wanna", "want to"), ("didja", "did you"),
    ("d'you", "do you"), ("dya", "do you"), ("lemme", "let me"), ("gimme", "give me"), ("ain't", "is not"),
    ("y'all", "you"), ("'cause", "because"),
)  # fmt: skip
_UNMARKED = re.compile(
    r"\b(is|are|was|were|do|does|did|has|have|had|could|would|should)nt\b"
    r"|\b(what|who|that|how|where)s\b|\b(what|who|that|how|where|why|when|there|it)'s\b"
)
"""Contraction without a verb of its own: ``didnt``, ``whats``, ``why's``."""
_POSSESSIVE = re.compile(r"(?<=\d)'s\b")
_TIME_SIGN = re.compile(r"\bt ?= ?(?=\d)")
"""``t=11`` as the name of a time."""
_ELIDED = re.compile(r"\b([cdjlmnst]|qu)'(?=\w)")
"""French elision: ``m'as`` is two words, ``m`` and ``as``."""

_ORDINAL = re.compile(r"\b(\d+)(?:st|nd|rd|er|re|eme|e)\b|\b((?:der|die|das|den|dem|zum|beim|am) \d+)\.(?= )")
"""Ordinal in digits, as in English (2nd), French (2e, 1er) and German (``den 2. Besucher``); Spanish has 2º."""

_NAME = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_UNDOTTED = re.compile(r"(?<=\d),(?=\d)")


def folded(text: str) -> str:
    """Return ``text`` in lower case without accents."""
    plain = unicodedata.normalize("NFKD", text.casefold().translate(_LETTERS))
    return "".join(letter for letter in plain if not unicodedata.combining(letter))


def tokens(text: str) -> list[str]:
    """Return the words and numbers of ``text``, without accents and contractions; ``_`` separates words.

    An ordinal in digits ends in ``th`` in each language.
    """
    plain = _TIME_SIGN.sub("second ", folded(text).replace("_", " "))
    plain = _UNMARKED.sub(lambda found: f"{found[1]} not" if found[1] else f"{found[2] or found[3]} is", plain)
    for short, long in _CONTRACTIONS:
        plain = plain.replace(short, long)
    plain = _UNDOTTED.sub(".", _ELIDED.sub(r"\1 ", plain))
    plain = _ORDINAL.sub(r"\1\2th", plain)
    plain = _POSSESSIVE.sub("", plain)
    # "a1" and "room1" are two words, as a recogniser hears them.
    plain = re.sub(r"(?<=[a-z])(?=\d)|(?<=\d)(?=(?!th\b)[a-z])", " ", plain)
    return [token.partition("'")[0] for token in _TOKEN.findall(plain)]


_QUOTED = re.compile(
    r'["\u201c\u201d\u201e\u00ab\u00bb]([^"\u201c\u201d\u201e\u00ab\u00bb]+)["\u201c\u201d\u00ab\u00bb]'
)


def quoted_tokens(text: str) -> tuple[str, ...]:
    """Return the words of the first text between quotation marks; none without them."""
    found = _QUOTED.search(text)
    return () if found is None else tuple(tokens(found[1]))


def name_tokens(name: str) -> list[str]:
    """Return the words of an identifier: ``a_openDoor2`` consists of a, open, door and 2."""
    return [part.casefold() for part in _NAME.findall(name)]


_ENDINGS = ("ings", "ing", "ations", "ation", "ions", "ion", "edly", "ed", "es", "s", "er", "en", "est", "et", "e")
_WEAK_ENDINGS = {"er", "est", "et", "ion", "ions", "ation", "ations"}
"""Endings that are parts of short words: offer, rest, greet."""
_SHORTEST_STEM = 3
_LONG = 6
"""Least length of a stem in which a double l is one: ``patrolled``."""
_SAME_BEGIN = 0.84
"""Least similarity in writing of words that begin with different sounds: ``fall`` is not ``call``."""
_LEAST_WRITTEN = 0.5
"""Least similarity in writing of words that sound alike."""
_IRREGULAR = {
    form: verb
    for verb, forms in {
        "go": "went gone goes going", "do": "did done does doing", "take": "took taken", "drive": "drove driven",
        "give": "gave given", "say": "said", "tell": "told", "see": "saw seen", "get": "got", "come": "came",
        "bring": "brought", "leave": "left", "hold": "held", "begin": "began", "choose": "chose", "make": "made",
        "send": "sent", "find": "found", "speak": "spoke spoken",
        "keep": "kept", "stand": "stood", "let": "letting", "put": "putting", "set": "setting",
    }.items()
    for form in forms.split()
}  # fmt: skip


@lru_cache(maxsize=10_000)
def stem(word: str) -> str:
    """Return a word without its ending, the same for most forms of a verb or noun."""
    word = _IRREGULAR.get(word, word)
    if word.endswith(("ies", "ied")) and len(word) >= _LONG:
        word = f"{word[:-3]}y"  # "verified"
    ending = "s"
    while ending:
        fits = ((each, len(word) - len(each) - (2 if each in _WEAK_ENDINGS else 0)) for each in _ENDINGS)
        found = (each for each, left in fits if word.endswith(each) and left >= _SHORTEST_STEM)
        ending = next(found, "")
        word = word.removesuffix(ending)
    is_doubled = len(word) > _SHORTEST_STEM and word[-1] == word[-2]
    if is_doubled and (word[-1] not in "ls" or (word[-1] == "l" and len(word) >= _LONG)):
        word = word[:-1]
    return word


@cache
def _ordinary_stems() -> frozenset[str]:
    return frozenset(map(stem, ENGLISH.ordinary_verbs))


@lru_cache(maxsize=10_000)
def is_ordinary_verb(word: str) -> bool:
    """Return whether a word is a form of an ordinary English verb, which resembles other words by chance only."""
    return stem(word) in _ordinary_stems()


_SOUNDS = (
    ("sch", "x"), ("tch", "x"), ("ch", "x"), ("sh", "x"), ("ph", "f"), ("gh", ""), ("th", "t"), ("wh", "w"),
    ("ck", "k"), ("qu", "k"), ("kn", "n"), ("wr", "r"),
)  # fmt: skip
_LETTER_SOUNDS = str.maketrans("gcqdbvzjy", "kkktpfsxi")


@lru_cache(maxsize=10_000)
def sound(word: str) -> str:
    """Return the consonants of a word; voiced and voiceless ones are equal, a last r is silent."""
    for letters, one in _SOUNDS:
        word = word.replace(letters, one)
    word = word.translate(_LETTER_SOUNDS)
    consonants = word[:1] + re.sub(r"[aeiouhw]|r$", "", word[1:])
    return re.sub(r"(.)\1+", r"\1", consonants)


@lru_cache(maxsize=10_000)
def _letters(word: str) -> tuple[tuple[str, int], ...]:
    """Return the letters of a word, and how often it has each."""
    return tuple(Counter(word).items())


def _most_alike(one: str, other: str) -> float:
    """Return a bound of how alike two words are written: the share of their letters that are common."""
    common = 0
    for letter, count in _letters(one):
        if letter in other:
            common += min(count, other.count(letter)) if count > 1 else 1
    return 2.0 * common / (len(one) + len(other))


@lru_cache(maxsize=50_000)
def similarity(one: str, other: str) -> float:
    """Return how alike a word of a question is to a known one, from 0 to 1.

    They are equal, of one stem, written alike, or sound alike; an ordinary verb is only like its own forms.
    """
    if one == other:
        return 1.0
    if one.isdigit() or other.isdigit():
        return 0.0
    if stem(one) == stem(other):
        return 0.97
    if min(len(one), len(other)) < _SHORTEST_STEM or is_ordinary_verb(one):
        return 0.0
    pairs = ((one, other), (stem(one), stem(other)))
    if sum(_most_alike(*pair) for pair in pairs) < 2 * _LEAST_WRITTEN:
        return 0.0
    written = sum(SequenceMatcher(None, *pair, autojunk=False).ratio() for pair in pairs) / 2
    sounds_alike = len(sound(one)) > 1 and sound(one) == sound(other)
    if sound(one)[:1] != sound(other)[:1] and written < _SAME_BEGIN:
        return min(written, ALIKE - 0.01)
    heard = HEARD if sounds_alike and written > _LEAST_WRITTEN else 0.0
    return min(0.95, max(written, heard))


_SHORT = 6
"""Length from which on a word may have a wrong letter or one too many."""
_SHORTEST = 4
"""Length from which on a word may lack a letter; in shorter ones letters may be swapped."""
_LEAST = 3


@lru_cache(maxsize=32)
def _stems(words: frozenset[str]) -> frozenset[str]:
    return frozenset(map(stem, words))


def corrected(word: str, known: Set[str], names: Set[str], asking: Set[str] = frozenset()) -> str:
    """Return a mistyped word as it is written, or the word itself if it is known or resembles no word alone.

    Args:
        word: A word that a person typed.
        known: Words of the language and of the deeds.
        names: Words of names, which are never changed.
        asking: Words of questions, which are expected most: short ones may have a wrong letter, too.
    """
    if len(word) < _LEAST or not word.isalpha() or word in known or word in names or is_ordinary_verb(word):
        return word
    swapped = {each for each in _swapped(word) if each in known}
    if swapped:
        return min(swapped)
    alike = [each for each in known if each[0] == word[0] and abs(len(each) - len(word)) <= 1 and _is_near(word, each)]
    for difference, shortest in ((1, _SHORTEST), (0, _SHORT), (-1, _SHORT)):  # missing, wrong, too many
        if difference < 0 and stem(word) in _stems(frozenset(known)):
            return word
        near = [each for each in alike if len(each) - len(word) == difference]
        if near and len(word) >= shortest:
            return min(near) if len({stem(each) for each in near}) == 1 else word
    asked = {each for each in asking if each[0] == word[0] and len(each) >= len(word) and _is_near(word, each)}
    return asked.pop() if len(asked) == 1 else word


def _swapped(word: str) -> set[str]:
    return {word[:n] + word[n + 1] + word[n] + word[n + 2 :] for n in range(len(word) - 1)}


def _is_near(one: str, other: str) -> bool:
    """Return whether two words differ by one letter that is missing, or that another one replaces."""
    short, long = sorted((one, other), key=len)
    begin = next((n for n, letter in enumerate(short) if letter != long[n]), len(short))
    rest = long[begin + 1 :]
    return short[begin:] == rest or (len(short) == len(long) and short[begin + 1 :] == rest)


def starts(phrase: Sequence[str], words: Sequence[str]) -> list[int]:
    """Return the places where a phrase begins in these very words."""
    return [n for n in range(len(words)) if is_at(phrase, words, n)]


def is_at(phrase: Sequence[str], words: Sequence[str], place: int) -> bool:
    """Return whether a phrase is at a place in these very words."""
    return tuple(words[place : place + len(phrase)]) == tuple(phrase)


def occurrences(
    phrase: Sequence[str], words: Sequence[str], most_between: int
) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield where ``phrase`` occurs in ``words``, as `likeness` has it, each place once."""
    begin = 0
    while begin < len(words):
        alike, places = likeness(phrase, words[begin:], most_between)
        if not places:
            return
        yield alike, tuple(begin + place for place in places)
        begin += places[0] + 1


def likeness(phrase: Sequence[str], words: Sequence[str], most_between: int = 2) -> tuple[float, tuple[int, ...]]:
    """Return how well ``phrase`` occurs in ``words``, in order with few words between, and the places of its words."""
    best: tuple[float, tuple[int, ...]] = 0.0, ()
    for start, first in enumerate(words):
        least = similarity(first, phrase[0])
        if least < ALIKE or least <= best[0]:
            continue
        places, at = [start], start + 1
        for wanted in phrase[1:]:
            reach = range(at, min(len(words), at + 1 + most_between))
            found = max(reach, key=lambda place: (similarity(words[place], wanted), -place), default=None)
            alike = 0.0 if found is None else similarity(words[found], wanted)
            if found is None or alike < ALIKE:
                break
            places.append(found)
            least, at = min(least, alike), found + 1
        else:
            if least > best[0]:
                best = least, tuple(places)
    return best


_NUMBERS = [language.numbers for language in LANGUAGES.values()]
_UNITS = {word: number for each in _NUMBERS for number, word in enumerate(each["units"])}
_UNITS |= {word: 1 for each in _NUMBERS for word in each.get("one", ())}
_TENS = {word: 10 * number for each in _NUMBERS for number, word in enumerate(each["tens"], 2)}
NUMBER_WORDS = frozenset((*_UNITS, *_TENS))
"""Words of numbers."""
_HUNDREDS = {word for each in _NUMBERS for word in each["hundred"]}
_GERMAN = re.compile(rf"({'|'.join(_UNITS)})und({'|'.join(_TENS)})")
_POINTS = {"point", "komma", "virgule", "coma", "punto"}


def number_at(words: Sequence[str], place: int) -> tuple[float, int] | None:
    """Return the number that begins at a place, in digits or words, and how many words it takes; None without one.

    More than twelve digits are no number that anybody asks for.
    """
    word = words[place]
    if re.fullmatch(r"\d{1,12}:\d\d(\.\d+)?", word):
        minutes, _, seconds = word.partition(":")
        return int(minutes) * 60 + float(seconds), 1
    if re.fullmatch(r"-?\d{1,12}(\.\d+)?", word):
        rest = "".join(words[place + 1 : place + 2])
        if re.fullmatch(r"[1-9]00", word) and re.fullmatch(r"[1-9]\d?", rest):
            return float(word) + float(rest), 2  # "100 1", as a recogniser writes 101
        return _with_point(float(word), words, place + 1, 1)
    german = _GERMAN.fullmatch(word)
    if german:
        return _with_point(float(_TENS[german[2]] + _UNITS[german[1]]), words, place + 1, 1)
    total, used = 0, 0
    for each in words[place : place + 4]:
        if each in _HUNDREDS:
            total = max(total, 1) * 100
        elif each in _TENS and total % 100 == 0:
            total += _TENS[each]
        elif each in _UNITS and (total % 10 == 0 or (total % 100 in (60, 80) and _UNITS[each] < 20)) and used < 3:
            total += _UNITS[each]
        elif not (each in ("and", "et", "y", "und") and used and place + used + 1 < len(words)):
            break
        used += 1
    while used and words[place + used - 1] in ("and", "et", "y", "und"):
        used -= 1
    return _with_point(float(total), words, place + used, used) if used else None


_ORDINALS = {word: number for each in _NUMBERS for number, word in enumerate(each["ordinals"], 3)}


def ordinal_at(words: Sequence[str], place: int, units: Container[str]) -> tuple[float, int] | None:
    """Return the number of an ordinal before a unit of time: ``the eleventh second``, ``the 30th second``."""
    following = words[place + 1] if place + 1 < len(words) else ""
    number = _ORDINALS.get(words[place]) or ordinal_in_digits(words[place])
    return (float(number), 1) if number is not None and following in units else None


def ordinal_in_digits(word: str) -> int | None:
    """Return the number of an ordinal in digits, as `tokens` writes it: ``2th``; None for other words."""
    return int(word[:-2]) or None if re.fullmatch(r"\d{1,12}th", word) else None


_FRACTIONS = {
    "half": 0.5, "halbe": 0.5, "halben": 0.5, "demi": 0.5, "medio": 0.5, "media": 0.5, "quarter": 0.25,
    "viertel": 0.25, "quart": 0.25, "cuarto": 0.25,
}  # fmt: skip
_OF_A = (["of", "a"], ["einer"], ["de"], ["de", "una"], ["d", "une"], ["a"], ["an"])


def fraction_at(words: Sequence[str], place: int, units: Container[str]) -> tuple[float, int] | None:
    """Return a fraction before a unit of time, ``half a minute``, and how many words it takes."""
    if words[place] not in _FRACTIONS:
        return None
    between = (len(one) for one in _OF_A if list(words[place + 1 : place + 1 + len(one)]) == one)
    used = 1 + max(between, default=0)
    following = words[place + used] if place + used < len(words) else ""
    return (_FRACTIONS[words[place]], used) if following in units else None


def _with_point(number: float, words: Sequence[str], place: int, used: int) -> tuple[float, int]:
    if number.is_integer() and place + 1 < len(words) and words[place] in _POINTS:
        digit = words[place + 1]
        value = int(digit) if re.fullmatch(r"\d", digit) else _UNITS.get(digit)
        if value is not None and value < 10:
            return number + value / 10, used + 2
    return number, used


def digits(words: Iterable[str]) -> list[str]:
    """Return words with number words as digits: ``room one`` as room and 1."""
    return [str(_UNITS[word]) if word in _UNITS else word for word in words]
