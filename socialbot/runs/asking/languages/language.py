"""Words of questions by class, and sentences of answers, of one language.

Each language lists words by class. A class is a role in a question: an interrogative (``why``, ``who``), a verb that
every agent knows (``see``, ``do``), a reference (``me``, ``people``), a tense or a negation. Words have no accents.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

INTERROGATIVES = (
    "why", "what", "who", "when", "where", "how_often", "how_many", "how_long", "how_far", "unanswerable",
)  # fmt: skip


@dataclass(frozen=True)
class Language:
    """Words by class, and sentences of answers by name."""

    code: str
    words: Mapping[str, str]
    """Alternatives, separated by commas; an alternative may have several words."""
    sentences: Mapping[str, str]

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
