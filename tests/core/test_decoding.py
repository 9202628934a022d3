"""Decoding to types, in several threads at once."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import pytest

from socialbot.core.decoding import from_builtins, from_json, json_decoder, msgpack_decoder

RACE = """
import dataclasses, sys, threading
from typing import Annotated

import msgspec

from socialbot.core.decoding import from_builtins, from_json, json_decoder, msgpack_decoder

sys.setswitchinterval(1e-6)
lists = Annotated[list[dict[str, int]], msgspec.Meta(max_length=5)]
fields = [(f"f{index}", lists) for index in range(20)]
value = {name: [{"a": 1}] for name, _ in fields}
DECODINGS = {
    "from_builtins": lambda kind: from_builtins(value, kind),
    "from_json": lambda kind: from_json(msgspec.json.encode(value), kind),
    "msgpack_decoder": lambda kind: msgpack_decoder(kind).decode(msgspec.msgpack.encode(value)),
    "mixed": lambda kind: (json_decoder(list[kind]), from_builtins(value, kind), msgpack_decoder(dict[str, kind])),
}
decode = DECODINGS[sys.argv[1]]
make = {"struct": msgspec.defstruct, "dataclass": dataclasses.make_dataclass}[sys.argv[2]]
found = []
for number in range(30):
    kind, together = make(f"T{number}", fields), threading.Barrier(3)
    threads = [
        threading.Thread(target=lambda: (together.wait(), found.append(decode(kind)))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
print(len(found))
"""


@pytest.mark.parametrize("decoding", ["from_builtins", "from_json", "msgpack_decoder", "mixed"])
@pytest.mark.parametrize("kind", ["struct", "dataclass"])
def test_threads_may_decode_to_a_new_type_at_once(decoding: str, kind: str) -> None:
    """With msgspec alone, nearly every first use in three threads ends the process by SIGSEGV."""
    command = [sys.executable, "-c", RACE, decoding, kind]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["90"]), done.stderr


class Point(msgspec.Struct):
    x: int


def test_decoders_check_types() -> None:
    assert from_json(b'{"x": 1}', Point) == from_builtins({"x": 1}, Point) == Point(1)
    assert msgpack_decoder(Point).decode(msgspec.msgpack.encode(Point(1))) == Point(1)
    assert from_builtins({"x": "1"}, Point, strict=False) == Point(1)
    assert json_decoder(Point) is json_decoder(Point)
    for wrong in (lambda: from_json(b'{"x": "1"}', Point), lambda: from_builtins({"x": "1"}, Point)):
        with pytest.raises(msgspec.ValidationError):
            wrong()
