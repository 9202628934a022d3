"""Readings of a question: each is a kind of question with the deed, persons, things and time that it is about.

A question is read in two steps. The first one finds the parts: names, people, times, classes of words, and the deeds
that its words may name. The second one combines them: each kind of question with each deed is a reading, and the
weights of `_ranking` say which one is most likely.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._clauses import (
    TELLS,
    Parts,
    without_between,
    without_contrast,
    without_event,
    without_report,
)
from socialbot.runs.asking._doer import PARTICLES, verb_by_form
from socialbot.runs.asking._named_deeds import NamedDeed
from socialbot.runs.asking._parts import (
    ARTICLES,
    GREETINGS,
    INDEFINITE,
    Found,
    are_doers,
    bound_of,
    event_of,
    known_words,
    names_in,
    parts_of,
    places_of_event,
    prepared,
    subordinate,
)
from socialbot.runs.asking._people import asked_beliefs
from socialbot.runs.asking._question import Event, Kind, Question
from socialbot.runs.asking._references import PersonReference, Reading
from socialbot.runs.asking._sentences import kind_of_name
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking._unrecorded import has_other_object, ids_without_records, names_without_records
from socialbot.runs.asking._word_classes import places_of_class, tells_exactly
from socialbot.runs.asking._words import number_at, quoted_tokens, starts, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, INTERROGATIVES, LANGUAGES, Language, lexicon

MOST_WORDS = 100
"""Words of the longest question that is understood; the time to read one grows with the square of its length."""
_OF_DEEDS: Sequence[Kind] = ("why", "why_not", "when", "who", "how_long", "count", "did", "next", "failed", "where")
_OF_SAYING: Sequence[Kind] = ("why", "why_not", "when", "who", "count", "did")
_OF_STATES: Sequence[Kind] = (
    "why", "why_not", "see", "next", "doing", "said", "who", "when", "how_long", "count", "heard", "failed",
)  # fmt: skip
"""Kinds of questions about a deed, about words that were said, and about anything else."""
_ASKED: Mapping[str, Set[Kind]] = {
    "why": {"why"},
    "what": {"doing", "said", "see", "next", "who", "when", "heard"},
    "who": {"who", "see", "said", "heard"},
    "when": {"when", "said", "heard"},
    "where": {"when", "said", "doing", "see", "heard"},
    "how_often": {"count"},
    "how_many": {"count", "see"},
    "how_long": {"how_long"},
    "how_far": {"see", "where"},
    "unanswerable": {"when", "said", "doing", "count", "heard"},
}
"""Kinds of questions by the class of their interrogative."""
_WITHOUT: Set[Kind] = {"did", "see", "who", "next", "doing", "heard"}
"""Kinds of questions without interrogative; with a deed, only whether it was or will be done, or how often."""
_WHETHER: Set[Kind] = {"did", "next", "count"}
_YOU = {"you", "u"}
_OBJECTS = {"name", "thing", "time", "cause"}
"""Evidence that names no deed, but what it is about."""
_OF_WORDS = {"said", "cause", "time"}
"""Evidence of the words of records only."""
_OF_RECORDS = _OBJECTS | _OF_WORDS
"""Evidence of what a deed was about, or of the words of its record, but not of the deed itself."""
_MOST_SAID = 0.8
"""Least share of the words in question that a deed says."""
_EVENTS = set[str]().union(
    *(language.first_words("event after", "event before", "event when") for language in LANGUAGES.values())
)
"""Words that begin a clause about the time."""
_BESIDE_SAID = {
    "for", "about", "a", "an", "the", "my", "to", "see", "have", "get", "uber", "von", "nach", "um", "dem", "den",
    "der", "die", "das", "ein", "eine", "einen", "einem", "du", "de", "des", "sur", "le", "la", "les", "l", "un", "une",
    "mon", "ma", "pour", "sobre", "del", "el", "los", "las", "una", "mi", "para",
}  # fmt: skip
"""Words behind a verb of saying that need not be said: ``ask to see a badge``."""
_BEFORE_REQUEST = {"que", "qu", "de", "d"}
"""French and Spanish words between a verb of saying and what was said: ``pediste que cerraran la puerta``."""
_BEFORE_ADDRESSEE = {"to", "zu", "a", "an", "for"}
_OBJECT_BEGINS = (["the"], ["a"], ["an"], ["its"], ["their"], ["his"], ["her"])
_COMMON = ENGLISH.known_words - ENGLISH.first_words("why", "where")
"""Words that anybody says."""
_MOVING = lexicon.meanings(("move",))
_ORIGIN = (("from",), ("woher",), ("d", "ou"), ("de", "donde"))
"""Words that ask where something was before."""
_PLAN = {"plan", "plans", "plane", "planes"}
"""Words for plans, in four languages."""
_OF_PLANS = ("what", "who", "how_many", "where")
"""Interrogatives of questions about the steps of a plan."""
_OF_LEXICON = 0.5
"""Weight of a word of the lexicon for the language of a question, beside words of its grammar."""


@dataclass(frozen=True)
class Candidate:
    """Reading of a question with what it rests on, for the ranking; ``deed`` is None for one without a deed."""

    question: Question
    found: Found
    deed: NamedDeed | None
    left_over: int
    """Words of subordinate clauses that nothing explains."""
    fit: float = 0.0
    """Share of the words of a belief's name that the question has."""
    ignores_event: bool = False
    """Whether another reading takes a subordinate clause of it for the time: ``before t1 came``."""


def candidates(text: str, subjects: Subjects, language: str = "") -> list[Candidate]:
    """Return the readings of a text in the languages that explain most of its words; none of an empty or long text.

    Args:
        text: What a person wrote or said.
        subjects: What the run can be asked about.
        language: Language of the text (ISO 639-1), if it is known.
    """
    words, quoted = tokens(text), quoted_tokens(text)
    if not 0 < len(words) <= MOST_WORDS:
        return []
    codes = [language] if language in LANGUAGES else list(LANGUAGES)
    known = {code: known_words(subjects, LANGUAGES[code]) for code in codes}
    # The letter of t1 is no French word.
    whole = [one for one, after in zip(words, [*words[1:], ""], strict=True) if len(one) > 1 or not after.isdigit()]
    exact = {
        code: sum(1.0 if word in known[code] else _OF_LEXICON * (word in lexicon.words(code)) for word in whole)
        + any(letter in LANGUAGES[code].letters for letter in text.lower())
        for code in codes
    }
    own = [code for code in codes if exact[code] == max(exact.values())]
    names = names_in(text, own, subjects)
    as_written, has_unknown_id = names.union(quoted), not quoted and bool(ids_without_records(text, subjects))
    return [
        each
        for code in own
        for each in _candidates(
            prepared(words, as_written, subjects, LANGUAGES[code]), quoted, subjects, LANGUAGES[code]
        )
        if each.question.kind is None or (names <= {*each.question.says} and not has_unknown_id)
    ]


def _candidates(
    words: Sequence[str], quoted: Sequence[str], subjects: Subjects, language: Language
) -> Iterator[Candidate]:
    """Yield readings of the whole, of its main clause beside a contrast or an event, and the one that refuses it."""
    report = None if quoted else without_report(words, language)
    if report is not None:
        yield from _reported(report, subjects, language)
        return
    whole = parts_of(words, subjects, language)
    is_hypothetical = tells_exactly(words, language, "hypothetical")  # "what if": no record tells that
    if is_hypothetical or names_without_records(whole.reading, whole.referred, subjects):
        yield Candidate(whole.question, whole, None, 0)
        return
    about_plan = _about_plan(whole, subjects)
    if about_plan is not None:
        yield about_plan
        return
    split = without_between(words, language) if whole.question.span_s is None else None
    between = [] if split is None else list(_between(split, quoted, subjects, language))
    if between:  # Then nothing else explains the word.
        yield from (*between, Candidate(whole.question, whole, None, 0))
        return
    split = without_contrast(words, language)
    if split is not None and split.is_denied and whole.reading.has("who"):
        only = list(_done_only(split, quoted, subjects, language))
        if only:
            yield from (*only, Candidate(whole.question, whole, None, 0))
            return
    at_event = list(_at_event(words, quoted, whole, subjects, language))
    for each in _combined(whole, quoted, subjects):
        yield replace(each, ignores_event=bool(at_event))
    if split is not None:
        other, main = parts_of(split.contrast, subjects, language), parts_of(split.main, subjects, language)
        contrast = subordinate(other, subjects)
        if contrast.person is None and contrast.ordinal is not None and subjects.persons:
            contrast = replace(contrast, person=PersonReference(ordinal=contrast.ordinal))  # "and the second not"
        left = len(other.reading.free())
        if contrast.person is not None or contrast.things or not split.is_denied:
            for each in _combined(main, quoted, subjects):
                asked = replace(each.question, contrast=contrast, is_open=whole.question.is_open)
                yield replace(each, question=asked, left_over=left)
        elif contrast.topics:
            # "Why did t1 get a greeting, but no help?" asks about the help.
            for each in _combined(main, quoted, subjects):
                if each.question.kind == "why_not" and each.deed is not None:
                    yield replace(each, question=replace(each.question, topics=contrast.topics), left_over=left)
    yield from at_event
    yield Candidate(whole.question, whole, None, 0)


def _at_event(
    words: Sequence[str], quoted: Sequence[str], whole: Found, subjects: Subjects, language: Language
) -> Iterator[Candidate]:
    """Yield the readings of the main clause beside an event: ``after t2 had left``."""
    split = without_event(words, language)
    if split is None:
        return
    other, main = parts_of(split.event, subjects, language), parts_of(split.main, subjects, language)
    if split.relation == "before" and main.reading.has("why") and main.reading.has("waits"):
        # "Why did you wait before you greeted t1?" asks why it was done then.
        for each in _combined(other, quoted, subjects):
            if each.question.kind == "did" and each.deed is not None:
                yield replace(each, question=replace(each.question, kind="why"))
    for each in _combined(main, quoted, subjects):
        event = event_of(split, other, each.question, subjects)
        if event is not None:
            event = replace(event, is_near=split.is_near)
            left = 0 if event.heard is not None else len(set(other.reading.free()) - places_of_event(other))
            asked = replace(each.question, event=event, is_open=whole.question.is_open)
            yield replace(each, question=asked, left_over=left)


def _about_plan(found: Found, subjects: Subjects) -> Candidate | None:
    """Return the reading about the steps of a plan, or about why there was a new one; None without these words.

    It is a refusal if the question has words that no record has: ``the first step of your plan to bake a cake``.
    """
    reading, words, language = found.reading, found.reading.words, found.reading.language
    goals = {stem(word) for each in subjects.history if each.kind == "plan_start" for word in tokens(each.what)}
    if not goals:
        return None
    named, new = (places_of_class(words, language, name) for name in ("step", "replan"))
    is_plan, order = bool(_PLAN.intersection(words)), found.question.ordinal
    if named and order is None:
        order = next((int(one[0]) for n in named if (one := number_at([*words, ""], n + 1)) is not None), None)
    is_asked = not reading.has("why", "next", "fail", "when", "how_long") and (reading.has(*_OF_PLANS) or is_plan)
    if is_asked and (
        (named and (is_plan or (order or 0) > 0))
        or (new and is_plan and reading.has("what") and not _is_caused(reading))
    ):
        kind: Kind = "steps"
    elif new:
        kind = "replanned"
    else:
        return None
    begin = min(named | new | {n for n, word in enumerate(words) if word in _PLAN})
    content = tuple(
        words[n]
        for n in range(begin, len(words))
        if n not in named | new | found.referred and words[n] not in {*language.known_words, *_PLAN}
    )
    agent, _ = min(found.agents, key=lambda each: each[1], default=("", 0))
    is_known = all(
        word.isdigit() or stem(word) in goals or subjects.is_recorded(word, language.code) for word in content
    )
    question = replace(
        found.question, kind=kind if is_known else None, agent=agent, ordinal=order, unknown=content, person=None
    )
    return Candidate(question, found, None, 0)


def _done_only(parts: Parts, quoted: Sequence[str], subjects: Subjects, language: Language) -> Iterator[Candidate]:
    """Yield the readings about people for whom only one deed was done: ``Who got help but no greeting?``."""
    other = subordinate(parts_of(parts.contrast, subjects, language), subjects)
    if not other.topics or other.person is not None or other.things:
        return
    for each in _combined(parts_of(parts.main, subjects, language), quoted, subjects):
        is_same = each.deed is None or each.deed.topic.name == other.topics[0].name
        if each.question.kind == "who" and not is_same:
            yield replace(each, question=replace(each.question, contrast=other))


def _reported(parts: Parts, subjects: Subjects, language: Language) -> Iterator[Candidate]:
    """Yield the reading about what people said, and the one that refuses it."""
    main, told = parts_of(parts.main, subjects, language), parts_of(parts.event, subjects, language)
    asked = next((name for name in INTERROGATIVES if told.reading.has(name)), "whether")
    question = replace(main.question, says=parts.event, reported=asked, unknown=())
    if subjects.heard_stems:
        yield Candidate(replace(question, kind="heard"), main, None, 0)
    yield Candidate(question, main, None, 0)


def _between(parts: Parts, quoted: Sequence[str], subjects: Subjects, language: Language) -> Iterator[Candidate]:
    """Yield the readings about the time between two events."""
    first, second = parts_of(parts.event, subjects, language), parts_of(parts.until, subjects, language)
    begin, end = bound_of(first, second, subjects, "after"), bound_of(second, first, subjects, "before")
    if begin is None or end is None:
        return
    left = sum(len(set(each.reading.free()) - places_of_event(each)) for each in (first, second))
    for each in _combined(parts_of(parts.main, subjects, language), quoted, subjects):
        yield replace(each, question=replace(each.question, between=(begin, end)), left_over=left)


def _combined(found: Found, quoted: Sequence[str], subjects: Subjects) -> Iterator[Candidate]:
    """Yield each kind of question with each deed, and with each agent as the one that acts or as a thing."""
    says, places = _words_said(found, quoted, subjects)
    telling = {at[0] for _, at in found.reading.found.get("say", ()) if len(at) == 1}  # t1 may hear from the robot
    are_tellers = are_doers(found, telling, subjects)  # "What did t1 say to you?"
    are_subjects = are_tellers and bool(subjects.heard_stems) and (found.verb is None or found.verb in telling)
    for deed in (
        each
        for each in found.deeds
        if not (
            _is_another(each, found)
            or has_other_object(each, found, subjects)
            or _lacks_kind(each, found.reading, subjects)
        )
    ):
        if _says_another(deed, found, says, subjects):
            continue
        if are_subjects and deed.places.isdisjoint(telling):
            if any(
                (found.reading.words[n],) in found.reading.language.phrases["replies"] for n in telling
            ):  # "What did I reply to your offer?"
                offer = replace(found.question, topics=(deed.topic,), person=None)
                event = Event("after", offer, leaves=False, is_near=True)
                yield Candidate(replace(found.question, kind="heard", event=event, unknown=()), found, None, 0)
            continue
        asked = _kinds(found, deed)
        unknown = [place for place in found.reading.free() if place not in deed.places]
        for agent, things in _roles(found, deed.topic, subjects):
            question = replace(
                found.question,
                topics=(deed.topic,), agent=agent, things=things,
                agent_kind=_kind_of_agents(found.reading, subjects, deed),
                is_opposite=deed.is_opposite, is_synonym=deed.is_synonym, is_negative=_is_denied(deed, found),
                by_people=not quoted and are_doers(found, deed.places, subjects),
                counts_people=found.reading.has("how_many") and not found.reading.has("time") and bool(
                    {*found.reading.places("people")} - deed.places),
                unknown=tuple(found.reading.words[place] for place in unknown),
            )  # fmt: skip
            if found.reading.has("start") and "why_not" not in asked:  # that is its first time, whenever it was
                question = replace(question, at_s=None, ordinal=question.ordinal or 1)
            for kind in (one for one in _OF_DEEDS if one in asked):
                yield Candidate(replace(question, kind=kind), found, deed, 0)
    asked = _kinds(found)
    agent, _ = min(found.agents, key=lambda each: each[1], default=("", 0))
    others = {name: found.reading.words[max(0, place - 1)] for name, place in found.agents if name != agent}
    question = replace(found.question, agent=agent, things={**found.question.things, **others})
    asked -= {"said"} if are_tellers else set()
    words, voices = found.reading.words, found.reading.language.voices
    is_teller = bool(voices.you.intersection(words)) or any(voices.second.fullmatch(words[n]) for n in telling)
    if telling and is_teller and not are_tellers and found.reading.language.code != "en":
        asked -= {"heard"}  # "¿Qué me dijiste?"
    asked -= {"see"} if _is_placed(found.reading, question) else set()
    asked -= {"doing", "said", "see", "who"} if _is_content(found) else set()
    if found.reading.has("who") and found.reading.has("not") and not question.about_left_out:
        asked -= {"who"}  # "Who was not here?"
    asks = found.reading.has(*INTERROGATIVES)
    for kind in (one for one in _OF_STATES if one in asked and (one != "heard" or subjects.heard_stems)):
        at_person = question.person.at_s if question.person is not None and kind in ("said", "see") else None
        one = replace(question, kind=kind)
        if kind == "heard":
            is_quoted = bool(says) and are_tellers and not found.reading.has("what")
            heard = says if is_quoted else _words_heard(found, subjects)
            one = replace(one, says=heard, unknown=tuple(word for word in one.unknown if word not in heard))
        elif kind == "count" and are_tellers and subjects.heard_stems:
            one = replace(one, by_people=True)  # "How often did I speak?"
        elif kind == "said" and asks and says and not _EVENTS.intersection(says) and subjects.is_quoted(says):
            # "What did you say about the library?"
            left = tuple(words[place] for place in found.reading.free() if place not in places)
            one = replace(one, says=says, unknown=left)
        elif kind == "said" and GREETINGS.intersection(says):
            continue  # "When did you say hello?"
        yield Candidate(one if at_person is None else replace(one, at_s=at_person), found, None, 0)
    if "why" not in asked and "why_not" not in asked:
        yield from _of_records(found, question, subjects)
    if says and not are_tellers:
        person = None if question.person is not None and question.person.me else question.person  # "can I help you"
        left = [place for place in found.reading.free() if place not in places]
        has_order = places & {*found.reading.places("ordinals"), *found.reading.places("first")}
        question = replace(
            question, says=says, person=person, unknown=tuple(found.reading.words[place] for place in left),
            ordinal=None if has_order else question.ordinal,  # "the library is on the second floor"
        )  # fmt: skip
        for kind in (one for one in _OF_SAYING if one in asked):
            yield Candidate(replace(question, kind=kind), found, None, 0)


def _of_records(found: Found, question: Question, subjects: Subjects) -> Iterator[Candidate]:
    """Yield readings about beliefs, about the places of things, and about the ends of plans."""
    reading, free = found.reading, found.reading.free()
    verb = _verb_by_form(found)
    for each in asked_beliefs(reading, subjects):
        if verb in each.places:
            continue  # "Wann hast du die Tür geöffnet?" asks for a deed
        unknown = tuple(reading.words[place] for place in free if place not in each.places)
        asked = replace(question, kind="believed", belief=each.name, unknown=unknown, asks_when=reading.has("when"))
        yield Candidate(asked, found, None, 0, each.fit)
    asks_origin = any(starts(one, reading.words) for one in _ORIGIN)
    is_thing = reading.has("where") and not asks_origin and (question.things or question.agent)
    if is_thing or _is_placed(reading, question):
        at_person = None if question.person is None else question.person.at_s
        asked = replace(question, kind="where", at_s=question.at_s if at_person is None else at_person)
        yield Candidate(asked, found, None, 0)
    if reading.has("outcome", "fail"):
        yield Candidate(replace(question, kind="ended"), found, None, 0)


def _is_placed(reading: Reading, question: Question) -> bool:
    """Return whether a question asks where a person was, or how far away."""
    free, articles = set(reading.free()), reading.language.phrases["article"]
    has_other = any((word,) in articles and n + 1 in free for n, word in enumerate(reading.words))  # "the library"
    return question.person is not None and reading.has("where", "how_far") and not has_other


def _is_content(found: Found) -> bool:
    """Return whether a question asks what is at a thing, in words that name no deed: ``What was inside box a2?``."""
    phrases, names = found.reading.language.phrases, found.referred
    places, others = (
        {word for name in classes for phrase in phrases[name] for word in phrase}
        for classes in (("at place",), ("what", "being", "article", "to", "from"))
    )
    words = [word for n, word in enumerate(found.reading.words) if n not in names]
    is_place = not places.isdisjoint(words) and (places | others).issuperset(words)
    return is_place and found.reading.has("what") and bool(found.question.things or found.agents)


def _is_denied(deed: NamedDeed, found: Found) -> bool:
    """Return whether a deed is denied; the negation may be one of its own words: ``do nothing``."""
    denied = {*found.reading.places("not")}
    is_own = bool(denied) and not deed.is_opposite and deed.places.issuperset(denied)
    return found.question.is_negative and (not is_own or found.reading.has("nobody", "silent"))


def _is_another(deed: NamedDeed, found: Found) -> bool:
    """Return whether the main verb is not that of a deed, of which the words name only the object.

    "Did you frisk Bob?" is about no other deed to Bob; the verb of a light one, such as *get*, does not count.
    """
    words, verb = found.reading.words, found.verb
    other = _verb_by_form(found)
    if other is not None and _OF_RECORDS.issuperset(deed.evidence):
        return other not in deed.places or other in deed.caused  # "Warum hast du die Tür geöffnet?"
    if found.reading.has("where") and deed.is_synonym and all(words[n - 1] in ARTICLES for n in deed.places):
        return True  # "Where is the vacuum?"
    if verb is None or (verb in found.reading.places("do") and "thing" in deed.evidence):
        return False  # "Did you do the kitchen?"
    if verb in deed.caused:
        return True  # "Did you open the door?" is not about what was done because the door was open
    if verb in deed.places:
        return _has_other_particle(words[verb : verb + 3], verb + 1 in deed.places)
    return bool(found.question.verb) or _OBJECTS.issuperset(deed.evidence)


def _verb_by_form(found: Found) -> int | None:
    return verb_by_form(found.reading, found.referred | {at for _, at in found.agents})


def _says_another(deed: NamedDeed, found: Found, says: Sequence[str], subjects: Subjects) -> bool:
    """Return whether a deed says other words than those in question, or asks for nothing, if the question does."""
    done = subjects.done(deed.topic)
    if not _OF_WORDS.issuperset(deed.evidence) and (not deed.topic.is_saying or "act" in deed.evidence):
        return False
    if found.question.asks:
        return not any(map(subjects.asks, done))
    named = {
        stem(word) for text in arguments_of(deed.topic.name) for word in tokens(text)
    }  # way, of tell("way_library")
    if named.issuperset(map(stem, says)):
        return False
    return not any(subjects.share_said(says, each) >= _MOST_SAID for each in done)


def _has_other_particle(words: Sequence[str], is_named: bool) -> bool:
    """Return whether a particle changes the meaning of a verb: ``check in``, but not ``drive in``."""
    is_particle = PARTICLES.issuperset(words[1:2]) and words[1:] and not is_named and words[2:3] not in _OBJECT_BEGINS
    return bool(is_particle) and _MOVING.isdisjoint(lexicon.meanings((words[0],)))


def _words_heard(found: Found, subjects: Subjects) -> tuple[str, ...]:
    """Return the words of a question that people said."""
    return tuple(word for word in found.reading.words if stem(word) in subjects.heard_stems and word not in _COMMON)


def _kinds(found: Found, deed: NamedDeed | None = None) -> Set[Kind]:
    """Return the kinds of questions that the interrogatives of a clause may ask."""
    reading = found.reading
    classes = [name for name in _ASKED if reading.has(name)]
    told = min([*reading.places("say"), *(deed.places if deed is not None else ())], default=len(reading.words))
    if reading.words[0] in TELLS and classes and told < min(min(reading.places(name)) for name in classes):
        classes = []  # "Did you tell me where the library is?"
    if "why" not in classes:  # behind another one, "when" and "who" begin a subordinate clause
        classes.sort(key=lambda name: (name in ("what", "who", "when"), min(reading.places(name))))
    classes = ["why"] if "what" in classes and _is_caused(reading) else classes[:1]
    kinds = set(_ASKED[classes[0]]) if classes else set(_WITHOUT)
    if not classes and reading.has("say"):
        kinds.add("said")  # "Did you say anything to t2?"
    if deed is not None and not classes:
        kinds &= _WHETHER if reading.has("future", "plan") else _WHETHER - {"next"}
    if not classes and _is_request(reading):
        kinds -= {"did", "count"}  # "Could you greet t2 now?" does not ask whether it was done
    if deed is None and reading.has("plan") and not reading.has("see"):
        kinds.discard("see")  # "What was your goal at 12 s?"
    places = set() if deed is None else deed.places
    is_opposite = deed is not None and deed.is_opposite
    is_denied = reading.has("silent") or not places.issuperset(reading.places("not"))
    if reading.has("fail") or (deed is None and reading.has("outcome") and not classes):
        kinds.add("failed")
    if "why" in kinds and (is_denied or is_opposite):
        kinds.add("why_not")
        if "why" in classes and not is_opposite:
            kinds.remove("why")
    return kinds


def _is_request(reading: Reading) -> bool:
    """Return whether somebody is asked to do something: ``please``, ``could you``."""
    words, asks = reading.words, sorted(reading.language.phrases["request"], key=len, reverse=True)
    begin = next((len(one) for one in asks if tuple(words[: len(one)]) == one), 0)
    is_asking = tuple(words[begin : begin + 1]) in reading.language.phrases["matrix"]  # "would you say"
    is_past = reading.has("past") or reading.language.auxiliaries.intersection(words[begin:])
    return begin > 0 and not is_asking and not is_past


def _is_caused(reading: Reading) -> bool:
    """Return whether something causes somebody to act: ``what tempted you to ...``, ``what had you ...``."""
    if reading.words[reading.place("what")] != "what":
        return False
    following = reading.words[reading.place("what") + 1 :][:2]
    is_verb = bool(following) and (following[0] not in reading.language.auxiliaries or following[0] == "had")
    return is_verb and bool(_YOU.intersection(following[1:]))


def _roles(found: Found, topic: Topic, subjects: Subjects) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the agent that acts with the things in question; an agent that something is done to is a thing."""
    words, own = found.reading.words, arguments_of(topic.name)  # "check Bob" is the deed check("Bob")
    things = {name: before for name, before in found.question.things.items() if name not in own}
    agents = sorted(found.agents, key=lambda each: each[1])
    beside = {name: words[place - 1] if place else "" for name, place in agents}
    if not beside:
        yield "", things
        return
    done = subjects.done(topic)
    does, objects = {each.source for each in done}, {one for each in done for one in arguments_of(each.what)[1:]}
    first = next(iter(beside))
    for agent in beside:
        if agent in does or agent == first:
            yield agent, {**things, **{name: before for name, before in beside.items() if name != agent}}
    if objects.intersection(beside) or not does.intersection(beside):
        yield "", {**things, **beside}


def _kind_of_agents(reading: Reading, subjects: Subjects, deed: NamedDeed) -> str:
    """Return the kind of agents of ``which carrier left``, if agents of this kind do the deed; else empty."""
    kind = asked_kind(reading, subjects)
    return next((one for each in subjects.done(deed.topic) if stem(one := kind_of_name(each.source)) == kind), "")


def asked_kind(reading: Reading, subjects: Subjects) -> str:
    """Return the kind of names of ``which carrier`` and ``how many carriers``, as a stem; empty without one."""
    asked = next((stem(word) for n, word in enumerate(reading.words) if reading.is_asked_for(n)), "")
    return asked if asked in {stem(kind) for kind in subjects.kinds if len(kind) > 1} else ""


def concerns_kind(call: TraceRecord, kind: str) -> bool:
    """Return whether a call is one of or about a thing or agent of a kind, which is a stem."""
    return any(stem(kind_of_name(name)) == kind for name in (call.source, *arguments_of(call.what)))


def _lacks_kind(deed: NamedDeed, reading: Reading, subjects: Subjects) -> bool:
    """Return whether a question asks for a kind of things that the deed has nothing to do with."""
    kind, done = asked_kind(reading, subjects), subjects.done(deed.topic)
    return bool(kind and done) and not any(concerns_kind(one, kind) for one in done)


def _words_said(found: Found, quoted: Sequence[str], subjects: Subjects) -> tuple[tuple[str, ...], Set[int]]:
    """Return the words of an utterance and their places: quoted ones, or those behind a verb of saying."""
    reading, words = found.reading, found.reading.words
    if quoted and (places := starts(quoted, words)):
        return tuple(quoted), set(range(places[0], places[0] + len(quoted)))
    said = reading.places("say")
    if not said:
        return (), set()
    named = found.referred | {n for n, word in enumerate(words) if word in subjects.argument_names}
    end = next((n for n in range(max(said) + 2, len(words)) if n in named), len(words))
    others = reading.language.first_words("people", "nobody", "all")
    if end == len(words) > 1 and words[-2] in _BEFORE_ADDRESSEE and words[-1] in others:
        end -= 1  # "thank you to anybody"
    begin = max(said) + 1
    if begin == len(words):  # the verb is the last word, as in German and in a passive
        before = [*reading.places("you"), *(n for n in range(max(said)) if words[n] in reading.language.auxiliaries)]
        begin, end = max(before, default=-1) + 1, max(said)
    while begin < end - 1 and words[begin] in _BEFORE_REQUEST:
        begin += 1
    quantities = {word for name in ("times", "others") for one in reading.language.phrases[name] for word in one}
    while end > begin + 1 and (words[end - 1] in _BEFORE_ADDRESSEE or words[end - 1] in quantities):
        end -= 1
    if any(reading.language.phrases[name].count((words[begin],)) for name in INTERROGATIVES if begin < len(words)):
        # "Did you say where the library is?" does not quote, but asks for words about the library.
        told = tuple(word for word in words[begin:end] if word not in reading.language.known_words)
        return (told, set(range(begin, end))) if told and subjects.is_quoted(told) else ((), set())
    names = {word for name in found.question.things for word in tokens(name)}
    mine = reading.language.first_words("me")
    while end - begin > 1 and words[begin] in {*INDEFINITE, *_BESIDE_SAID, *mine, *names}:
        begin += 1  # "ask someone to ...", "ask for a badge"
    vague = reading.language.single_words("filler", "what", "me", "you", "left out") - GREETINGS
    event = next((n for n in range(begin + 1, end) if words[n] in _EVENTS), end)
    if not subjects.is_quoted(words[begin:end]):
        end = event  # "say goodbye when the person left"
    told = tuple(words[begin:end])
    is_known = subjects.is_quoted(told) or not GREETINGS.isdisjoint(told)  # "say hello"
    if vague.issuperset(told) or (not is_known and reading.taken.issuperset(range(begin, end))):
        return (), set()  # "speak with t3", "say anything", "no dijiste nada"
    return told, set(range(begin, end))
