"""The public names of socialbot, their cost, and the imports that docs, examples and templates use."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import socialbot

ROOT = Path(__file__).parents[1]
NAMES = Path(__file__).with_name("public_names.txt")
PACKAGES = ("socialbot", "socialbot.bdi", "socialbot.testing")
SHOWN = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/**/*.md"),
    *ROOT.glob("examples/**/*.py"),
    *ROOT.glob("examples/**/*.md"),
    *ROOT.glob("socialbot/cli/templates/**/*.template"),
]
"""Files that show users how to import socialbot."""

ENTRY = re.compile(r"^::: (\S+)$", re.MULTILINE)
IMPORT = re.compile(r"^\s*(?:from (socialbot[\w.]*) import|import (socialbot[\w.]*))", re.MULTILINE)


def public_names() -> str:
    """The public names by package, as in ``public_names.txt``."""
    listed = ((package, sorted(importlib.import_module(package).__all__)) for package in PACKAGES)
    return "".join(f"{package}.{name}\n" for package, names in listed for name in names)


def test_the_public_names_are_those_of_the_snapshot():
    assert NAMES.read_text("utf-8") == public_names(), "run python -m tests.test_front_door if this is intended"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_can_be_imported(package):
    module = importlib.import_module(package)
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


def test_type_checkers_see_the_names_that_are_imported_lazily():
    tree = ast.parse(Path(socialbot.__file__).read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    seen = {alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert seen == set(socialbot.__all__)


def test_the_reference_lists_every_public_name_once():
    entries = [entry for page in ROOT.glob("docs/reference/*.md") for entry in ENTRY.findall(page.read_text("utf-8"))]
    assert len(entries) == len(set(entries))
    packages = [entry for entry in entries if entry in PACKAGES]
    missing = [
        name
        for name in public_names().split()
        if name not in entries
        and name.rpartition(".")[0] not in packages
        and name.replace("socialbot.", "socialbot.bdi.") not in public_names().split()
    ]
    assert missing == []


def test_unknown_names_are_refused_as_usual():
    with pytest.raises(AttributeError, match="no attribute 'Robot'"):
        socialbot.Robot  # type: ignore[attr-defined] # noqa: B018


def test_importing_socialbot_takes_less_than_30_ms_of_processor_time():
    code = "import time; start = time.process_time(); import socialbot; print(time.process_time() - start)"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, check=True) for _ in range(3)]
    assert min(float(run.stdout) for run in runs) < 0.03


def shown_imports() -> list[tuple[str, str]]:
    return [
        (str(path.relative_to(ROOT)), match[1] or match[2])
        for path in SHOWN
        for match in IMPORT.finditer(path.read_text("utf-8"))
    ]


def test_docs_examples_and_templates_import_from_the_front_door_or_one_level_below_a_room():
    # An agent package, such as socialbot.agents.waldo, counts as a room.
    below = {where: name for where, name in shown_imports() if name.replace(".agents.", ".", 1).count(".") > 2}
    assert below == {}
    private = [shown for shown in shown_imports() if "._" in shown[1]]
    assert {where for where, _ in private} <= {"docs/howto/extending.md"}
    assert {name.rpartition(".")[0] for _, name in private} == {"socialbot.cli"}  # the room of the command it shows


@pytest.mark.parametrize("name", sorted({name for _, name in shown_imports()}))
def test_the_modules_that_docs_examples_and_templates_import_exist(name):
    importlib.import_module(name)


if __name__ == "__main__":
    NAMES.write_text(public_names(), encoding="utf-8")
