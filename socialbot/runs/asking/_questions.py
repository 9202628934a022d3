"""Questions: from words to the kind of question, the deed, the persons, the things and the time that it is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Literal

from socialbot.runs.asking._clauses import (
    Parts,
    Relation,
    addressed,
    caused,
    without_contrast,
    without_event,
    without_matrix,
)
from socialbot.runs.asking._coverage import coverage
from socialbot.runs.asking._kinds import Kind, kind_of
from socialbot.runs.asking._named_deeds import named_deeds
from socialbot.runs.asking._references import (
    PersonReference,
    Reading,
    digits_after_names,
    take_names,
    take_ordinal,
    take_person,
    take_span,
    take_time,
)
from socialbot.runs.asking._roles import (
    ADDRESSING,
    acting_agent,
    addressee,
    clause_verb,
    is_explained,
    is_for_robot,
)
from socialbot.runs.asking._sentences import kind_of_name
from socialbot.runs.asking._spelling import corrected
from socialbot.runs.asking._topics import Subjects, Topic
from socialbot.runs.asking._word_classes import classify, guess_interrogative, places_of_class, tells, words_of_deeds
from socialbot.runs.asking._words import NUMBER_WORDS, is_ordinary_verb, quoted_tokens, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, INTERROGATIVES, LANGUAGES, Language
from socialbot.runs.asking.languages.light_verbs import without_light_verbs
from socialbot.runs.asking.languages.paraphrases import homophones, paraphrased

SURE = 0.68
"""Confidence below which a question counts as not understood."""
_AWAY = {"away", "off", "weg", "fort"}
"""Particles of verbs of leaving."""
_BEFORE_SAID = {"for", "about", "a", "an", "the"}
_BEFORE_ASKED = _BEFORE_SAID | {"to", "see", "have", "get"}
"""Words behind a verb of asking that need not be said: ``ask to see a badge``."""
NEAR_S = 2.0
"""Tolerance (s) of a time in a question about a deed: people estimate times."""
MOST_WORDS = 100
"""Words of the longest question that is understood; the time to read one grows with the square of its length."""
_ARTICLES = {("the",), ("a",), ("an",)}
_ALL_SAID = 0.99
_MOST_CONFUSED = 2
"""Most words that a recogniser confused with words of the same sound."""
_LONG = 5
"""Least length of a word that is heard as two."""
_LONG_PHRASE, _ASKING = 3, 3
"""Least words of a phrase, and least letters of a word of a short one, that is expected in a question."""
_INDEFINITE = {"anybody", "anyone", "somebody", "someone", "jemand", "jemanden", "quelqu", "alguien"}


@dataclass(frozen=True)
class Question:
    """Question as it was understood.

    Args:
        kind: What is asked.
        language: Its language (ISO 639-1).
        confidence: From 0 to 1; below `SURE` it was not understood.
        topics: The deed it is about; other deeds with the same words follow.
        person: The person it is about.
        agent: The agent that acted; empty for any.
        agent_kind: Kind of the agents that acted, of ``which carrier``; empty for any.
        things: Names in it, such as box_a1, with the word before each, such as "to".
        at_s: Time in it, in seconds from the start; ``ago`` tells that it counts back from now.
        span_s: Span of time in it; with a negative begin it ends at the time of the question.
        ordinal: Which time a deed was done: 1 for the first, -1 for the last.
        is_past: Whether it asks about the past.
        says: Words that were said, in a question about an utterance.
        is_opposite: Whether it names the opposite of the deed: ``ignore`` for not to greet.
        is_negative: Whether it has a negation.
        about_all: Whether it is about all people.
        extreme: Whether it asks for the longest or the shortest visit.
        about_left_out: Whether it asks for people for whom the deed was not done.
        about_speech: Whether it is about speaking in general.
        asks: Whether it is about asking somebody.
        contrast: Question about those with whom the deed is contrasted: ``and not t2``.
        event: Question about the event that tells the time: ``after t2 had left``.
        unknown: Its words that nothing explains.
        verb: Its verb, if nothing explains it.
        is_synonym: Whether it names the deed by a synonym that the agent does not declare.
    """

    kind: Kind | None
    language: str
    confidence: float
    topics: tuple[Topic, ...] = ()
    person: PersonReference | None = None
    agent: str = ""
    agent_kind: str = ""
    things: Mapping[str, str] = field(default_factory=dict)
    at_s: float | None = None
    ago: bool = False
    span_s: tuple[float, float] | None = None
    ordinal: int | None = None
    is_past: bool = False
    says: tuple[str, ...] = ()
    is_opposite: bool = False
    is_negative: bool = False
    about_all: bool = False
    extreme: Literal["longest", "shortest", ""] = ""
    about_left_out: bool = False
    about_speech: bool = False
    asks: bool = False
    contrast: Question | None = None
    event: Event | None = None
    unknown: tuple[str, ...] = ()
    verb: str = ""
    is_synonym: bool = False


@dataclass(frozen=True)
class Event:
    """Event that tells a time: a person comes or ``leaves``, or a deed of the robot.

    Args:
        relation: Whether the time is after it, before it, or that of the event.
        what: The people and the deed, as a question.
        leaves: Whether the person leaves.
        heard: Words that the person said: ``when I asked about the library``; None for another event.
    """

    relation: Relation
    what: Question
    leaves: bool
    heard: tuple[str, ...] | None = None


def understand(text: str, subjects: Subjects, language: str = "") -> Question:
    """Return ``text`` as a question.

    Args:
        text: What a person wrote or said.
        subjects: What the run can be asked about.
        language: Language of the text (ISO 639-1), if it is known; else that which explains it best.
    """
    words, quoted = tokens(text), quoted_tokens(text)
    if not 0 < len(words) <= MOST_WORDS:
        return Question(None, language if language in LANGUAGES else ENGLISH.code, 0.0)
    best = first = _understood(words, quoted, subjects, language)
    for _ in range(_MOST_CONFUSED):
        if (best.kind is not None and best.confidence >= SURE) or best.language != ENGLISH.code:
            break
        known = ENGLISH.known_words | words_of_deeds(subjects, ENGLISH.code)
        strange = {*best.unknown, *(set(words) - ENGLISH.known_words - subjects.names)}
        variants = [
            [*words[:n], one, *words[n + 1 :]]
            for n, word in enumerate(words)
            if word in strange and not is_ordinary_verb(word) and {*words[:n][-1:]}.isdisjoint(subjects.kinds)
            for one in homophones(word)
            if one in known
        ]
        read = [(_understood(each, quoted, subjects, ENGLISH.code), each) for each in variants]
        better, words = max(read, key=lambda each: _certainty(each[0]), default=(best, words))
        if _certainty(better) <= _certainty(best):
            break
        best = better
    return best if best is first or not best.unknown else first


def _certainty(question: Question) -> float:
    return 0.0 if question.kind is None else question.confidence


def _understood(words: Sequence[str], quoted: Sequence[str], subjects: Subjects, language: str) -> Question:
    candidates = [language] if language in LANGUAGES else list(LANGUAGES)
    exact = {code: _exact(words, LANGUAGES[code]) for code in candidates}
    # A question in one language may contain names and phrases of another.
    own = [LANGUAGES[code] for code in candidates if exact[code] >= max(exact.values()) - 1]
    read = [_read(_prepared(words, subjects, each, is_plain=not quoted), quoted, subjects, each) for each in own]
    best = max(read, key=lambda question: (question.confidence, exact[question.language]))
    return best if best.confidence >= SURE else max(read, key=lambda question: exact[question.language])


def _prepared(words: Sequence[str], subjects: Subjects, language: Language, *, is_plain: bool) -> list[str]:
    """Return the words of the question itself, spelled as the language and the deeds have them."""
    known = language.known_words | words_of_deeds(subjects, language.code) | NUMBER_WORDS
    alternatives = (one for name in INTERROGATIVES for one in language.phrases[name])
    asking = {word for one in alternatives if len(one) < _LONG_PHRASE for word in one if len(word) >= _ASKING}
    asking -= language.auxiliaries
    spelled = [corrected(word, known, subjects.names, asking) for word in words]
    result = without_matrix(_joined(spelled, subjects, language), language)
    if language is ENGLISH and is_plain:
        deeds = words_of_deeds(subjects, language.code, with_opposites=True)
        result = without_light_verbs(result, has_people=bool(subjects.persons))
        result = paraphrased(result, deeds=deeds, has_people=bool(subjects.persons))
        result = addressed(caused(result, subjects, language), language)
    return result


def _joined(words: Sequence[str], subjects: Subjects, language: Language) -> list[str]:
    """Join pairs of words that are one known word: a recogniser may hear ``of ten`` for ``often``."""
    known = language.known_words | words_of_deeds(subjects, language.code)
    result: list[str] = []
    for word in words:
        is_whole = bool(result) and result[-1] in known and word in known
        if result and not is_whole and len(result[-1]) + len(word) >= _LONG and result[-1] + word in known:
            result[-1] += word
        else:
            result.append(word)
    return result


def _exact(words: Sequence[str], language: Language) -> int:
    """Return how many words a language knows as they are."""
    return sum(word in language.known_words for word in words)


def _read(words: Sequence[str], quoted: Sequence[str], subjects: Subjects, language: Language) -> Question:
    """Read a question with its contrast and its event; words that only look like one belong to the main clause."""
    contrast = None
    split = without_contrast(words, language)
    if split is not None:
        contrast = _read_clause(split.contrast, subjects, language)
        if contrast.person is None and contrast.ordinal is not None and subjects.persons:
            contrast = replace(contrast, person=PersonReference(ordinal=contrast.ordinal))  # "and the second not"
        if split.is_denied and contrast.topics and contrast.person is None and not contrast.things:
            main = _read_clause(split.main, subjects, language, quoted)
            if main.kind in ("why", "why_not") and main.topics:
                # "Why did t1 get a greeting, but no help?" asks about the help.
                return replace(main, kind="why_not", topics=contrast.topics, is_negative=True)
        if contrast.person is not None or contrast.things or not split.is_denied:
            words = split.main
        else:
            contrast = None
    split = without_event(words, language)
    main = None if split is None else _read_clause(split.main, subjects, language, quoted)
    if split is not None and main is not None and main.kind is not None:
        event = _event(split, main, subjects, language)
        if event is not None:
            return _with_event(replace(main, contrast=contrast), event, split.main, language)
    return replace(_read_clause(words, subjects, language, quoted), contrast=contrast)


def _event(parts: Parts, main: Question, subjects: Subjects, language: Language) -> Event | None:
    what = _read_clause(parts.event, subjects, language)
    leaves, comes = tells(parts.event, language, "leaves"), tells(parts.event, language, "comes")
    first = (parts.event[0],)
    people = (*language.phrases["me"], *language.phrases["them"], *language.phrases["people"])
    begin = parts.event[1:2] if first in _ARTICLES else first
    is_by_person = what.person is not None or begin in people
    if what.about_speech and is_by_person and first not in language.phrases["you"]:
        heard = tuple(word for word in parts.event if word not in language.known_words)
        return Event(parts.relation, what, leaves=False, heard=heard)
    if main.topics and not what.topics and (what.things or what.agent):
        # The same deed with another thing or of another agent: "before carrier b"
        things = {name: before for name, before in what.things.items() if name not in subjects.agents}
        agent = what.agent or next((name for name in what.things if name in subjects.agents), "")
        return Event(parts.relation, replace(what, topics=main.topics, things=things, agent=agent), leaves=False)
    if what.says:
        return Event(parts.relation, what, leaves=False)
    leaves = leaves and (not comes or bool(_AWAY.intersection(parts.event)))  # "walked off"
    is_visit = (what.person is not None or what.about_all) and (leaves or comes)
    if not is_visit and main.topics and not what.topics and what.person is not None:
        return Event(parts.relation, replace(what, topics=main.topics), leaves=False)  # "before t1"
    is_order = main.kind == "who" and parts.relation != "when" and what.person is not None
    if not is_visit and is_order and not main.topics and not what.topics:
        return Event(parts.relation, what, leaves=False)  # "Who came after t1?"
    if not is_visit and (not what.topics or what.confidence < SURE):
        return None
    if is_visit and what.topics:
        what = replace(what, topics=())
    return Event(parts.relation, what, leaves)


def _with_event(question: Question, event: Event, words: Sequence[str], language: Language) -> Question:
    """Return a question whose time is told by an event; how long the robot waited with a deed is about that deed."""
    if question.kind in ("why", "why_not") and not question.topics and event.what.topics and event.relation == "when":
        # "What were you thinking when you greeted t1?"
        return replace(question, topics=event.what.topics, person=event.what.person, confidence=event.what.confidence)
    waited = event.relation == "before" and event.what.topics and tells(words, language, "waits")
    if not waited or (question.topics and question.kind not in ("why", "how_long", "count")):
        return replace(question, event=event)
    kind = "why" if question.kind in ("why", "why_not") else "how_long"
    what = event.what
    return replace(
        question, kind=kind, topics=what.topics, person=what.person, at_s=None, confidence=what.confidence, unknown=()
    )


def _read_clause(words: Sequence[str], subjects: Subjects, language: Language, quoted: Sequence[str] = ()) -> Question:
    reading = Reading(language, digits_after_names(list(words), subjects))
    span_s = take_span(reading)
    at_s, ago, person = take_time(reading) if span_s is None else (None, False, None)
    things, agents = take_names(reading, subjects)
    person = take_person(reading, subjects) or person
    referred = frozenset(reading.taken)
    classify(reading, words_of_deeds(subjects, language.code))
    if person is None and reading.has("me"):
        person = PersonReference(me=True)
    ordinal = take_ordinal(reading, referred) if span_s is None else None
    verb = clause_verb(reading, referred)
    named = named_deeds(reading, subjects, verb)
    topics, fit, is_opposite = named.topics, named.fit, named.is_opposite
    if topics and topics[0].declared is None:
        # "Why did you let Ann in?" is about Ann, even if the name belongs to another deed.
        for place in reading.free():
            name = subjects.argument_names.get(reading.words[place])
            if name is not None:
                things[name] = reading.words[place - 1] if place else ""
                reading.taken.add(place)
    if topics and at_s is not None and tells([reading.words[reading.place("topic")]], language, "talk"):
        topics, fit = (), 1.0  # "Why did you talk to t1 at 11 s?" is about what was said then
        reading.found.pop("topic")
    is_aimed = at_s is not None if person is None else not person.me
    silent = is_aimed and tells(words, language, "silent")
    if silent and (not topics or not topics[0].concerns_people):
        topics, fit = (), 1.0  # silence towards a person is a deed left undone
        reading.found.setdefault("say", []).append((1.0, (0,)))
        reading.found.setdefault("not", []).append((1.0, (0,)))
        reading.taken |= places_of_class(words, language, "silent")
        reading.found.pop("topic", None)
    topic = next(iter(topics), None)
    if topic is not None and reading.has("say") and (thing := addressee(reading, topic)):
        things, topics, topic, fit = {**things, thing: "to"}, (), None, 1.0
    if topic is not None:
        deed = set(reading.found["topic"][0][1])
        reading.found["not"] = [each for each in reading.found.get("not", ()) if not deed.issuperset(each[1])]
    guess_interrogative(reading, topic is not None)
    does = {record.source for record in subjects.done(topic)} if topic is not None and agents else set()
    agent = acting_agent(reading, agents, topic is not None, does)
    things |= {
        name: reading.words[place - 1] if place else "" for name, place in agents if name not in (agent, *things)
    }
    agent_kind = _asked_kind(reading, subjects, topic) if topic is not None and not agent else ""
    kind, sure = kind_of(reading, topic is not None, at_s is not None, span_s is not None)
    if topic is not None and (is_for_robot(reading) or (reading.has("where") and not subjects.done(topic))):
        kind = None
    if kind in ("why", "why_not") and is_opposite:
        kind = "why_not" if kind == "why" else "why"
    says: tuple[str, ...] = ()
    spoken_to = {word for name, before in things.items() if before == "to" for word in tokens(name)}
    if kind in ("why", "when", "did", "count") and reading.has("say"):
        says = _words_said(reading, referred, subjects, topic, spoken_to, quoted)
        if says:
            topics, topic, fit = (), None, 1.0
            person = None if person is not None and person.me else person  # "can I help you"
        elif topic is None and kind in ("when", "did"):
            kind = "said"
    elif kind is None and topic is None and reading.has("say") and not reading.has(*INTERROGATIVES):
        says = _words_said(reading, referred, subjects, topic, spoken_to)
        kind, sure = ("did", 0.95) if says and subjects.is_quoted(says) else (None, 0.0)  # "Was "come in" said?"
    if person is not None and person.at_s is not None and (kind == "said" or reading.has("how_far")):
        at_s = person.at_s
    unknown = tuple(reading.words[place] for place in reading.free())
    deeds = words_of_deeds(subjects, language.code)
    verb = None if verb is None or is_explained(reading, verb) else verb
    confidence = min(sure, fit) * coverage(reading, topic, subjects, deeds, verb)
    return Question(
        kind, language.code, round(confidence, 3), topics, person, agent, agent_kind, things, at_s, ago,
        span_s, ordinal,
        is_past=reading.has("past") and not reading.has("future"), says=says, is_opposite=is_opposite,
        is_negative=reading.has("not", "nobody"), about_all=reading.has("all"), extreme=_extreme(reading),
        about_left_out=_is_about_left_out(reading), about_speech=reading.has("say"),
        asks=any(stem(reading.words[place]) == "ask" for place in reading.places("say")),
        unknown=unknown, verb="" if verb is None else reading.words[verb], is_synonym=named.is_synonym,
    )  # fmt: skip


def _asked_kind(reading: Reading, subjects: Subjects, topic: Topic) -> str:
    """Return the kind of agents of ``which carrier left``, if agents of this kind do the deed; else empty."""
    if not reading.has("what", "who"):
        return ""
    place = min(places[0] for name in ("what", "who") for _, places in reading.found.get(name, ()))
    asked = reading.words[place + 1] if reading.words[place] == "which" and place + 1 < len(reading.words) else ""
    kinds = {kind_of_name(record.source) for record in subjects.done(topic)}
    return asked if asked in kinds else ""


def _extreme(reading: Reading) -> Literal["longest", "shortest", ""]:
    return "longest" if reading.has("longest") else "shortest" if reading.has("shortest") else ""


def _is_about_left_out(reading: Reading) -> bool:
    """Return whether a negation is about people in front of it: ``was there anybody you did not greet``."""
    people = [places[0] for _, places in reading.found.get("people", ())]
    denied = [places[0] for _, places in reading.found.get("not", ())]
    # "Did you forget to greet anyone?"
    omitted = [places[0] for _, places in reading.found.get("not", ()) if len(places) > 1]
    return any(one < place for one in people for place in denied) or any(
        place < one and reading.words[one] in _INDEFINITE for one in people for place in omitted
    )


def _words_said(
    reading: Reading,
    referred: Set[int],
    subjects: Subjects,
    topic: Topic | None,
    spoken_to: Set[str],
    quoted: Sequence[str] = (),
) -> tuple[str, ...]:
    """Take the words of an utterance: those in quotation marks, or behind the verb up to a person or a time."""
    starts = (n for n in range(len(reading.words)) if quoted and (*reading.words[n : n + len(quoted)],) == (*quoted,))
    start = next(starts, None)
    if start is not None and topic is None:
        reading.taken.update(range(start, start + len(quoted)))
        return tuple(quoted)
    last = max(place for _, places in reading.found["say"] for place in places)
    end = next((place for place in range(last + 1, len(reading.words)) if place in referred), len(reading.words))
    others = {one[0] for name in ("people", "nobody", "all") for one in reading.language.phrases[name]}
    if end == len(reading.words) and reading.words[-2] in ADDRESSING and reading.words[-1] in others:
        end -= 1  # "thank you to anybody"
    while end < len(reading.words) and end > last + 1 and reading.words[end - 1] in ADDRESSING:
        end -= 1
    begin = last + 1
    while end - begin > 1 and reading.words[begin] in _INDEFINITE:
        begin += 1  # "ask someone to ..."
    while begin < end and (reading.words[begin] in spoken_to or (begin > last + 1 and reading.words[begin] == "to")):
        begin += 1  # "tell Ann to ..."
    aside = _BEFORE_ASKED if stem(reading.words[last]) == "ask" else _BEFORE_SAID
    while end - begin > 1 and not quoted and reading.words[begin] in aside:
        begin += 1  # "ask for a badge"
    if begin == len(reading.words) and not reading.has("you"):  # "Was "come in" said?"
        verbs = [place for place in range(last) if reading.words[place] in reading.language.auxiliaries]
        begin, end = (verbs[-1] + 1 if verbs else last), last
    elif begin == len(reading.words):  # the verb is the last word, as in German
        begin, end = max(place for _, places in reading.found["you"] for place in places) + 1, last
    said = tuple(reading.words[begin:end])
    vague = {one[0] for name in ("filler", "what") for one in reading.language.phrases[name] if len(one) == 1}
    if vague.issuperset(said):
        said = ()  # "speak with t3", "say anything"
    is_quoted = subjects.is_quoted(said)
    if not said or (topic is not None and not is_quoted):
        return ()
    if topic is not None and topic.declared is not None and not _is_whole_quotation(said, reading, subjects):
        return ()
    if not is_quoted and reading.taken.issuperset(range(begin, end)):
        return ()
    reading.taken.update(range(begin, end))
    return said


def _is_whole_quotation(said: Sequence[str], reading: Reading, subjects: Subjects) -> bool:
    """Return whether somebody said all of several words: "say you are welcome" is no question about a welcome."""
    names_saying = set(reading.places("say")).intersection(reading.places("topic"))
    return len(said) > 2 and not names_saying and subjects.is_quoted(said, _ALL_SAID)


def with_time(question: Question, now_s: float) -> Question:
    """Return a question with a time that counts back as a time of the run; it is negative before the run."""
    if question.span_s is not None and question.span_s[0] < 0.0:
        question = replace(question, span_s=(max(0.0, now_s + question.span_s[0]), now_s))
    if not question.ago or question.at_s is None:
        return question
    at_s = now_s - question.at_s
    return replace(question, at_s=at_s if at_s < -NEAR_S else max(0.0, at_s), ago=False)
