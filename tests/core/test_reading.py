"""Reading files that may be anything."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from socialbot.agents.dialogue.script import page_of
from socialbot.bags.image_files import open_video, read_image
from socialbot.bags.reader import open_bag
from socialbot.bdi import saving
from socialbot.bdi.agentspeak.programs import IncludePaths, parse, read_program
from socialbot.bdi.agentspeak.projects import read_project
from socialbot.bdi.trace import read_trace
from socialbot.core.errors import SocialbotError
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.reading import check_size, open_file, read_bytes
from socialbot.graph.files import load_graph
from socialbot.robots.profile import load_profile
from socialbot.runtime.deployment import is_deployment, load_deployment
from socialbot.runtime.sweeps import Journal
from socialbot.speech.audio import read_wav
from socialbot.speech.neural import PiperVoice
from socialbot.vision.metrics.formats.yolo import is_yolo
from socialbot.vision.network import OnnxModel

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "graph": ("x.yaml", lambda path: load_graph(str(path))),
    "deployment": ("x.yaml", load_deployment),
    "robot": ("x.yaml", lambda path: load_profile(str(path))),
    "script": ("x.yaml", page_of),
    "program": ("x.asl", read_program),
    "project": ("x.mas2j", read_project),
    "mind": ("x.json", saving.read),
    "trace": ("x.jsonl", read_trace),
    "journal": ("x.jsonl", Journal),
    "voice": ("x.onnx.json", lambda path: PiperVoice(str(path.with_suffix("")))),
    "network": ("x.onnx", OnnxModel),
    "image": ("x.png", read_image),
    "video": ("x.mp4", open_video),
    "sound": ("x.wav", read_wav),
    "bag": ("x.mcap", open_bag),
}
"""Name of a file, and its reader."""

TEXTS = ("graph", "deployment", "robot", "script", "program", "project")


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_readers_refuse_what_may_have_no_end(kind: str, reader: str, tmp_path: Path) -> None:
    name, read = READERS[reader]
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)  # nobody writes to it
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(SocialbotError) as caught:
        read(path)
    assert str(path.with_suffix("")) in str(caught.value)
    assert caught.value.remedy
    assert caught.value.exit_code in (3, 4, 7)


@pytest.mark.parametrize("reader", TEXTS)
def test_readers_refuse_large_texts(reader: str, tmp_path: Path) -> None:
    name, read = READERS[reader]
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(TEXT_BYTES + 1)
    with pytest.raises(SocialbotError, match="larger than 16 MiB"):
        read(path)


@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_files_that_are_looked_at_are_not_read_without_end(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "data.yaml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.write_bytes(b"machines:\n" + bytes(TEXT_BYTES))
    assert not is_deployment(str(path))
    assert not is_yolo(tmp_path)


def test_an_included_program_may_not_be_a_pipe(tmp_path: Path) -> None:
    (tmp_path / "zero.asl").symlink_to("/dev/zero")
    with pytest.raises(SocialbotError, match=r"zero\.asl"):
        parse('{ include("zero.asl") }', str(tmp_path / "main.asl"), IncludePaths())


def test_a_file_without_a_stated_size_is_read() -> None:
    file = Path("/proc/self/maps")
    assert file.stat().st_size == 0
    assert read_bytes(file).startswith(file.read_bytes()[:12])


@pytest.mark.parametrize("size", [0, 1, 99, 100])
def test_files_up_to_the_limit_are_read_in_full(size: int, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(os.urandom(size))
    assert read_bytes(file, 100) == file.read_bytes()
    check_size(file, 100)


def test_larger_files_and_files_without_a_stated_size_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(bytes(101))
    with pytest.raises(OSError, match="larger than"):
        read_bytes(file, 100)
    with pytest.raises(OSError, match="larger than"):
        check_size(file, 100)
    with pytest.raises(OSError, match="larger than"):
        read_bytes(Path("/proc/self/maps"), 100)


@pytest.mark.parametrize("name", ["x" * 5000, "x" * 256, "a\0b", "loop"])
def test_names_that_no_file_can_have_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    path = tmp_path / name
    with pytest.raises(OSError, match=re.escape(repr(name)[1:-1])):
        read_bytes(path)


def test_folders_and_missing_files_are_refused_as_usual(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        open_file(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_file(tmp_path / "none")


def test_a_file_in_a_bag_may_not_be_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "bag_0.mcap")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    with pytest.raises(SocialbotError, match="a pipe"):
        open_bag(tmp_path)
