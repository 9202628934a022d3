from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.errors import InstallationError
from socialbot.core.messages import CompressedImage
from socialbot.vision import detectors
from socialbot.vision import network as module
from socialbot.vision.detector import iou
from socialbot.vision.detectors import FILE, SHA256, nanodet
from socialbot.vision.images import bgr_from_compressed
from socialbot.vision.metrics.truth import load_truth
from socialbot.vision.network import included_model
from tests.system.running import eventually
from tests.vision.drawn import corridor as empty_room


@pytest.fixture(scope="module")
def finder():
    return nanodet(0.4)


@pytest.fixture(scope="module")
def frames(corridor):
    """Pictures of the committed bag with the people in them, one in twenty."""
    truth = load_truth(corridor.with_suffix(".truth.json"))
    people = {frame.stamp: frame.persons for frame in truth.frames}
    with open_bag(corridor) as bag:
        topic = bag.choose_image_topic()
        images = (image for _, image in bag.messages({topic.name: topic.type}))
        chosen = [image for image in itertools.islice(images, 0, None, 20) if isinstance(image, CompressedImage)]
    return [(bgr_from_compressed(image), people[image.stamp]) for image in chosen]


def test_most_people_of_the_committed_bag_are_found_and_hardly_anything_else(finder, frames):
    seen = found = wrong = 0
    for image, people in frames:
        detections = finder.detect(image)
        clear = [(p.x, p.y, p.w, p.h) for p in people if p.visible > 0.8 and p.distance_m < 12]
        seen += len(clear)
        found += sum(iou(np.array(box), detections.boxes).max(initial=0) > 0.5 for box in clear)
        everybody = np.array([(p.x, p.y, p.w, p.h) for p in people]).reshape(-1, 4)
        wrong += sum(iou(box, everybody).max(initial=0) < 0.1 for box in detections.boxes)
    assert seen > 10
    assert found >= 0.9 * seen
    assert wrong <= 0.05 * seen


@pytest.mark.parametrize(
    "picture", [empty_room(), np.zeros((480, 640, 3), np.uint8), np.full((48, 64, 3), 255, np.uint8)]
)
def test_empty_image_is_empty(finder, picture):
    found = finder.detect(picture)
    assert found.boxes.shape == (0, 4)
    assert found.boxes.dtype == found.scores.dtype == np.float64


def test_threads_change_nothing(frames):
    image = max(frames, key=lambda frame: len(frame[1]))[0]
    one, two = (nanodet(0.1, threads=threads).detect(image) for threads in (1, 2))
    assert len(one) > 0
    assert one.boxes.tobytes() == two.boxes.tobytes()
    assert one.scores.tobytes() == two.scores.tobytes()


@pytest.mark.parametrize("shape", [(1, 1), (7, 900), (900, 7), (120, 160), (375, 1242), (1080, 1920), (640, 480)])
def test_images_of_any_shape(finder, shape):
    assert len(finder.detect(np.zeros((*shape, 3), np.uint8))) == 0


def test_missing_weights_are_an_error_with_a_remedy(monkeypatch):
    monkeypatch.setattr(detectors, "FILE", "elsewhere.onnx")
    with pytest.raises(
        InstallationError, match=r"models/elsewhere\.onnx: No such file(.|\n)*remedy: bring the file back"
    ):
        nanodet(0.4)


def test_changed_weights_are_refused(monkeypatch, tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "nanodet.onnx").write_bytes(included_model(FILE, SHA256)[:-1] + b"\0")
    monkeypatch.setattr(module.resources, "files", lambda package: tmp_path)
    with pytest.raises(InstallationError, match=f"wrong weights(.|\n)*expected {SHA256}(.|\n)*bring the file back"):
        included_model(FILE, SHA256)


def test_notice_names_the_model_file():
    folder = module.resources.files("socialbot.vision") / "models"
    assert SHA256 in (folder / "NOTICE").read_text()
    assert "RangiLyu" in (folder / "LICENSE").read_text()


def test_number_of_threads_is_limited(frames):
    tasks = Path("/proc/self/task")
    before = {task.name for task in tasks.iterdir()}
    finder = nanodet(0.4, threads=2)
    for image, _ in frames[:2]:
        finder.detect(image)
    # The thread that asks waits for them, and the one that limits the time ends soon.
    assert eventually(lambda: len({task.name for task in tasks.iterdir()} - before) <= 2)


def test_people_are_found_in_the_dark(finder, frames):
    clear = [(image, p) for image, people in frames for p in people if p.visible > 0.9 and p.distance_m < 8]
    found = 0
    for image, p in clear:
        dark = finder.detect((image * 0.05).astype(np.uint8))
        found += iou(np.array((p.x, p.y, p.w, p.h)), dark.boxes).max(initial=0) > 0.5
    assert len(clear) > 5
    assert found >= 0.9 * len(clear)
