import hashlib
import subprocess
import sys
import threading
import time
import unicodedata
import wave

import numpy as np
import pytest

from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.speech.synthesis import Sound, Synthesizer, phonemes

SENTENCE = "Hello, nice to see you. Can I help you find something?"


def digest(sound: Sound) -> str:
    return hashlib.sha256(sound.samples.tobytes()).hexdigest()


@pytest.fixture(scope="module")
def english() -> Synthesizer:
    return Synthesizer()


def test_duration_of_a_sentence_is_plausible(english):
    sound = english.say(SENTENCE)
    assert sound.samples.dtype == np.int16
    assert sound.samples.ndim == 1
    assert sound.sample_rate == 22050
    assert 2.0 < sound.duration_s < 5.0
    assert np.abs(sound.samples).max() > 3000


def test_same_text_gives_same_samples(english):
    first = digest(english.say(SENTENCE))
    assert digest(Synthesizer().say(SENTENCE)) == first
    Synthesizer("de", rate_wpm=300, pitch=90).say("Guten Tag, schön Sie zu sehen!")
    assert digest(Synthesizer().say(SENTENCE)) == first


def test_a_voice_with_breath_gives_same_samples_at_any_time():
    """espeak-ng takes the second of the day as the seed of the breath."""
    first, second = digest(Synthesizer("fr+f2").say("Salut 5")), int(time.time())
    while int(time.time()) == second:
        time.sleep(0.05)
    assert digest(Synthesizer("fr+f2").say("Salut 5")) == first


def test_new_process_gives_same_samples(english):
    english.say("Something else first.")
    code = (
        "import hashlib; from socialbot.speech.synthesis import Synthesizer;"
        f"print(hashlib.sha256(Synthesizer().say({SENTENCE!r}).samples.tobytes()).hexdigest())"
    )
    fresh = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert fresh.stdout.strip() == digest(english.say(SENTENCE))


def test_voices_are_independent(english):
    german = Synthesizer("de")
    alone = digest(english.say("Hello")), digest(german.say("Hello"))
    assert alone[0] != alone[1]
    assert (digest(Synthesizer().say("Hello")), digest(Synthesizer("de").say("Hello"))) == alone


def test_repeated_text_is_cached(monkeypatch):
    voice = Synthesizer()
    first = voice.say(SENTENCE)
    monkeypatch.setattr("socialbot.speech.synthesis._espeak", lambda: pytest.fail("it is made again"))
    assert voice.say(SENTENCE) is first


def test_threads_take_turns(english):
    expected = {voice: digest(Synthesizer(voice).say(SENTENCE)) for voice in ("en", "de", "fr", "es")}
    heard: list[tuple[str, str]] = []

    def talk(voice: str) -> None:
        heard.extend((voice, digest(Synthesizer(voice).say(SENTENCE))) for _ in range(5))

    threads = [threading.Thread(target=talk, args=(voice,)) for voice in expected]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(heard) == 20
    assert all(expected[voice] == sound for voice, sound in heard)


def test_rate_and_pitch_matter():
    slow, fast = Synthesizer(rate_wpm=120).say(SENTENCE), Synthesizer(rate_wpm=240).say(SENTENCE)
    assert slow.duration_s > 1.5 * fast.duration_s
    assert crossings(Synthesizer(pitch=90).say("aaaah")) > 1.2 * crossings(Synthesizer(pitch=10).say("aaaah"))


def crossings(sound: Sound) -> float:
    """Zero crossings a second, which rise with the pitch."""
    positive = sound.samples > 0
    return np.count_nonzero(positive[1:] != positive[:-1]) / sound.duration_s


def test_long_text_is_complete(english):
    once, often = english.say(SENTENCE).duration_s, english.say(" ".join([SENTENCE] * 20)).duration_s
    assert 15 * once < often < 25 * once


@pytest.mark.parametrize("text", ["", "   ", "\n\t", "\0"])
def test_refuses_text_without_speech(english, text):
    with pytest.raises(MessageError, match="without text"):
        english.say(text)


def test_control_characters_are_ignored(english):
    assert digest(english.say("Hello\x01 40P there")) == digest(english.say("Hello  40P there"))
    assert english.say("Hello\0 there").duration_s == english.say("Hello  there").duration_s


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        (unicodedata.normalize("NFD", "Grüße, schöne Märchen"), "Grüße, schöne Märchen"),
        ("Biblio\u00adthek", "Bibliothek"),
        ("\ufeff\u200eBiblio\u2060thek", "Bibliothek"),
        ("die\u00a0Bibliothek\u200bhier", "die Bibliothek hier"),
    ],
)
def test_words_are_spoken_the_same_however_they_are_encoded(written: str, plain: str):
    assert phonemes(written, "de") == phonemes(plain, "de")
    german = Synthesizer("de")
    assert german.say(written).wav() == german.say(plain).wav()
    assert german.say(written).marks == german.say(plain).marks


@pytest.mark.parametrize(("language", "voice"), [("zh", "cmn"), ("no", "nb"), ("en-GB", "en"), ("no+f3", "nb+f3")])
def test_languages_may_be_called_otherwise_than_their_voices(language: str, voice: str):
    assert digest(Synthesizer(language).say("Oslo 5")) == digest(Synthesizer(voice).say("Oslo 5"))


def test_error_for_unknown_voice_suggests_others():
    with pytest.raises(ParameterError) as raised:
        Synthesizer("en_US")
    assert raised.value.what == "unknown voice 'en_US'"
    some = str(raised.value.remedy).partition("such as ")[2].split(", ")
    assert "en-us" in some
    assert len(some) >= 8
    for voice in some:
        Synthesizer(voice)


@pytest.mark.parametrize("wrong", [{"rate_wpm": 20}, {"rate_wpm": 1000}, {"pitch": 101}, {"pitch": -1}])
def test_refuses_numbers_out_of_range(wrong):
    with pytest.raises(ParameterError, match="out of range"):
        Synthesizer(**wrong)


def test_missing_library_has_a_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "espeakng_loader", None)
    with pytest.raises(InstallationError) as raised:
        Synthesizer()
    assert raised.value.remedy == extra_command("speech")


def test_unreadable_data_is_an_installation_error(monkeypatch, tmp_path):
    import espeakng_loader

    with monkeypatch.context() as patch:
        patch.setattr(espeakng_loader, "get_data_path", lambda: str(tmp_path / "nothing"))
        with pytest.raises(InstallationError, match="cannot read its data"):
            Synthesizer()
    assert Synthesizer().say("Hello").duration_s > 0


def test_wav_file_has_the_samples(english, tmp_path):
    sound = english.say("Hello")
    sound.write_wav(tmp_path / "hello.wav")
    with wave.open(str(tmp_path / "hello.wav")) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 2, sound.sample_rate)
        assert np.array_equal(np.frombuffer(file.readframes(file.getnframes()), "<i2"), sound.samples)
    assert [path.name for path in tmp_path.iterdir()] == ["hello.wav"]


def test_failed_write_keeps_the_old_file(english, tmp_path, monkeypatch):
    target = tmp_path / "hello.wav"
    target.write_bytes(b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(wave.Wave_write, "writeframes", full)
    with pytest.raises(OSError, match="No space"):
        english.say("Hello").write_wav(target)
    assert [path.name for path in tmp_path.iterdir()] == ["hello.wav"]
    assert target.read_bytes() == b"old"


def test_volume_scales_the_samples():
    sound = Sound(np.array([-32768, -101, 0, 100, 32767], np.int16), 22050)
    assert sound.at_volume(0.5).samples.tolist() == [-16384, -50, 0, 50, 16384]
    assert not sound.at_volume(0.0).samples.any()
    assert np.array_equal(sound.at_volume(1.0).samples, sound.samples)
