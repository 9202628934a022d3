"""Speech recognition with faster-whisper, and the interface for other recognisers."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.speech.audio import RATE_HZ
from socialbot.speech.recognition_models import load_files

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
        model: One of `socialbot.speech.recognition_models.MODELS`, or a folder.
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
