"""Whether everything that reads what others wrote survives rubbish: nothing crashes, hangs or fills the memory.

``python -m evaluation.fuzz --inputs 1000000`` gives each decoder its share of the inputs: what socialbot itself writes
(messages, files, bags, programs), with something changed. They are the same for the same ``--seed``. Child processes
do the work, with limits of time and memory. The exit code is 1 when one of the inputs did what none may do; ``--keep``
has those inputs as files, and ``--decoder NAME --first NUMBER --inputs 1`` does one of them again.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from evaluation.progress import Bar
from evaluation.report import JsonOption, Report, Value, run
from socialbot.core.errors import ParameterError, suggestion
from tests.fuzz.decoders import Decoder, decoders
from tests.fuzz.mutations import numbered

HANG_S = 1.0
"""So much CPU time an input may take."""
STUCK_S = 20.0
"""A child that has been at one input for so long is killed: it waits for something, or cannot be interrupted."""
GROWTH_MB = 200
"""By so much the memory of a child may grow in all."""
GUARD_MB = 4096
"""What a child cannot get more of, for the sake of the machine."""
SLICE = 5000
"""Inputs a child does before it is replaced."""
LOOK_S = 0.05
UNMET_EXIT = 1

How = Literal["crash", "hang", "memory"]

InputsOption = Annotated[int, typer.Option(min=1, help="How many inputs, over all decoders.")]
JobsOption = Annotated[int, typer.Option(min=1, help="Processes at once.")]
SeedOption = Annotated[int, typer.Option(help="Other seeds make other inputs.")]
DecoderOption = Annotated[list[str] | None, typer.Option("--decoder", help="Only this decoder; can be given again.")]
FirstOption = Annotated[int, typer.Option(min=0, help="The number of the first input of each decoder.")]
KeepOption = Annotated[Path | None, typer.Option(help="A folder for the inputs that did harm.")]


class TooLong(BaseException):
    """An input took too long. No decoder may take it for an error of its own."""


@dataclass(frozen=True)
class Finding:
    """An input that did what none may do; ``what`` is the same for all that did so at the same place."""

    decoder: str
    number: int
    how: How
    what: str


@dataclass
class Tally:
    """How one decoder fared."""

    inputs: int = 0
    taken: int = 0
    cpu_s: float = 0.0
    growth_mb: float = 0.0
    longest_s: float = 0.0
    findings: list[Finding] = field(default_factory=list)

    def count(self, how: How) -> int:
        """How many inputs did so."""
        return sum(finding.how == how for finding in self.findings)

    def row(self) -> dict[str, Value]:
        """As a row of a table."""
        return {
            "inputs": self.inputs,
            "taken": round(self.taken / max(1, self.inputs), 3),
            "inputs_per_s": round(self.inputs / max(1e-9, self.cpu_s)),
            "longest_ms": round(1000 * self.longest_s),
            "growth_mb": round(self.growth_mb, 1),
            "crashes": self.count("crash"),
            "hangs": self.count("hang"),
            "memory": self.count("memory"),
        }


@dataclass(frozen=True)
class Slice:
    """Some inputs for one decoder: numbers from ``first`` to before ``end``."""

    decoder: Decoder
    first: int
    end: int


def peak_mb() -> float:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _work(part: Slice, seed: int, at: Any, results: Connection) -> None:
    """Does the inputs of ``part``, ``at`` telling which one; sends findings, then the tally.

    It stops when memory has grown.
    """
    _prepare()
    tally, decoder, before_mb = Tally(), part.decoder, peak_mb()
    begun = time.process_time()
    for number in range(part.first, part.end):
        at.value = number
        tally.inputs += 1
        began = time.process_time()
        how: How | None = None
        what = ""
        try:
            tally.taken += _attempt(decoder, numbered(decoder.name, seed, number, decoder.seeds))
        except TooLong as error:
            how, what = "hang", _place(error)
        except Exception as error:  # noqa: BLE001 - whatever it raises is what is looked for
            how, what = "memory" if isinstance(error, MemoryError) else "crash", _place(error)
        took_s = time.process_time() - began
        if took_s > HANG_S and how is None:
            how, what = "hang", f"{took_s:.1f} s"
        tally.longest_s = max(tally.longest_s, took_s)
        tally.growth_mb = peak_mb() - before_mb
        if tally.growth_mb > GROWTH_MB:
            how, what = "memory", f"{tally.growth_mb:.0f} MB more"
        if how is not None:
            results.send(Finding(decoder.name, number, how, what))
        if how == "memory":
            break
    tally.cpu_s = time.process_time() - begun
    results.send(tally)
    results.close()


def _prepare() -> None:
    """Limits and quiet for a child."""
    logging.disable(logging.CRITICAL)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries in C complain there
    resource.setrlimit(resource.RLIMIT_DATA, (GUARD_MB << 20, GUARD_MB << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, _too_long)


def _too_long(*unused: object) -> None:
    raise TooLong


def _attempt(decoder: Decoder, data: bytes) -> bool:
    signal.setitimer(signal.ITIMER_PROF, HANG_S)
    try:
        return decoder.takes(data)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _place(error: BaseException) -> str:
    """What was raised, and where in socialbot."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"{os.sep}socialbot{os.sep}" in frame.filename] or frames
    return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno}"


class Child:
    """A process that does a slice."""

    def __init__(self, part: Slice, seed: int) -> None:
        context = multiprocessing.get_context("fork")
        self.part = part
        self._at: Any = context.Value("q", part.first, lock=False)
        self._results, sender = context.Pipe(duplex=False)
        self._process: BaseProcess = context.Process(target=_work, args=(part, seed, self._at, sender))
        self._process.start()
        sender.close()
        self._since, self._last = time.monotonic(), part.first
        self._findings: list[Finding] = []

    def look(self) -> tuple[Tally, int] | None:
        """How it fared, and the input to go on with; None while it works. One that is stuck is killed."""
        alive = self._process.is_alive()  # asked first: what it sends before its end is read below
        while self._results.poll():
            try:
                result = self._results.recv()
            except EOFError:
                break
            if isinstance(result, Tally):
                return self._ended(result)
            self._findings.append(result)
        at, now = int(self._at.value), time.monotonic()
        if at != self._last:
            self._last, self._since = at, now
        stuck = now - self._since >= STUCK_S
        if alive and not stuck:
            return None
        self._process.kill()
        self._process.join()
        what = f"stuck for {STUCK_S:g} s" if stuck else f"the process ended with {self._process.exitcode}"
        self._findings.append(Finding(self.part.decoder.name, at, "hang" if stuck else "crash", what))
        return self._ended(Tally(inputs=at + 1 - self.part.first))

    def _ended(self, tally: Tally) -> tuple[Tally, int]:
        self._process.join()
        self._results.close()
        tally.findings += self._findings
        return tally, self.part.first + tally.inputs


def slices(chosen: Sequence[Decoder], inputs: int, first: int) -> Iterator[Slice]:
    """``inputs`` in all, shared out evenly."""
    for index, decoder in enumerate(chosen):
        end = first + inputs // len(chosen) + (index < inputs % len(chosen))
        for begin in range(first, end, SLICE):
            yield Slice(decoder, begin, min(end, begin + SLICE))


def fuzz(parts: Sequence[Slice], seed: int, jobs: int) -> dict[str, Tally]:
    """Does all ``parts``, ``jobs`` at once; the tally of each decoder."""
    tallies = {part.decoder.name: Tally() for part in parts}
    waiting, children = list(reversed(parts)), list[Child]()
    with Bar("slices", len(parts)) as bar:
        while waiting or children:
            while waiting and len(children) < jobs:
                children.append(Child(waiting.pop(), seed))
            time.sleep(LOOK_S)
            for child in list(children):
                ended = child.look()
                if ended is None:
                    continue
                children.remove(child)
                tally, following = ended
                _add(tallies[child.part.decoder.name], tally)
                if following < child.part.end:
                    waiting.append(Slice(child.part.decoder, following, child.part.end))
                else:
                    bar.advance()
    return tallies


def _add(sum_: Tally, more: Tally) -> None:
    sum_.inputs += more.inputs
    sum_.taken += more.taken
    sum_.cpu_s += more.cpu_s
    sum_.growth_mb = max(sum_.growth_mb, more.growth_mb)
    sum_.longest_s = max(sum_.longest_s, more.longest_s)
    sum_.findings += more.findings


def choose(names: Sequence[str]) -> list[Decoder]:
    """The decoders called ``names``, or all. Raises ParameterError."""
    known = {decoder.name: decoder for decoder in decoders()}
    for name in names:
        if name not in known:
            raise ParameterError(f"no decoder {name!r}", where="--decoder", remedy=suggestion(name, known))
    return [known[name] for name in names or known]


def _kept(folder: Path, findings: Sequence[Finding], seed: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    seeds = {decoder.name: decoder.seeds for decoder in decoders()}
    for finding in findings:
        data = numbered(finding.decoder, seed, finding.number, seeds[finding.decoder])
        (folder / f"{finding.decoder}-{finding.number}-{finding.how}").write_bytes(data)


def main(
    inputs: InputsOption = 1_000_000,
    jobs: JobsOption = 2,
    seed: SeedOption = 1,
    decoder: DecoderOption = None,
    first: FirstOption = 0,
    keep: KeepOption = None,
    json: JsonOption = None,
) -> None:
    """Give everything that reads what others wrote rubbish to read, and count what it does wrong."""
    report = Report("fuzz", quick=inputs < 1_000_000)
    begun = time.monotonic()
    tallies = fuzz(list(slices(choose(decoder or []), inputs, first)), seed, jobs)
    findings = [finding for tally in tallies.values() for finding in tally.findings]
    seconds = time.monotonic() - begun
    report.add("inputs", "inputs", sum(tally.inputs for tally in tallies.values()))
    report.add("decoders", "decoders", len(tallies))
    report.add("wall_s", "time, s", round(seconds, 1))
    report.add("inputs_per_s", "inputs a second", round(inputs / seconds))
    for how, text in (
        ("crash", "exceptions other than SocialbotError, and ends of the process"),
        ("hang", f"inputs that took more than {HANG_S:g} s of CPU time"),
        ("memory", f"inputs after which memory had grown by more than {GROWTH_MB} MB"),
    ):
        report.add(how, text, sum(finding.how == how for finding in findings), 0)
    report.tables = {"decoders": {name: tally.row() for name, tally in tallies.items()}}
    places = Counter((finding.decoder, finding.how, finding.what) for finding in findings)
    firsts = {(one.decoder, one.how, one.what): one.number for one in reversed(findings)}
    if places:
        report.tables["findings"] = {
            f"{name}: {what}": {"how": how, "times": times, "first_input": firsts[name, how, what]}
            for (name, how, what), times in places.most_common()
        }
    if keep is not None:
        _kept(keep, findings, seed)
    report.finish(json)
    if findings:
        sys.exit(UNMET_EXIT)


if __name__ == "__main__":
    run(main)
