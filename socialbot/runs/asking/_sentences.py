"""Clauses of answers: what each says, in words, and the claim and records behind it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.core.vocabulary import Condition, Sentences
from socialbot.runs.asking._facts import Facts, Held, record_agent
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking.languages import LANGUAGES
from socialbot.runs.narration import Narrator, past
from socialbot.runs.why import call_of

ClaimKind = Literal[
    "did", "did_not", "said", "said_not", "believed", "not_believed", "percept", "wanted", "planned", "asked",
    "rejected", "chose", "saw", "saw_nobody", "here", "nobody_here", "count", "count_people", "count_heard",
    "nothing_wanted",
    "message", "outside", "heard", "failed", "nothing_failed", "took", "plan_ended", "not_named",
    "step", "step_count",
]  # fmt: skip


class Claim(msgspec.Struct, frozen=True, omit_defaults=True):
    """Statement of a clause in a form that can be checked against the trace. Times are seconds from the start.

    Args:
        kind: What is stated.
        agent: Node of the agent that it is about.
        what: Calls of the deed, the belief, goal or desire, or the words.
        at_s: Time, or begin of the time, for which it is stated.
        until_s: End of that time.
        persons: The people whom it is about.
        value: A number in the clause: seconds, metres, a count or the number of a step.
    """

    kind: ClaimKind
    agent: str = ""
    what: tuple[str, ...] = ()
    at_s: float | None = None
    until_s: float | None = None
    persons: tuple[str, ...] = ()
    value: float | None = None


class Clause(msgspec.Struct, frozen=True):
    """Part of an answer with the ids of the records behind it."""

    text: str
    records: tuple[str, ...]
    claim: Claim


class Answer(msgspec.Struct, frozen=True):
    """Answer to a question.

    Args:
        question: The question.
        language: Language of the answer (ISO 639-1).
        intent: Kind of question: why, why_not, see, next, doing, said, who, when, how_long, count or did; empty if
            unclear.
        known: Whether there is an answer; else ``text`` says "I don't know".
        text: The answer.
        clauses: Its clauses with the ids of their records and their claims, in the order of the text.
        confidence: How sure it is that the question was understood, from 0 to 1.
        assumes: What the answer assumes, such as who asks; empty if it assumes nothing.
        examples: Questions that can be asked instead, if the answer is not known.
        options: Answers to the most likely readings, if ``text`` asks which one is meant; each has its reading as an
            indirect question.
    """

    question: str
    language: str
    intent: str
    known: bool
    text: str
    clauses: tuple[Clause, ...] = ()
    confidence: float = 0.0
    assumes: str = ""
    examples: tuple[str, ...] = ()
    options: tuple[Answer, ...] = ()


_ITS = re.compile(r"\bits\b")


def _number(value: float, sentences: Mapping[str, str]) -> str:
    """Return a number with at most one decimal, as the language of ``sentences`` writes it."""
    return f"{round(value, 1):g}".replace(".", sentences["decimal"])


def time_in_words(seconds: float, asked_at_s: float | None, sentences: Mapping[str, str]) -> str:
    """Return a time in words: from the start of the run, or back from the time of the question if that is given."""
    if asked_at_s is None or seconds > asked_at_s:
        return sentences["at"].format(at=_number(seconds, sentences))
    ago = round(asked_at_s - seconds)
    return sentences["ago"].format(ago=ago) if ago > 1 else sentences["just_now"]


def infinitive(sentence: str) -> str:
    """Put a sentence without subject, such as ``goes to room1``, into the infinitive."""
    verb, space, rest = sentence.partition(" ")
    if verb.endswith("ies"):
        verb = f"{verb[:-3]}y"
    elif verb in ("has", "is", "does", "goes"):
        verb = {"has": "have", "is": "be", "does": "do", "goes": "go"}[verb]
    elif re.search(r"(ss|sh|ch|x)es$", verb):
        verb = verb[:-2]
    elif verb.endswith("s") and not verb.endswith("ss"):
        verb = verb[:-1]
    return f"{verb}{space}{rest}"


class Speech:
    """Puts facts of a run into clauses of one language.

    Args:
        facts: The facts.
        language: Language of the answer (ISO 639-1).
        you: The person who asks, if known: "you" in the answer.
        is_single: Whether only one agent is concerned, which says "I".
        asked_at_s: Time of the question, to tell times as "9 seconds ago"; None: as "at 3.6 s".
    """

    def __init__(self, facts: Facts, language: str, you: str, is_single: bool, asked_at_s: float | None = None) -> None:
        self.facts, self.language, self.you = facts, language, you
        self.is_single, self.asked_at_s = is_single, asked_at_s
        self.fixed: Mapping[str, str] = LANGUAGES[language].sentences
        self._narrator = Narrator(facts.subjects.wording, facts.history)

    def say(self, name: str, **values: object) -> str:
        return self.fixed[name].format(**values)

    def number(self, value: float) -> str:
        """Return a number with at most one decimal."""
        return _number(value, self.fixed)

    def people(self, persons: Sequence[str], nobody: str = "somebody") -> str:
        """Return people in words; without any, the word ``nobody``."""
        named = [self.say("somebody") if one == "somebody" else self.say("person", id=one) for one in persons]
        if not named:
            return self.say(nobody)
        head = ", ".join(named[:-1])
        return f"{head} {self.say('and')} {named[-1]}" if head else named[-1]

    def subject(self, agent: str) -> str:
        return "I" if self.is_single else self.facts.subjects.wording.name(agent)

    def _of_subject(self, agent: str, verb: str) -> str:
        """Return a sentence of a subject and a verb with its objects; what an agent calls its own is "my"."""
        subject = self.subject(agent)
        return f"{subject} {_ITS.sub('my', verb) if subject == 'I' else verb}"

    def about(self, agent: str, text: str) -> str:
        """Return a sentence with "I" as one about ``agent``, unless that agent speaks."""
        if self.is_single or not agent:
            return text
        name = self.facts.subjects.wording.name(agent)
        if self.language != "en" or not text.startswith("I "):
            return f"{name}: {text}"
        return f"{name}{text[1:]}"

    def at(self, clause: Clause, seconds: float) -> Clause:
        """Return a clause with its time in front."""
        return msgspec.structs.replace(clause, text=self.then(seconds, clause.text))

    def within(self, clause: Clause, begin_s: float, end_s: float) -> Clause:
        """Return a clause with its span of time (s) in front."""
        text = self.say("within", at=self.number(begin_s), until=self.number(end_s), clause=clause.text)
        return msgspec.structs.replace(clause, text=text)

    def then(self, seconds: float, text: str) -> str:
        """Return a text with the time it is about in front."""
        return self.say("then", when=self.when(seconds), clause=text)

    def when(self, seconds: float) -> str:
        """Return a time in words: from the start of the run, or back from the question."""
        return time_in_words(seconds, self.asked_at_s, self.fixed)

    def _declared(self, sentences: Sentences, persons: Sequence[str], nobody: str = "somebody") -> str | None:
        pair = sentences.get(self.language)
        if pair is None:
            return None
        if isinstance(pair, str):
            return pair
        if self.you and self.you in persons:
            return pair[0]
        return pair[1].replace("{person}", self.people(persons, nobody))

    # Deeds

    def did(self, record: TraceRecord, topic: Topic | None, *, at: bool = True) -> Clause:
        facts = self.facts
        persons, agent = facts.concerned(record), record_agent(facts.history, record)
        declared = None
        if topic is not None and topic.declared is not None:
            declared = self._declared(topic.declared.did, persons)
        if record.kind == "utterance":
            what: tuple[str, ...] = (record.what,)
        else:
            what = (call_of(record) or record.what,)
        text = declared or self._generic(record, agent)
        seconds = facts.history.seconds(record.stamp)
        about = tuple(one for one in persons if declared is not None and "{person}" in _second(topic, self.language))
        kind: ClaimKind = "said" if record.kind == "utterance" and declared is None else "did"
        if record.kind in ("goal", "desire"):
            kind = "wanted"
        clause = Clause(text, (record.id,), Claim(kind, agent, what, seconds, persons=about))
        return self.at(clause, seconds) if at else clause

    def _generic(self, record: TraceRecord, agent: str) -> str:
        words = self.facts.subjects.words_said(record)
        if words:
            return self.about(agent, self.say("said", what=words))
        if record.kind in ("goal", "desire"):
            return f"{self.subject(agent)} wanted {record.what}"
        return self._of_subject(agent, past(self._sentence(record)))

    def _sentence(self, record: TraceRecord) -> str:
        """Return a deed as a sentence in the present tense without its subject."""
        wording = self.facts.subjects.wording
        call = call_of(record) or record.what
        name, _, arguments = call.rstrip(")").partition("(")
        known = name in wording.phrases
        return wording.call(name, [one.strip() for one in arguments.split(",")]) if known else f"does {record.what}"

    def did_not(
        self, topic: Topic, persons: Sequence[str], agent: str, span: tuple[float, float], things: Sequence[str]
    ) -> Clause:
        """Return the clause that a deed was not done in a span of time."""
        declared = self._declared(topic.declared.did_not, persons, "anybody") if topic.declared is not None else None
        text = declared
        if text is None:
            sentence = self._partly(topic, things)
            is_named = bool(agent) or self.is_single
            text = (
                self._of_subject(agent, f"did not {infinitive(sentence)}") if is_named else f"nobody {past(sentence)}"
            )
        named = persons if topic.declared is None or topic.concerns_people else ()
        return Clause(text, (), Claim("did_not", agent, topic.calls, *span, persons=(*named, *things)))

    def _partly(self, topic: Topic, things: Sequence[str]) -> str:
        """Return the sentence of a deed with only some of its arguments, each in the place of its kind."""
        sentence = self.facts.subjects.wording.phrases.get(topic.name)
        if sentence is None and topic.is_saying:
            said = " ".join(arguments_of(topic.name)).rstrip(",:;")
            return f'says "{said}"' + (f" to {', '.join(things)}" if things else "")
        if sentence is None:
            return f"does {topic.name}" + (f" with {', '.join(things)}" if things else "")
        done = self.facts.subjects.done(topic)
        example = list(arguments_of(done[-1].what)) if done else []
        values = {
            n: thing for thing in things for n, one in enumerate(example) if kind_of_name(one) == kind_of_name(thing)
        }
        unfit = [thing for thing in things if thing not in values.values()]
        told = re.split(
            r"\s+\w+\s+\{(?!(?:%s)\})\d\}|\s*\{(?!(?:%s)\})\d\}" % (("|".join(map(str, values)) or "x",) * 2), sentence
        )[0]
        told = told.format(*(values.get(n, "") for n in range(10)))
        unfit += [thing for thing in values.values() if thing not in told]
        return told + (f" with {', '.join(unfit)}" if unfit else "")

    # Beliefs

    def believed(self, belief: Held, stamp: int) -> Clause:
        """Return the clause that something was believed at ``stamp``."""
        condition = self._condition(belief.what)
        persons = self._persons(belief.what)
        seconds = self.facts.history.seconds(stamp)
        value, records = None, [belief.record.id]
        text = self._declared(condition.held, persons) if condition is not None else None
        if text is not None:
            text, value, more = self._measured(text, persons, stamp, belief.agent)
            records += more
        if text is None:
            percept = self._percept(belief.record)
            if percept is None:
                text = self.say("belief", what=belief.what)
            else:
                text = f'my sensor noted "{percept.what}"'
                records = [*records, percept.id]
        if not self.is_single and text == self.say("belief", what=belief.what):
            text = f"{self.subject(belief.agent)} believed {belief.what}"
        return Clause(
            text,
            tuple(records),
            Claim("believed", belief.agent, (belief.what,), seconds, persons=tuple(persons), value=value),
        )

    def lacked(self, name: str, persons: Sequence[str], agent: str, stamp: int) -> Clause | None:
        """Return the clause that a belief was not held at ``stamp``; None if no sentence says so."""
        condition = self._condition(name)
        if condition is None:
            return None
        text = self._declared(condition.lacked, persons)
        if text is None:
            return None
        text, value, records = self._measured(text, persons, stamp, agent)
        if text is None:
            return None
        seconds = self.facts.history.seconds(stamp)
        claim = Claim("not_believed", agent, (name,), seconds, persons=tuple(persons), value=value)
        return Clause(text, tuple(records), claim)

    def _condition(self, what: str) -> Condition | None:
        known = {each.belief: each for each in self.facts.subjects.vocabulary.conditions}
        return known.get(what) or known.get(what.partition("(")[0])

    def has_sentence(self, what: str) -> bool:
        """Return whether a belief that was held has a sentence in the language of the answer."""
        condition = self._condition(what)
        return condition is not None and self.language in condition.held

    def _persons(self, what: str) -> list[str]:
        known = {*self.facts.subjects.persons, "somebody"}
        return [one for one in arguments_of(what) if one in known]

    def _measured(
        self, text: str, persons: Sequence[str], stamp: int, agent: str
    ) -> tuple[str | None, float | None, list[str]]:
        """Fill in for how long other beliefs had been held; None if one of them was not."""
        found = re.search(r"\{([a-z]\w*)\}", text)
        if found is None:
            return text, None, []
        person = persons[0] if persons else ""
        held = next((each for each in self.facts.held(found[1], person, agent) if each.at(stamp)), None)
        if held is None:
            return None, None, []
        seconds = self.facts.history.seconds(stamp) - self.facts.history.seconds(held.begin)
        return text.replace(found[0], self.number(seconds)), round(seconds, 6), [held.record.id]

    def _percept(self, belief: TraceRecord) -> TraceRecord | None:
        """Return what the sensor of a belief noted, in English and in the past; None without a note."""
        percept = self.facts.history.cause(belief)
        if self.language != "en" or percept is None or percept.kind != "percept":
            return None
        return percept

    def heard(self, record: TraceRecord) -> Clause:
        """Return the clause of what a person said."""
        person = str(record.detail.get("person") or "")
        is_you = bool(person) and person == self.you
        named = self.people([person] if person else [])
        text = self.say("heard_you" if is_you else "heard", person=named, what=record.what)
        return self._stated(record, text, Claim("heard", what=(record.what,), persons=(person,) if person else ()))

    def failed(self, failure: TraceRecord) -> Clause:
        """Return the clause of a failure: the goal that failed, and the message of the failure."""
        history = self.facts.history
        goal = next((each for each in history.before(failure) if each.kind in ("goal", "action")), failure)
        message = str(failure.detail.get("message") or "")
        what = infinitive(self._sentence(goal)) if self.language == "en" else goal.what
        text = self.about(failure.source, self.say("failed", what=what, why=f": {message}" if message else ""))
        return self._stated(failure, text, Claim("failed", failure.source, (failure.what, goal.what, message)), goal)

    def ended(self, end: TraceRecord) -> Clause:
        """Return the clause of how a plan ended."""
        outcome, reason = str(end.detail.get("outcome") or ""), str(end.detail.get("reason") or "")
        text = self.say("ended", what=end.what, outcome=outcome, why=f": {reason}" if reason else "")
        return self._stated(end, text, Claim("plan_ended", end.source, (end.what, outcome, reason)))

    def _stated(self, record: TraceRecord, text: str, claim: Claim, *others: TraceRecord) -> Clause:
        """Return the clause of a record, and of others behind it, with its time in the claim and in front."""
        seconds = self.facts.history.seconds(record.stamp)
        ids = tuple(dict.fromkeys(each.id for each in (record, *others)))
        return self.at(Clause(text, ids, msgspec.structs.replace(claim, at_s=seconds)), seconds)

    def took(self, deed: TraceRecord, end: TraceRecord) -> Clause:
        """Return the clause of how long a deed took."""
        value = round((end.stamp - deed.stamp) / SECOND, 6)
        claim = Claim("took", deed.source, at_s=self.facts.history.seconds(deed.stamp), value=value)
        return Clause(self.say("took", value=self.number(value)), (deed.id, end.id), claim)

    def narrated(self, record: TraceRecord, kind: ClaimKind) -> Clause:
        """Return the clause that explanations have for a record."""
        clause = self._narrator.clause(record)
        seconds = self.facts.history.seconds(record.stamp)
        text = clause.sentence()
        if self.is_single and clause.subject and text.startswith(clause.subject):
            text = f"I{text[len(clause.subject) :]}"
        condition = self._condition(record.what) if record.kind == "unbelief" else None
        if condition is not None:
            text = self._declared(condition.ended, self._persons(record.what)) or text
        return Clause(text, (record.id,), Claim(kind, record.source, (record.what,), seconds))


def kind_of_name(name: str) -> str:
    """Return the first word of a name: box_a1 and box_b2 are of one kind."""
    return re.split(r"[_\d]", name)[0]


def _second(topic: Topic | None, language: str) -> str:
    """Return the sentence about others; it tells whether a deed is one to people."""
    pair = topic.declared.did.get(language) if topic is not None and topic.declared is not None else None
    return pair[1] if isinstance(pair, tuple) else ""
