"""Deeds that a run can be asked about, and the names and arguments of their calls."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field

from socialbot.core.vocabulary import Deed
from socialbot.runs.asking._words import name_tokens, tokens

Phrase = tuple[str, ...]

_ARGUMENT = re.compile(r'"([^"]*)"|([^\s,()]+)')
SAYING = {"say", "speak", "tell", "utter", "announce"}


@dataclass(frozen=True)
class Topic:
    """Deed that can be asked about: a goal, an action, or what a vocabulary declares.

    ``calls`` are names, or calls with their first arguments. A phrase of ``words`` must occur as a whole; of ``loose``
    phrases the first word counts most.
    """

    name: str
    calls: tuple[str, ...]
    words: Mapping[str, tuple[Phrase, ...]] = field(default_factory=dict)
    opposites: Mapping[str, tuple[Phrase, ...]] = field(default_factory=dict)
    loose: tuple[Phrase, ...] = ()
    declared: Deed | None = None

    @property
    def concerns_people(self) -> bool:
        """Whether the deed has to do with people: its sentences name them, or it has none."""
        told = self.declared.did.values() if self.declared is not None else ()
        return not told or any(
            "{person}" in one for pair in told for one in ([pair] if isinstance(pair, str) else pair)
        )

    @property
    def names_people(self) -> bool:
        """Whether its sentences name people."""
        return self.declared is not None and bool(self.declared.did) and self.concerns_people

    @property
    def is_saying(self) -> bool:
        """Whether the deed is to say words that its name has: ``say("Come in")``."""
        return bool(SAYING.intersection(name_tokens(functor_of(self.name)))) and "(" in self.name

    @property
    def named_by_argument(self) -> Set[Phrase]:
        """Phrases that have only the argument of its call: Bob, of ``check("Bob")``."""
        texts = () if self.is_saying or self.declared is not None else arguments_of(self.name)
        return {tuple(tokens(text)) for text in texts}

    @property
    def call_names(self) -> Set[str]:
        """Names of the calls that it covers."""
        return {call_name(each) for each in self.calls}

    def covers(self, call: str) -> bool:
        """Return whether ``call`` (``name(argument, ...)``, quotes do not count) is this deed."""
        plain = call.replace('"', "")
        name, _, arguments = plain.rstrip(")").partition("(")
        for each in self.calls:
            wanted, _, first = each.replace('"', "").rstrip(")").partition("(")
            if wanted == name and (not first or [*split(arguments)][: len([*split(first)])] == [*split(first)]):
                return True
        return False


def call_name(call: str) -> str:
    return call.replace('"', "").rstrip(")").partition("(")[0]


def functor_of(text: str) -> str:
    return text.lstrip("~").partition("(")[0]


def split(arguments: str) -> Iterator[str]:
    """Yield the arguments of a call."""
    return (quoted or plain for quoted, plain in _ARGUMENT.findall(arguments))


def arguments_of(text: str) -> tuple[str, ...]:
    """Return the arguments of a literal, a call or a plan step as text without quotes."""
    inner = text.strip("()").partition(" ")[2] if text.startswith("(") else text.partition("(")[2].rpartition(")")[0]
    return tuple(split(inner or text.partition(" ")[2]))
