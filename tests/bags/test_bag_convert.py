"""Bags from one form of messages to the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from socialbot.bags import codec
from socialbot.bags.conversion import convert_bag
from socialbot.bags.reader import BagWriter, RosbagsTypes, open_bag
from socialbot.cli.bag import bag as commands
from socialbot.core.errors import BagError
from socialbot.core.messages import (
    CompressedImage,
    Mind,
    PersonDetection,
    PersonDetections,
    Structured,
    TraceRecord,
    Utterance,
)

TYPES = RosbagsTypes()


class Private(Structured, frozen=True, kw_only=True):
    """A message of somebody else."""

    load: str


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    person = PersonDetection(x=1.5, y=2.0, w=3.0, h=4.0, score=0.1, track_id="t1", distance_m=2.25)
    said = Utterance(stamp=40, id="u1", text="Grüß Gott")
    with BagWriter(tmp_path / "recorded") as writer:
        writer.write(
            "/camera", CompressedImage(stamp=1, frame_id="c", format="jpeg", data=np.arange(9, dtype=np.uint8)), 5
        )
        writer.write("/detections", PersonDetections(stamp=1, frame_id="c", width=64, height=48, persons=(person,)), 10)
        record = TraceRecord(stamp=30, id="a-1", source="waldo", kind="did", what="x", detail={"n": [1, 2.5, "é"]})
        writer.write("/waldo/trace", record, 20)
        writer.write("/waldo/trace", TraceRecord(stamp=3, id="a-2", source="waldo", kind="did", what="early"), 30)
        writer.write("/waldo/mind", Mind(stamp=35, agent="waldo", beliefs=(), desires=("d",), intentions=()), 35)
        writer.write("/speech/say", said, 40)
        plain = TYPES.serialize(TYPES.make(codec.STRING, data="Good morning"))
        writer.write_raw("/speech/say", codec.STRING, plain, 50)
        writer.write("/private", Private(stamp=1, load="crate"), 60)
        writer.write_raw(
            "/other", "somebody_msgs/msg/Own", b"\0\1\0\0\7\0\0\0", 70, type_hash="RIHS01_7", definition="uint32 n\n"
        )
    return tmp_path / "recorded"


def contents(path: Path) -> list[tuple[str, int, str, bytes]]:
    with open_bag(path) as bag:
        return list(bag.raw_messages({topic.name: topic.name for topic in bag.topics}))


def said_in(path: Path) -> list[object]:
    with open_bag(path) as bag:
        known = {topic.name: topic.name for topic in bag.topics if topic.name not in ("/other", "/camera", "/private")}
        return list(bag.messages(known))


def test_there_and_back_every_byte_is_the_same(recorded: Path, tmp_path: Path) -> None:
    there = convert_bag(recorded, tmp_path / "typed", "typed")
    assert (there.messages, there.converted) == (9, 5)
    assert {topic: kept.first for topic, kept in there.kept.items()} == {
        "/speech/say": "plain text",
        "/private": there.kept["/private"].first,
    }
    back = convert_bag(tmp_path / "typed", tmp_path / "back", "json")
    assert back.converted == 5
    assert contents(tmp_path / "back") == contents(recorded)
    for path in (tmp_path / "typed", tmp_path / "back"):
        with open_bag(path) as bag:
            assert bag.is_latched("/waldo/mind")
            assert not bag.is_latched("/speech/say")
            assert bag.definition("somebody_msgs/msg/Own") == ("uint32 n\n", "RIHS01_7")


def test_a_typed_bag_says_the_same(recorded: Path, tmp_path: Path) -> None:
    convert_bag(recorded, tmp_path / "typed", "typed", storage="sqlite3")
    assert said_in(tmp_path / "typed") == said_in(recorded)
    types = {topic: name for topic, _, name, _ in contents(tmp_path / "typed")}
    assert types["/waldo/trace"] == "socialbot_msgs/msg/TraceRecord"
    assert types["/private"] == codec.STRING


def test_what_has_the_form_already_stays_byte_for_byte(recorded: Path, tmp_path: Path) -> None:
    made = convert_bag(recorded, tmp_path / "again", "json")
    assert made.converted == 0
    assert contents(tmp_path / "again") == contents(recorded)


def test_the_graph_of_a_bag_goes_along(recorded: Path, tmp_path: Path) -> None:
    (recorded / "graph.yaml").write_text("name: g\n")
    convert_bag(recorded, tmp_path / "typed", "typed")
    names = {file.name for file in (tmp_path / "typed").iterdir()}
    assert names == {"graph.yaml", "metadata.yaml", "typed.mcap"}
    assert (tmp_path / "typed" / "graph.yaml").read_text() == "name: g\n"


def test_no_bag_is_written_over(recorded: Path) -> None:
    with pytest.raises(BagError, match="already exists"):
        convert_bag(recorded, recorded, "typed")


def test_the_command_tells_what_it_did(recorded: Path, tmp_path: Path) -> None:
    answer = CliRunner().invoke(commands, ["convert", str(recorded), str(tmp_path / "t"), "--wire", "typed"])
    assert answer.exit_code == 0, answer.output
    assert "as before: /speech/say: 1, first: plain text" in answer.output
    assert "5 of them now typed" in " ".join(answer.output.split())
