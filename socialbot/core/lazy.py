"""Names that are looked up on use: lazy re-exports of a package, and renamed attributes."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any


def lazy_exports(package: str) -> Callable[[str], object]:
    """Return a module-level ``__getattr__`` for the package called ``package``.

    It imports a name of ``__all__`` on its first use, from the module that the ``if TYPE_CHECKING:`` block of the
    package imports it from.
    """

    def __getattr__(name: str) -> object:  # noqa: N807 - the name that Python looks up
        if name not in sys.modules[package].__all__:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(_homes(package)[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return __getattr__


@cache
def _homes(package: str) -> dict[str, str]:
    """Return the modules of the names that the ``if TYPE_CHECKING:`` block of a package imports."""
    import ast
    from inspect import getsource

    blocks = (part for part in ast.parse(getsource(sys.modules[package])).body if isinstance(part, ast.If))
    imports = (part for block in blocks for part in block.body if isinstance(part, ast.ImportFrom))
    return {each.name: part.module for part in imports if part.module for each in part.names}


class RenamedAttribute:
    """Old name of the attribute ``new``, with a deprecation warning."""

    def __init__(self, new: str) -> None:
        self._new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self._old = name

    def __get__(self, instance: object, owner: type) -> Any:
        text = f"{owner.__name__}.{self._old} is deprecated and will be removed in the next release; use {self._new}"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return getattr(instance or owner, self._new)
