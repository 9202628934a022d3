"""Answers to questions, composed of clauses that records support."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec

from socialbot.core.errors import ParameterError
from socialbot.core.messages import TraceRecord
from socialbot.core.registry import vocabulary_of
from socialbot.runs.asking._causes import contrast, reasons, reasons_against
from socialbot.runs.asking._facts import Presence, near, record_agent
from socialbot.runs.asking._questions import SURE, examples, understand, with_time
from socialbot.runs.asking._scope import NEAR_S, Scope
from socialbot.runs.asking._sentences import Claim, Clause, number
from socialbot.runs.asking._topics import Subjects, Topic, arguments_of
from socialbot.runs.asking.languages import LANGUAGES
from socialbot.runs.narration import plan_of, step_in
from socialbot.runs.run import RunView
from socialbot.runs.why import decided_at

MOST_NAMED = 5
"""Deeds, people or beliefs that an answer names; it counts the others."""
ALL_WORDS = 0.8
"""Least share of the words in question that an utterance has to have to be told as said."""


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
        assumes: What the answer takes for granted, such as who asks; empty for nothing.
        examples: Questions that can be asked instead, if the answer is not known.
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


def answer(
    run: RunView,
    text: str,
    *,
    language: str = "",
    at_s: float | None = None,
    speaker: str = "",
    agent: str = "",
    spoken: bool = False,
) -> Answer:
    """Return the answer of a run to a question about it.

    Args:
        run: A recorded or live run.
        text: The question, as written or recognised.
        language: Its language (ISO 639-1); by default the one that explains it best.
        at_s: Time of the question, in seconds from the start; by default the end of the run.
        speaker: Track id of the person who asks; by default the person whom the deed in question concerned.
        agent: Node of the agent that is addressed; by default any.
        spoken: Tell times as people say them, "9 seconds ago", instead of "at 3.6 s".

    Raises:
        ParameterError: ``agent`` is no agent of the run.
    """
    history = run.history
    if agent and agent not in history.agents:
        remedy = f"give one of {', '.join(history.agents)}" if history.agents else "the run has no agents"
        raise ParameterError(f"there is no agent {agent!r}", remedy=remedy)
    vocabulary = vocabulary_of(run.graph)
    subjects = Subjects(history, run.wording, vocabulary, {})
    question = understand(text, subjects, language)
    if not question.topics or question.kind == "why_not" or question.confidence < SURE:
        # Rules name deeds that were never considered in this run.
        subjects = Subjects(history, run.wording, vocabulary, run.rules)
        question = understand(text, subjects, language)
    end_s = history.seconds(run.end) if len(history) else 0.0
    now_s = end_s if at_s is None else min(max(0.0, at_s), end_s)
    return _Answering(run, subjects, with_time(question, now_s), now_s, speaker, agent, spoken=spoken).answer(text)


class _Answering(Scope):
    """One question being answered."""

    def answer(self, text: str) -> Answer:
        question = self.question
        if not len(self.history):
            return self._unknown(text, self.speech.say("not_recorded"))
        if question.kind is None or question.confidence < SURE:
            return self._unknown(text, self.speech.say("unclear"), understood=False)
        if question.at_s is not None and question.at_s > self.history.duration_s + NEAR_S:
            return self._unknown(text, self.speech.say("not_recorded"))
        if question.event is not None and self.event_s is None:
            return self._unknown(text, self.speech.say("not_recorded"))
        found = self._contrasted(getattr(self, f"_{question.kind}")())
        if found is None:
            return self._unknown(text, self.speech.say("not_recorded"))
        return self._made(text, *found)

    def _made(self, text: str, told: str, clauses: Sequence[Clause]) -> Answer:
        whole = told[:1].upper() + told[1:]
        return Answer(
            text, self.language, self.question.kind or "", True, f"{whole.rstrip('.')}.", tuple(clauses),
            self.question.confidence, self.assumes,
        )  # fmt: skip

    def _unknown(self, text: str, why: str, *, understood: bool = True) -> Answer:
        language = LANGUAGES[self.language]
        told = f"{self.speech.say('unknown')}. {why[:1].upper()}{why[1:]}."
        intent = self.question.kind or "" if understood else ""
        asked = examples(self.subjects, language, self.history.duration_s / 2)
        return Answer(text, self.language, intent, False, told, (), self.question.confidence, "", asked)

    # Why

    def _contrasted(self, found: tuple[str, list[Clause]] | None) -> tuple[str, list[Clause]] | None:
        """Add what was done or left undone for those with whom the question contrasts the deed."""
        other = self.question.contrast
        if other is None or found is None or other.person is None:
            return found
        topics = other.topics or self.question.topics
        if not topics:
            return None
        asked = replace(self.question, topics=topics, person=other.person, contrast=None, kind="why_not")
        told = _Answering(
            self.run, self.subjects, asked, self.now_s, self.speaker, self.agent, spoken=self.spoken
        )._why_not()
        return found if told is None else (f"{found[0]}; {told[0]}", [*found[1], *told[1]])

    def _why(self) -> tuple[str, list[Clause]] | None:
        deed = self._chosen() if self.topic is not None else self._undescribed()
        if deed is None:
            if self.topic is None:
                return None
            return self._left_undone()
        return self._because(deed)

    def _because(self, deed: TraceRecord) -> tuple[str, list[Clause]] | None:
        topic = self.topic or self.subjects.topic_of(deed)
        clauses = [self.speech.did(deed, topic)]
        because = reasons(self.speech, deed)
        if not because:
            return None
        told = f"{clauses[0].text}{self.speech.say('because')} {self._joined(because)}"
        foil = contrast(self.speech, deed, self.subjects)
        if foil is not None:
            told += f"; {foil.text}"
        return told, [*clauses, *because, *([foil] if foil else [])]

    def _undescribed(self) -> TraceRecord | None:
        """Return the deed of a question without a known deed: what was said, or what was done at a time or last."""
        deeds = [each for each in self.subjects.deeds if each.stamp <= self.now and self._is_meant(each)]
        if self.question.says:
            return next(reversed(self.quoted(deeds, self.question.says)), None)
        if self.question.unknown:
            return None
        if self.question.at_s is not None:
            stamp = self.history.stamp(self.question.at_s)
            decided = [each for each in decided_at(self.history, stamp) if self._is_meant(each)]
            return next(iter(decided or near(deeds, stamp, NEAR_S)), None)
        return self._numbered(self._of_persons(deeds))

    def _up_to_now(self) -> list[TraceRecord]:
        """Return the deeds of the agent, people and things in question until now."""
        deeds = [each for each in self.subjects.deeds if each.stamp <= self.now and self._is_meant(each)]
        return self._in_time(self._of_persons(deeds))

    def _why_not(self) -> tuple[str, list[Clause]] | None:
        if self.topic is None and self.question.about_speech:
            # "Why did you say nothing to t3?": the first deed that speaks was left undone.
            spoken = (each for each in self.subjects.deeds if self.subjects.words_said(each))
            self.topic = next((topic for each in spoken if (topic := self.subjects.topic_of(each))), None)
            self.deeds = self.deeds_at_all = [] if self.topic is None else self._up_to_now()
            self.deeds = [each for each in self.deeds if self.subjects.words_said(each)]
        if self.topic is None:
            return None
        deed = self._chosen()
        if deed is not None:
            did = self.speech.did(deed, self.topic)
            return did.text, [did]
        return self._left_undone()

    def _left_undone(self) -> tuple[str, list[Clause]] | None:
        """Return that the deed was not done and why; None if a deed has to do with the same things in another way."""
        things = set(self.question.things)
        done = self.subjects.done(self.topic) if things and self.topic is not None else ()
        for each in done:
            if self.agent in ("", record_agent(self.history, each)) and things <= self._things_behind(each):
                return None
        return self._undone()

    def _things_behind(self, deed: TraceRecord) -> set[str]:
        """Return the things in a deed and in its causes."""
        chain = (deed, *self.history.before(deed))
        return {name for each in chain for name in (*re.findall(r"\w+", each.what), each.source)}

    def _undone(self) -> tuple[str, list[Clause]]:
        topic = self.topic
        assert topic is not None
        span = self._span()
        agent = self._only_agent()
        undone = self.speech.did_not(topic, self.persons, agent, span, list(self.question.things))
        if self.question.at_s is not None:
            undone = self.speech.at(undone, self.question.at_s)
        elif self.question.event is not None or self.question.span_s is not None:
            undone = self.speech.within(undone, *span)
        earlier = [each for each in self._of_persons(self.deeds) if self.history.seconds(each.stamp) < span[0]]
        if earlier:
            done = self.speech.did(earlier[-1], topic)
            return f"{undone.text}{self.speech.say('because')} {done.text}", [undone, done]
        because = reasons_against(self.speech, self.subjects, topic, self.persons, agent, span, self.question.at_s)
        if not because:
            instead = self._instead(topic)
            return "; ".join(each.text for each in (undone, *instead)), [undone, *instead]
        return f"{undone.text}{self.speech.say('because')} {self._joined(because)}", [undone, *because]

    def _instead(self, topic: Topic) -> list[Clause]:
        """Return the last deed of the same kind with one of the things in question."""
        done = [each for each in self.subjects.done(topic) if each.stamp <= self.now]
        for thing in self.question.things:
            found = [each for each in done if thing in arguments_of(each.what)]
            if found:
                return [self.speech.did(found[-1], topic)]
        return []

    # Deeds: when, how often, whether, who

    def _when(self) -> tuple[str, list[Clause]] | None:
        if self.topic is not None:
            deeds = self._of_persons(self.deeds)
            if self.question.at_s is not None:
                deeds = near(deeds, self.history.stamp(self.question.at_s), NEAR_S)
            elif self.question.ordinal is not None:
                deeds = [one for one in [self._numbered(deeds)] if one is not None]
            return self._listed(deeds) if deeds else self._left_undone()
        if self.question.says:
            said = self.quoted(self._up_to_now(), self.question.says)
            return self._listed(said) if said else None
        return self._who()

    def _listed(self, deeds: Sequence[TraceRecord]) -> tuple[str, list[Clause]]:
        clauses = [self.speech.did(each, self.topic) for each in deeds[:MOST_NAMED]]
        if len(deeds) > MOST_NAMED:
            clauses.append(self._number(deeds))
        return self._joined(clauses), clauses

    def _count(self) -> tuple[str, list[Clause]] | None:
        if self.topic is not None:
            deeds = self._of_persons(self.deeds)
            if not deeds:
                return self._left_undone()
            shown = [self.speech.did(each, self.topic) for each in deeds[:MOST_NAMED]]
            counted = self._number(deeds)
            return f"{counted.text}: {self._joined(shown)}", [counted, *shown]
        if self.question.says:
            said = self.quoted(self._up_to_now(), self.question.says, ALL_WORDS)
            if not said:
                return self._did_say()
            counted, shown = self._number(said), [self.speech.did(each, None) for each in said[:MOST_NAMED]]
            return f"{counted.text}: {self._joined(shown)}", [counted, *shown]
        return self._count_people() if self.subjects.persons or self._has_frames() else None

    def _number(self, deeds: Sequence[TraceRecord]) -> Clause:
        text = self.speech.say("times_one") if len(deeds) == 1 else self.speech.say("times", count=len(deeds))
        topic, agent = self.topic, self.agent
        calls = (
            topic.calls
            if topic
            else tuple(dict.fromkeys(one for each in deeds for one in self.subjects.calls_of(each)))
        )
        is_limited = self.question.event is not None or self.question.span_s is not None
        begin_s, end_s = self._span() if is_limited else (0.0, self.now_s)
        claim = Claim(
            "count", agent, calls, begin_s, end_s,
            (*self.persons, *self.question.things), float(len(deeds)),
        )  # fmt: skip
        return Clause(text, tuple(each.id for each in deeds), claim)

    def _did(self) -> tuple[str, list[Clause]] | None:
        if self.topic is None:
            return self._did_say()
        if (
            self.question.about_all
            or self.question.about_left_out
            or (self.question.is_opposite and self.question.person is None)
        ):
            return self._did_for_all()
        deeds = self._of_persons(self.deeds)
        chosen = self._chosen()
        if chosen is not None:
            clause = self.speech.did(chosen, self.topic)
            return f"{self._confirmed(True)}: {clause.text}", [clause]
        other = [each for each in self._of_persons(self.deeds_at_all) if each.stamp <= self.now]
        if not deeds and other and self.question.event is not None:
            # Done, but on the other side of the event.
            clauses = [self.speech.did(other[-1], self.topic)]
            if self.event_deed is not None:
                clauses.append(self.speech.did(self.event_deed, self.subjects.topic_of(self.event_deed)))
            return f"{self._confirmed(False)}: {self._joined(clauses)}", clauses
        if not deeds:
            undone = self._left_undone()
            return None if undone is None else (f"{self._confirmed(False)}: {undone[0]}", undone[1])
        undone = self.speech.did_not(
            self.topic, self.persons, self._only_agent(), self._span(), list(self.question.things)
        )
        if self.question.at_s is not None:
            undone = self.speech.at(undone, self.question.at_s)
        other = self.speech.did(deeds[-1], self.topic)
        return f"{self._confirmed(False)}: {undone.text}; {other.text}", [undone, other]

    def _confirmed(self, is_done: bool) -> str:
        """Return yes or no; for the opposite of a deed, such as "ignore", the other one."""
        return self.speech.say("yes" if is_done is not self.question.is_opposite else "no")

    def _did_say(self) -> tuple[str, list[Clause]] | None:
        if not self.question.says:
            return None
        said = self.quoted(self._up_to_now(), self.question.says, ALL_WORDS)
        if said:
            clause = self.speech.did(said[-1], None)
            return f"{self.speech.say('yes')}: {clause.text}", [clause]
        text = self.speech.about(self.agent, self.speech.say("said_no_words", what=" ".join(self.question.says)))
        claim = Claim("said_not", self.agent, self.question.says, 0.0, self.now_s, tuple(self.persons))
        clause = Clause(text, (), claim)
        return f"{self.speech.say('no')}: {clause.text}", [clause]

    def _did_for_all(self) -> tuple[str, list[Clause]] | None:
        """Return whether a deed was done for everybody: no, with those who were left out, or yes."""
        asks_left_out = self.question.is_opposite or self.question.about_left_out
        left = self._left_out(self._all_people())
        if left:
            told, clauses = self._without(left)
            return f"{self.speech.say('yes' if asks_left_out else 'no')}: {told}", clauses
        if not self.deeds:
            return self._left_undone()
        told, clauses = self._listed(self.deeds)
        return f"{self.speech.say('no' if asks_left_out else 'yes')}: {told}", clauses

    def _without(self, persons: Sequence[str]) -> tuple[str, list[Clause]]:
        """Return for each of some people that the deed was not done, and why."""
        texts, clauses = [], []
        for person in persons[-MOST_NAMED:]:
            self.persons = [person]
            told, some = self._undone()
            texts.append(told)
            clauses += some
        return "; ".join(texts), clauses

    def _who(self) -> tuple[str, list[Clause]] | None:
        if self.topic is not None:
            left = (
                self._left_out(self._all_people()) if self.question.is_negative is not self.question.is_opposite else []
            )
            return self._without(left) if left and self.question.person is None else self._when()
        if not self._has_frames():
            return None
        is_at_event = self.event_s is not None and self.question.kind == "who"
        if self.question.at_s is not None or is_at_event:
            return self._see()
        stays = self._visits()
        clauses = [self._stay(each) for each in stays]
        if not clauses:
            return self._nobody()
        shown = clauses[:MOST_NAMED]
        if len(clauses) > MOST_NAMED or self.question.kind == "count":
            shown.insert(0, self._people_counted())
        return self._joined(shown), shown

    def _visits(self) -> list[Presence]:
        """Return the visits in question, in order of arrival."""
        stays = [each for each in self.facts.visits if each.first.stamp <= self.now]
        if self.persons:
            stays = [each for each in stays if each.person in self.persons]
        if self.question.extreme and stays:
            lengths = [
                round(self.history.seconds(each.last.stamp) - self.history.seconds(each.first.stamp), 1)
                for each in stays
            ]
            wanted = max(lengths) if self.question.extreme == "longest" else min(lengths)
            stays = [each for each, length in zip(stays, lengths, strict=True) if length == wanted]
        return stays

    def _how_long(self) -> tuple[str, list[Clause]] | None:
        """Return when people were here; for a deed also when it was done."""
        if self.topic is None:
            return self._who()
        deed = self._chosen()
        if deed is None:
            return self._left_undone()
        clauses = [self.speech.did(deed, self.topic)]
        concerned = self.facts.concerned(deed)
        clauses += [
            self._stay(each)
            for each in self.facts.visits
            if each.person in concerned and each.first.stamp <= deed.stamp <= each.last.stamp
        ]
        return self._joined(clauses), clauses

    def _count_people(self) -> tuple[str, list[Clause]]:
        if not any(each.first.stamp <= self.now for each in self.facts.visits):
            return self._nobody()
        clause = self._people_counted()
        return clause.text, [clause]

    def _people_counted(self) -> Clause:
        begin_s, end_s = self._span() if self.question.span_s is not None else (0.0, self.now_s)
        begin, end = self.history.stamp(begin_s), self.history.stamp(end_s)
        stays = [each for each in self.facts.visits if each.first.stamp <= end and each.last.stamp >= begin]
        came = {each.person: each for each in reversed(stays)}
        text = self.speech.say("counted_one") if len(came) == 1 else self.speech.say("counted", count=len(came))
        claim = Claim("count_people", at_s=begin_s, until_s=end_s, value=float(len(came)))
        return Clause(text, tuple(each.first.id for each in came.values()), claim)

    def _nobody(self) -> tuple[str, list[Clause]]:
        claim = Claim("nobody_here", at_s=0.0, until_s=self.now_s, persons=tuple(self.persons))
        clause = Clause(self.speech.say("nobody_came"), (), claim)
        return clause.text, [clause]

    def _stay(self, stay: Presence) -> Clause:
        last = stay.last if stay.last.stamp <= self.now else (self.facts.frame(self.now) or stay.last)
        at_s, until_s = self.history.seconds(stay.first.stamp), self.history.seconds(last.stamp)
        is_you = stay.person == self.speech.you
        text = self.speech.say(
            "here_you" if is_you else "here",
            person=self.speech.people([stay.person]),
            at=number(at_s),
            until=number(until_s),
        )
        return Clause(text, (stay.first.id, last.id), Claim("here", at_s=at_s, until_s=until_s, persons=(stay.person,)))

    def _has_frames(self) -> bool:
        return self.facts.frame(self.now) is not None

    # State: what is seen, said, done and intended

    def _moment(self) -> tuple[float, int]:
        told = self.question.at_s if self.question.at_s is not None else self.event_s
        seconds = self.now_s if told is None else told
        return seconds, self.history.stamp(seconds)

    def _see(self) -> tuple[str, list[Clause]] | None:
        _, stamp = self._moment()
        frame = self.facts.frame(stamp)
        if frame is None or (self.agent and not self._sees(self.agent)):
            return self._sensed(stamp)
        if self.persons and self.question.at_s is None and self.event_s is None:
            return self._who()
        seconds = self.history.seconds(frame.stamp)
        people = [each for each in frame.detail.get("persons", ()) if each.get("track_id") or not self.subjects.persons]
        if not people:
            claim = Claim("saw_nobody", at_s=seconds)
            clause = self.speech.at(Clause(self.speech.say("saw_none"), (frame.id,), claim), seconds)
            return clause.text, [clause]
        clauses = []
        for person in people[:MOST_NAMED]:
            name = str(person.get("track_id") or "somebody")
            shown, distance = self.speech.people([name]), person.get("distance_m")
            if distance is not None:
                shown = self.speech.say("away", person=shown, distance=number(distance))
            claim = Claim("saw", at_s=seconds, persons=(name,), value=distance)
            clauses.append(Clause(shown, (frame.id,), claim))
        told = self.speech.say("saw_one", people=self._joined(clauses))
        return self.speech.then(seconds, told), clauses

    def _sees(self, agent: str) -> bool:
        """Return whether the decisions of an agent come from detections."""
        return any(each.source == agent and each.cause.startswith("detection") for each in self.history)

    def _sensed(self, stamp: int) -> tuple[str, list[Clause]] | None:
        """Return the newest beliefs from sensors."""
        held = [
            each
            for each in self.facts.beliefs
            if each.at(stamp) and each.record.detail.get("source") == "percept" and self.agent in ("", each.agent)
        ]
        clauses = [self.speech.believed(each, stamp) for each in held[-3:]]
        return (self._joined(clauses), clauses) if clauses else None

    def _said(self) -> tuple[str, list[Clause]] | None:
        deeds = [each for each in self.subjects.deeds if self.subjects.words_said(each)]
        spoken = [each for each in deeds if each.stamp <= self.now] or deeds
        spoken = self._in_time(self._of_persons(each for each in spoken if self._is_meant(each)))
        at_s = self.question.at_s
        if at_s is not None:
            spoken = near(spoken, self.history.stamp(at_s), NEAR_S)
        elif self.question.ordinal is not None or not self.persons:
            spoken = [one for one in [self._numbered(spoken)] if one is not None]
        if not spoken and self.question.things:
            return None
        if not spoken:
            span = self._span()
            claim = Claim("said_not", self.agent, at_s=span[0], until_s=span[1], persons=tuple(self.persons))
            clause = Clause(self.speech.say("said_nothing"), (), claim)
            return clause.text, [clause]
        clauses = [self.speech.did(each, None) for each in spoken[-MOST_NAMED:]]
        return self._joined(clauses), clauses

    def _doing(self) -> tuple[str, list[Clause]] | None:
        seconds, stamp = self._moment()
        deeds = [each for each in self.subjects.deeds if self._is_meant(each)]
        if self.question.span_s is not None:
            return self._listed_deeds(self._up_to_now()) or self._idle_in(self.question.span_s)
        if self.question.event is not None:
            deeds = self._in_time(each for each in deeds if each.stamp <= self.now)
            place = -1 if self.question.event.relation == "before" else 0
            return self._listed_deeds([deeds[place]]) if deeds else None
        if self.question.ordinal is not None:
            deed = self._numbered(self._up_to_now())
            return None if deed is None else self._listed_deeds([deed])
        if self.question.at_s is None and self.question.is_past:
            return self._listed_deeds(self._of_persons(each for each in deeds if each.stamp <= self.now))
        under_way = [each for each in deeds if each.stamp <= stamp and self._is_under_way(each, stamp)]
        if not under_way and self.question.at_s is not None:
            under_way = [each for each in near(deeds, stamp, 1.0) if each.stamp <= self.now]
        if under_way:
            return self._listed_deeds(under_way)
        before = [each for each in deeds if each.stamp <= stamp]
        text = self.speech.about(self.agent, self.speech.say("nothing_done"))
        nothing = Clause(text, (), Claim("did_not", self._only_agent(), (), seconds, seconds))
        nothing = self.speech.at(nothing, seconds)
        if not before:
            return nothing.text, [nothing]
        last = self.speech.did(before[-1], self.subjects.topic_of(before[-1]), at=False)
        told = self.speech.say("last_was", when=self._when_done(before[-1]), clause=last.text)
        return f"{nothing.text}; {told}", [nothing, last]

    def _idle_in(self, span_s: tuple[float, float]) -> tuple[str, list[Clause]]:
        """Return that nothing was said in a span of time without deeds."""
        begin_s, end_s = span_s[0], min(self.now_s, span_s[1])
        claim = Claim("said_not", self.agent, at_s=begin_s, until_s=end_s, persons=tuple(self.persons))
        clause = self.speech.within(Clause(self.speech.say("said_nothing"), (), claim), begin_s, end_s)
        return clause.text, [clause]

    def _when_done(self, deed: TraceRecord) -> str:
        return self.speech.when(self.history.seconds(deed.stamp))

    def _listed_deeds(self, deeds: Sequence[TraceRecord]) -> tuple[str, list[Clause]] | None:
        shown = deeds[-MOST_NAMED:]
        clauses = [self.speech.did(each, self.subjects.topic_of(each)) for each in shown]
        return (self._joined(clauses), clauses) if clauses else None

    def _is_under_way(self, record: TraceRecord, stamp: int) -> bool:
        """Return whether a step, an action or an utterance that began had not ended at ``stamp``."""
        ends = [each for each in self.history.effects(record) if each.kind in ("step_end", "action_end", "speech")]
        over = [each for each in ends if each.kind != "speech" or each.what not in ("started", "waiting")]
        return bool(over) and min(each.stamp for each in over) > stamp

    def _next(self) -> tuple[str, list[Clause]] | None:
        seconds, stamp = self._moment()
        planned = self._planned(stamp)
        if planned:
            told = self._joined(planned)
            return self.speech.then(seconds, told), planned
        state = self.run.states.at(stamp)
        wanted = [
            Clause(
                self.speech.about(mind.name, self.speech.say("wanted", what=goal.text)),
                (goal.id,),
                Claim("wanted", mind.name, (goal.text,), seconds),
            )
            for mind in state.agents
            if self.agent in ("", mind.name)
            for goal in (*mind.desires, *mind.goals)
            if not self.facts.has_failed(goal.id, stamp)
        ][:MOST_NAMED]
        nothing = self.speech.about(self.agent, self.speech.say("nothing_next"))
        clauses = wanted or [Clause(nothing, (), Claim("nothing_wanted", self._only_agent(), at_s=seconds))]
        told = self.speech.then(seconds, self._joined(clauses))
        later = next((each for each in self.subjects.deeds if each.stamp > stamp and self._is_meant(each)), None)
        if later is None or later.stamp > self.now:
            return told, clauses
        done = self.speech.did(later, self.subjects.topic_of(later), at=False)
        following = self.speech.say("next_was", when=self._when_done(later), clause=done.text)
        return f"{told}; {following}", [*clauses, done]

    def _planned(self, stamp: int) -> list[Clause]:
        """Return the next step of each plan in execution."""
        found = []
        for mind in self.run.states.at(stamp).agents:
            for plan in mind.plans if self.agent in ("", mind.name) else ():
                record = self.history.find(plan.id)
                if record is not None:
                    found += self._step_ahead(record, mind.name, stamp)
        return found[:MOST_NAMED]

    def _step_ahead(self, plan: TraceRecord, agent: str, stamp: int) -> Iterator[Clause]:
        """Yield the first step of a plan that had not begun at ``stamp``."""
        between = self.history.between(plan.stamp, stamp)
        begun = Counter(each.what for each in between if each.kind == "step" and plan_of(self.history, each) is plan)
        for place, line in enumerate(plan.detail.get("steps", ()), 1):
            step = step_in(line)
            if begun[step]:
                begun[step] -= 1
                continue
            action, *arguments = step.strip("()").split()
            sentence = self.subjects.wording.call(action, arguments)
            whose = "my" if self.speech.is_single else f"{self.subjects.wording.name(agent)}'s"
            text = f"step {place} of {whose} plan for {plan.what} was next: {sentence}"
            claim = Claim("planned", agent, (step, plan.what), self.history.seconds(stamp), value=float(place))
            yield Clause(text, (plan.id,), claim)
            return

    def _joined(self, clauses: Sequence[Clause]) -> str:
        texts = [each.text for each in clauses]
        return ", ".join(texts[:-1]) + (f" {self.speech.say('and')} " if texts[1:] else "") + texts[-1] if texts else ""
