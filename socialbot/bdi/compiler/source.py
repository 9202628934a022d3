"""Generated Python source: units of functions, their constants, and which line belongs to which step."""

from __future__ import annotations

import builtins
import functools
import itertools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from socialbot.bdi.compiler.runtime import NAMES
from socialbot.bdi.intentions import GENERATED_FILE
from socialbot.bdi.terms import Atom

if TYPE_CHECKING:
    from socialbot.bdi.library import Library
    from socialbot.bdi.steps import Step

VALUE, CELL = "value", "cell"
"""What a local holds: a value without variables; or perhaps a variable that has no value yet."""

Scope = dict[str, str]
"""VALUE or CELL for each variable that has a local."""

_BUILTINS = {**vars(builtins), **NAMES}
_numbers = itertools.count(1)


class Unit:
    """The source of one plan or rule: several functions within one that is given the constants.

    Plans that differ in constants only have the same source, and share its code.
    """

    def __init__(self, title: str, library: Library) -> None:
        self.library = library
        self.title = title
        self.functions: list[Function] = []
        self.constants: dict[str, Any] = {}
        self.dry = 0
        self._names = itertools.count(1)

    def name(self, prefix: str) -> str:
        """A name that is not taken."""
        return f"{prefix}{next(self._names)}"

    def constant(self, value: object) -> str:
        """An expression for a constant."""
        for name, known in self.constants.items():
            if known is value:
                return name
        name = self.name("k")
        self.constants[name] = value
        return name

    def function(self, prefix: str, parameters: Iterable[str], scope: Scope) -> Function:
        """Begins a function."""
        function = Function(self, self.name(prefix), tuple(parameters), dict(scope))
        self.functions.append(function)
        return function

    def build(self) -> tuple[Any, dict[int, Step]]:
        """Compiles it: the first function, and the steps by line."""
        lines = [f"def make({', '.join(self.constants)}):"]
        steps: dict[int, Step] = {}
        for function in self.functions:
            lines.append(f"    def {function.name}({', '.join(function.parameters)}):")
            for depth, text, step in function.lines:
                lines.append("    " * (depth + 2) + text)
                if step is not None:
                    steps[len(lines)] = step
        lines.append(f"    return {self.functions[0].name}\n")
        return _make("\n".join(lines))(*self.constants.values()), steps


@functools.lru_cache(maxsize=10_000)
def _make(source: str) -> Any:
    filename = f"{GENERATED_FILE} {next(_numbers)}"
    # A traceback asks the loader of a frame's module for the source.
    namespace = {"__builtins__": _BUILTINS, "__name__": filename, "__loader__": _SourceLoader(source)}
    exec(compile(source, filename, "exec"), namespace)
    return namespace["make"]


class _SourceLoader:
    def __init__(self, source: str) -> None:
        self.source = source

    def get_source(self, name: str) -> str:
        return self.source


class Function:
    """One generated function, written line by line."""

    def __init__(self, unit: Unit, name: str, parameters: tuple[str, ...], scope: Scope) -> None:
        self.unit = unit
        self.name = name
        self.parameters = parameters
        self.scope = scope
        self.lines: list[tuple[int, str, Step | None]] = []
        self.depth = 0
        self.loops = 0

    def line(self, text: str, step: Step | None = None) -> None:
        """Writes a line; an exception in it is one of ``step``."""
        self.lines.append((self.depth, text, step))

    @contextmanager
    def block(self, head: str, step: Step | None = None) -> Iterator[None]:
        """Writes ``head:`` and indents what follows."""
        self.line(f"{head}:", step)
        self.depth += 1
        before = len(self.lines)
        yield
        if len(self.lines) == before:
            self.line("pass")
        self.depth -= 1

    def relation(self, key: str) -> str:
        """Writes the look-up of a relation; returns the local that holds it."""
        name = self.unit.name("r")
        # A plain dictionary is twice as fast as a method that creates missing items.
        self.line(f"try: {name} = ag.relations[{key!r}]")
        self.line(f"except KeyError: {name} = ag.beliefs.relation({key!r})")
        return name

    def local(self, variable: str) -> str:
        """The Python name of a variable."""
        return f"v_{variable}"


def simple(value: object) -> bool:
    """Whether a constant is compared by identity."""
    return value.__class__ is Atom


def tuple_of(items: Iterable[str]) -> str:
    """The expression of a tuple."""
    text = ", ".join(items)
    return f"({text},)" if text else "()"
