from __future__ import annotations

import re
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import GraphError, ParameterError, SocialbotError
from socialbot.core.registry import graph_names, node_types
from socialbot.graph.files import dump_graph, load_graph, node_type, parse_graph, with_changes
from socialbot.graph.node import Graph, NodeConfig
from socialbot.graph.wizard import WizardKey
from tests.graph.test_graph import Echo, Source

GOOD = """\
name: test
inputs: [/more]
paced_by: /echo
nodes:
  source:
    type: tests.graph.test_graph:Source
  echo:
    type: tests.graph.test_graph:Echo
    parameters:
      volume: 0.4
      times: 3
    remap:
      status: /echo/status
"""


def test_a_graph_file_defines_the_graph(tmp_path):
    path = tmp_path / "g.yaml"
    path.write_text(GOOD)
    expected = Graph(
        "test",
        (
            NodeConfig("source", Source),
            NodeConfig("echo", Echo, {"volume": 0.4, "times": 3}, {"status": "/echo/status"}),
        ),
        inputs=frozenset({"/more"}),
        paced_by="/echo",
    )
    assert load_graph(str(path)) == load_graph(path) == expected


def test_a_graph_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(GraphError, match=r"waldo\.yaml: cannot be read: No such file"):
        load_graph(tmp_path / "waldo.yaml")


def test_a_node_of_ones_own_may_stand_beside_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "own_node_beside.py").write_text("from tests.graph.test_graph import Source\nclass Own(Source): ...\n")
    path = tmp_path / "g.yaml"
    path.write_text("name: own\nnodes:\n  own: {type: own_node_beside:Own}\n")
    assert load_graph(str(path)).node("own").type.__name__ == "Own"


def test_a_node_of_ones_own_may_stand_in_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_node_here.py").write_text("from tests.graph.test_graph import Source\nclass Own(Source): ...\n")
    assert node_type("own_node_here:Own").__name__ == "Own"


def test_modules_beside_a_graph_do_not_shadow_installed_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "colorsys.py").write_text("raise SystemExit('this is not the one')")
    path = tmp_path / "g.yaml"
    path.write_text("name: own\nnodes:\n  own: {type: colorsys:Own}\n")
    with pytest.raises(GraphError, match="colorsys of Python's standard library has no 'Own'") as caught:
        load_graph(str(path))
    assert "give a module of your own" in str(caught.value.remedy)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import no_such_library\n", ["No module named 'no_such_library'", "install no_such_library"]),
        ("\n1 / 0\n", ["ZeroDivisionError: division by zero (own_wrong_", ".py:2)", "fix the module"]),
        ("Own = 3\n", ["is no node"]),
        (
            "from socialbot import Input\nInput(int, '/a')\n",
            [": int is no message (own_wrong_", ".py:2)\n  remedy: give a Message of socialbot"],
        ),
        (
            "from socialbot import variables\nX, Y = variables('X, Y')\n",
            ["'X,' is not a variable name (own_wrong_", ".py:2)"],
        ),
        (
            "from socialbot import Parameter\nParameter(5.0, 'size (m)', minimum=9.0)\n",
            [
                "parameter (size (m)): the default 5.0 is out of range (own_wrong_",
                ".py:2)\n  remedy: give a value from 9.0",
            ],
        ),
        ("import argparse\nargparse.ArgumentParser().parse_args(['-x'])\n", ["SystemExit: 2 (own_wrong_", ".py:2)"]),
    ],
)
def test_errors_in_modules_of_users_are_reported(text, words, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    module = f"own_wrong_{abs(hash(text))}"
    (tmp_path / f"{module}.py").write_text(text)
    path = tmp_path / "g.yaml"
    path.write_text(f"name: own\nnodes:\n  own: {{type: {module}:Own}}\n")
    with pytest.raises(GraphError) as caught:
        load_graph(str(path))
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert caught.value.where == f"{path}:3"


@pytest.mark.parametrize("name", graph_names())
def test_a_graph_that_comes_with_socialbot_is_sound(name):
    assert load_graph(name).name == name


@pytest.mark.parametrize("name", node_types())
def test_a_node_that_comes_with_socialbot_is_there(name):
    assert node_type(name).__doc__


@pytest.mark.parametrize("name", node_types())
def test_each_parameter_has_a_description_and_accepts_its_default(name):
    for parameter in node_type(name).parameters().values():
        assert parameter.doc
        assert parameter.check(parameter.default, "here") == parameter.default


def test_waldo_listens_to_the_camera_and_has_its_seven_nodes():
    waldo = load_graph("waldo")
    assert len(waldo.nodes) == 7
    assert waldo.paced_by == "/humans/bodies/detections"
    assert {"/waldo/actions", "/speech/say", "/head/command"} <= waldo.topics().keys()
    assert {"/camera/image_raw", "/camera/camera_info"} <= waldo.without_sources().inputs


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("paced_by:", "pacedby:", 3, ["unknown key 'pacedby'", "did you mean 'paced_by'?"]),
        ("    remap:", "    remaps:", 12, ["unknown key 'remaps'", "did you mean 'remap'?"]),
        ("tests.graph.test_graph:Echo", "echo", 8, ["unknown node type 'echo'", "package.module:Class"]),
        ("tests.graph.test_graph:Echo", "tests.graph.test_graph:Eco", 8, ["has no 'Eco'", "did you mean 'Echo'?"]),
        ("tests.graph.test_graph:Echo", "tests.no_graph:Echo", 8, ["no module 'tests.no_graph'", "beside the graph"]),
        ("tests.graph.test_graph:Echo", "tests.graph.test_graph:graph", 8, ["is no node"]),
        ("inputs: [/more]", "inputs: [/more", 3, ["no valid YAML"]),
        ("      times: 3", "      times: 3: 4", 11, ["no valid YAML"]),
        ("      times: 3", "      times: 3\n      times: 4", 12, ["no valid YAML", "duplicate"]),
        ("name: test", "name: 3", 1, ["'name' must be a text, got 3"]),
        ("inputs: [/more]", "inputs: /more", 2, ["'inputs' must be a list of texts"]),
        ("inputs: [/more]", "inputs: [more]", 2, ["no valid topic: 'more'", "begin with /"]),
        ("inputs: [/more]", "inputs:\n- /more\n- /a b", 4, ["no valid topic: '/a b'"]),
        ("inputs: [/more]", "services: [add]", 2, ["no valid topic: 'add'", "begin with /"]),
        ("      status: /echo/status", "      heard: /moor", 13, ["nobody publishes /moor", "did you mean '/more'?"]),
        ("inputs: [/more]", "inputs: [1]", 2, ["each of 'inputs' must be a text, got 1"]),
        ("    type: tests.graph.test_graph:Echo\n", "", 8, ["'type'"]),
        ("    type: tests.graph.test_graph:Echo", "    type: 7", 8, ["'type' must be a text, got 7"]),
        ("  source:\n    type: tests.graph.test_graph:Source", "  source: here", 5, ["expected names with values"]),
        ("      volume: 0.4", "      volume: 4.5", 10, ["4.5 is out of range", "echo.volume"]),
        ("      volume: 0.4", "      volume: loud", 10, ["'loud' is not of type float"]),
        ("      volume: 0.4", "      volumes: 0.4", 10, ["no parameter 'volumes'", "did you mean 'volume'?"]),
        ("      status: /echo/status", f"      status: /{'a' * 228}", 13, ["no valid topic", "at most 228 characters"]),
        ("  echo:", f"  {'a' * 201}:", 7, ["no valid name for a node", "at most 200"]),
        ("      status: /echo/status", "      stats: /echo/status", 13, ["no input or output 'stats'"]),
        ("      status: /echo/status", "      status: [1]", 13, ["'status' must be a text"]),
        ("      status: /echo/status", "      heard: /sad", 13, ["nobody publishes /sad", "did you mean '/said'?"]),
        ("      status: /echo/status", "      status: /said", 13, ["/said is Utterance for source but SpeechStatus"]),
        ("paced_by: /echo", "paced_by: /eco", 3, ["paced_by names /eco", "did you mean '/echo'?"]),
    ],
)  # fmt: skip
def test_an_error_names_file_line_and_remedy(old, new, line, words):
    assert old in GOOD
    with pytest.raises((GraphError, ParameterError)) as caught:
        parse_graph(GOOD.replace(old, new), where="dir/g.yaml")
    assert all(word in str(caught.value) for word in words), str(caught.value)
    place = re.match(r"dir/g\.yaml:(\d+)", caught.value.where or "")
    assert place, f"no file and line: {caught.value.where}"
    # What is wrong with a node may be said of the node as a whole; it begins at line 7.
    assert int(place[1]) == line or (line > 8 and "no valid YAML" not in words and 7 <= int(place[1]) <= line)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected names with values"),
        ("[]", "expected names with values"),
        ("name: x", "'nodes' is missing"),
        ("nodes: {}", "'name'"),
        ("name: x\nnodes:", "expected names with values"),
        ("\x00", "no valid YAML"),
        ("a: *b", "no valid YAML"),
        ("--- {name: x}\n--- {name: y}", "no valid YAML"),
    ],
)
def test_a_page_that_is_no_graph_is_refused(text, words):
    with pytest.raises(GraphError, match=words) as caught:
        parse_graph(text, where="g.yaml")
    assert (caught.value.where or "").startswith("g.yaml")


@pytest.mark.parametrize(
    ("name", "written", "value"),
    [
        ("volume", ".5", 0.5), ("volume", "1e-1", 0.1), ("volume", "1", 1), ("times", "0x10", 16),
        ("times", "1_000", 1000), ("loud", "true", True), ("device", "'1'", "1"), ("device", "|\n        usb", "usb\n"),
    ],
)  # fmt: skip
def test_values_may_use_any_yaml_style(name, written, value):
    text = GOOD.replace("volume: 0.4", f"{name}: {written}").replace("      times: 3\n", "")
    found = parse_graph(text, where="g.yaml").node("echo").parameters
    assert dict(found) == {name: value}
    assert type(found[name]) is type(value)


def test_a_folder_is_no_graph(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "butler").mkdir()
    with pytest.raises(GraphError, match=r"(?s)butler: is a folder.*socialbot\.agents"):
        load_graph("butler")


def test_a_missing_file_and_one_that_is_no_text_are_explained(tmp_path):
    with pytest.raises(GraphError, match="did you mean 'waldo'"):
        load_graph("wald")
    binary = tmp_path / "g.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(GraphError, match="cannot be read"):
        load_graph(str(binary))


@settings(deadline=None, max_examples=100)
@given(st.text(st.sampled_from("abn:- \n{}[]'\"#&*!|>%@,0\t"), max_size=40))
def test_whatever_the_text_is_errors_are_for_people(text):
    with pytest.raises(SocialbotError):
        parse_graph(text, where="g.yaml")


TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1, max_size=12)
TRICKY = st.sampled_from(("yes", "null", "1", "1e3", "~", "- a", "a: b", "#", "on", "'", "2026-11-21", " x "))
TOPICS = st.from_regex(r"/[a-z]{1,6}(/[a-z]{1,6})?", fullmatch=True)
PARAMETERS = st.fixed_dictionaries(
    {},
    optional={
        "volume": st.floats(0.0, 1.0),
        "times": st.integers(1, 2**40),
        "loud": st.booleans(),
        "voice": st.sampled_from(("en", "it")),
        "device": TEXTS | TRICKY,
    },
)


@settings(deadline=None, max_examples=30)
@given(
    TEXTS | TRICKY,
    st.lists(st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True), max_size=3, unique=True),
    PARAMETERS,
    TOPICS,
    st.booleans(),
    st.frozensets(TOPICS),
)
def test_a_graph_survives_being_written_and_read(name, nodes, parameters, topic, remapped, inputs):
    remap = {"say": topic} if remapped and topic not in ("/said", "/status") else {}
    graph = Graph(
        name,
        tuple(NodeConfig(node, Echo, parameters, remap) for node in nodes),
        inputs=inputs | {"/said"},
        paced_by="/status" if nodes else "",
    )
    assert parse_graph(dump_graph(graph), where="dumped") == graph


def test_the_graphs_that_come_with_socialbot_survive_too():
    waldo = load_graph("waldo").without_sources().with_parameters({"bdi_engine": {"offer": "Aiuto? Sì, «subito»!"}})
    assert parse_graph(dump_graph(waldo), where="dumped") == waldo


def test_merged_values_have_no_line():
    with pytest.raises(GraphError, match="expected names with values") as caught:
        parse_graph("name: &x {nodes: 3}\n<<: *x\n", where="page")
    assert caught.value.where == "page:1"


@pytest.mark.parametrize(
    "text", ["[a]: b", "name: " + "9" * 5000, "{" * 5000, "- " * 5000, "a: 2001-99-99", "x: &a [*a]"]
)
def test_unsupported_yaml_is_a_clear_error(text):
    with pytest.raises(GraphError):
        parse_graph(text, where="page")


def test_a_change_names_a_node_or_the_type_of_one_node():
    def graph(*names: str) -> Graph:
        nodes = [NodeConfig(name, node_type("speaker")) for name in names]
        return Graph("test", tuple(nodes), inputs=frozenset({"/speech/say"}))

    def changed(*names: str) -> list[object]:
        return [dict(node.parameters) for node in with_changes(graph(*names), ["speaker.pitch=60"]).nodes]

    assert changed("mouth") == [{"pitch": 60}]
    assert changed("mouth", "speaker") == [{}, {"pitch": 60}]
    with pytest.raises(GraphError, match="no node 'speaker'"):
        changed("mouth", "other")


WIZARD = (
    GOOD
    + """\
wizard:
  g: {label: greet now, achieve: greet()}
  h: {say: Good morning!, agent: echo}
"""
)


def test_keys_for_the_person_behind_the_scenes():
    graph = parse_graph(WIZARD, where="g.yaml")
    assert graph.wizard == (
        WizardKey("g", "greet now", "achieve", "greet()"),
        WizardKey("h", "say Good morning!", "say", "Good morning!", "echo"),
    )
    assert parse_graph(dump_graph(graph), where="again").wizard == graph.wizard


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  g:", "  w:", "g.yaml:15: no valid key: 'w'"),
        ("  g:", "  G1:", "no valid key: 'G1'"),
        (", achieve: greet()", "", "key 'g' needs one command"),
        ("achieve: greet()", "achieve: greet(), say: Hello", "key 'g' needs one command"),
        ("Good morning!", "''", "'say' is empty"),
        ("achieve:", "acheive:", "did you mean 'achieve'"),
        ("agent: echo", "agent: ecko", "key 'h': no node 'ecko'"),
    ],
)
def test_invalid_keys_are_refused(old, new, words):
    with pytest.raises(GraphError, match=re.escape(words)):
        parse_graph(WIZARD.replace(old, new), where="g.yaml")
