"""Report of ``socialbot asl test``: lines on the console, and a file in JUnit's format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from rich.console import Console
from rich.text import Text

from socialbot.cli._options import many
from socialbot.core.errors import ParameterError, SocialbotError

if TYPE_CHECKING:
    from socialbot.bdi.agentspeak import IncludePaths
    from socialbot.bdi.agentspeak.unit_tests import TestResult


def report_tests(
    files: list[Path], paths: IncludePaths, *, names: str, seconds: float, shows: bool, junit: Path | None
) -> bool:
    """Run the tests of programs and report them; return whether all passed."""
    from socialbot.bdi.agentspeak.unit_tests import TestFile

    console = Console(highlight=False, soft_wrap=True)
    results: list[TestResult] = []
    broken: list[tuple[Path, str]] = []
    for file in files:
        try:
            program = TestFile(file, paths)
        except SocialbotError as problem:
            broken.append((file, str(problem)))
            console.print(Text(str(file)))
            console.print(Text.assemble(("  error ", "bold red"), str(problem)))
            continue
        tests = [test for test in program.tests if names in test.name]
        if tests:
            console.print(Text(str(file)))
        for test in tests:
            result = program.run(test, seconds)
            results.append(result)
            _print_result(console, result, shows=shows)
    failed = sum(not result.passed for result in results)
    counts = [f"{len(results) - failed} passed", f"{failed} failed"]
    if broken:
        counts.append(f"{many(len(broken), 'file')} not run")
    console.print(f"{many(len(results), 'test')}: {', '.join(counts)}")
    if junit is not None:
        _write_junit(junit, results, broken)
    return not failed and not broken and bool(results)


def _print_result(console: Console, result: TestResult, *, shows: bool) -> None:
    word = ("  ok    ", "green") if result.passed else ("  FAIL  ", "bold red")
    console.print(Text.assemble(word, f"{result.test.name}"))
    for reason in result.reasons:
        console.print(Text(f"        {reason}"))
    if shows or not result.passed:
        for line in result.output:
            console.print(Text(f"        | {line}", style="dim"))


def _write_junit(file: Path, results: list[TestResult], broken: list[tuple[Path, str]]) -> None:
    """Write the results as JUnit XML. Raises ParameterError if the file cannot be written."""
    failures = sum(not result.passed for result in results)
    suite = ElementTree.Element(
        "testsuite",
        name="socialbot asl test",
        tests=str(len(results) + len(broken)),
        failures=str(failures),
        errors=str(len(broken)),
    )
    for result in results:
        case = ElementTree.SubElement(
            suite,
            "testcase",
            classname=str(result.test.file),
            name=result.test.name,
            line=str(result.test.line),
            time=f"{result.seconds:.3f}",
        )
        if not result.passed:
            ElementTree.SubElement(case, "failure", message=result.reasons[0]).text = "\n".join(result.reasons)
        if result.output:
            ElementTree.SubElement(case, "system-out").text = "\n".join(result.output)
    for path, problem in broken:
        case = ElementTree.SubElement(suite, "testcase", classname=str(path), name="load")
        ElementTree.SubElement(case, "error", message=problem.partition("\n")[0]).text = problem
    try:
        ElementTree.ElementTree(suite).write(file, encoding="utf-8", xml_declaration=True)
    except OSError as problem:
        raise ParameterError(f"cannot be written: {problem.strerror}", where=str(file)) from problem
