from __future__ import annotations

import sys

import typer
from typer.testing import CliRunner

from socialbot.cli.sim import sim
from socialbot.core.errors import InstallationError
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
