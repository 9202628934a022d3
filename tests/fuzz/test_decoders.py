from __future__ import annotations

import random
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import SocialbotError
from socialbot.core.registry import message_types
from tests.fuzz import quick
from tests.fuzz.decoders import Decoder, decoders
from tests.fuzz.examples import structured
from tests.fuzz.mutations import LARGEST, mutated, numbered

NAMES = [decoder.name for decoder in decoders()]
SLOW = {"bag-mcap", "bag-db3", "bag-metadata", "beliefs", "desires", "rules", "graph", "deployment", "waldo"}

LONG_RUNS = {"run-waldo", "run-hospital", "run-values"}
"""A short run, run-plans, is read by the same code."""

WORST_CPU_S = 1.0


@pytest.fixture(params=NAMES)
def decoder(request: pytest.FixtureRequest) -> Decoder:
    return next(decoder for decoder in decoders() if decoder.name == request.param)


def survives(decoder: Decoder, data: bytes) -> None:
    """Check that ``data`` is accepted or refused, within the time limit."""
    begun = time.process_time()
    decoder.takes(data)
    assert time.process_time() - begun < WORST_CPU_S, f"{data[:50]!r} and so on"


def test_output_of_socialbot_is_accepted(decoder: Decoder) -> None:
    for seed in decoder.seeds:
        decoder.decode(seed)


@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.slow) for part in range(1, 5))])
def test_mutated_inputs_are_accepted_or_refused(decoder: Decoder, part: int) -> None:
    # A run is opened, explained, frozen into a page and exported.
    count = 2 if decoder.name.startswith("run-") else 6 if decoder.name in SLOW else 30
    for number in range(part * count, (part + 1) * count):
        survives(decoder, numbered(decoder.name, 0, number, decoder.seeds))


def test_any_bytes_are_taken_or_refused(decoder: Decoder) -> None:
    share = 15 if decoder.name.startswith("run-") else 5

    @settings(quick, max_examples=settings().max_examples // share)
    @given(st.binary(max_size=200) | st.text(max_size=100).map(lambda text: text.encode("utf-8", "replace")))
    def holds(data: bytes) -> None:
        survives(decoder, data)

    holds()


JSON, OTHERS = (b"[", b'{"a":', b"9", b'"', b"\xff"), (b"{", b"(", b"- ", b"a: {", b"/* ", b" ", b"~")


def check_repeated(decoder: Decoder, units: tuple[bytes, ...]) -> None:
    for unit in units:
        for begin in (b"", *decoder.seeds[:1]):
            survives(decoder, begin + unit * (10_000 // len(unit)))


@pytest.mark.parametrize(
    "decoder",
    [pytest.param(name, marks=pytest.mark.slow) if name in LONG_RUNS else name for name in NAMES],
    indirect=True,
)
def test_nested_or_long_inputs_are_refused_in_time(decoder: Decoder) -> None:
    check_repeated(decoder, JSON if decoder.name.startswith("run-") else JSON + OTHERS)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("run-")])
def test_runs_of_other_formats_than_json_are_refused_in_time(name: str) -> None:
    check_repeated(next(decoder for decoder in decoders() if decoder.name == name), OTHERS)


@settings(quick, max_examples=60)
@given(st.randoms(use_true_random=False), st.lists(st.binary(min_size=1, max_size=30), min_size=1, max_size=3))
def test_an_input_is_never_too_long_and_the_same_for_the_same_number(chance: random.Random, seeds: list[bytes]) -> None:
    assert len(mutated(chance, seeds)) <= LARGEST
    assert numbered("any", 1, 7, seeds) == numbered("any", 1, 7, seeds)


def test_numbers_and_names_make_other_inputs() -> None:
    seeds = (bytes(range(200)),)
    made = {numbered(name, 1, number, seeds) for name in ("a", "b") for number in range(50)}
    assert len(made) > 90


def test_there_is_an_example_of_every_schema() -> None:
    assert [type(message) for message in structured()] == list(message_types())


def test_a_decoder_distinguishes_refusals_from_faults() -> None:
    def decode(data: bytes) -> None:
        if data == b"bad":
            raise SocialbotError("no")
        if data == b"worse":
            raise ValueError("worse")

    decoder = Decoder("any", decode, (b"good",))
    assert decoder.takes(b"good")
    assert not decoder.takes(b"bad")
    with pytest.raises(ValueError, match="worse"):
        decoder.takes(b"worse")
