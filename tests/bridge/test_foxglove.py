"""Runs as files of other tools, read back by readers that are not ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from socialbot.bridge.bags import BagWriter, open_bag
from socialbot.bridge.foxglove import export_foxglove
from socialbot.commands.export import export
from socialbot.errors import BagError, ParameterError
from socialbot.inspect.run_folder import RecordedRun, open_run
from socialbot.inspect.streams import detections_of, minds_of, poses_of, sentences_of
from socialbot.messages import CompressedImage, TraceRecord

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
    record(2 * SECOND, "motion-2", "motion", "head_pan_joint 0.500 rad, head_tilt_joint -0.250 rad"),
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


def test_streams_tell_what_the_record_tells(run: RecordedRun) -> None:
    (found,) = detections_of(run)
    assert (found.width, found.persons[0].track_id) == (64, "t1")
    assert [(pose.pan, pose.tilt) for pose in poses_of(run)] == [(0.5, -0.25)]
    told = list(sentences_of(run))
    assert [one.is_failure for one in told] == [False, False, True]
    assert all(one.text.endswith(".") for one in told)
    first = next(iter(minds_of(run)))
    assert first.agent == "waldo"
    assert [belief.text for belief in first.beliefs] == ['personDetected("Yes")']
    assert any("GreetPeople" in desire for desire in first.desires)


def test_the_file_for_foxglove_is_read_by_another_reader(run: RecordedRun, tmp_path: Path) -> None:
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


def test_boxes_frames_and_turns_are_where_they_should_be(run: RecordedRun, tmp_path: Path) -> None:
    from socialbot.bridge.bag_types import RosbagsTypes

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
    pan = [frame for frame in frames if frame.child_frame_id == "head_pan_link"][-1].transform.rotation
    tilt = [frame for frame in frames if frame.child_frame_id == "head_tilt_link"][-1].transform.rotation
    assert (pan.z, tilt.y) == pytest.approx((np.sin(0.25), np.sin(0.125)))
    levels = [message.level for topic, message in told if topic == "/rosout"]
    assert levels == [20, 20, 30]


def test_the_recording_for_rerun_is_whole(run: RecordedRun, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    out = tmp_path / "run.rrd"
    export(run.folder, out)
    for command in ("verify", "stats"):
        told = subprocess.run([sys.executable, "-m", "rerun", "rrd", command, out], capture_output=True, text=True)
        assert told.returncode == 0, told.stderr
    for part in ("/camera", "/camera/people", "/head/pan_rad", "/minds/waldo", "/log/waldo", "/people/t1/distance_m"):
        assert f"{part}: 1" in told.stdout


def test_the_command_tells_what_it_wrote(run: RecordedRun, tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(export)
    answer = CliRunner().invoke(app, [str(run.folder), str(tmp_path / "run.mcap")])
    assert answer.exit_code == 0, answer.output
    assert "5 records of 2.0 s in" in answer.output.replace("\n", " ")
    assert "without pictures" not in answer.output


def test_nothing_is_written_over_or_guessed(run: RecordedRun, tmp_path: Path) -> None:
    (tmp_path / "old.mcap").touch()
    with pytest.raises(BagError, match="already exists"):
        export(run.folder, tmp_path / "old.mcap")
    with pytest.raises(ParameterError, match="does not say for which tool"):
        export(run.folder, tmp_path / "run.bin")
