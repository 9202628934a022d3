"""What the engine has to do, said as plainly as can be.

Beliefs are a list, intentions are generators, a failing goal is an exception. In one turn the agent
looks at one event, then makes one step of one intention; intentions take turns.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import Literal

Plan = Generator[int, None, None]
"""Yields before each step: the seconds to sleep first."""


@dataclass(frozen=True)
class Atom:
    """A name with one argument; "X" is the one variable there is. "s" is a singleton, "r" an event only."""

    name: str
    arg: int | str

    def bound(self, x: int | None) -> Atom:
        assert x is not None or self.arg != "X"
        return replace(self, arg=x) if self.arg == "X" and x is not None else self


@dataclass(frozen=True)
class Check:
    atom: Atom
    negated: bool


@dataclass(frozen=True)
class Step:
    kind: Literal["do", "add", "remove", "goal", "fail", "wait"]
    atom: Atom


@dataclass(frozen=True)
class Plain:
    """A rule: when ``kind`` happens to ``head`` and all tests hold, do the body."""

    kind: Literal["added", "removed", "wanted", "failed"]
    head: Atom
    tests: tuple[Check, ...]
    body: tuple[Step, ...]


class Failed(Exception):  # noqa: N818 - what it says
    pass


class Reference:
    def __init__(self, rules: list[Plain]) -> None:
        self.rules = rules
        self.now = 0
        self.done: list[str] = []
        self.beliefs: list[Atom] = []
        self.events: list[tuple[str, Atom]] = []
        self.ready: list[Iterator[int]] = []
        self.asleep: list[tuple[int, Plan]] = []

    def believe(self, atom: Atom) -> None:
        if atom in self.beliefs:
            return
        if atom.name == "s":
            for other in [belief for belief in self.beliefs if belief.name == "s"]:
                self.forget(other)
        if atom.name != "r":
            self.beliefs.append(atom)
        self.announce("added", atom)

    def forget(self, atom: Atom) -> None:
        if atom in self.beliefs:
            self.beliefs.remove(atom)
            self.announce("removed", atom)

    def achieve(self, goal: Atom) -> None:
        self.proceed(self.pursue(goal))

    def announce(self, kind: str, atom: Atom) -> None:
        if any((rule.kind, rule.head.name) == (kind, atom.name) for rule in self.rules):
            self.events.append((kind, atom))

    def turn(self) -> None:
        while self.asleep and self.asleep[0][0] <= self.now:
            self.proceed(self.asleep.pop(0)[1])
        if self.events:
            chosen = self.choose(*self.events.pop(0))
            if chosen is not None:
                if chosen[0].body:
                    self.proceed(self.perform(*chosen))
                else:
                    self.ready.append(iter(()))  # nothing to do takes a turn, too
        if self.ready:
            self.proceed(self.ready.pop(0))

    def proceed(self, plan: Iterator[int]) -> None:
        """Makes the step that ``plan`` is ready for, and puts it in line for its next one."""
        try:
            pause = next(plan)
        except (StopIteration, Failed):
            return
        if pause:
            assert isinstance(plan, Generator)
            self.asleep.append((self.now + pause, plan))
            self.asleep.sort(key=lambda sleeper: sleeper[0])
        else:
            self.ready.append(plan)

    def pursue(self, goal: Atom) -> Plan:
        try:
            plan = self.choose("wanted", goal)
            if plan is None:
                raise Failed
            yield from self.perform(*plan)
        except Failed:
            plan = self.choose("failed", goal)
            if plan is None:
                raise
            yield from self.perform(*plan)

    def perform(self, rule: Plain, x: int | None) -> Plan:
        for step in rule.body:
            yield 0
            atom = step.atom.bound(x)
            if step.kind == "do":
                self.done.append(f"{atom.name}{atom.arg}")
            elif step.kind == "add":
                self.believe(atom)
            elif step.kind == "remove":
                self.forget(atom)
            elif step.kind == "goal":
                yield from self.pursue(atom)
            elif step.kind == "wait":
                yield int(atom.arg)
            else:
                raise Failed

    def choose(self, kind: str, atom: Atom) -> tuple[Plain, int | None] | None:
        for rule in self.rules:
            if (rule.kind, rule.head.name) == (kind, atom.name) and rule.head.arg in ("X", atom.arg):
                x = int(atom.arg) if rule.head.arg == "X" else None
                for solution in self.solutions(rule.tests, x):
                    return rule, solution
        return None

    def solutions(self, tests: tuple[Check, ...], x: int | None) -> Iterator[int | None]:
        if not tests:
            yield x
            return
        atom, rest = tests[0].atom, tests[1:]
        variable = atom.arg == "X"
        wanted = x if variable else atom.arg
        found = [belief for belief in self.beliefs if belief.name == atom.name and wanted in (None, belief.arg)]
        if tests[0].negated:
            if not found:
                yield from self.solutions(rest, x)
        else:
            for belief in found:
                yield from self.solutions(rest, int(belief.arg) if variable else x)
