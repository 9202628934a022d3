from __future__ import annotations

import copy
import json

import pytest

from socialbot.core.errors import TruthError
from socialbot.vision.metrics.truth import TruthObject, TruthPerson, load_truth, truth_from_messages

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


def test_good_file(tmp_path):
    truth = load(tmp_path, GOOD)
    assert truth.image_topic == "/camera/image_raw"
    assert [frame.stamp for frame in truth.frames] == [10, 20]
    assert truth.frames[1].persons == (TruthPerson(id="p1", x=1, y=2.5, w=3, h=4, distance_m=5, visible=1.0),)


def test_optional_fields_of_truth(tmp_path):
    thing = {"kind": "coat stand", "x": 1, "y": 2, "w": 3, "h": 4}
    frames = [{"stamp": 10, "persons": [], "light": "sun", "objects": [{**thing, "kind": "shadow"}]}]
    truth = load(tmp_path, {**GOOD, "scene": "scene2", "split": "held-back", "objects": [thing], "frames": frames})
    assert (truth.scene, truth.split) == ("scene2", "held-back")
    assert truth.objects == (TruthObject(kind="coat stand", x=1, y=2, w=3, h=4),)
    assert truth.frames[0].objects == (TruthObject(kind="shadow", x=1, y=2, w=3, h=4),)
    assert truth.frames[0].light == "sun"


def test_facing_and_posture_of_a_person(tmp_path):
    person = {**GOOD["frames"][1]["persons"][0], "facing_rad": 1.57, "posture": "seated"}
    truth = load(tmp_path, {**GOOD, "frames": [{"stamp": 10, "persons": [person]}]})
    assert (truth.frames[0].persons[0].facing_rad, truth.frames[0].persons[0].posture) == (1.57, "seated")


def test_defaults_of_truth(tmp_path):
    truth = load(tmp_path, GOOD)
    assert (truth.frames[1].persons[0].facing_rad, truth.frames[1].persons[0].posture) == (None, "unknown")
    assert (truth.scene, truth.split, truth.objects) == ("", "", ())
    assert (truth.frames[0].objects, truth.frames[0].light) == ((), "")


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
        (changed("split", value="test"), "split"),
        (changed("scene", value=1), "scene"),
        (changed("objects", value=[{"x": 1, "y": 2, "w": 3, "h": 4}]), "kind"),
    ],
)
def test_invalid_file_is_refused(tmp_path, content, word):
    with pytest.raises(TruthError, match=word) as caught:
        load(tmp_path, content)
    assert "corridor.truth.json" in str(caught.value)
    assert caught.value.remedy


def test_missing_file(tmp_path):
    with pytest.raises(TruthError, match=r"none\.json: No such file"):
        load_truth(tmp_path / "none.json")


MESSAGE = {
    "schema": "socialbot/truth_frame",
    "version": 1,
    "stamp": 10,
    "image_topic": "/camera/image_raw",
    "scene": "scene1",
    "split": "tune",
    "light": "dim",
    "persons": GOOD["frames"][1]["persons"],
    "objects": [{"kind": "poster", "x": 1, "y": 2, "w": 3, "h": 4}],
}


def from_messages(*messages):
    texts = [message if isinstance(message, str) else json.dumps(message) for message in messages]
    return truth_from_messages(texts, "hall.bag")


def test_truth_from_the_messages_of_a_bag():
    truth = from_messages(MESSAGE, {**MESSAGE, "stamp": 20, "persons": [], "objects": []})
    assert (truth.image_topic, truth.scene, truth.split, truth.objects) == ("/camera/image_raw", "scene1", "tune", ())
    assert [(frame.stamp, len(frame.persons), len(frame.objects)) for frame in truth.frames] == [(10, 1, 1), (20, 0, 0)]
    assert truth.frames[0].light == "dim"


@pytest.mark.parametrize(
    ("messages", "word"),
    [
        ([], "no message"),
        (["{"], "message 0.*truncated"),
        ([MESSAGE, "hello"], "message 1"),
        ([{**MESSAGE, "schema": "socialbot/truth"}], "message 0"),
        ([{**MESSAGE, "version": 2}], "message 0"),
        ([{key: value for key, value in MESSAGE.items() if key != "persons"}], "persons"),
        ([MESSAGE, MESSAGE], "frame 10 follows 10"),
        ([MESSAGE, {**MESSAGE, "stamp": 20, "split": "held-back"}], "split 'held-back'"),
        ([MESSAGE, {**MESSAGE, "stamp": 20, "image_topic": "/other"}], "/other"),
    ],
)
def test_invalid_messages_are_refused(messages, word):
    with pytest.raises(TruthError, match=word) as caught:
        from_messages(*messages)
    assert "hall.bag" in str(caught.value)
    assert caught.value.remedy


def test_json_that_is_nested_too_deeply_is_refused(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text('{"frames":' + "[" * 10_000)
    with pytest.raises(TruthError):
        load_truth(path)
    with pytest.raises(TruthError, match="message 0"):
        truth_from_messages(['{"persons":' + "[" * 10_000], "hall.bag")
