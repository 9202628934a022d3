"""Forget a person of a run: nothing of them is left, and everything of the others is."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import RunError
from socialbot.core.messages import TraceRecord
from socialbot.runs.folder import open_run
from socialbot.runs.forgetting import forget_person
from socialbot.runs.record import RunTrace
from tests.system.running import socialbot_here

START = 1_000 * SECOND
SOURCE = "/humans/bodies/detections"


def frame(at_s: float, **places: float) -> TraceRecord:
    stamp = START + round(at_s * SECOND)
    persons = [{"track_id": name, "x": x, "y": 20.5, "w": 40.0, "h": 100.0, "score": 0.9} for name, x in places.items()]
    what = f"{len(persons)} {'person' if len(persons) == 1 else 'persons'}"
    detail = {"persons": persons, "width": 640, "height": 480} if persons else {}
    return TraceRecord(
        stamp=stamp, id=f"detection-{stamp}", source=SOURCE, kind="detection", what=what, cause="", detail=detail
    )


def acted(at_s: float, kind: str, id: str, what: str, cause: str = "", source: str = "waldo") -> TraceRecord:
    return TraceRecord(stamp=START + round(at_s * SECOND), id=id, source=source, kind=kind, what=what, cause=cause)


def detection_id(at_s: float) -> str:
    return f"detection-{START + round(at_s * SECOND)}"


RECORDS = [
    frame(0.0),
    acted(0.5, "action", "a0", "stayIdle()"),
    frame(1.0, t1=101.25),
    acted(1.0, "belief", "b1", 'personDetected("Yes")', detection_id(1.0)),
    acted(1.1, "utterance", "u1", "Hello! Nice to see you.", "b1", "/speech/say"),
    acted(1.2, "motion", "m1", "head_pan_joint 0.321 rad"),
    frame(2.0, t1=102.25, t10=300.75),
    acted(2.0, "belief", "b2", 'engages("t10")', detection_id(2.0)),
    acted(2.1, "belief", "b3", 'engages("t1")', detection_id(2.0)),
    acted(2.2, "goal", "g3", "GreetPeople()", "b3"),
    acted(2.3, "action", "a3", 'speak("greeting")', "g3"),
    acted(2.4, "utterance", "u3", "Hello again!", "a3", "/speech/say"),
    acted(2.5, "utterance", "u2", "Hello, you there!", "b2", "/speech/say"),
    frame(3.0, t10=301.75),
    acted(3.5, "unbelief", "b4", 'engages("t1")'),
    acted(3.6, "belief", "b5", 'returned("t1", "t10")'),
    frame(4.0, t1=103.25),
    frame(5.0),
    acted(6.0, "belief", "b6", 'personDetected("No")', detection_id(5.0)),
    acted(20.0, "action", "a7", "stayIdle()"),
]


@pytest.fixture
def run(tmp_path) -> Path:
    folder = tmp_path / "run"
    (folder / "speech").mkdir(parents=True)
    (folder / "log").mkdir()
    lines = [msgspec.json.encode(record) for record in RECORDS]
    (folder / "trace.jsonl").write_bytes(b"".join(line + b"\n" for line in lines) + b'{"half a line about t1')
    seen = [{"topic": "/world", "message": {"near": "t1"}}, {"topic": "/world", "message": {"near": "t10"}}]
    (folder / "seen.jsonl").write_text("".join(json.dumps(line) + "\n" for line in seen))
    (folder / "scored.jsonl").write_text('{"x": 101.25}\n')
    results = {
        "graph": "waldo",
        "ended": "well",
        "actions": [{"t_s": 2.3, "id": "a3", "name": "speak"}, {"t_s": 20.0, "id": "a7", "name": "stayIdle"}],
        "utterances": [{"t_s": at, "id": id, "text": "Hello"} for at, id in ((1.1, "u1"), (2.4, "u3"), (2.5, "u2"))],
        "scores": {"frames": 3},
        "labels": {"visitor": "t1"},
    }
    (folder / "results.json").write_text(json.dumps(results))
    (folder / "report.html").write_text("a picture of t1")
    (folder / "annotated.mp4").write_bytes(b"t1")
    (folder / "speech" / "001-hello.wav").write_bytes(b"RIFF")
    (folder / "log" / "waldo.log").write_text("t1 came\nt10 came\n")
    return folder


def test_nothing_of_the_person_is_left(run):
    made = forget_person(run, "t1")
    text = {path.name: path.read_text("utf-8") for path in run.rglob("*") if path.is_file()}
    everything = "\n".join(text.values())
    assert not re.search(r"\bt1\b", everything)
    for trace_of_them in (
        "101.25",
        "102.25",
        "103.25",
        "0.321",
        "Nice to see you",
        "Hello again",
        "GreetPeople",
        "speak",
    ):
        assert trace_of_them not in everything
    assert 'personDetected("Yes")'.replace('"', '\\"') not in everything  # nobody else was there
    assert 'personDetected("No")'.replace('"', '\\"') not in everything  # when they left
    assert sorted(text) == ["results.json", "seen.jsonl", "trace.jsonl", "waldo.log"]
    assert (made.frames, made.left) == (3, [])
    assert sorted(made.files) == ["annotated.mp4", "report.html", "scored.jsonl", "speech/001-hello.wav"]


def test_others_may_still_read_what_is_left(run):
    names = ("trace.jsonl", "seen.jsonl", "results.json", "log/waldo.log")
    for name in names:
        (run / name).chmod(0o644)
    forget_person(run, "t1")
    assert {oct((run / name).stat().st_mode & 0o777) for name in names} == {"0o644"}


def test_another_run_in_the_folder_is_named_as_left(run):
    inner = run / "unchanged"
    inner.mkdir()
    (inner / "trace.jsonl").write_bytes((run / "trace.jsonl").read_bytes())
    assert forget_person(run, "t1").left == ["unchanged/trace.jsonl"]


@pytest.mark.parametrize("name", ["face.webp", "lab.avi", "voice.ogg", "table.parquet", "bag/bag_0.db3", "notes.zip"])
def test_a_file_that_cannot_be_searched_is_named_as_left(run, name):
    """Nobody can say what a film or an archive holds."""
    (run / name).parent.mkdir(exist_ok=True)
    (run / name).write_bytes(b"RIFF\x00\xff\xfe of somebody")
    assert forget_person(run, "t1").left == [name]


def heard(at_s: float, text: str, person: str = "") -> TraceRecord:
    record = acted(at_s, "hearing", f"heard-{at_s}", text, source="/humans/voices/speech")
    return msgspec.structs.replace(record, detail={"start": record.stamp, "person": person} if person else {})


def test_sentences_whose_speaker_is_not_known_are_named_as_left(run):
    """In the frame at 2 s are two people, and one of them says a name."""
    said = [heard(2.1, "My name is Ann"), heard(2.2, "Not me", "t10"), heard(2.3, "Me", "t1"), heard(20.0, "Hello?")]
    with (run / "trace.jsonl").open("wb") as file:
        file.writelines(msgspec.json.encode(each) + b"\n" for each in (*RECORDS, *said))
    done = socialbot_here("forget", run, "--person", "t1")
    assert "2 heard sentences of unknown speakers" in done.stdout
    assert [each.what for each in open_run(run).history if each.kind == "hearing"] == [
        "My name is Ann", "Not me", "Hello?",
    ]  # fmt: skip


def test_files_outside_of_the_folder_stay_as_they_are(run, tmp_path):
    """A run from somebody else may hold links."""
    outside = tmp_path / "notes.log"
    outside.write_text("t1 came\n")
    (run / "notes.log").symlink_to(outside)
    assert forget_person(run, "t1").left == ["notes.log"]
    assert outside.read_text() == "t1 came\n"


@pytest.mark.parametrize("name", ["trace.jsonl", "seen.jsonl", "results.json"])
def test_a_record_that_is_a_link_to_elsewhere_is_refused(run, tmp_path, name):
    outside = (run / name).rename(tmp_path / name)
    before = outside.read_bytes()
    (run / name).symlink_to(outside)
    with pytest.raises(RunError, match="link"):
        forget_person(run, "t1")
    assert outside.read_bytes() == before


def test_everything_of_the_others_is_left(run):
    forget_person(run, "t1")
    records = list(open_run(run).history)
    assert [record.id for record in records if record.kind != "detection"] == ["a0", "b2", "u2", "a7"]
    people = [
        [one["track_id"] for one in each.detail.get("persons", ())] for each in records if each.kind == "detection"
    ]
    assert people == [[], [], ["t10"], ["t10"], [], []]
    frames = [each for each in records if each.kind == "detection"]
    assert frames[1].what == "0 persons"
    assert frames[1].detail == frames[0].detail == {}
    results = json.loads((run / "results.json").read_text())
    assert [each["id"] for each in results["actions"]] == ["a7"]
    assert [each["id"] for each in results["utterances"]] == ["u2"]
    assert results["scores"] is None
    assert "t10" in (run / "seen.jsonl").read_text()
    assert (run / "log" / "waldo.log").read_text() == "t10 came\n"


def test_all_people_can_be_forgotten_one_by_one(run):
    forget_person(run, "t1")
    forget_person(run, "t10")
    assert not re.search(r"\bt10?\b", (run / "trace.jsonl").read_text())
    with pytest.raises(RunError, match="nobody was seen"):
        forget_person(run, "t10")


def test_an_unknown_person_changes_nothing(run):
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match="no person 't2'"):
        forget_person(run, "t2")
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("results", ["", "[", "[]", "[" * 100_000, '{"actions": 3}', '{"utterances": ["t1"]}'])
def test_a_run_with_damaged_results_is_refused_before_any_change(run, results):
    (run / "results.json").write_text(results)
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match=r"results\.json: cannot be read"):
        forget_person(run, "t1")
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


def test_the_command_says_what_it_did_and_what_it_left(run):
    results = json.loads((run / "results.json").read_text())
    (run / "results.json").write_text(json.dumps({**results, "bag": {"path": "/data/lab"}}))
    done = socialbot_here("forget", run, "--person", "t1")
    assert done.returncode == 0, done.stderr
    assert "t1 is removed from 3 frames" in done.stdout
    assert "the bag /data/lab still shows them" in done.stdout
    refused = socialbot_here("forget", run, "--person", "t1")
    assert refused.returncode == 3
    assert "no person 't1'" in refused.stderr


def test_a_run_that_is_still_recorded_is_refused(tmp_path):
    """Its recorder would go on in a file that nobody finds, and then stop."""
    with RunTrace(tmp_path / "run", lossy=True) as trace:
        for record in RECORDS:
            trace.observe("/waldo/trace", record)
        with pytest.raises(RunError, match="still recorded"):
            forget_person(tmp_path / "run", "t1")
        trace.observe("/waldo/trace", RECORDS[0])
        assert trace.lost == 0
        assert len((tmp_path / "run" / "trace.jsonl").read_bytes().splitlines()) == len(RECORDS) + 1
    assert forget_person(tmp_path / "run", "t1").frames
