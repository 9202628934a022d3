"""Write the page that compares AgentSpeak here with Jason, from its tests: ``python -m tools.conformance``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from socialbot.bdi.stdlib import internals, usage
from tests.conformance.jason import Item, all_items
from tests.conformance.random_programs import recorded

PAGE = Path(__file__).parents[1] / "docs" / "conformance.md"
HEADING = """\
# Conformance with Jason

This page is the list of Jason's standard library and syntax: what each item does, and whether it means the same here.
[Semantics](semantics.md) explains the language and the larger differences.

| section | yes | differs | no | extra |
|---|---|---|---|---|
{summary}

- **yes**: all programs of the item print the same.
- **differs**: some programs print something else. The second table of the section tells what and why.
- **no**: the item does not exist here. A program that uses it is refused by name.
- **extra**: the item does not exist in Jason.

The tests compare socialbot with Jason {version}. `tests/conformance/jason` has {cases} small programs with their output
in Jason. {random} random programs of two agents print the same, in any order (`tests/conformance/random_programs.py`).
`python -m tools.conformance` writes this page from the tests. Programs that no test has may differ.
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
    sections = [(section, list(group)) for section, group in groupby(items, key=lambda item: item.section)]
    found = recorded()
    cases = sum(len(item.cases) for item in items)
    summary = "\n".join([*(_counts(section, group) for section, group in sections), _counts("all", items)])
    heading = HEADING.format(summary=summary, cases=cases, random=len(found["answers"]), version=found["jason"])
    return "\n".join([heading, *(_section(section, group) for section, group in sections)])


def _counts(section: str, items: Sequence[Item]) -> str:
    counts = (sum(item.status == status for item in items) or "" for status in ("yes", "differs", "no", "extra"))
    return f"| {' | '.join([section, *map(str, counts)])} |"


def _section(section: str, items: Sequence[Item]) -> str:
    """Text of a section: a table of the items with a meaning, the names of the others, and the differences."""
    rows = [f"| {_cell(text)} | {item.status} |" for item in items if (text := _meaning(item))]
    parts = [f"## {section}\n"]
    if rows:
        parts.append("\n".join(["| item | same |", "|---|---|", *rows, ""]))
    for status, label in (("yes", "The same"), ("differs", "Partly different")):
        if names := [_code(item.name) for item in items if item.status == status and not _meaning(item)]:
            parts.append(f"{label}: {'; '.join(names)}.\n")
    if rows := [row for item in items for row in _differences(item)]:
        parts.append("\n".join(["| differs in | Jason prints | here | why |", "|---|---|---|---|", *rows, ""]))
    return "\n".join(parts)


def _meaning(item: Item) -> str:
    """What an item does, behind its name; empty if the name says it."""
    text = item.missing or item.extra or description(item.name)
    return text if not text or text.startswith(f"`{item.name}") else f"{_code(item.name)}: {text}"


def description(name: str) -> str:
    """What an internal action does, by its docstring; empty for other items."""
    entry = internals().get(name)
    if entry is not None:
        return usage(entry)
    group = [text.rstrip(".") for text in map(description, sorted(internals())) if text.startswith(f"`{name}.")]
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


def _code(name: str) -> str:
    """The name of an item as Markdown; a name with words and code marks its code itself."""
    return name if "`" in name else f"`{name}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
