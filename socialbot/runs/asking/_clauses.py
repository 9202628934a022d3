"""Parts of a question beside its main clause: whom a deed is contrasted with, and the event that tells its time.

"Why did you help t1, but not t2?" contrasts, "What did you do after t1 had left?" tells its time by an event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from socialbot.runs.asking.languages import INTERROGATIVES, Language

Relation = Literal["after", "before", "when"]

_MOST_WORDS = 8
"""Most words of a contrast."""


@dataclass(frozen=True)
class Parts:
    """Words of the main clause, of its contrast and of the event that tells its time."""

    main: tuple[str, ...]
    contrast: tuple[str, ...] = ()
    is_denied: bool = False
    """Whether the contrast is a negation, and not ``rather than`` or ``instead of``."""
    event: tuple[str, ...] = ()
    relation: Relation = "when"


def without_contrast(words: Sequence[str], language: Language) -> Parts | None:
    """Split off who or what is contrasted: ``and not t2``, ``rather than t2``, ``but t2 did not``; None without it."""
    for place in range(2, len(words)):
        for phrase in language.phrases["rather"]:
            if _is_at(phrase, words, place):
                return Parts(tuple(words[:place]), tuple(words[place + len(phrase) :]))
        for phrase in language.phrases["but"]:
            rest = words[place + len(phrase) :]
            if not _is_at(phrase, words, place) or len(rest) > _MOST_WORDS:
                continue
            denied = [word for word in rest if (word,) not in language.phrases["not"]]
            if len(denied) < len(rest):
                return Parts(tuple(words[:place]), tuple(denied), is_denied=True)
    return None


def without_event(words: Sequence[str], language: Language) -> Parts | None:
    """Split off the event that tells the time, behind the main clause or in front of it; None without one."""
    asking = {one[0] for name in INTERROGATIVES if name != "when" for one in language.phrases[name]}
    asking |= set(language.auxiliaries)
    relations: tuple[Relation, ...] = ("after", "before", "when")
    for place in range(len(words) - 1):
        for relation in relations:
            for phrase in sorted(language.phrases[f"event {relation}"], key=len, reverse=True):
                if not _is_at(phrase, words, place) or place + len(phrase) == len(words):
                    continue
                rest = words[place + len(phrase) :]
                if rest[0] in language.auxiliaries:
                    continue
                asked = next((n for n in range(2, len(rest) - 1) if _asks(rest[n : n + 2], language)), None)
                if place >= 2 and asked is not None:
                    # The event in the middle: "How soon after t2 came did you greet her?"
                    main = (*words[:place], *rest[asked:])
                    return Parts(main, event=tuple(rest[:asked]), relation=relation)
                if place >= 2:
                    return Parts(tuple(words[:place]), event=tuple(rest), relation=relation)
                # The event in front: "When t2 left, what did you do?"
                begin = next((n for n in range(2, len(rest) - 1) if place == 0 and rest[n] in asking), None)
                if begin is not None:
                    return Parts(tuple(rest[begin:]), event=tuple(rest[:begin]), relation=relation)
    return None


def _asks(pair: Sequence[str], language: Language) -> bool:
    """Return whether two words begin a question to the robot: ``did you``."""
    return pair[0] in language.auxiliaries and tuple(pair[1:]) in language.phrases["you"]


def _is_at(phrase: Sequence[str], words: Sequence[str], place: int) -> bool:
    return tuple(words[place : place + len(phrase)]) == tuple(phrase)
