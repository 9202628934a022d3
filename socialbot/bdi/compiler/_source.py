"""Generated Python source: functions, their constants, and the plan step of each line."""

from __future__ import annotations

import builtins
import functools
import itertools
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from socialbot.bdi.compiler._runtime import NAMES
from socialbot.bdi.intentions import GENERATED_FILE
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.library import Library
    from socialbot.bdi.steps import Step

VALUE, CELL = "value", "cell"
"""States of a local: a ground value, or a cell that may hold an unbound variable."""

Scope = dict[str, str]
"""State, VALUE or CELL, of each variable with a local."""

MAX_NESTED = 50
"""Most conditions in each other."""

_SHALLOWER = "write the inner parts as plans or rules of their own"
_BUILTINS = {**vars(builtins), **NAMES}
_numbers = itertools.count(1)


class Unit:
    """Source of one plan or rule: functions inside a factory of the constants.

    Plans that differ only in constants share the compiled code. As a context, it adds its title to a `RuleError`.

    Attributes:
        symbols: Variables that have a `Name` instead of an atom as value.
        lenient: Whether the use of a variable without a value fails at run time, as in AgentSpeak, instead of now.
    """

    def __init__(self, title: str, library: Library, symbols: set[str], *, lenient: bool = False) -> None:
        self.library = library
        self.symbols = symbols
        self.title = title
        self.lenient = lenient
        self.functions: list[Function] = []
        self.constants: dict[str, Any] = {}
        self.dry = 0
        self._depth = 0
        self._names = itertools.count(1)

    def name(self, prefix: str) -> str:
        return f"{prefix}{next(self._names)}"

    def constant(self, value: object) -> str:
        for name, known in self.constants.items():
            if known is value:
                return name
        name = self.name("k")
        self.constants[name] = value
        return name

    def function(self, prefix: str, parameters: Iterable[str], scope: Scope) -> Function:
        function = Function(self, self.name(prefix), tuple(parameters), dict(scope))
        self.functions.append(function)
        return function

    def __enter__(self) -> Unit:
        return self

    def __exit__(self, kind: object, problem: BaseException | None, traceback: object) -> None:
        if isinstance(problem, RuleError):
            problem.where = self.title
        elif isinstance(problem, (RecursionError, MemoryError)) or "too many" in str(problem):
            raise RuleError("this is nested too deeply", where=self.title, remedy=_SHALLOWER) from problem

    def nest(self) -> None:
        """Begin a condition within a condition, which costs more to compile at each level."""
        self._depth += 1
        if self._depth > MAX_NESTED:
            raise RuleError(f"more than {MAX_NESTED} conditions in each other", remedy=_SHALLOWER)

    def unnest(self) -> None:
        """End what `nest` began."""
        self._depth -= 1

    def build(self) -> tuple[Any, dict[int, Step]]:
        """Compile the source; return the first function and the steps by line number."""
        lines = [f"def make({', '.join(self.constants)}):"]
        steps: dict[int, Step] = {}
        for function in self.functions:
            if "trail" not in function.parameters and any("trail" in text for _, text, _ in function.lines):
                function.lines.insert(0, (0, "trail = []", None))
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
    # Tracebacks read the source from the module's loader.
    loader = SimpleNamespace(get_source=lambda name: source)
    namespace = {"__builtins__": _BUILTINS, "__name__": filename, "__loader__": loader}
    exec(compile(source, filename, "exec"), namespace)
    return namespace["make"]


class Function:
    """Generated function, built line by line.

    Attributes:
        event: Arguments of the event of the plan, if its local ``args`` holds their values.
    """

    def __init__(self, unit: Unit, name: str, parameters: tuple[str, ...], scope: Scope) -> None:
        self.unit = unit
        self.name = name
        self.parameters = parameters
        self.scope = scope
        self.lines: list[tuple[int, str, Step | None]] = []
        self.depth = 0
        self.loops = 0
        self.matches = False
        self.event: tuple[object, ...] | None = None

    def line(self, text: str, step: Step | None = None) -> None:
        """Append a line; its exceptions belong to ``step``."""
        self.lines.append((self.depth, text, step))

    @contextmanager
    def block(self, head: str, step: Step | None = None) -> Iterator[None]:
        """Append ``head:`` and indent the lines of the context."""
        self.line(f"{head}:", step)
        self.depth += 1
        before = len(self.lines)
        yield
        if len(self.lines) == before:
            self.line("pass")
        self.depth -= 1

    def relation(self, key: str) -> str:
        """Emit the lookup of a relation; return its local."""
        name = self.unit.name("r")
        known = self.key(key)
        # A plain dictionary is twice as fast as a method that creates missing items.
        self.line(f"try: {name} = ag.relations[{known}]")
        self.line(f"except KeyError: {name} = ag.beliefs.relation({known})")
        return name

    def key(self, key: str) -> str:
        """Return the constant of the key of a relation or trigger; the same object as there is found faster."""
        return self.unit.constant(sys.intern(key))

    def local(self, variable: str) -> str:
        return f"v_{variable}"

    def save(self, names: Iterable[str], step: Step | None = None) -> dict[str, str]:
        """Emit copies of locals, since they change in a loop; return the copies by variable."""
        copies = {name: self.unit.name("x") for name in sorted(names)}
        for name, copied in copies.items():
            self.line(f"{copied} = {self.local(name)}", step)
        return copies

    def resolve(self, names: Iterable[str], state: str | None = None, copies: dict[str, str] | None = None) -> None:
        """Emit the resolution of locals, or of copies of them, and optionally set their state."""
        for name in sorted(names):
            convert = "plain" if name in self.unit.symbols else "resolve"
            self.line(f"{self.local(name)} = {convert}({copies[name] if copies else self.local(name)})")
            if state is not None:
                self.scope[name] = state


def tuple_of(items: Iterable[str]) -> str:
    """Return the expression of a tuple."""
    text = ", ".join(items)
    return f"({text},)" if text else "()"
