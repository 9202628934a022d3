"""Trace of an agent: causally linked records of its beliefs, goals, plans and actions."""

from __future__ import annotations

import itertools
import os
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields
from os import PathLike
from string import Formatter
from typing import IO, TYPE_CHECKING, Any

from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import RuleError, place_of
from socialbot.core.reading import read_bytes

if TYPE_CHECKING:
    from logging import Logger

_ROOM = os.path.dirname(__file__)


@dataclass(frozen=True, slots=True)
class Record:
    """Trace record at ``time`` (ns); ``cause`` is the id of the record or percept that caused it."""

    id: str
    time: int
    kind: str
    what: str
    cause: str
    detail: dict[str, object] = field(default_factory=dict)


_FIELDS = tuple(field.name for field in fields(Record))

Sink = Callable[[Record], None]
"""Receives the records in order. The first exception of a sink is logged; no exception stops the agent."""


_logger: Logger | None = None


def log() -> Logger:
    """Return the logger ``socialbot.bdi``; the slow import of ``logging`` happens on demand."""
    global _logger
    if _logger is None:
        import logging

        _logger = logging.getLogger("socialbot.bdi")
    return _logger


_MOST_FAILURES = 1000
"""Most kinds of failures that are counted."""


class TraceWriter:
    """Numbers the trace records of an agent and passes them to its sink.

    ``sink`` may be replaced at any time; without one, records are only numbered.
    """

    __slots__ = ("_broken", "_failures", "_now", "name", "numbers", "sink")

    def __init__(self, name: str, clock: Clock, sink: Sink | None) -> None:
        self.name = name
        self.sink = sink
        self.numbers = itertools.count(1)
        self._now = clock.now
        self._broken = False
        self._failures: Counter[tuple[str, str]] = Counter()
        """Number of failures by what failed, and where or why."""

    def record(self, kind: str, what: str, cause: Any, **detail: object) -> str:
        """Write a record; return its id."""
        record_id = f"{self.name}-{next(self.numbers)}"
        if self.sink is not None:
            try:
                self.sink(Record(record_id, self._now(), kind, what, str(cause), detail))
            except Exception:  # noqa: BLE001 - a sink is user code
                if not self._broken:
                    log().exception("%s: the trace is incomplete from here on: its sink failed", self.name)
                self._broken = True
        return record_id

    def record_failure(self, what: str, cause: Any, problem: Exception) -> str:
        """Write a record of an exception of user code; return its id. Log the first, tenth, hundredth, ... alike."""
        message, place = message_of(problem), raised_in(problem)
        if len(self._failures) >= _MOST_FAILURES:
            self._failures.clear()
        self._failures[what, place or message] += 1
        count = self._failures[what, place or message]
        if str(count).strip("0") == "1":
            times = f" {count} times" if count > 1 else ""
            log().warning("%s: %s%s: %s%s", self.name, what, times, message, place and f" ({place})")
        where = {"where": place} if place else {}
        return self.record("failure", what, cause, reason=type(problem).__name__, message=message, **where)

    def explain(self, record: str) -> list[Record]:
        """Return the causes of a record, from the record back to the percept. The sink must be a `Trace`."""
        chain = getattr(self.sink, "explain", None)
        if chain is None:
            raise RuleError("no trace is kept", where=self.name, remedy="give the engine sink=Trace()")
        return chain(record)


def raised_in(problem: Exception) -> str:
    """File and line of the user's code in which an exception was raised; empty if it has none."""
    return place_of(problem, _ROOM)


def message_of(problem: Exception) -> str:
    """Message of an exception of user code."""
    if isinstance(problem, RecursionError):
        limit = sys.getrecursionlimit()
        return f"inferences or calls are nested too deeply for the limit of {limit} calls (sys.setrecursionlimit)"
    return str(problem)


class Trace:
    """Sink that keeps the last ``limit`` records and explains their causes.

    >>> trace = Trace()
    >>> trace(Record("a-1", 0, "belief", "rain()", "frame-7"))
    >>> trace(Record("a-2", 0, "action", 'say("wet")', "a-1"))
    >>> print(as_text(trace.explain("a-2")))
    It did say("wet"),
    because it believed rain(),
    because of frame-7.
    """

    def __init__(self, limit: int = 100_000) -> None:
        if limit < 1:
            raise RuleError(f"a trace cannot keep {limit} records", remedy="give a limit of 1 or more")
        self.limit = limit
        self._order: deque[Record] = deque()
        self._by_id: dict[str, Record] = {}

    def __call__(self, record: Record) -> None:
        self._order.append(record)
        self._by_id[record.id] = record
        if len(self._order) > self.limit:
            old = self._order.popleft()
            if self._by_id.get(old.id) is old:
                del self._by_id[old.id]

    def __iter__(self) -> Iterator[Record]:
        return iter(list(self._order))

    def __len__(self) -> int:
        return len(self._order)

    def __contains__(self, record_id: object) -> bool:
        return record_id in self._by_id

    def find(self, kind: str | None = None, what: str | None = None) -> list[Record]:
        """Records of a kind and, with ``what``, those with this name or text; the oldest first."""
        return [
            record
            for record in self._order
            if (kind is None or record.kind == kind)
            and (what is None or record.what == what or record.what.partition("(")[0] == what)
        ]

    def explain(self, record_id: str) -> list[Record]:
        """Return a record and its chain of causes, as far as the trace has them. Raises RuleError for an unknown id."""
        record = self._by_id.get(record_id)
        if record is None:
            raise RuleError(f"no record {record_id}", remedy="give the id of a record in the trace")
        chain: dict[str, Record] = {}
        while record is not None and record.id not in chain:
            chain[record.id] = record
            record = self._by_id.get(record.cause)
        return list(chain.values())


class JsonLines:
    """Sink that writes each record to a file as one line of JSON.

    Each line is flushed at once: a crash of the process loses at most the last one. ``file`` is an open file or a path;
    ``append`` keeps the previous content, ``text`` describes values that JSON lacks.
    """

    def __init__(
        self, file: str | PathLike[str] | IO[str], *, append: bool = False, text: Callable[[Any], str] = str
    ) -> None:
        import json  # rarely needed, and large

        self._encode = json.JSONEncoder(ensure_ascii=False, default=text).encode
        self._own = isinstance(file, (str, PathLike))
        mode = "a" if append else "w"
        self._file = open(file, mode, encoding="utf-8") if isinstance(file, (str, PathLike)) else file  # noqa: SIM115

    def __call__(self, record: Record) -> None:
        self._file.write(self._encode({name: getattr(record, name) for name in _FIELDS}) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file, if it was given as a path."""
        if self._own:
            self._file.close()

    def __enter__(self) -> JsonLines:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def read_trace(file: str | PathLike[str], limit: int = 100_000) -> Trace:
    """Read a trace of `JsonLines`, without a truncated last line. Raises RuleError for other files."""
    import json

    trace = Trace(limit)
    try:
        lines = read_bytes(file).split(b"\n")
    except OSError as problem:
        what = f"cannot be read: {problem.strerror}"
        raise RuleError(what, where=str(file), remedy="give a trace file") from problem
    for number, line in enumerate(lines, 1):
        try:
            if line:
                trace(Record(**json.loads(line)))
        except (ValueError, TypeError, RecursionError) as problem:
            if number < len(lines):
                raise RuleError(
                    "this is not a trace record", where=f"{file}:{number}", remedy="give a trace file"
                ) from problem
    return trace


class tee:  # noqa: N801 - reads as a function
    """Sink that passes each record to several sinks, even if one of them raises."""

    def __init__(self, *sinks: Sink) -> None:
        self.sinks = sinks

    def __call__(self, record: Record) -> None:
        problem: Exception | None = None
        for sink in self.sinks:
            try:
                sink(record)
            except Exception as error:  # noqa: BLE001 - raised after the other sinks
                problem = error
        if problem is not None:
            raise problem

    @property
    def explain(self) -> Any:
        """Method `Trace.explain` of the first sink that has it, or None."""
        return next((sink.explain for sink in self.sinks if hasattr(sink, "explain")), None)  # type: ignore[attr-defined]


SENTENCES = {
    "belief": "it believed {}{source:, source: }",
    "unbelief": "it believed {} no longer",
    "percept": "{}",
    "unhandled": "no plan applied to {}",
    "event": "there was {}",
    "held": "it had believed {} for {seconds} s",
    "goal": "it wanted {}",
    "plan": "it chose the plan{label: } for {}",
    "continued": "the goal {} went on as another",
    "action": "it did {}",
    "progress": "{} was {percent} done{text:: }",
    "action_end": "{} {outcome}{message:: }",
    "message": "it said: {}",
    "achieved": "it achieved {}",
    "failure": "{} failed{message:: }",
    "dropped": "it gave up an intention{message:: }",
}
"""Templates by kind of record: ``{}`` is its text, ``{reason}`` a detail, and ``{reason:: }`` a detail after ``: ``,
empty without a value. Other packages may add their kinds of records."""

KINDS = frozenset(SENTENCES)
"""Kinds of records of an engine."""


class _Detail(str):
    """Detail whose format specification is its prefix."""

    def __format__(self, before: str) -> str:
        return f"{before}{self!s}" if self else ""


def sentence(record: Record) -> str:
    """Describe a record in a few words."""
    detail, words = record.detail, SENTENCES.get(record.kind)
    if words is None:
        return f"{record.kind} {record.what}"
    details = defaultdict(_Detail)
    details.update({name: _Detail(value) for name, value in detail.items() if value is not None})
    details["percent"] = _Detail(f"{detail.get('fraction', 0):.0%}")
    details["message"] = details["message"] or details["reason"]
    if details["source"] == "self":
        del details["source"]
    return Formatter().vformat(words, (record.what,), details)


def as_text(chain: Iterable[Record]) -> str:
    """Format the result of `Trace.explain` as sentences, with times (s) since the first record of the chain."""
    records = list(chain)
    if not records:
        return ""
    begin, end = records[-1], records[0]
    lines = []
    for record in records:
        late = (record.time - begin.time) / SECOND
        when = f" at {late:+.3f} s" if end.time != begin.time else ""
        lines.append(f"{'because ' if lines else ''}{sentence(record)}{when}")
    if begin.cause:
        lines.append(f"because of {begin.cause}")
    text = ",\n".join(lines) + "."
    return text[0].upper() + text[1:]
