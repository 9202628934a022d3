"""What a question is about in a run: its deeds, people, agent and span of time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._facts import Facts, near, record_agent
from socialbot.runs.asking._languages import LANGUAGES
from socialbot.runs.asking._questions import Question
from socialbot.runs.asking._sentences import Speech
from socialbot.runs.asking._topics import Subjects, Topic, arguments_of
from socialbot.runs.run import RunView
from socialbot.runs.why import call_of

NEAR_S = 2.0
"""Tolerance (s) of a time in a question about a deed: people estimate times."""

_SHOWN = re.compile(r"\{(\d)\}")
_PLACE = re.compile(r"(\w+) \{(\d)\}")
"""Argument of a phrase with the word before it: ``from {1}``."""

T = TypeVar("T")


class Scope:
    """Records and people that a question is about. ``assumes`` says who the speaker is taken for."""

    def __init__(
        self,
        run: RunView,
        subjects: Subjects,
        question: Question,
        now_s: float,
        speaker: str,
        agent: str,
        *,
        spoken: bool,
    ) -> None:
        self.run, self.subjects, self.question, self.now_s = run, subjects, question, now_s
        self.history = subjects.history
        self.now = self.history.stamp(now_s)
        self.facts = Facts(subjects, self.now)
        self.agent = question.agent or agent
        self.topic: Topic | None = next(iter(question.topics), None)
        self.assumes = ""
        self.language = self._answer_language()
        self.deeds = self._deeds()
        self.persons = self._persons(speaker)
        me = question.person is not None and question.person.me
        asked_at_s = now_s if spoken else None
        self.speech = self._speech(speaker or (self.persons[0] if me and self.persons else ""), asked_at_s)

    def _answer_language(self) -> str:
        """Return the language of the question, or English if the deed has no sentences in it."""
        code = self.question.language
        deed = self.topic.declared if self.topic is not None else None
        return code if self.topic is None or (deed is not None and code in deed.did) else "en"

    def _speech(self, you: str, asked_at_s: float | None) -> Speech:
        agents = [self.agent] if self.agent else list(self.history.agents)
        return Speech(self.facts, self.language, you, len(agents) == 1 and not self.question.agent, asked_at_s)

    def _deeds(self) -> list[TraceRecord]:
        """Return the records of the deed of the question, of its agent and things: up to now, or else later ones."""
        later: list[TraceRecord] = []
        for topic in self.question.topics:
            found = [each for each in self.subjects.done(topic) if self._is_meant(each)]
            before = [each for each in found if each.stamp <= self.now]
            if before or (found and not later):
                self.topic, later = topic, found
            if before:
                return before
        return later

    def _is_meant(self, record: TraceRecord) -> bool:
        """Return whether a deed is one of the agent and things in question, each in the place that its word names."""
        things, arguments = self.question.things, arguments_of(record.what)
        phrase = self.subjects.wording.phrases.get(call_of(record).partition("(")[0], "")
        shown = [arguments[n] for n in map(int, _SHOWN.findall(phrase)) if n < len(arguments)] if phrase else arguments
        if things and not set(things) <= {*shown, *arguments[:1], record.source}:
            return False
        places = {word: int(n) for word, n in _PLACE.findall(phrase)}
        for thing, before in things.items():
            place = places.get(before)
            if place is not None and arguments[place : place + 1] != (thing,):
                return False
        return not self.agent or record_agent(self.history, record) == self.agent

    def _persons(self, speaker: str) -> list[str]:
        """Return the people whom the question names; none if it names nobody."""
        reference, facts = self.question.person, self.facts
        if not self.subjects.persons:
            return []
        if reference is None:
            left = self._left_out() if self.question.kind == "why_not" and self.question.at_s is None else []
            return left[-1:] if left and self.deeds else []
        if reference.name:
            return [reference.name]
        if reference.ordinal is not None:
            arrivals = [one for one in facts.arrivals if self._came(one)]
            place = reference.ordinal - 1 if reference.ordinal > 0 else reference.ordinal
            return arrivals[place : place + 1 or None][:1] or ["?"]
        if reference.at_s is not None:
            seen = facts.present_at(self.history.stamp(reference.at_s))
            return seen[:1] or ["?"]
        if speaker:
            return [speaker]
        found = self._asker()
        if found:
            self.assumes = LANGUAGES[self.language].sentences["assumes"].format(id=found)
        return [found] if found else []

    def _came(self, person: str) -> bool:
        return any(each.person == person and each.first.stamp <= self.now for each in self.facts.visits)

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
            deeds = [self._numbered(deeds) or deeds[-1]]
        if self.question.kind == "why_not":
            return ([*self._known_people(), *self._left_out()] or [""])[-1]
        for deed in reversed(deeds):
            if found := [one for one in self.facts.concerned(deed) if one != "somebody"]:
                return found[-1]
        return next((each.person for each in reversed(self.facts.visits) if each.first.stamp <= self.now), "")

    def _known_people(self) -> list[str]:
        """Return the people who came until now and whom an agent believed something about, or else all who came."""
        came = [one for one in self.facts.arrivals if self._came(one)]
        return [one for one in came if any(one in arguments_of(each.what) for each in self.facts.beliefs)] or came

    def _left_out(self) -> list[str]:
        """Return the people whom the deed in question never concerned."""
        return [
            one for one in self._known_people() if not any(one in self.facts.concerned(each) for each in self.deeds)
        ]

    def _of_persons(self, records: Iterable[TraceRecord]) -> list[TraceRecord]:
        return [each for each in records if not self.persons or set(self.persons) & {*self.facts.concerned(each)}]

    def _numbered(self, records: Sequence[T]) -> T | None:
        place = self.question.ordinal
        if place is None:
            return records[-1] if records else None
        place = place - 1 if place > 0 else place
        return records[place] if -len(records) <= place < len(records) else None

    def _chosen(self) -> TraceRecord | None:
        """Return the deed that is meant: the one at the time or of the number in the question, or else the last."""
        deeds = self._of_persons(self.deeds)
        if self.question.at_s is not None:
            return next(iter(near(deeds, self.history.stamp(self.question.at_s), NEAR_S)), None)
        return self._numbered(deeds)

    def _only_agent(self) -> str:
        return self.agent or (self.history.agents[0] if len(self.history.agents) == 1 else "")

    def _span(self) -> tuple[float, float]:
        """Return the time (s) in which a deed was left undone."""
        at_s = self.question.at_s
        if at_s is not None:
            return max(0.0, at_s - NEAR_S), min(self.now_s, at_s + NEAR_S)
        stays = [each for each in self.facts.visits if each.person in self.persons and each.first.stamp <= self.now]
        if not stays:
            return 0.0, self.now_s
        return self.history.seconds(stays[0].first.stamp), min(self.now_s, self.history.seconds(stays[-1].last.stamp))
