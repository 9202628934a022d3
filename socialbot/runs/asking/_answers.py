"""Answers to questions, composed of clauses that records support."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from difflib import SequenceMatcher
from weakref import WeakKeyDictionary

import msgspec

from socialbot.core.errors import ParameterError
from socialbot.core.messages import TraceRecord
from socialbot.core.registry import vocabulary_of
from socialbot.core.vocabulary import Deed
from socialbot.runs.asking._activity import (
    ahead,
    count_heard,
    doing,
    ended,
    failed,
    heard,
    heard_as,
    replanned,
    said,
    steps,
)
from socialbot.runs.asking._causes import contrast, reasons
from socialbot.runs.asking._clauses import is_question
from socialbot.runs.asking._facts import Facts, near
from socialbot.runs.asking._options import asking_back, offered
from socialbot.runs.asking._people import believed, placed, seen, stay, visitors
from socialbot.runs.asking._question import NEAR_S, Question, with_time
from socialbot.runs.asking._ranking import SURE, ranked
from socialbot.runs.asking._readings import candidates
from socialbot.runs.asking._scope import NOBODY, Scope, Told
from socialbot.runs.asking._sentences import Answer, Claim, Clause, infinitive
from socialbot.runs.asking._subjects import Subjects
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._unrecorded import unrecorded
from socialbot.runs.asking._whether import Whether
from socialbot.runs.asking._words import folded, sound, tokens
from socialbot.runs.asking.languages import LANGUAGES, Language
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from socialbot.runs.why import call_of, decided_at

_MOST_UNRECORDED = 2
"""Most names without records that an answer tells."""
_LETTER = re.compile(r"(?<=\w) [A-HJ-Z]\b")
"""Letter of a name behind a word; "I" is a word."""
_AND_WHY = re.compile(
    r"\W+(and|und|et|y)\s+(why|how\s+come|warum|wieso|weshalb|pourquoi|por\s*qu[e\u00e9])\W*$", re.IGNORECASE
)
"""Second question for the reason of what the first one asks."""
_SHORTEST_NAME = 2
"""Length above which a word of a name is told by its sound."""
_SIMILAR_SOUND = 0.6
"""Least share of the consonants that a misheard word and the word that was said have in common."""
_TOLD: Mapping[str, Callable[[Scope], Told | None]] = {
    "see": seen, "said": said, "doing": doing, "next": ahead,
    "heard": heard, "failed": failed, "believed": believed, "ended": ended,
    "where": placed, "steps": steps, "replanned": replanned,
}  # fmt: skip
"""Functions that answer kinds of questions about a state."""


def answer(
    run: RunView,
    text: str,
    *,
    language: str = "",
    at_s: float | None = None,
    speaker: str = "",
    agent: str = "",
    spoken: bool = False,
    asked_as: str = "",
) -> Answer:
    """Return the answer of a run to a question about it, or a question back with ``options``.

    Args:
        run: A recorded or live run.
        text: The question, as written or recognised.
        language: Its language (ISO 639-1); by default the one that explains it best.
        at_s: Time of the question, in seconds from the start; by default the end of the run.
        speaker: Track id of the person who asks; by default the person whom the deed in question concerned.
        agent: Node of the agent that is addressed; by default any.
        spoken: Tell times as people say them, "9 seconds ago", instead of "at 3.6 s".
        asked_as: Id of the record of the question, if the run has heard it: it is nothing that was said before.

    Raises:
        ParameterError: ``agent`` is no agent of the run.
    """
    history = run.history
    if agent and agent not in history.agents:
        remedy = f"give one of {', '.join(history.agents)}" if history.agents else "the run has no agents"
        raise ParameterError(f"there is no agent {agent!r}", remedy=remedy)
    facts, now_s = facts_of(run, asked_as), asked_at_s(run, at_s)

    def reply(question: Question) -> Answer:
        return answered(run, facts, question, text, now_s, speaker=speaker, agent=agent, spoken=spoken)

    main = _AND_WHY.sub("", text)  # "Did you greet t2, and why?"
    found = candidates(main, facts.subjects, language)
    if not found:
        return reply(Question(None, language if language in LANGUAGES else "en"))
    answers = [reply(each.question) for each in found]
    shares = ranked(found, answers, facts.subjects)
    place, probability = shares[0]
    confidence = round(probability, 3)
    known = [(answers[n], share) for n, share in shares if answers[n].known and not found[n].question.has_unknown_name]
    options = offered(known, SURE, now_s if spoken else None)
    best = found[place]
    told = answers[place]
    if probability < SURE or options:
        told = reply(replace(best.question, kind=None))
    if options:
        back = asking_back([each.question for each in options])
        told = msgspec.structs.replace(told, text=back, options=tuple(options))
    elif not told.known and (names := unrecorded(best.found, facts.subjects, text)):
        told = _without_record(told, names[:_MOST_UNRECORDED], text)
    elif main != text and told.clauses[0].claim.kind in ("did", "said"):
        because = reply(replace(best.question, kind="why"))
        told = _with_reason(told, because) if because.known else told
    return msgspec.structs.replace(told, confidence=confidence)


def _with_reason(told: Answer, because: Answer) -> Answer:
    """Return an answer with the reason for what it tells; of several deeds, for the last one."""
    reason = f"{because.text[:1].lower()}{because.text[1:]}"
    if len(told.clauses) > 1:
        whole, clauses = f"{told.text.rstrip('.')}; {reason}", (*told.clauses, *because.clauses)
        return msgspec.structs.replace(told, text=whole, clauses=clauses)
    yes = f"{LANGUAGES[told.language].sentences['yes']}: "
    whole = f"{yes}{reason}" if told.text.startswith(yes) else because.text
    return msgspec.structs.replace(because, text=whole)


def words_of_names(run: RunView) -> Set[str]:
    """Return the words of the names of agents, things and people in a run, as people say them."""
    subjects = facts_of(run).subjects
    names = (*subjects.agents, *subjects.things, *subjects.persons, *subjects.argument_names)
    return {word for name in names for word in tokens(name) if word.isalpha() and len(word) > _SHORTEST_NAME}


def answer_heard(
    texts: Sequence[str], answered: Callable[[str], Answer], names: Set[str] = frozenset()
) -> tuple[str, Answer]:
    """Answer a spoken question whose recognised texts are ``texts``, the most likely one first.

    The first one counts. Only if it has words that no record has, they may be misheard: then the first other text that
    is answered, has words of a similar sound in their places, and denies as much as the first one, is taken. If it is
    not understood, each word that is not one of grammar may be misheard. A text with a letter more, as in "carrier A",
    counts before one without it: unstressed letters are missed easily. Last, a word that no record has is taken for the
    only name that sounds the same: "Scott" for "scout".

    Args:
        texts: The texts, at least one.
        answered: Returns the answer to a text: `answer` for a run.
        names: Words of names that people may say: those of `words_of_names`.

    Returns:
        The text that was taken, and its answer.
    """
    whole = next((text for text in texts[1:] if _LETTER.search(text) and _is_without_letter(texts[0], text)), "")
    if whole and (found := answered(whole)).known:
        return whole, found
    first = answered(texts[0])
    unknown = {
        word for one in first.clauses if one.claim.kind == "not_named" for word in tokens(" ".join(one.claim.what))
    }
    words, language = tokens(texts[0]), LANGUAGES[first.language]
    if not first.known and not first.intent:
        unknown.update(word for word in words if word not in language.known_words)
    if first.known or not unknown:
        return texts[0], first
    negations = language.single_words("not")
    for text in (*texts[1:], _with_names(texts[0], unknown, names)):
        others = tokens(text)
        if _is_misheard(words, others, unknown) and negations.intersection(words) == negations.intersection(others):
            found = answered(text)
            if found.known:
                return text, found
    return texts[0], first


def _with_names(text: str, unknown: Set[str], names: Set[str]) -> str:
    """Return a text with the only name of the same sound in place of each unknown word that has one."""
    for word in unknown:
        alike = [one for one in names if sound(one) == sound(word) and len(sound(one)) > 1]
        if len(alike) == 1:
            text = re.sub(rf"\b{re.escape(word)}\b", alike[0], text, flags=re.IGNORECASE)
    return text


def _is_without_letter(text: str, other: str) -> bool:
    """Return whether a text has the words of another one without its capital letters."""
    return not _LETTER.search(text) and tokens(text) == tokens(_LETTER.sub("", other))


def _is_misheard(words: Sequence[str], others: Sequence[str], unknown: Set[str]) -> bool:
    """Return whether ``others`` have words of a similar sound in the places of the unknown ``words``."""
    for change, begin, end, start, stop in SequenceMatcher(None, words, others, autojunk=False).get_opcodes():
        if unknown.isdisjoint(words[begin:end]):
            continue
        sounds = sound("".join(words[begin:end])), sound("".join(others[start:stop]))
        if change == "equal" or SequenceMatcher(None, *sounds, autojunk=False).ratio() < _SIMILAR_SOUND:
            return False
    return True


def _without_record(refused: Answer, names: Sequence[str], text: str) -> Answer:
    """Return the refusal of a question with the names in it that no record has, as they were written."""
    written = {folded(one): one for one in re.findall(r"\w+", text)}
    sentences = LANGUAGES[refused.language].sentences
    clauses = [
        Clause(sentences["not_named"].format(word=written.get(one, one)), (), Claim("not_named", what=(one,)))
        for one in names
    ]
    told = f" {sentences['and']} ".join(each.text for each in clauses)
    told, unclear = f"{told[:1].upper()}{told[1:]}", sentences["unclear"]
    is_unclear = f" {unclear}." in refused.text
    text = refused.text.replace(f" {unclear}.", f" {told}.") if is_unclear else f"{sentences['unknown']}. {told}."
    return msgspec.structs.replace(refused, text=text, clauses=tuple(clauses))


def is_asked(text: str, language: str) -> bool:
    """Return whether a text has the form of a question in a language (ISO 639-1)."""
    return language in LANGUAGES and is_question(tokens(text), LANGUAGES[language])


_FACTS: WeakKeyDictionary[RunView, tuple[tuple[int | str, ...], Facts]] = WeakKeyDictionary()
"""Facts of runs with the state of their history; a live run has new ones after each record."""


def facts_of(run: RunView, asked_as: str = "") -> Facts:
    """Return the facts of a run and what it can be asked about; rules name deeds that were never considered, too."""
    history = run.history
    state = id(history), len(history), history.forgotten, history.end, asked_as
    known = _FACTS.get(run)
    if known is None or known[0] != state:
        known = _FACTS[run] = state, _facts(run, asked_as)
    return known[1]


def _facts(run: RunView, asked_as: str) -> Facts:
    vocabulary = vocabulary_of(run.graph)
    if run.graph is None:  # the words of all packages
        known = tuple(deed for deed in vocabulary.deeds if _occurs(deed, run.history))
        vocabulary = replace(vocabulary, deeds=known)
    return Facts(Subjects(run.history, run.wording, vocabulary, run.rules, asked_as))


def answered(
    run: RunView,
    facts: Facts,
    question: Question,
    text: str,
    now_s: float,
    *,
    speaker: str = "",
    agent: str = "",
    spoken: bool = False,
) -> Answer:
    """Return the answer to a question as it was understood, asked at ``now_s``."""
    return _Answering(run, facts, with_time(question, now_s), now_s, speaker, agent, spoken=spoken).answer(text)


def asked_at_s(run: RunView, at_s: float | None = None) -> float:
    """Return the time (s) of a question in a run: by default its end."""
    end_s = run.history.seconds(run.end) if len(run.history) else 0.0
    return end_s if at_s is None else min(max(0.0, at_s), end_s)


def _occurs(deed: Deed, history: History) -> bool:
    """Return whether a run has records of the calls of a deed."""
    names = {call.partition("(")[0] for call in deed.calls}
    return any(call_of(record).partition("(")[0] in names for record in history)


_LIMITED = {"who", "count", "did", "how_long", "when"}
"""Kinds of questions about visits that may have a limit, or be at the same time as others."""


class _Answering(Whether):
    """One question being answered."""

    def answer(self, text: str) -> Answer:
        question = self.question
        if not len(self.history):
            return self._unknown(text, self.speech.say("not_recorded"))
        if question.kind is None:
            return self._unknown(text, self.speech.say("unclear"), understood=False)
        asked_s = question.at_s if question.span_s is None else question.span_s[0]
        if asked_s is not None and not 0.0 <= asked_s <= self.history.duration_s + NEAR_S:
            return self._unknown(text, self.speech.say("not_recorded"))
        is_about_nobody = question.person is not None and self.topic is not None and not self.topic.concerns_people
        is_limited = question.limit is not None or question.is_shared
        has_no_span = question.between is not None and question.span_s is None
        if (
            (question.event is not None and self.event_s is None)
            or has_no_span
            or self.persons == [NOBODY]
            or is_about_nobody
            or (is_limited and (self.topic is not None or question.kind not in _LIMITED))
        ):
            return self._unknown(text, self.speech.say("not_recorded"))
        if question.by_people:
            found = count_heard(self) if self.topic is None else heard_as(self)
        else:
            found = self._contrasted(
                _TOLD[question.kind](self) if question.kind in _TOLD else getattr(self, f"_{question.kind}")()
            )
        if found is None:
            return self._unknown(text, self.speech.say("not_recorded"))
        return self._made(text, *found)

    def _made(self, text: str, told: str, clauses: Sequence[Clause]) -> Answer:
        whole = told[:1].upper() + told[1:]
        return Answer(
            text, self.language, self.question.kind or "", True, f"{whole.rstrip('.')}.", tuple(clauses),
            assumes=self.assumes,
        )  # fmt: skip

    def _unknown(self, text: str, why: str, *, understood: bool = True) -> Answer:
        language = LANGUAGES[self.language]
        told = f"{self.speech.say('unknown')}. {why[:1].upper()}{why[1:]}."
        if not understood and not self.spoken:
            told += f" {self.speech.say('able')}."
        intent = self.question.kind or "" if understood else ""
        asked = _examples(self.subjects, language, self.history.duration_s / 2)
        return Answer(text, self.language, intent, False, told, examples=asked)

    # Why

    def _contrasted(self, found: Told | None) -> Told | None:
        """Add what was done or left undone for those with whom the question contrasts the deed."""
        other = self.question.contrast
        if other is None or found is None or other.person is None:
            return found
        topics = other.topics or self.question.topics
        if not topics:
            return None
        asked = replace(self.question, topics=topics, person=other.person, contrast=None, kind="why_not")
        foil = self._beside(asked)
        if foil.persons == [NOBODY]:
            return None
        told = foil._why_not()
        return found if told is None else (f"{found[0]}; {told[0]}", [*found[1], *told[1]])

    def _why(self) -> Told | None:
        deed = self.chosen() if self.topic is not None else self._undescribed()
        if deed is None:
            if self.topic is None:
                return None
            if self.event_s is not None and self.question.span_s is None:  # to stay idle may have begun before
                deed = self._lasting(self.of_persons(self.deeds_at_all), self.history.stamp(self.event_s))
        return self._left_undone() if deed is None else self._because(deed)

    def _because(self, deed: TraceRecord) -> Told | None:
        topic = self.topic or self.subjects.topic_of(deed)
        clauses = [self.speech.did(deed, topic)]
        because = reasons(self.speech, deed)
        if not because:
            return None
        told = self.speech.say("because", clause=clauses[0].text, reason=self.joined(because))
        foil = contrast(self.speech, deed)
        if foil is not None:
            told += f"; {foil.text}"
        return told, [*clauses, *because, *([foil] if foil else [])]

    def _undescribed(self) -> TraceRecord | None:
        """Return the deed of a question without a known deed: what was said, or what was done at a time or last."""
        deeds = self.meant_until_now()
        if self.question.says:
            return next(reversed(self.quoted(deeds, self.question.says)), None)
        if self.question.unknown:
            return None
        if self.question.at_s is not None:
            stamp = self.history.stamp(self.question.at_s)
            decided = [each for each in decided_at(self.history, stamp) if self.is_meant(each)]
            return next(iter(decided or near(deeds, stamp, NEAR_S)), None)
        return self.numbered(self.of_persons(deeds))

    def _why_not(self) -> Told | None:
        if self.topic is None and self.question.says:
            return self._did_say()
        if self.topic is None and self.question.about_speech:
            # "Why did you say nothing to t3?": the first deed that speaks was left undone.
            spoken = (each for each in self.subjects.deeds if self.subjects.words_said(each))
            self.topic = next((topic for each in spoken if (topic := self.subjects.topic_of(each))), None)
            self.deeds = self.deeds_at_all = [] if self.topic is None else self.up_to_now()
            self.deeds = [each for each in self.deeds if self.subjects.words_said(each)]
        if self.topic is None:
            return None
        deed = self.chosen()
        if deed is not None:
            did = self.speech.did(deed, self.topic)
            return did.text, [did]
        return self._left_undone()

    # Deeds: when, who

    def _when(self) -> Told | None:
        event = self.question.event
        if self.topic is not None:
            if self.question.is_negative and not self.question.is_opposite and not self.subjects.persons:
                return None  # "Which box was not picked up?": no record tells which other ones there are.
            deeds = self.of_persons(self.deeds)
            if not deeds and (parts := self._parts()):
                return self._compared(parts)
            if self.question.at_s is not None:
                deeds = near(deeds, self.history.stamp(self.question.at_s), NEAR_S)
            elif self.question.ordinal is not None:
                deeds = self.one_of(deeds)
            elif event is not None and event.is_near:
                deeds = deeds[-1:] if event.relation == "before" else deeds[:1]
            return self._listed(deeds) if deeds else self._left_undone()
        if self.question.says:
            said = self.quoted(self.up_to_now(), self.question.says)
            return self._listed(said) if said else None
        return visitors(self)

    def _who(self) -> Told | None:
        other = self.question.contrast
        if self.topic is not None and other is not None and other.topics and other.person is None:
            return self._done_only(other)
        if self.topic is not None:
            left = (
                self._left_out(self._all_people()) if self.question.is_negative is not self.question.is_opposite else []
            )
            if self.question.person is None and left:
                return self._without(left)
            return self._when()
        return self._without_any() if self.question.about_left_out else self._when()

    def _done_only(self, other: Question) -> Told | None:
        """Return the people for whom the deed was done, and the ``other`` one not."""
        asked = replace(self.question, topics=other.topics, contrast=None, is_opposite=other.is_opposite)
        beside = self._beside(asked)
        came = self._all_people()
        undone = [
            one for one in came if one not in {each for deed in beside.deeds for each in self.facts.concerned(deed)}
        ]
        done = {one: deed for deed in self.deeds for one in self.facts.concerned(deed) if one in undone}
        if not done:
            return None
        told, clauses = self._listed(list({id(deed): deed for deed in done.values()}.values()))
        without, some = beside._without(list(done))
        return f"{told}; {without}", [*clauses, *some]

    def _how_long(self) -> Told | None:
        """Return when people were here; for a deed also when it was done; for a time between events both of them."""
        if self.question.between is not None:
            stays = [each for each in self.visits() if each.person in self.event_persons]
            return self.told_deeds(self.between) or self.told([stay(self, each) for each in stays])
        if self.topic is None:
            return self._who()
        deed = self.chosen()
        if deed is None:
            return self._left_undone()
        clauses = [self.speech.did(deed, self.topic)]
        concerned = self.facts.concerned(deed)
        clauses += [
            stay(self, each)
            for each in self.facts.visits
            if each.person in concerned and each.first.stamp <= deed.stamp <= each.last.stamp
        ]
        end = self.facts.end_of(deed)
        if end is not None and not clauses[1:]:
            clauses.append(self.speech.took(deed, end))
        return self.joined(clauses), clauses


def _examples(subjects: Subjects, language: Language, at_s: float) -> tuple[str, ...]:
    """Return questions that this run can answer."""
    done = [topic for topic in subjects.topics if subjects.done(topic)]
    declared = (" ".join(topic.words[language.code][0]) for topic in done if language.code in topic.words)
    named = (
        infinitive(subjects.wording.call(topic.name, arguments_of(call_of(subjects.done(topic)[0]))))
        for topic in done
        if topic.loose and language.code == "en"
    )
    deed = next(declared, None) or next(named, None)
    texts = language.sentences["examples"].split(" | ")
    return tuple(text.format(deed=deed, at=f"{at_s:.0f}") for text in texts if deed or "{deed}" not in text)
