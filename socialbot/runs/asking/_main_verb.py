"""The main verb of an English question."""

from __future__ import annotations

from collections.abc import Set

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._words import stem

_ARTICLES = {"the", "a", "an", "my", "your", "its", "der", "die", "das", "dem", "den", "la", "le", "les", "el", "los"}
_BEFORE_SUBJECT = {"did", "does", "do", "will", "would", "can", "could", "have", "has", "had"}
_BEFORE_VERB = {
    "ever", "also", "just", "still", "already", "even", "then", "again", "both", "once", "twice", "please", "at",
    "least", "always", "first", "last", "yet", "not", "never", "been", "to", "and", "be", "all", "ahead",
}  # fmt: skip
"""Words between a subject and its verb, beside adverbs in -ly."""


def _stems(verbs: str) -> frozenset[str]:
    return frozenset(map(stem, verbs.split()))


_BEFORE_INFINITIVE = _stems(
    "want decide choose need try manage start begin happen bother dare care refuse forget fail use tend plan "
    "intend continue end have get wish like love neglect omit prefer hesitate"
)
_BEFORE_GERUND = _stems("start begin stop keep end continue avoid go finish")
_IN_LY = _stems("reply apply supply rely fly comply")
"""Verbs that end as adverbs do."""
_LIGHT = _stems(
    "get give make take receive have had do perform carry provide show let keep stay remain stand spend need "
    "obtain pay experience be become seem appear use issue know tell remember recall"
)
"""Verbs whose object says what is done: ``Did you give t1 a greeting?``, ``Do you know why ...?``"""
PARTICLES = {"up", "down", "off", "out", "over", "away", "back", "in", "on", "through", "along", "apart", "around"}


def clause_verb(reading: Reading, subjects: Set[int]) -> int | None:
    """Return the place of the verb behind the first auxiliary and its subject in an English question; None without one.

    ``subjects`` are the places of names. A verb such as *give* does not count, as its object says what is done.
    """
    if reading.language.code != "en":
        return None
    words = reading.words
    start = next((n for n, word in enumerate(words) if word in _BEFORE_SUBJECT), None)
    if start is None:
        return None
    nouns = {at for name in ("people", "nobody", "named", "me", "them") for at in reading.places(name)}
    nouns |= {at for at, word in enumerate(words) if (word,) in reading.language.phrases["you"]}
    place = start + 1
    while place < len(words) and (place in subjects | nouns or words[place] in _ARTICLES):
        place += 1
    if place == start + 1 or (words[place - 1] in _ARTICLES and place - 1 not in subjects):
        return None
    while place < len(words):
        if place in subjects:  # "carrier a and carrier b"
            place += 1
            continue
        following = next(iter(words[place + 1 : place + 2]), "")
        is_auxiliary = (following in ("to", "not", "up") and stem(words[place]) in _BEFORE_INFINITIVE) or (
            following.endswith("ing") and stem(words[place]) in _BEFORE_GERUND
        )
        goes_and = words[place] in ("go", "come", "try") and following in ("and", "ahead")
        is_adverb = words[place] in _BEFORE_VERB or (words[place].endswith("ly") and stem(words[place]) not in _IN_LY)
        if not (is_auxiliary or goes_and or is_adverb):
            return None if stem(words[place]) in _LIGHT and following not in PARTICLES else place
        place += 1
    return None
