"""Progress on stderr, if it is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def bar(what: str, of: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar for ``what``; call the result with the number of finished items, and perhaps a new text.

    ``of`` is the name of the items, ``total`` their number, if known.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    texts = TextColumn("{task.description}", markup=False), TextColumn(of, markup=False)
    columns = (texts[0], BarColumn(), MofNCompleteColumn(), texts[1], TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done, what=None: progress.update(task, completed=done, description=what)
