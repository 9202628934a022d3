from __future__ import annotations

import pwd
import re
import resource
import shutil
import tempfile
from pathlib import Path

import pytest

from socialbot.core.errors import ParameterError
from socialbot.core.paths import FOLDERS_VARIABLE, allow, replace_file, temporary_folder, user_folder, within, workspace
from socialbot.core.registry import node_types
from socialbot.graph.files import dump_graph, load_graph, node_type, with_changes
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from tests.system.running import limited


def test_a_file_is_replaced_with_its_permissions_and_through_a_link(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes(b"old")
    file.chmod(0o640)
    link.symlink_to(file)
    replace_file(link, b"new")
    assert (file.read_bytes(), file.stat().st_mode & 0o777) == (b"new", 0o640)
    assert link.is_symlink()
    assert sorted(tmp_path.iterdir()) == [file, link]


def test_the_draft_of_a_private_file_is_private(tmp_path, monkeypatch):
    """Another user who opens it could read the new content, also later."""
    file, modes = tmp_path / "file", []
    file.write_bytes(b"old")
    file.chmod(0o600)
    copy = shutil.copymode

    def note(source, draft):
        modes.append(draft.stat().st_mode & 0o777)
        copy(source, draft)

    monkeypatch.setattr(shutil, "copymode", note)
    replace_file(file, b"new")
    assert modes == [0o600]
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_file_that_cannot_be_replaced_leaves_nothing_else_behind(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="folder"):
        replace_file(tmp_path / "folder", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize("path", ["a.wav", "deep/er/a.wav", "./a", "deep/../a", ""])
def test_paths_inside_are_taken_relative_to_the_folder(tmp_path, path):
    assert within(path, [tmp_path], where="speech.folder") == (tmp_path / path).resolve()
    assert within(tmp_path / path, [tmp_path], where="speech.folder") == (tmp_path / path).resolve()


@pytest.mark.parametrize("path", ["..", "../x", "a/../../x", "/etc/passwd", "/", "~/../../x/../..", "\0"])
def test_paths_that_lead_out_are_refused(tmp_path, path):
    with pytest.raises(ParameterError, match=r"speech\.folder"):
        within(path, [tmp_path / "inside"], where="speech.folder")


def test_a_folder_whose_name_begins_alike_is_outside(tmp_path):
    with pytest.raises(ParameterError):
        within("../runs2/x", [tmp_path / "runs"], where="x")


def test_links_are_followed_before_one_looks(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link").symlink_to(tmp_path)
    (inside / "self").symlink_to(inside / "self")
    for path in ("link/secret", "self/x"):
        with pytest.raises(ParameterError):
            within(path, [inside], where="x")


def test_it_may_be_in_any_of_several_folders(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    assert within(second / "x", [first, second], where="x") == second / "x"
    assert within("x", [first, second], where="x") == first / "x"


def test_users_allow_folders_for_this_process_and_those_it_starts(tmp_path):
    environment: dict[str, str] = {}
    assert workspace(environment) == (Path.cwd(),)
    allow(tmp_path / "out", environment)
    allow(tmp_path / "out" / "deeper", environment)
    allow(tmp_path / "more", environment)
    allow(Path("runs"), environment)
    assert environment[FOLDERS_VARIABLE] == f"{tmp_path / 'out'}:{tmp_path / 'more'}"
    assert workspace(environment) == (Path.cwd(), tmp_path / "out", tmp_path / "more")


def test_a_folder_with_an_unusable_name_is_refused(tmp_path):
    environment: dict[str, str] = {}
    allow(Path("/a:/"), environment)
    assert environment == {}


PATHLIKE = re.compile(r"file|folder|path|model$|source|^init_")
ELSEWHERE = "/etc/socialbot"
NODES = [
    ("speaker", "folder", {"playback": "off"}),
    ("waldo", "mind_file", {}),
    ("cleaner", "mind_file", {}),
    ("cleaner", "pddl_file", {}),
    ("cleaner", "init_bset", {}),
    ("cleaner", "init_dset", {}),
    ("cleaner", "init_reactive_rules_set", {}),
    ("hospital_coordinator", "memory_file", {}),
    ("person_detector", "camera_file", {}),
    ("person_detector", "model", {"detector": "onnx"}),
    ("camera", "source", {}),
]


@pytest.mark.parametrize("path", [ELSEWHERE, "../../../../../../../../../../etc/socialbot"])
@pytest.mark.parametrize(("kind", "parameter", "others"), NODES)
def test_no_node_reads_or_writes_elsewhere(kind, parameter, others, path):
    config = NodeConfig("node", node_type(kind), {**others, parameter: path})
    with pytest.raises(ParameterError, match="is outside of") as caught:
        InlineRunner(Graph("test", (config,), inputs=frozenset(topic for topic, _ in config.subscriptions))).start()
    assert caught.value.where == f"node.{parameter}"


def test_every_parameter_that_is_a_path_is_among_them():
    names = {name for kind in node_types() for name in node_type(kind).parameters()}
    assert {name for name in names if PATHLIKE.search(name)} == {parameter for _, parameter, _ in NODES}


def test_files_of_the_command_line_may_be_anywhere(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDERS_VARIABLE, "")
    with_changes(
        load_graph("waldo"), [f"camera.source={tmp_path}/film.avi", "bdi_engine.greeting=Hi", "camera.rate_hz=5"]
    )
    assert workspace() == (Path.cwd(), tmp_path / "film.avi")


def test_files_beside_a_graph_may_be_used(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDERS_VARIABLE, "")
    graph = load_graph("waldo")
    (tmp_path / "mine.yaml").write_text(dump_graph(graph))
    load_graph(str(tmp_path / "mine.yaml"))
    assert workspace() == (Path.cwd(), tmp_path)


def test_a_temporary_folder_that_cannot_be_made_is_an_error(monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", None)
    with limited(resource.RLIMIT_FSIZE, 0), pytest.raises(ParameterError, match="cannot make a folder for temporary"):
        temporary_folder("test-")


def test_a_user_without_a_home_folder_has_to_name_one(monkeypatch):
    """As in a container that runs with any user id."""

    def nobody(_: int) -> None:
        raise KeyError

    monkeypatch.setattr(pwd, "getpwuid", nobody)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    with pytest.raises(ParameterError, match=r"XDG_STATE_HOME: this user has no home folder"):
        user_folder("XDG_STATE_HOME", ".local/state")
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert user_folder("XDG_STATE_HOME", ".local/state") == Path("/state")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", "/home/robot")
    assert user_folder("XDG_STATE_HOME", ".local/state") == Path("/home/robot/.local/state")
    monkeypatch.setenv("XDG_STATE_HOME", "relative/state")
    assert user_folder("XDG_STATE_HOME", ".local/state") == Path("/home/robot/.local/state")
