"""Facts of a run that answers rest on: who was where, what was believed when, whom a deed concerned."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._subjects import Subjects, persons_in
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.history import History

GAP_S = 3.0
"""A shorter absence does not end a visit."""
_WITH_CONTENT = 2
"""Arguments of a belief about what a person said without its content: the person and the intent."""
ROUNDED_S = 0.5
"""What a time in whole seconds leaves open."""


@dataclass(frozen=True)
class Held:
    """Time (ns) in which an agent believed something; ``end`` is None if it still does. ``record`` is the first."""

    agent: str
    what: str
    record: TraceRecord
    begin: int
    end: TraceRecord | None

    def at(self, stamp: int) -> bool:
        return self.begin <= stamp and (self.end is None or stamp < self.end.stamp)

    def within(self, begin: int, end: int) -> bool:
        return self.begin <= end and (self.end is None or self.end.stamp > begin)


@dataclass(frozen=True)
class Presence:
    """Frames (first and last detection record) in which a person was in view without a long gap."""

    person: str
    first: TraceRecord
    last: TraceRecord


class Facts:
    """Facts of a history, read once."""

    def __init__(self, subjects: Subjects) -> None:
        self.subjects = subjects
        self.history: History = subjects.history

    @cached_property
    def beliefs(self) -> list[Held]:
        """Intervals of all beliefs, in order of their begin."""
        begun: dict[tuple[str, str], TraceRecord] = {}
        found: list[Held] = []
        for record in self.history:
            key = record.source, record.what
            if record.kind == "belief":
                begun.setdefault(key, record)
            elif record.kind == "unbelief" and not record.detail.get("left") and key in begun:
                start = begun.pop(key)
                found.append(Held(*key, start, start.stamp, record))
        found += [Held(*key, start, start.stamp, None) for key, start in begun.items()]
        return sorted(found, key=lambda each: each.begin)

    def held(self, name: str, person: str = "", agent: str = "") -> Iterator[Held]:
        """Yield the intervals of beliefs of a name or literal, those about ``person`` only if one is given."""
        for each in self.beliefs:
            is_named = each.what == name or each.what.partition("(")[0] == name
            if is_named and agent in ("", each.agent) and (not person or person in arguments_of(each.what)):
                yield each

    @cached_property
    def visits(self) -> list[Presence]:
        """Visits of the detected people in order of arrival."""
        found: list[Presence] = []
        latest: dict[str, int] = {}
        for record in self.history:
            for person in persons_in(record):
                place = latest.get(person)
                if place is not None and record.stamp - found[place].last.stamp < nanoseconds(GAP_S):
                    found[place] = Presence(person, found[place].first, record)
                else:
                    latest[person] = len(found)
                    found.append(Presence(person, record, record))
        return found

    @cached_property
    def arrivals(self) -> list[str]:
        """The detected people in order of their first arrival."""
        return list(dict.fromkeys(each.person for each in self.visits))

    @cached_property
    def departures(self) -> list[str]:
        """The detected people in order of their last departure."""
        left = {each.person: each.last.stamp for each in self.visits}
        return sorted(left, key=left.__getitem__)

    def frame(self, stamp: int) -> TraceRecord | None:
        """Return the newest detections up to ``stamp``."""
        return next((each for each in self.history.back(self.history.start, stamp) if each.kind == "detection"), None)

    def present_at(self, stamp: int) -> list[str]:
        """Return the people of the newest frame up to ``stamp``, or else those of visits around it."""
        frame = self.frame(stamp)
        seen = [] if frame is None or stamp - frame.stamp > SECOND else persons_in(frame)
        return seen or [each.person for each in self.visits if each.first.stamp <= stamp <= each.last.stamp]

    def concerned(self, record: TraceRecord) -> list[str]:
        """Return the people whom a deed concerned.

        These are people in its arguments, in the beliefs that its plan added, or else in the first belief of the chain
        of causes that names somebody.
        """
        persons = set(self.subjects.persons) | {"somebody"}
        named = [one for one in arguments_of(record.what) if one in persons]
        if named or not self.subjects.persons:
            return named
        chain = [record, *self.history.before(record)]
        action = next((each for each in chain if each.kind in ("action", "step")), None)
        plan = None if action is None else self.history.cause(action)
        if plan is not None and plan.kind == "plan":
            beside = [each for each in self.history.effects(plan) if each.kind == "belief" and each.stamp >= plan.stamp]
            found = [one for each in beside for one in arguments_of(each.what) if one in persons]
            if found:
                return list(dict.fromkeys(found))
        for each in chain:
            found = [one for one in arguments_of(each.what) if one in persons] if each.kind == "belief" else []
            if found:
                return found
        return []

    def trigger(self, record: TraceRecord) -> TraceRecord | None:
        """Return the belief that a deed came from: the last in its chain of causes that the agent did not derive."""
        last = None
        for each in self.history.before(record):
            if each.kind == "belief" and each.source == record_agent(self.history, record):
                last = each
                if each.detail.get("source") != "self":
                    return each
            elif each.kind in ("desire", "plan_start", "step"):
                break
        return last

    def heard_before(self, deed: TraceRecord) -> TraceRecord | None:
        """Return the utterance of a person that a deed responds to.

        It is in the chain of causes, or its belief has the arguments of a goal there: ``Respond("t1", "directions",
        ["library"])`` within a longer turn responds to ``heard("t1", "directions", ["library"])``.
        """
        chain = list(self.history.before(deed))
        contents = {each.what.partition("(")[2] for each in chain if each.kind == "goal"}
        for stamp, content, hearing in reversed(self._heard_contents):
            if stamp <= deed.stamp and (content in contents or hearing in chain):
                return hearing
        return None

    @cached_property
    def _heard_contents(self) -> list[tuple[int, str, TraceRecord]]:
        """Times, arguments and utterances of the beliefs that came from what people said, in order of time."""
        heard = (
            (each.stamp, each.what.partition("(")[2], hearing)
            for each in self.history
            if each.kind == "belief" and len(arguments_of(each.what)) > _WITH_CONTENT
            for hearing in self.history.before(each)
            if hearing.kind == "hearing"
        )
        return sorted(heard, key=lambda each: each[0])

    def intents(self, hearing: TraceRecord) -> list[str]:
        """Return what an utterance of a person was understood as: the intents of the beliefs that came from it."""
        percepts = [each for each in self.history.effects(hearing) if each.kind == "percept"]
        beliefs = [one for each in (hearing, *percepts) for one in self.history.effects(each) if one.kind == "belief"]
        return [one[1] for each in beliefs if len(one := arguments_of(each.what)) > 1]

    @cached_property
    def failures(self) -> list[TraceRecord]:
        """Failures of goals and actions."""
        return [each for each in self.history if each.kind == "failure"]

    @cached_property
    def plan_starts(self) -> list[TraceRecord]:
        """Begins of plans with steps."""
        return [each for each in self.history if each.kind == "plan_start" and each.detail.get("steps")]

    @cached_property
    def plan_ends(self) -> list[TraceRecord]:
        """Ends of plans for goals and desires."""
        return [each for each in self.history if each.kind == "plan_end"]

    def end_of(self, deed: TraceRecord) -> TraceRecord | None:
        """Return the record of the end of a step, an action or an utterance; None if it is not known."""
        ends = (each for each in self.history.effects(deed) if each.kind in ("step_end", "action_end", "speech"))
        over = (each for each in ends if each.kind != "speech" or each.what not in ("started", "waiting"))
        return min(over, key=lambda each: each.stamp, default=None)

    def over(self, deed: TraceRecord) -> TraceRecord | None:
        """Return the record of the end of a deed, which may be a goal that was achieved; None if it is not known."""
        ends = self.history.effects(deed) if deed.kind in ("goal", "desire") else []
        return next((each for each in ends if each.kind in ("achieved", "desire_fulfilled")), self.end_of(deed))

    def has_failed(self, goal: str, stamp: int) -> bool:
        """Return whether a goal, by the id of its record, had failed by ``stamp``; its failure plan may go on."""
        failures = (each for each in self.failures if each.stamp <= stamp)
        return any(goal == cause.id for each in failures for cause in self.history.before(each))


def record_agent(history: History, record: TraceRecord) -> str:
    """Return the node of the agent behind a record of an action, a step or an utterance."""
    if record.kind not in ("utterance", "speech", "head", "motion", "detection"):
        return record.source
    behind = (each.source for each in history.before(record) if each.kind not in ("utterance", "speech", "detection"))
    return next(behind, "")


def near_or_later(
    records: Sequence[TraceRecord], stamp: int, within_s: float, ends: Callable[[TraceRecord], TraceRecord | None]
) -> list[TraceRecord]:
    """Return the records that were under way at ``stamp`` or began nearest to it, or else all that began later."""
    begun = stamp - nanoseconds(ROUNDED_S)
    timely = [each for each in records if each.stamp >= begun or ((end := ends(each)) and end.stamp >= begun)]
    return near(timely, stamp, within_s) or [each for each in timely if each.stamp >= begun]


def near(records: Sequence[TraceRecord], stamp: int, within_s: float) -> list[TraceRecord]:
    """Return the records nearest to ``stamp``, at most ``within_s`` away."""
    best = min((abs(each.stamp - stamp) for each in records), default=None)
    if best is None or best > nanoseconds(within_s):
        return []
    return [each for each in records if abs(each.stamp - stamp) == best]
