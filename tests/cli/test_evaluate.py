from __future__ import annotations

import json
import signal
import subprocess
import sys

import cv2
import pytest

from tests.system.running import children, eventually, is_alive, running, socialbot_here
from tests.vision.metrics.scenes import drawn_bag, drawn_pictures, walking

QUICKLY = ("--detector", "hog", "--jobs", "1")


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")


def evaluate(*args: object) -> subprocess.CompletedProcess[str]:
    return socialbot_here("evaluate", *args)


def test_evaluates_bag_and_images_with_all_outputs(tmp_path):
    bag = drawn_bag(tmp_path, scene="scene1", split="held-back", frames=2)
    tuning = drawn_bag(tmp_path, "tuning", scene="scene1", split="tune", frames=1)
    pictures = drawn_pictures(tmp_path / "room", 1)
    ended = evaluate(
        bag, tuning, "--images", pictures, "--split", "held-back", *QUICKLY, "--out", tmp_path / "out",
        "--figures", tmp_path / "figures.json", "--threads", "1",
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert "Beside the paper's Table 3" in ended.stdout
    assert "tuning is skipped: its split is tune" in ended.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())
    scenes = figures["detectors"]["hog"]["scenes"]
    assert set(scenes) == {"scene1", "room"}
    band = scenes["scene1"]["bands"]["2-10"]
    assert band["tp"] + band["fn"] == 2
    assert {"tp", "fp", "fn", "precision", "recall", "f1"} <= set(band)
    assert figures["detectors"]["hog"]["frames_per_s"] > 0
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text()).keys() == figures.keys()
    assert (tmp_path / "out" / "index.html").read_text().startswith("<!doctype html>")


@pytest.mark.slow
def test_other_bands_and_presence(tmp_path):
    bag = drawn_bag(tmp_path, frames=2)
    ended = evaluate(
        bag, "--bands", "0-3,3-5", "--presence", "--no-speed", *QUICKLY, "--figures", tmp_path / "f.json"
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    figures = json.loads((tmp_path / "f.json").read_text())
    assert list(figures["detectors"]["hog"]["scenes"]["clip"]["bands"]) == ["0-3", "3-5", "outside", "unknown"]
    assert figures["settings"]["matching"] == "presence"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_interrupt_ends_all_processes(corridor):
    with running("evaluate", corridor, "--detector", "hog", "--no-speed", "--jobs", "1") as process:
        assert eventually(lambda: len(children(process.pid)) >= 2, 60)
        workers = children(process.pid)
        process.send_signal(signal.SIGINT)
        assert process.wait(180) == 0
        assert "Traceback" not in process.output()
    assert eventually(lambda: not any(map(is_alive, workers)))


def test_data_set_in_a_common_format_is_evaluated_and_exported(tmp_path):
    sequence = tmp_path / "Hall-01"
    (sequence / "img1").mkdir(parents=True)
    lines = []
    for number, (picture, box) in enumerate(walking(4), 1):
        cv2.imwrite(str(sequence / "img1" / f"{number:06}.jpg"), picture)
        lines.append(f"{number},1,{','.join(map(str, box))},1,1,1\n{number},2,5,5,9,9,0,3,1\n")
    (sequence / "gt.txt").write_text("".join(lines))
    exports = ("--export", f"coco={tmp_path}/results.json", "--export", f"mot={tmp_path}/tracks")
    ended = evaluate(sequence, *QUICKLY, "--no-speed", "--figures", tmp_path / "f.json", *exports)
    assert ended.returncode == 0, ended.stderr
    assert "not used: 4 boxes of class car" in ended.stderr
    figures = json.loads((tmp_path / "f.json").read_text())
    scene = figures["detectors"]["hog"]["scenes"]["Hall-01"]
    tracks = (tmp_path / "tracks" / "Hall-01.txt").read_text().splitlines()
    assert scene["tracking"]["hits"] + scene["tracking"]["false"] == len(tracks) > 0
    assert scene["coco"]["ap50"] > 0
    assert {entry["image_id"] for entry in json.loads((tmp_path / "results.json").read_text())} <= {1, 2, 3, 4}


def test_folder_of_images_with_labels_elsewhere(tmp_path):
    pictures = drawn_pictures(tmp_path / "room", 1)
    labels = (pictures / "persons.json").rename(tmp_path / "mine.json")
    ended = evaluate(pictures, "--truth", labels, *QUICKLY, "--no-speed")
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (["--figures", "{folder}"], "{folder}"),
        (["--html", "{file}/page.html"], "{file}/page.html"),
        (["--out", "{file}"], "{file}/evaluation.json"),
        (["--out", "{taken}"], "{taken}/curves.svg"),
    ],
)
def test_unwritable_output_is_an_error_at_the_start(tmp_path, arguments, where):
    (tmp_path / "file").write_text("")
    (tmp_path / "taken" / "curves.svg").mkdir(parents=True)
    places = {name: str(tmp_path / name) for name in ("file", "taken")} | {"folder": str(tmp_path)}
    bag = drawn_bag(tmp_path, frames=1)
    # A model that is not there: looking for people would be another error.
    ended = evaluate(
        bag, "--detector", "onnx", "--set", "model=none.onnx", *(word.format(**places) for word in arguments)
    )
    assert "cannot be written" in ended.stderr
    assert where.format(**places) in ended.stderr.replace("\n", "")
    assert ended.returncode == 4
    assert list((tmp_path / "taken").iterdir()) == [tmp_path / "taken" / "curves.svg"]


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        ([], 4, "nothing to evaluate"),
        (["{bag}", "--detector", "hogg"], 4, "did you mean 'hog'"),
        (["{bag}", "--bands", "2"], 4, "is not a band"),
        (["{bag}", "--split", "tune"], 4, "no bag has the split tune"),
        (["{bag}", "--truth", "x.json"], 3, "x.json: No such file"),
        (["{bag}", "{bag}"], 4, "clip is given twice"),
        (["{bag}", "--set", "colour=red"], 4, "no setting 'colour'"),
        (["nowhere"], 3, "no such file or folder"),
        (["--images", "nowhere"], 3, "no such file or folder"),
        (["--images", ".", "--format", "cocoa"], 4, "unknown format 'cocoa'"),
        (["{bag}", "--export", "csv=x"], 4, "write coco=FILE or mot=DIR"),
        (["{bag}", "--split", "any"], 2, "any"),
    ],
)
def test_refuses_invalid_arguments(tmp_path, arguments, code, word):
    bag = drawn_bag(tmp_path, frames=1)
    ended = evaluate(*(word.format(bag=bag) for word in arguments))
    assert word in ended.stderr
    assert ended.returncode == code
    assert "Traceback" not in ended.stderr
