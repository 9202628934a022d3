"""Beliefs that the words of a question may name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._topics import Subjects
from socialbot.runs.asking.languages.lexicon import is_about

LEAST_FIT = 0.5
"""Least share of the words of a belief's name that a question has to have."""

_PLACES = {"in", "at", "on", "upon", "position", "location", "located", "place", "room"}
"""Words in the names of beliefs about places, which answer "where"."""


class AskedBelief(NamedTuple):
    """Name of a belief that a question may ask for, the share of its words, and the places of those in the question."""

    name: str
    fit: float
    places: frozenset[int]


def _parts(name: str) -> list[str]:
    return [part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def tells_place(name: str) -> bool:
    """Return whether a belief of this name tells where something is."""
    return bool(_PLACES.intersection(_parts(name)[:1]))


def asked_beliefs(reading: Reading, subjects: Subjects) -> Iterator[AskedBelief]:
    """Yield the beliefs that the words of a question may ask for."""
    is_where = reading.has("where") or {"which", "room"} <= set(reading.words)
    for name in subjects.belief_names:
        parts = _parts(name)
        if is_where and tells_place(name):
            yield AskedBelief(name, 1.0, frozenset(reading.places("where")))
            continue
        places: set[int] = set()
        matched = 0
        for part in parts:
            own = {n for n, word in enumerate(reading.words) if is_about(word, reading.language.code, part)}
            matched += bool(own)
            places |= own
        if parts and matched / len(parts) >= LEAST_FIT:
            yield AskedBelief(name, matched / len(parts), frozenset(places))
