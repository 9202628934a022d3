"""JUnit XML of test results."""

from __future__ import annotations

from xml.etree import ElementTree

from socialbot.runs.junit import TestCase, write_junit


def test_texts_with_control_characters_can_be_read(tmp_path):
    text = "\x1b[31mred\x1b[0m\tand\x00zero\ufffe\ud800"
    case = TestCase(text, text, failure=["first", text], error=text, skipped=text, output=[text])
    write_junit(tmp_path / "results.xml", {text: [case]})
    found = ElementTree.parse(tmp_path / "results.xml").getroot().find("testsuite/testcase")
    assert found is not None
    shown = "?[31mred?[0m\tand?zero??"
    assert [(each.tag, each.get("message"), each.text) for each in found] == [
        ("failure", "first", f"first\n{shown}"),
        ("error", shown, shown),
        ("skipped", shown, None),
        ("system-out", None, shown),
    ]
