"""Kinds of questions, by the classes of their words."""

from __future__ import annotations

from typing import Literal

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._word_classes import tells
from socialbot.runs.asking.languages import INTERROGATIVES

_ACTIVE = {"did", "does", "has", "have", "had"}
_RECEIVES = {
    "get", "got", "gotten", "receive", "received", "have", "had", "been", "be", "not", "obtain", "experience", "hear",
    "who", "that", "in", "at", "or", "and", "with", "from",
}  # fmt: skip
"""Verbs that say that something is done to a person, and words that begin a description of a person."""
_NUMERALS = {"twice", "thrice"}
_ADVERBS = {"ever", "already", "also", "even", "really", "actually", "just", "yet", "indeed", "never", "only", "still"}

Kind = Literal["why", "why_not", "see", "next", "doing", "said", "who", "when", "how_long", "count", "did"]


def kind_of(reading: Reading, has_topic: bool, has_time: bool, has_span: bool) -> tuple[Kind | None, float]:
    """Return the kind of question by the classes of its words, and how sure it is."""
    has = reading.has
    sure = min((max(alike for alike, _ in reading.found[name]) for name in INTERROGATIVES if has(name)), default=1.0)
    past = has("past") or has_time or has_span
    if has("longest", "shortest") and not has_topic and has("who", "what", "here", "people"):
        return "who", sure  # "Whose visit was the longest?"
    if "would" in reading.words and "if" in reading.words and not has("why"):
        return None, 0.0  # "What would you do if ten people came?"
    if has("unanswerable") and not has("why", "how_often", "how_many", "how_long", "how_far", "what", "when", "where"):
        return None, 0.0
    if not has_topic and has("say") and _is_said_by_a_person(reading):
        return None, 0.0
    if _is_done_to_robot(reading) or (not has_topic and _is_described(reading)):
        return None, 0.0
    if has("plan") and not has_topic and has("named", "people") and not has("you"):
        return None, 0.0  # what people want is not known
    if not has(*INTERROGATIVES) and not has("here", "see", "longest", "shortest") and _is_done_by_a_person(reading):
        return None, 0.0  # "Did t4 like your help?"
    if has_topic and not has(*INTERROGATIVES) and not has("past") and _is_request(reading):
        return None, 0.0  # "Can you greet t3 now?"
    if has("why") and not has_topic and has("here") and has("people", "named") and not has("you", "not", "say"):
        return None, 0.0  # why people come and go is not known
    if has("why"):
        return ("why_not" if has("not") else "why"), sure
    if has("how_long"):
        return ("how_long", sure) if has_topic or has("here", "people", "me", "named") else (None, 0.0)
    if has("how_far"):
        return ("see", sure) if has("people", "me", "named", "see") else (None, 0.0)
    if has("where"):
        # The sentence of a deed has its place.
        return ("when", sure) if has_topic else (None, 0.0)
    if has("how_often"):
        return "count", sure
    if has("when"):
        return ("when", sure) if has_topic or has("here", "see", "say", "people", "me") else (None, 0.0)
    if has("how_many"):
        if has("people") and has("named") and not has_topic and not has("see", "here"):
            return None, 0.0  # "How many children does t1 have?"
        if has("people"):
            if has_time and not has_topic:
                return "see", sure
            is_now = has("see", "present") and not has("past", "here")
            return ("see" if is_now and not tells(reading.words, reading.language, "overall") else "count"), sure
        return ("count", sure) if has_topic else (None, 0.0)
    if has("who"):
        if has_topic:
            return "who", sure
        if has("see") and has("past") and not has_time:
            return "who", sure  # "Who did you see?"
        if has("see") or (has("here") and not has("past", "first", "last") and not has_time):
            return "see", sure
        return ("who", sure) if has("here", "people", "longest", "shortest") or past else (None, 0.0)
    if has("what"):
        return _what(reading, has_topic, sure)
    if has_topic:
        if _NUMERALS.intersection(reading.words):
            return "count", 1.0  # "You greeted t1 twice, right?"
        return ("next" if has("future", "plan") and not has("past") else "did"), 1.0
    if has("say") and has("you"):
        return "did", 0.95
    if has("see"):
        return "see", 0.95
    if has("future") and not has("past", "you"):
        return None, 0.0  # "Will t1 come back?"
    if has("here") and has("people", "nobody", "me", "named") and not _robot_acts(reading):
        return ("who" if has("past") else "see"), 0.9
    if has("people", "nobody") and has("present", "past") and not _robot_acts(reading):
        return ("who" if has("past") else "see"), 0.8
    if has("people", "nobody") and has_time:
        return "see", 0.9  # "Any visitors at 12 s?"
    acts = [places[0] for _, places in reading.found.get("do", ())]
    is_active = any(reading.words[one] not in reading.language.auxiliaries for one in acts)
    if is_active and has("you") and has("present"):
        return "doing", 0.9  # "Are you occupied?"
    if has("plan", "next") and (len(reading.words) <= 4 or (has("plan") and has("you"))):
        return "next", 0.8
    return None, 0.0


def _what(reading: Reading, has_topic: bool, sure: float) -> tuple[Kind | None, float]:
    has = reading.has
    if has("see") and not has_topic:
        return "see", sure
    if has("say") and not has_topic and not has("future"):
        return "said", sure
    if has("next", "plan", "future") and not has("past"):
        return ("next", sure) if has("you") or not has("people", "named") else (None, 0.0)  # people's plans: unknown
    phrases, place = reading.language.phrases, reading.place("what")
    asks_people = tuple(reading.words[place + 1 : place + 2]) in phrases["people"]
    if (reading.words[place],) in phrases["which"] and (has_topic or (asks_people and has("here"))):
        return "who", sure
    if has("do", "happen", "plan"):
        return "doing", sure
    if has("people", "here", "named") and not has_topic and not _robot_acts(reading):
        return "see", sure * 0.9
    if has_topic and not has("you") and reading.words[place + 1 : place + 2] in (["got"], ["was"], ["were"]):
        return "when", sure  # "What was loaded first?": the sentence of the deed has its things
    return ("did" if has_topic and has("you", "past") else None), sure * 0.7


def _is_request(reading: Reading) -> bool:
    """Return whether the robot is asked to do something: ``Can you greet t3?``, ``Please greet t3``."""
    places: tuple[int, ...] = reading.found["topic"][0][1]
    if any(reading.words[place].endswith(("ed", "ing")) for place in places):
        return False
    if any(tuple(reading.words[: len(one)]) == one for one in reading.language.phrases["request"]):
        return True
    if reading.language.code != "en":
        return False  # the first word may be a verb of the past
    # "Help me!"
    following = tuple(reading.words[places[-1] + 1 :][:1])
    is_noun = following in (("for",), ("of",), ("to",)) or not following
    return places[0] == 0 and not reading.has("you", "named") and not is_noun


def _is_done_by_a_person(reading: Reading) -> bool:
    """Return whether a person does something else than to get or to be: ``Did t2 smile?``, ``Has t1 fallen?``."""
    words = reading.words
    persons = {place for name in ("named", "people") for _, places in reading.found.get(name, ()) for place in places}
    aside = {*_ADVERBS, *(one[0] for one in reading.language.phrases["ordinals"]), "the", "first", "last"}
    begin = next((n for n, word in enumerate(words) if word in _ACTIVE), None)
    if reading.language.code != "en" or begin is None:
        return False
    place = begin + 1
    while place < len(words) and words[place] in aside:
        place += 1
    if place not in persons:
        return False
    verb = next((n for n in range(place, len(words)) if n not in persons and words[n] not in _ADVERBS), None)
    return verb is not None and words[verb] not in _RECEIVES and not words[verb].isdigit()


def _is_said_by_a_person(reading: Reading) -> bool:
    """Return whether a person speaks, and not the robot: ``did t2 say anything``, ``did anybody talk to you``."""
    if reading.language.code == "es":
        return False  # the form of the verb alone addresses the robot
    verb = reading.place("say")
    speakers = [places[0] for name in ("named", "people", "nobody") for _, places in reading.found.get(name, ())]
    robot = [places[0] for _, places in reading.found.get("you", ())]
    speakers += [place for place, word in enumerate(reading.words) if word in ("they", "he", "she")]
    return any(place < verb for place in speakers) and not any(place < verb for place in robot)


def _robot_acts(reading: Reading) -> bool:
    """Return whether the robot does something unknown to somebody: ``What did you give t2?``."""
    robot = [places[0] for _, places in reading.found.get("you", ())]
    people = [places[0] for name in ("named", "people") for _, places in reading.found.get(name, ())]
    return any(one < place for one in robot for place in people)


def _is_done_to_robot(reading: Reading) -> bool:
    """Return whether a person does something unknown to the robot: ``Did t1 thank you?``."""
    if reading.language.code != "en":
        return False
    people = [places[0] for name in ("named", "people") for _, places in reading.found.get(name, ())]
    robot = [places[0] for _, places in reading.found.get("you", ())]
    is_object = bool(robot) and reading.words[robot[0] - 1] not in ("by", "from", *reading.language.auxiliaries)
    return is_object and any(one < place < robot[0] for one in people for place in reading.free())


def _is_described(reading: Reading) -> bool:
    """Return whether it asks what somebody is or looks like: ``Was t1 a woman?``, ``What does t1 look like?``."""
    found, words = reading.found, reading.words
    if reading.has("named") and any(
        words[places[0]] == "look" and len(places) > 1 for _, places in found.get("see", ())
    ):
        return True
    people = sorted(places[0] for name in ("named", "people", "nobody") for _, places in found.get(name, ()))
    articles = ("a", "an", "ein", "eine", "un", "une", "una")
    return any(words[place - 1] in articles and one < place for one in people for place in people if place)
