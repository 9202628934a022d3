"""A page (HTML) that needs nothing else: what came of something, in a line and in figures, and sections that tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from socialbot.errors import SocialbotError
from socialbot.report.style import STYLE

Cells = Sequence[tuple[str, str]]
"""A row of a table: texts, each with how it is shown: r (to the right), good, bad, code, or empty."""


@dataclass(frozen=True)
class Section:
    """A part of a page: its heading, its content as HTML, and a note on how to read that, as HTML."""

    title: str
    content: str
    note: str = ""


@dataclass(frozen=True)
class Page:
    """All that is on a page. ``tiles`` are figures with what they count.

    ``warnings`` say at the top what went wrong; ``scripts`` are elements that stand behind everything else.
    """

    title: str
    lead: str = ""
    verdict: str = ""
    good: bool = True
    warnings: Sequence[str] = ()
    tiles: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = ()
    scripts: str = ""

    def html(self) -> str:
        """The page. Sections without content are left out."""
        sections = [section for section in self.sections if section.content]
        mark = f'<span class="mark{"" if self.good else " bad"}">{escape(self.verdict)}</span>' if self.verdict else ""
        parts = [
            f"<h1>{escape(self.title)}{mark}</h1>",
            *(f'<p class="warning">{escape(warning)}</p>' for warning in self.warnings),
            *([f'<p class="lead">{escape(self.lead)}</p>'] if self.lead else []),
            tiles(self.tiles),
            _contents(sections),
            *(part for number, section in enumerate(sections, 1) for part in _section(number, section)),
        ]
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f'<meta name="color-scheme" content="light dark"><title>{escape(self.title)}</title>'
        )
        body = "\n".join(filter(None, parts))
        return (
            f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n'
            f"<body><main>\n{body}\n</main>{self.scripts}</body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Writes it to ``path``. Raises SocialbotError when that is not possible."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.html(), encoding="utf-8")
        except OSError as error:
            raise SocialbotError(f"cannot be written: {error.strerror}", where=str(path)) from error
        return path


def tiles(figures: Iterable[tuple[str, str]]) -> str:
    """Figures with what they count."""
    inner = "".join(
        f'<div class="tile"><b>{escape(figure)}</b><span>{escape(what)}</span></div>' for figure, what in figures
    )
    return f'<div class="tiles">{inner}</div>' if inner else ""


def table(heads: Sequence[str], rows: Iterable[Cells], *, right: Sequence[int] = ()) -> str:
    """A table; the heads numbered in ``right`` are set to the right. The texts may hold any sign."""
    top = "".join(f'<th class="{"r" if n in right else ""}">{escape(head)}</th>' for n, head in enumerate(heads))
    lines = "".join(f"<tr>{''.join(_cell(text, kind) for text, kind in row)}</tr>" for row in rows)
    thead = f"<thead><tr>{top}</tr></thead>" if any(heads) else ""
    return wide(f"<table>{thead}<tbody>{lines}</tbody></table>")


def settings(setting: Mapping[str, object]) -> str:
    """A table of names and values."""
    return table(("", ""), ([(name, ""), (str(value), "code")] for name, value in setting.items())) if setting else ""


def wide(content: str) -> str:
    """What may be wider than the page: it scrolls by itself."""
    return f'<div class="wide" tabindex="0">{content}</div>'


def folded(summary: str, content: str, *, opened: bool = False) -> str:
    """``content`` (HTML) that is unfolded by a click on ``summary`` (text)."""
    return f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{content}</details>"


def _cell(text: str, kind: str) -> str:
    if kind == "code":
        return f"<td><code>{escape(text)}</code></td>"
    return f'<td class="{kind}">{escape(text)}</td>'


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#part-{n}">{escape(section.title)}</a>' for n, section in enumerate(sections, 1))
    return f'<nav aria-label="Contents">{links}</nav>' if len(sections) > 1 else ""


def _section(number: int, section: Section) -> Iterable[str]:
    yield f'<h2 id="part-{number}">{escape(section.title)}</h2>'
    if section.note:
        yield f'<p class="note">{section.note}</p>'
    yield section.content
