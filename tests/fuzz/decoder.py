"""Decoder: a function of bytes that refuses bad input with a SocialbotError."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from socialbot.core.clock import SECOND
from socialbot.core.errors import SocialbotError

STAMP = 1_700_000_000 * SECOND


@dataclass(frozen=True)
class Decoder:
    """Decoder with its valid inputs as ``seeds``."""

    name: str
    decode: Callable[[bytes], object]
    seeds: tuple[bytes, ...]

    def takes(self, data: bytes) -> bool:
        """Whether ``data`` is taken; False when it is refused. Raises what a decoder must not raise."""
        try:
            self.decode(data)
        except SocialbotError as error:
            str(error)
            return False
        return True


@dataclass(frozen=True)
class StringMessage:
    """A std_msgs/String as any middleware gives it."""

    data: object


def text_of(data: bytes) -> str:
    return data.decode("utf-8", "replace")
