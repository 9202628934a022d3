"""References ``module:attribute`` to Python objects, which users write in files and options."""

from __future__ import annotations

import importlib
import re
import sys
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from socialbot.core.errors import GraphError, SocialbotError, described, place_of, suggestion
from socialbot.core.process import EndedBySignal

_SOCIALBOT = Path(__file__).parents[1]
_IN_FILE = re.compile(r":\d")  # a place with a line
_STANDARD = Path(sysconfig.get_path("stdlib"))
_INSTALLED = {"site-packages", "dist-packages"}  # folders of other modules below that of the standard library

_records: ContextVar[tuple[Path, ...]] = ContextVar("records", default=())
"""Folders of data, whose modules are not imported."""


@contextmanager
def reading_record(folder: Path) -> Iterator[None]:
    """Import no module of ``folder`` within the block, even if it is the working directory."""
    token = _records.set((*_records.get(), folder.resolve()))
    try:
        yield
    finally:
        _records.reset(token)


def load_reference(
    reference: str,
    what: str,
    fits: Callable[[object], bool],
    *,
    name: str = "",
    where: str = "",
    places: str = "into the working directory",
    error: type[SocialbotError] = GraphError,
) -> Any:
    """Import the object of a reference ``module:attribute`` that a user wrote.

    Installed modules take precedence over those in the working directory. Modules of Python's standard library and
    programs (``package.__main__``) are not imported: some of them act when they are.

    Args:
        reference: Reference.
        what: Noun of the object for error messages, such as "node type".
        fits: Whether an object of the module could be meant, for suggestions.
        name: Name of the object for error messages; default: the reference.
        where: Place of the reference, for error messages.
        places: Where a module may lie that is not installed, for error messages.
        error: Class of the error that is raised if the module or the attribute cannot be loaded.
    """
    module, _, attribute = reference.partition(":")
    if module.partition(".")[0] != "socialbot":
        look_in(Path.cwd())
    failure = f"cannot load {what} {name or reference!r}"
    if fault := _fault(module, attribute):
        raise error(f"{failure}: {fault.what}", where=where, remedy=fault.remedy)
    try:
        loaded = importlib.import_module(module)
    except ModuleNotFoundError as missing:
        if missing.name is None or not f"{module}.".startswith(f"{missing.name}."):
            remedy = f"install {missing.name}, which {module} imports, where socialbot is installed"
            raise error(f"{failure}: {missing}", where=where, remedy=remedy) from missing
        remedy = f"install it, or put it {places}"
        raise error(f"{failure}: there is no module {missing.name!r}", where=where, remedy=remedy) from missing
    except SocialbotError as mistake:
        if _IN_FILE.search(mistake.where or ""):
            raise error(f"{failure}: {mistake.what}", where=mistake.where, remedy=mistake.remedy) from mistake
        what = f"{mistake.where}: {mistake.what}" if mistake.where else mistake.what
        place = place_of(mistake, str(_SOCIALBOT))
        what = f"{what} ({place})" if place else what
        raise error(f"{failure}: {what}", where=where, remedy=mistake.remedy) from mistake
    except EndedBySignal:
        raise
    except (Exception, SystemExit) as mistake:
        raise error(
            f"{failure}: {described(mistake)}",
            where=where,
            remedy=f"fix the module {module}",
        ) from mistake
    if not hasattr(loaded, attribute):
        own = [key for key, value in vars(loaded).items() if fits(value) and _is_of(loaded, value)]
        raise error(f"{failure}: {module} has no {attribute!r}", where=where, remedy=suggestion(attribute, own))
    return getattr(loaded, attribute)


def _fault(module: str, attribute: str) -> SocialbotError | None:
    """Why a module must not be imported; None if it may be."""
    first, *inner = module.split(".")
    if "__main__" in inner:
        return SocialbotError(f"{module} is a program", remedy="name a module")
    try:
        spec = find_spec(first)
    except ValueError:  # no name, or this program
        return None
    found = (spec.submodule_search_locations or [spec.origin or ""]) if spec is not None else []
    places = [Path(place).resolve() for place in found]
    if first in sys.stdlib_module_names or any(map(_is_standard, places)):
        remedy = f"give a module of your own that is called {module} another name"
        return SocialbotError(f"{module} of Python's standard library has no {attribute!r} of this kind", remedy=remedy)
    for folder in _records.get():
        if any(place.is_relative_to(folder) for place in places):
            what = f"{module} lies in the record {folder}, whose modules are not imported"
            return SocialbotError(what, remedy="move it to another folder, and start socialbot there, if you trust it")
    return None


def _is_standard(place: Path) -> bool:
    return place.is_relative_to(_STANDARD) and not _INSTALLED & set(place.parts)


def _is_of(module: ModuleType, value: object) -> bool:
    """Whether a class is defined in ``module``; other values count as its own."""
    return not isinstance(value, type) or value.__module__ == module.__name__


_added: set[str] = set()
"""Folders beside those of installed modules."""


def look_in(folder: Path) -> None:
    """Let modules in ``folder`` be imported, after those that are installed."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
        _added.add(str(folder))


def installed_places(package: str) -> list[Path]:
    """Folders of an installed package, which is not imported. Those of `look_in` do not count.

    Raises:
        ValueError: The name is empty.
    """
    spec = find_spec(package)
    found = [Path(place) for place in (spec.submodule_search_locations or ())] if spec is not None else []
    return [place for place in found if str(place.parent) not in _added]
