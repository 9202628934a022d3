from __future__ import annotations

import contextlib
import math
import time
from typing import Annotated, Any, Literal

import msgspec
import pytest
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.core.errors import GraphError, ParameterError
from socialbot.core.limits import YAML_DEPTH
from socialbot.core.yaml import check_depth, load_yaml, read_page


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
@pytest.mark.parametrize(
    "number", ["0x" + "f" * 5000, "0o" + "7" * 6000, "9" * 251, "1." + "3" * 2000, '!!int "' + "9" * 2000 + '"']
)
def test_long_numbers_are_refused_with_the_line(loader: YAML, number: str) -> None:
    with pytest.raises(MarkedYAMLError, match="a number of more than 250 characters") as caught:
        load_yaml(loader, f"a: 1\nb: {number}")
    assert caught.value.problem_mark is not None
    assert caught.value.problem_mark.line == 1


@pytest.mark.parametrize("loader", loaders())
@pytest.mark.parametrize("number", ["0x" + "f" * 248, "9" * 250, "-0o" + "7" * 247])
def test_whole_numbers_fit_into_floats(loader: YAML, number: str) -> None:
    assert math.isfinite(float(load_yaml(loader, f"a: {number}")["a"]))


@pytest.mark.parametrize("loader", loaders())
def test_long_numbers_of_base_60_take_no_time(loader: YAML) -> None:
    begun = time.process_time()
    with pytest.raises(MarkedYAMLError, match="a number of more than 250 characters"):
        load_yaml(loader, "%YAML 1.1\n---\na: 1" + ":59" * 100_000)
    assert time.process_time() - begun < 1.0


@pytest.mark.parametrize("loader", loaders())
def test_usual_aliases_are_allowed(loader: YAML) -> None:
    page = load_yaml(loader, "base: &base {rate: 3, names: &names [a, b]}\nnode: {<<: *base, more: *names}")
    assert dict(page["node"]) == {"rate": 3, "names": ["a", "b"], "more": ["a", "b"]}


class Wheel(msgspec.Struct, frozen=True):
    radius: Annotated[float, msgspec.Meta(ge=0.1, le=2.5)]
    at: tuple[float, float] = (0.0, 0.0)


class Robot(msgspec.Struct):
    name: Annotated[str, msgspec.Meta(pattern="[a-z]+", description="a name; use small letters")]
    wheels: dict[str, Wheel]
    pose: str | tuple[float, float] | None = None
    modes: tuple[Literal["drive", "park"], ...] = ()
    steps: Annotated[int, msgspec.Meta(ge=1)] = 1
    speed: float = 1.0
    active: bool = True
    grid: tuple[tuple[str, ...], ...] = ()
    spare: Wheel = Wheel(1.0)
    extra: Any = None


ROBOT = "name: rob\nwheels:\n  left:\n    radius: 1\n"


def test_a_struct_states_the_fields_of_a_file():
    text = ROBOT + "  3: {radius: 2.5, at: [1, 2]}\npose: [1, 2.5]\nmodes: [park]\ngrid:\nextra: [1]\n"
    robot = read_page(text, where="r.yaml").read(Robot)
    wheels = {"left": Wheel(1.0), "3": Wheel(2.5, (1.0, 2.0))}
    assert robot == Robot("rob", wheels, (1.0, 2.5), ("park",), extra=[1])
    assert [type(each) for each in (robot.wheels["left"].radius, robot.name)] == [float, str]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("name: Rob", "r.yaml:1: 'name' must be a name, got 'Rob'\n  remedy: use small letters"),
        ("name: rob\ncolor: red", "r.yaml:2: unknown key 'color'\n  remedy: known: active"),
        ("name: rob\nstep: 2", "r.yaml:2: unknown key 'step'\n  remedy: did you mean 'steps'?"),
        ("name: rob\nsteps: 0", "r.yaml:2: 'steps' must be a whole number from 1, got 0"),
        ("name: rob\nsteps: 1.0", "r.yaml:2: 'steps' must be a whole number from 1, got 1.0"),
        ("name: rob\nsteps: true", "r.yaml:2: 'steps' must be a whole number from 1, got True"),
        ("name: rob\nsteps: " + "9" * 400, "r.yaml:2: no valid YAML: a number of more than 250"),
        ("name: rob\nspeed: 1e999", "r.yaml:2: 'speed' must be a number, got inf"),
        ("name: 0x" + "f" * 4000, "r.yaml:1: no valid YAML: a number of more than 250"),
        ("name: 0x" + "f" * 240, "r.yaml:1: 'name' must be a name, got "),
        ("name: rob\nspeed: .nan", "r.yaml:2: 'speed' must be a number, got nan"),
        ("name: rob\nspeed: -.inf", "r.yaml:2: 'speed' must be a number, got -inf"),
        ("name: rob\nspeed: !unit 3", "r.yaml:2: 'speed' must be a number, got "),
        ("name: rob\nactive: 1", "r.yaml:2: 'active' must be true or false, got 1"),
        ("name: rob\nactive:", "r.yaml:2: 'active' must be true or false, got nothing"),
        ("name: rob\npose: 1", "r.yaml:2: 'pose' must be a text or a list of 2 numbers, got 1"),
        ("name: rob\npose: [1]", "r.yaml:2: 'pose' must be a text or a list of 2 numbers, got a list"),
        ("name: rob\npose:", "r.yaml:2: 'pose' must be a text or a list of 2 numbers, got nothing"),
        ("name: rob\npose: [1, a]", "r.yaml:2: each of 'pose' must be a number, got 'a'"),
        ("name: rob\nmodes: drive", "r.yaml:2: 'modes' must be a list, got 'drive'"),
        ("name: rob\nmodes:\n- drive\n- fly", "r.yaml:4: each of 'modes' must be one of drive, park, got 'fly'"),
        ("name: rob\ngrid: [a]", "r.yaml:2: each of 'grid' must be a list of texts, got 'a'"),
        ("name: rob\ngrid:\n- [a]\n- [b, 2]", "r.yaml:4: each of 'grid' must be a text, got 2\n  remedy: write texts"),
        ("name: rob\nspare:", "r.yaml:2: expected names with values, got nothing\n  remedy: known: radius, at"),
        ("name: rob\nspare: {at: [1, 2]}", "r.yaml:2: 'radius' is missing\n  remedy: give a number from 0.1 to 2.5"),
        ("active: true", "r.yaml:1: 'name' is missing\n  remedy: give a name; use small letters"),
        ("name: ''", "r.yaml:1: 'name' is missing"),
        ("name: rob\nspare: {1: 2, '1': 3}", "r.yaml:2: unknown key 1"),
        ("- name", "r.yaml:1: expected names with values, got a list"),
        ("name: [", "r.yaml:"),
    ],
)
def test_an_error_says_what_where_and_how_to_correct_it(line: str, message: str):
    text = line + ROBOT.removeprefix("name: rob") if line[0] != "-" else line
    with pytest.raises(ParameterError) as caught:
        read_page(text, where="r.yaml", error=ParameterError).read(Robot)
    assert str(caught.value).startswith(message)


def test_keys_of_one_name_are_refused():
    with pytest.raises(GraphError, match=r"r.yaml:6: two keys have the name '1'"):
        read_page(ROBOT + "  1: {radius: 1}\n  '1': {radius: 2}\n", where="r.yaml").read(Robot)


def test_the_same_text_in_two_files_is_an_error_of_each():
    for where in ("r.yaml", "s.yaml"):
        with pytest.raises(GraphError, match=rf"^{where}:1: "):
            read_page("[no robot]", where=where).read(Robot)


def test_values_left_out_are_the_usual_ones():
    section = read_page("at: [1, 2]", where="w.yaml")
    assert section.read(Wheel, {"radius": 2.0}) == Wheel(2.0, (1.0, 2.0))
    assert section.value("radius", float, 3.0) == 3.0
    with pytest.raises(GraphError, match=r"w.yaml:1: 'radius' is missing\n  remedy: give a number"):
        section.value("radius", float)


def test_lines_of_keys_and_list_items():
    page = read_page(ROBOT + "grid:\n- [a]\n- - b\n  - c\n", where="r.yaml")
    paths = (("wheels",), ("wheels", "left", "radius"), ("grid", 1, 1), ("grid", 5), ("nothing", "x"), ("name", "x"))
    assert [page.line(*path) for path in paths] == [f"r.yaml:{line}" for line in (2, 4, 8, 5, 1, 1)]
