"""Write the page that compares AgentSpeak here with Jason, from its tests: ``python -m tools.conformance``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from socialbot.bdi.stdlib import internals, usage
from tests.conformance.jason import Case, Item, all_items
from tests.conformance.random_programs import recorded

PAGE = Path(__file__).parents[1] / "docs" / "conformance.md"
HEADING = """\
# Conformance with Jason

This page lists Jason's standard library and syntax: what each item does, and whether it means the same here.

- {yes} of {all} items are **the same**: all test programs print the same as in Jason {version}.
- {differs} are **partly different**: some programs print something else. A table in the section tells what and why.
- {no} are **missing**: a program that uses one is refused by name. {extra} are **not in Jason**.

[Differences](differences.md) has those that concern whole programs. [Semantics](semantics.md) defines the language.

Not the same: {summary}.

`tests/conformance/jason` has {cases} small programs with their output in Jason. {random} random programs of two agents
print the same, in any order (`tests/conformance/random_programs.py`). `python -m tools.conformance` writes this page
from the tests. Programs that no test has may differ.
"""

HEADINGS = {"yes": "The same", "differs": "Partly different", "no": "Missing", "extra": "Not in Jason"}
"""Status of an item, and the heading of those that have it."""

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
    heading = HEADING.format(
        summary=", ".join(filter(None, (_count(section, group) for section, group in sections))),
        all=len(items),
        **{status: sum(item.status == status for item in items) for status in HEADINGS},
        cases=cases,
        random=len(found["answers"]),
        version=found["jason"],
    )
    return "\n".join([heading, *(_section(section, group) for section, group in sections)])


def _count(section: str, items: Sequence[Item]) -> str:
    """The number of items of a section that are not as in Jason, with a link to it; empty if there is none."""
    others = sum(item.status != "yes" for item in items)
    return f"[{section.lower()}](#{section.lower().replace(' ', '-')}) {others} of {len(items)}" if others else ""


def _section(section: str, items: Sequence[Item]) -> str:
    """Text of a section: the items by their status, first those with a meaning, and the differences."""
    parts = [f"## {section}\n"]
    for status, heading in HEADINGS.items():
        those = [item for item in items if item.status == status]
        names = [_code(item.name) for item in those if not _meaning(item)]
        if lines := [f"- {meaning}" for item in those if (meaning := _meaning(item))]:
            parts.append("\n".join([f"{heading}:\n", *lines, *([f"- {'; '.join(names)}"] if names else []), ""]))
        elif names:
            parts.append(f"{heading}: {'; '.join(names)}.\n")
    if rows := _differences([case for item in items for case in item.cases if case.why]):
        parts.append("\n".join(["| program | Jason prints | here | why |", "|---|---|---|---|", *rows, ""]))
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


def _differences(cases: Sequence[Case]) -> list[str]:
    """Rows of the programs that print something else than in Jason; those that do so alike share one."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for case in cases:
        told = (_printed(case.jason), _printed(case.expected), _cell(case.why))
        rows.setdefault(told, []).append(f"`{_cell(' '.join([*case.program, case.body]))}`")
    return [f"| {'<br>'.join(programs)} | {' | '.join(told)} |" for told, programs in rows.items()]


def _printed(lines: list[str]) -> str:
    return ", ".join(f"`{_cell(line)}`" for line in lines) or "nothing"


def _code(name: str) -> str:
    """The name of an item as Markdown; a name with words and code marks its code itself."""
    return name if "`" in name else f"`{name}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
