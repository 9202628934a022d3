"""Speech recognition with faster-whisper, and the interface for other recognisers."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.speech.audio import RATE_HZ
from socialbot.speech.recognition_models import load_files

_LONGEST_S = 30  # Sound that the network takes.
_PADDING_S = 4  # Silence after the speech; with less the network repeats itself.
_SHORTEST_S = 10
_TOKENS_PER_S, _TOKENS = 12, 16  # More text than anybody speaks is a repetition.
_FRAMES_PER_S = 100
_MIN_LOG_PROBABILITY = -1.0
_NO_SPEECH = 0.6
_MOST_COMPRESSION = 2.4
_LONGEST_WORD = 20


@dataclass(frozen=True)
class RecognizedText:
    """Text of a piece of speech, its language (ISO 639-1), and a confidence from 0 to 1."""

    text: str
    language: str
    confidence: float


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
        features = self._network.feature_extractor(sound)[:, : seconds * _FRAMES_PER_S]
        encoded = self._network.encode(features)
        language = self._language(encoded)
        tokenizer = self._tokenizers[language]
        prompt = self._network.get_prompt(tokenizer, [], without_timestamps=True, hotwords=self._vocabulary or None)
        most = len(prompt) + _TOKENS + round(_TOKENS_PER_S * samples.size / RATE_HZ)
        result = self._network.model.generate(
            encoded, [prompt], beam_size=5, max_length=min(most, self._network.max_length), return_scores=True,
            return_no_speech_prob=True,
        )[0]  # fmt: skip
        text = tokenizer.decode(result.sequences_ids[0]).strip()
        likely = float(result.scores[0])
        if not text or likely < _MIN_LOG_PROBABILITY or (result.no_speech_prob > _NO_SPEECH and likely < -0.5):
            return None
        return RecognizedText(text, language, min(1.0, math.exp(likely)))

    def _language(self, encoded: Any) -> str:
        if len(self._languages) == 1:
            return self._languages[0]
        shares = {token[2:-2]: share for token, share in self._network.model.detect_language(encoded)[0]}
        return max(self._languages, key=lambda language: shares.get(language, 0.0))


def repeats(text: str) -> bool:
    """Whether three words of a text occur twice in the same order, as the network writes when it loops."""
    words = re.findall(r"\w+", text.lower())
    triples = list(zip(words, words[1:], words[2:], strict=False))
    return len(set(triples)) < len(triples)


def loops(text: str) -> bool:
    """Whether a text says the same so often that no person did, such as one letter a hundred times.

    The measure, how far the text can be compressed, and its limit are those of Whisper. A person may well say one word
    again and again, such as "stop".
    """
    words = set(re.findall(r"\w+", text.lower()))
    if len(words) == 1 and len(min(words)) <= _LONGEST_WORD:
        return False
    data = text.encode()
    return len(data) > _MOST_COMPRESSION * len(zlib.compress(data))
