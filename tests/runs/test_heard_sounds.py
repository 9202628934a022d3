from __future__ import annotations

import wave
from pathlib import Path

import numpy as np

from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech
from socialbot.runs.folder import open_run
from socialbot.runs.heard_sounds import heard_sound, write_heard
from socialbot.runs.record import WELL, RunRecord

RATE = 8000


def run_with(folder: Path, *heard: HeardSpeech) -> Path:
    with RunRecord(folder) as record:
        for message in heard:
            record.observe("/humans/voices/speech", message)
        record.write_results({"graph": "test", "ended": WELL})
    return folder


def bag_with_sound(path: Path, topic: str = "/audio") -> Path:
    """Write a bag of 4 s of sound whose samples count up, in pieces of 0.5 s."""
    numbers = np.arange(4 * RATE, dtype="<i2")
    with BagWriter(path) as bag:
        for piece in range(8):
            begin = piece * RATE // 2
            samples = numbers[begin : begin + RATE // 2].tobytes()
            message = AudioData(stamp=SECOND + piece * SECOND // 2, samples=samples, sample_rate=RATE)
            bag.write(topic, message, message.stamp)
    return path


def test_the_sound_of_each_sentence_is_cut_from_the_bag(tmp_path):
    heard = HeardSpeech(stamp=3 * SECOND, start=2 * SECOND, text="Hello", person="t1")
    run = run_with(tmp_path / "run", heard)
    with open_bag(bag_with_sound(tmp_path / "bag")) as bag:
        assert write_heard(bag, run) == 1
    with wave.open(str(run / "speech" / heard_sound(heard.id))) as file:
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2")
        assert file.getframerate() == RATE
    # From 0.2 s before the sentence, 1 s after the first sample, to 0.2 s after it.
    assert (samples[0], samples[-1] + 1, samples.size) == (0.8 * RATE, 2.2 * RATE, 1.4 * RATE)
    opened = open_run(run)
    assert opened.sound(heard_sound(heard.id)) is not None
    lanes = {lane.name: lane.bars for lane in opened.timeline.lanes()}
    assert [(bar.text, bar.to_s) for bar in lanes["heard"]] == [("Hello", 0.0)]


def test_a_bag_without_sound_or_a_run_without_speech_has_none(tmp_path):
    heard = HeardSpeech(stamp=3 * SECOND, start=2 * SECOND, text="Hello")
    with open_bag(bag_with_sound(tmp_path / "silent", "/other")) as bag:
        assert write_heard(bag, run_with(tmp_path / "one", heard)) == 0
    with open_bag(bag_with_sound(tmp_path / "bag")) as bag:
        assert write_heard(bag, run_with(tmp_path / "two")) == 0
    assert not (tmp_path / "one" / "speech").exists()
