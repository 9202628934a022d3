"""Questions back: the two most likely readings of a question that is not understood surely, and the reply to them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import msgspec

from socialbot.runs.asking._sentences import Answer, time_in_words
from socialbot.runs.asking._words import tokens
from socialbot.runs.asking.languages import ENGLISH

LEAST = 0.12
"""Least probability of a reading that is offered."""
LEAST_OF_ALL = 0.25
"""Least probability of all offered readings together."""
LEAST_ALONE = 0.4
"""Least probability of a reading that is offered alone."""
NEAR = 0.8
"""Share of the probability of the best reading from which on the second one is near."""
MOST = 2

_TIME = re.compile(r"^(at [\d.]+ s|\d+ seconds ago|just now|from [\d.]+ to [\d.]+ s) ", re.IGNORECASE)
_STATES = {
    "see": "what I saw", "said": "what I said", "doing": "what I did", "next": "what I intended", "who": "who was here",
    "when": "who was here", "heard": "what people said", "failed": "what failed", "count": "how many people were here",
    "how_long": "how long people were here", "ended": "how the plan ended",
    "where": "where it was",
}  # fmt: skip
_DEEDS = {
    "why": "why", "why_not": "why", "when": "when", "count": "how often", "did": "whether", "how_long": "how long",
    "who": "who was concerned when",
}  # fmt: skip
_UNDONE = {"why_not", "did", "doing", "see", "next"}
"""Kinds of questions that are offered although their answer begins with something that was not done."""
_REPLIES = (
    {"first", "former", "1", "1st", "yes", "yeah", "yep", "sure", "correct", "exactly", "right"},
    {"second", "latter", "2", "two", "2nd", "last", "other"},
)
"""Words of a reply that choose the first and the second reading."""
_BESIDE = {
    "please", "the", "one", "i", "mean", "meant", "ask", "asked", "you", "me", "that", "did", "is", "it", "was", "want",
    "to", "know", "oh", "okay", "thanks", "no",
}  # fmt: skip
"""Words that a reply may have, too."""


def offered(answers: Sequence[tuple[Answer, float]], sure: float, asked_at_s: float | None = None) -> list[Answer]:
    """Return the answers to the readings to ask back with, each with its reading as an indirect question.

    There are none if the question is understood or hopeless.

    Args:
        answers: Different answers that are known, with the probabilities of their readings, the most likely one first.
        sure: Probability from which on the best one is understood.
        asked_at_s: Time of a spoken question, to tell times as "9 seconds ago"; None: as "at 3.6 s".
    """
    if not answers or answers[0][0].language != "en":
        return []
    best = answers[0][1]
    answers = [each for each in answers if each[0].intent in _UNDONE or each[0].clauses[0].claim.kind != "did_not"]
    likely = [each for each in answers[:MOST] if each[1] >= LEAST]
    is_near = len(likely) == MOST and likely[1][1] >= NEAR * best
    least = LEAST_OF_ALL if len(likely) == MOST else LEAST_ALONE
    if (best >= sure and not is_near) or sum(share for _, share in likely) < least:
        return []
    found: dict[str, Answer] = {}
    for one, share in likely:
        text = _indirect(one, asked_at_s)
        text = _timed(text, one, asked_at_s) if text in found else text
        if text not in found:
            found[text] = msgspec.structs.replace(one, question=text, confidence=round(share, 3))
    return list(found.values())


def asking_back(options: Sequence[str]) -> str:
    """Return the question back.

    >>> asking_back(["why I greeted you", "when I greeted you"])
    'Do you ask why I greeted you, or when?'
    """
    first, *others = options
    if not others:
        return f"Do you ask {first}?"
    word, _, rest = others[0].partition(" ")
    is_same = first.partition(" ")[2] == rest
    return f"Do you ask {first}, or {word if is_same else others[0]}?"


def chosen_option(options: Sequence[str], reply: str) -> int:
    """Return the number of the option that a reply chooses, from 1 on, or 0 for none of them.

    >>> options = ["why I greeted you", "when I greeted you"]
    >>> [chosen_option(options, each) for each in ("the second", "When.", "why, please", "yes", "no", "Where is Bob?")]
    [2, 2, 1, 1, 0, 0]
    """
    words = set(tokens(reply))
    said = [set(tokens(each)) for each in options]
    for place, own in enumerate(said, 1):
        others = {word for each in said if each is not own for word in each}
        if words & (own - others) and not words & (others - own) and words <= own | _REPLIES[0] | _BESIDE:
            return place
    numbered = [n for n, known in enumerate(_REPLIES[: len(options)], 1) if words & known]
    is_reply = len(numbered) == 1 and words <= _REPLIES[numbered[0] - 1] | _BESIDE
    return numbered[0] if is_reply else 0


def _indirect(one: Answer, asked_at_s: float | None) -> str:
    """Return the question that is answered, as in ``why I greeted you``."""
    claims = [each for each in one.clauses if each.claim.kind in ("did", "did_not", "said", "said_not", "wanted")]
    if one.intent in _DEEDS and claims:
        told, agent = _TIME.sub("", claims[0].text), f"{claims[0].claim.agent} "
        told = told.replace(" did not ", " did ", 1) if one.intent == "did" else told
        if one.intent == "who" and told.startswith(agent):
            return f"who {told.removeprefix(agent)}"
        return f"{_DEEDS[one.intent]} {told}"
    if one.intent == "believed":
        return f"whether {_TIME.sub('', one.clauses[0].text)}"
    if one.clauses[0].claim.kind == "count":
        return "how often I spoke"
    text = _STATES.get(one.intent, _STATES["heard"])  # "Did t1 thank you?" is answered by what t1 said
    return _timed(text, one, asked_at_s) if one.intent in ("see", "said", "doing", "next") else text


def _timed(text: str, one: Answer, asked_at_s: float | None) -> str:
    at_s = one.clauses[0].claim.at_s
    return text if at_s is None else f"{text} {time_in_words(at_s, asked_at_s, ENGLISH.sentences)}"
