"""Definitions of types in a bag, of which rosbags makes Python: huge arrays, types in each other, odd names."""

from __future__ import annotations

import time

import pytest
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

from socialbot.bags.types import deserialize, type_problem

NAME = "p/msg/A"
NEXT = "\n" + "=" * 80 + "\n"
TWICE = "T1 a\nT1 b" + "".join(f"{NEXT}MSG: p/T{n}\nT{n + 1} a\nT{n + 1} b" for n in range(1, 40))
IDL = "IDL: p/msg/A\nmodule p {{ module msg {{ {}; struct A {{ octet b; }}; }}; }};"
CONSTANT = "module A_Constants {{ const long X = {}; }}"
SQUARES = " ".join(f"const long long X{n} = X{n - 1} * X{n - 1};" for n in range(1, 40))


def connection(text: str, name: str = NAME) -> Connection:
    kind = MessageDefinitionFormat.IDL if text.startswith("IDL") else MessageDefinitionFormat.MSG
    return Connection(1, "/x", name, MessageDefinition(kind, text), "", 1, ConnectionExtRosbag2("cdr", []), None)


@pytest.mark.parametrize(
    ("text", "name", "why"),
    [
        ("string[1000000000] x\n", NAME, "has more than 100000 parts"),
        (f"B[1000] x{NEXT}MSG: p/B\nC[1000] y{NEXT}MSG: p/C\nstring z\n", NAME, "has more than 100000 parts"),
        (f"{TWICE}{NEXT}MSG: p/T40\nuint8 z\n", NAME, "has more than 100000 parts"),
        (f"{TWICE}{NEXT}MSG: p/T40\nuint8[0] z\n", NAME, "has an array of 0 items"),
        ("B[] x" + "".join(f"{NEXT}MSG: p/B\nB[] x\n" for _ in range(1)), NAME, "types in each other"),
        ("A a\nA b\n", NAME, "types in each other"),
        ("uint8 a\n" * 100_000, NAME, "more than 524288 characters"),
        ("uint8 a\n", "1p/msg/A", "SyntaxError"),
        ("uint8 structure_needs_at_least_one_member\nuint8 b\n", NAME, "TypeError"),
        ("float64 X=1e999\nuint8 b\n", NAME, "NameError"),
        ("int64 a\n---\nint64 b\n", NAME, "Could not parse"),
        (IDL.format(CONSTANT.format("1 << 30000000000")), NAME, "shifted by more than 64 bits"),
        (IDL.format(CONSTANT.format("1 << (1 << 40)")), NAME, "by a calculated number"),
        (IDL.format(f"module A_Constants {{ const long long X0 = 99999; {SQUARES} }}"), NAME, "more than 64 bits"),
    ],
)
def test_an_unusable_definition_is_refused_soon(
    text: str, name: str, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    begun = time.process_time()
    problem = type_problem(connection(text, name))
    assert problem is not None
    assert problem.what == "is unknown"
    assert why in caplog.text
    assert len(caplog.text) < 1000
    assert not any("\n" in record.getMessage() for record in caplog.records)
    assert time.process_time() - begun < 3.0


def test_usual_definitions_are_used() -> None:
    arrays = f"string[3] names\nfloat64[1000000] numbers\nB[] parts\nB[2] pair{NEXT}MSG: p/B\nstring z\n"
    constant = IDL.format(CONSTANT.format("-3"))
    for text in (arrays, constant, *(IDL.format(CONSTANT.format(value)) for value in ("1 << 3", "9999 * 9999"))):
        assert type_problem(connection(text)) is None
    assert deserialize(connection(constant), b"\0\1\0\0\7\0\0\0").b == 7


def test_definitions_in_idl_with_includes_are_used() -> None:
    """rosbag2 records those of packages without .msg files, such as of event cameras and of Autoware."""
    own = (
        "// generated from rosidl_adapter/resource/msg.idl.em\n\n"
        '#include "p/msg/B.idl"\n#include "std_msgs/msg/Header.idl"\n\n'
        'module p { module msg { @verbatim (language="comment", text="# of it")\n'
        "struct A { std_msgs::msg::Header header; p::msg::B part; }; }; };\n"
    )
    part = "  #pragma once\nmodule p { module msg { struct B { octet b; }; }; };\n"
    one = connection(f"IDL: p/msg/A\n{own}{'=' * 80}\nIDL: p/msg/B\n{part}")
    assert type_problem(one) is None
    data = b"\0\1\0\0" + bytes(8) + b"\4\0\0\0eye\0" + b"\7"
    found = deserialize(one, data)
    assert (found.header.frame_id, found.part.b) == ("eye", 7)
