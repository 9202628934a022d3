"""Conformance cases: short programs with what Jason prints for them, by item of its language and library.

A file of cases reads::

    # Lists
    == .delete
    .delete(1, 3, [a,b,c,a], L); .print(L)
      jason: [a,a]
    | b(1). b(2).
    .nth(7, [a], X)
      jason: failed internal_action
      here: failed wrong_arguments
      why: one reason for all wrong arguments

A line with ``#`` begins a section of the page, ``==`` an item. A case is the body of a plan, after lines of the program
with ``|``. ``jason:`` is the output of Jason by line, ``here:`` the output of this engine if it differs, ``why:`` the
reason. An item without cases has ``not:`` and the reason why it does
not exist here, or ``extra:`` if it does not exist in Jason. ``failed E`` is the failure of the plan with ``error(E)``.

    python -m tests.conformance.jason "COMMAND" [ITEM...]

runs the cases in Jason itself and writes the lines ``jason:``. COMMAND runs a project file, given as its last argument,
in the current folder, and prints lines such as ``[agent] text``.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

FOLDER = Path(__file__).with_name("jason")


@dataclass
class Case:
    """Program of one goal with the output of Jason, the output of socialbot, and the reason of a difference."""

    body: str
    program: list[str] = field(default_factory=list)
    jason: list[str] = field(default_factory=list)
    here: list[str] | None = None
    why: str = ""

    @property
    def text(self) -> str:
        """Whole program; `.print` marks its lines, to tell them from messages of the interpreter."""
        extra = "\n".join(self.program)
        text = f'!go.\n{extra}\n+!go <- {self.body}.\n-!go[error(E)] <- .print("failed ", E).\n'
        return re.sub(r"\.print\(", '.print("> ",', text)

    @property
    def expected(self) -> list[str]:
        return self.jason if self.here is None else self.here


@dataclass
class Item:
    """Construct or internal action of Jason."""

    name: str
    section: str
    cases: list[Case] = field(default_factory=list)
    missing: str = ""
    extra: str = ""

    @property
    def status(self) -> str:
        if self.missing or self.extra:
            return "no" if self.missing else "extra"
        return "differs" if any(case.why for case in self.cases) else "yes"


def read(path: Path) -> list[Item]:
    items: list[Item] = []
    section, program = "", []
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        text = line.strip()
        if not text:
            continue
        if line.startswith("# "):
            section = line[2:]
        elif line.startswith("== "):
            items.append(Item(line[3:], section))
        elif line.startswith("| "):
            program.append(line[2:])
        elif not line.startswith("  "):
            items[-1].cases.append(Case(text, program))
            program = []
        else:
            kind, colon, value = text.partition(":")
            value = value[1:]
            if not colon or kind not in ("jason", "here", "why", "not", "extra"):
                raise ValueError(f"{path}:{number}: {line}")
            if kind == "not":
                items[-1].missing = value
            elif kind == "extra":
                items[-1].extra = value
            elif kind == "why":
                items[-1].cases[-1].why = value
            elif kind == "jason":
                items[-1].cases[-1].jason.append(value)
            else:
                case = items[-1].cases[-1]
                case.here = [*(case.here or ()), *([value] if value != "nothing" else [])]
    return items


def all_items() -> list[Item]:
    return [item for path in sorted(FOLDER.glob("*.txt")) for item in read(path)]


def write(path: Path, items: list[Item]) -> None:
    lines, section = [], None
    for item in items:
        if item.section != section:
            section = item.section
            lines += ["", f"# {section}"] if lines else [f"# {section}"]
        lines += ["", f"== {item.name}"]
        if item.missing:
            lines.append(f"  not: {item.missing}")
        if item.extra:
            lines.append(f"  extra: {item.extra}")
        for case in item.cases:
            lines += [*(f"| {line}" for line in case.program), case.body]
            lines += [f"  jason: {line}" for line in case.jason]
            if case.here is not None:
                lines += [f"  here: {line}" for line in case.here or ["nothing"]]
            if case.why:
                lines.append(f"  why: {case.why}")
    path.write_text("\n".join(lines) + "\n", "utf-8")


def record(command: str, wanted: list[str]) -> None:
    """Run cases in Jason, each as an agent, and write what it prints."""
    files = {path: read(path) for path in sorted(FOLDER.glob("*.txt"))}
    cases = [
        case
        for items in files.values()
        for item in items
        if not wanted or any(word in item.name for word in wanted)
        for case in item.cases
    ]
    for begin in range(0, len(cases), 100):
        batch = cases[begin : begin + 100]
        with tempfile.TemporaryDirectory() as folder:
            for number, case in enumerate(batch):
                Path(folder, f"c{number}.asl").write_text(case.text, "utf-8")
            agents = " ".join(f"c{number};" for number in range(len(batch)))
            Path(folder, "cases.mas2j").write_text(f"MAS cases {{ agents: {agents} }}", "utf-8")
            ended = subprocess.run(
                [*shlex.split(command), "cases.mas2j"], cwd=folder, capture_output=True, text=True, check=False
            )
        for case in batch:
            case.jason = []
        for line in (ended.stdout + ended.stderr).splitlines():
            found = re.match(r"\[c(\d+)\] > (.*)", line)
            if found:
                batch[int(found[1])].jason.append(found[2])
    for path, items in files.items():
        write(path, items)


if __name__ == "__main__":
    record(sys.argv[1], sys.argv[2:])
