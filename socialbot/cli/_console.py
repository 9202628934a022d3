"""Output of commands. It may hold texts of strangers, so characters that control a terminal are replaced."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import rich.console
import typer
from rich.console import ConsoleOptions, RenderableType
from rich.errors import MarkupError
from rich.segment import Segment
from rich.text import Text

from socialbot.core.terminal import without_controls

WIDE = 1000
"""Width of a page for a file or pipe."""

LOST = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of an output on a full or broken disk, or on a terminal that is gone."""


STDOUT = "standard output"


class Output:
    """Stdout whose errors name it, unlike those of Python, or that drops what cannot be written (``lossy``).

    A live graph goes on without its output, and writes again when it can.
    """

    def __init__(self, output: TextIO, *, lossy: bool = False) -> None:
        self._output, self._lossy = output, lossy

    def __getattr__(self, name: str) -> Any:
        return getattr(self._output, name)

    def write(self, text: str) -> int:
        with self._guarded():
            self._output.write(text)
        return len(text)

    def flush(self) -> None:
        with self._guarded():
            self._output.flush()

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno not in LOST or not self._lossy:
                error.filename = STDOUT
                raise


class Console(rich.console.Console):
    """Console of rich that highlights nothing and prints only its own control sequences, not those in texts.

    Text with invalid markup is printed as it is, and markup makes no links, whose address would not be seen. Lines for
    a file or pipe are not folded, so that other programs find whole names. The variable COLUMNS changes that, but not
    together with LINES: then it is the size of a terminal, which for example pytest passes on to the programs it runs.
    With ``lossy``, it is a console on stdout that drops what cannot be written.
    """

    def __init__(self, *, lossy: bool = False, **options: Any) -> None:
        if lossy and sys.stdout is not None:
            options["file"] = Output(sys.stdout, lossy=True)
        super().__init__(highlight=False, **options)
        asked = "width" in options or ("COLUMNS" in os.environ and "LINES" not in os.environ)
        if not self.is_terminal and not asked:
            self.width = WIDE

    def print_address(self, server: str, url: str) -> None:
        """Print the URL of a server. Only a terminal gets its token: files and journals are kept."""
        shown = url if self.is_terminal else url.partition("?")[0]
        self.print(f"{server}: [bold]{shown}[/]{'' if shown == url else ' (and the token)'}", soft_wrap=True)

    def print_plain(self, text: str, style: str | None = None) -> None:
        """Print plain text without folding its lines."""
        self.print(text, style=style, soft_wrap=True, markup=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            style = segment.style.update_link(None) if segment.style and segment.style.link else segment.style
            yield segment if segment.control else Segment(without_controls(segment.text), style)

    def render_str(self, text: str, **options: Any) -> Text:
        try:
            return super().render_str(text, **options)
        except MarkupError:
            return super().render_str(text, **{**options, "markup": False})


def print_line(text: Any = "", *, nl: bool = True, err: bool = False) -> None:
    """Print text on stdout, or on stderr."""
    typer.echo(without_controls(str(text)), nl=nl, err=err)
