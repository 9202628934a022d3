"""Names in the docs exist: files, anchors, commands and their options."""

from __future__ import annotations

import ast
import math
import re
import unicodedata
from collections.abc import Iterator
from functools import cache
from importlib.metadata import metadata, requires
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

import socialbot
from socialbot.cli.main import command
from socialbot.graph.files import node_type
from socialbot.vision.detectors import DETECTORS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"(?<![\w./'-])socialbot ((?:[a-z][a-z0-9-]*)(?:[^`\n]*))")
RULE = re.compile(r"by its rule '(\S+).*' \(waldo\.py:(\d+)\)")
OPTION = re.compile(r"(?<!\S)(--[a-z][a-z-]*|-[a-z])(?=[\s=`]|$)")


def text_of(page: Path) -> str:
    return page.read_text("utf-8")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@cache
def anchors(page: Path) -> frozenset[str]:
    """The places of a page that can be linked to."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", text_of(page)), re.MULTILINE)
    return frozenset(slug(heading) for heading in headings)


def slug(heading: str) -> str:
    """Return the anchor of a heading."""
    plain = (
        unicodedata.normalize("NFKD", re.sub(r"[`*]|\]\([^)]*\)|\[", "", heading)).encode("ascii", "ignore").decode()
    )
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def test_each_path_of_an_attacker_has_a_test():
    page = text_of(ROOT / "docs/security.md")
    table = page.partition("## Attack surface")[2].partition("\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("|") and not line.startswith(("| path |", "|---"))]
    assert len(rows) > 90
    for row in rows:
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert len(cells) == 4, row
        assert all(cells), row
        file, _, test = cells[-1].strip("`").partition("::")
        *classes, name = test.split("::")
        body = ast.parse(text_of(ROOT / "tests" / file)).body
        for of in classes:
            [body] = (part.body for part in body if isinstance(part, ast.ClassDef) and part.name == of)
        assert name in {part.name for part in body if isinstance(part, ast.FunctionDef)}, row


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path):
    for link in LINK.findall(FENCE.sub("", text_of(page))):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, place = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{name_of(page)} links to {link}"
        if place and target.suffix == ".md":
            assert place in anchors(target), f"{name_of(page)} links to {link}; there are {sorted(anchors(target))}"


def constants_of_the_site() -> dict[str, Any]:
    """The literals of the mkdocs hook, whose imports are not installed for tests."""
    tree = ast.parse(text_of(ROOT / "tools" / "site.py"))
    found = (node for node in tree.body if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name))
    return {ast.unparse(node.targets[0]): node.value for node in found}


def test_links_to_files_outside_the_docs_lead_to_files_that_the_site_has():
    constants = constants_of_the_site()
    along = set(ast.literal_eval(constants["ALONG"]))
    pattern = re.compile(ast.literal_eval(constants["LINK"].args[0]))
    docs = ROOT / "docs"
    for page in docs.rglob("*.md"):
        linked = [(page.parent / link).resolve() for link in pattern.findall(text_of(page))]
        beyond = {str(target.relative_to(ROOT)) for target in linked if not target.is_relative_to(docs)}
        assert beyond <= along, name_of(page)
        assert not any("https" in target.parts for target in linked), name_of(page)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_headings_and_tables_begin_after_an_empty_line(page: Path):
    lines = FENCE.sub("", text_of(page)).splitlines()
    begun = [line for before, line in pairwise(lines) if before and re.match(r"#+ ", line)]
    begun += [line for before, line in pairwise(lines) if before and before[0] != "|" and line.startswith("|")]
    assert begun == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_section_and_no_paragraph_is_on_a_page_twice(page: Path):
    text = FENCE.sub("", text_of(page))
    parts = re.findall(r"^#.+", text, re.MULTILINE)
    parts += [part for part in re.split(r"\n\s*\n|\n(?=- )", text) if len(part.split()) > 12 and part[0] != " "]
    assert sorted({part for part in parts if parts.count(part) > 1}) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_all_rows_of_a_table_have_the_columns_of_its_head(page: Path):
    for table in re.findall(r"(?:^\|.*\n?)+", FENCE.sub("", text_of(page)), re.MULTILINE):
        head, *rows = table.splitlines()
        assert [row for row in rows if columns(row) != columns(head)] == []


def columns(row: str) -> int:
    return len(re.findall(r"(?<!\\)\|", row)) - 1


def in_nav(node: object) -> Iterator[str]:
    """The pages that a part of the nav names."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict):
        for below in node.values():
            yield from in_nav(below)
    elif isinstance(node, list):
        for below in node:
            yield from in_nav(below)


def test_every_page_is_in_the_nav_and_the_nav_names_no_other():
    named = list(in_nav(YAML(typ="safe").load(ROOT / "mkdocs.yml")["nav"]))
    there = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert len(named) == len(set(named))
    assert {page for page in named if not page.startswith("repository/")} == there
    for page in set(named) - there:
        assert (ROOT / page.removeprefix("repository/")).exists(), page


def commands_in(page: Path) -> Iterator[str]:
    """Return the arguments of ``socialbot`` in lines of code."""
    text = text_of(page)
    indented = re.findall(r"^(?: {4}|\t)(.*)$", FENCE.sub("", text), re.MULTILINE)
    fenced = "\n".join(FENCE.findall(text)).splitlines()
    quoted = re.findall(r"(?<!`)`([^`\n]+)`(?!`)", FENCE.sub("", text))
    for line in [*indented, *fenced, *quoted]:
        for found in COMMAND.findall(line.partition("  #")[0]):
            if re.match(r"(\$ |\. |.*&& |.*\| |.*bin/|\w+=\S+ )*socialbot ", line.strip()):
                yield re.split(r"\s[|&;]|[;)]", found)[0]


def resolved(words: list[str]) -> tuple[Any, list[str]]:
    """The command that ``words`` name, and the words that follow it. Raises LookupError."""
    found: Any = command()
    while words and hasattr(found, "commands"):
        found, words = found.commands[words[0]], words[1:]
    return found, words


def options_of(found: Any) -> set[str]:
    options = (parameter for parameter in found.params if parameter.param_type_name == "option")
    return {"--help", "-h", *(name for option in options for name in (*option.opts, *option.secondary_opts))}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_exist_with_their_options(page: Path):
    for line in commands_in(page):
        found, rest = resolved(line.split())
        named = set(OPTION.findall(re.sub(r"'[^']*'|\"[^\"]*\"|--ros-args.*", "", " ".join(rest))))
        assert named <= options_of(found), f"{name_of(page)}: socialbot {line}"


def test_every_command_is_explained_on_the_page_of_commands():
    text = text_of(ROOT / "docs" / "cli.md")
    shown = (name for name, found in command().commands.items() if not found.hidden)
    assert [name for name in shown if not re.search(rf"`(socialbot )?{name}\b", text)] == []


def section(text: str, anchor: str) -> str:
    """Return the part of the page of commands below the heading of a command, with its subsections."""
    found = re.search(rf"^### {re.escape(anchor)}\n.*?(?=^##?#? (?!#)|\Z)", text, re.MULTILINE | re.DOTALL)
    return found[0] if found else ""


def leaves(found: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The commands that take no further ones, with their names."""
    for name, below in getattr(found, "commands", {}).items():
        if not below.hidden:
            yield from leaves(below, (*path, name)) if hasattr(below, "commands") else [((*path, name), below)]


def unnamed_options(text: str) -> list[str]:
    """The options that neither the section of their command names nor one that it links to."""
    unnamed = []
    for path, found in leaves(command()):
        own = section(text, path[0])
        told = own + "".join(section(text, anchor) for anchor in re.findall(r"\]\(#([a-z]+)\)", own))
        shown = (each for each in found.params if each.param_type_name == "option" and not each.hidden)
        unnamed += [f"{' '.join(path)} {each.opts[0]}" for each in shown if not set(each.opts) & set(words(told))]
    return unnamed


def words(text: str) -> list[str]:
    return re.findall(r"--?[a-z][a-z-]*", text)


def test_every_option_is_explained_on_the_page_of_commands():
    text = text_of(ROOT / "docs" / "cli.md")
    assert unnamed_options(text) == []
    assert unnamed_options(text.replace("`--template NAME`", "")) == ["new --template"]


def rows(text: str, *heads: str) -> Iterator[list[str]]:
    """The cells of the columns ``heads`` in the tables that have them all; code stands without its quotes."""
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        head, _, *body = ([cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in table.splitlines())
        if set(heads) <= set(head):
            yield from ([row[head.index(name)] for name in heads] for row in body)


def is_default(told: str, default: object) -> bool:
    """Whether a page tells the default of an option or a parameter as it is."""
    if isinstance(default, bool):
        return told in (("on", "true", "`true`") if default else ("off", "false", "`false`"))
    if isinstance(default, (int, float)):
        return re.fullmatch(r"-?[\d.]+", told) is not None and float(told) == default
    return told.strip("`") == str(default)


def stated(names: str, defaults: str) -> Iterator[tuple[str, str]]:
    """The names in a cell with their defaults in another, where these are single words."""
    found, told = re.findall(r"`(--[a-z-]+|[a-z]\w+)[ `]", names), defaults.split(", ")
    if len(found) == len(told):
        yield from ((name, value) for name, value in zip(found, told, strict=True) if value and " " not in value)


def test_the_defaults_on_the_page_of_commands_are_those_of_the_options():
    compared, wrong = 0, []
    text = text_of(ROOT / "docs" / "cli.md")
    for path, found in leaves(command()):
        options = {name: each for each in found.params for name in each.opts}
        for head in (f"option of `{' '.join(path)}`", "option"):
            for names, defaults in rows(section(text, path[0]), head, "default"):
                for name, told in stated(names, defaults):
                    if name in options and options[name].default is not None:
                        compared += 1
                        wrong += [] if is_default(told, options[name].default) else [f"{' '.join(path)} {name}: {told}"]
    assert compared > 25
    assert wrong == []


def test_the_defaults_of_parameters_are_those_of_the_nodes():
    compared, wrong = 0, []
    types = {"the coordinator": "hospital_coordinator", "the world": "hospital_world"}
    for page in PAGES:
        for kind in re.findall(r"^\| parameter of (`\w+`|the \w+) \| default", text_of(page), re.MULTILINE):
            declared = node_type(types.get(kind) or kind.strip("`")).parameters()
            for names, defaults in rows(text_of(page), f"parameter of {kind}", "default"):
                for name, told in stated(names, defaults):
                    compared += 1
                    wrong += [] if is_default(told, declared[name].default) else [f"{name_of(page)}: {name} {told}"]
    assert compared > 25
    assert wrong == []


def test_the_scores_on_the_page_of_detectors_are_those_of_the_detectors():
    told = {
        name.strip("`"): [float(each.removesuffix(" s")) for each in scores]
        for name, *scores in rows(
            text_of(ROOT / "docs" / "detectors.md"), "detector", "sure", "weak", "certain", "bridge"
        )
    }
    assert told == {
        name: [spec.sure, spec.weak, spec.certain if math.isfinite(spec.certain) else spec.sure, spec.bridge_s]
        for name, spec in DETECTORS.items()
    }


def test_every_dependency_is_on_the_page_of_dependencies():
    text = text_of(ROOT / "docs" / "dependencies.md")
    needed = {re.split(r"[^\w-]", each)[0] for each in requires("socialbot") or ()} - {"socialbot"}
    assert {"numpy", "mujoco", "pytest"} <= needed
    assert needed - set(re.findall(r"[\w-]+", text.replace("ruamel.", "ruamel-"))) == set()


def test_every_extra_is_on_the_page_of_the_installation():
    text = text_of(ROOT / "docs" / "installation.md")
    extras = metadata("socialbot").get_all("Provides-Extra") or []
    assert {"speech", "sim"} <= set(extras)
    assert [each for each in extras if f"`{each}`" not in text] == []


def test_commands_are_found_in_the_docs():
    told = {line.split()[0] for page in PAGES for line in commands_in(page)}
    assert {"demo", "replay", "up", "bag", "plan", "status", "why"} <= told


def test_an_unknown_command_and_an_unknown_option_are_noticed():
    with pytest.raises(LookupError):
        resolved(["replya", "bag"])
    assert "--runer" not in options_of(resolved(["replay"])[0])
    assert "--runner" in options_of(resolved(["replay"])[0])


def test_the_rules_in_the_readme_are_waldos():
    text = (ROOT / "README.md").read_text("utf-8")
    rules = text.partition("rules:\n\n```python\n")[2].partition("```")[0].splitlines()
    source = {line.strip() for line in (ROOT / "socialbot/agents/waldo/waldo.py").read_text("utf-8").splitlines()}
    assert len(rules) >= 3
    assert [line for line in rules if line not in source] == []


def test_shown_lines_of_rules_are_those_of_the_code():
    code = text_of(ROOT / "socialbot" / "agents" / "waldo" / "waldo.py").splitlines()
    shown = [found for page in PAGES for found in RULE.findall(text_of(page))]
    assert shown
    assert [(rule, number) for rule, number in shown if rule not in code[int(number) - 1]] == []


GROUPS = {"asl_actions"}  # groups of entry points that are no module


def is_module(name: str) -> bool:
    return any((ROOT / "socialbot" / file).exists() for file in (name, f"{name}.py"))


def sentences(text: str) -> list[str]:
    """The sentences of a page outside of code, tables and headings; an item of a list ends one."""
    prose = re.sub(r"^(?:#+ .*|\|.*|:::.*|(?: {4}|\t).*)$", "", FENCE.sub("", text), flags=re.MULTILINE)
    prose = re.sub(r"`[^`\n]+`", "code", re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", prose))
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:-|\d+\.) )|(?<=[.!?])\s+(?=[A-Z`(])", prose)
    return [part for part in parts if re.search(r"[a-z]", part)]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_sentences_have_at_most_18_words_on_average(page):
    lengths = [len(re.findall(r"[\w'-]+", each)) for each in sentences(text_of(page))]
    assert sum(lengths) <= 18 * len(lengths)


FOLDERS = "data|docs|evaluation|examples|interfaces|ros|socialbot|tests|tools"
WRITTEN = re.compile(r"(?:Save this as|In) `([\w./-]+)`")
"""Files that the reader writes."""


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_and_programs_of_the_repository_in_the_docs_exist(page):
    text = text_of(page)
    files = set(re.findall(rf"`((?:{FOLDERS})/[\w./-]+)[`:]", FENCE.sub("", text))) - set(WRITTEN.findall(text))
    programs = set(re.findall(r"python -m ((?:evaluation|tools|tests)\.\w+(?:\.\w+)*)", text))
    files |= {f"{name.replace('.', '/')}.py" for name in programs}
    files |= set(re.findall(rf"python ((?:{FOLDERS})/[\w/]+\.py)", text))
    packages = {name for name in files if (ROOT / name.removesuffix(".py") / "__main__.py").exists()}
    schemas = {name for name in files if re.fullmatch(r"socialbot/\w+/\d", name)}
    assert [name for name in files - packages - schemas if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_modules_of_socialbot_in_the_docs_exist(page):
    names = set(re.findall(r"(?<![\w/.-])socialbot\.([a-z_]+)", text_of(page))) - GROUPS
    assert [name for name in names if not hasattr(socialbot, name) and not is_module(name)] == []
