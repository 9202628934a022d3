"""Write the page that compares AgentSpeak here with Jason, from its tests: ``python -m tools.conformance``."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from socialbot.bdi.stdlib import internals, usage
from tests.conformance.jason import Item, all_items
from tests.conformance.random_programs import recorded

PAGE = Path(__file__).parents[1] / "docs" / "conformance.md"
HEADING = """\
# Conformance with Jason

This page tells, for each item of Jason's standard library and syntax, whether it means the same here. It is generated
from tests (`python -m tools.conformance`): `tests/conformance/jason` contains {cases} small programs with what
Jason {version} prints for them, and the tests run them. In addition, {random} random programs of two agents print the
same there and here, in any order: `tests/conformance/random_programs.py` makes them and records the answers.
[Semantics](semantics.md) explains the language and the larger differences.

- **yes**: all programs of the item print the same.
- **differs**: some programs print something else; the table below the section tells what and why.
- **no**: the item does not exist here; a program that uses it is refused by name.
- **extra**: the item does not exist in Jason.

{yes} items are the same, {differs} differ in part, {no} do not exist.
"""

DESCRIBED = {
    ".findall": "`.findall(T, c, L)`: L is the list of T for each solution of the condition c.",
    ".setof": "`.setof(T, c, L)`: the same, sorted and each only once.",
    ".count": "`.count(c, N)`: the condition c has N solutions; `.count(c)` is a number in arithmetic.",
    ".eval": "`.eval(X, c)`: X is true or false, as the condition c.",
}


def page() -> str:
    """Text of the page."""
    items = all_items()
    cases = sum(len(item.cases) for item in items)
    counts = {status: sum(item.status == status for item in items) for status in ("yes", "differs", "no")}
    found = recorded()
    parts = [HEADING.format(cases=cases, random=len(found["answers"]), version=found["jason"], **counts)]
    for section, group in groupby(items, key=lambda item: item.section):
        found = list(group)
        parts.append(f"## {section}\n")
        parts.append("\n".join(["| item | same | |", "|---|---|---|", *map(_row, found), ""]))
        rows = [row for item in found for row in _differences(item)]
        if rows:
            heading = ["| differs in | Jason prints | here | why |", "|---|---|---|---|"]
            parts.append("\n".join([*heading, *rows, ""]))
    return "\n".join(parts)


def _row(item: Item) -> str:
    return f"| `{_cell(item.name)}` | {item.status} | {_cell(item.missing or item.extra or description(item.name))} |"


def description(name: str) -> str:
    """What an internal action does, by its docstring; empty for other items."""
    entry = internals().get(name)
    if entry is not None:
        return usage(entry)
    group = [text for text in map(description, sorted(internals())) if text.startswith(f"`{name}.")]
    return DESCRIBED.get(name, "") or "; ".join(group)


def _differences(item: Item) -> list[str]:
    return [
        f"| `{_cell(' '.join([*case.program, case.body]))}` | {_printed(case.jason)} | {_printed(case.expected)} "
        f"| {_cell(case.why)} |"
        for case in item.cases
        if case.why
    ]


def _printed(lines: list[str]) -> str:
    return ", ".join(f"`{_cell(line)}`" for line in lines) or "nothing"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
