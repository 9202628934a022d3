"""Ranking of the readings of a question by a log-linear model, whose weights `evaluation.train_questions` learns.

The features of a reading are the classes of its words in their order, how its deed is named, how many constraints its
records satisfy, and how many words it leaves unexplained.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files

from socialbot.runs.asking._doer import PARTICLES
from socialbot.runs.asking._facts import record_agent
from socialbot.runs.asking._parts import VERBS
from socialbot.runs.asking._question import NEAR_S
from socialbot.runs.asking._readings import Candidate, asked_kind, concerns_kind
from socialbot.runs.asking._sentences import Answer
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._words import tokens

SURE = 0.5
"""Probability below which the best reading counts as not understood."""
_TENSES = ("past", "present", "future")
_MOST_COUNTED = 3
_BY = {"by", "von", "par", "por"}
_WEIGHTS = "reading.json"
_LIKE = {"nearest": "longest", "farthest": "longest", "limit": "longest", "same time": "here"}
"""Classes of words with the weights of another one, as the lists of questions hardly have them."""


@cache
def weights() -> Mapping[str, float]:
    """Return the weights of the features."""
    return json.loads((files("socialbot.runs.asking") / _WEIGHTS).read_text("utf-8"))


def ranked(found: Sequence[Candidate], answers: Sequence[Answer], subjects: Subjects) -> list[tuple[int, float]]:
    """Return the place of the best reading of each answer and the probability of the answer, the most likely one first.

    Readings with equal answers count together, and those without an answer are one refusal.
    """
    weight = weights()
    scores = [
        sum(weight.get(name, 0.0) * value for name, value in each.items())
        for each in featured(found, answers, subjects)
    ]
    highest = max(scores)
    shares = [math.exp(score - highest) for score in scores]
    places: dict[int, list[int]] = {}
    for place, one in enumerate(alike(answers)):
        places.setdefault(one, []).append(place)
    best = [
        (max(same, key=lambda n: shares[n]), sum(shares[n] for n in same) / sum(shares)) for same in places.values()
    ]
    return sorted(best, key=lambda each: (-each[1], -shares[each[0]]))


def alike(answers: Sequence[Answer]) -> list[int]:
    """Return for each answer the place of the first one that tells the same; all refusals tell the same."""
    first: dict[str, int] = {}
    return [first.setdefault(_told(each), n) for n, each in enumerate(answers)]


def _told(answer: Answer) -> str:
    """Return what an answer tells; that check("Bob") and that check with Bob was not done is the same."""
    if not answer.known:
        return ""
    claim = answer.clauses[0].claim
    if claim.kind != "did_not":
        return answer.text
    words = sorted(set(tokens(" ".join((*claim.what, *claim.persons)))))
    return f"{claim.agent} {words} {claim.at_s} {claim.until_s}"


def featured(found: Sequence[Candidate], answers: Sequence[Answer], subjects: Subjects) -> list[dict[str, float]]:
    """Return the features of readings and of their answers."""
    cache: dict[object, dict[str, float]] = {}
    sequences: dict[object, list[str]] = {}
    result = []
    for each, told in zip(found, answers, strict=True):
        key = id(each.found), id(each.deed)
        if key not in sequences:
            sequences[key] = _classes(each)
        question = each.question
        kind, mode = question.kind or "none", _mode(each)
        records = (
            *key,
            question.says,
            mode,
            question.agent,
            tuple(question.things),
            question.event is None,
            question.between is None,
            question.contrast is None,
            question.belief,
            each.ignores_event,
        )
        if records not in cache:
            cache[records] = dict(_of_parts(each, subjects))
        features = dict(cache[records])
        features |= {f"{kind}: {name}": value for name, value in features.items()}
        features |= {f"{kind} {mode}": 1.0}
        features |= {f"{kind} | {one}": 1.0 for one in _sequence(sequences[key])}
        for one in _marks(each):
            features[f"{kind} & {one}"] = 1.0
            features[f"{mode} & {one}"] = 1.0
        for one, value in _of_answer(each, told):
            features[one] = features[f"{kind}: {one}"] = features[f"{mode}: {one}"] = value
        result.append(features)
    return result


def _mode(each: Candidate) -> str:
    """Return what a reading is about: a deed, words of the robot or of people, failures, another state, or nothing."""
    kind = each.question.kind
    if kind in (None, "heard", "failed", "believed", "ended", "where"):
        return kind or "none"
    return "deed" if each.deed is not None else "says" if each.question.says else "state"


def _classes(each: Candidate) -> list[str]:
    """Return the class of each word: the deed, a name, a number, a class of the grammar, or unknown."""
    reading = each.found.reading
    classes = ["?"] * len(reading.words)
    for name, found in reading.found.items():
        if name in _TENSES or name.startswith("person "):
            continue
        for _, places in found:
            for place in places:
                if classes[place] in ("?", "filler"):
                    classes[place] = _LIKE.get(name, name)
    for place in each.found.referred:
        if classes[place] == "?":
            classes[place] = "#" if reading.words[place][:1].isdigit() else "N"
    for _, place in each.found.agents:
        classes[place] = "A"
    for place in each.deed.places if each.deed is not None else ():
        classes[place] = "DEED"
    for place, name in enumerate(classes):
        if name == "?" and reading.words[place] in reading.language.known_words:
            classes[place] = reading.words[place]
    return classes


def _sequence(classes: Sequence[str]) -> Iterator[str]:
    named = [one for n, one in enumerate(classes) if one != "filler" and classes[max(0, n - 1) : n] != [one]]
    yield from set(named)
    yield from {f"{one} {other}" for one, other in zip(["^", *named], [*named, "$"], strict=True)}
    yield "^ " + " ".join(named[:2])


def _marks(each: Candidate) -> Iterator[str]:
    """Yield what a reading has beside its words."""
    question, reading = each.question, each.found.reading
    if question.person is not None:
        person = question.person
        yield "me" if person.me else "named" if person.names else "together" if person.together else "person"
    yield from (name for name in _TENSES if reading.has(name))
    for name, value in (
        ("time", question.at_s), ("span", question.span_s or question.between), ("ordinal", question.ordinal),
        ("things", question.things),
        ("agent", question.agent), ("all", question.about_all), ("opposite", question.is_opposite),
        ("negative", question.is_negative), ("contrast", question.contrast), ("left out", question.about_left_out),
        ("agent kind", question.agent_kind), ("extreme", question.extreme), ("asks", question.asks),
    ):  # fmt: skip
        if value is not None and value != "" and value is not False and value != {}:
            yield name
    if question.event is not None:
        yield f"event {question.event.relation}"
        if question.event.heard is not None:
            yield "heard"


def _of_answer(each: Candidate, told: Answer) -> Iterator[tuple[str, float]]:
    """Yield what an answer tells, and whether it has the names and the time in question."""
    question = each.question
    if not told.known:
        yield "unanswered", 1.0
        return
    first = told.clauses[0].claim
    yield f"tells {first.kind}", 1.0
    if question.is_synonym:
        yield f"tells {first.kind} by synonym", 1.0
    if question.names:
        shown = " ".join(one for clause in told.clauses for one in (clause.text, *clause.claim.what))
        yield "names told", sum(one in shown for one in question.names) / len(question.names)
    if question.at_s is not None and not question.ago and first.at_s is not None:
        yield "time told", float(abs(first.at_s - question.at_s) <= NEAR_S)


def _of_parts(each: Candidate, subjects: Subjects) -> Iterator[tuple[str, float]]:
    """Yield how well the parts fit together: words, deed, things, agents and time."""
    question, reading = each.question, each.found.reading
    free = len([word for word in question.unknown if len(word) > 2])
    mode = _mode(each)
    yield f"{mode} left", float(min(free, _MOST_COUNTED))
    if free:
        yield f"{mode} unknown", 1.0
    verb = each.found.verb
    if verb is not None and not (each.deed is not None and verb in each.deed.places):
        is_known = any(verb in reading.places(name) for name in VERBS)
        yield f"{mode} verb", 0.5 if is_known else 1.0
    yield "beside", float(min(each.left_over, _MOST_COUNTED))
    if question.event is not None or question.contrast is not None or question.between is not None:
        yield "split", 1.0
    if each.ignores_event:
        yield "ignores event", 1.0
    if mode == "says":
        shares = [subjects.share_said(question.says, one) for one in subjects.deeds]
        yield "quoted", max(shares, default=0.0)
    if question.agent:
        yield "agent acts", 1.0
    if question.belief:
        yield "belief words", each.fit
        yield "other beliefs", 1.0 - each.fit
    if each.deed is None:
        return
    deed, topic = each.deed, each.deed.topic
    yield from ((f"by {name}", alike) for name, alike in deed.evidence.items())
    yield "by words only", float(deed.is_synonym and set(deed.evidence) <= {"said", "cause", "name"})
    verb = each.found.verb
    following = reading.words[verb + 1 : verb + 2] if verb is not None and verb in deed.places else []
    if PARTICLES.intersection(following) and verb is not None and verb + 1 not in deed.places:
        yield "other particle", 1.0  # "Did you check in?"
    best = max(one.fit for one in each.found.deeds)
    yield "behind", best - deed.fit
    yield "deed words", float(min(len(deed.places), _MOST_COUNTED))
    done = subjects.done(topic)
    yield ("acted" if subjects.acted(topic) else "wanted" if done else "never done"), 1.0
    if not topic.concerns_people and question.person is not None:
        yield "no people", 1.0
    if kind := asked_kind(reading, subjects):
        about = [one for one in done if {*question.things} <= {*arguments_of(one.what), one.source}]
        yield "kind asked", float(any(concerns_kind(one, kind) for one in about))
    if question.things:
        fitting = [len(set(question.things) & {*arguments_of(one.what), one.source}) for one in done]
        yield "things", max(fitting, default=0) / len(question.things)
        sizes = [len({*arguments_of(one.what)} - {one.source}) for one in done]
        yield "arguments", max((n / max(1, size) for n, size in zip(fitting, sizes, strict=True)), default=0.0)
        yield "all things", float(max(fitting, default=0) == len(question.things))
    if question.agent:
        yield "agent does", float(any(record_agent(subjects.history, one) == question.agent for one in done))
    if question.at_s is not None and not question.ago:
        away_s = min((abs(subjects.history.seconds(one.stamp) - question.at_s) for one in done), default=math.inf)
        yield "at time", float(away_s <= NEAR_S)
        yield "near time", 1.0 / (1.0 + away_s)
    for name, place in each.found.agents:
        if _BY.intersection(reading.words[max(0, place - 2) : place]):  # "opened by the nurse"
            yield ("by acts" if name == question.agent else "by is a thing"), 1.0
    before = [name for name, place in each.found.agents if deed.places and place < min(deed.places)]
    if before and not reading.has("you"):
        yield ("subject acts" if question.agent == before[0] else "subject is a thing"), 1.0
    order = [(reading.place("you"), "you")] if reading.has("you") else []
    order += [(place, "agent") for name, place in each.found.agents if name == question.agent][:1]
    order += [(place, "people") for name in ("people", "named", "nobody") for place in reading.places(name)[:1]]
    order += [(min(deed.places), "deed")] if deed.places else []
    yield "order " + " ".join(name for _, name in sorted(order)), 1.0
