from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bridge.environment import Across
from socialbot.bridge.transport import open_topics
from socialbot.core.errors import GraphError, ParameterError, SocialbotError
from socialbot.core.process_settings import ProcessSettings
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, NodeConfig
from socialbot.runtime._processes import RestartPolicy
from socialbot.runtime.deployment import Deployment, Server, is_address, is_own, load_deployment, parse_deployment
from socialbot.runtime.machine import enter
from socialbot.vision.camera_node import Camera
from tests.runtime.deployments import PAGE, deployment


def test_a_file_assigns_nodes_to_machines():
    read = deployment()
    assert read.machines == {"robot": "10.77.0.1", "workstation": "10.77.0.2"}
    assert read.places["head"] == "robot"
    assert read.domain == 42
    assert read.restart == RestartPolicy(times=3, within_s=30.0, first_s=0.5, longest_s=4.0)
    assert read.keys == Path("/here/keys")
    assert read.graph.node("bdi_engine").parameters["greeting"] == "Hallo"
    found = read.across("robot")
    assert found is not None
    assert found == Across(peers=("10.77.0.2",), participants=found.participants)
    assert len(read.half("robot")) < len(read.half("workstation")) < found.participants < 20


def test_most_keys_are_optional():
    page = PAGE.replace("domain: 42\ndiscovery: peers\n", "").partition("pictures:")[0]
    read = parse_deployment(page, where="d.yaml", folder=Path("/here"))
    assert (read.domain, read.keys, read.restart) == (0, None, RestartPolicy())


def test_topics_of_drivers_may_be_open():
    read = deployment(("{keys: keys}", "{keys: keys, open: [/camera/image_raw, /tf]}"))
    variables: dict[str, str] = {}
    enter(read, "robot", variables)
    assert variables["SOCIALBOT_KEYS"] == "/here/keys:robot"
    assert open_topics(variables) == {"/camera/image_raw", "/tf"}


@pytest.mark.parametrize(("written", "port"), [("robot", 11811), ("robot:7000", 7000)])
def test_a_discovery_server_runs_on_a_machine(written: str, port: int):
    read = deployment(("discovery: peers", f"discovery: {{server: '{written}'}}"))
    assert read.server == Server("robot", port)
    assert read.across("workstation") == Across(server=f"10.77.0.1:{port}")


def test_state_files_are_beside_the_file():
    assert deployment(("parameters:", "minds: kept\nparameters:")).minds == Path("/here/kept")
    assert deployment().minds is None


def test_a_graph_may_be_beside_the_file(tmp_path: Path):
    (tmp_path / "g.yaml").write_text("name: eyes\nnodes:\n  camera: {type: camera}\n")
    file = tmp_path / "d.yaml"
    file.write_text("graph: g.yaml\nmachines: {laptop: {address: 127.0.0.1}}\nnodes: {camera: laptop}\n")
    assert load_deployment(file).graph == load_graph(str(tmp_path / "g.yaml"))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("domain: 42", "domians: 42", 2, ["unknown key 'domians'", "did you mean 'domain'?"]),
        ("graph: waldo", "graph: wald", 1, ["no graph 'wald'", "did you mean 'waldo'?"]),
        ("graph: waldo", "graph: 3", 1, ["'graph' must be a text, got 3"]),
        ("domain: 42", "domain: 233", 2, ["a whole number from 0 to 232, got 233"]),
        ("domain: 42", "domain: true", 2, ["a whole number", "got True"]),
        ("discovery: peers", "discovery: multicast", 3, ["must be peers, or {server: MACHINE}, got 'multicast'"]),
        ("discovery: peers", "discovery: {server: 'robot:70000'}", 3, ["'70000' is not a port"]),
        ("discovery: peers", "discovery: {server: rowboat}", 3, ["no machine 'rowboat'", "did you mean 'robot'?"]),
        ("discovery: peers", "discovery: 7", 3, ["'discovery' must be peers, or {server: MACHINE}, got 7"]),
        ("  robot: {address: 10.77.0.1}", "  robot: {adress: 10.77.0.1}", 5, ["did you mean 'address'?"]),
        ("  robot: {address: 10.77.0.1}", "  robot: {}", 5, ["'address' is missing"]),
        ("  robot: {address: 10.77.0.1}", "  robot: 10.77.0.1", 5, ["expected names with values"]),
        ("10.77.0.1", "10.77.0.256", 5, ["'10.77.0.256' is not a valid address", "IPv4"]),
        ("10.77.0.1", "'::1'", 5, ["'::1' is an IPv6 address", "IPv4"]),
        ("10.77.0.1", "10.77.0.2", 5, ["two machines have the address 10.77.0.2"]),
        ("  robot: {address", "  ro-bot: {address", 5, ["'ro-bot' is not a valid machine name"]),
        ("  camera: robot", "  camera: robo", 8, ["no machine 'robo'", "did you mean 'robot'?"]),
        ("  camera: robot", "  camra: robot", 8, ["waldo has no node 'camra'", "did you mean 'camera'?"]),
        ("  camera: robot", "  camera: [robot]", 8, ["'camera' must be a text"]),
        ("  camera: robot\n", "", 7, ["nodes without a machine: camera", "add camera: robot"]),
        ("  camera: robot", "  camera: robot\n  camera: robot", 9, ["no valid YAML", "duplicate"]),
        ("  /camera/image_raw:", "  /camera/image_ray:", 16, ["is not an image topic", "'/camera/image_raw'?"]),
        ("    transport: jpeg", "    transport: png", 17, ["'transport' must be one of jpeg, raw, got 'png'"]),
        ("    quality: 70", "    quality: 700", 18, ["700 is out of range", "1 to 100"]),
        ("    quality: 70", "    quality: high", 18, ["'high' is not of type int"]),
        ("    rate_hz: 15", "    rate: 15", 19, ["unknown key 'rate'", "did you mean 'rate_hz'?"]),
        ("times: 3", "times: -1", 20, ["'times' must be a whole number from 0"]),
        ("first_s: 0.5", "first_s: .nan", 20, ["'first_s' must be a number"]),
        ("{keys: keys}", "{key: keys}", 21, ["unknown key 'key'", "did you mean 'keys'?"]),
        ("{keys: keys}", "{keys: keys, open: /camera}", 21, ["'open' must be a list of texts"]),
        ("{keys: keys}", "{keys: keys, open: [camera]}", 21, ["each of 'open' must be a full topic", "/camera"]),
        ("{keys: keys}", "{}", 21, ["'keys' is missing"]),
        ("  bdi_engine:\n", "  bdi_engin:\n", 23, ["no node 'bdi_engin'", "did you mean 'bdi_engine'?"]),
        ("    greeting: Hallo", "    greetin: Hallo", 24, ["no parameter 'greetin'", "did you mean 'greeting'?"]),
        ("    greeting: Hallo", "    greeting: 7", 24, ["7 is not of type str"]),
        ("security: {keys: keys}", "security: {keys: keys", 22, ["no valid YAML"]),
    ],
)  # fmt: skip
def test_an_error_has_file_line_and_remedy(old: str, new: str, line: int, words: list[str]):
    with pytest.raises((GraphError, ParameterError)) as caught:
        deployment((old, new))
    assert all(word in str(caught.value) for word in words), str(caught.value)
    place = re.match(r"dir/d\.yaml:(\d+)", caught.value.where or "")
    assert place, f"no file and line: {caught.value}"
    # YAML itself notices an end that is missing somewhat later.
    assert int(place[1]) == line or ("no valid YAML" in words and int(place[1]) >= line), str(caught.value)


@pytest.mark.parametrize("key", ["machines", "nodes"])
def test_requires_machines_and_nodes(key: str):
    page = "\n".join(part for part in re.split(r"\n(?=\w)", PAGE) if not part.startswith(key))
    with pytest.raises(GraphError, match=f"'{key}' is missing"):
        parse_deployment(page, where="d.yaml", folder=Path("/here"))


def test_an_error_in_the_graph_names_the_graph_file(tmp_path: Path):
    (tmp_path / "g.yaml").write_text("name: eyes\nnodes:\n  camera: {typ: camera}\n")
    file = tmp_path / "d.yaml"
    file.write_text("graph: g.yaml\nmachines: {laptop: {address: 127.0.0.1}}\nnodes: {camera: laptop}\n")
    with pytest.raises(GraphError, match=r"g\.yaml:3"):
        load_deployment(file)


def test_an_unreadable_file_is_an_error(tmp_path: Path):
    with pytest.raises(GraphError, match="cannot be read"):
        load_deployment(tmp_path / "none.yaml")


@settings(max_examples=150)
@given(st.text(st.sampled_from("abn:- \n{}[]'\"#&*!|>%@,0\t"), max_size=40))
def test_invalid_text_raises_only_socialbot_errors(text: str):
    with pytest.raises(SocialbotError):
        parse_deployment(text, where="d.yaml", folder=Path("/here"))


VALUES = st.recursive(
    st.sampled_from(
        ("1", "-1", "1e99", ".inf", ".nan", "true", "~", "robot", "'a.b'", "2026-99-01", "*a", "!!int x", "{[]: 1}")
    ),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]")
        | st.dictionaries(st.sampled_from(("camera", "server", "address", "1", "a.b")), inner, max_size=3).map(
            lambda items: "{" + ", ".join(f"{key}: {value}" for key, value in items.items()) + "}"
        )
    ),
    max_leaves=5,
)


@settings(max_examples=150)
@given(st.sampled_from([line for line in PAGE.splitlines() if not line.endswith(":")]), VALUES)
def test_errors_of_wrong_values_name_the_file(line: str, value: str):
    try:
        read = deployment((line, f"{line.partition(':')[0]}: {value}"))
    except SocialbotError as error:
        where = error.where or ""
    else:
        where = "dir/d.yaml" if {one.name for one in read.written.nodes} == read.places.keys() else ""
    assert where.startswith("dir/d.yaml")


def test_the_examples_in_the_documentation_are_valid():
    text = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text("utf-8")
    laptop, two, *parts = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert len(parts) == 2
    for page in (laptop, two, *(two + part for part in parts)):
        read = parse_deployment(page, where="deploy.md", folder=Path("/here"))
        assert all(f"`{one.name}`" in text or one.name in page for one in read.graph.nodes)


EYES = Graph("eyes", (NodeConfig("camera", Camera),))


def test_a_single_machine_has_no_discovery_settings():
    assert Deployment(EYES, {"laptop": "127.0.0.1"}, {"camera": "laptop"}).across("laptop") is None


def test_finds_this_machine_by_its_address():
    here = Deployment(EYES, {"laptop": "127.0.0.1", "robot": "192.0.2.7"}, {"camera": "robot"})
    assert here.this_machine() == "laptop"


@pytest.mark.parametrize(
    ("machines", "words"),
    [
        ({"robot": "192.0.2.7", "desk": "192.0.2.8"}, "none of the addresses: robot .192.0.2.7., desk"),
        ({"robot": "127.0.0.1", "desk": "127.0.0.2"}, "this could be robot or desk"),
    ],
)
def test_lists_the_machines_if_none_or_several_match(machines: dict[str, str], words: str):
    with pytest.raises(GraphError, match=words) as caught:
        Deployment(EYES, machines, {"camera": "robot"}).this_machine()
    assert "--machine" in str(caught.value)


def test_suggests_the_name_of_an_unknown_machine():
    with pytest.raises(GraphError, match="did you mean 'robot'"):
        deployment().half("robto")


def test_checks_addresses():
    assert all(map(is_address, ("10.0.0.1", "robot", "robot.local", "a-b.example.org")))
    assert not any(
        map(is_address, ("", "10.0.0", "1.2.3.4.5", "::1", "a b", "-a", "a..b", "a;b", "x" * 64, "10.0.0.1\n"))
    )
    assert is_own("127.0.0.1")
    assert not is_own("192.0.2.7")


def test_processes_have_priorities_cores_and_memory() -> None:
    settings = "{head: {priority: 20, memory_mb: 500}, person_detector: {nice: 5, cpus: [0, 1]}}"
    read = deployment(("parameters:", f"processes: {settings}\nparameters:"))
    assert read.processes == {
        "head": ProcessSettings(priority=20, memory_mb=500),
        "person_detector": ProcessSettings(nice=5, cpus=(0, 1)),
    }


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("{hed: {nice: 5}}", "no node 'hed'"),
        ("{head: {nice: 50}}", "'nice' must be from -20 to 19"),
        ("{head: {speed: 5}}", "speed"),
        ("{head: {nice: low}}", "'nice' must be a whole number"),
        ("{head: {cpus: 0}}", "'cpus' must be a list of whole numbers"),
        ("{head: 5}", "expected names with values"),
    ],
)
def test_mistakes_in_processes_are_named(settings: str, message: str) -> None:
    with pytest.raises((GraphError, ParameterError), match=message) as caught:
        deployment(("parameters:", f"processes: {settings}\nparameters:"))
    assert re.match(r"d.*yaml:\d+", caught.value.where or ""), caught.value.where
