"""Examples: small programs in AgentSpeak, what happens to them, and what they print or believe in the end.

A file of examples reads::

    == a belief that is added is an event
    +b(X) <- .print(X).
    -- then
    +b(1)
    -- prints
    1

After the title comes the program of the agent ``me``, after ``-- agent bob`` that of another one. After ``-- then``
come lines of what happens, one after the other: ``+b(1)[source(S)]`` is believed, ``-b(_)`` forgotten, ``!g`` wanted,
``2 s`` is time that passes; several things with ``;`` between them happen before the agent thinks. A line that begins
with ``bob:`` happens to bob. Without such lines a minute passes. What is expected is one of ``-- prints``, ``-- at``
(the same, each line after the second at which it was printed), ``-- believes``, ``-- refuses`` (the first line of the
error). Lines that begin with ``%`` are comments.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialbot.bdi import Engine
from socialbot.bdi.agentspeak import agentspeak, parse_literal
from socialbot.bdi.belief_base import is_source
from socialbot.bdi.literals import Literal
from socialbot.bdi.society import Society
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import SocialbotError

SECTION = re.compile(r"^-- (then|prints|at|believes|refuses|agent \w+)$")
MINUTE = 60 * SECOND


@dataclass
class Example:
    """One example; ``programs`` are texts by the names of agents."""

    file: str
    title: str
    programs: dict[str, str] = field(default_factory=dict)
    then: list[str] = field(default_factory=list)
    expected: dict[str, list[str]] = field(default_factory=dict)


def examples(path: Path) -> Iterator[Example]:
    """The examples of a file. Raises ValueError for one without expectations."""
    text = "\n".join(line for line in path.read_text("utf-8").splitlines() if not line.startswith("%"))
    for chunk in text.split("\n== ")[1:]:
        title, *lines = chunk.splitlines()
        example = Example(path.stem, title.strip())
        section = "agent me"
        sections: dict[str, list[str]] = {section: []}
        for line in lines:
            found = SECTION.match(line)
            if found:
                section = found[1]
                sections[section] = []
            elif line.strip():
                sections[section].append(line)
        for name, content in sections.items():
            if name.startswith("agent "):
                example.programs[name[6:]] = "\n".join(content)
            elif name == "then":
                example.then = content
            else:
                example.expected[name] = content
        if not example.expected:
            raise ValueError(f"{path.name}: {title}: nothing is expected")
        yield example


class Paper(io.TextIOBase):
    """Keeps lines that are printed, each with the second at which it was."""

    def __init__(self, clock: ManualClock) -> None:
        self.clock = clock
        self.lines: list[tuple[float, str]] = []
        self.begun = ""

    def write(self, text: str, /) -> int:
        *whole, self.begun = (self.begun + text).split("\n")
        self.lines += [(self.clock.now() / SECOND, line) for line in whole]
        return len(text)


class Stage:
    """Agents in simulated time."""

    def __init__(self, example: Example) -> None:
        self.example = example
        self.clock = ManualClock()
        self.paper = Paper(self.clock)
        self.society = Society(self.clock)
        self.agents: dict[str, Engine] = {}

    def play(self) -> dict[str, list[str]]:
        """Runs the example; returns what it expects, as it is."""
        refused: list[str] = []
        with contextlib.redirect_stdout(self.paper):
            try:
                self.act()
            except SocialbotError as error:
                refused = str(error).splitlines()[:1]
        found = {
            "prints": [self.said(line).rstrip() for _, line in self.paper.lines],
            "at": [f"{second:g} {self.said(line)}" for second, line in self.paper.lines],
            "believes": sorted(shown(held) for engine in self.agents.values() for held in engine.beliefs),
            "refuses": refused,
        }
        return {name: found[name] for name in ("refuses", *self.example.expected) if found[name] or name != "refuses"}

    def act(self) -> None:
        """Loads the programs, and lets happen what happens."""
        for name, text in self.example.programs.items():
            self.agents[name] = engine = self.society.add(name)
            equip(engine)
            engine.add_text(text, f"{name}.asl")
        self.think()
        for line in self.example.then:
            self.happens(line)
        if not self.example.then:
            self.pass_to(MINUTE)

    def said(self, line: str) -> str:
        """Return the output, with the agent's name if there are several agents."""
        return line if len(self.agents) > 1 else line.removeprefix("[me] ")

    def happens(self, line: str) -> None:
        """Lets one line happen."""
        name, colon, rest = line.partition(": ")
        engine = self.agents[name] if colon else next(iter(self.agents.values()))
        for item in (rest if colon else line).split("; "):
            if item.endswith(" s"):
                self.pass_to(self.clock.now() + round(float(item[:-2]) * SECOND))
            else:
                happens(engine, item.strip())
        self.think()

    def think(self) -> None:
        """Lets all think until nobody has anything to do."""
        while self.society.run_until_idle():
            pass

    def pass_to(self, end: int) -> None:
        """Advance the time from wakeup to wakeup of the agents."""
        while (due := self.society.next_wakeup()) is not None and due <= end:
            self.clock.set(max(due, self.clock.now()))
            self.think()
        self.clock.set(end)
        self.think()


def equip(engine: Engine) -> None:
    """Gives an agent the actions of the examples."""
    engine.add_action(lambda engine, *args: print("note", *map(agentspeak, args)), "note")
    engine.add_action(lambda engine: False, "refuse")
    engine.add_action(crash)


def crash(engine: Any, *args: Any) -> None:
    """Fails in the way programs do."""
    raise LookupError("nothing there")


def happens(engine: Engine, item: str) -> None:
    """Posts a change of beliefs, or a goal."""
    sign, literal = item[0], parse_literal(item[1:])
    if sign == "!":
        engine.achieve(literal)
        return
    sources = [str(note.args[0]) for note in literal.annotations if isinstance(note, Literal) and is_source(note)]
    others = tuple(note for note in literal.annotations if not is_source(note))
    belief: Any = literal.with_(annotations=others)
    if sign == "+":
        engine.believe(belief, source=sources[0] if sources else "self")
    else:
        engine.forget(belief)


def shown(held: Any) -> str:
    """A belief with its annotations, as AgentSpeak writes it; that it is the agent's own goes without saying."""
    sources = "" if held.sources == ("self",) else f" from {', '.join(held.sources)}"
    return f"{agentspeak(held.belief)}{sources}"
