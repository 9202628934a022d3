from __future__ import annotations

import copy
import json

import pytest

from socialbot.errors import TruthError
from socialbot.vision.truth import TruthPerson, load_truth

GOOD = {
    "schema": "socialbot/truth",
    "version": 1,
    "image_topic": "/camera/image_raw",
    "frames": [
        {"stamp": 10, "persons": []},
        {
            "stamp": 20,
            "persons": [{"id": "p1", "x": 1, "y": 2.5, "w": 3, "h": 4, "distance_m": 5, "visible": 1.0, "facing": 0}],
        },
    ],
}


def load(tmp_path, content):
    path = tmp_path / "corridor.truth.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return load_truth(path)


def test_a_good_file(tmp_path):
    truth = load(tmp_path, GOOD)
    assert truth.image_topic == "/camera/image_raw"
    assert [frame.stamp for frame in truth.frames] == [10, 20]
    assert truth.frames[1].persons == (TruthPerson(id="p1", x=1, y=2.5, w=3, h=4, distance_m=5, visible=1.0),)


def changed(*path, value=None):
    content = copy.deepcopy(GOOD)
    place = content
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return content


PERSON = ("frames", 1, "persons", 0)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "truncated"),
        ("{", "truncated"),
        ("[]", "array"),
        ("\xff", "JSON"),
        (changed("schema"), "schema"),
        (changed("version"), "version"),
        (changed("schema", value="other"), "other"),
        (changed("version", value=2), "2"),
        (changed("image_topic"), "image_topic"),
        (changed("frames"), "frames"),
        (changed("frames", 0, "stamp", value=1.5), "stamp"),
        (changed("frames", 0, "stamp", value=20), "20 follows 20|frame 20"),
        (changed("frames", 0, "stamp", value=30), "frame 20 follows 30"),
        (changed(*PERSON, "id"), "id"),
        (changed(*PERSON, "id", value=3), "id"),
        (changed(*PERSON, "w", value=-1), "w"),
        (changed(*PERSON, "visible", value=1.2), "visible"),
        (changed(*PERSON, "distance_m", value="far"), "distance_m"),
    ],
)
def test_what_does_not_fit_is_an_error_that_names_the_file(tmp_path, content, word):
    with pytest.raises(TruthError, match=word) as caught:
        load(tmp_path, content)
    assert "corridor.truth.json" in str(caught.value)
    assert caught.value.remedy


def test_a_missing_file(tmp_path):
    with pytest.raises(TruthError, match=r"none\.json: No such file"):
        load_truth(tmp_path / "none.json")
