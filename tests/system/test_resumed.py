"""A restart of `up` after a power cut resumes the saved state of agents."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import cv2
import msgspec
import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.messages import CompressedImage, TraceRecord
from socialbot.vision.images import bgr_from_compressed
from tests.system.running import eventually, running

pytestmark = [pytest.mark.ros, pytest.mark.slow]

PAGE = """
graph: waldo
domain: {domain}
machines: {{laptop: {{address: 127.0.0.1}}}}
nodes: {{camera: laptop, image_converter: laptop, person_detector: laptop, bdi_engine: laptop, listener: laptop,
        speech: laptop, head: laptop}}
minds: minds
parameters:
  camera: {{source: {film}, rate_hz: 10, loop: true}}
  speech: {{playback: 'off'}}
"""
THERE_S = (9.5, 12.0)
"""The part of the corridor in which somebody is near."""


@pytest.fixture
def file(corridor: Path, tmp_path: Path) -> Path:
    """Somebody comes and goes back for ever, and is always there."""
    film = tmp_path / "film.avi"
    begin_s, end_s = THERE_S
    with open_bag(corridor) as bag:
        frames = [
            bgr_from_compressed(message)
            for _, message in bag.messages({topic.name: topic.name for topic in bag.image_topics})
            if isinstance(message, CompressedImage) and begin_s <= (message.stamp - bag.start) / 1e9 < end_s
        ]
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (640, 480))
    for frame in (*frames, *reversed(frames)):
        writer.write(frame)
    writer.release()
    file = tmp_path / "waldo.yaml"
    file.write_text(PAGE.format(domain=os.environ["ROS_DOMAIN_ID"], film=film))
    return file


def told(run: Path, kind: str) -> list[str]:
    """Return the records of a kind, up to the last complete line."""
    trace = run / "trace.jsonl"
    lines = trace.read_bytes().rpartition(b"\n")[0].splitlines() if trace.exists() else []
    records = (msgspec.json.decode(line, type=TraceRecord) for line in lines)
    return [record.what for record in records if record.kind == kind]


def test_greets_nobody_twice_after_a_restart(file: Path, tmp_path: Path) -> None:
    first, second, mind = tmp_path / "first", tmp_path / "second", tmp_path / "minds" / "bdi_engine.json"
    with running("up", file, "--out", first) as up:
        assert eventually(lambda: bool(told(first, "utterance")), 90)
        assert eventually(lambda: mind.exists() and "greeted" in mind.read_text())
        up.send_signal(signal.SIGKILL)
    with running("up", file, "--out", second):
        assert eventually(lambda: told(second, "detection").count("1 person") > 30, 90)
        assert told(first, "utterance")[0] not in told(second, "utterance")
