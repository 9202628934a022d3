from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.cli.systemd import quoted, unit
from socialbot.core.errors import ParameterError
from socialbot.core.process_settings import ProcessSettings


def test_a_unit_starts_the_nodes_of_its_machine(tmp_path: Path):
    read = configparser.RawConfigParser()
    read.read_string(unit(tmp_path / "waldo.yaml", "robot", user="pi"))
    assert read["Service"]["WorkingDirectory"] == str(tmp_path)
    assert read["Service"]["User"] == "pi"
    assert read["Service"]["ExecStart"].endswith(f" -m socialbot up {tmp_path}/waldo.yaml --machine robot")


def test_refuses_a_name_with_a_line_break(tmp_path: Path):
    with pytest.raises(ParameterError, match="cannot hold this path"):
        unit(tmp_path / "a\nExecStartPre=evil.yaml", "robot")


def unquoted(text: str) -> str:
    """An argument as systemd takes it, after systemd.syntax(7) and systemd.service(5)."""
    if text.startswith('"') and text.endswith('"'):
        text = text[1:-1]
    read, rest = "", text
    while rest:
        step = 2 if rest[:2] in ("\\\\", '\\"', "%%", "$$") else 1
        assert step == 2 or rest[0] not in '\\"%$'
        read, rest = read + rest[step - 1], rest[step:]
    return read


@settings(max_examples=200)
@given(st.text(st.sampled_from("ab/ \\\"'%$;#{}~*é"), max_size=12))
def test_quotes_every_argument(argument: str):
    assert unquoted(quoted(argument)) == argument


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_accepts_the_unit(tmp_path: Path):
    folder = tmp_path / "50% of $HOME"
    folder.mkdir()
    path = tmp_path / "socialbot-robot.service"
    path.write_text(unit(folder / "waldo.yaml", "robot", user="root"))
    done = subprocess.run(["systemd-analyze", "verify", path], capture_output=True, text=True, check=False)
    assert str(path) not in done.stderr, done.stderr
    assert path.name not in done.stderr, done.stderr


def test_a_unit_permits_the_priorities_of_its_processes(tmp_path: Path):
    priorities = [ProcessSettings(priority=20), ProcessSettings(priority=5, nice=-3), ProcessSettings(nice=5)]
    text = unit(tmp_path / "waldo.yaml", "robot", user="pi", settings=priorities)
    assert "\nLimitRTPRIO=20\nLimitNICE=-3\n" in text
    assert "Limit" not in unit(tmp_path / "waldo.yaml", "robot", user="pi")
