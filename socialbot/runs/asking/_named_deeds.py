"""Deeds that a question may name, each with the evidence for it in the words of the question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

from socialbot.core.clock import nanoseconds
from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import SAYING, Phrase, Topic, arguments_of
from socialbot.runs.asking._words import ALIKE, FORM, likeness, name_tokens, similarity, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, INTERROGATIVES, lexicon
from socialbot.runs.asking.languages.lexicon import Meaning, Named, done_by, found_in, meanings, named_meanings

Evidence = Mapping[str, float]

_SOFT = (
    "see", "do", "say", "here", "plan", "happen", "next", "time", "filler", "place", "not", "people", "nobody", "what",
    "at", "fail", "wish",
)  # fmt: skip
"""Classes whose words may be parts of a deed: "do nothing", "say hello", "come to base"."""
_LONGEST_ASKING = 5
"""Most letters of interrogatives that are nothing else."""
_NEAR_S = 2.0
_VERB = 0.78
"""Share of the first word of a loose phrase in its likeness."""
_MOST_DEEDS = 7
"""Most deeds of a question that are compared."""
_TRUST = {
    "declared": 1.0, "opposite": 1.0, "loose": 0.98, "synonym": 0.95, "act": 0.94, "name": 0.8, "said": 0.7,
    "cause": 0.5, "thing": 0.3, "time": 0.3,
}  # fmt: skip
"""How much each kind of evidence counts when the deeds to compare are selected."""


@dataclass(frozen=True)
class NamedDeed:
    """Deed with the evidence for it.

    Args:
        topic: The deed.
        evidence: How well each kind of evidence fits, from 0 to 1: a phrase that the agent declares, an ``opposite``,
            a ``loose`` phrase from names, a ``synonym``, the ``act`` that words do, the ``name`` in its argument, words
            that are ``said``, and words of its records and their ``cause``.
        places: Places of the words that name it.
        caused: Those that only its cause has.
    """

    topic: Topic
    evidence: Evidence
    places: frozenset[int]
    caused: frozenset[int] = frozenset()

    @property
    def is_opposite(self) -> bool:
        return "opposite" in self.evidence

    @property
    def is_synonym(self) -> bool:
        """Whether the words are none of the agent."""
        return not {"declared", "opposite", "loose"}.intersection(self.evidence)

    @property
    def fit(self) -> float:
        return max(_TRUST[name] * alike for name, alike in self.evidence.items())


def named_deeds(reading: Reading, subjects: Subjects, things: Sequence[str], stamp: int | None) -> list[NamedDeed]:
    """Return the deeds that the words may name, the most likely ones first.

    Args:
        reading: The words with their classes.
        subjects: What the run can be asked about.
        things: Names of things and agents in the question.
        stamp: Time (ns) in the time in the question; None without one.
    """
    free = set(reading.free())
    # "Why did you explain it?": behind an interrogative, its class is no other one.
    asking = sorted(place for name in INTERROGATIVES for place in reading.places(name))
    free |= {place for place in asking[1:] if len(reading.words[place]) > _LONGEST_ASKING}
    soft = {place for name in _SOFT for place in reading.places(name)}
    own = {phrase[0] for topic in subjects.topics for phrase in topic.loose if len(phrase) == 1} - SAYING
    free |= {place for place in reading.places("say") if reading.words[place] in own}  # an action "answer"
    meant = found_in(reading.words, reading.language.code)
    found = [
        each
        for topic in subjects.topics
        for opposite in (False, True)
        for each in [_named(topic, reading, subjects, things, stamp, free, soft, meant, opposite=opposite)]
        if each is not None
    ]
    # "Come back" is to go back, if that is a deed of its own, and "go" is not to go back.
    whole = {each.topic.name: each.places for each in found if _is_whole_meaning(each.topic, meant)}
    names = {(_name_of(each), each.places) for each in found}
    found = [
        each
        for each in found
        if each.topic.name in whole
        or not (any(each.places <= places for places in whole.values()) or _is_longer(each, names))
    ]
    # "Go ahead" is not to go: a phrase outdoes a part of it.
    # "How many rooms did you clean?" counts the rooms that were cleaned, and not "clean rooms".
    if not reading.has("how_many"):
        surely = [each for each in found if {"declared", "synonym", "act"}.intersection(each.evidence)]
        found = [each for each in found if not any(each.places < one.places and one.fit >= each.fit for one in surely)]
    found = [each for each in found if not _is_outdone(each, found)]
    found.sort(key=lambda each: (-round(each.fit, 2), not subjects.done(each.topic), -len(each.places)))
    return found[:_MOST_DEEDS]


def _is_outdone(deed: NamedDeed, found: Sequence[NamedDeed]) -> bool:
    """Return whether ``check`` outdoes ``check("Ann")``, as the words do not name Ann, or else the other way round."""
    alike = [each for each in found if each is not deed and each.topic.call_names == deed.topic.call_names]
    if deed.topic.is_saying:
        return False
    if "(" in deed.topic.name:
        return "name" not in deed.evidence and any("(" not in each.topic.name for each in alike)
    return any("name" in each.evidence for each in alike)


def _named(
    topic: Topic,
    reading: Reading,
    subjects: Subjects,
    things: Sequence[str],
    stamp: int | None,
    free: set[int],
    soft: set[int],
    meant: Sequence[Named],
    *,
    opposite: bool,
) -> NamedDeed | None:
    code, words, known = reading.language.code, reading.words, lexicon.words(reading.language.code)
    evidence: dict[str, float] = {}
    places: dict[str, tuple[int, ...]] = {}

    def note(kind: str, alike: float, at: Sequence[int]) -> None:
        if at and alike > evidence.get(kind, 0.0):
            evidence[kind], places[kind] = alike, tuple(at)

    def resembles(at: int, word: str) -> bool:
        """Return whether a word may be meant by one that is mistyped or misheard."""
        return similarity(words[at], word) >= (FORM if words[at] in known else ALIKE)

    def occurs(phrase: Phrase) -> tuple[float, tuple[int, ...]]:
        alike, at = likeness(phrase, words, most_between=4)
        if alike < FORM and any(words[n] in known for n in at):
            return 0.0, ()  # "décharger" is another verb than "charger"
        is_named = bool(at) and bool(set(at) & free or len(at) > 1) and _is_whole(phrase, at, words, free, soft)
        return (alike, at) if is_named else (0.0, ())

    table = topic.opposites if opposite else topic.words
    for phrase in table.get(code, ()):
        note("opposite" if opposite else "declared", *occurs(phrase))
    alike = {meaning for phrase in table.get(code, ())[:1] for meaning in meanings(phrase, code)}
    for each in meant:
        if each.meaning in alike and _is_whole(each.phrase, each.places, words, free, soft):
            note("opposite" if opposite else "synonym", 1.0, each.places)
    if opposite:
        found = {place for at in places.values() for place in at}
        return NamedDeed(topic, evidence, frozenset(found)) if found else None
    for phrase in topic.loose:
        note("name" if phrase in topic.named_by_argument else "loose", *_loosely(phrase, words, free, soft, code))
    kind, alike = _meanings_of(topic)
    for each in meant:
        if each.meaning in alike and _is_whole(each.phrase, each.places, words, free, soft):
            note(kind, 1.0, each.places)
    done = subjects.acted(topic)
    if things and (fitting := max((len({*things} & {*arguments_of(one.what)}) for one in done), default=0)):
        evidence["thing"] = fitting / len(things)
    if stamp is not None and any(abs(one.stamp - stamp) <= nanoseconds(_NEAR_S) for one in done):
        evidence["time"] = 1.0
    content = [place for place in sorted(free) if len(words[place]) > 2]
    for kind, table in (("said", subjects.said_stems(topic)), ("cause", subjects.cause_stems(topic))):
        at = [place for place in content if stem(words[place]) in table]
        note(kind, len(at) / len(content) if at else 0.0, at)
    if not evidence:
        return None
    found = {place for at in places.values() for place in at}
    of_deed = {word for phrase in (*topic.words.get(code, ()), *topic.loose) for word in phrase}
    found |= {at for at in free if any(resembles(at, word) for word in of_deed)}
    others = {place for kind, at in places.items() if kind != "cause" for place in at}
    return NamedDeed(topic, evidence, frozenset(found), frozenset(places.get("cause", ())) - others)


def _is_whole_meaning(topic: Topic, meant: Sequence[Named]) -> bool:
    """Return whether words mean the whole name of a deed, and not only its verb."""
    whole = frozenset[Meaning]().union(
        *(meanings(phrase) - meanings(phrase[:1]) for phrase in topic.loose if len(phrase) > 1)
    )
    return any(each.meaning in whole for each in meant)


def _name_of(deed: NamedDeed) -> tuple[str, ...]:
    return tuple(name_tokens(deed.topic.name.partition("(")[0]))


def _is_longer(deed: NamedDeed, names: Set[tuple[tuple[str, ...], frozenset[int]]]) -> bool:
    """Return whether the name of a deed begins with that of another one with the same words: go_back with go."""
    name = _name_of(deed)
    is_begun = any((name[:n], deed.places) in names for n in range(1, len(name)))
    return is_begun and "time" not in deed.evidence


def meanings_of(subjects: Subjects) -> Set[Meaning]:
    """Return the meanings of the deeds that a run can be asked about."""
    return frozenset[Meaning]().union(*(_meanings_of(topic)[1] for topic in subjects.topics))


def _meanings_of(topic: Topic) -> tuple[str, Set[Meaning]]:
    """Return the kind of evidence that a deed is meant, and the meanings of its name or of what its words do."""
    if topic.is_saying:
        return "act", done_by(tokens(" ".join(arguments_of(topic.name))))
    whole = (meanings(phrase) for phrase in topic.loose if len(phrase) > 1)
    return "synonym", frozenset[Meaning]().union(*(named_meanings(phrase[0]) for phrase in topic.loose), *whole)


def _is_whole(phrase: Phrase, places: Sequence[int], words: Sequence[str], free: set[int], soft: set[int]) -> bool:
    """Return whether no word of a phrase has another role; words that only resemble theirs must have none."""
    return all(
        place in free or (place in soft and len(phrase) > 1 and similarity(words[place], wanted) > 0.95)
        for place, wanted in zip(places, phrase, strict=True)
    )


def _loosely(
    phrase: Phrase, words: Sequence[str], free: set[int], soft: set[int], code: str
) -> tuple[float, tuple[int, ...]]:
    """Return how well words name a deed by its phrase, whose first word counts most, and their places."""
    least = ALIKE if code == ENGLISH.code else FORM
    found: list[int] = []
    total = 0.0

    def alike(at: int, wanted: str) -> float:
        is_meant = len(phrase) > 1 and not meanings((words[at],), code).isdisjoint(named_meanings(wanted))
        return max(similarity(words[at], wanted), FORM if is_meant else 0.0)

    for n, wanted in enumerate(phrase):
        share = 1.0 if len(phrase) == 1 else _VERB if n == 0 else (1.0 - _VERB) / (len(phrase) - 1)
        places = [at for at in free | soft if alike(at, wanted) >= (least if at in free else 0.95)]
        place = max(places, key=lambda at, wanted=wanted: (alike(at, wanted), -at), default=None)
        if place is not None:
            total += share * alike(place, wanted)
            found.append(place)
        elif n == 0:
            return 0.0, ()
    return (total, tuple(found)) if set(found) & free else (0.0, ())
