from __future__ import annotations

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.core.errors import TruthError
from socialbot.vision.metrics.frames import IgnoreBox, LabelledImage, PersonBox, load_labels

BOX = {"x": 10, "y": 20.5, "w": 30, "h": 90, "distance_m": None, "truncated": False, "occluded": True}
GOOD = {"image": "a.jpg", "complete": False, "boxes": [BOX], "ignore": [{"x": 0, "y": 0, "w": 50, "h": 5}]}


def load(tmp_path, content):
    path = tmp_path / "persons.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
    return load_labels(path)


def test_good_list(tmp_path):
    (picture,) = load(tmp_path, [GOOD])
    assert picture == LabelledImage(
        image="a.jpg",
        complete=False,
        boxes=(PersonBox(x=10, y=20.5, w=30, h=90, occluded=True),),
        ignore=(IgnoreBox(x=0, y=0, w=50, h=5),),
    )


def test_optional_fields_of_labels(tmp_path):
    (picture,) = load(tmp_path, [{"image": "a.jpg", "boxes": [{"x": 1, "y": 2, "w": 3, "h": 4}]}])
    assert picture.complete
    assert picture.boxes[0].distance_m is None
    assert not picture.ignore


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "truncated"),
        ("{}", "list|array"),
        ("[]", "no images in the list"),
        ([{"boxes": []}], "entry 0.*image"),
        ([GOOD, {"image": "b.jpg"}], r"entry 1 \(b.jpg\).*boxes"),
        ([{**GOOD, "boxes": [{**BOX, "w": 0}]}], r"entry 0 \(a.jpg\).*w"),
        ([{**GOOD, "boxes": [{**BOX, "x": "left"}]}], r"boxes.*x"),
        ([{**GOOD, "boxes": [{**BOX, "distance_m": -1}]}], "distance_m"),
        ([{**GOOD, "complete": "yes"}], "complete"),
        ([{**GOOD, "ignore": [[1, 2, 3, 4]]}], "ignore"),
        ([{**GOOD, "ignore": [], "boxes": [{"x": 0.1, "y": 0.2, "w": 0.3, "h": 0.9}]}], "at most 1.*\n.*pixels"),
        ([GOOD, GOOD], "twice, as entries 0 and 1"),
        ([{**GOOD, "boxes": [{**BOX, "x": -31}]}], "outside the image"),
        ([{**GOOD, "image": ""}], "empty"),
        ([3], "entry 0"),
    ],
)
def test_invalid_entry_is_refused(tmp_path, content, words):
    with pytest.raises(TruthError, match=f"(?s){words}") as caught:
        load(tmp_path, content)
    assert "persons.json" in str(caught.value)
    assert caught.value.remedy


def test_missing_file(tmp_path):
    with pytest.raises(TruthError, match=r"none\.json: No such file"):
        load_labels(tmp_path / "none.json")


pixels = st.floats(2, 5000)
people = st.builds(
    PersonBox,
    x=pixels,
    y=pixels,
    w=pixels,
    h=pixels,
    distance_m=st.none() | st.floats(0, 100),
    truncated=st.booleans(),
    occluded=st.booleans(),
)
lists = st.lists(
    st.builds(
        LabelledImage,
        image=st.text(min_size=1, max_size=9),
        complete=st.booleans(),
        boxes=st.lists(people, max_size=3).map(tuple),
        ignore=st.lists(st.builds(IgnoreBox, x=pixels, y=pixels, w=pixels, h=pixels), max_size=2).map(tuple),
    ),
    min_size=1,
    max_size=4,
    unique_by=lambda picture: picture.image,
)


@given(lists)
def test_labels_survive_a_round_trip(tmp_path_factory, pictures):
    path = tmp_path_factory.mktemp("labels") / "persons.json"
    path.write_bytes(msgspec.json.encode(pictures))
    assert load_labels(path) == tuple(pictures)


@pytest.mark.parametrize("content", ["[" * 10_000, "[" + '{"image":' * 10_000])
def test_json_that_is_nested_too_deeply_is_refused(tmp_path, content):
    path = tmp_path / "persons.json"
    path.write_text(content)
    with pytest.raises(TruthError):
        load_labels(path)
