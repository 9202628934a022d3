"""Spelling of the words of a question."""

from __future__ import annotations

from collections.abc import Set

from socialbot.runs.asking._words import is_ordinary_verb, stem

_SHORT = 6
"""Length from which on a word may have a wrong letter or one too many."""
_SHORTEST = 4
"""Length from which on a word may lack a letter; in shorter ones letters may be swapped."""
_LEAST = 3


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
        if difference < 0 and any(stem(word) == stem(each) for each in known):
            return word
        near = [each for each in alike if len(each) - len(word) == difference]
        if near and len(word) >= shortest:
            return min(near) if len({stem(each) for each in near}) == 1 else word
    asked = {each for each in asking if each[0] == word[0] and len(each) >= len(word) and _is_near(word, each)}
    return asked.pop() if len(asked) == 1 else word


def _swapped(word: str) -> set[str]:
    """Return the word with each two neighbouring letters swapped."""
    return {word[:n] + word[n + 1] + word[n] + word[n + 2 :] for n in range(len(word) - 1)}


def _is_near(one: str, other: str) -> bool:
    """Return whether two words differ by one letter that is missing, or that another one replaces."""
    short, long = sorted((one, other), key=len)
    begin = next((n for n, letter in enumerate(short) if letter != long[n]), len(short))
    rest = long[begin + 1 :]
    return short[begin:] == rest or (len(short) == len(long) and short[begin + 1 :] == rest)
