"""Pages as a reader has them."""

from __future__ import annotations

import base64
import gzip
import json
import re
from html.parser import HTMLParser
from typing import Any


class Reader(HTMLParser):
    """Collects the words of a page, and whether all that is opened is closed."""

    VOID = frozenset({"meta", "input", "br", "img", "link"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def read(html: str) -> str:
    """The words of a page, of which every element is closed, and which needs no other file."""
    reader = Reader()
    reader.feed(html)
    assert reader.open == []
    markup = re.sub(r"<(script|style)\b.*?</\1>", "", html, flags=re.DOTALL)
    assert not re.search(r"src\s*=", markup)
    assert not re.search(r'href="(?!#|data:image/jpeg)', markup)
    assert "://" not in markup.replace("http://www.w3.org/2000/svg", "")
    return " ".join(reader.words)


def headings(html: str) -> list[str]:
    """The titles of its sections."""
    return re.findall(r'<h2 id="part-[^"]*">(.*?)</h2>', html)


def unfrozen(html: str) -> dict[str, Any]:
    """The data of the run that a frozen page holds."""
    found = re.search(r'<script type="text/plain" id="data">(.*?)</script>', html)
    assert found is not None
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


def charts(html: str) -> dict[str, dict[str, Any]]:
    """The data of the charts of a page by title."""
    found = re.findall(r'<figcaption>([^<]*)</figcaption><script type="application/json">(.*?)</script>', html)
    return {title: json.loads(data) for title, data in found}


def series(html: str, title: str) -> dict[str, list[Any]]:
    """The points of the series of a chart by name."""
    return {each["name"]: each["points"] for each in charts(html)[title]["series"]}
