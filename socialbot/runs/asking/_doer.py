"""The main verb of a clause, and who does its deed.

People do it, if they are its subject or the robot is what it is done to.

"Did t1 greet you?" and "Were you greeted by t1?" are about no deed of the robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Set

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._words import stem
from socialbot.runs.asking.languages.lexicon import is_deed

_INDEFINITE = {
    "anybody", "anyone", "somebody", "someone", "everybody", "one", "jemand", "jemanden", "quelqu", "un", "alguien",
}  # fmt: skip
_BEFORE_OBJECT = {"for", "at", "with"}
"""Prepositions between an English verb and its object."""
_EUPHONIC = {"il", "elle", "on"}
"""Words behind a French *t* that is no pronoun: ``a-t-il``."""
_NOT_BEFORE_SUBJECT = {"a", "al", "de", "del", "por", "con", "para"}
"""Spanish prepositions before a person."""
_THIRD_PRETERITE = re.compile(".*o")
_NEAR = 3
"""Most words between a person and the auxiliary or the preposition of its clause."""


def is_done_by_people(reading: Reading, deed: Set[int], verb: int | None, *, is_robot_you: bool) -> bool:
    """Return whether people, and no robot, do what a clause without the name of an agent tells.

    Args:
        reading: The words with their classes.
        deed: Places of the words that name the deed.
        verb: Place of the main verb, if it is known.
        is_robot_you: Whether ``you`` means the one robot whose deeds are known, and not one of several.
    """
    return bool(deed) and _Clause(reading, deed).is_done_by_people(verb, is_robot_you=is_robot_you)


class _Clause:
    def __init__(self, reading: Reading, deed: Set[int]) -> None:
        self.reading, self.words, self.deed, self.begin = reading, reading.words, deed, min(deed)
        self.voices = reading.language.voices
        named = {n for name in reading.found if name.startswith("person ") for n in reading.places(name)}
        self.people = named | {n for n in reading.places("people") if self.words[n] not in _INDEFINITE}
        """Places of people: *anybody* may be the robot, too."""
        self.unread = {*named, *reading.places("why")}
        """Places of names, such as *t* of ``t1``, and of ``what made you``, behind which the robot acts."""

    def is_done_by_people(self, verb: int | None, *, is_robot_you: bool) -> bool:
        voices = self.voices
        by = [n for n in self._at(voices.by) if self._at(voices.passive)]
        by += [n for n in self._at(voices.source) if self._at(voices.receive)]
        people = {*self.people, *self.reading.places("people"), *self.reading.places("me")}
        asked = self.reading.language.first_words("who")  # "By whom was t1 greeted?"
        by = [n for n in by if not self._is(n + 1, voices.to_you | asked)]
        if any(people.intersection(range(n + 1, n + 1 + _NEAR)) for n in by):
            return True
        if is_robot_you and self._at(voices.passive | voices.receive) and self._is_robot_patient():
            return True
        if any(self.words[n] in voices.first for n in self.deed):
            return True  # "¿Qué fue lo último que dije?"
        code = self.reading.language.code
        # English "was" and "is" are also other verbs.
        also_other = self.reading.language.auxiliaries if code == "en" else frozenset()
        if self._at((voices.passive | voices.receive) - also_other):
            return False
        subject: Mapping[str, Callable[[], bool]] = {
            "de": self._is_german_subject, "fr": self._is_french_subject, "es": self._is_spanish_subject,
        }  # fmt: skip
        if code == "en":
            return (is_robot_you and self._is_robot_english_object()) or self._is_english_subject(verb)
        if self._at(voices.you):
            return is_robot_you and self._is_robot_object()
        is_mine = self._at(voices.first) and not any(voices.second.fullmatch(self.words[n]) for n in self.deed)
        return bool(is_mine) or (is_robot_you and self._is_robot_object()) or subject[code]()

    def _at(self, words: Set[str]) -> list[int]:
        return [n for n, word in enumerate(self.words) if word in words and n not in self.unread]

    def _is(self, place: int, words: Set[str]) -> bool:
        return place < len(self.words) and self.words[place] in words

    def _is_robot_patient(self) -> bool:
        """Return whether the robot is the subject in the passive voice: ``were you greeted``, ``fuiste saludado``."""
        form, passive = self.voices.participle, self._at(self.voices.passive)
        if not any(form.fullmatch(self.words[n]) for n in self.deed if not passive or n > min(passive)):
            return False
        if self.reading.language.code == "en":
            return any(
                abs(n - place) == 1 and max(n, place) < self.begin and form.fullmatch(self.words[max(n, place) + 1])
                for n in self._at(self.voices.you) for place in passive
            )  # fmt: skip
        second = any(self._is(n - 1, self.reading.language.auxiliaries) and self.voices.second.fullmatch(
            self.words[n - 1]) for n in passive)  # fmt: skip
        return bool(passive) and (bool(self._at(self.voices.you)) or second or bool(self._at({"fuiste"})))

    # The robot as an object

    def _is_robot_english_object(self) -> bool:
        """Return whether ``you`` is behind the verb, and not in front of it, too: not ``the words you spoke``."""
        you = [n for n in self._at(self.voices.to_you) if self.words[n - 1] != "thank"]
        if any(n + 1 in self.deed and "the" in self.words[max(0, n - _NEAR - 1) : n - 1] for n in you):
            return False
        if any(self.words[n - 1] == "to" for n in self.deed if you and n > min(you)):
            return False  # "Did it take you long to greet t1?"
        is_behind = (
            n - 1 in self.deed or self.words[n - 1] == "to" or (n - 2 in self.deed and self._is(n - 1, _BEFORE_OBJECT))
            for n in you
        )  # fmt: skip
        return any(is_behind) and min(you) > self.begin

    def _is_robot_object(self) -> bool:
        """Return whether a pronoun means the robot as an object, and no verb has it as a subject."""
        you = self._at(self.voices.to_you)
        if self.reading.language.code == "de":
            return bool(you) and not self._at(self.voices.you)
        for n in you:
            following = self.words[n + 1] if n + 1 < len(self.words) else ""
            is_subject = self.voices.second.fullmatch(following) or "tu" in self.words or following in _EUPHONIC
            if following and not is_subject and (self.words[n] != "vous" or following in self.voices.third):
                return True
        return False

    # People as subjects

    def _is_english_subject(self, verb: int | None) -> bool:
        """Return whether certain people are between the auxiliary and the verb: ``did t1 greet``, ``did I greet``.

        They may also be the subject of a relative clause: ``the last thing I said``.
        """
        if any(map(self._is_relative_subject, self.deed)):
            return True
        if verb is None or verb not in self.deed:
            return False
        start = max((n for n in range(verb) if self.words[n] in self.reading.language.auxiliaries), default=verb)
        subject = range(start + 1, verb)
        mine = {n for n in self.reading.places("me") if self.words[n] in ("i", "we")}
        return bool((self.people | mine).intersection(subject)) and not {*self._at(self.voices.you)}.intersection(
            subject
        )

    def _is_relative_subject(self, verb: int) -> bool:
        """Return whether people say something: a verb of saying follows them, and no auxiliary comes before them."""
        first = {n for n in self.reading.places("me") if self.words[n] in ("i", "we")}
        people = {*self.people, *self.reading.places("people")} | first
        begin = verb
        while begin and begin - 1 in people:
            begin -= 1
        if verb not in self.reading.places("say") or begin == verb:
            return False
        phrases = self.reading.language.phrases
        describing = {one for name in ("article", "first", "last", "ordinals") for one in phrases[name]}
        while begin and (self.words[begin - 1],) in describing:
            begin -= 1
        return begin > 0 and self.words[begin - 1] not in self.reading.language.auxiliaries

    def _is_german_subject(self) -> bool:
        third = [n for n in self._at(self.voices.third) if not self._is(n + 1, {"sie"})]  # "Haben Sie t1 begrüßt?"
        return any(self.people.intersection(range(n + 1, n + 1 + _NEAR)) for n in third)

    def _is_french_subject(self) -> bool:
        return any(n < self.begin and self.people.intersection(range(max(0, n - _NEAR), n)) for n in self._at(
            self.voices.third))  # fmt: skip

    def _is_spanish_subject(self) -> bool:
        is_third = _THIRD_PRETERITE.fullmatch(self.words[self.begin]) or self._at(self.voices.third)
        return bool(is_third) and any(
            not _NOT_BEFORE_SUBJECT.intersection(self.words[max(0, n - 2) : n]) for n in self.people
        )


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

    ``subjects`` are the positions of names. A verb such as *give* does not count: its object says what is done.
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


_PERFECT = {
    "de": {"hast", "hat", "habe", "haben", "habt"},
    "fr": {"as", "avez", "es", "etes", "a", "ont"},
    "es": {"has", "ha", "han", "habias", "habia", "habian"},
}
"""Auxiliaries before a participle. French *a* is one only behind a subject or before a pronoun."""
_BETWEEN = {
    "t", "il", "elle", "ils", "elles", "on", "ne", "pas", "jamais", "l", "la", "le", "les", "me", "te", "se", "lo",
    "los", "las", "no", "nunca", "y", "en",
}  # fmt: skip
"""French and Spanish words that may precede a verb in its clause, beside the subject."""


def verb_by_form(reading: Reading, subjects: Set[int]) -> int | None:
    """Return the place of the main verb of a German, French or Spanish clause; None if its form does not tell it.

    It is the participle of an auxiliary, or else the word beside *du* or *tu*, or a Spanish form of the second person.
    ``subjects`` are the positions of names.
    """
    code, words, voices = reading.language.code, reading.words, reading.language.voices
    if code not in _PERFECT:
        return None
    you = {n for n, word in enumerate(words) if word in voices.you}
    last, free = len(words) - 1, {n for n in reading.free() if n not in subjects}
    perfect = [
        n
        for n, word in enumerate(words)
        if word in _PERFECT[code]
        and (word != "a" or n - 1 in subjects or (n < last and words[n + 1] in _EUPHONIC | {"t"}))
    ]
    if perfect and code == "de":
        begin, is_form = perfect[0], voices.participle.fullmatch
        place = next(
            (n for n in range(last, begin, -1) if is_form(words[n]) or (n in free and is_deed(words[n], code))), None
        )
        return place if place in free else None
    if perfect:
        between = you | subjects | {n for n, word in enumerate(words) if word in _BETWEEN}
        place = next((n for n in range(perfect[0] + 1, last + 1) if n not in between), None)
        return place if place in free else None
    beside = {n - 1 for n in you} if code != "es" else set[int]()
    beside |= {n + 1 for n in you} if code != "de" else set()
    if code == "es":  # "¿Por qué abriste la puerta?": in front of the verb are words without a meaning of their own.
        first = next((n for n, word in enumerate(words) if n in free and word not in _BETWEEN), None)
        beside |= {first} if first is not None and voices.second.fullmatch(words[first]) else set()
    return min(beside & free, default=None)
