"""Fuzzing finds, counts and survives crashes, hangs and memory growth."""

from __future__ import annotations

import mmap
import os
import signal
import time

import pytest

from evaluation import fuzz
from evaluation.fuzz import Finding, Tally
from socialbot.core.errors import ParameterError, SocialbotError
from tests.fuzz.decoders import Decoder
from tests.fuzz.mutations import numbered

SEEDS = (b"0123456789" * 3,)
INPUTS = 6


def harmful(data: bytes) -> None:
    """Fail in another way for each of the first inputs."""
    number = next(number for number in range(INPUTS) if numbered("harmful", 1, number, SEEDS) == data)
    match number:
        case 0:
            raise ValueError("not for people")
        case 1:
            while True:
                pass
        case 2:
            os.kill(os.getpid(), signal.SIGKILL)
        case 3:
            time.sleep(60)
        case 4:
            raise SocialbotError("refused")


def fuzzed(decoder: Decoder, inputs: int) -> Tally:
    return fuzz.fuzz(list(fuzz.slices([decoder], inputs, 0)), 1, 1)[decoder.name]


@pytest.fixture(autouse=True)
def short_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "HANG_S", 0.1)
    monkeypatch.setattr(fuzz, "STUCK_S", 3.0)
    monkeypatch.setattr(fuzz, "LOOK_S", 0.01)


def test_each_kind_of_harm_is_counted_and_fuzzing_continues() -> None:
    tally = fuzzed(Decoder("harmful", harmful, SEEDS), INPUTS)
    assert tally.inputs == INPUTS
    assert {finding.number: (finding.how, finding.what.partition(" at ")[0]) for finding in tally.findings} == {
        0: ("crash", "ValueError"),
        1: ("hang", "TooLong"),
        2: ("crash", "the process ended with -9"),
        3: ("hang", "stuck for 3 s"),
    }
    assert tally.taken == 1


def test_memory_that_grows_is_counted_and_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "GROWTH_MB", 30)
    kept: list[mmap.mmap] = []

    def keep(data: bytes) -> None:
        """Take new memory from the system, and not some that malloc has kept."""
        kept.append(mmap.mmap(-1, 60 << 20))
        for page in range(0, 60 << 20, mmap.PAGESIZE):
            kept[-1][page] = 1

    tally = fuzzed(Decoder("greedy", keep, SEEDS), 7)
    assert tally.inputs == 7
    assert [finding.how for finding in tally.findings] == ["memory"] * len(tally.findings)
    assert 3 <= len(tally.findings) <= 7


def test_inputs_are_shared_out_evenly() -> None:
    decoders = [Decoder(name, harmful, SEEDS) for name in "abc"]
    parts = list(fuzz.slices(decoders, 30_002, 5))
    assert sum(part.end - part.first for part in parts) == 30_002
    assert [part.first for part in parts if part.decoder.name == "b"] == [5, 5005, 10_005]


def test_an_unknown_decoder_is_named() -> None:
    with pytest.raises(ParameterError, match="did you mean 'graph'"):
        fuzz.choose(["grap"])


def test_harmful_inputs_are_saved(tmp_path) -> None:
    [decoder] = fuzz.choose(["plan"])
    fuzz._kept(tmp_path / "found", [Finding("plan", 3, "hang", "")], 1)
    assert (tmp_path / "found" / "plan-3-hang").read_bytes() == numbered("plan", 1, 3, decoder.seeds)
