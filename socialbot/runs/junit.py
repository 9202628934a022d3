"""Test results as JUnit XML, which continuous integration services read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from socialbot.core.errors import ParameterError
from socialbot.core.paths import writing
from socialbot.core.terminal import without_controls


@dataclass(frozen=True)
class TestCase:
    """Result of one test.

    Args:
        classname: Name of its group, such as its file.
        name: Name of the test.
        seconds: Its duration.
        line: Line of the test in its file; 0 if unknown.
        failure: Reasons why it failed, the first one as a summary.
        error: Why it could not run.
        skipped: Reason why it has no result.
        output: Lines of its output.
    """

    __test__ = False

    classname: str
    name: str
    seconds: float | None = None
    line: int = 0
    failure: Sequence[str] = ()
    error: str = ""
    skipped: str = ""
    output: Sequence[str] = field(default=())


def write_junit(file: Path, suites: Mapping[str, Sequence[TestCase]]) -> None:
    """Write test suites by their names.

    Raises:
        ParameterError: The file cannot be written.
    """
    root = ElementTree.Element("testsuites")
    for name, cases in suites.items():
        counts = {
            "tests": len(cases),
            "failures": sum(bool(each.failure) for each in cases),
            "errors": sum(bool(each.error) for each in cases),
            "skipped": sum(bool(each.skipped) for each in cases),
        }
        named = {"name": without_controls(name), **{key: str(n) for key, n in counts.items()}}
        suite = ElementTree.SubElement(root, "testsuite", named)
        for case in cases:
            _add(suite, case)
    with writing(file, ParameterError):
        file.parent.mkdir(parents=True, exist_ok=True)
        ElementTree.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)


def _add(suite: ElementTree.Element, case: TestCase) -> None:
    more = {"line": str(case.line)} if case.line else {}
    if case.seconds is not None:
        more["time"] = f"{case.seconds:.3f}"
    names = {"classname": without_controls(case.classname), "name": without_controls(case.name)}
    found = ElementTree.SubElement(suite, "testcase", {**names, **more})
    if case.failure:
        text = without_controls("\n".join(case.failure))
        ElementTree.SubElement(found, "failure", message=text.partition("\n")[0]).text = text
    if case.error:
        text = without_controls(case.error)
        ElementTree.SubElement(found, "error", message=text.partition("\n")[0]).text = text
    if case.skipped:
        ElementTree.SubElement(found, "skipped", message=without_controls(case.skipped))
    if case.output:
        ElementTree.SubElement(found, "system-out").text = without_controls("\n".join(case.output))
