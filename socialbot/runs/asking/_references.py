"""References in questions: times, numbers of deeds, agents, things and people."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from typing import Literal

from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._words import (
    NUMBER_WORDS,
    digits,
    fraction_at,
    is_at,
    likeness,
    number_at,
    ordinal_at,
    ordinal_in_digits,
    similarity,
    starts,
    stem,
    tokens,
)
from socialbot.runs.asking.languages import Language, lexicon

Quantity = Literal["times", "others", ""]
"""What a question asks about the number of deeds: how many times, or to which or how many others."""


@dataclass(frozen=True)
class Limit:
    """Limit of a duration (s) or distance (m): ``longer than ten seconds``, ``within three metres``."""

    value: float
    is_most: bool
    in_metres: bool

    def holds(self, value: float) -> bool:
        return value <= self.value if self.is_most else value >= self.value


@dataclass(frozen=True)
class PersonReference:
    """People in a question.

    They are the speaker (``me``), one by order of arrival or by time, those with names, or those who were ``together``.
    ``leaves`` counts them by order of departure: ``the last person to leave``.
    """

    me: bool = False
    ordinal: int | None = None
    at_s: float | None = None
    names: tuple[str, ...] = ()
    together: bool = False
    leaves: bool = False


@dataclass
class Reading:
    """Question while it is read: its words, those that are explained, and the classes of words in it."""

    language: Language
    words: list[str]
    taken: set[int] = field(default_factory=set)
    found: dict[str, list[tuple[float, tuple[int, ...]]]] = field(default_factory=dict)
    is_later: bool = False
    """Whether its time is that after which something was done: ``after 50 s``."""

    def take(self, name: str, *places: int) -> None:
        """Take the words at some places as a phrase of a class."""
        self.found.setdefault(name, []).append((1.0, places))
        self.taken |= set(places)

    def has(self, *names: str) -> bool:
        return any(self.found.get(name) for name in names)

    def place(self, name: str) -> int:
        return self.found[name][0][1][0]

    def places(self, name: str) -> list[int]:
        return [place for _, places in self.found.get(name, ()) for place in places]

    def free(self) -> list[int]:
        return [place for place in range(len(self.words)) if place not in self.taken]

    def is_asked_for(self, place: int) -> bool:
        """Return whether a word is that of ``which crane`` or ``how many kilos``."""
        before = (*self.language.phrases["which"], *self.language.phrases["how_many"])
        return any(place >= len(each) and is_at(each, self.words, place - len(each)) for each in before)


def digits_after_names(words: list[str], subjects: Subjects, language: Language) -> list[str]:
    """Return words with number words as digits behind the words of names: ``room one`` is room1."""
    heads = {
        phrase[0]
        for phrase in (*subjects.things.values(), *(tuple(tokens(name)) for name in subjects.agents))
        if phrase
    }
    after = {word for phrase in subjects.things.values() for word in phrase}
    result = list(words)
    for n in (n for n in range(1, len(words)) if (words[n],) not in language.phrases["article"]):
        if words[n - 1] in heads or (words[n - 1] in after and len(words[n - 1]) == 1):
            result[n] = digits([words[n]])[0]
    return result


# Times


def take_time(reading: Reading, subjects: Subjects) -> tuple[float | None, bool, PersonReference | None]:
    """Take a time from the words: its value (s), whether it counts back, and the person whom it describes."""
    phrases, units, words = reading.language.phrases, reading.language.units, reading.words
    for n in range(len(words)):
        found = number_at(words, n) or ordinal_at(words, n, units) or fraction_at(words, n, units)
        if found is None or (reading.language.code == "en" and words[n] == "once"):  # 11 in Spanish
            continue
        value, used = found
        before, after = words[n - 1] if n else "", words[n + used] if n + used < len(words) else ""
        if len(before) == 1 and after not in units and words[max(0, n - 2)] in subjects.kinds:
            continue  # "la caisse a2"
        places = set(range(n, n + used))
        if after in units:
            value, places = value * units[after], places | {n + used}
            following = n + used + 1
            more = number_at(words, following) if following < len(words) and units[after] == 60.0 else None
            if more is not None:
                value += more[0]
                places |= set(range(following, min(len(words), following + more[1] + 1)))
        elif before in units and (words[n] != "one" or words[max(0, n - 2)] not in _DEFINITE):  # "the second one"
            value, places = value * units[before], places | {n - 1}
        elif ":" not in words[n] and (before,) not in phrases["at"]:
            continue
        first, last = min(places), max(places)
        reading.is_later = words[_word_in_front(words, first)] in _LATER
        behind = reading.language.code == "en"  # "bei Sekunde 12 vor dir"
        ago = any(
            is_at(one, words, last + 1) if behind else first >= len(one) and is_at(one, words, first - len(one))
            for one in phrases["ago"]
        )
        if reading.language.code == "de" and not any(words[place] in units for place in places):
            ago = False  # "vor 1:23" is before that time, "vor 10 s" is ten seconds ago
        reading.taken |= places
        describes = _names_person(reading, first)
        by_time = None if ago or not describes or first == 0 else PersonReference(at_s=value)
        for name in ("ago", "at"):
            for one in phrases[name]:
                for start in (last + 1, first - len(one)):
                    if start >= 0 and is_at(one, words, start):
                        reading.taken |= set(range(start, start + len(one)))
        if by_time is not None:
            reading.taken |= {
                place for place in range(max(0, first - 4), first) if (words[place],) in phrases["people"]
            }
            return None, False, by_time
        return value, ago, None
    for name, value in (("start", 0.0), ("recently", None)):
        for one in sorted(phrases[name], key=len, reverse=True):
            alike, places = likeness(one, words, 0)
            if alike > 0.95 and len(one) > 1:
                if name == "start" and _names_person(reading, places[0]):
                    reading.taken |= set(places)
                    return None, False, PersonReference(ordinal=1)
                reading.take(name, *places)
                return value, False, None
    return None, False, None


def take_limit(reading: Reading) -> Limit | None:
    """Take a limit of a duration or distance from the words: ``longer than ten seconds``."""
    words, phrases = reading.words, reading.language.phrases
    metres = {one[0] for one in phrases["metres"]}
    for name in ("within", "more than", "less than"):
        for phrase in sorted(phrases[name], key=len, reverse=True):
            for start in starts(phrase, words):
                n = start + len(phrase)
                found = number_at(words, n) if n < len(words) else None
                unit = n + found[1] if found is not None else len(words)
                units = metres if name == "within" else {*reading.language.units, *metres}
                if found is None or unit >= len(words) or words[unit] not in units:
                    continue
                reading.take("limit", *range(start, unit + 1))
                in_metres = words[unit] in metres
                value = found[0] * (1.0 if in_metres else reading.language.units[words[unit]])
                return Limit(value, name != "more than", in_metres)
    return None


def take_span(reading: Reading) -> tuple[float, float] | None:
    """Take a span of time (s): ``between 20 and 30 s``, ``before 30 s``, ``in the first ten seconds``.

    ``In the last ten seconds`` counts back from the time of the question: its begin is negative.
    """
    units, words = reading.language.units, reading.words
    for n in range(1, len(words)):
        first = number_at(words, n) or fraction_at(words, n, units)
        order = _order(words[n - 1], reading.language)
        if first is None and words[n] in units and order in (1, -1):
            reading.taken |= {n - 1, n}  # the first minute
            return (0.0, units[words[n]]) if order == 1 else (-units[words[n]], 0.0)
        if first is None:
            continue
        places, end, begin_unit = set(range(n, n + first[1])), n + first[1], 0.0
        if words[end : end + 1] and words[end] in units:
            if order in (1, -1) and first[0] > 0.0:
                reading.taken |= {*places, n - 1, end}
                seconds = first[0] * units[words[end]]
                return (0.0, seconds) if order == 1 else (-seconds, 0.0)
            if words[n - 1] in _UNTIL:
                reading.taken |= {*places, n - 1, end}
                return 0.0, first[0] * units[words[end]]
            begin_unit = units[words[end]]
            places, end = {*places, end}, end + 1
        second = number_at(words, end + 1) if end + 1 < len(words) and words[end] in _TO else None
        begin = n - 1 if words[n - 1] in units and not begin_unit else n
        unit = begin_unit or (units[words[begin]] if begin < n else 0.0)
        since = _word_in_front(words, begin)
        if unit and second is None and words[since] in _SINCE:
            reading.taken |= {*places, *range(since, n)}
            is_back = words[since] in _SINCE_BACK and begin == n  # "seit 20 Sekunden" are the last 20 s
            return (-first[0] * unit, 0.0) if is_back else (first[0] * unit, math.inf)
        if second is None or words[n - 1] not in _FROM:
            continue
        last = end + 1 + second[1]
        unit = units.get(words[last], 0.0) if last < len(words) else 0.0
        if unit:
            reading.taken |= {*places, n - 1, *range(end, last + 1)}
            begin_s, end_s = sorted((first[0] * (begin_unit or unit), second[0] * unit))
            return max(0.0, begin_s), end_s
    return None


_FROM = {"between", "from", "zwischen", "von", "entre", "de", "desde"}
_SINCE = {"since", "seit", "ab", "depuis", "desde", "partir"}
_SINCE_BACK = {"seit", "depuis"}
"""Words for a time up to now before a number of seconds: ``seit 20 Sekunden``."""
_LATER = {"after", "nach", "apres", "tras", "despues"}
_BEFORE_TIME = {"the", "der", "la", "les", "los", "las", "el", "de", "des", "del"}
"""Words between a preposition and a time: ``después de los 50 segundos``."""
_UNTIL = {"before", "until", "till", "by", "bis", "avant", "hasta"}
_TO = {"and", "to", "until", "till", "und", "bis", "et", "a", "y", "hasta"}


def _word_in_front(words: Sequence[str], time: int) -> int:
    """Return the place of the preposition in front of a time."""
    place = max(0, time - 1)
    while place and words[place] in _BEFORE_TIME:
        place -= 1
    return place


_ALIKE_ORDINAL = 0.79
_WHOLE = 0.999
_MOST_IN_ORDER = 20
"""Largest number of a person that counts as the order of arrival."""
_DEFINITE = {
    "the", "that", "this", "der", "die", "das", "den", "dem", "diesen", "diesem", "diese", "le", "la", "l", "ce",
    "cette", "cet", "el", "al", "ese", "esa", "este", "esta",
}  # fmt: skip
_PLURAL = {"aux", "les", "des", "los", "las", "those", "these"}
_BOTH = {"beiden"}
_RELATIVE = {"who", "that", "die", "qui", "que"}
_BETWEEN = ("at", "past", "here", "them", "filler")
"""Classes of the words between a person and the time that describes them: ``the man who was here at 12 s``."""


def _names_person(reading: Reading, time: int) -> bool:
    """Return whether a time describes the person named before it, and not the whole question."""
    phrases, words = reading.language.phrases, reading.words
    between = {word for name in _BETWEEN for one in phrases[name] for word in one} | _RELATIVE
    for place in range(time - 1, max(-1, time - 6), -1):
        if (words[place],) in phrases["people"]:
            # "anybody at 30 s" is nobody in particular
            return any(word in _DEFINITE for word in words[max(0, place - 2) : place])
        if words[place] not in between:
            return False
    return False


def _order(word: str, language: Language) -> int | None:
    """Return the number of an ordinal in any form: 1 for the first, -1 for the last; None for other words."""
    phrases = language.phrases
    written = ordinal_in_digits(word)
    if written is not None or word in NUMBER_WORDS:
        return written
    known = [(one[0], 1) for one in phrases["first"] if len(one) == 1]
    known += [(one[0], -1) for one in phrases["last"] if len(one) == 1]
    known += [(one[0], number) for number, one in enumerate(phrases["ordinals"], 2)]
    spoken = next((number for each, number in known if "th" in each and word == each.replace("th", "f")), None)
    if spoken is not None:
        return spoken  # "the fird visitor"
    forms = ((similarity(word[: len(each)], each), similarity(word[:-1], each[:-1]), number) for each, number in known)
    alike, number = max((max(one, other), number) for one, other, number in forms)
    is_form = (
        len(word) > 4 and alike >= _ALIKE_ORDINAL and word not in (language.known_words | lexicon.words(language.code))
    )
    return number if alike == 1.0 or is_form else None


def _order_behind(reading: Reading, person: int) -> int | None:
    """Take the order of arrival behind a person: ``the man who came first``."""
    phrases, words = reading.language.phrases, reading.words
    between = {word for name in ("comes", "here", *_BETWEEN) for one in phrases[name] for word in one} | _RELATIVE
    for place in range(person + 1, min(len(words), person + 6)):
        if place in reading.taken:
            return None
        exact = [*phrases["first"], *phrases["last"], *phrases["ordinals"]]
        is_exact = (words[place],) in exact or ordinal_in_digits(words[place]) is not None
        number = _order(words[place], reading.language) if is_exact else None
        if number is not None and place > person + 1:
            reading.taken |= set(range(person, place + 1))
            return number
        if words[place] not in between:
            return None
    return None


def _number_behind(reading: Reading, person: int) -> int | None:
    """Take the number behind a person as the order of arrival: ``person two``, ``visitor number 2``."""
    words = reading.words
    place = person + 1 + (words[person + 1 : person + 2] in (["number"], ["no"], ["nummer"], ["numero"]))
    found = number_at(words, place) if place < len(words) and place not in reading.taken else None
    if found is not None and tuple(words[place + found[1] : place + found[1] + 1]) in reading.language.phrases["time"]:
        return None  # "anybody two times"
    if found is None or not found[0].is_integer() or not 1 <= found[0] <= _MOST_IN_ORDER:
        return None
    reading.taken |= set(range(person, place + found[1]))
    return int(found[0])


def take_ordinal(reading: Reading, referred: Set[int]) -> int | None:
    """Return which time a deed was done, 'the first time', 'the second greeting'; ``referred`` words name people."""
    words, phrases = reading.words, reading.language.phrases
    for one in phrases["end"]:
        alike, places = likeness(one, words, 0)
        if alike > _WHOLE:
            reading.taken |= set(places)
            return -1
    asking = {*phrases["what"], *phrases["which"], *phrases["at"]}
    for n, word in enumerate(words):
        number = _order(word, reading.language)
        is_time = n + 1 < len(words) and (words[n + 1],) in phrases["time"]
        is_unit = word in reading.language.units and (n + 1 < len(words) or (words[n - 1],) in asking)
        is_place = words[n + 1 : n + 2] == ["lugar"]
        is_order = words[max(0, n - 1)] in _DEFINITE or not is_unit or is_place
        is_counted = is_time or word in ("first", "last") or (n not in referred and is_order)
        if number is None or (n in reading.taken and not is_counted):
            continue
        reading.taken.add(n)
        if is_time:
            reading.taken.add(n + 1)
        return number
    return None


def take_quantity(reading: Reading, *, is_named: bool) -> Quantity:
    """Take words of quantity: ``twice``, ``again`` and ``only once``, or ``anybody else`` and ``three people``.

    ``Anybody twice`` is about several people, unless one ``is_named``.
    """
    words, phrases = reading.words, reading.language.phrases
    people = {n for n, word in enumerate(words) if (word,) in phrases["people"]}
    numbers = {n for n in range(len(words)) if number_at(words, n) is not None}
    counted = {n for n in range(1, len(words)) if (words[n],) in phrases["time"] and (
        n - 1 in numbers or _order(words[n - 1], reading.language) is not None)}  # fmt: skip
    found: dict[str, set[int]] = {"times": {place - one for place in counted for one in (0, 1)}, "others": set()}
    for name, places in found.items():
        for phrase in phrases[name]:
            begins = starts(phrase, words)
            if phrase in phrases["event after"]:  # "once t2 had left" is no "once, haven't you?"
                begins = [n for n in begins if {*words[n + 1 : n + 2]} <= reading.language.auxiliaries]
            places.update(n + one for n in begins for one in range(len(phrase)))
    whole = _DEFINITE | reading.language.first_words("all")
    several = {n for n in numbers if n + 1 in people and (n == 0 or words[n - 1] not in whole)}
    places = found["times"] | found["others"] | several
    if not places:
        return ""
    for place in sorted(places):
        reading.take("filler", place)
    is_about_others = bool(found["others"] or several) and not found["times"]
    return "others" if is_about_others or (people and not is_named) else "times"


# Names and persons


def take_names(reading: Reading, subjects: Subjects) -> tuple[dict[str, str], list[tuple[str, int]]]:
    """Take names from the words: things with the words before them (from, to), and agents with their places."""
    words = reading.words
    things: dict[str, str] = {}
    agents: list[tuple[str, int]] = []
    named = [(phrase, "agent", name) for name, phrases in subjects.agent_words().items() for phrase in phrases]
    grammar = {
        stem(word)
        for name, alternatives in reading.language.phrases.items()
        for one in alternatives
        for word in one
        if len(one) == 1 and name != "place"
    }
    named += [
        (phrase, "thing", name)
        for name, phrase in subjects.things.items()
        if name not in subjects.agents and (len(phrase) != 1 or not grammar.issuperset(map(stem, phrase)))
    ]
    named += [(tuple(tokens(name)), "person", name) for name in subjects.persons]
    for phrase, kind, name in sorted(named, key=lambda each: -len(each[0])):
        if len(phrase) == 1 and len(phrase[0]) < 3:
            continue
        alike, places = likeness(phrase, words, 0)
        exact = [words[place] == wanted for place, wanted in zip(places, phrase, strict=False)]
        is_name = alike > 0.95 or (bool(places) and len(phrase) > 1 and all(
            same or len(wanted) > 2 for same, wanted in zip(exact, phrase, strict=True)))  # fmt: skip
        if not is_name or not places or reading.taken & set(places) or (len(phrase) == 1 and not exact[0]):
            continue
        if kind == "person" and len(phrase) > 1 and not all(exact):
            continue
        reading.taken |= set(places)
        if kind == "agent":
            agents.append((name, places[0]))
        elif kind == "thing":
            things[name] = _word_before(reading, places[0])
        else:
            reading.take("named", *places)
            reading.take(f"person {name}", *places)
    tails = Counter(tuple(phrase[1:]) for phrase, kind, _ in named if kind != "person")
    short = {phrase[1:]: name for phrase, kind, name in named if kind == "thing" and tails[phrase[1:]] == 1}
    for n in range(len(words) - 1):
        name, places = short.get((words[n], words[n + 1])), {n, n + 1}
        is_written = words[n + 1].isdigit() and words[n + 2 : n + 3] != ["th"] and (
            not words[n + 2 : n + 3] or words[n + 2] not in reading.language.units)  # fmt: skip
        if name is not None and is_written and not reading.taken & places:
            reading.taken |= places  # "b1" is box_b1
            things[name] = _word_before(reading, n)
    deeds = {stem(word) for topic in subjects.topics for phrase in topic.loose for word in phrase}
    for name, phrases in subjects.agent_words().items():
        for n, word in enumerate(words):
            single = phrases[-1] if phrases else ()
            if stem(word) in deeds:
                continue  # "clean" is a deed of the cleaner
            is_begin = len(word) > 2 or subjects.begins_agent(word, reading.language)
            if n not in reading.taken and is_begin and len(single) == 1 and single[0].startswith(word):
                reading.taken.add(n)
                agents.append((name, n))
    return things, agents


_KEPT = {"to", "from", "into", "onto"}
"""English prepositions, as sentences have them."""


def _word_before(reading: Reading, place: int) -> str:
    """Return the word before a name and its article, a preposition of place in English; empty without one."""
    phrases = reading.language.phrases
    before = [word for word in reading.words[:place] if (word,) not in phrases["article"]]
    found = next((name for name in ("to", "from") if before and (before[-1],) in phrases[name]), "")
    if not found and reading.language.code == "de" and tuple(reading.words[-1:]) in phrases["from"]:
        found = "from"  # "Wann hast du die Küche verlassen?"
    is_word = reading.language.code == "en" and before and before[-1] in _KEPT
    return found if found and not is_word else "".join(before[-1:])


def take_person(reading: Reading, subjects: Subjects) -> PersonReference | None:
    """Take a person by name or by order of arrival from the words."""
    words, phrases = reading.words, reading.language.phrases
    people = {one for one in phrases["people"] if len(one) == 1}
    named = [name for name in subjects.persons if reading.has(f"person {name}")]
    if named:
        places = [reading.place(f"person {name}") for name in named]
        reading.taken |= {place - 1 for place in places if place and (words[place - 1],) in people}
        return PersonReference(names=tuple(named))
    for n, word in enumerate(words):
        number = None if n in reading.taken else _order(word, reading.language)
        near = [place for place in (n + 1, n - 1) if 0 <= place < len(words) and (words[place],) in people]
        if number is not None and near:
            reading.taken |= {n, near[0]}
            return PersonReference(ordinal=number)
    for n, word in enumerate(words):
        if word == "number" and subjects.persons and n not in reading.taken:
            number = _number_behind(reading, n)
            if number is not None:
                return PersonReference(ordinal=number)  # "number three"
    for n, word in enumerate(words):
        # "the man who came first", "two people"
        if n not in reading.taken and (word,) in people:
            number = _order_behind(reading, n) or _number_behind(reading, n)
            if number is not None:
                return PersonReference(ordinal=number)
            counted = number_at(words, n - 1) if n else None
            is_group = n > 0 and words[n - 1] in _DEFINITE and (word,) in phrases["group"]
            if counted is not None and n - 1 not in reading.taken:
                reading.taken.add(n - 1)
                is_meant = n > 1 and (words[n - 2] in _DEFINITE or (words[n - 2],) in phrases["which"])
                is_group = is_meant and counted[0] == 2.0 and words[n - 3] != "of"
            if is_group:
                return PersonReference(together=True)  # "the two people", "the couple"
        elif _is_pair(words, n) and n not in reading.taken:
            reading.take("people", n)
            return PersonReference(together=True)
    return None


def _is_pair(words: Sequence[str], place: int) -> bool:
    """Return whether a word is that for two people whom a relative clause describes: ``the two who came in``."""
    is_definite = place > 0 and words[place - 1] in _DEFINITE | _PLURAL
    counted = number_at(words, place)
    following = words[place + 1 :] if words[place] in _BOTH else words[place + 1 : place + 2]
    is_two = words[place] in _BOTH or (counted is not None and counted[0] == 2.0)
    return is_definite and is_two and not _RELATIVE.isdisjoint(following)
