from __future__ import annotations

import json
import sys

import pytest
import typer
from typer.testing import CliRunner

from socialbot.cli.sim import sim
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command

app = typer.Typer()
app.command()(sim)


def test_without_mujoco_no_bag_is_begun(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["foyer", "--record", "bag"])
    assert isinstance(done.exception, InstallationError)
    assert done.exception.remedy is not None
    assert extra_command("sim") in done.exception.remedy
    assert not list(tmp_path.iterdir())


SCRIPT = "place: foyer\nduration: 2\npeople: [{id: ada, enter: entrance, legs: [{stand: 90}]}]\n"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("office --script script.yaml", "office: is not the place of script.yaml, 'foyer'"),
        ("foyer --script script.yaml --visitors 8", "--visitors: the script names its people"),
        ("--control sweep --perception truth", "--perception truth: nobody takes detections without an agent"),
    ],
)
def test_no_option_is_ignored(tmp_path, monkeypatch, given, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "script.yaml").write_text(SCRIPT, "utf-8")
    done = CliRunner().invoke(app, given.split())
    assert isinstance(done.exception, ParameterError)
    assert told in str(done.exception)


@pytest.mark.parametrize(("given", "lasts_s"), [([], 2.0), (["--duration", "1"], 1.0)])
def test_a_script_lasts_as_long_as_it_says_unless_a_duration_is_given(tmp_path, monkeypatch, given, lasts_s):
    pytest.importorskip("mujoco", reason="`make sim` installs it")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "script.yaml").write_text(SCRIPT, "utf-8")
    done = CliRunner().invoke(app, ["--script", "script.yaml", "--perception", "truth", "--out", "run", *given])
    assert done.exit_code == 0, done.output
    stamps = [json.loads(line)["stamp"] for line in (tmp_path / "run" / "trace.jsonl").read_text("utf-8").splitlines()]
    assert (max(stamps) - min(stamps)) / 1e9 == pytest.approx(lasts_s, abs=0.5)
