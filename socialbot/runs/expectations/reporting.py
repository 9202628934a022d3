"""Reports on expectations: reasons of failures as text, JUnit XML, and a page."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.runs.expectations.atoms import ObservedAtom
from socialbot.runs.expectations.checking import Instance, Verdict
from socialbot.runs.expectations.formulas import Eventually
from socialbot.runs.junit import TestCase, write_junit
from socialbot.runs.narration import rejected_plans
from socialbot.runs.pages import Cell, Page, Section, folded, part, table
from socialbot.runs.why import explain

if TYPE_CHECKING:
    from socialbot.runs.folder import RecordedRun

MOST_FAILURES = 5
MOST_REJECTED = 3
_ALIKE = 0.75
"""Least similarity of a name to one that was meant."""
_WILD = re.compile(r"[*?\[]")
AFTERWARDS_S = 3.0
"""Time after a trigger in which events without a plan may explain why nothing came."""

WORDS = {"passed": "passed", "failed": "FAILED", "open": "open", "untested": "untested"}


@dataclass(frozen=True)
class Checked:
    """Verdicts on one run.

    Args:
        name: Name of the run in reports.
        run: The run.
        page: Page of the run, if it was written.
        verdicts: One for each expectation.
        nearest: By name of an expectation, the nearest change of a parameter that would pass, if one is known.
    """

    name: str
    run: RecordedRun
    page: Path | None
    verdicts: Sequence[Verdict]
    nearest: dict[str, str] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        return all(each.passed for each in self.verdicts)

    @cached_property
    def known_names(self) -> frozenset[str]:
        """Names in the records and rules of the run."""
        rules = (text for texts in self.run.rules.values() for text in texts)
        recorded = (text for each in self.run.history for text in (each.what, str(each.detail.get("rule", ""))))
        return frozenset(name for text in {*rules, *recorded} for name in re.findall(r"[A-Za-z_.][\w.-]*", text))

    @cached_property
    def utterances(self) -> list[str]:
        """What agents said in the run."""
        return sorted({each.what for each in self.run.history if each.kind == "utterance"}, reverse=True)


def counted(checked: Sequence[Checked]) -> str:
    """Return the numbers of verdicts by outcome, such as ``3 passed, 1 open``."""
    outcomes = [verdict.outcome for each in checked for verdict in each.verdicts]
    return ", ".join(f"{outcomes.count(each)} {each}" for each in WORDS if each in outcomes)


def summary(verdict: Verdict) -> str:
    """Return how many instances there were, in a few words."""
    count = len(verdict.instances)
    if verdict.outcome == "untested":
        return "nothing in this run puts it to the test"
    instances = f"{count} {'instance' if count == 1 else 'instances'}"
    if verdict.outcome == "failed":
        return f"{len(verdict.failures)} of {instances}"
    if verdict.outcome == "open":
        undecided = sum(each.outcome == "open" for each in verdict.instances)
        return f"{undecided} of {instances} undecided when the run ended"
    return instances


def headline(verdict: Verdict, failure: Instance) -> str:
    """Return the moment of a failure and the expectation there."""
    who = f", {failure.text}" if failure.text else ""
    text = f"at {failure.at_s:.2f} s{who}: {verdict.expectation.text}"
    return f"{text}; {late}" if (late := lateness(verdict, failure)) else text


def lateness(verdict: Verdict, failure: Instance) -> str:
    """Return by how much an event missed its time window, and the window that would pass."""
    holds = verdict.expectation.holds
    if failure.came is None or not isinstance(holds, Eventually) or holds.window.most is None:
        return ""
    after_s = (failure.came - failure.at) / SECOND
    limit_s = holds.window.most / SECOND
    if after_s <= limit_s:
        return f"it came {after_s:.2f} s after it, too early"
    return f"it came {after_s:.2f} s after it, {after_s - limit_s:.2f} s too late; within({_up(after_s)}) would pass"


def _up(seconds: float) -> str:
    """Round up to hundredths."""
    return f"{-(-seconds * 1000 // 10) / 100:g}"


def reasons(failure: Instance, run: RecordedRun) -> list[str]:
    """Return why the moment of a failure came about, and which plans did not apply then."""
    lines: list[str] = []
    if failure.record is not None:
        explained = explain(run.history, run.wording, failure.record)
        lines += explained.text().splitlines()
        lines += [f"    not by {each.plan}: {each.because}" for each in explained.rejected[:MOST_REJECTED]]
    if failure.record is None or failure.record.kind == "detection":
        start = run.history.start + failure.at
        near = run.history.between(start, start + nanoseconds(AFTERWARDS_S))
        found = [plan for record in near if record.kind == "unhandled" for plan in rejected_plans(record)]
        lines += [f"  no plan applied; not {plan}: {why}" for plan, why in dict.fromkeys(found[:MOST_REJECTED])]
    return lines


def notes(checked: Checked, verdict: Verdict) -> Iterator[str]:
    """Yield which names in an expectation the run does not have, if one of its names is alike.

    A misspelled name makes an expectation fail, or pass, or leaves it untested.
    """
    for atom in verdict.expectation.formula.atoms():
        name = atom.name if isinstance(atom, ObservedAtom) else ""
        if not name or checked.known_names.issuperset(re.findall(r"[\w.-]+", name)):
            continue
        if atom.text.startswith("said("):
            plain = name.strip("*").casefold()
            known = {each[: len(plain)].casefold(): each for each in checked.utterances}
            is_said = any(fnmatchcase(each, name) for each in checked.utterances)
        else:
            plain, known, is_said = name, {each: each for each in checked.known_names}, False
        close = difflib.get_close_matches(plain, known, n=1, cutoff=_ALIKE)
        if close and not is_said and not _WILD.search(plain):
            yield f"nothing in this run has the name or text {name!r}; did you mean {known[close[0]]!r}?"


def moment_link(page: Path, failure: Instance, start: Path | None = None) -> str:
    """Return the address of a moment in the page of a run, relative to the folder ``start``."""
    path = page if start is None else Path(os.path.relpath(page, start))
    return f"{path}#t={failure.at_s:g}"


def text_of(checked: Checked, verdict: Verdict) -> Iterator[str]:
    """Yield the failures of a verdict as lines, with their moments and reasons."""
    for failure in verdict.failures[:MOST_FAILURES]:
        yield headline(verdict, failure)
        if checked.page is not None:
            yield f"  {moment_link(checked.page, failure)}"
        yield from (f"  {line}" for line in reasons(failure, checked.run))
    if len(verdict.failures) > MOST_FAILURES:
        yield f"and {len(verdict.failures) - MOST_FAILURES} more"
    if verdict.name in checked.nearest:
        yield f"nearest change that passes: {checked.nearest[verdict.name]}"
    if verdict.failures and verdict.expectation.reason:
        yield f"it matters because {verdict.expectation.reason}"
    yield from (f"note: {text}" for text in dict.fromkeys(notes(checked, verdict)))


def write_results(path: Path, checked: Sequence[Checked], behaviours: str) -> None:
    """Write JUnit XML: one test suite for each run. Raises ParameterError if the file cannot be written."""
    suites = {
        each.name: [
            TestCase(
                f"{behaviours}.{each.name}",
                verdict.name,
                failure=list(text_of(each, verdict)) if not verdict.passed else [],
                skipped=summary(verdict) if verdict.outcome in ("untested", "open") else "",
            )
            for verdict in each.verdicts
        ]
        for each in checked
    }
    write_junit(path, suites)


def write_results_page(path: Path, checked: Sequence[Checked], behaviours: str) -> Path:
    """Write the page of the verdicts, which links to the moments in the pages of the runs. Raises SocialbotError."""
    verdicts = [verdict for each in checked for verdict in each.verdicts]
    wrong = sum(not each.passed for each in verdicts)
    all_passed = all(each.outcome == "passed" for each in verdicts)
    page = Page(
        f"Behaviours: {behaviours}",
        "Expectations on each run, with their verdicts.",
        "all passed" if all_passed else counted(checked),
        good=not wrong,
        tiles=[(str(len(checked)), "runs"), (str(len(verdicts)), "expectations checked"), (str(wrong), "failed")],
        sections=[Section(each.name, _run_section(each, path.parent)) for each in checked],
    )
    return page.write(path)


def _run_section(checked: Checked, folder: Path) -> Markup:
    rows: list[Sequence[Cell]] = [
        (
            verdict.name,
            (WORDS[verdict.outcome].lower(), {"passed": "good", "failed": "bad"}.get(verdict.outcome, "")),
            summary(verdict),
            verdict.expectation.text,
        )
        for verdict in checked.verdicts
    ]
    parts = [table(("expectation", "verdict", "instances", "meaning"), rows)]
    for verdict in checked.verdicts:
        parts += [part("paragraph", f"{verdict.name}: note: {each}") for each in notes(checked, verdict)]
        for failure in verdict.failures[:MOST_FAILURES]:
            lines = "\n".join(reasons(failure, checked.run)) or "no record shows a reason"
            link = "" if checked.page is None else moment_link(checked.page, failure, folder)
            who = f", {failure.text}" if failure.text else ""
            content = part("failure", headline(verdict, failure), link, lines)
            parts.append(folded(f"{verdict.name} at {failure.at_s:.2f} s{who}", content, opened=True))
        if verdict.name in checked.nearest:
            nearest = checked.nearest[verdict.name]
            parts.append(part("paragraph", f"{verdict.name}: nearest change that passes: {nearest}"))
    return Markup("").join(parts)
