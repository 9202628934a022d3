"""References to Python objects in data of strangers: nothing of the data is imported, and nothing that acts."""

from __future__ import annotations

import subprocess
import sys

import pytest

from socialbot.bags.types import installed_definition
from socialbot.core.errors import GraphError
from socialbot.core.references import load_reference, look_in
from socialbot.runs.folder import open_run
from socialbot.runtime.bag_source import graph_of
from tests.runs.runs import greeting


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))


def _load(reference):
    return load_reference(reference, "node type", callable)


@pytest.fixture
def record(tmp_path, monkeypatch):
    """Folder of a record with a module, in which the user works."""
    folder = greeting(tmp_path / "run")
    (folder / "of_a_stranger.py").write_text("raise SystemExit('this was run')")
    (folder / "graph.yaml").write_text("name: odd\nnodes:\n  odd: {type: of_a_stranger:Node}\n")
    monkeypatch.chdir(folder)
    return folder


def test_no_module_in_the_folder_of_a_run_is_imported_even_if_one_works_there(record):
    [damage] = open_run(".").damage
    assert "of_a_stranger lies in the record" in damage
    assert "of_a_stranger" not in sys.modules


def test_no_module_in_the_folder_of_a_bag_is_imported_even_if_one_works_there(record):
    with pytest.raises(GraphError, match="of_a_stranger lies in the record"):
        graph_of(record)


def test_no_message_package_in_the_folder_of_a_bag_is_imported(record):
    package = record / "stranger_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('this was run')")
    (package / "msg" / "__init__.py").touch()
    look_in(record)
    assert installed_definition("stranger_msgs/msg/Odd") == ""


@pytest.mark.parametrize(
    ("reference", "fault"),
    [
        ("this:s", "this of Python's standard library"),
        ("idlelib.idle:Node", "idlelib.idle of Python's standard library"),
        ("test.autotest:main", "test.autotest of Python's standard library"),
        ("json.__main__:Node", "json.__main__ is a program"),
        ("pip.__main__:Node", "pip.__main__ is a program"),
        (":Node", "Empty module name"),
        ("..core:Node", "package"),
    ],
)
def test_modules_that_act_when_they_are_imported_are_not(reference, fault):
    known = set(sys.modules)
    with pytest.raises(GraphError, match=fault):
        _load(reference)
    assert not {"this", "idlelib.idle", "test.autotest"} & (set(sys.modules) - known)


def test_a_signal_during_an_import_is_no_mistake_of_the_module(tmp_path):
    (tmp_path / "slow_module.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGTERM)\n")
    code = (
        "from socialbot.core.process import exit_on_signals\n"
        "from socialbot.core.references import load_reference\n"
        "exit_on_signals()\n"
        "load_reference('slow_module:Node', 'node type', callable)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
