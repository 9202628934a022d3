"""Observed atoms of a run: records, health and messages as signals by variable values."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Health, Message, TraceRecord
from socialbot.runs.expectations.formulas import AtomicFormula, Binding, Occurrence, TemporalFormula

if TYPE_CHECKING:
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.history import History

Key = tuple[tuple[str, str], ...]
"""Values of the variables of an atom, by name."""

RECORDS, HEALTH = "record", "health"
"""Subjects of observers: trace records, and changes of health; other subjects are topics."""


class AtomObserver:
    """Collects the occurrences of one atom from a run, in order of time."""

    subjects: frozenset[str] = frozenset({RECORDS})

    def __init__(self) -> None:
        self._found: dict[Key, list[Occurrence]] = {}

    def take(self, at: int, item: Any, history: History) -> None:
        """Process a record, health or message at ``at`` (ns from the start)."""
        raise NotImplementedError

    def occurrences(self, end: int, history: History) -> Mapping[Key, Sequence[Occurrence]]:
        """Return the occurrences until ``end`` (ns from the start) by values of the variables."""
        return self._found

    def forget(self, before: int) -> None:
        """Drop occurrences that ended before a moment (ns from the start)."""
        for key, occurrences in list(self._found.items()):
            occurrences[:] = [each for each in occurrences if each.end >= before]
            if not occurrences:
                del self._found[key]

    def _end(self, key: Key, begin: int, at: int, record: TraceRecord | None) -> None:
        """Note a state that ended just before ``at``."""
        if begin < at:
            self._found.setdefault(key, []).append(Occurrence(begin, at - 1, record))

    def _with_open(
        self, states: Iterable[tuple[Key, int, TraceRecord | None]], end: int
    ) -> Mapping[Key, Sequence[Occurrence]]:
        """Return the occurrences with the states that have not ended until ``end``."""
        found = {key: list(all_of) for key, all_of in self._found.items()}
        for key, begin, record in states:
            if begin <= end:
                found.setdefault(key, []).append(Occurrence(begin, end, record))
        return {key: sorted(all_of, key=_begin) for key, all_of in found.items()}


def key_of(values: Mapping[str, str]) -> Key:
    return tuple(sorted(values.items()))


class EventObserver(AtomObserver):
    """Events, as ``select`` finds them: it returns the values of the variables, several or none."""

    def __init__(
        self,
        select: Callable[[Any, History], Iterable[Mapping[str, str]]],
        subjects: Iterable[str] = (RECORDS,),
        kinds: Iterable[str] = (),
        *,
        later: bool = False,
    ) -> None:
        super().__init__()
        self.subjects = frozenset(subjects)
        self._select, self._kinds, self._later = select, frozenset(kinds), later
        self._pending: list[tuple[int, Any]] = []

    def take(self, at: int, item: Any, history: History) -> None:
        if self._kinds and getattr(item, "kind", "") not in self._kinds:
            return
        if self._later:  # causes may arrive after their effects
            self._pending.append((at, item))
        else:
            self._note(at, item, history)

    def _note(self, at: int, item: Any, history: History) -> None:
        for values in self._select(item, history):
            record = item if isinstance(item, TraceRecord) else None
            insort(self._found.setdefault(key_of(values), []), Occurrence(at, at, record), key=_begin)

    def occurrences(self, end: int, history: History) -> Mapping[Key, Sequence[Occurrence]]:
        pending, self._pending = self._pending, []
        for at, item in pending:
            self._note(at, item, history)
        return self._found


class StateObserver(AtomObserver):
    """States that records, health or messages begin and end.

    ``changes`` returns the state's name, the values of the variables, and whether it begins; or nothing.
    """

    def __init__(
        self,
        changes: Callable[[Any, History], Iterable[tuple[str, Mapping[str, str], bool]]],
        subjects: Iterable[str] = (RECORDS,),
        kinds: Iterable[str] = (),
    ) -> None:
        super().__init__()
        self.subjects = frozenset(subjects)
        self._changes, self._kinds = changes, frozenset(kinds)
        self._open: dict[str, tuple[Key, int, TraceRecord | None]] = {}

    def take(self, at: int, item: Any, history: History) -> None:
        if self._kinds and getattr(item, "kind", "") not in self._kinds:
            return
        for name, values, begins in self._changes(item, history):
            if begins and name not in self._open:
                self._open[name] = key_of(values), at, item if isinstance(item, TraceRecord) else None
            elif not begins and name in self._open:
                key, begin, record = self._open.pop(name)
                self._end(key, begin, at, record)

    def occurrences(self, end: int, history: History) -> Mapping[Key, Sequence[Occurrence]]:
        return self._with_open(self._open.values(), end)


class ActionObserver(AtomObserver):
    """Actions and steps in execution. Only those are known to last that make progress, end later, or are steps."""

    def __init__(self, begins: Callable[[TraceRecord], Mapping[str, str] | None]) -> None:
        super().__init__()
        self._begins = begins
        self._begun: dict[str, tuple[Key, int, TraceRecord]] = {}
        self._lasting: set[str] = set()

    def take(self, at: int, item: Any, history: History) -> None:
        if item.kind in ("action", "step"):
            values = self._begins(item)
            if values is not None:
                self._begun[item.id] = key_of(values), at, item
                if item.kind == "step":
                    self._lasting.add(item.id)
        elif item.kind == "progress":
            self._lasting.add(item.cause)
        elif item.kind in ("action_end", "step_end") and item.cause in self._begun:
            key, begin, record = self._begun.pop(item.cause)
            self._lasting.discard(item.cause)
            self._end(key, begin, at, record)

    def occurrences(self, end: int, history: History) -> Mapping[Key, Sequence[Occurrence]]:
        return self._with_open((self._begun[name] for name in self._lasting & self._begun.keys()), end)


class PersonObserver(AtomObserver):
    """Persons whose detections satisfy ``is_it``, by track id under the variable ``variable`` (empty: anyone).

    The state holds from the first to the last frame that shows it; frames at most ``gap_s`` apart belong together.
    """

    def __init__(self, is_it: Callable[[Mapping[str, Any]], bool], variable: str, gap_s: float) -> None:
        super().__init__()
        self._is_it, self._variable, self._gap = is_it, variable, nanoseconds(gap_s)

    def take(self, at: int, item: Any, history: History) -> None:
        if item.kind != "detection":
            return
        for person in item.detail.get("persons", ()):
            if not self._is_it(person):
                continue
            key = ((self._variable, person.get("track_id") or "somebody"),) if self._variable else ()
            track = self._found.setdefault(key, [])
            if track and at - track[-1].end <= self._gap:
                track[-1] = track[-1]._replace(end=max(track[-1].end, at))
            else:
                track.append(Occurrence(at, at, item))


def _begin(occurrence: Occurrence) -> int:
    return occurrence.begin


class Observation:
    """Observed atoms of a run that may go on. Feed it in order of time, then read it as a trace of formulas.

    Args:
        formulas: The formulas to evaluate.
        history: Records of the run, for causes; it must hold the records of `take_record`.
        complete: Whether the run is over; windows without a limit end with it.
    """

    def __init__(self, formulas: Iterable[TemporalFormula], history: History, *, complete: bool = True) -> None:
        self.complete = complete
        whole = list(formulas)
        self.history = history
        self._memory = max((each.memory for each in whole), default=1)
        self._observers = {atom: atom.observer() for each in whole for atom in each.atoms()}
        self._by_subject: dict[str, list[AtomObserver]] = {}
        for observer in self._observers.values():
            for subject in observer.subjects:
                self._by_subject.setdefault(subject, []).append(observer)
        self._end = 0
        self._read: dict[AtomicFormula, Mapping[Key, Sequence[Occurrence]]] = {}

    @property
    def topics(self) -> frozenset[str]:
        """Topics whose messages matter, besides records and health."""
        return frozenset(self._by_subject) - {RECORDS, HEALTH}

    def take_record(self, record: TraceRecord) -> None:
        self._take(RECORDS, record.stamp, record)

    def take_health(self, at_s: float, health: Health) -> None:
        self._take(HEALTH, self.history.start + nanoseconds(at_s), health)

    def take_message(self, topic: str, message: Message) -> None:
        self._take(topic, message.stamp, message)

    def _take(self, subject: str, stamp: int, item: Any) -> None:
        at = max(0, stamp - self.history.start)
        for observer in self._by_subject.get(subject, ()):
            observer.take(at, item, self.history)

    def read(self, end: int) -> None:
        """End the trace at ``end`` (ns from the start) for now."""
        self._end = max(end, 0)
        self._read.clear()

    def forget(self, before: int) -> None:
        """Drop occurrences that ended before a moment (ns from the start)."""
        for observer in self._observers.values():
            observer.forget(before)

    @property
    def end(self) -> int:
        return self._end

    @property
    def last(self) -> int:
        return self._end + self._memory

    def occurrences(self, atom: AtomicFormula, binding: Binding) -> Sequence[Occurrence]:
        found = self._all(atom)
        if not atom.variables:
            return _until(found.get((), ()), self._end)
        given = tuple(sorted((name, value) for name, value in binding.items() if name in atom.variables))
        return _until(found.get(given, ()), self._end)

    def values(self, atoms: Iterable[AtomicFormula]) -> dict[str, set[str]]:
        """Return the values that the atoms show for each variable."""
        values: dict[str, set[str]] = {}
        for atom in atoms:
            for name in atom.binds:
                values.setdefault(name, set())
            for key in self._all(atom):
                for name, value in key:
                    if name in atom.binds:
                        values[name].add(value)
        return values

    def keys(self, atom: AtomicFormula) -> Iterator[Key]:
        """Yield the values for which an atom ever holds."""
        return (key for key, found in self._all(atom).items() if found)

    def _all(self, atom: AtomicFormula) -> Mapping[Key, Sequence[Occurrence]]:
        if atom not in self._read:
            self._read[atom] = self._observers[atom].occurrences(self._end, self.history)
        return self._read[atom]


def _until(found: Sequence[Occurrence], end: int) -> Sequence[Occurrence]:
    if not found or found[-1].end <= end:
        return found
    return [each._replace(end=min(each.end, end)) for each in found if each.begin <= end]


def observe_run(run: RecordedRun, formulas: Iterable[TemporalFormula]) -> Observation:
    """Return the observed atoms of a recorded run, whole."""
    history = run.history
    observation = Observation(formulas, history)
    topics = observation.topics
    for at_s, health in run.node_history.health:
        observation.take_health(at_s, health)
    for record in history:
        observation.take_record(record)
    if topics:
        for topic, message in run.messages(topics):
            observation.take_message(topic, message)
    observation.read(max(run.end - history.start, nanoseconds(run.lasted_s)))
    return observation
