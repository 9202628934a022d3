from __future__ import annotations

import contextlib
import time

import pytest
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.core.limits import YAML_DEPTH
from socialbot.core.yaml import check_depth, load_yaml


def loaders() -> list[YAML]:
    return [YAML(typ="rt"), YAML(typ="safe", pure=True)]


@pytest.mark.parametrize("loader", loaders())
def test_valid_files_are_loaded(loader: YAML) -> None:
    assert load_yaml(loader, "a: {b: [1, 2.5]}\nc:\n  - d") == {"a": {"b": [1, 2.5]}, "c": ["d"]}


@pytest.mark.parametrize("loader", loaders())
@pytest.mark.parametrize("text", ["[a]: b", "{[a]: b}", "? {a: b}\n: c", "9" * 5000, "2001-99-99", "a: *b", "<<: 3"])
def test_whatever_is_wrong_is_an_error_of_yaml(loader: YAML, text: str) -> None:
    with contextlib.suppress(YAMLError):
        assert load_yaml(loader, text) is not None


@pytest.mark.parametrize("loader", loaders())
@pytest.mark.parametrize("unit", ["{", "[", "- ", "? ", "{a: ", "[1, "])
def test_deeply_nested_files_are_refused_with_the_line(loader: YAML, unit: str) -> None:
    begun = time.process_time()
    with pytest.raises(MarkedYAMLError, match="nested more than") as caught:
        load_yaml(loader, "a: 1\nb:\n  " + unit * 3000)
    assert time.process_time() - begun < 0.5
    assert caught.value.problem_mark is not None
    assert caught.value.problem_mark.line == 2


@pytest.mark.parametrize("loader", loaders())
def test_some_depth_is_allowed(loader: YAML) -> None:
    nested = load_yaml(loader, "[" * (YAML_DEPTH - 5) + "]" * (YAML_DEPTH - 5))
    for _ in range(YAML_DEPTH - 6):
        [nested] = nested
    assert nested == []


def test_the_depth_can_be_checked_before_loading() -> None:
    check_depth("a: {b: [c]}\n" * 1000)
    with pytest.raises(YAMLError, match="nested more than"):
        check_depth("[{" * YAML_DEPTH)


def levels(first: str, more: str) -> str:
    """Nine levels, each with nine aliases of the one before: 9 ** 9 values in 400 bytes."""
    parts = [f"a0: &a0 {first}"]
    parts += [f"a{n}: &a{n} {more.format(', '.join([f'*a{n - 1}'] * 9))}" for n in range(1, 9)]
    return "\n".join(parts)


@pytest.mark.parametrize("loader", loaders())
@pytest.mark.parametrize(
    "text",
    [
        levels("[x, x, x, x, x, x, x, x, x]", "[{}]"),
        levels("{k: 1, l: 2}", "{{<<: [{}]}}"),
        "- &a [" + ", ".join("x" * 10_000) + "]\n- [" + ", ".join(["*a"] * 20) + "]",
        "&a [*a]",
        "a: &a {b: *a}",
        "- &b0 []\n" + "\n".join(f"- &b{n} [*b{n - 1}]" for n in range(1, 2000)),
    ],
)
def test_aliases_that_explode_are_refused_with_the_line(loader: YAML, text: str) -> None:
    begun = time.process_time()
    with pytest.raises(MarkedYAMLError, match=r"aliases make it too large|nested more than") as caught:
        load_yaml(loader, text)
    assert time.process_time() - begun < 2.0
    assert caught.value.problem_mark is not None


@pytest.mark.parametrize("loader", loaders())
def test_usual_aliases_are_allowed(loader: YAML) -> None:
    page = load_yaml(loader, "base: &base {rate: 3, names: &names [a, b]}\nnode: {<<: *base, more: *names}")
    assert dict(page["node"]) == {"rate": 3, "names": ["a", "b"], "more": ["a", "b"]}
