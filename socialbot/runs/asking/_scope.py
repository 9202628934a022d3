"""What a question is about in a run: its deeds, people, agent and span of time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._facts import Facts, Presence, near, record_agent
from socialbot.runs.asking._question import NEAR_S, Event, Question
from socialbot.runs.asking._sentences import Clause, Speech, kind_of_name
from socialbot.runs.asking._subjects import has_word
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking.languages import LANGUAGES
from socialbot.runs.run import RunView
from socialbot.runs.why import call_of

EVENT_S = 8.0
"""Time (s) after the begin of an event that counts as during it: "when t2 came"."""

_LATER_S = 0.001
"""Time (s) that keeps an event out of a span behind or before it."""

_SHOWN = re.compile(r"\{(\d)\}")
_PLACE = re.compile(r"(\w+) \{(\d)\}")
"""Argument of a phrase with the word before it: ``from {1}``."""

_LIKE = {"for": "to", "towards": "to", "toward": "to"}
"""Words in front of a place with the meaning of another one: ``leave for the deposit``."""

MOST_NAMED = 5
"""Most deeds, people or beliefs that an answer names."""

NOBODY = "?"
"""Person of a question that nobody fits: the ninth visitor of two."""

Told = tuple[str, list[Clause]]
"""Text of an answer and its clauses."""

T = TypeVar("T")


def fitting_words(heard: Sequence[TraceRecord], words: Sequence[str]) -> list[TraceRecord]:
    """Return the utterances of people with the most of ``words``, in any form of them; none if no word fits."""
    counts = [sum(has_word(each.what, word) for word in {*words}) for each in heard]
    most = max([1, *counts])
    return [each for each, count in zip(heard, counts, strict=True) if count == most]


class Scope:
    """Records and people that a question is about. ``assumes`` says who the speaker is taken for."""

    def __init__(
        self,
        run: RunView,
        facts: Facts,
        question: Question,
        now_s: float,
        speaker: str,
        agent: str,
        *,
        spoken: bool,
    ) -> None:
        self.run, self.facts, self.question, self.now_s = run, facts, question, now_s
        self.speaker, self.spoken, self._by_kind = speaker, spoken, False
        self.subjects, self.history = facts.subjects, facts.history
        self.now = self.history.stamp(now_s)
        self.agent = question.agent or agent
        self.topic: Topic | None = next(iter(question.topics), None)
        self.assumes = ""
        self.language = self._answer_language()
        self.event_deed: TraceRecord | None = None
        self.event_persons: Sequence[str] = ()
        self.event_s = self._event_time(question.event)
        self.between: tuple[TraceRecord, ...] = ()
        if question.between is not None:
            self.question = replace(question, span_s=self._span_between(*question.between))
        self.deeds_at_all = self._deeds()
        self.deeds = self.in_time(self.deeds_at_all)
        self.persons = self._persons()
        me = question.person is not None and question.person.me
        asked_at_s = now_s if spoken else None
        self.speech = self._speech(speaker or (self.persons[0] if me and self.persons else ""), asked_at_s)

    def _answer_language(self) -> str:
        """Return the language of the question, or English if the deed has no sentences in it."""
        code = self.question.language
        deed = self.topic.declared if self.topic is not None else None
        is_told = self.topic is None or (deed is not None and code in deed.did)
        return code if is_told or (self.topic is not None and self._only_says(self.topic)) else "en"

    def _only_says(self, topic: Topic) -> bool:
        """Return whether the answer tells words that were said, which each language has a sentence for."""
        question, done = self.question, self.subjects.done(topic)
        is_anywhere = question.at_s is None and question.span_s is None and question.event is None
        is_told = question.kind in ("when", "why", "count") and is_anywhere and not (question.things or question.person)
        return is_told and bool(done) and all(self.subjects.words_said(each) for each in done)

    def _speech(self, you: str, asked_at_s: float | None) -> Speech:
        agents = [self.agent] if self.agent else list(self.history.agents)
        return Speech(self.facts, self.language, you, len(agents) == 1 and not self.question.agent, asked_at_s)

    def _deeds(self) -> list[TraceRecord]:
        """Return the records of the deed of the question, of its agent and things: up to now, or else later ones.

        Of several deeds with the same words, that at the time in question is meant.
        """
        if self.question.by_people:
            return []
        later: list[TraceRecord] = []
        meant = self._meant()
        if self.question.things and not any(found for _, found in meant):
            self._by_kind = True  # "base" is base_b, if nothing was done with a base without letter
            meant = self._meant()
            self._by_kind = any(found for _, found in meant)
        if self.question.at_s is not None:
            at = self.history.stamp(self.question.at_s)
            meant.sort(key=lambda each: min((abs(one.stamp - at) for one in near(each[1], at, NEAR_S)), default=at))
        for topic, found in meant:
            before = self.until_now(found)
            if before or (found and not later):
                self.topic, later = topic, found
            if before:
                return before
        return later

    def _meant(self) -> list[tuple[Topic, list[TraceRecord]]]:
        """Return the topics of the question with their deeds of its agent and things."""
        return [
            (topic, [one for one in self.subjects.done(topic) if self.is_meant(one)]) for topic in self.question.topics
        ]

    def _span_between(self, first: Event, second: Event) -> tuple[float, float] | None:
        """Return the time (s) from the end of one event to the begin of another; None if they did not happen."""
        swapped = replace(second, relation="after", leaves=True), replace(first, relation="before", leaves=False)
        for events in ((first, second), swapped):
            times, deeds, persons = [], [], []
            for event in events:
                self.event_deed = None
                times.append(self._event_time(event, next(iter(times), None)))
                deeds += [self.event_deed] if self.event_deed is not None else []
                persons += self.event_persons
            begin_s, end_s = times
            if begin_s is not None and end_s is not None and begin_s < end_s:
                self.event_deed, self.event_persons, self.between = None, persons, tuple(deeds)
                is_over = all(self.facts.end_of(each) is not None for each in deeds[:1])
                return begin_s + (0.0 if is_over else _LATER_S), end_s - _LATER_S
        return None

    def _event_time(self, event: Event | None, since_s: float | None = None) -> float | None:
        """Return the time (s) of an event; None without one, or if it did not happen.

        Of several deeds it is the one in question, or the first one after ``since_s``.
        """
        if event is None:
            return None
        scope = Scope(self.run, self.facts, event.what, self.now_s, self.speaker, "", spoken=False)
        self.event_persons = scope.persons
        if event.heard is not None:
            fitting = [each for each in scope.heard() if all(has_word(each.what, word) for word in event.heard)]
            return self.history.seconds(fitting[0 if event.relation == "before" else -1].stamp) if fitting else None
        if event.what.says:
            said = self.quoted(self.until_now(self.subjects.deeds), event.what.says)
            self.event_deed = next(reversed(said), None)
            return None if self.event_deed is None else self.history.seconds(self.event_deed.stamp)
        if event.what.topics:
            self.event_deed = scope.chosen()
            if event.relation == "after" and event.what.ordinal is None and event.what.at_s is None:
                self.event_deed = next(reversed(scope.without_leaving(scope.of_persons(scope.deeds))), self.event_deed)
            if since_s is not None and event.what.ordinal is None and event.what.at_s is None:
                later = (each for each in scope.of_persons(scope.deeds) if self.history.seconds(each.stamp) >= since_s)
                self.event_deed = next(later, self.event_deed)
        elif event.what.things or event.what.agent:
            deeds = scope.meant_until_now()
            if not deeds and event.what.agent:  # "after the crate was put on the truck"
                what = replace(event.what, agent="", things={**event.what.things, event.what.agent: ""})
                return self._event_time(replace(event, what=what), since_s)
            if event.relation == "after":
                deeds = scope.without_leaving(deeds) or deeds
            self.event_deed = deeds[-1 if event.relation == "after" else 0] if deeds else None
        if event.what.topics or event.what.things or event.what.agent:
            if self.event_deed is None:
                return None
            end = self.facts.over(self.event_deed) if event.relation == "after" else None
            return self.history.seconds((end or self.event_deed).stamp)
        stays = self.visits()
        if not event.what.about_all:
            stays = [one for one in stays if one.person in scope.persons]
        if not stays:
            return None
        ends = max(one.last.stamp for one in stays)
        return self.history.seconds(ends if event.leaves else stays[0].first.stamp)

    def quoted(self, deeds: Sequence[TraceRecord], words: Sequence[str], least: float = 0.5) -> list[TraceRecord]:
        """Return the utterances with the largest share of ``words``, at least ``least`` of them."""
        if self.question.asks:
            deeds = [each for each in deeds if self.subjects.asks(each)] or deeds
        shares = [self.subjects.share_said(words, each) for each in deeds]
        most = max([least, *shares])
        return [each for each, share in zip(deeds, shares, strict=True) if share >= most]

    def in_time(self, records: Iterable[TraceRecord]) -> list[TraceRecord]:
        """Return the records in the span, or before, after or at the event of the question; all of them without one."""
        event, span_s = self.question.event, self.question.span_s
        if span_s is not None:
            return [each for each in records if span_s[0] <= self.history.seconds(each.stamp) <= span_s[1]]
        if event is None:
            return list(records)
        if self.event_s is None:
            return []
        is_counted = self.question.kind == "count"
        seconds = [
            (self.history.seconds(each.stamp), each)
            for each in records
            if each is not self.event_deed or (is_counted and event.relation == "when")
        ]
        if event.relation == "before":
            return [each for at_s, each in seconds if at_s < self.event_s]
        end_s = self.event_s + EVENT_S if event.relation == "when" else self.now_s
        begin_s = self.span()[0] if is_counted else self.event_s - 0.1
        return [each for at_s, each in seconds if begin_s <= at_s <= end_s]

    def is_meant(self, record: TraceRecord) -> bool:
        """Return whether a deed is one of the agent and things in question, each in the place that its word names."""
        things, arguments = self.question.things, arguments_of(record.what)
        if self._by_kind:
            kinds = {kind_of_name(one): one for one in reversed(arguments)}
            things = {one if one in arguments else kinds.get(one, one): before for one, before in things.items()}
        phrase = self.subjects.wording.phrases.get(call_of(record).partition("(")[0], "")
        shown = [arguments[n] for n in map(int, _SHOWN.findall(phrase)) if n < len(arguments)] if phrase else arguments
        if things and not set(things) <= {*shown, *arguments[:1], record.source}:
            is_act = self.question.is_synonym and any(
                topic.is_saying and topic.covers(call_of(record)) for topic in self.question.topics
            )
            is_told = self.subjects.words_said(record) and (
                is_act or self.question.kind == "said" or {*things.values()} <= {"to"}
            )
            return bool(is_told) and set(things) <= self.things_behind(record)  # words to Bob need not name him
        if self.question.thing_kind and self.question.thing_kind not in map(kind_of_name, arguments):
            return False
        places = {word: int(n) for word, n in _PLACE.findall(phrase)}
        for thing, before in things.items():
            place = places.get(before, places.get(_LIKE.get(before, "")))
            if place is not None and arguments[place : place + 1] != (thing,):
                return False
        agent, kind = record_agent(self.history, record), self.question.agent_kind
        return self.agent in ("", agent) and kind in ("", kind_of_name(agent))

    def without_leaving(self, deeds: Iterable[TraceRecord]) -> list[TraceRecord]:
        """Return deeds without those that leave a place in question: "after the bathroom" begins in front of them."""
        return [each for each in deeds if self.question.things.keys().isdisjoint(self._origins(each))]

    def _origins(self, record: TraceRecord) -> list[str]:
        """Return the places that a deed goes away from: ``moves from {1}``."""
        arguments, name = arguments_of(record.what), call_of(record).partition("(")[0]
        places = _PLACE.findall(self.subjects.wording.phrases.get(name, ""))
        return [arguments[int(n)] for word, n in places if word == "from" and int(n) < len(arguments)]

    def things_behind(self, deed: TraceRecord) -> set[str]:
        """Return the things in a deed, in its causes and, if it is a goal, in what was done for it."""
        chain = [deed, *self.history.before(deed)]
        if deed.kind in ("goal", "desire"):
            chain += self._done_for(deed)
        return {name for each in chain for name in (*re.findall(r"\w+", each.what), each.source)}

    def _done_for(self, goal: TraceRecord) -> list[TraceRecord]:
        """Return the effects of a goal, their effects, and so on."""
        found = self.history.effects(goal)
        for each in found:
            found += self.history.effects(each)
        return found

    def _persons(self) -> list[str]:
        """Return the people whom the question names; none if it names nobody."""
        reference, facts = self.question.person, self.facts
        if not self.subjects.persons:
            return []
        if reference is None:
            if self.question.kind != "why_not":
                return []
            at_s = self.question.at_s
            left = self._left_out(None if at_s is None else self.facts.present_at(self.history.stamp(at_s)))
            return left[-1:] if left and self.deeds else []
        if reference.names:
            return list(reference.names)
        if reference.together:
            return self._together()
        if reference.ordinal is not None:
            arrivals = [one for one in (facts.departures if reference.leaves else facts.arrivals) if self._came(one)]
            place = reference.ordinal - 1 if reference.ordinal > 0 else reference.ordinal
            return arrivals[place : place + 1 or None][:1] or [NOBODY]
        if reference.at_s is not None:
            seen = facts.present_at(self.history.stamp(reference.at_s))
            return seen[:1] or [NOBODY]
        if self.speaker:
            return [self.speaker]
        found = self._asker()
        if found:
            self.assumes = LANGUAGES[self.language].sentences["assumes"].format(id=found)
        return [found] if found else []

    def _together(self) -> list[str]:
        """Return the newest people who were here at the same time."""
        visits = self.visits()
        for newest in reversed(visits):
            same = [
                each.person
                for each in visits
                if each.first.stamp <= newest.last.stamp and newest.first.stamp <= each.last.stamp
            ]
            if len({*same}) > 1:
                return list(dict.fromkeys(same))
        return [NOBODY]

    def _came(self, person: str) -> bool:
        return any(each.person == person for each in self.visits())

    def _asker(self) -> str:
        """Return the most likely speaker: somebody in view at the time in question, or whom the last deed concerned."""
        at_s = self.question.at_s
        if at_s is not None:
            seen = self.facts.present_at(self.history.stamp(at_s))
            concerned = [
                one for each in near(self.deeds, self.history.stamp(at_s), NEAR_S) for one in self.facts.concerned(each)
            ]
            return next(iter([*concerned, *seen]), "")
        deeds = self.deeds
        if self.question.ordinal is not None and deeds:
            deeds = [self.numbered(deeds) or deeds[-1]]
        if self.question.kind == "why_not":
            return ([*self._known_people(), *self._left_out()] or [""])[-1]
        for deed in reversed(deeds):
            if found := [one for one in self.facts.concerned(deed) if one != "somebody"]:
                return found[-1]
        return next((each.person for each in reversed(self.visits())), "")

    def _all_people(self) -> list[str]:
        return [one for one in self.facts.arrivals if self._came(one)]

    def _known_people(self) -> list[str]:
        """Return the people who came until now and whom an agent believed something about, or else all who came."""
        came = self._all_people()
        return [one for one in came if any(one in arguments_of(each.what) for each in self.facts.beliefs)] or came

    def _left_out(self, people: Sequence[str] | None = None) -> list[str]:
        """Return the people whom the deed in question never concerned."""
        if self.topic is not None and not self.topic.concerns_people:
            return []
        people = self._known_people() if people is None else people
        return [one for one in people if not any(one in self.facts.concerned(each) for each in self.deeds)]

    def of_persons(self, records: Iterable[TraceRecord]) -> list[TraceRecord]:
        reference, asked = self.question.person, set(self.persons)
        if reference is not None and reference.together:
            return [each for each in records if asked <= {*self.facts.concerned(each)}]
        return [each for each in records if not asked or asked & {*self.facts.concerned(each)}]

    def until_now(self, records: Iterable[TraceRecord]) -> list[TraceRecord]:
        """Return the records up to the time of the question."""
        return [each for each in records if each.stamp <= self.now]

    def heard(self) -> list[TraceRecord]:
        """Return what the people in question said until now."""
        said = self.until_now(self.subjects.heard)
        return [each for each in said if not self.persons or each.detail.get("person") in self.persons]

    def visits(self) -> list[Presence]:
        """Return the visits that began until now."""
        return [each for each in self.facts.visits if each.first.stamp <= self.now]

    def numbered(self, records: Sequence[T]) -> T | None:
        place = self.question.ordinal
        if place is None:
            return records[-1] if records else None
        place = place - 1 if place > 0 else place
        return records[place] if -len(records) <= place < len(records) else None

    def one_of(self, records: Sequence[T]) -> list[T]:
        """Return only the record of the number in the question, or else the last one; none if there are not so many."""
        chosen = self.numbered(records)
        return [] if chosen is None else [chosen]

    def chosen(self) -> TraceRecord | None:
        """Return the deed that is meant: the one at the time or of the number in the question, or else the last."""
        deeds = self.of_persons(self.deeds)
        if self.question.at_s is not None:
            at = self.history.stamp(self.question.at_s)
            return next(iter(near(deeds, at, NEAR_S)), None) or self._lasting(deeds, at)
        event = self.question.event
        if event is not None and event.relation != "before" and self.question.ordinal is None:
            return deeds[0] if deeds else None
        return self.numbered(deeds)

    def _lasting(self, deeds: Sequence[TraceRecord], stamp: int) -> TraceRecord | None:
        """Return a deed that was still the last one at a time: to stay idle lasts until something else is done."""
        if self.topic is None or self.topic.names_people or self.topic.is_saying:
            return None
        last = next((each for each in reversed(deeds) if each.stamp <= stamp), None)
        if last is None:
            return None
        agent = record_agent(self.history, last)
        later = (each for each in self.subjects.deeds if last.stamp < each.stamp <= stamp)
        return None if any(record_agent(self.history, each) == agent for each in later) else last

    def moment(self) -> tuple[float, int]:
        """Return the time that a state is asked for, in seconds and as a stamp: by default that of the question."""
        told = self.question.at_s if self.question.at_s is not None else self.event_s
        seconds = self.now_s if told is None else told
        return seconds, self.history.stamp(seconds)

    def only_agent(self) -> str:
        return self.agent or (self.history.agents[0] if len(self.history.agents) == 1 else "")

    def span(self) -> tuple[float, float]:
        """Return the time (s) in which a deed was left undone."""
        at_s = self.question.at_s
        if at_s is not None:
            return max(0.0, at_s - NEAR_S), min(self.now_s, at_s + NEAR_S)
        if self.question.span_s is not None:
            return self.question.span_s[0], min(self.now_s, self.question.span_s[1])
        if self.question.event is not None and self.event_s is not None:
            relation = self.question.event.relation
            begin_s = 0.0 if relation == "before" else max(0.0, self.event_s - 0.1)
            if relation == "after" and self.question.kind == "count":
                begin_s = self.event_s + _LATER_S  # the event itself does not count
            end_s = self.event_s + EVENT_S if relation == "when" else self.now_s
            return begin_s, min(max(0.0, self.event_s - 0.1) if relation == "before" else end_s, self.now_s)
        stays = [each for each in self.visits() if each.person in self.persons]
        if not stays:
            return 0.0, self.now_s
        return self.history.seconds(stays[0].first.stamp), min(self.now_s, self.history.seconds(stays[-1].last.stamp))

    def up_to_now(self) -> list[TraceRecord]:
        """Return the deeds of the agent, people and things in question until now."""
        return self.in_time(self.of_persons(self.meant_until_now()))

    def meant_until_now(self) -> list[TraceRecord]:
        """Return the deeds of the agent and things in question until now."""
        return [each for each in self.until_now(self.subjects.deeds) if self.is_meant(each)]

    def joined(self, clauses: Sequence[Clause]) -> str:
        texts = [each.text for each in clauses]
        return ", ".join(texts[:-1]) + (f" {self.speech.say('and')} " if texts[1:] else "") + texts[-1] if texts else ""

    def told(self, clauses: list[Clause]) -> Told | None:
        """Return an answer of clauses; None without any."""
        return (self.joined(clauses), clauses) if clauses else None

    def told_deeds(self, deeds: Sequence[TraceRecord]) -> Told | None:
        """Return an answer with deeds of any kind; None without any."""
        return self.told([self.speech.did(each, self.subjects.topic_of(each)) for each in deeds])
