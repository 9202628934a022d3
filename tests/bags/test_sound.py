"""Sound in bags: from videos, and as recorded by other packages."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from socialbot.bags.conversion import import_bag
from socialbot.bags.playback import feeding
from socialbot.bags.reader import open_bag
from socialbot.bags.sound import sound_of
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, MessageError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData
from socialbot.graph.files import parse_graph

HEARING = parse_graph("name: ears\ninputs: [/audio]\nnodes:\n  hearing: {type: hearing}\n", where="test")
ROS_DRIVERS = {
    "audio_common_msgs/msg/AudioData": "uint8[] data",
    "audio_common_msgs/msg/AudioDataStamped": "std_msgs/Header header\naudio_common_msgs/AudioData audio",
}
PORTABLE = {
    "audio_common_msgs/msg/AudioInfo": "int32 format\nint32 channels\nint32 rate\nint32 chunk",
    "audio_common_msgs/msg/AudioData": (
        "float32[] float32_data\nint32[] int32_data\nint16[] int16_data\nint8[] int8_data\nuint8[] uint8_data"
    ),
    "audio_common_msgs/msg/Audio": ("audio_common_msgs/AudioData audio_data\naudio_common_msgs/AudioInfo info"),
    "audio_common_msgs/msg/AudioStamped": "std_msgs/Header header\naudio_common_msgs/Audio audio",
}


def bag_with(path: Path, definitions: dict[str, str], name: str, make) -> Path:
    """Write a bag with one message, received at 2 s; ``make`` gets the types by their short names."""
    types = get_typestore(Stores.ROS2_JAZZY)
    for each, text in definitions.items():
        types.register(get_types_from_msg(text, each))
    short = SimpleNamespace(**{each.rpartition("/")[2]: kind for each, kind in types.types.items()})
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/audio", name, typestore=types)
        writer.write(connection, 2 * SECOND, types.serialize_cdr(make(short), name))
    return path


def header(types):
    return types.Header(stamp=types.Time(sec=1, nanosec=500), frame_id="")


def read(path: Path) -> AudioData:
    with open_bag(path) as bag:
        assert feeding(bag, HEARING, None) == {"/audio": "/audio"}
        [(_topic, message)] = bag.messages({"/audio": "/audio"}, HEARING.topics())
        assert not bag.skipped
    assert isinstance(message, AudioData)
    return message


def test_bytes_without_a_header_end_at_the_reception(tmp_path: Path) -> None:
    samples = np.arange(1600, dtype="<i2")
    path = bag_with(
        tmp_path / "bag", ROS_DRIVERS, "audio_common_msgs/msg/AudioData",
        lambda types: types.AudioData(data=samples.view(np.uint8)),
    )  # fmt: skip
    assert read(path) == AudioData(stamp=SECOND * 19 // 10, samples=samples.tobytes(), sample_rate=16000)


def test_stamped_bytes(tmp_path: Path) -> None:
    samples = np.arange(100, dtype="<i2")
    path = bag_with(
        tmp_path / "bag", ROS_DRIVERS, "audio_common_msgs/msg/AudioDataStamped",
        lambda types: types.AudioDataStamped(header=header(types), audio=types.AudioData(data=samples.view(np.uint8))),
    )  # fmt: skip
    assert read(path) == AudioData(stamp=SECOND + 500, samples=samples.tobytes(), sample_rate=16000)


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("int16_data", np.array([256, -512], np.int16)),
        ("int32_data", np.array([256 << 16, -512 << 16], np.int32)),
        ("int8_data", np.array([1, -2], np.int8)),
        ("uint8_data", np.array([129, 126], np.uint8)),
        ("float32_data", np.array([1 / 128, -1 / 64], np.float32)),
    ],
)
def test_samples_of_any_kind_with_their_rate(tmp_path: Path, field: str, values: np.ndarray) -> None:
    empty = {
        "float32_data": np.zeros(0, np.float32),
        "int32_data": np.zeros(0, np.int32),
        "int16_data": np.zeros(0, np.int16),
        "int8_data": np.zeros(0, np.int8),
        "uint8_data": np.zeros(0, np.uint8),
    }

    def make(types):
        info = types.AudioInfo(format=8, channels=2, rate=48000, chunk=1)
        audio = types.Audio(audio_data=types.AudioData(**{**empty, field: values}), info=info)
        return types.AudioStamped(header=header(types), audio=audio)

    sound = read(bag_with(tmp_path / "bag", PORTABLE, "audio_common_msgs/msg/AudioStamped", make))
    assert np.frombuffer(sound.samples, "<i2").tolist() == [256, -512]
    assert (sound.stamp, sound.sample_rate, sound.channels) == (SECOND + 500, 48000, 2)


@pytest.mark.parametrize(("data", "why"), [(b"ID3\x04abc", "compressed as mp3"), (b"abc", "3 bytes of sound")])
def test_sound_that_cannot_be_read(data: bytes, why: str) -> None:
    with pytest.raises(MessageError, match=why):
        sound_of(SimpleNamespace(data=data), SECOND)


def make_video(path: Path, *, rate: int = 44100, seconds: float = 2.0, sound: bool = True) -> Path:
    """A video whose picture is white, and whose sound is loud, from 1 s to 1.5 s only."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=20)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        audio = container.add_stream("aac", rate=rate, layout="stereo") if sound else None
        for index in range(round(20 * seconds)):
            pixels = np.full((48, 64, 3), 255 if 20 <= index < 30 else 0, np.uint8)
            for packet in video.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")):
                container.mux(packet)
        for packet in video.encode():
            container.mux(packet)
        if audio is not None:
            times = np.arange(round(rate * seconds)) / rate
            wave = 0.5 * np.sin(2 * np.pi * 440 * times) * ((times >= 1) & (times < 1.5))
            frame = av.AudioFrame.from_ndarray(
                np.stack([wave, wave]).astype(np.float32), format="fltp", layout="stereo"
            )
            frame.sample_rate = rate
            for packet in [*audio.encode(frame), *audio.encode()]:
                container.mux(packet)
    return path


def test_import_keeps_the_sound_of_a_video_in_step_with_its_images(tmp_path: Path) -> None:
    made = import_bag(make_video(tmp_path / "film.mp4"), tmp_path / "bag", start=5 * SECOND)
    assert made.images == 40
    assert made.sound_s == pytest.approx(2.0, abs=0.1)
    with open_bag(made.path) as bag:
        sounds = [message for _, message in bag.messages({"/audio": "/audio"}) if isinstance(message, AudioData)]
        stamps = [message.stamp for _, message in bag.messages({each.name: each.name for each in bag.topics})]
    assert stamps == sorted(stamps)
    assert {(each.sample_rate, each.channels) for each in sounds} == {(44100, 2)}
    levels = {each.stamp: np.abs(np.frombuffer(each.samples, "<i2").astype(int)).max() for each in sounds}
    loud = [stamp / SECOND for stamp, level in levels.items() if level > 8000]
    assert (loud[0], loud[-1]) == (pytest.approx(6.0, abs=0.06), pytest.approx(6.45, abs=0.06))


def test_import_of_a_part_and_without_sound(tmp_path: Path) -> None:
    film = make_video(tmp_path / "film.mp4")
    assert import_bag(film, tmp_path / "part", limit_s=1.0).sound_s == pytest.approx(1.0, abs=0.06)
    assert import_bag(film, tmp_path / "silent", sound=False).sound_s == 0
    silent = make_video(tmp_path / "silent.mp4", sound=False)
    assert import_bag(silent, tmp_path / "none").sound_s == 0


def test_import_without_pyav_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog) -> None:
    film = make_video(tmp_path / "film.mp4")
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    assert import_bag(film, tmp_path / "bag").sound_s == 0
    assert f"its sound, if it has any, is left out: {extra_command('hear')}" in caplog.text


def test_video_with_damaged_sound_is_refused_or_read(tmp_path: Path) -> None:
    film = make_video(tmp_path / "film.mp4")
    film.write_bytes(film.read_bytes()[:3000])
    with pytest.raises(BagError):
        import_bag(film, tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_sound_with_an_unset_header_ends_when_it_was_received():
    unset = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    message = SimpleNamespace(header=unset, audio=SimpleNamespace(data=bytes(32_000)))
    assert sound_of(message, 3 * SECOND).stamp == 2 * SECOND


@pytest.mark.parametrize(
    "begin",
    [
        b"\xff\xfb\xff\xfb",
        b"\xff\xfb\x90\x00",
        b"\xff\xf3\x40\x00",
        b"\xff\xeb\x90\x00",
        b"\xff\xfb\x9c\x00",
        b"\xff\xfb\xf0\x00",
    ],
)
@pytest.mark.parametrize("count", [1598, 20])
def test_loud_samples_are_no_mp3(begin, count):
    samples = begin + np.full(count, -1000, "<i2").tobytes()
    assert sound_of(SimpleNamespace(data=samples), SECOND).samples == samples


@pytest.mark.parametrize(
    ("head", "length"),
    [(b"\xff\xfb\x90\x00", 417), (b"\xff\xfb\x92\x00", 418), (b"\xff\xf3\x80\x00", 208), (b"\xff\xe3\x80\x00", 417)],
)
@pytest.mark.parametrize("frames", [1, 2])
def test_frames_of_mp3_are_refused(head, length, frames):
    with pytest.raises(MessageError, match="compressed as mp3"):
        sound_of(SimpleNamespace(data=(head + bytes(length - 4)) * frames), SECOND)
