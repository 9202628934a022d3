"""Output of commands. It may hold texts of strangers, so characters that control a terminal are replaced."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import rich.console
import typer
from rich.console import ConsoleOptions, RenderableType
from rich.errors import MarkupError
from rich.segment import Segment
from rich.text import Text

from socialbot.core.terminal import without_controls

WIDE = 1000
"""Width of a page for a file or pipe."""


class Console(rich.console.Console):
    """Console of rich that highlights nothing and prints only its own control sequences, not those in texts.

    Text with invalid markup is printed as it is, and markup makes no links, whose address would not be seen. Lines for
    a file or pipe are not folded, so that other programs find whole names. The variable COLUMNS changes that, but not
    together with LINES: then it is the size of a terminal, which for example pytest passes on to the programs it runs.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, **options)
        asked = "width" in options or ("COLUMNS" in os.environ and "LINES" not in os.environ)
        if not self.is_terminal and not asked:
            self.width = WIDE

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
