"""Report of ``socialbot asl test``: lines on the console, and a file in JUnit's format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text

from socialbot.cli._console import Console
from socialbot.cli._options import many
from socialbot.core.errors import SocialbotError
from socialbot.runs.junit import TestCase, write_junit

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
        write_junit(junit, {"socialbot asl test": _cases(results, broken)})
    return not failed and not broken and bool(results)


def _print_result(console: Console, result: TestResult, *, shows: bool) -> None:
    word = ("  ok    ", "green") if result.passed else ("  FAIL  ", "bold red")
    console.print(Text.assemble(word, f"{result.test.name}"))
    for reason in result.reasons:
        console.print(Text(f"        {reason}"))
    if shows or not result.passed:
        for line in result.output:
            console.print(Text(f"        | {line}", style="dim"))


def _cases(results: list[TestResult], broken: list[tuple[Path, str]]) -> list[TestCase]:
    cases = [
        TestCase(
            str(result.test.file),
            result.test.name,
            result.seconds,
            result.test.line,
            failure=() if result.passed else result.reasons,
            output=result.output,
        )
        for result in results
    ]
    return [*cases, *(TestCase(str(path), "load", error=problem) for path, problem in broken)]
