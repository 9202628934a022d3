"""What a question asks, as it was understood: its kind, deed, persons, things and time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Literal

from socialbot.runs.asking._clauses import Relation
from socialbot.runs.asking._references import Limit, PersonReference, Quantity
from socialbot.runs.asking._topics import Topic

Kind = Literal[
    "why", "why_not", "see", "next", "doing", "said", "who", "when", "how_long", "count", "did", "heard", "failed",
    "believed", "ended", "where", "steps", "replanned",
]  # fmt: skip
NEAR_S = 2.0
"""Tolerance (s) of a time in a question about a deed: people estimate times."""


@dataclass(frozen=True)
class Question:
    """Question as it was understood.

    Args:
        kind: What is asked; None if it was not understood.
        language: Its language (ISO 639-1).
        topics: The deed it is about; none for another question.
        person: The person it is about.
        agent: The agent that acted; empty for any.
        agent_kind: Kind of the agents that acted, of ``which carrier``; empty for any.
        things: Names in it, such as box_a1, with the word before each, such as "to".
        at_s: Time in it, in seconds from the start; ``ago`` tells that it counts back from now.
        is_later: Whether it asks for records after the time, as in ``after 50 s``.
        span_s: Span of time in it; with a negative begin it ends at the time of the question.
        ordinal: Which time a deed was done: 1 for the first, -1 for the last.
        is_past: Whether it asks about the past.
        says: Words that were said, in a question about an utterance.
        is_opposite: Whether it names the opposite of the deed: ``ignore`` for not to greet.
        is_negative: Whether it has a negation.
        about_all: Whether it is about all people.
        extreme: Whether it asks for the longest or the shortest visit, or the nearest or the farthest person.
        is_compared: Whether it asks for no one of several people: ``Did t3 stay longer than t5?``.
        limit: Least or most duration (s) or distance (m) of the visits in question.
        is_shared: Whether it asks who was here at the same time as the people in it.
        leaves: Whether it asks about people who leave.
        about_left_out: Whether it asks for people for whom the deed was not done.
        about_speech: Whether it is about speaking in general.
        asks: Whether it is about asking somebody.
        contrast: Question about those with whom the deed is contrasted: ``and not t2``.
        event: Question about the event that tells the time: ``after t2 had left``.
        between: Two events that the time is between: ``between the bathroom and the kitchen``.
        unknown: Its words that nothing explains.
        verb: Its verb, if nothing explains it.
        is_open: Whether a deed does not decide it: it offers alternatives, ``before or after``, or asks for more than
            records tell, such as ``together``, ``too late`` or ``because``.
        quantity: Whether it asks how many ``times`` a deed was done (twice, again), or to which ``others`` (else).
        is_synonym: Whether it names the deed by a synonym that the agent does not declare.
        reported: Class of the interrogative of an indirect question, ``whether`` without one, if it is what somebody
            asked: ``Did t1 ask why you left?``; ``says`` has its words.
        thing_kind: Kind of the things that the deed is done to, of ``which box``; empty for any.
        plan: Goal or desire of a plan, if the words have its whole name.
        belief: Name of the belief that it asks for.
        asks_when: Whether it asks since when something was believed.
        by_people: Whether people do the deed, and not the robot: ``Did t1 greet you?``.
        counts_people: Whether it asks to how many people the deed was done.
    """

    kind: Kind | None
    language: str
    topics: tuple[Topic, ...] = ()
    person: PersonReference | None = None
    agent: str = ""
    agent_kind: str = ""
    things: Mapping[str, str] = field(default_factory=dict)
    at_s: float | None = None
    ago: bool = False
    is_later: bool = False
    span_s: tuple[float, float] | None = None
    ordinal: int | None = None
    is_past: bool = False
    says: tuple[str, ...] = ()
    is_opposite: bool = False
    is_negative: bool = False
    about_all: bool = False
    extreme: Literal["longest", "shortest", "nearest", "farthest", ""] = ""
    is_compared: bool = False
    limit: Limit | None = None
    is_shared: bool = False
    leaves: bool = False
    about_left_out: bool = False
    about_speech: bool = False
    asks: bool = False
    contrast: Question | None = None
    event: Event | None = None
    between: tuple[Event, Event] | None = None
    unknown: tuple[str, ...] = ()
    verb: str = ""
    is_open: bool = False
    quantity: Quantity = ""
    is_synonym: bool = False
    reported: str = ""
    thing_kind: str = ""
    plan: str = ""
    belief: str = ""
    asks_when: bool = False
    by_people: bool = False
    counts_people: bool = False

    @property
    def names(self) -> Set[str]:
        """Names of things and agents in it."""
        return {*self.things, self.agent} - {""}

    @property
    def has_unknown_name(self) -> bool:
        """Whether it names something that the run does not have, such as t9 or room 7."""
        return any(letter.isdigit() for word in self.unknown for letter in word)


@dataclass(frozen=True)
class Event:
    """Event that tells a time: a person comes or ``leaves``, or a deed of the robot.

    Args:
        relation: Whether the time is after it, before it, or that of the event.
        what: The people and the deed, as a question.
        leaves: Whether the person leaves.
        heard: Words that the person said: ``when I asked about the library``; None for another event.
        is_near: Whether only what is next to the event is in question: ``right after``.
    """

    relation: Relation
    what: Question
    leaves: bool
    heard: tuple[str, ...] | None = None
    is_near: bool = False


def with_time(question: Question, now_s: float) -> Question:
    """Return a question with a time that counts back as a time of the run; it is negative before the run.

    Whether or how often something was done after a time is asked for all of the time after it.
    """
    if question.is_later and question.at_s is not None and question.kind in ("count", "did", "who"):
        return replace(question, at_s=None, span_s=(question.at_s, math.inf))
    if question.span_s is not None and question.span_s[0] < 0.0:
        question = replace(question, span_s=(max(0.0, now_s + question.span_s[0]), now_s))
    if not question.ago or question.at_s is None:
        return question
    at_s = now_s - question.at_s
    return replace(question, at_s=at_s if at_s < -NEAR_S else max(0.0, at_s), ago=False)
