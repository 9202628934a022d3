"""How far something has come that takes longer than a moment: a bar on the terminal, nothing elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[int], None]
"""Takes how many things are done by now."""


def unseen(done: int) -> None:
    """For who does not look."""


@contextmanager
def bar(what: str, of: str, total: int | None = None) -> Iterator[Advance]:
    """A bar on stderr for ``what``, while it is a terminal; ``total`` is how many things, None if nobody knows.

    What it gives is to be called with the number of things that are done, called ``of``.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield unseen
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(of, markup=False),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Says on stderr that ``what`` goes on, while it is a terminal."""
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status(escape(what)):
        yield
