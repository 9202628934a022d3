from __future__ import annotations

import pytest

from socialbot.core.errors import SocialbotError
from socialbot.runs.report_page import Page, Section, folded, settings, table
from tests.runs.pages import headings, read

HOSTILE = "</script><img onerror=x>\"'&"


def test_what_is_there_is_told():
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
    for told in ("A run", "It went.", "ended well", "The camera died.", "7", "lives", "first", "a note", "seed", "4"):
        assert told in words


def test_sections_without_content_are_left_out():
    html = Page("A run", sections=[Section("One", ""), Section("Two", "<p>x</p>"), Section("Three", "<p>y</p>")]).html()
    assert headings(html) == ["Two", "Three"]
    assert html.count("<a href=") == 2


def test_what_people_wrote_is_text():
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


def test_it_is_for_light_and_dark():
    assert "prefers-color-scheme:dark" in Page("A run").html()


def test_where_it_cannot_be_written_that_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SocialbotError, match="cannot be written"):
        Page("A run").write(tmp_path / "file" / "page.html")
