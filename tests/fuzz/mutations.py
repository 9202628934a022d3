"""Inputs that are nearly right: what socialbot itself writes, with something changed."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

LARGEST = 1 << 16
"""Bytes of the longest input."""

DEEP = 3000
"""So often what can be nested is nested: more than Python calls go deep."""

TOKENS = (
    b"NaN", b"-Infinity", b"1e999", b"-1", b"0", b"18446744073709551616", b"9223372036854775807", b"9" * 400,
    b"0.1e-400", b"null", b"true", b'""', b"[]", b"{}", b"\\ud800", b"\\u0000", b"\x00", b"\xff", b"\xf0\x9f\xa4\x96",
    b"\xed\xa0\x80", b"\r\n", b"\t", b"'", b'"', b"\\", b"&a [*a]", b"*a", b"!!python/object:os.system", b"!x", b"? ",
    b": ", b"- ", b"#", b"%", b"---\n", b"<<: ", b"(", b")", b"(not ", b"~", b"/*", b"//", b"../../etc/passwd",
    b"{x}", b"2001-99-99",
)  # fmt: skip
NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, (1 << 63) - 1, (1 << 64) - 1)
NESTED = (b"[", b"{", b'{"a":', b"(", b"- ", b"[1,", b"not ", b"-", b"(and ", b"f(", b"a: {", b"/* ")

Change = Callable[[random.Random, bytearray, Sequence[bytes]], None]


def _flip(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)


def _set(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    data[chance.randrange(len(data))] = chance.randrange(256)


def _number(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    """A length, an offset, a time that lies."""
    width, at = chance.choice((1, 2, 4, 4, 8)), chance.randrange(len(data))
    number = chance.choice(NUMBERS) & ((1 << 8 * width) - 1)
    data[at : at + width] = number.to_bytes(width, chance.choice(("little", "big")))


def _cut(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    del data[chance.randrange(len(data)) :]


def _remove(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    begin, end = _span(chance, data)
    del data[begin:end]


def _repeat(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    begin, end = _span(chance, data)
    data[end:end] = data[begin:end] * chance.choice((1, 1, 2, 5, 50))


def _swap(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    begin, end = _span(chance, data)
    part = data[begin:end]
    del data[begin:end]
    at = chance.randrange(len(data) + 1)
    data[at:at] = part


def _splice(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    other = chance.choice(seeds)
    begin, end = _span(chance, other or b" ")
    at = chance.randrange(len(data))
    data[at : at + chance.choice((0, end - begin))] = other[begin:end]


def _word(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    """Insert an unusual token, or replace one."""
    begin, end = _span(chance, data)
    data[begin : chance.choice((begin, end))] = chance.choice(TOKENS)


def _figure(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    """Another number or word where one was written."""
    at = chance.randrange(len(data))
    while at < len(data) and not chr(data[at]).isalnum():
        at += 1
    end = at
    while end < len(data) and chr(data[end]).isalnum():
        end += 1
    data[at:end] = chance.choice(TOKENS)


def _nest(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    at = chance.randrange(len(data))
    data[at:at] = chance.choice(NESTED) * chance.choice((3, 30, DEEP))


def _lengthen(chance: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    at = chance.randrange(len(data))
    data[at:at] = bytes([data[at]]) * chance.choice((100, 10_000, LARGEST))


_USUAL: tuple[Change, ...] = (
    _flip, _set, _number, _cut, _remove, _repeat, _swap, _splice, _word, _figure,
)  # fmt: skip
_RARE: tuple[Change, ...] = (_nest, _lengthen)


def _span(chance: random.Random, data: bytes | bytearray) -> tuple[int, int]:
    """A part of ``data``, mostly a short one."""
    begin = chance.randrange(len(data))
    length = min(chance.expovariate(1 / chance.choice((4, 40, 400))), len(data))
    return begin, min(len(data), begin + 1 + int(length))


def mutated(chance: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the ``seeds``, changed in one place or in several; now and then anything at all."""
    if chance.random() < 0.01:
        return chance.randbytes(chance.randrange(200))
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
        if not data:
            data += b"\x00"
        chance.choice(_RARE if chance.random() < 0.03 else _USUAL)(chance, data, seeds)
    return bytes(data[:LARGEST])


def numbered(name: str, seed: int, number: int, seeds: Sequence[bytes]) -> bytes:
    """Input ``number`` of those for the decoder ``name``: always the same."""
    return mutated(random.Random(f"{name} {seed} {number}"), seeds)
