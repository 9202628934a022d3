"""`socialbot status` and `socialbot down` beside a graph that is up."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep
from typing import Any

import pytest

from socialbot.bridge.keys import new_key
from socialbot.runs.folder import open_run
from tests.system.running import eventually, running, socialbot
from tests.system.test_deployment import ROOT, folder, half  # noqa: F401 - a fixture
from tests.system.two_hosts import Host, two_hosts

pytestmark = [pytest.mark.ros, pytest.mark.slow]

GRAPH = """
name: voice
inputs: [/speech/say, /head/command, /humans/bodies/detections]
nodes:
  speech: {type: speaker, parameters: {playback: 'off'}}
  head: {type: head}
"""


def status(*arguments: object) -> tuple[int, dict[str, dict[str, Any]]]:
    """Exit code of `socialbot status`, and its status of each node."""
    done = socialbot("status", *arguments, "--json")
    assert done.stdout, done.stderr
    return done.returncode, {one["name"]: one for one in json.loads(done.stdout)["nodes"]}


@contextmanager
def voice(tmp_path: Path) -> Iterator[Any]:
    (tmp_path / "voice.yaml").write_text(GRAPH)
    with running("up", tmp_path / "voice.yaml", "--out", tmp_path / "run") as process:
        yield process


def test_status_shows_nodes_and_down_ends_them(tmp_path: Path) -> None:
    graph = tmp_path / "voice.yaml"
    with voice(tmp_path) as up:
        code, nodes = status(graph, "--wait", 60)
        assert (code, list(nodes)) == (0, ["speech", "head"])
        head = nodes["head"]
        assert head["memory_mb"] > 10
        assert head["cpu_percent"] >= 0
        os.kill(head["pid"], signal.SIGKILL)
        assert eventually(lambda: status(graph, "--wait", 60)[1]["head"]["restarts"] == 1, 60)
        done = socialbot("status", graph, "--wait", 60)
        assert "head: its process was ended by signal 9" in done.stdout
        assert "all 2 nodes are well" in done.stdout
        done = socialbot("down")
        assert (done.returncode, done.stderr) == (0, "")
        assert "voice on" in done.stdout
        assert up.wait(60) == 0
    code, nodes = status(graph)
    assert (code, {one["condition"] for one in nodes.values()}) == (10, {"no messages"})
    assert "nothing is up here" in socialbot("down").stdout


def test_ignores_unsealed_diagnostics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Forged statuses neither restart processes nor appear in the status of a graph with keys."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from socialbot.bridge.environment import spinning_node

    values = {"machine": "robot", "state": "given up", "restarts": "6", "last_error": "hung", "pid": "1"}
    lies = [
        DiagnosticStatus(name=name, values=[KeyValue(key=key, value=value) for key, value in values.items()])
        for name in ("speech", "head")
    ]
    new_key("robot", tmp_path / "keys")
    graph = tmp_path / "voice.yaml"
    with monkeypatch.context() as keys:
        keys.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        with spinning_node("stranger") as ros, voice(tmp_path):
            code, before = status(graph, "--wait", 60)
            assert code == 0
            liar = ros.create_publisher(DiagnosticArray, "/diagnostics", 10)
            ros.create_timer(0.02, lambda: liar.publish(DiagnosticArray(status=lies)))
            sleep(5.0)
            code, after = status(graph)
            assert code == 0
            assert [one["pid"] for one in after.values()] == [one["pid"] for one in before.values()]
            assert {one["restarts"] for one in after.values()} == {0}
    record = open_run(tmp_path / "run")
    assert {told.values["state"] for course in record.node_history.reports.values() for _, told in course} <= {
        "unconfigured", "inactive", "active",
    }  # fmt: skip


def test_down_reports_unreachable_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A graph with keys ignores requests of a process without one."""
    new_key("robot", tmp_path / "keys")
    with monkeypatch.context() as keys:
        keys.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
        with voice(tmp_path) as up:
            assert status(tmp_path / "voice.yaml", "--wait", 60)[0] == 0
            keys.delenv("SOCIALBOT_KEYS")
            done = socialbot("down", "--timeout", 6)
            assert (done.returncode, done.stdout) == (10, "")
            assert f"process {up.pid}: a run is up here, but its key is not trusted" in done.stderr
            assert up.poll() is None


def on(host: Host, *arguments: object) -> tuple[int, str]:
    """Exit code and output of socialbot on ``host``."""
    process = host.start(
        *(sys.executable, "-m", "socialbot", *arguments),
        variables={"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    output, _ = process.communicate(timeout=180)
    return process.returncode, output


def test_status_and_down_cover_both_machines(folder: Path) -> None:  # noqa: F811
    for name in ("robot", "workstation"):
        new_key(name, folder / "keys")
    page = folder / "waldo.yaml"
    with page.open("a") as text:
        text.write("security: {keys: keys}\n")
    with two_hosts() as hosts, half(hosts.robot, folder) as robot, half(hosts.workstation, folder) as workstation:
        code, told = on(hosts.workstation, "status", page, "--wait", 90)
        assert code == 0, told
        hosts.cut()
        code, told = on(hosts.workstation, "status", page, "--json")
        missing = {one["machine"] for one in json.loads(told)["nodes"] if one["condition"] == "no messages"}
        assert (code, missing) == (10, {"robot"})
        assert on(hosts.workstation, "down", page, "--machine", "robot")[0] == 10
        assert robot.poll() is None
        hosts.mend()
        assert on(hosts.robot, "status", page, "--wait", 60)[0] == 0
        code, told = on(hosts.workstation, "down", page)
        assert code == 0, told
        assert "waldo on robot: ended" in told
        assert "waldo on workstation: ended" in told
        assert (robot.wait(60), workstation.wait(60)) == (0, 0)
