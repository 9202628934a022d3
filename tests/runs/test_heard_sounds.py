from __future__ import annotations

import wave
from pathlib import Path

import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import AudioData, HeardSpeech, Message, TraceRecord
from socialbot.runs.folder import open_run
from socialbot.runs.heard_sounds import heard_sound, write_heard
from socialbot.runs.record import WELL, RunRecord
from tests.runs.browsing import Visit, chromium, served
from tests.runs.test_run_record import RUN

RATE = 8000


def run_with(folder: Path, *messages: Message) -> Path:
    with RunRecord(folder) as record:
        for message in messages:
            record.observe("/topic", message)
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


def test_the_id_of_a_record_leads_out_of_no_folder(tmp_path):
    """Without keys, other programs can publish records during a replay over ROS."""
    detail = {"start": 2 * SECOND}
    record = TraceRecord(stamp=3 * SECOND, id="../../else", source="x", kind="hearing", what="Hello", detail=detail)
    run = run_with(tmp_path / "run", record, HeardSpeech(stamp=4 * SECOND, start=3 * SECOND, text="Hello"))
    with open_bag(bag_with_sound(tmp_path / "bag")) as bag:
        assert write_heard(bag, run) == 1
    assert not (tmp_path / "else.wav").exists()


@pytest.mark.parametrize("wrong", [{"samples": b"abc"}, {"channels": 3}, {"channels": 100}, {"sample_rate": 2**40}])
def test_sound_that_no_node_can_hear_is_left_out(tmp_path, wrong):
    message = AudioData(**{"stamp": SECOND, "samples": bytes(2 * RATE), "sample_rate": RATE, **wrong})
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/audio", message, SECOND)
    run = run_with(tmp_path / "run", HeardSpeech(stamp=2 * SECOND, start=SECOND, text="Hello"))
    with open_bag(tmp_path / "bag") as bag:
        assert write_heard(bag, run) == 0


@pytest.mark.slow
def test_the_page_plays_what_was_heard_with_its_words(tmp_path):
    end = RUN[-1].stamp + 2 * SECOND
    heard = HeardSpeech(stamp=end, start=end - SECOND, text="Where is the library?", person="t1")
    run = run_with(tmp_path / "run", *RUN, heard)
    (run / "speech").mkdir()
    with wave.open(str(run / "speech" / heard_sound(heard.id)), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(bytes(4 * RATE))
    begin_s = (heard.start - RUN[0].stamp) / SECOND
    with chromium() as browser, served(run) as url:
        visit = Visit(browser, url, f"t={begin_s - 0.1:g}")
        caption = visit.page.locator("#speech")
        assert "library" not in caption.inner_text()
        with visit.page.expect_response(lambda response: heard_sound(heard.id) in response.url):
            visit.page.get_by_role("button", name="Play", exact=True).click()
        visit.page.wait_for_function("document.querySelector('#speech').innerText.includes('library')")
        assert visit.page.locator(".bar.heard").count() == 1 + sum(isinstance(one, HeardSpeech) for one in RUN)
        visit.close()


def test_a_bag_without_sound_or_a_run_without_speech_has_none(tmp_path):
    heard = HeardSpeech(stamp=3 * SECOND, start=2 * SECOND, text="Hello")
    with open_bag(bag_with_sound(tmp_path / "silent", "/other")) as bag:
        assert write_heard(bag, run_with(tmp_path / "one", heard)) == 0
    with open_bag(bag_with_sound(tmp_path / "bag")) as bag:
        assert write_heard(bag, run_with(tmp_path / "two")) == 0
    assert not (tmp_path / "one" / "speech").exists()
