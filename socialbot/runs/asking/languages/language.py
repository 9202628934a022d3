"""Words of questions by class, and sentences of answers, of one language.

Each language lists words by class. A class is a role in a question: an interrogative (``why``, ``who``), a verb that
every agent knows (``see``, ``do``), a reference (``me``, ``people``), a tense or a negation. Words have no accents.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

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
    third: frozenset[str]
    participle: re.Pattern[str]
    second: re.Pattern[str] = re.compile("(?!)")
    first: frozenset[str] = frozenset()


def word_set(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


@dataclass(frozen=True)
class Language:
    """Words by class, and sentences of answers by name."""

    code: str
    words: Mapping[str, str]
    """Alternatives, separated by commas; an alternative may have several words."""
    sentences: Mapping[str, str]
    voices: Voices
    letters: str = ""
    """Letters and signs that no other language has."""

    @cached_property
    def phrases(self) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Alternatives of each class as tuples of words."""
        return {name: tuple(tuple(one.split()) for one in text.split(",")) for name, text in self.words.items()}

    @cached_property
    def known_words(self) -> frozenset[str]:
        """Words of all classes."""
        return frozenset(word for alternatives in self.phrases.values() for phrase in alternatives for word in phrase)

    @cached_property
    def units(self) -> dict[str, float]:
        """Words for units of time with their length in seconds."""
        return {
            one[0]: seconds for name, seconds in (("seconds", 1.0), ("minutes", 60.0)) for one in self.phrases[name]
        }

    @property
    def auxiliaries(self) -> frozenset[str]:
        """First words of questions that are answered by yes or no."""
        return frozenset(one[0] for one in self.phrases["auxiliary"])
