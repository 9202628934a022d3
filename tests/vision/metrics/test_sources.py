from __future__ import annotations

import json

import msgspec
import pytest

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, ImageError, TruthError
from socialbot.vision.metrics.frames import bag_source, image_sources, with_own_names
from tests.vision.metrics.scenes import START, drawn_bag, drawn_pictures


def test_bag_with_its_truth_beside_it(corridor):
    source = bag_source(corridor)
    assert (source.name, source.scene, source.split, len(source.frames)) == ("corridor", "corridor", "", 420)
    blocks = [frame.block for frame in source.frames]
    assert blocks == sorted(blocks)
    assert [blocks.count(block) for block in range(14)] == [30] * 14
    assert sum(len(frame.persons) for frame in source.frames) == 399


def test_truth_in_a_bag_equals_truth_beside_it(tmp_path):
    beside = bag_source(drawn_bag(tmp_path, "one", scene="hall", split="tune"))
    inside = bag_source(drawn_bag(tmp_path, "two", beside=False, inside=True, scene="hall", split="tune"))
    assert (inside.scene, inside.split) == ("hall", "tune")
    assert inside.frames == beside.frames


def test_objects_of_the_recording_are_in_every_frame(tmp_path):
    bag = drawn_bag(tmp_path, frames=2)
    path = tmp_path / "clip.truth.json"
    content = json.loads(path.read_text())
    thing = {"x": 1, "y": 2, "w": 3, "h": 4}
    content["objects"] = [{"kind": "poster", **thing}]
    content["frames"][1]["objects"] = [{"kind": "shadow", **thing}]
    path.write_text(json.dumps(content))
    kinds = [[each.kind for each in frame.objects] for frame in bag_source(bag).frames]
    assert kinds == [["poster"], ["poster", "shadow"]]


def test_bags_of_the_same_name_are_named_by_their_folders(tmp_path):
    days = [tmp_path / lab / "monday" for lab in ("east", "west")] + [tmp_path / "east" / "friday"]
    paths = []
    for day in days:
        day.mkdir(parents=True)
        paths.append(drawn_bag(day, "walk", frames=2))
    paths.append(drawn_bag(tmp_path, "other", frames=2))
    sources = with_own_names([(path, bag_source(path)) for path in paths])
    assert [source.name for source in sources] == ["east/monday/walk", "west/monday/walk", "friday/walk", "other"]


def test_a_bag_that_is_given_twice_keeps_its_name(tmp_path):
    bag = drawn_bag(tmp_path, "walk", frames=2)
    assert [source.name for source in with_own_names([(bag, bag_source(bag))] * 2)] == ["walk", "walk"]


@pytest.mark.parametrize("beside", [True, False])
def test_dot_belongs_to_the_name_of_a_folder(tmp_path, beside):
    bags = [drawn_bag(tmp_path, name, frames=1, beside=beside, inside=not beside) for name in ("run.1", "run.2")]
    assert [bag_source(bag).name for bag in bags] == ["run.1", "run.2"]


def test_single_file_is_called_by_its_name_without_the_suffix(tmp_path):
    folder = drawn_bag(tmp_path, frames=1)
    (file,) = folder.glob("*.mcap")
    alone = file.rename(tmp_path / "run.1.mcap")
    (tmp_path / "clip.truth.json").rename(tmp_path / "run.1.truth.json")
    assert bag_source(alone).name == "run.1"


@pytest.mark.parametrize("apart_s", [-1_690_000_000, 7200])
def test_truth_with_the_stamps_of_headers_fits_images_on_a_corrected_clock(tmp_path, apart_s):
    """The camera counts from its start, or its clock is ahead; it starts again between the last two images."""
    bag = drawn_bag(tmp_path, frames=4)
    truth = json.loads((tmp_path / "clip.truth.json").read_text())
    topic, apart, back = truth["image_topic"], apart_s * SECOND, 50 * SECOND
    with open_bag(bag) as recorded, BagWriter(tmp_path / "boot") as writer:
        images = [message for _, message in recorded.messages({topic: topic})]
        for number, image in enumerate(images):
            header = image.stamp + apart - (back if number == 3 else 0)
            writer.write(topic, msgspec.structs.replace(image, stamp=header), image.stamp)
            truth["frames"][number]["stamp"] = header
    truth["frames"].sort(key=lambda frame: frame["stamp"])
    (tmp_path / "labels.json").write_text(json.dumps(truth))
    source = bag_source(tmp_path / "boot", tmp_path / "labels.json")
    expected = bag_source(bag).frames
    assert [(frame.stamp, frame.persons) for frame in source.frames] == [
        (frame.stamp, frame.persons) for frame in expected
    ]
    assert [image.stamp for image in source.images.read()] == [frame.stamp for frame in expected]


def test_bag_without_truth(tmp_path):
    with pytest.raises(TruthError, match=r"clip: no ground truth.*\n.*clip\.truth\.json"):
        bag_source(drawn_bag(tmp_path, beside=False))


def test_truth_of_another_topic(tmp_path):
    bag = drawn_bag(tmp_path, frames=1)
    path = tmp_path / "clip.truth.json"
    path.write_text(path.read_text().replace("/camera/image_raw/compressed", "/other"))
    with pytest.raises(BagError, match="no topic '/other'"):
        bag_source(bag)


def test_labelled_images(tmp_path):
    (source,) = image_sources(drawn_pictures(tmp_path / "hall"))
    assert (source.name, source.scene) == ("hall", "hall")
    assert [frame.name for frame in source.frames] == ["0.png", "1.png", "2.png"]
    assert [frame.stamp for frame in source.frames] == [encoded.stamp for encoded in source.images.read()]
    assert all(frame.ranged for frame in source.frames)
    assert len({frame.block for frame in source.frames}) == 3


def test_labels_may_name_scenes(tmp_path):
    folder = drawn_pictures(tmp_path / "hall")
    entries = json.loads((folder / "persons.json").read_text())
    entries[1]["scene"] = "stairs"
    (folder / "persons.json").write_text(json.dumps(entries))
    assert {source.scene: len(source.frames) for source in image_sources(folder)} == {"hall": 2, "stairs": 1}


def test_where_no_distance_is_known_distances_mean_nothing(tmp_path):
    (source,) = image_sources(drawn_pictures(tmp_path / "hall", distance=None))
    assert not any(frame.ranged for frame in source.frames)


def test_images_that_are_missing(tmp_path):
    folder = drawn_pictures(tmp_path / "hall")
    (folder / "1.png").unlink()
    with pytest.raises(ImageError, match=r"1 of 3 images.*the first: 1\.png"):
        image_sources(folder)


def test_stamps_are_those_of_the_images(tmp_path):
    source = bag_source(drawn_bag(tmp_path, frames=3))
    assert [encoded.stamp for encoded in source.images.read()] == [frame.stamp for frame in source.frames]
    assert source.frames[0].stamp == START
    assert source.frames[2].name == "0.2 s"
