"""Pages from templates: escaping, tables and charts."""

from __future__ import annotations

import hashlib
import io
import re
import struct

import cv2
import numpy as np
import pytest
from rich.console import Console

from socialbot.core.errors import ParameterError
from socialbot.runs.bag_images import BlurredPictures
from socialbot.runs.pages import PAGE, Page, Section, Table, bundle, folded, series_charts, settings, table, thumbnail
from socialbot.runs.run import Picture
from tests.runs.pages import charts, headings, read, series

HOSTILE = "</script><img onerror=x>\"'&"


def test_page_shows_all_of_its_parts():
    words = read(
        Page(
            "A run",
            lead="It went.",
            verdict="ended well",
            warnings=["The camera died."],
            tiles=[("7", "lives")],
            sections=[Section("One", "<p>first</p>", "a note"), Section("Two", settings({"seed": 4}))],
        ).html()
    )
    for text in ("A run", "It went.", "ended well", "The camera died.", "7", "lives", "first", "a note", "seed", "4"):
        assert text in words


def test_page_omits_sections_without_content():
    html = Page("A run", sections=[Section("One", ""), Section("Two", "<p>x</p>"), Section("Three", "<p>y</p>")]).html()
    assert headings(html) == ["Two", "Three"]
    assert html.count("<a href=") == 2


def test_page_escapes_text():
    page = Page(
        HOSTILE,
        lead=HOSTILE,
        verdict=HOSTILE,
        warnings=[HOSTILE],
        tiles=[(HOSTILE, HOSTILE)],
        sections=[
            Section(HOSTILE, table((HOSTILE,), [[(HOSTILE, "")], [(HOSTILE, "code")]])),
            Section("two", folded(HOSTILE, settings({HOSTILE: HOSTILE}))),
        ],
    )
    html = page.html()
    assert "<img" not in html
    assert "</script>" not in html
    assert read(html).count(HOSTILE) == 15


def test_page_supports_light_and_dark():
    assert "prefers-color-scheme:dark" in Page("A run").html()


def test_unwritable_file_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match=r"cannot be written.*\n.*check the folder"):
        Page("A run").write(tmp_path / "file" / "page.html")


def huge_jpeg() -> bytes:
    """A JPEG that claims 3.6 gigapixels."""
    data = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    at = data.index(b"\xff\xc0") + 5
    return data[:at] + struct.pack(">HH", 60_000, 60_000) + data[at + 4 :]


@pytest.mark.parametrize("image", [huge_jpeg(), b"", b"text"], ids=["huge", "empty", "text"])
def test_an_image_that_cannot_be_decoded_has_no_thumbnail(image):
    assert thumbnail(image) is None

    class Source:
        def at(self, stamp: int) -> Picture:
            return Picture(stamp, image)

    assert BlurredPictures(Source(), lambda stamp: np.zeros((0, 4))).at(7) is None


def test_table_column_becomes_a_chart():
    rows = {f"{n} rooms": {"</script>s": 0.5 * n, "what": "x", "same": 1, "ok": True} for n in (10, 50, 200)}
    html = Page("A run", sections=[Section("One", series_charts(rows))]).html()
    read(html)
    assert list(charts(html)) == ["&lt;/script&gt;s"]
    assert series(html, "&lt;/script&gt;s") == {"</script>s": [[10, 5.0], [50, 25.0], [200, 100.0]]}


@pytest.mark.parametrize("names", [("a", "b", "c"), ("3", "1", "2"), ("1", "2")])
def test_table_without_ascending_numbers_has_no_charts(names):
    assert series_charts(dict(zip(names, ({"s": n} for n in range(3)), strict=False))) == ""


def test_bundle_holds_every_imported_module():
    main = bundle("main.js", charts=True, instead=(("api.js", "frozen.js"),))
    modules = set(re.findall(r'"(page/[\w.]+)":', main.imports))
    served = {f"page/{path.name}" for path in PAGE.glob("*.js")} - {"page/frozen.js", "page/document.js"}
    assert modules == served
    assert "http" not in main.imports


def test_bundled_chart_library_is_the_one_that_the_notice_names():
    notice = (PAGE / "vendor/NOTICE").read_text("utf-8")
    for name in ("uPlot.iife.min.js", "uPlot.min.css"):
        assert hashlib.sha256((PAGE / "vendor" / name).read_bytes()).hexdigest() in notice


def test_a_table_for_the_terminal_shows_brackets_and_the_first_rows():
    cells = Table(("setting", "bag"), [("camera.size=[1, 2]", ("[bold]", "bad")), *[("x", 1.5)] * 3])
    shown = io.StringIO()
    Console(width=60, file=shown).print(cells.terminal(2))
    assert [line.split() for line in shown.getvalue().splitlines()] == [
        ["setting", "bag"],
        ["camera.size=[1,", "2]", "[bold]"],
        ["x", "1.5"],
        ["..."],
    ]
