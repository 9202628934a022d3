"""A mind in a file, and files that are none."""

from __future__ import annotations

import json
import os
from typing import Any

import pytest

from socialbot.bdi import wait
from socialbot.bdi.saving import SCHEMA, VERSION, MindError, read, restore, save, write
from tests.bdi.lab import Lab, X, do, go, p, q
from tests.bdi.minds import mind


def test_a_file_holds_the_schema_and_brings_the_mind_back(tmp_path):
    lab = Lab()
    lab.tell(+p("ä"))
    write(lab.engine, tmp_path / "mind.json")
    data = read(tmp_path / "mind.json")
    assert (data["schema"], data["version"], data["name"]) == (SCHEMA, VERSION, "lab")
    twin = Lab()
    restore(twin.engine, data)
    assert twin.beliefs == ['p("ä")']
    assert [path.name for path in tmp_path.iterdir()] == ["mind.json"]


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    lab = Lab()
    path = tmp_path / "mind.json"
    write(lab.engine, path)
    before = path.read_bytes()
    lab.tell(+p(1))

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(MindError, match="No space left"):
        write(lab.engine, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(MindError, match="cannot write"):
        write(lab.engine, tmp_path / "nowhere" / "mind.json")


def test_a_belief_that_cannot_be_saved_leaves_the_old_file(tmp_path):
    lab = Lab()
    path = tmp_path / "mind.json"
    write(lab.engine, path)
    lab.tell(+p(b"x"))
    with pytest.raises(MindError, match="cannot be saved"):
        write(lab.engine, path)
    assert read(path)["beliefs"] == []


def saved(*changes: tuple[str, object]) -> dict[str, Any]:
    lab = Lab(+p(X).held_for(3) >> [], go() >> [wait(1)])
    lab.tell(+p(1), go())
    lab.engine.random.random()
    data = json.loads(json.dumps(save(lab.engine)))
    data.update(changes)
    return data


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("schema", "other"), "not a saved mind"),
        (("version", 99), "version 99"),
        (("beliefs", [{}]), "damaged"),
        (("beliefs", None), "damaged"),
        (("beliefs", [{"belief": "p", "args": [{}], "annotations": [], "since": 1, "cause": ""}]), "damaged"),
        (("beliefs", [{"belief": "p", "args": [1], "annotations": [], "since": "x", "cause": ""}]), "damaged"),
        (("pursuits", [{"event": "+!go/2", "args": [], "annotations": [], "cause": ""}]), "damaged"),
        (("pursuits", [{"event": "go/0", "args": [], "annotations": [], "cause": ""}]), "damaged"),
        (("ripening", [{}]), "damaged"),
        (("random", [1, 2]), "damaged"),
        (("random", [3, [1, 2], None]), "damaged"),
        (("stage", 3), "damaged"),
        (("records", None), "damaged"),
        (("held_plans", [3]), "damaged"),
    ],
    ids=str,
)
def test_damaged_data_are_an_error_and_change_nothing(change, message):
    lab = Lab(go() >> [wait(1), do("x")])
    lab.tell(+q(1), go())
    before = mind(lab.engine)
    with pytest.raises(MindError, match=message):
        restore(lab.engine, saved(change))
    assert mind(lab.engine) == before
    lab.until(1)
    assert lab.done == ["x"]


def test_data_without_a_part_are_an_error():
    for key in saved():
        data = saved()
        del data[key]
        if key not in ("name", "time"):
            with pytest.raises(MindError):
                restore(Lab().engine, data)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"schema": "socialbot/mind"}', "[" * 100_000, "\0"])
def test_a_file_that_is_no_mind_is_an_error_with_its_name(tmp_path, text):
    path = tmp_path / "mind.json"
    path.write_text(text)
    with pytest.raises(MindError, match=r"mind\.json"):
        read(path)


def test_a_file_cut_off_anywhere_is_an_error(tmp_path):
    path = tmp_path / "mind.json"
    whole = json.dumps(saved())
    for end in range(0, len(whole) - 1, 97):
        path.write_text(whole[:end])
        with pytest.raises(MindError):
            read(path)
    with pytest.raises(MindError, match="cannot read"):
        read(tmp_path / "none.json")
