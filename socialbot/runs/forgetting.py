"""Remove one person from the record of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from socialbot.core.bounded_log import is_being_written, parts
from socialbot.core.clock import nanoseconds
from socialbot.core.decoding import from_json, json_decoder
from socialbot.core.errors import RunError, suggestion
from socialbot.core.messages import NO_JSON, TraceRecord
from socialbot.core.paths import expect_inside, leads_inside, replace_file, writing
from socialbot.core.reading import read_bytes
from socialbot.runs.folder import open_run
from socialbot.runs.record import RESULTS, SCORED, SEEN, TRACE

AFTER_S = 10.0
"""Actions of agents until so long after they were alone with a person are a trace of that person."""

PICTURES = (".html", ".mp4", ".jpg", ".jpeg", ".png", ".rrd", ".mcap", ".eaf")
"""Files with pictures, or with everything: they are removed."""

_TEXTS = (".json", ".yaml", ".yml", ".csv", ".txt", ".log")

Span = tuple[int, int]


@dataclass
class Forgotten:
    """Removed parts of a run.

    Attributes:
        frames: Number of frames in which the person was seen.
        records: Number of removed records of agents.
        files: Removed files.
        left: Files that may still show the person, such as the bag of the run, which is not changed.
        unnamed: Number of heard sentences that are kept and whose speaker is not known.
    """

    frames: int = 0
    records: int = 0
    files: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    unnamed: int = 0


def forget_person(folder: Path, person: str) -> Forgotten:
    """Remove a person from the record of a run.

    Removed are: their boxes in every frame; records that name them, with everything that follows from these; all that
    agents did while nobody else was there and `AFTER_S` after that; files with pictures and with scores of frames.

    Args:
        folder: The run.
        person: Id of the person, such as ``t1``.

    Raises:
        RunError: There is no run, it is still recorded, it has no such person, or it cannot be written.
    """
    if is_being_written(folder / TRACE):
        raise RunError("the run is still recorded", where=str(folder), remedy="end it first: socialbot down")
    known = _people(open_run(folder).history)
    if person not in known:
        remedy = suggestion(person, known) if known else "nobody was seen in this run"
        raise RunError(f"no person {person!r}", where=str(folder), remedy=remedy)
    with writing(folder, RunError, remedy="check its permissions"):
        return _Forgetting(folder, person).run()


def _people(history: Any) -> list[str]:
    found = (one.get("track_id", "") for record in history for one in record.detail.get("persons", ()))
    return sorted(set(filter(None, found)))


class _Lists(msgspec.Struct):
    """Lists in the results of a run whose items have an id."""

    actions: tuple[dict[str, Any], ...] = ()
    utterances: tuple[dict[str, Any], ...] = ()


class _Forgetting:
    def __init__(self, folder: Path, person: str) -> None:
        self._folder = folder
        self._person = person
        # Part of another word, as t1 in t10, is another name.
        self._named = re.compile(rf"(?<![A-Za-z0-9_]){re.escape(person)}(?![A-Za-z0-9_])")
        self._removed: set[str] = set()
        self._kept: set[str] = set()
        self._made = Forgotten()

    def run(self) -> Forgotten:
        for name in (TRACE, SEEN, RESULTS):
            for path in (*parts(self._folder / name), self._folder / name):
                expect_inside(self._folder, path)
        results = self._results()
        records = [record for path in parts(self._folder / TRACE) for record in self._records(path)]
        alone = self._alone(records)
        for path in parts(self._folder / TRACE):
            kept = (self._without(record, alone) for record in self._records(path))
            _replace(path, [msgspec.json.encode(record) for record in kept if record is not None])
        for path in parts(self._folder / SEEN) if (self._folder / SEEN).exists() else ():
            _replace(path, [line for line in read_bytes(path).split(b"\n") if line and not self._names(line)])
        if results is not None:
            self._rewrite_results(results)
        self._remove_files()
        return self._made

    def _records(self, path: Path) -> Iterator[TraceRecord]:
        """Yield the intact records of a file; damaged lines are dropped, since they may hold anything."""
        decoder = json_decoder(TraceRecord)
        for line in read_bytes(path).split(b"\n"):
            try:
                if line:
                    yield decoder.decode(line)
            except NO_JSON:
                continue

    def _names(self, data: bytes) -> bool:
        return self._named.search(data.decode("utf-8", "replace")) is not None

    def _alone(self, records: Sequence[TraceRecord]) -> list[Span]:
        """Times (ns) in which agents reacted to this person alone."""
        spans: list[Span] = []
        for record in records:
            if record.kind != "detection":
                continue
            ids = {one.get("track_id", "") for one in record.detail.get("persons", ())}
            if ids == {self._person}:
                end = record.stamp + nanoseconds(AFTER_S)
                if spans and record.stamp <= spans[-1][1]:
                    spans[-1] = spans[-1][0], end
                else:
                    spans.append((record.stamp, end))
            elif ids and spans and record.stamp <= spans[-1][1]:  # somebody else is there now
                spans[-1] = spans[-1][0], record.stamp - 1
        return spans

    def _without(self, record: TraceRecord, alone: Sequence[Span]) -> TraceRecord | None:
        """Return a record without the person; None if it is a trace of them."""
        if record.kind == "detection":
            return self._frame_without(record)
        follows = record.cause in self._removed
        at_that_time = any(begin <= record.stamp <= end for begin, end in alone)
        if follows or at_that_time or self._names(msgspec.json.encode(record)):
            self._made.records += 1
            self._removed.add(record.id)
            return None
        self._kept.add(record.id)
        self._made.unnamed += record.kind == "hearing" and not record.detail.get("person")
        return record

    def _frame_without(self, record: TraceRecord) -> TraceRecord:
        persons = record.detail.get("persons", ())
        others = [one for one in persons if one.get("track_id", "") != self._person]
        if len(others) == len(persons):
            return record
        self._made.frames += 1
        if not others:
            self._removed.add(record.id)
        detail = {**record.detail, "persons": others} if others else {}
        what = f"{len(others)} {'person' if len(others) == 1 else 'persons'}"
        return msgspec.structs.replace(record, what=what, detail=detail)

    def _results(self) -> dict[str, Any] | None:
        """Return the results of the run, None without any. Raises RunError if they are damaged, before any change."""
        path = self._folder / RESULTS
        if not path.is_file():
            return None
        data = read_bytes(path)
        try:
            from_json(data, _Lists)
            return from_json(data, dict[str, Any])
        except NO_JSON as error:
            remedy = "delete this file, or the whole run; nothing was removed"
            raise RunError(f"cannot be read: {error}", where=str(path), remedy=remedy) from error

    def _rewrite_results(self, results: dict[str, Any]) -> None:
        for name in ("actions", "utterances"):
            if name in results:
                results[name] = [each for each in results[name] if each.get("id") in self._kept]
        results["scores"] = None
        results.pop("decisions", None)
        text = msgspec.json.format(msgspec.json.encode(self._scrubbed(results)), indent=2) + b"\n"
        replace_file(self._folder / RESULTS, text)

    def _scrubbed(self, value: Any) -> Any:
        """Return plain data without items that name the person."""
        if isinstance(value, dict):
            return {key: self._scrubbed(each) for key, each in value.items() if not self._named.search(str(key))}
        if isinstance(value, list):
            return [self._scrubbed(each) for each in value if not (isinstance(each, str) and self._named.search(each))]
        return "" if isinstance(value, str) and self._named.search(value) else value

    def _remove_files(self) -> None:
        """Remove pictures, scores of frames and speech; drop lines of logs that name the person."""
        known = {*parts(self._folder / TRACE), *parts(self._folder / SEEN)}
        known |= {self._folder / "results.json", self._folder / "graph.yaml"}
        for path in sorted(self._folder.rglob("*")):
            name = str(path.relative_to(self._folder))
            if not path.is_file() or path in known:
                continue
            if not leads_inside(self._folder, path):
                self._made.left.append(name)
                continue
            if path.name == SCORED or path.suffix in PICTURES or path.suffix == ".wav":
                in_bag = path.suffix == ".mcap" and (path.parent / "metadata.yaml").exists()
                if in_bag:
                    self._made.left.append(name)
                else:
                    path.unlink()
                    self._made.files.append(name)
            else:
                self._remove_lines(path, name)

    def _remove_lines(self, path: Path, name: str) -> None:
        try:
            data = read_bytes(path)
        except OSError:  # too large, or not readable
            self._made.left.append(name)
            return
        if path.suffix in _TEXTS and self._names(data):
            replace_file(path, b"\n".join(line for line in data.split(b"\n") if not self._names(line)))
        elif self._names(data) or not _is_text(data):
            self._made.left.append(name)


def _is_text(data: bytes) -> bool:
    """Whether a search for names finds them; in films, sounds and archives it does not."""
    try:
        return "\0" not in data.decode()
    except UnicodeDecodeError:
        return False


def _replace(path: Path, lines: Sequence[bytes]) -> None:
    replace_file(path, b"".join(line + b"\n" for line in lines))
