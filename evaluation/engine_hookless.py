"""Engine without the trace hook, to measure the cost of an unused hook.

The modules of `socialbot.bdi` are imported a second time. Every ``sink is None`` in them and in their generated code is
replaced by its value without a sink.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import importlib.machinery
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import CodeType, ModuleType
from typing import Any

import evaluation.engine_programs
import socialbot

PACKAGE = "socialbot.bdi"
PROGRAMS = "evaluation.engine_programs"


@contextmanager
def hookless() -> Iterator[Any]:
    """Import the engine without the hook inside the block.

    Yields `evaluation.engine_programs` for that engine.
    """
    usual = _modules()
    package = socialbot.bdi  # type: ignore[attr-defined]
    programs = sys.modules.pop(PROGRAMS)
    for name in usual:
        del sys.modules[name]
    finder = _Finder()
    sys.meta_path.insert(0, finder)
    try:
        yield importlib.import_module(PROGRAMS)
    finally:
        sys.meta_path.remove(finder)
        for name in _modules():
            del sys.modules[name]
        sys.modules.update({**usual, PROGRAMS: programs})
        socialbot.bdi = package  # type: ignore[attr-defined]
        evaluation.engine_programs = programs  # type: ignore[assignment]


def without_hook(source: str) -> ast.Module:
    """Return the syntax tree of a module without checks for the sink."""
    return ast.fix_missing_locations(_Strip().visit(ast.parse(source)))


def _modules() -> dict[str, ModuleType]:
    return {name: module for name, module in sys.modules.items() if name == PACKAGE or name.startswith(f"{PACKAGE}.")}


class _Finder:
    def find_spec(self, name: str, path: Sequence[str] | None, target: Any = None) -> Any:
        if name != PACKAGE and not name.startswith(f"{PACKAGE}."):
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(name, spec.origin)
        return spec


class _Loader(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType:
        return compile(without_hook(self.get_data(self.path).decode()), self.path, "exec", dont_inherit=True)

    def exec_module(self, module: ModuleType) -> None:
        if module.__name__ == f"{PACKAGE}.compiler._source":
            module.__dict__["compile"] = _compile
        super().exec_module(module)


def _compile(source: str, filename: str, mode: str) -> CodeType:
    return builtins.compile(without_hook(source), filename, mode, dont_inherit=True)


class _Strip(ast.NodeTransformer):
    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        """Replace a check for the sink by its value; the compiler of Python removes the branch that is never taken."""
        if ast.unparse(node).endswith((".sink is None", ".sink is not None")):
            return ast.Constant(isinstance(node.ops[0], ast.Is))
        return node
