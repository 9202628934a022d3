"""Deprecated import paths: old module and name paths of the last release keep working for one release.

``_old_names.txt`` lists, for each old module, the modules that now hold its names, and names that changed:
``old: new [new ...] | name=new_name name=module:new_name``.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

_PACKAGE = "socialbot."


class _OldPath(NamedTuple):
    """The modules that hold the names of an old module, and ``module:name`` for names that changed."""

    homes: tuple[str, ...]
    names: dict[str, str]


@cache
def old_modules() -> dict[str, _OldPath]:
    """Return the old modules by path, without ``socialbot.``."""
    table = {}
    for line in Path(__file__).with_suffix(".txt").read_text("utf-8").splitlines():
        old, _, rest = line.partition(":")
        homes, _, changed = rest.partition("|")
        table[old] = _OldPath(tuple(homes.split()), dict(pair.split("=") for pair in changed.split()))
    return table


def _lookup(old: str, stacklevel: int) -> Callable[[str], object]:
    """A ``__getattr__`` for the old module, with a warning for each name that changed."""
    homes, names = old_modules()[old]

    def __getattr__(name: str) -> object:  # noqa: N807 - the name that Python looks up
        if name in names:
            module, _, new = names[name].rpartition(":")
            home = _PACKAGE + (module or homes[0])
            _warn(f"{_PACKAGE}{old}.{name}", f"{home}.{new}", stacklevel=stacklevel)
            return getattr(import_module(home), new)
        for home in homes if not name.startswith("__") else ():
            if home != old and hasattr(found := import_module(_PACKAGE + home), name):
                return getattr(found, name)
        raise AttributeError(f"module {_PACKAGE + old!r} has no attribute {name!r}")

    return __getattr__


def _warn(old: str, new: str, *, stacklevel: int = 3) -> None:
    text = f"{old} is deprecated and will be removed in the next release; use {new}"
    warnings.warn(text, DeprecationWarning, stacklevel=stacklevel)


class _OldModule(ModuleType):
    def __call__(self, *args: object, **options: object) -> object:
        # ``socialbot.replay`` is a function now; importing the old module of that name would hide it.
        return getattr(self, self.__name__.rpartition(".")[2])(*args, **options)


class _Loader:
    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _OldModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        old = module.__name__.removeprefix(_PACKAGE)
        homes = [_PACKAGE + home for home in old_modules()[old].homes]
        if homes:
            _warn(module.__name__, " or ".join(homes))
        vars(module)["__getattr__"] = _lookup(old, 3)


class OldNamesFinder:
    """Import finder of old modules, and of old names in existing modules."""

    @classmethod
    def find_spec(cls, fullname: str, path: Sequence[str] | None, target: object = None) -> ModuleSpec | None:
        """Return the spec of an old module, or of an existing module with old names; else None."""
        if not fullname.startswith(_PACKAGE):
            return None
        old = fullname.removeprefix(_PACKAGE)
        if old not in old_modules():
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is None or spec.loader is None:  # a folder without code is left of an older checkout
            is_package = any(each.startswith(f"{old}.") for each in old_modules())
            return ModuleSpec(fullname, _Loader(), is_package=is_package)  # type: ignore[arg-type]
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            own, fallback = vars(module).get("__getattr__"), _lookup(old, 4)

            def __getattr__(name: str) -> object:  # noqa: N807 - the name that Python looks up
                if own is not None:
                    try:
                        return own(name)
                    except AttributeError:
                        pass
                return fallback(name)

            vars(module)["__getattr__"] = __getattr__

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def install() -> None:
    """Install the import finder of old names."""
    if OldNamesFinder not in sys.meta_path:
        sys.meta_path.insert(0, OldNamesFinder)
