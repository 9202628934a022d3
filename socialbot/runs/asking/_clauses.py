"""Parts of a question beside its main clause.

"I wonder why you left" depends on a clause that only asks, "Why did you help t1, but not t2?" contrasts, and "What did
you do after t1 had left?" tells its time by an event.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

from socialbot.runs.asking._words import is_at, starts
from socialbot.runs.asking.languages import INTERROGATIVES, Language

Relation = Literal["after", "before", "when"]

_TELLERS = {"i", "we", "they", "he", "she", "somebody", "someone", "people", "everybody"}
_HEARSAY = {
    "told", "said", "say", "says", "heard", "hear", "believe", "think", "thought", "guess", "suppose", "assume",
    "claim", "claims", "bet", "reckon", "understand", "understood", "noticed", "saw", "gather",
}  # fmt: skip
_INDEFINITE = {"anything", "something", "etwas", "algo"}
"""Words that ask for a thing, but begin no indirect question: ``Did you say anything to me?``"""
_HEARING = {"hear", "heard"}
_TAGS = ("true", "correct", "right")
CLOSELY = {
    "right", "just", "immediately", "directly", "shortly", "soon", "straight", "direkt", "unmittelbar", "gleich",
    "kurz", "juste", "immediatement", "justo", "inmediatamente", "next",
}  # fmt: skip
"""Words for a short time before or after an event."""
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
    is_near: bool = False
    """Whether only what is next to the event is in question: ``right after``."""
    until: tuple[str, ...] = ()
    """The second of two events that the time is between."""


def without_report(words: Sequence[str], language: Language) -> Parts | None:
    """Split off what somebody asked or told: ``Did t1 ask why you left?``; None without it.

    A person in front of the indirect question has done that: ``Can somebody tell me why you left?`` only asks.
    """
    asking = [one for name in INTERROGATIVES for one in language.phrases[name]] + list(language.phrases["complement"])
    past, mine = language.first_words("past") | _ASKED, language.first_words("me")
    people = language.first_words("people", "them")
    for place in range(2, len(words) - 1):
        before = words[:place]
        if not any(is_at(phrase, words, place) for phrase in asking) or not _ASKED.intersection(before):
            continue
        verb = next(n for n, word in enumerate(before) if word in _ASKED)
        named = [n for n in range(place) if n and before[n].isdigit() and before[n - 1] == "t"]
        if language.voices.you.intersection(before[:verb]):
            continue  # "What led to you asking t1 whether ...?"
        is_told = bool(named) or (before[0] in language.auxiliaries | _ASKED and bool(people.intersection(before)))
        if is_told and past.intersection(before) and not mine.intersection(before) and verb + _ASIDE >= place:
            return Parts(tuple(before), event=tuple(words[place:]))
    return None


_ASKED = {
    "ask", "asked", "asks", "asking", "tell", "told", "say", "said", "inquire", "inquired", "enquire", "enquired",
    "gefragt", "fragte", "gesagt", "sagte", "erkundigt", "demande", "demanda", "dit", "pregunto", "preguntado", "dijo",
    "dicho",
}  # fmt: skip
"""Verbs of asking and telling in the past tense, or with an auxiliary."""
TELLS = {"did", "have", "hast", "habt", "as", "avez", "has", "dijiste", "contaste", "explicaste"}
"""Words that ask whether the robot told something."""
_ASIDE = 4
"""Most words from such a verb to the indirect question."""


def without_matrix(words: Sequence[str], language: Language) -> list[str]:
    """Return an indirect question without the clause that it depends on.

    ``I wonder why you ...``, ``Is it true that you ...`` and ``..., can you tell me?`` only ask. Their negation and
    their time are no part of the question.
    """
    words = _without_end(words, language)
    if without_report(words, language) is not None:
        return list(words)
    before = words[: words.index("you")] if "you" in words else ()
    if before and words[0] in _TELLERS and _HEARSAY.intersection(before) and {"me", "that"}.issuperset(before[2:]):
        return list(words[len(before) :])  # "Somebody told me you ..."
    if len(words) > 4 and (words[1], words[2] in _HEARING, words[3]) == ("you", True, "me"):
        return [words[0], "i", *words[4:]]  # "Did you hear me say ...?"
    asking = [one for name in INTERROGATIVES for one in language.phrases[name] if one[0] not in _INDEFINITE]
    thinking, aside = language.first_words("matrix"), _function_words(language)
    people = language.first_words("people", "them") | {"t"}
    for place, word in enumerate(words):
        before = words[:place]
        is_event = (word,) in language.phrases["event when"] and (words[0],) in language.phrases["past"]
        is_asking = any(is_at(phrase, words, place) for phrase in asking)
        # "Quote what you said": a verb in front of an interrogative asks, too.
        asks = thinking.intersection(before) or (place == 1 and before[0] not in language.known_words)
        is_where = any(is_at(phrase, words, place) for phrase in language.phrases["where"])
        if TELLS.intersection(before[:2]) and (is_where or people.intersection(before[2:])):
            continue  # "Did you tell me where ...?" and "Did you tell t1 why ...?" ask what was told
        if place and is_asking and not is_event and asks:
            return list(words[place:])
        for phrase in language.phrases["complement"]:
            is_linked = len(phrase) > 1 or thinking.intersection(before)
            if place and is_linked and is_at(phrase, words, place):
                return list(words[place + len(phrase) :])
        if word not in thinking and word not in aside and (place or word in language.known_words):
            break
    return list(words)


def _without_end(words: Sequence[str], language: Language) -> Sequence[str]:
    """Return words without another question at their end: ``..., do you know?``, ``... or did you not?``."""
    asking = language.first_words(*INTERROGATIVES)
    thinking, aside = language.first_words("matrix"), _function_words(language)
    if len(words) > 3 and words[-1] in _TAGS and words[-2] not in (*language.auxiliaries, "the", "your", "my", "to"):
        words = words[:-1]
    for place in range(3, len(words)):
        alternative = words[place + 1 : place + 2]
        if (words[place],) in language.phrases["or"] and (
            {*alternative} & language.auxiliaries or (tuple(alternative) in language.phrases["not"])
        ):
            return words[:place]  # "... or did you forget somebody?"
    for place in range(max(3, len(words) - _MOST_WORDS), len(words) - 2):
        end = words[place:]
        is_aside = all(word in thinking or word in aside for word in end) and bool(thinking.intersection(end))
        if end[0] in language.auxiliaries and is_aside and words[place - 1] not in asking:
            return words[:place]
    return words


def _function_words(language: Language) -> set[str]:
    return language.single_words("you", "me", "them", "not", "auxiliary", "present", "past", "future", "filler")


def without_contrast(words: Sequence[str], language: Language) -> Parts | None:
    """Split off who or what is contrasted: ``and not t2``, ``rather than t2``, ``but t2 did not``; None without it."""
    for phrase in language.phrases["why not"]:
        for place in range(2, len(words) - len(phrase)):
            if is_at(phrase, words, place):
                # "You helped t1, so why not t2?"
                return Parts((phrase[0], *words[:place]), tuple(words[place + len(phrase) :]), is_denied=True)
    for place in range(2, len(words)):
        for phrase in language.phrases["rather"]:
            if is_at(phrase, words, place):
                return Parts(tuple(words[:place]), tuple(words[place + len(phrase) :]))
        for phrase in language.phrases["but"]:
            rest = words[place + len(phrase) :]
            if not is_at(phrase, words, place) or len(rest) > _MOST_WORDS:
                continue
            denied = _without(rest, language.phrases["not"])
            if len(denied) < len(rest):
                return Parts(tuple(words[:place]), tuple(denied), is_denied=True)
    return None


def without_event(words: Sequence[str], language: Language) -> Parts | None:
    """Split off the event that tells the time, behind the main clause or in front of it; None without one."""
    asking = [one for name in INTERROGATIVES if name != "when" for one in language.phrases[name]]
    verbs: tuple[tuple[Relation, str], ...] = (("after", "follows"), ("before", "precedes"))
    for relation, name in verbs:
        for begin, verb in product(language.phrases["what"], language.phrases[name]):
            event = words[len(begin) + len(verb) :]
            if event and (*words[: -len(event)],) == (*begin, *verb):  # "What followed the first greeting?"
                return Parts((*begin, *language.phrases["happen"][0]), event=(*event,), relation=relation)
    asking += [(one,) for one in language.auxiliaries]
    relations: tuple[Relation, ...] = ("after", "before", "when")
    for place in range(len(words) - 1):
        for relation in relations:
            for phrase in sorted(language.phrases[f"event {relation}"], key=len, reverse=True):
                if not is_at(phrase, words, place) or place + len(phrase) == len(words):
                    continue
                rest = words[place + len(phrase) :]
                if rest[0] in language.auxiliaries or (place < 2 and phrase[0] == language.sentences["and"]):
                    continue
                asked = next((n for n in range(2, len(rest) - 1) if _asks(rest[n : n + 2], language)), None)
                if place >= 2 and asked is not None:
                    # The event in the middle: "How soon after t2 came did you greet her?"
                    main = (*words[:place], *rest[asked:])
                    return Parts(main, event=tuple(rest[:asked]), relation=relation)
                if place >= 2:
                    main, end = tuple(words[:place]), 1 if (rest[-1],) in language.phrases["why"] and rest[1:] else 0
                    # "You left before t1 came. Why?"
                    main, event = _with_verb((*rest[len(rest) - end :], *main), rest[: len(rest) - end], language)
                    is_near = words[place - 1] in CLOSELY or main[-1] in CLOSELY
                    return Parts(main, event=event, relation=relation, is_near=is_near)
                # The event in front: "When t2 left, what did you do?"
                is_near = place == 1 and words[0] in CLOSELY
                is_front = place == 0 or is_near
                begins = [
                    n
                    for n in range(2, len(rest) - 1)
                    if is_front and any(is_at(one, rest, n) for one in asking) and rest[n + 1] not in _INVERTED
                ]
                asks = (n for n in begins if rest[n] not in language.auxiliaries or _asks(rest[n : n + 2], language))
                begin = next(asks, next(iter(begins), None))
                if begin is not None:
                    main = list(rest[begin:])
                    if relation == "when" and len(main) > 2 and (main[-1],) in language.phrases["event after"]:
                        relation = "after"  # "When t2 left, what did you do right after?"
                        is_near = main[-2] in CLOSELY
                        main = main[:-2] if is_near else main[:-1]
                    return Parts(tuple(main), event=tuple(rest[:begin]), relation=relation, is_near=is_near)
    return None


def without_between(words: Sequence[str], language: Language) -> Parts | None:
    """Split off two events that the time is between: ``between the bathroom and the kitchen``; None without them."""
    linking = language.sentences["and"]
    asking = language.first_words(*INTERROGATIVES) | language.auxiliaries
    for place in (n for n, word in enumerate(words) if word in language.single_words("between")):
        rest = words[place + 1 :]
        link = next((n for n in range(1, len(rest) - 1) if rest[n] == linking), None)
        if link is None:
            continue
        end = next((n for n in range(link + 2, len(rest)) if place < 2 and rest[n] in asking), len(rest))
        main = (*words[:place], *rest[end:])
        if main:
            main, until = _with_verb(main, rest[link + 1 : end], language)
            return Parts(main, event=tuple(rest[:link]), relation="after", until=until)
    return None


_INVERTED = {"il", "elle", "ils", "elles", "t"}
"""French pronouns behind the verb of their own clause: ``Quand le camion est-il parti ?``."""
_PARTICIPLE = re.compile(r"([a-z]{2,3})?ge[a-z]+(t|en)|(be|ver|er|ent)[a-z]+t|(ver|ent)[a-z]+en")


def _with_verb(main: Sequence[str], end: Sequence[str], language: Language) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return a main clause with its German verb, which is behind the event: ``Was hast du nach dem Bad gemacht?``."""
    is_split = language.code == "de" and len(end) > 1 and _PARTICIPLE.fullmatch(end[-1])
    if not is_split or any(_PARTICIPLE.fullmatch(word) for word in main):
        return tuple(main), tuple(end)
    return (*main, end[-1]), tuple(end[:-1])


def _without(words: Sequence[str], phrases: Sequence[Sequence[str]]) -> list[str]:
    taken = {place + n for phrase in phrases for place in starts(phrase, words) for n in range(len(phrase))}
    return [word for place, word in enumerate(words) if place not in taken]


def _asks(pair: Sequence[str], language: Language) -> bool:
    """Return whether two words begin a question to the robot: ``did you``."""
    return pair[0] in language.auxiliaries and tuple(pair[1:]) in language.phrases["you"]


_BEFORE_QUESTION = 5
"""Most words before the interrogative of an indirect question: ``could you please tell me why``."""


def is_question(words: Sequence[str], language: Language) -> bool:
    """Return whether words have the form of a question: an auxiliary verb or an interrogative begins them.

    An interrogative may also follow words that only ask, such as ``please tell me``.
    """
    asking = [one for name in INTERROGATIVES for one in language.phrases[name]]
    thinking, aside = language.first_words("matrix"), _function_words(language)
    for place, word in enumerate(words[: _BEFORE_QUESTION + 1]):
        if any(is_at(phrase, words, place) for phrase in asking):
            return True
        if place == 0 and word in language.auxiliaries and len(words) > 2:
            is_denied = tuple(words[1:2]) in language.phrases["not"]  # "Do not call Anna" is no question.
            return not is_denied or tuple(words[2:3]) in language.phrases["you"]
        if word not in thinking and word not in aside:
            return False
    return False
