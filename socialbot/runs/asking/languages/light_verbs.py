"""English verbs that carry another verb or a noun: ``got rejected``, ``let Ann come in``.

A question with such a verb is rewritten with the verb that carries its meaning. Only its structure counts, not the
deeds of an agent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

_GOT = ("gets", "got")
_AUXILIARIES = {"did", "does", "do", "has", "have", "had"}
_LET = ("let", "lets", "letting", "allow", "allowed", "permit", "permitted")
_ENTER = ("come", "go", "get", "walk", "step", "pass", "enter")
_INSIDE = ("in", "inside", "into", "through", "past")
_MOST_BETWEEN = 3
"""Most words of an object: ``let the second visitor come in``."""
_THANKS = {"thank": "thank you", "thanked": "thank you", "apologised": "sorry", "apologized": "sorry"}
_PARTICIPLES = {"sent", "told", "put", "let", "shut", "kept", "made", "left", "taken", "driven", "brought", "given"}
_NO_PARTICIPLES = {"bed", "red", "need", "speed", "rid"}
_REPLY = ("answer", "reply", "respond")
_SUBJECTS = {"you", "i", "we", "he", "she", "they", "the"}
_DID = {"did": "do", "said": "say"}
_ADDRESSED = (["asked"], ["told"])
_LEAVE = {"left": "departed", "leave": "depart", "leaves": "departs"}
_BEHIND_LEAVE = {"before", "after", "first", "last", "at", "so", "for", "when", "early", "earlier", "later", "without"}
_HALFWAY = ("halfway", "midway", "partway")
_UNITS = {"s", "sec", "seconds", "second", "minute", "minutes"}


def without_light_verbs(words: Sequence[str], *, has_people: bool) -> list[str]:
    """Return the words of an English question with the verbs that carry its meaning.

    Args:
        words: Words of a question.
        has_people: Whether people come and go in the run; else robots do, by driving.
    """
    result = list(words)
    for rewrite in _REWRITES:
        result = rewrite(result)
    return result if has_people else _departed(result)


def _admitted(words: list[str]) -> list[str]:
    """``let Ann come in`` is ``let Ann in``."""
    for place, word in enumerate(words):
        if word not in _LET:
            continue
        for at in range(place + 2, min(place + 3 + _MOST_BETWEEN, len(words))):
            is_entering = words[at] in _ENTER or (words[at] == "to" and words[at + 1 : at + 2] in [[e] for e in _ENTER])
            end = at + 2 if words[at] == "to" else at + 1
            if is_entering and words[end - 1] == "enter":
                return [*words[:place], "let", *words[place + 1 : at], "in", *words[end:]]
            if is_entering and words[end : end + 1] and words[end] in _INSIDE:
                return [*words[:place], "let", *words[place + 1 : at], "in", *words[end + 1 :]]
    return words


def _received(words: list[str]) -> list[str]:
    """``got rejected`` is ``was rejected``, ``been to the kitchen`` is ``gone to the kitchen``."""
    result = list(words)
    for place in range(1, len(words) - 1):
        word, following = words[place], words[place + 1]
        is_participle = following in _PARTICIPLES or (following.endswith("ed") and following not in _NO_PARTICIPLES)
        if word in _GOT and is_participle and not _AUXILIARIES.intersection(words[:place]):
            result[place] = "was"
        elif word == "been" and following == "to":
            result[place] = "gone"
        elif word in ("gets", "got") and following in ("in", "inside") and words[place - 1] in ("who", "anybody"):
            result[place : place + 2] = ["was", "let in"]
    return [part for word in result for part in word.split()]


def _ended(words: list[str]) -> list[str]:
    """``how many boxes ended up on c`` is ``how many boxes were put on c``."""
    for place in range(1, len(words) - 2):
        pair = tuple(words[place : place + 2])
        if pair in (("ended", "up"), ("end", "up"), ("wound", "up")) and words[place + 2] in ("on", "onto"):
            return [*words[:place], *(["were"] if pair[0] != "end" else []), "put", *words[place + 2 :]]
    return words


def _permitted(words: list[str]) -> list[str]:
    """``who let the robot start cleaning`` is ``who permitted the robot cleaning``."""
    for place, word in enumerate(words):
        if word not in _LET:
            continue
        for at in range(place + 2, min(place + 2 + _MOST_BETWEEN + 1, len(words) - 1)):
            if words[at] in ("start", "begin") and words[at + 1].endswith("ing"):
                return [
                    *words[:place],
                    "permitted" if place < 2 else "permit",
                    *words[place + 1 : at],
                    *words[at + 1 :],
                ]
    return words


def _replied(words: list[str]) -> list[str]:
    """``how did you answer`` is ``what did you say``."""
    for place in range(len(words) - 3):
        if words[place : place + 3] == ["how", "did", "you"] and words[place + 3] in _REPLY:
            return [*words[:place], "what", "did", "you", "say", *words[place + 4 :]]
    return words


def _spoken(words: list[str]) -> list[str]:
    """``when they thanked you`` is ``when they said thank you``; ``when you were asked`` is ``when they asked you``."""
    for place in range(1, len(words) - 1):
        if words[place] in _THANKS and words[place + 1] == "you" and words[place - 1] not in ("did", "to"):
            return [*words[:place], "said", *_THANKS[words[place]].split(), *words[place + 2 :]]
        is_passive = words[place + 1 : place + 3] == ["you", "were"] and words[place + 3 : place + 4] in _ADDRESSED
        if words[place] in ("when", "after", "once") and is_passive:
            return [*words[: place + 1], "they", words[place + 3], "you", *words[place + 4 :]]
    return words


def _cleft(words: list[str]) -> list[str]:
    """``was it spot who opened it`` is ``did spot opened it``: forms of a verb do not count."""
    if words[:2] in (["was", "it"], ["is", "it"]):
        link = next((n for n in range(3, min(6, len(words) - 1)) if words[n] in ("who", "that")), 0)
        if link and words[link + 1] in _SUBJECTS:
            return ["did", *words[link + 1 :], *words[2:link]]  # "was it t1 that you helped"
        if link:
            return ["did", *words[2:link], *words[link + 1 :]]
    return words


def _last_thing(words: list[str]) -> list[str]:
    """``what was the last thing you did`` is ``what did you do last``."""
    for place in range(len(words) - 6):
        is_thing = words[place] == "what" and words[place + 1] in ("was", "is") and words[place + 2] == "the"
        if is_thing and words[place + 3] in ("first", "last", "next") and words[place + 4] == "thing":
            end = next((n for n in range(place + 6, len(words)) if words[n] in _DID), 0)
            if end:
                subject = words[place + 5 : end]
                return [*words[:place], "what", "did", *subject, _DID[words[end]], words[place + 3], *words[end + 1 :]]
    return words


def _delayed(words: list[str]) -> list[str]:
    """``why did it take you so long to offer help`` is ``why did you offer help``."""
    for place in range(len(words) - 4):
        if words[place : place + 2] == ["it", "take"]:
            end = next((n for n in range(place + 3, min(place + 8, len(words) - 1)) if words[n] == "to"), 0)
            if end and words[end - 2 : end] == ["so", "long"]:
                return [*words[:place], *words[place + 2 : end - 2], *words[end + 1 :]]
    return words


def _departed(words: list[str]) -> list[str]:
    """``carrier b left before`` is ``carrier b departed before``."""
    result = list(words)
    for place in range(1, len(words)):
        if words[place] in _LEAVE and {*words[place + 1 : place + 2]} <= _BEHIND_LEAVE:
            result[place] = _LEAVE[words[place]]
    return result


def _dated(words: list[str]) -> list[str]:
    """``halfway through, at 30 seconds`` is ``at 30 seconds``."""
    if not _UNITS.intersection(words):
        return words
    place = next((n for n, word in enumerate(words) if word in _HALFWAY), None)
    if place is None:
        return words
    return [*words[:place], *words[place + (2 if words[place + 1 : place + 2] == ["through"] else 1) :]]


_REWRITES: tuple[Callable[[list[str]], list[str]], ...] = (
    _admitted,
    _received,
    _ended,
    _permitted,
    _replied,
    _spoken,
    _dated,
    _cleft,
    _last_thing,
    _delayed,
)
