"""The examples in the documents are run, and their tables are complete."""

from __future__ import annotations

import contextlib
import doctest
import io
import re
from pathlib import Path

import pytest

import socialbot.bdi
from socialbot.bdi._messaging import PERFORMATIVES
from socialbot.bdi.compiler._runtime import FUNCTIONS
from socialbot.bdi.intentions import REASONS
from socialbot.bdi.trace import KINDS
from tests.conformance.examples import Example, Stage, examples

ROOT = Path(__file__).parents[2]
SEMANTICS = (ROOT / "docs" / "semantics.md").read_text("utf-8")
ENGINE = (ROOT / "docs" / "engine.md").read_text("utf-8")
HOSPITAL = (ROOT / "docs" / "hospital.md").read_text("utf-8")
DELIBERATION = (ROOT / "docs" / "deliberation.md").read_text("utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


PROGRAMS = blocks(SEMANTICS, "agentspeak") + blocks(ENGINE, "agentspeak")


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_an_example_in_agentspeak_prints_what_it_says(number):
    text = PROGRAMS[number]
    expected = re.findall(r"// -> (.*)$", text, re.MULTILINE)
    assert expected
    assert Stage(Example("docs", "", {"me": text}, [], {"prints": expected})).play() == {"prints": expected}


SCRIPTS = {
    name: blocks(text, "python")
    for name, text in (
        ("semantics.md", SEMANTICS),
        ("engine.md", ENGINE),
        ("deliberation.md", DELIBERATION),
        ("hospital.md", HOSPITAL),
    )
}


@pytest.mark.parametrize("document", [name for name, scripts in SCRIPTS.items() if scripts])
def test_the_examples_in_python_run_one_after_the_other(document):
    """Blocks with ``>>>`` are doctests, the others are run; ``# -> text`` is what they print."""
    names: dict[str, object] = {"__name__": "examples"}
    for script in SCRIPTS[document]:
        if script.startswith(">>>"):
            test = doctest.DocTestParser().get_doctest(script, names, document, document, 0)
            told = io.StringIO()
            doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=told.write, clear_globs=False)
            assert told.getvalue() == ""
            names.update(test.globs)
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(script, document, "exec"), names)
        assert printed.getvalue().splitlines() == re.findall(r"# -> (.*)$", script, re.MULTILINE), script


def test_there_are_examples():
    assert len(PROGRAMS) > 8
    assert len(SCRIPTS["engine.md"]) > 5
    assert len(SCRIPTS["deliberation.md"]) > 3
    assert len(SCRIPTS["hospital.md"]) > 2


def test_every_reason_performative_and_function_is_told():
    for reason in REASONS:
        assert f"| `{reason}` |" in SEMANTICS, reason
    for performative in PERFORMATIVES:
        assert f"`{performative}`" in SEMANTICS, performative
    for name in FUNCTIONS:
        assert f"`{name}" in SEMANTICS or f"`{name.removeprefix('math.')}`" in SEMANTICS, name


def test_every_public_name_and_every_kind_of_record_is_told():
    for name in socialbot.bdi.__all__:
        assert re.search(rf"\b{name}\b", ENGINE), name
    for kind in KINDS:
        assert f"`{kind}`" in ENGINE, kind


FILES = sorted((Path(__file__).parent / "examples").glob("*.txt"))
EXAMPLES = [example for path in FILES for example in examples(path)]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: f"{example.file}: {example.title}")
def test_example(example: Example):
    assert Stage(example).play() == example.expected


def test_no_two_examples_have_the_same_title():
    names = [(example.file, example.title) for example in EXAMPLES]
    assert len(set(names)) == len(names) > 100
