"""Names that are looked up on use: lazy re-exports of a package, and renamed attributes."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_exports(package: str, modules: Mapping[str, str]) -> Callable[[str], object]:
    """Return a module-level ``__getattr__`` for ``package``.

    Args:
        package: ``__name__`` of the package.
        modules: Exported names of each module, separated by spaces.
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def __getattr__(name: str) -> object:  # noqa: N807 - the name that Python looks up
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return __getattr__


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
