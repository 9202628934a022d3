"""Limits of files that are read at once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from socialbot.bdi.agentspeak.programs import read_program
from socialbot.core.errors import GraphError, RuleError, SocialbotError
from socialbot.core.limits import DATA_BYTES, TEXT_BYTES
from socialbot.core.paths import read_bytes, read_text
from socialbot.graph.files import load_graph
from socialbot.runtime.deployment import load_deployment
from socialbot.vision.metrics.truth import load_truth


def sparse(path: Path, size: int) -> Path:
    """A file of zeros that takes no space on the disk."""
    path.touch()
    os.truncate(path, size)
    return path


def test_a_file_up_to_the_limit_is_read(tmp_path: Path) -> None:
    path = sparse(tmp_path / "a", 1000)
    assert read_bytes(path, 1000) == bytes(1000)
    with pytest.raises(OSError, match="larger than 0 MiB"):
        read_bytes(path, 999)


def test_a_device_without_end_is_refused() -> None:
    with pytest.raises(GraphError, match="is a device or a pipe"):
        read_text(Path("/dev/zero"), GraphError)


def test_line_ends_are_those_of_linux(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one\r\ntwo\rthree\n")
    assert read_text(tmp_path / "a", GraphError) == "one\ntwo\nthree\n"


@pytest.mark.parametrize(
    ("name", "size", "read"),
    [
        ("graph.yaml", TEXT_BYTES, lambda path: load_graph(str(path))),
        ("deployment.yaml", TEXT_BYTES, load_deployment),
        ("agent.asl", TEXT_BYTES, read_program),
        pytest.param("truth.json", DATA_BYTES, load_truth, marks=pytest.mark.slow),
    ],
)
def test_readers_refuse_larger_files(tmp_path: Path, name: str, size: int, read) -> None:
    with pytest.raises(SocialbotError, match="larger than"):
        read(sparse(tmp_path / name, size + 1))


def test_includes_do_not_multiply_without_end(tmp_path: Path) -> None:
    for number in range(40):
        name = f'"{number + 1}.asl"'
        (tmp_path / f"{number}.asl").write_text(f"{{include({name}, a)}} {{include({name}, b)}}")
    (tmp_path / "40.asl").write_text("p.")
    with pytest.raises((RuleError, SocialbotError), match="more than 1000 files"):
        read_program(tmp_path / "0.asl")
