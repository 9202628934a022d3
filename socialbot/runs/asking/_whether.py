"""Whether, when and how often deeds were done, and what was left undone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import msgspec

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._causes import plans_of, reasons_against
from socialbot.runs.asking._facts import record_agent
from socialbot.runs.asking._people import count_people, has_frames
from socialbot.runs.asking._question import Question
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told
from socialbot.runs.asking._sentences import Claim, Clause, kind_of_name
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking.languages import LANGUAGES

ALL_WORDS = 0.8
"""Least share of the words in question that an utterance has to have to be told as said."""

SOME_WORDS = 0.3
"""Share of the words in question from which on an utterance may have asked for the same thing."""

Decided = tuple[bool | None, str, list[Clause]]
"""Whether a deed was done, the text that tells it, and its clauses; None if they do not decide the question."""


T = TypeVar("T", bound="Whether")


class Whether(Scope):
    """Question about what was done or left undone."""

    def _count(self) -> Told | None:
        if self.topic is not None:
            is_negative = self.question.is_negative is not self.question.is_opposite
            if is_negative and not self.question.quantity and self.question.person is None:
                left = self._left_out(self._all_people())  # "How many people did you not help?"
                return self._without(left) if left else None
            deeds = self.of_persons(self.deeds)
            if not deeds:
                return self._left_undone()
            counted = self._number(deeds)
            if self.question.counts_people and self.question.person is None and self.topic.names_people:
                counted = self._number_of_people(deeds, counted)
            return self._told_with(counted, deeds)
        if self.question.says:
            said = self.quoted(self.up_to_now(), self.question.says, ALL_WORDS)
            if not said:
                return self._did_say()
            return self._told_with(self._number(said), said)
        if self.question.about_speech and not self.question.is_negative:
            said = [each for each in self.up_to_now() if self.subjects.words_said(each)]
            return (self._number(said).text, [self._number(said)]) if said else None
        return count_people(self) if self.subjects.persons or has_frames(self) else None

    def _told_with(self, counted: Clause, deeds: Sequence[TraceRecord]) -> Told:
        """Return a count with the first deeds."""
        shown = [self.speech.did(each, self.topic) for each in deeds[:MOST_NAMED]]
        return f"{counted.text}: {self.joined(shown)}", [counted, *shown]

    def _listed(self, deeds: Sequence[TraceRecord]) -> Told:
        clauses = [self.speech.did(each, self.topic) for each in deeds[:MOST_NAMED]]
        if len(deeds) > MOST_NAMED:
            clauses.append(self._number(deeds))
        return self.joined(clauses), clauses

    def _number(self, deeds: Sequence[TraceRecord]) -> Clause:
        text = self.speech.say("times_one") if len(deeds) == 1 else self.speech.say("times", count=len(deeds))
        topic, agent = self.topic, self.agent
        calls = (
            self._calls_with_things(topic, deeds)
            if topic
            else tuple(dict.fromkeys(one for each in deeds for one in self.subjects.calls_of(each)))
        )
        is_limited = self.question.event is not None or self.question.span_s is not None
        begin_s, end_s = self.span() if is_limited else (0.0, self.now_s)
        claim = Claim(
            "count", agent, calls, begin_s, end_s,
            (*self.persons, *self.question.things), float(len(deeds)),
        )  # fmt: skip
        return Clause(text, tuple(each.id for each in deeds), claim)

    def _number_of_people(self, deeds: Sequence[TraceRecord], counted: Clause) -> Clause:
        """Return how many people the deeds were done to."""
        count = len({one for each in deeds for one in self.facts.concerned(each)})
        text = self.speech.say("people_one") if count == 1 else self.speech.say("people", count=count)
        claim = msgspec.structs.replace(counted.claim, kind="count_people", value=float(count))
        return Clause(text, counted.records, claim)

    def _calls_with_things(self, topic: Topic, deeds: Sequence[TraceRecord]) -> tuple[str, ...]:
        """Return the calls of a deed, with the things in question in their places: ``pickup(*, box_c2)``.

        ``pickup(gripper_a, box_a2, box_c2)`` names box_c2, too, but picks up box_a2.
        """
        things = self.question.things
        arguments = [arguments_of(each.what) for each in deeds]
        if (
            not things
            or any("(" in call for call in topic.calls)
            or not all(set(things) <= {*one} for one in arguments)
        ):
            return topic.calls
        ends = [max(one.index(thing) for thing in things) + 1 for one in arguments]
        known = (
            [one if one in things else "*" for one in each[:end]] for each, end in zip(arguments, ends, strict=True)
        )
        shown = dict.fromkeys(", ".join(each) for each in known)
        return tuple(f"{call}({each})" for call in topic.calls for each in shown)

    def _did(self) -> Told | None:
        """Return whether a deed was done, with yes or no only if the records decide it.

        Neither answers a negative question, "Did you never greet t1?", or an open one without ambiguity.
        """
        if self.topic is None:
            return self._did_say()
        asks_all = self.question.about_all or (self.question.is_opposite and self.question.person is None)
        if not self.question.quantity and not self._parts() and (asks_all or self.question.about_left_out):
            return self._did_for_all()
        found = self._decided()
        if found is None:
            return None
        is_done, told, clauses = found
        if is_done is None or self.question.is_negative or self.question.is_open:
            return told, clauses
        return f"{self.speech.say('yes' if is_done is not self.question.is_opposite else 'no')}: {told}", clauses

    def _decided(self) -> Decided | None:
        question, parts = self.question, self._parts()
        if parts and question.ordinal is not None:
            told = self._compared(parts)
            return (None, *told) if told else self._decided_for_each([replace(each, ordinal=None) for each in parts])
        if parts:
            return self._decided_for_each(parts)
        if question.quantity == "others" and self.deeds:  # To have greeted t1 is no "yes" to "anybody else".
            every = self._beside(replace(question, kind="count", person=None, ordinal=None))
            return None, *every._listed(every.deeds)
        deeds = self.of_persons(self.deeds)
        is_ordered = question.ordinal is not None and question.event is None
        if question.at_s is None and (question.quantity or is_ordered) and deeds:
            return self._counted_or_ordered(deeds)
        chosen = self.chosen()
        if chosen is not None:
            clauses = [self.speech.did(chosen, self.topic)]
            if self.event_deed is not None and question.event is not None and question.event.relation != "when":
                clauses.append(self.speech.did(self.event_deed, self.subjects.topic_of(self.event_deed)))
            return None if question.quantity else True, self.joined(clauses), clauses
        other = self.until_now(self.of_persons(self.deeds_at_all))
        if not deeds and other and question.event is not None:
            # Done, but on the other side of the event.
            clauses = [self.speech.did(other[-1], self.topic)]
            if self.event_deed is not None:
                clauses.append(self.speech.did(self.event_deed, self.subjects.topic_of(self.event_deed)))
            return False, self.joined(clauses), clauses
        if not deeds:
            undone = self._left_undone()
            return None if undone is None else (None if question.quantity else False, *undone)
        assert self.topic is not None
        undone = self.speech.did_not(self.topic, self.persons, self.only_agent(), self.span(), list(question.things))
        if question.at_s is not None:
            undone = self.speech.at(undone, question.at_s)
        done = self.speech.did(deeds[-1], self.topic)
        return False, f"{undone.text}; {done.text}", [undone, done]

    def _parts(self) -> list[Question]:
        """Return the question about each of several people or things that it names; none for a single one."""
        question = self.question
        person, things = question.person, question.things
        if person is not None and len(person.names) > 1:
            return [replace(question, person=replace(person, names=(name,))) for name in person.names]
        language = LANGUAGES[question.language]
        links = {language.sentences["and"], *language.first_words("or")}
        joined = [name for name, before in things.items() if before in links]
        if not joined or self.deeds_at_all:
            return []
        others = [name for name in things if name not in joined]
        if question.agent and all(name in self.subjects.agents for name in joined):
            kept = {name: things[name] for name in others}  # "Did carrier a and carrier b leave?"
            return [replace(question, agent=name, things=kept) for name in (question.agent, *joined)]
        kinds = {kind_of_name(name) for name in joined}
        first = [name for name in others if kind_of_name(name) in kinds] or others[:1]
        kept = {name: things[name] for name in others if name not in first}
        return [replace(question, things={**kept, name: ""}) for name in (*first, *joined)]

    def _decided_for_each(self, parts: Sequence[Question]) -> Decided | None:
        """Return whether a deed was done to each of several people or things; undecided if only to some."""
        found = [self._beside(part)._decided() for part in parts]
        known = [each for each in found if each is not None]
        if len(known) < len(found):
            return None
        done = {is_done for is_done, _, _ in known}
        told = "; ".join(text for _, text, _ in known)
        return done.pop() if len(done) == 1 else None, told, [clause for _, _, some in known for clause in some]

    def _compared(self, parts: Sequence[Question]) -> Told | None:
        """Return the deed to each of several people or things, in order of time; None if it was not done to each."""
        place = -1 if self.question.ordinal == -1 else 0
        scopes = [self._beside(replace(part, ordinal=None)) for part in parts]
        done = [deeds[place] for each in scopes if (deeds := each.of_persons(each.deeds))]
        if len(done) < len(parts):
            return None
        return self._listed(sorted(done, key=lambda each: each.stamp))

    def _beside(self: T, question: Question) -> T:
        """Return another question about the same run."""
        return type(self)(self.run, self.facts, question, self.now_s, self.speaker, self.agent, spoken=self.spoken)

    def _counted_or_ordered(self, deeds: Sequence[TraceRecord]) -> Decided | None:
        """Return how often a deed was done, or whether it was the first or last one."""
        question = self.question
        if question.quantity:  # To have done it once is no "yes" to "twice".
            told = self._beside(replace(question, kind="count", ordinal=None))._count()
            return None if told is None else (None, *told)
        if question.person is not None or question.things or question.agent:
            return self._ordered(deeds)
        chosen = self.chosen()
        told = self._listed(deeds if chosen is None else [chosen])
        return None if chosen is None else True, *told

    def _ordered(self, deeds: Sequence[TraceRecord]) -> Decided:
        """Return whether the first or last of all such deeds was that to the person or thing in question."""
        is_agent = self.question.person is None and not self.question.things
        done = self.until_now(self.subjects.done(self.topic)) if self.topic else []
        every = [one for one in done if is_agent or self.agent in ("", record_agent(self.history, one))]
        if is_agent:  # "Did carrier a leave last?" is about carriers.
            kind = kind_of_name(self.agent)
            every = [each for each in every if kind_of_name(record_agent(self.history, each)) == kind]
        first = self.numbered(every)
        clauses = [] if first is None else [self.speech.did(first, self.topic)]
        if first in deeds:
            return True, self.joined(clauses), clauses
        clauses.append(self.speech.did(deeds[-1], self.topic))
        return False, self.joined(clauses), clauses

    def _did_say(self) -> Told | None:
        if not self.question.says:
            return None
        said = self.quoted(self.up_to_now(), self.question.says, ALL_WORDS)
        if said and self.question.quantity:
            return self._beside(replace(self.question, kind="count"))._count()
        if said:
            clause = self.speech.did(said[-1], None)
            return clause.text if self.question.is_negative else f"{self.speech.say('yes')}: {clause.text}", [clause]
        if self.question.asks and self.quoted(self.up_to_now(), self.question.says, SOME_WORDS):
            return None  # "Did you ask to see a badge?": in other words, perhaps
        text = self.speech.about(self.agent, self.speech.say("said_no_words", what=" ".join(self.question.says)))
        claim = Claim("said_not", self.agent, self.question.says, 0.0, self.now_s, tuple(self.persons))
        clause = Clause(text, (), claim)
        is_open = self.question.is_negative or self.question.quantity
        return clause.text if is_open else f"{self.speech.say('no')}: {clause.text}", [clause]

    def _did_for_all(self) -> Told | None:
        """Return whether a deed was done for everybody: no, with those who were left out, or yes."""
        asks_left_out = self.question.is_opposite or self.question.about_left_out
        left = self._left_out(self._all_people())
        if left:
            told, clauses = self._without(left)
            return f"{self.speech.say('yes' if asks_left_out else 'no')}: {told}", clauses
        if not self.deeds:
            return self._left_undone()
        told, clauses = self._listed(self.deeds)
        if not self.subjects.persons:  # No record tells which other things there are.
            return told, clauses
        return f"{self.speech.say('no' if asks_left_out else 'yes')}: {told}", clauses

    def _without(self, persons: Sequence[str]) -> Told:
        """Return for each of some people that the deed was not done, and why."""
        texts, clauses = [], []
        for person in persons[-MOST_NAMED:]:
            self.persons = [person]
            told, some = self._undone()
            texts.append(told)
            clauses += some
        return "; ".join(texts), clauses

    def _without_any(self) -> Told | None:
        """Return the people for whom no deed was done, with what was not done for them; None without such people."""
        done = self.meant_until_now()
        named = [(each, topic) for each in done if (topic := self.subjects.topic_of(each)) and topic.names_people]
        topics = {topic.name: topic for _, topic in named}
        concerned = {one for each, _ in named for one in self.facts.concerned(each)}
        left = [one for one in self._all_people() if one not in concerned] if topics else []
        if not left:
            return None
        told: list[Told] = []
        for topic in topics.values():
            self.topic, self.deeds = topic, self.subjects.done(topic)
            told.append(self._without(left))
        return "; ".join(text for text, _ in told), [clause for _, clauses in told for clause in clauses]

    def _left_undone(self) -> Told | None:
        """Return that the deed was not done and why; None if the words may mean another deed.

        They may if the deed was done to the same things in another way, if it is done to other kinds of things only,
        and if they are synonyms and only other agents do it: a carrier that "drops off" does not put boxes down.
        """
        things = set(self.question.things)
        if self.question.ordinal is not None and self.of_persons(self.deeds):
            return None  # It was done, but not so often.
        done = self.subjects.done(self.topic) if self.topic is not None else []
        by_agent = [each for each in done if self.agent in ("", record_agent(self.history, each))]
        tried = [each.id for each in self.in_time(by_agent) if things and things <= self.things_behind(each)]
        if tried:
            begin_s, end_s = self.span()
            timely = [each for each in self.facts.failures if begin_s <= self.history.seconds(each.stamp) <= end_s]
            failures = [each for each in timely if any(one.id in tried for one in self.history.before(each))]
            return self.told([self.speech.failed(each) for each in failures if things <= self.things_behind(each)])
        if done and not by_agent and self.question.is_synonym:
            return None
        kinds = {kind_of_name(one) for each in done for one in (*arguments_of(each.what), each.source)}
        if done and not kinds.issuperset(kind for one in things if (kind := kind_of_name(one)) != one):
            return None
        if self.question.thing_kind and by_agent:
            return None  # It was done, perhaps to things of another kind.
        return self._undone()

    def _undone(self) -> Told:
        topic = self.topic
        assert topic is not None
        span = self.span()
        agent = self.only_agent()
        undone = self.speech.did_not(topic, self.persons, agent, span, list(self.question.things))
        if self.question.at_s is not None:
            undone = self.speech.at(undone, self.question.at_s)
        elif self.question.event is not None or self.question.span_s is not None:
            undone = self.speech.within(undone, *span)
        earlier = [each for each in self.of_persons(self.deeds) if self.history.seconds(each.stamp) < span[0]]
        if earlier:
            done = self.speech.did(earlier[-1], topic)
            return self.speech.say("because", clause=undone.text, reason=done.text), [undone, done]
        because = self._prevented(topic, span) or reasons_against(
            self.speech, topic, self.persons, agent, span, self.question.at_s
        )
        if not because:
            instead = self._instead(topic)
            return "; ".join(each.text for each in (undone, *instead)), [undone, *instead]
        told = self.speech.say("because", clause=undone.text, reason=self.joined(because))
        return told, [undone, *because]

    def _prevented(self, topic: Topic, span: tuple[float, float]) -> list[Clause]:
        """Return the last failure of a plan that would have done the deed to the people and things in question."""
        rules, things = {*plans_of(self.subjects, topic)}, {*self.question.things}
        for failure in reversed(self.facts.failures):
            chain = list(self.history.before(failure))
            is_meant = span[0] <= self.history.seconds(failure.stamp) <= span[1] and self.agent in ("", failure.source)
            is_meant = is_meant and things <= self.things_behind(failure)
            concerned = {one for each in (failure, *chain) for one in self.facts.concerned(each)}
            is_meant = is_meant and concerned.issuperset(self.persons)
            if is_meant and any(each.kind == "plan" and each.detail.get("rule") in rules for each in chain):
                return [self.speech.failed(failure)]
        return []

    def _instead(self, topic: Topic) -> list[Clause]:
        """Return the last deed of the same kind with one of the things in question."""
        done = self.until_now(self.subjects.done(topic))
        for thing in self.question.things:
            found = [each for each in done if thing in arguments_of(each.what)]
            if found:
                return [self.speech.did(found[-1], topic)]
        return []
