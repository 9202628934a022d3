"""Bags with sound: the same speech is heard in each replay, in one thread and over ROS."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np
import pytest

from socialbot.bags.conversion import import_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import HeardSpeech, Message
from socialbot.graph.files import parse_graph
from socialbot.runtime.bag_source import replay
from socialbot.speech.audio import RATE_HZ, chunks_of
from tests.speech.sounds import silence, spoken

EARS = """
name: ears
inputs: [/audio]
nodes:
  hearing: {type: hearing, parameters: {languages: en}}
"""
EYES_AND_EARS = """
name: eyes_and_ears
inputs: [/audio, /camera/image_raw/compressed, /camera/camera_info]
paced_by: /humans/bodies/detections
nodes:
  image_converter: {type: image_converter}
  person_detector: {type: person_detector}
  hearing: {type: hearing, parameters: {languages: en}}
"""


def sound() -> np.ndarray:
    parts = [
        silence(1),
        spoken("What are the opening hours?"),
        silence(1.5),
        spoken("Where is the library?"),
        silence(1),
    ]
    return np.concatenate(parts)


def sound_bag(path: Path) -> Path:
    with BagWriter(path) as bag:
        for message in chunks_of(sound(), start=5 * SECOND):
            bag.write("/audio", message, message.stamp + SECOND // 20)
    return path


def film_bag(path: Path) -> Path:
    av = pytest.importorskip("av")
    film = path.with_suffix(".mp4")
    samples = sound()
    with av.open(str(film), "w") as container:
        video = container.add_stream("mpeg4", rate=5)
        video.width, video.height, video.pix_fmt = 160, 120, "yuv420p"
        audio = container.add_stream("aac", rate=RATE_HZ, layout="mono")
        for _ in range(5 * samples.size // RATE_HZ):
            for packet in video.encode(av.VideoFrame.from_ndarray(np.zeros((120, 160, 3), np.uint8), format="rgb24")):
                container.mux(packet)
        frame = av.AudioFrame.from_ndarray(samples[None, :].astype(np.float32) / 32768, format="fltp", layout="mono")
        frame.sample_rate = RATE_HZ
        for packet in [*video.encode(), *audio.encode(frame), *audio.encode()]:
            container.mux(packet)
    import_bag(film, path)
    return path


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.parametrize(("graph", "make"), [(EARS, sound_bag), (EYES_AND_EARS, film_bag)])
def test_replays_hear_the_same(graph: str, make, tmp_path: Path) -> None:
    pytest.importorskip("faster_whisper")
    from socialbot.speech.recognition import is_installed

    if not is_installed("base"):
        pytest.skip("the model base is not installed")
    bag = make(tmp_path / "bag")

    def heard(runner) -> list[HeardSpeech]:
        found: list[HeardSpeech] = []

        def note(topic: str, message: Message) -> None:
            if isinstance(message, HeardSpeech):
                found.append(message)

        replay(bag, parse_graph(graph, where="test"), tmp_path / runner, note, runner=runner, cache=False)
        return found

    inline, ros = heard("inline"), heard("ros")
    assert inline == ros
    assert len(inline) == 2
    assert "opening hours" in inline[0].text
    assert (tmp_path / "inline").is_dir()


def test_wav_file_is_heard_by_a_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The microphone node as a source of an inline run."""
    from socialbot.graph.inline import InlineRunner
    from socialbot.graph.node import Graph, NodeConfig
    from socialbot.speech.microphone import Microphone
    from tests.speech.sounds import LoudHearing

    monkeypatch.chdir(tmp_path)
    with wave.open("sound.wav", "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes(sound().tobytes())
    nodes = (NodeConfig("microphone", Microphone, {"source": "sound.wav"}), NodeConfig("hearing", LoudHearing, {}))
    runner = InlineRunner(Graph("test", nodes), start=SECOND)
    found: list[Message] = []
    runner.tap("/humans/voices/speech", lambda topic, message: found.append(message))
    runner.start()
    runner.advance(9 * SECOND)
    assert len(found) == 2
    assert runner.faults["hearing"].failures == 0
