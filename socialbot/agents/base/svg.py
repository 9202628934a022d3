"""SVG markup for drawings of worlds, with colours for light and dark pages. Lengths are pixels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape


def style(drawing: str, tones: Mapping[str, tuple[str, str]], rules: str = "") -> str:
    """The style element of a drawing of the class ``drawing``.

    Args:
        drawing: CSS class of the svg element.
        tones: Colours by name, light and dark. Each gives the classes ``f-NAME`` (filled), ``s-NAME`` (stroke) and
            ``l-NAME`` (line without filling).
        rules: Further CSS rules.
    """

    def classes(which: int) -> str:
        return "".join(
            f".{drawing} .f-{name}{{fill:{tone[which]}}}.{drawing} .s-{name}{{stroke:{tone[which]}}}"
            f".{drawing} .l-{name}{{fill:none;stroke:{tone[which]};stroke-width:2;stroke-linecap:round}}"
            for name, tone in tones.items()
        )

    return f"<style>{classes(0)}{rules}@media(prefers-color-scheme:dark){{{classes(1)}}}</style>"


def document(drawing: str, size: tuple[float, float], title: str, parts: Iterable[str]) -> str:
    """A complete drawing of the class ``drawing``."""
    wide, high = size
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="{drawing}" viewBox="0 0 {wide:.0f} {high:.0f}" '
        f'width="{wide:.0f}" height="{high:.0f}" font-family="system-ui, sans-serif" role="img">'
    )
    return "\n".join((head, f"<title>{escape(title)}</title>", *parts, "</svg>")) + "\n"


def group(content: str, place: tuple[float, float] | None = None, *, name: str = "", kind: str = "") -> str:
    """A group of elements, moved to ``place``. A page can find and move a group with a name."""
    named = f' data-name="{escape(name)}"' if name else ""
    kinds = f' class="{kind}"' if kind else ""
    moved = "" if place is None else f' transform="translate({place[0]:.1f} {place[1]:.1f})"'
    return f"<g{named}{kinds}{moved}>{content}</g>"


def rectangle(
    x: float, y: float, wide: float, high: float, tone: str, *, rx: float = 0, width: float = 0, stroke: str = ""
) -> str:
    """A rectangle with its upper left corner; ``stroke`` is a colour that is no tone."""
    coloured = f'stroke="{stroke}" ' if stroke else ""
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{high:.1f}" rx="{rx:.1f}" class="{tone}" '
        f'{coloured}stroke-width="{width}"/>'
    )


def line(x: float, y: float, to_x: float, to_y: float, tone: str, width: float, *, opacity: float = 1.0) -> str:
    """A line with round ends."""
    faint = f' opacity="{opacity}"' if opacity < 1.0 else ""
    return (
        f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" class="{tone}" '
        f'stroke-width="{width}" stroke-linecap="round"{faint}/>'
    )


def text(
    x: float,
    y: float,
    words: str,
    *,
    size: float = 12,
    tone: str = "f-ink",
    colour: str = "",
    anchor: str = "middle",
    weight: int = 400,
) -> str:
    """A line of text; ``colour`` replaces ``tone``."""
    look = f'fill="{colour}"' if colour else f'class="{tone}"'
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:.1f}" font-weight="{weight}" {look} '
        f'text-anchor="{anchor}">{escape(words)}</text>'
    )
