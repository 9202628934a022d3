"""Messages of every schema, made from what the schema says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from socialbot.core.messages import Structured
from socialbot.core.registry import message_types


def example(kind: inspect.Type, depth: int = 0) -> Any:
    """Plain data that fits ``kind``; lists and what may be left out are filled down to some depth."""
    match kind:
        case inspect.Metadata():
            return example(kind.type, depth)
        case inspect.StructType():
            fields = {
                field.encode_name: example(field.type, depth + 1)
                for field in kind.fields
                if field.required or depth < 5
            }
            return {kind.tag_field: kind.tag, **fields} if kind.tag_field else fields
        case inspect.UnionType():
            kinds = [each for each in kind.types if not isinstance(each, inspect.NoneType)]
            return example(kinds[0], depth)
        case inspect.VarTupleType() | inspect.ListType() | inspect.SetType() | inspect.FrozenSetType():
            return [example(kind.item_type, depth + 1)] * 2 if depth < 6 else []
        case inspect.TupleType():
            return [example(each, depth + 1) for each in kind.item_types]
        case inspect.DictType():
            return {example(kind.key_type, depth): example(kind.value_type, depth + 1)}
        case inspect.LiteralType():
            return kind.values[0]
        case inspect.StrType():
            return "box_a"
        case inspect.BoolType():
            return True
        case inspect.IntType():
            return int(max(1, kind.ge or 0))
        case inspect.FloatType():
            return 0.5
        case _:
            return "anything"


def structured() -> Iterator[Structured]:
    """A message of each schema that comes with socialbot."""
    for kind in message_types():
        yield msgspec.convert(example(inspect.type_info(kind)), kind)
