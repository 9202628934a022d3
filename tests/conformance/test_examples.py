from __future__ import annotations

from pathlib import Path

import pytest

from tests.conformance.examples import Example, Stage, examples

FILES = sorted((Path(__file__).parent / "examples").glob("*.txt"))
EXAMPLES = [example for path in FILES for example in examples(path)]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: f"{example.file}: {example.title}")
def test_example(example: Example):
    assert Stage(example).play() == example.expected


def test_no_two_examples_have_the_same_title():
    names = [(example.file, example.title) for example in EXAMPLES]
    assert len(set(names)) == len(names) > 100
