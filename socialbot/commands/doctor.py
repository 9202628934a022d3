"""``socialbot doctor``: whether the installation is well, and what to do where it is not."""

from __future__ import annotations

import json
import textwrap
from collections import Counter
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from socialbot.doctor import examine
from socialbot.errors import InstallationError
from socialbot.findings import Finding

STYLES = {"ok": "green", "warning": "yellow", "error": "bold red"}
NAME_COLUMNS = 14
INDENT = " " * (len("warning ") + NAME_COLUMNS + 1)
WIDEST = 100


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Leave out sending pictures over DDS.")] = False,
) -> None:
    """Examine the installation; say how to mend what is missing. Exit code 5 when something is."""
    console = Console(highlight=False)
    findings: list[Finding] = []
    with console.status("examining"):
        for finding in examine(quick=quick):
            findings.append(finding)
            if not as_json:
                console.print(_paragraph(finding, min(console.width, WIDEST)), soft_wrap=True)
    count = Counter(finding.state for finding in findings)
    if as_json:
        report = {"schema": "socialbot/doctor", "version": 1, "findings": [asdict(each) for each in findings]}
        typer.echo(json.dumps(report, indent=2))
    else:
        console.print(f"\n{count['ok']} ok, {_many(count['warning'], 'warning')}, {_many(count['error'], 'error')}")
    if count["error"]:
        raise typer.Exit(InstallationError.exit_code)


def _paragraph(finding: Finding, width: int) -> Text:
    head = f"{finding.state:7} {finding.name:{NAME_COLUMNS}} "
    text = Text(_wrapped(head + finding.text, width))
    text.stylize(STYLES[finding.state], 0, len(finding.state))
    text.stylize("bold", len("warning "), len(head))
    if finding.remedy:
        text.append("\n" + _wrapped(INDENT + f"remedy: {finding.remedy}", width), style="cyan")
    return text


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _wrapped(text: str, width: int) -> str:
    # Long words are commands and paths to be copied; they stay whole.
    return textwrap.fill(text, width, subsequent_indent=INDENT, break_long_words=False, break_on_hyphens=False)
