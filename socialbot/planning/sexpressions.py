"""S-expressions: words and parentheses, the surface of PDDL, with the line each one stands in."""

from __future__ import annotations

import re
from dataclasses import dataclass

from socialbot.errors import PlanningError

DEPTH = 100
"""How deep parentheses may be nested."""

_TOKEN = re.compile(r"[()]|[^\s()]+")


@dataclass(frozen=True, slots=True)
class Word:
    """Anything without blanks and parentheses, in lower case."""

    text: str
    line: int

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Group:
    """What stands between two parentheses; ``line`` is that of the first of them."""

    items: tuple[Sexpression, ...]
    line: int

    @property
    def head(self) -> str:
        """The first word; empty if there is none."""
        return self.items[0].text if self.items and isinstance(self.items[0], Word) else ""

    @property
    def rest(self) -> tuple[Sexpression, ...]:
        """All but the first item."""
        return self.items[1:]

    def __str__(self) -> str:
        return f"({' '.join(map(str, self.items))})"


Sexpression = Word | Group


def read_sexpression(text: str, *, where: str) -> Group:
    """The one group that ``text`` consists of; comments begin with ``;``. Raises PlanningError with the line."""
    whole: Group | None = None
    end = nested = 0
    open_groups: list[tuple[int, list[Sexpression]]] = []
    for number, line in enumerate(text.lower().split("\n"), 1):
        for token in _TOKEN.findall(line.partition(";")[0]):
            if whole is not None:
                raise PlanningError(
                    f"there is more after the end: {token!r}",
                    where=f"{where}:{number}",
                    remedy=f"remove it, or the parenthesis too many before it; (define ends in line {end}",
                )
            if token == "(":
                if len(open_groups) == DEPTH:
                    raise PlanningError(f"more than {DEPTH} parentheses in each other", where=f"{where}:{number}")
                open_groups.append((number, []))
            elif not open_groups:
                raise PlanningError(
                    f"expected a parenthesis, found {token!r}",
                    where=f"{where}:{number}",
                    remedy="a file begins with (define (domain ...) or (define (problem ...)",
                )
            elif token == ")":
                begin, items = open_groups.pop()
                group = Group(tuple(items), begin)
                if open_groups:
                    open_groups[-1][1].append(group)
                else:
                    whole, end = group, number
            else:
                if token.startswith(":") and len(open_groups) > 2 and not open_groups[-1][1]:
                    nested = nested or number
                open_groups[-1][1].append(Word(token, number))
    if open_groups:
        remedy = f"add the missing ), perhaps before the section in line {nested}" if nested else "add the missing )"
        raise PlanningError("this parenthesis is never closed", where=f"{where}:{open_groups[-1][0]}", remedy=remedy)
    if whole is None:
        raise PlanningError("there is nothing in it", where=where, remedy="a file begins with (define ...")
    return whole
