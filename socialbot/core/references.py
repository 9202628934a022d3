"""References ``module:attribute`` to Python objects, which users write in files and options."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from socialbot.core.errors import GraphError, SocialbotError, described, place_of, suggestion

_SOCIALBOT = Path(__file__).parents[1]
_IN_FILE = re.compile(r":\d")  # a place with a line


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

    Installed modules take precedence over those in the working directory.

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
    except (Exception, SystemExit) as mistake:
        raise error(
            f"{failure}: {described(mistake)}",
            where=where,
            remedy=f"fix the module {module}",
        ) from mistake
    if not hasattr(loaded, attribute):
        own = [key for key, value in vars(loaded).items() if fits(value) and _is_of(loaded, value)]
        if module.partition(".")[0] in sys.stdlib_module_names:
            remedy = f"give a module of your own that is called {module} another name"
            fault = f"{failure}: {module} of Python's standard library has no {attribute!r}"
            raise error(fault, where=where, remedy=remedy)
        raise error(f"{failure}: {module} has no {attribute!r}", where=where, remedy=suggestion(attribute, own))
    return getattr(loaded, attribute)


def _is_of(module: ModuleType, value: object) -> bool:
    """Whether a class is defined in ``module``; other values count as its own."""
    return not isinstance(value, type) or value.__module__ == module.__name__


def look_in(folder: Path) -> None:
    """Let modules in ``folder`` be imported, after those that are installed."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
