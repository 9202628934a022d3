"""Fuzz test of all decoders for foreign data: no crash, hang or excessive memory.

``python -m evaluation.fuzz --inputs 1000000`` gives each decoder its share of the inputs: mutated messages, files, bags
and programs of socialbot. Equal ``--seed`` gives equal inputs. Child processes with time and memory limits do the work.
The exit code is 1 after a harmful input. ``--keep`` saves such inputs as files, and ``--decoder NAME --first NUMBER
--inputs 1`` repeats one of them.
"""

from __future__ import annotations

import ctypes
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

from evaluation.report import UNMET_EXIT, Bar, JsonOption, Report, Value, run
from socialbot.core.errors import ParameterError, suggestion
from tests.fuzz.decoders import Decoder, decoders
from tests.fuzz.mutations import numbered

HANG_S = 1.0
"""CPU time limit of an input."""
STUCK_S = 20.0
"""Time after which a child stuck at one input is killed."""
GROWTH_MB = 200
"""Limit for the memory growth of a child."""
GUARD_MB = 4096
"""Hard memory limit of a child, to protect the machine."""
SLICE = 5000
"""Inputs per child process."""
LOOK_S = 0.05

How = Literal["crash", "hang", "memory"]

InputsOption = Annotated[int, typer.Option(min=1, help="Number of inputs of all decoders.")]
JobsOption = Annotated[int, typer.Option(min=1, help="Number of parallel processes.")]
SeedOption = Annotated[int, typer.Option(help="Random seed of the inputs.")]
DecoderOption = Annotated[list[str] | None, typer.Option("--decoder", help="Only this decoder; repeatable.")]
FirstOption = Annotated[int, typer.Option(min=0, help="Index of the first input of each decoder.")]
KeepOption = Annotated[Path | None, typer.Option(help="Folder for inputs that caused a failure.")]


class TooLong(BaseException):
    """Input exceeded its time limit; a BaseException, so that no decoder catches it."""


@dataclass(frozen=True)
class Finding:
    """Harmful input; ``what`` is equal for all inputs that fail at the same place."""

    decoder: str
    number: int
    how: How
    what: str


@dataclass
class Tally:
    """Results of one decoder."""

    inputs: int = 0
    taken: int = 0
    cpu_s: float = 0.0
    growth_mb: float = 0.0
    longest_s: float = 0.0
    findings: list[Finding] = field(default_factory=list)

    def count(self, how: How) -> int:
        return sum(finding.how == how for finding in self.findings)

    def row(self) -> dict[str, Value]:
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
    """Inputs of one decoder: numbers from ``first`` to before ``end``."""

    decoder: Decoder
    first: int
    end: int


def peak_mb() -> float:
    """Return the peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _work(part: Slice, seed: int, at: Any, results: Connection) -> None:
    """Process the inputs of ``part`` and send findings, then the tally.

    The number of the current input is in ``at``. The child stops when its memory exceeds the limit.
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
        except Exception as error:  # noqa: BLE001 - every exception is a finding
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
    logging.disable(logging.CRITICAL)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # C libraries print warnings there
    resource.setrlimit(resource.RLIMIT_DATA, (GUARD_MB << 20, GUARD_MB << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, _too_long)
    # Free memory inherited from the parent would hide growth. So it is returned, and the peak is reset.
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", "ascii")


def _too_long(*unused: object) -> None:
    raise TooLong


def _attempt(decoder: Decoder, data: bytes) -> bool:
    signal.setitimer(signal.ITIMER_PROF, HANG_S)
    try:
        return decoder.takes(data)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"{os.sep}socialbot{os.sep}" in frame.filename] or frames
    return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno}"


class Child:
    """Child process for one slice."""

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
        """Return the tally and the next input, or None while the child works; kill a stuck child."""
        alive = self._process.is_alive()  # checked first, to read all results of an ended child below
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
    """Divide ``inputs`` evenly among decoders."""
    for index, decoder in enumerate(chosen):
        end = first + inputs // len(chosen) + (index < inputs % len(chosen))
        for begin in range(first, end, SLICE):
            yield Slice(decoder, begin, min(end, begin + SLICE))


def fuzz(parts: Sequence[Slice], seed: int, jobs: int) -> dict[str, Tally]:
    """Run all ``parts`` in ``jobs`` processes; return the tally of each decoder."""
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
    """Return the decoders called ``names``, or all.

    Raises:
        ParameterError: A name is unknown.
    """
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
    """Fuzz all decoders of foreign data, and count harmful inputs."""
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
