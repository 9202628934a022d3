"""English phrases that stand for words of the grammar or of a deed, and words that a recogniser confuses.

Each line of `_MEANINGS` has what is meant, a colon, and phrases for it. A phrase matches in any form of its words, also
with articles and pronouns between them: ``open mouth`` is "opened your mouth", too. A verb of motion with a particle
says that somebody comes or leaves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from functools import cache

from socialbot.runs.asking._words import stem
from socialbot.runs.asking.languages.synonyms import synonyms

Phrase = tuple[str, ...]

_MEANINGS = """
    say: open mouth, come out of mouth, out of mouth, leave lips, cross lips, put into words, blurt out, voice
    view: field of view, field of vision, line of sight, range of vision, eyesight
    see: make out, lay eyes on, set eyes on, clap eyes on, get look at, have look at, pick out, catch glimpse of,
        become aware of, take notice of
    leave: clear off, make exit, take leave, be gone
    come: show face, make entrance, pay visit, make appearance, put in appearance, set foot
    here: hang around, hang about, stick around, hang out, loiter
    ignore: let walk by, let walk past, let go by, let pass, let walk on, let go past, let walk away,
        brush off, pay no attention, look past, look through, leave hanging, leave standing, leave unattended,
        have no time for, shrug off, not bother with, turn blind eye, give wide berth, cut dead, freeze out
    stay idle: sit there, sit around, sit still, sit idle, stand around, twiddle thumbs, kill time, go quiet, go still,
        go idle, fall silent, go to sleep, doze, laze, slack off, loaf, take break, take rest, be at rest, lie low
    plan: up sleeve, in store, in pipeline, on mind, on cards, line up, on to do list, have come up,
        get anything come up, lie ahead, look forward to, on horizon
    doing: get up to, get on with, keep you busy, keep you occupy, in middle of
    next: once we finish, when we finish, after we finish, once we be do, when we be do, after we be do,
        once this be over, when this be over, after this be over, once i leave, when i leave, after i leave
    first: earliest, very first
    last: final, very last
    greet: say hey, say good morning, say good afternoon, say good evening, make welcome, bid welcome, wish good day,
        bid good day
    help: be of use, come to aid, do favour, do favor, be of assistance, come to rescue, need anything, need something
    together: at once, at same time, all at once
    tell way: give direction, give way description, explain way, describe way
    authorize: give go ahead, give permission, give clearance, give green light, give okay, give ok
    why when: what be on mind when, what go through mind when, what go through head when
    why: for what cause, whatever for, to what end, with what aim, how do it come, what be you think, what be behind
"""
_DEEDS = {"greet", "help", "ignore", "authorize"}
"""Meanings that are deeds of some agents only."""
_MOTION = "walk,come,step,stroll,wander,pop,drop,swing,roll,run,rush,march,saunter,breeze,file,drift,amble"
_TOWARDS, _AWAY = "in,by,over,along,around,round,past,inside,through", "away,off,out"
_BETWEEN = frozenset(
    (
        "a", "an", "the", "him", "her", "them", "me", "my", "your", "his", "their", "its", "just", "any",
        "anybody", "anyone", "somebody", "someone", "everybody",
    )
)  # fmt: skip
_PAST = {"come": "came", "leave": "left", "say": "said", "see": "saw"}
_BASES = {
    form: verb
    for verb, forms in {
        "be": "am is are was were been being", "have": "has had having", "get": "got gotten", "let": "let",
        "sit": "sat", "pay": "paid", "fall": "fell", "lay": "laid", "lie": "lay lain", "catch": "caught", "run": "ran",
    }.items()
    for form in forms.split()
}  # fmt: skip
_SOUNDS = (
    "where were wear", "quite quiet", "weather whether", "grate great greet", "tea tee t", "too two to",
    "four for fore", "here hear", "see sea", "ate eight", "one won", "know no", "knew new", "there their",
    "wait weight", "aid aide",
    "hi high", "right write rite", "past passed", "by buy bye", "hole whole", "wood would", "sent cent scent",
    "scene seen", "red read", "why y", "you u ewe", "are r", "be bee b", "see c", "meat meet", "lead led",
    "guest guessed", "son sun", "our hour", "way weigh", "man main", "first fist", "person parson", "second seconds",
)  # fmt: skip


def _base(word: str) -> str:
    return _BASES.get(word) or stem(word)


@cache
def _phrases() -> Mapping[str, Sequence[tuple[Phrase, Phrase, bool]]]:
    """Return the bases of the words of each phrase, what it means, and whether it is a motion, by the first base."""
    found: list[tuple[Phrase, Phrase, bool]] = []
    for line in _MEANINGS.replace(",\n", ",").splitlines():
        meant, _, phrases = line.partition(":")
        found += [(tuple(map(_base, one.split())), tuple(meant.split()), False) for one in phrases.split(",") if meant]
    for meant, particles in (("come", _TOWARDS), ("leave", _AWAY)):
        pairs = ((verb, one) for verb in _MOTION.split(",") for one in particles.split(","))
        found += [((stem(verb), one), (meant,), True) for verb, one in pairs]
    by_first: dict[str, list[tuple[Phrase, Phrase, bool]]] = {}
    for each in sorted(found, key=lambda each: -len(each[0])):
        by_first.setdefault(each[0][0], []).append(each)
    return by_first


def paraphrased(words: Sequence[str], *, deeds: Set[str], has_people: bool) -> list[str]:
    """Return English words with each phrase as what it means.

    Args:
        words: Words of a question.
        deeds: Words of the deeds of the run: what they name stays as it is.
        has_people: Whether people come and go in the run.
    """
    result, place = [], 0
    stems = {stem(word) for word in deeds}
    while place < len(words):
        for phrase, meant, is_motion in _phrases().get(_base(words[place]), ()):
            end = _end(phrase, words, place)
            if not end:
                continue
            is_robot = bool(result) and result[-1] == "you"
            if is_motion and (not has_people or is_robot or words[end : end + 1] in (["to"], ["the"])):
                continue
            if not is_motion and len(phrase) == 1 and phrase[0] in stems:
                continue
            if meant[0] in _DEEDS and not stems.intersection(_named_by(meant)):
                continue
            is_past = words[place] in _BASES or words[place].endswith("ed") or words[place] == "came"
            result += [_PAST.get(word, word) if is_past else word for word in meant]
            place = end
            break
        else:
            result.append(words[place])
            place += 1
    return result


@cache
def _named_by(meant: Phrase) -> frozenset[str]:
    return frozenset(stem(one[0]) for one in (meant, *synonyms(meant, "en")) if len(one) == 1)


def _end(phrase: Phrase, words: Sequence[str], place: int) -> int:
    """Return the place behind a phrase that begins at ``place``; 0 if it is not there."""
    for n, wanted in enumerate(phrase):
        while n and place < len(words) and words[place] in _BETWEEN and _base(words[place]) != wanted:
            place += 1
        if place >= len(words) or _base(words[place]) != wanted:
            return 0
        place += 1
    return place


def homophones(word: str) -> tuple[str, ...]:
    """Return the words that a recogniser may have heard as ``word``."""
    groups = (group.split() for group in _SOUNDS)
    spoken = [word.replace("f", "th", 1)] if word.startswith("f") else []  # "fird"
    return tuple(dict.fromkeys([*spoken, *(one for group in groups if word in group for one in group if one != word)]))
