"""Runs as files of other tools, read back by readers that are not ours."""

from __future__ import annotations

import inspect
import resource
import subprocess
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import typer
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.bags.types import DEFINITIONS
from socialbot.cli.export import export
from socialbot.core.errors import BagError, ParameterError
from socialbot.core.messages import CompressedImage, TraceRecord
from socialbot.runs._streams import LEAP, beats, detections_of, minds_of, poses_of, sentences_of
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.foxglove import export_foxglove
from socialbot.runs.rerun import DISTANCES, HEAD, LOG, MINDS, PEOPLE, PICTURE
from tests.system.running import PATIENCE_S, cut, limited, socialbot_here

SECOND = 10**9
PERSON = {
    "x": 10.0,
    "y": 20.0,
    "w": 30.0,
    "h": 60.0,
    "score": 0.9,
    "track_id": "t1",
    "distance_m": 2.0,
    "bearing_rad": 0.0,
}


def record(stamp: int, id: str, kind: str, what: str, cause: str = "", **rest: object) -> TraceRecord:
    source = {"detection": "/humans/bodies/detections", "motion": "/head_controller/joint_trajectory"}.get(
        kind, "waldo"
    )
    return TraceRecord(stamp=stamp, id=id, source=source, kind=kind, what=what, cause=cause, detail=dict(rest))


RECORDS = (
    record(1 * SECOND, "detection-1", "detection", "1 person", persons=[PERSON], width=64, height=48),
    record(1 * SECOND, "w-1", "belief", 'personDetected("Yes")', "detection-1", source="percept"),
    record(1 * SECOND, "w-2", "goal", "GreetPeople()", "w-1"),
    record(2 * SECOND, "motion-2", "motion", "head_pan_joint 0.500 rad, head_tilt_joint -0.250 rad", duration_s=0.5),
    record(3 * SECOND, "w-3", "failure", "GreetPeople()", "w-2", reason="nobody hears"),
)


@pytest.fixture
def run(tmp_path: Path) -> RecordedRun:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "trace.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in RECORDS))
    picture = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].reshape(-1)
    with BagWriter(tmp_path / "bag") as writer:
        writer.write("/camera", CompressedImage(stamp=SECOND, frame_id="camera", format="jpeg", data=picture), SECOND)
    results = {"graph": "waldo", "bag": {"path": str(tmp_path / "bag"), "start": SECOND}}
    (folder / "results.json").write_bytes(msgspec.json.encode(results))
    return open_run(folder)


def test_streams_of_a_run(run: RecordedRun) -> None:
    (found,) = detections_of(run)
    assert (found.width, found.persons[0].track_id) == (64, "t1")
    assert list(poses_of(run)) == [(2 * SECOND, 0.5, -0.25, 0.5)]
    told = list(sentences_of(run))
    assert [one.is_failure for one in told] == [False, False, True]
    assert all(one.text.endswith(".") for one in told)
    first = next(iter(minds_of(run)))
    assert first.agent == "waldo"
    assert [belief.text for belief in first.beliefs] == ['personDetected("Yes")']
    assert any("GreetPeople" in desire for desire in first.desires)


def test_beats_skip_clock_jumps(run: RecordedRun) -> None:
    assert list(beats(run, SECOND)) == [SECOND, 2 * SECOND, 3 * SECOND]
    late = msgspec.structs.replace(RECORDS[-1], stamp=5 * SECOND + LEAP, id="w-4")
    with (run.folder / "trace.jsonl").open("ab") as trace:
        trace.write(msgspec.json.encode(late) + b"\n")
    assert list(beats(open_run(run.folder), SECOND)) == [SECOND, 2 * SECOND, 3 * SECOND, 5 * SECOND + LEAP]


def test_foxglove_file_is_valid_mcap(run: RecordedRun, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    out = tmp_path / "run.mcap"
    with open_bag(tmp_path / "bag") as bag:
        counts = export_foxglove(run, bag, out)
    with out.open("rb") as file:
        opened = reader.make_reader(file)
        summary = opened.get_summary()
        schemas = {each.topic: summary.schemas[each.schema_id] for each in summary.channels.values()}
        times = [message.log_time for _, _, message in opened.iter_messages(log_time_order=False)]
    assert sum(counts.values()) == summary.statistics.message_count == len(times)
    assert times == sorted(times)
    assert schemas["/camera"].name == "sensor_msgs/msg/CompressedImage"
    assert schemas["/humans/bodies/image_annotations"].name == "foxglove_msgs/msg/ImageAnnotations"
    assert schemas["/rosout"].name == "rcl_interfaces/msg/Log"
    assert schemas["/waldo/mind"].name == "socialbot_msgs/msg/Mind"
    assert schemas["/tf"].name == schemas["/tf_static"].name == "tf2_msgs/msg/TFMessage"
    assert all(schema.encoding == "ros2msg" and schema.data for schema in schemas.values())


def test_foxglove_file_has_a_complete_index(run: RecordedRun, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    out = tmp_path / "run.mcap"
    with open_bag(tmp_path / "bag") as bag:
        export_foxglove(run, bag, out)
    with out.open("rb") as file:
        through = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in reader.NonSeekingReader(file, validate_crcs=True).iter_messages()
        ]
    with out.open("rb") as file:
        seeking = reader.SeekingReader(file, validate_crcs=True)
        summary = seeking.get_summary()
        found = [(channel.topic, message.log_time, message.data) for _, channel, message in seeking.iter_messages()]
        sentences = [message.log_time for _, _, message in seeking.iter_messages(topics=["/rosout"])]
        assert seeking.get_header().profile == "ros2"
    assert sorted(found) == sorted(through)
    assert sentences == [SECOND, SECOND, 3 * SECOND]
    assert all(chunk.message_index_offsets for chunk in summary.chunk_indexes)
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (SECOND, 3 * SECOND)
    assert all(channel.message_encoding == "cdr" for channel in summary.channels.values())


@pytest.mark.parametrize("name", ["ImageAnnotations", "PointsAnnotation", "TextAnnotation", "CircleAnnotation"])
def test_annotations_have_the_official_fields(name: str) -> None:
    official = pytest.importorskip("foxglove.messages")
    definition = DEFINITIONS[f"foxglove_msgs/msg/{name}"]
    fields = [words[1] for line in definition.splitlines() if len(words := line.split()) == 2 and "=" not in line]
    assert fields == list(inspect.signature(getattr(official, name)).parameters)


def messages_of(file: Path) -> dict[str, list[Any]]:
    """The messages of a bag by topic, read by the definitions that are in it."""
    told: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([file]) as reader:
        for connection, _, data in reader.messages():
            told[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return told


def headers_of(message: Any) -> Iterator[Any]:
    """Every header that is somewhere in a message."""
    for field in getattr(message, "__dataclass_fields__", ()):
        value = getattr(message, field)
        if field == "header":
            yield value
        for part in value if isinstance(value, list) else [value]:
            yield from headers_of(part)


def test_frames_form_one_tree_and_boxes_match_images(corridor: Path, tmp_path: Path) -> None:
    folder, out = tmp_path / "run", tmp_path / "run.mcap"
    bag = cut(corridor, tmp_path / "visit", 7.0, 9.0)
    done = socialbot_here("replay", bag, "--runner", "inline", "--no-video", "--out", folder)
    assert done.returncode == 0, done.stderr
    export(folder, out)
    told = messages_of(out)
    frames = [frame for topic in ("/tf", "/tf_static") for message in told[topic] for frame in message.transforms]
    parents: dict[str, set[str]] = defaultdict(set)
    for frame in frames:
        parents[frame.child_frame_id].add(frame.header.frame_id)
    assert all(len(above) == 1 for above in parents.values()), "each frame hangs from one"
    named = {header.frame_id for messages in told.values() for message in messages for header in headers_of(message)}
    roots = (named | {above for one in parents.values() for above in one}) - parents.keys() - {""}
    assert roots == {"base_link"}, "each is connected with the foot of the robot"
    pictures, infos = told["/camera/image_raw/compressed"], told["/camera/camera_info"]
    assert {picture.header.frame_id for picture in pictures} == {info.header.frame_id for info in infos}
    assert {one.header.frame_id for one in told["/humans/bodies/detections"]} == {pictures[0].header.frame_id}
    boxes = told["/humans/bodies/image_annotations"]
    taken = {time_of(picture.header.stamp) for picture in pictures}
    assert {time_of(one.timestamp) for one in boxes} == taken, "each picture has its boxes, be there none"
    assert any(one.points for one in boxes)
    for one in boxes:
        assert {time_of(part.timestamp) for part in (*one.points, *one.texts)} <= {time_of(one.timestamp)}
    assert any(len(markers.markers) > 1 for markers in told["/humans/bodies/markers"])
    assert {tuple(state.name) for state in told["/joint_states"]} == {("head_pan_joint", "head_tilt_joint")}


def time_of(stamp: Any) -> int:
    return stamp.sec * SECOND + stamp.nanosec


def test_boxes_frames_and_head_turns(run: RecordedRun, tmp_path: Path) -> None:
    from socialbot.bags.types import RosbagsTypes

    out, types = tmp_path / "run.mcap", RosbagsTypes()
    export_foxglove(run, None, out)
    with open_bag(out) as bag:
        told = [
            (topic, types.deserialize(data, name))
            for topic, _, name, data in bag.raw_messages({topic.name: topic.name for topic in bag.topics})
        ]
    (boxes,) = [message for topic, message in told if topic == "/humans/bodies/image_annotations"]
    assert [(point.x, point.y) for point in boxes.points[0].points] == [(10, 20), (40, 20), (40, 80), (10, 80)]
    assert boxes.texts[0].text == "t1 2.0 m"
    frames = [each for topic, message in told if topic.startswith("/tf") for each in message.transforms]
    parents = {frame.child_frame_id: frame.header.frame_id for frame in frames}
    assert parents == {
        "head_pan_link": "base_link",
        "head_tilt_link": "head_pan_link",
        "camera_link": "base_link",
        "camera_color_optical_frame": "camera_link",
        "body_t1": "base_link",
    }
    turns = {time_of(frame.header.stamp): frame for frame in frames if frame.child_frame_id == "head_pan_link"}
    assert turns[2 * SECOND].transform.rotation.z == 0.0, "it does not begin to turn before it is told to"
    assert turns[2 * SECOND + SECOND // 4].transform.rotation.z == pytest.approx(np.sin(0.125)), "half way"
    pan = [frame for frame in frames if frame.child_frame_id == "head_pan_link"][-1].transform.rotation
    tilt = [frame for frame in frames if frame.child_frame_id == "head_tilt_link"][-1].transform.rotation
    assert (pan.z, tilt.y) == pytest.approx((np.sin(0.25), np.sin(0.125)))
    levels = [message.level for topic, message in told if topic == "/rosout"]
    assert levels == [20, 20, 30]


def test_rerun_recording_is_complete(run: RecordedRun, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    out = tmp_path / "run.rrd"
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what Rerun cannot use it leaves out with a warning
        export(run.folder, out)
    for command in ("verify", "stats"):
        told = subprocess.run([sys.executable, "-m", "rerun", "rrd", command, out], capture_output=True, text=True)
        assert told.returncode == 0, told.stderr
    for part in (
        PICTURE,
        f"{PICTURE}/people",
        PEOPLE,
        f"{HEAD}/pan",
        f"{MINDS}/waldo",
        f"{LOG}/waldo",
        f"{DISTANCES}/t1",
    ):
        assert f"/{part}: " in told.stdout


def test_export_command_prints_a_summary(run: RecordedRun, tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(export)
    answer = CliRunner().invoke(app, [str(run.folder), str(tmp_path / "run.mcap")])
    assert answer.exit_code == 0, answer.output
    assert "5 records of 2.0 s in" in answer.output.replace("\n", " ")
    assert "without pictures" not in answer.output


def test_export_refuses_existing_files_and_unknown_suffixes(run: RecordedRun, tmp_path: Path) -> None:
    (tmp_path / "old.mcap").touch()
    with pytest.raises(BagError, match="already exists"):
        export(run.folder, tmp_path / "old.mcap")
    with pytest.raises(ParameterError, match="the suffix names no format"):
        export(run.folder, tmp_path / "run.bin")


def test_a_full_disk_is_reported_for_the_file_and_leaves_nothing(run: RecordedRun, tmp_path: Path) -> None:
    out = tmp_path / "made" / "run.mcap"
    with limited(resource.RLIMIT_FSIZE, 2000), pytest.raises(BagError) as error:
        export_foxglove(run, None, out)
    assert str(error.value).startswith(f"{out}: cannot be written: File too large")
    assert "/bag" not in str(error.value)
    assert not list(out.parent.iterdir())


def test_a_rerun_recording_that_cannot_be_written_leaves_no_file(run: RecordedRun, tmp_path: Path) -> None:
    """Rerun writes in a thread, so the error comes at the end; in a process of its own, for which Rerun would wait."""
    pytest.importorskip("rerun")
    out = tmp_path / "run.rrd"
    command = f'ulimit -f 4; exec "{sys.executable}" -B -m socialbot export "{run.folder}" "{out}"'
    told = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=PATIENCE_S)
    assert told.returncode == 3, told.stderr
    assert f"{out}: cannot be written" in told.stderr
    assert "Traceback" not in told.stderr
    assert not out.exists()
