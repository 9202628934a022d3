"""Project files of Jason (``.mas2j``): the agents of a multi-agent system and their environment."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

from socialbot.bdi.agentspeak.lexer import AgentSpeakError, Source
from socialbot.bdi.agentspeak.parser import parse_term
from socialbot.bdi.agentspeak.programs import IncludePaths, Program, read_program, read_text
from socialbot.bdi.literals import Literal, literal
from socialbot.bdi.stdlib._agents import free_name
from socialbot.bdi.terms import Atom
from socialbot.core.errors import RuleError

DEFAULT_FOLDERS = (".", "src/asl", "src/agt", "asl")
"""Folders of programs, relative to the project, that are searched after those of the project."""

_NOTED = ("infrastructure", "executionControl", "classpath", "directives")
_CLASSES = ("agentArchClass", "agentClass", "beliefBaseClass")
_END = ""
_TOKEN = re.compile(r'"(?:[^"\\\n]|\\.)*"|[A-Za-z_]\w*|[0-9]+(?:\.[0-9]+)?|\S')
_COMMENT = re.compile(r'("(?:[^"\\\n]|\\.)*")|//[^\n]*|/\*.*?\*/', re.DOTALL)


@dataclass(frozen=True)
class ProjectAgent:
    """Agents of a project with one program: ``alice #3`` gives ``alice1`` to ``alice3``.

    The ``names`` differ from those of other agents: ``bob_1`` is a second ``bob``. ``beliefs`` and ``goals`` are added
    to those of the program. The prints of a ``raw`` agent have neither its name nor an end of line.
    """

    names: tuple[str, ...]
    file: Path
    beliefs: tuple[Literal, ...] = ()
    goals: tuple[Literal, ...] = ()
    raw: bool = False


@dataclass(frozen=True)
class Project:
    """Multi-agent system of a project file.

    Attributes:
        name: Name of the system.
        agents: Its agents, in the order of the file.
        environment: Python class ``module:Class`` or name of a Java class, if any.
        arguments: Arguments of the environment.
        folders: Folders of programs and included files.
        notes: What the file asks for and has no effect here, a sentence each.
    """

    name: str
    agents: tuple[ProjectAgent, ...]
    environment: str | None = None
    arguments: tuple[Any, ...] = ()
    folders: tuple[Path, ...] = ()
    notes: tuple[str, ...] = field(default=())


def read_project(file: Path) -> Project:
    """Read a project file.

    Raises:
        AgentSpeakError: The file has a mistake, or the program of an agent does not exist.
        RuleError: The file cannot be read.
    """
    return _ProjectParser(read_text(file), file).project()


def program_of(agent: ProjectAgent, paths: IncludePaths) -> Program:
    """Parse the program of an agent, with the beliefs and goals of the project. Raises AgentSpeakError."""
    program = read_program(agent.file, paths)
    return replace(program, beliefs=program.beliefs + agent.beliefs, goals=program.goals + agent.goals)


class _ProjectParser:
    def __init__(self, text: str, file: Path) -> None:
        self.file = file
        self.source = Source("", str(file))
        self.source.text = text
        bare = _COMMENT.sub(lambda found: found[1] or re.sub(r"[^\n]", " ", found[0]), text)
        found = list(_TOKEN.finditer(bare))
        self.words = [match[0] for match in found] + [_END]
        self.places = [match.start() for match in found] + [len(text.rstrip())]
        self.at = 0
        self.notes: list[str] = []
        self.folders: list[Path] = []
        self.environment: str | None = None
        self.arguments: tuple[Any, ...] = ()

    def error(self, what: str, remedy: str | None = None, at: int | None = None) -> AgentSpeakError:
        return self.source.error_at(self.places[self.at if at is None else at], what, remedy)

    def fail(self, expected: str, remedy: str | None = None) -> NoReturn:
        word = self.words[self.at]
        raise self.error(f"expected {expected}, found {repr(word) if word else 'the end of the file'}", remedy)

    def take(self, word: str) -> bool:
        """Skip a token if it is the next one."""
        found = self.words[self.at] == word
        self.at += found
        return found

    def skip(self, word: str) -> None:
        if not self.take(word):
            self.fail(repr(word))

    def name(self, what: str) -> str:
        word = self.words[self.at]
        if not (word[:1].isalpha() or word[:1] == "_"):
            self.fail(what)
        self.at += 1
        return word

    def project(self) -> Project:
        if self.words[self.at] != "MAS":
            self.fail("'MAS'", "a project begins with MAS name {")
        self.at += 1
        name = self.name("the name of the system")
        self.skip("{")
        entries: list[tuple[int, dict[str, Any]]] = []
        while not self.take("}"):
            section = self.name("a section, such as agents, or '}'")
            self.skip(":")
            if section == "agents":
                while self.words[self.at] not in ("}", _END) and self.words[self.at + 1] != ":":
                    entries.append((self.at, self.agent()))
            elif section == "environment":
                self.environment, self.arguments = self.class_name()
                self.host("the environment")
            elif section == "aslSourcePath":
                self.folders += [self.file.parent / text for text in self.strings()]
            elif section in _NOTED:
                start = self.at
                while self.words[self.at] not in ("}", _END) and self.words[self.at + 1] != ":":
                    self.at += 1
                shown = "".join(self.words[start : self.at]).rstrip(";")
                self.notes.append(f"{section} {shown} is ignored")
            else:
                self.at -= 2
                self.fail("a section: agents, environment, aslSourcePath, infrastructure, executionControl, classpath")
        if self.words[self.at] != _END:
            self.fail("the end of the file")
        self.folders += [self.file.parent / folder for folder in DEFAULT_FOLDERS]
        taken: set[str] = set()
        agents = tuple(self.found(at, entry, taken) for at, entry in entries)
        folders = tuple(dict.fromkeys(self.folders))
        return Project(name, agents, self.environment, self.arguments, folders, tuple(self.notes))

    def strings(self) -> list[str]:
        found = []
        while self.words[self.at][:1] == '"':
            found.append(self.string())
            self.take(";")
        return found

    def string(self) -> str:
        word = self.words[self.at]
        if word[:1] != '"' or len(word) < 2:
            self.fail("a text in double quotes")
        self.at += 1
        return re.sub(r"\\(.)", r"\1", word[1:-1])

    def host(self, what: str) -> None:
        if self.take("at"):
            self.notes.append(f"the host {self.string()} of {what} is ignored")

    def agent(self) -> dict[str, Any]:
        """Read ``name file.asl [options] agentClass x #3;``."""
        entry: dict[str, Any] = {"name": self.name("the name of an agent"), "count": 1}
        entry["file"] = self.program_file() or f"{entry['name']}.asl"
        if self.take("["):
            while True:
                self.option(entry)
                if not self.take(","):
                    break
            self.skip("]")
        while not self.take(";"):
            word = self.words[self.at]
            if word in _CLASSES:
                self.at += 1
                kind, _ = self.class_name()
                self.notes.append(f"{word} {kind} of {entry['name']} is Java and is ignored")
            elif self.take("#"):
                count = self.words[self.at]
                if not count.isdecimal() or len(count) > 9 or int(count) < 1:
                    self.fail("the number of agents, from 1")
                entry["count"] = int(count)
                self.at += 1
            elif word == "at":
                self.host(entry["name"])
            else:
                self.fail("';' after an agent")
        return entry

    def program_file(self) -> str:
        """Read the optional path of a program; its ending is optional."""
        start = self.at
        while self.words[self.at] not in ("[", "#", ";", "}", "at", _END, *_CLASSES):
            self.at += 1
        text = "".join(self.words[start : self.at]).replace("\\", "/")
        return text if not text or "." in text.rpartition("/")[2] else f"{text}.asl"

    def option(self, entry: dict[str, Any]) -> None:
        name = self.name("the name of an option")
        self.skip("=")
        at = self.at
        if name in ("beliefs", "goals"):
            entry[name] = self.literals(self.string(), at)
            return
        self.at += 1
        if name == "verbose" and self.words[at] == "0":
            entry["raw"] = True
            return
        self.notes.append(f"the option {name}={self.words[at]} of {entry['name']} is ignored")

    def literals(self, text: str, at: int) -> tuple[Literal, ...]:
        try:
            terms = parse_term(f"[{text}]", "<option>")
        except AgentSpeakError as problem:
            raise self.error(f"the option cannot be read: {problem}", at=at) from None
        found = tuple(literal(term.name) if isinstance(term, Atom) else term for term in terms)  # type: ignore[union-attr]
        if not all(isinstance(item, Literal) for item in found):
            raise self.error("expected literals separated by commas", at=at)
        return found  # type: ignore[return-value]

    def class_name(self) -> tuple[str, tuple[Any, ...]]:
        """Read a class of Java (``house.Env``) or Python (``house:Env``), with optional arguments."""
        text = self.name("the name of a class")
        while self.words[self.at] in (".", ":") and (self.words[self.at + 1][:1].isalpha()):
            text += self.words[self.at] + self.words[self.at + 1]
            self.at += 2
        args: tuple[Any, ...] = ()
        if self.take("("):
            start, depth = self.at, 1
            while depth and self.words[self.at] != _END:
                depth += {"(": 1, ")": -1}.get(self.words[self.at], 0)
                self.at += 1
            inner = self.source.text[self.places[start] : self.places[self.at - 1]]
            try:
                args = parse_term(f"[{inner}]", "<arguments>")  # type: ignore[assignment]
            except AgentSpeakError:
                args = (inner,)
        return text, args

    def found(self, at: int, entry: dict[str, Any], taken: set[str]) -> ProjectAgent:
        """Find the program of an agent, and names for it that are not ``taken`` yet."""
        places = [folder / entry["file"] for folder in self.folders]
        file = next((place for place in places if os.path.isfile(place)), None)
        if file is None:
            tried = ", ".join(map(str, dict.fromkeys(places)))
            raise self.error(f"the program {entry['file']} of {entry['name']} does not exist", f"tried: {tried}", at)
        extra = {name: entry[name] for name in ("beliefs", "goals", "raw") if name in entry}
        name, count = entry["name"], entry["count"]
        names = []
        for wanted in [name] if count == 1 else [f"{name}{number}" for number in range(1, count + 1)]:
            names.append(free_name(wanted, taken))
            taken.add(names[-1])
        return ProjectAgent(tuple(names), file, **extra)


def environment_of(project: Project) -> str | None:
    """Return the Python class of the environment, if any. Raises RuleError for one in Java."""
    name = project.environment
    if name is None or ":" in name:
        return name
    raise RuleError(
        f"the environment {name} is a class of Java",
        remedy="write it in Python, and give --environment module:Class, or environment: module:Class in the project",
    )
