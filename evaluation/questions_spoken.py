"""Spoken questions for `evaluation.questions`: synthetic speech, then recognition, as between a person and a robot."""

from __future__ import annotations

import re
import unicodedata

import numpy as np

from socialbot.runs.asking import LANGUAGES
from socialbot.speech.audio import Converter
from socialbot.speech.recognition import WhisperRecognizer
from socialbot.speech.synthesis import Synthesizer

VOICES = {"en": ("en-us", "en-gb-x-rp"), "de": ("de",), "fr": ("fr",), "es": ("es",)}
SPEED_WPM = 150


class Listener:
    """Speaks each question in its language and recognises it. ``names`` help the recogniser with names.

    Raises:
        InstallationError: The extra ``hear`` or ``speech`` is not installed.
        ParameterError: The model is missing.
    """

    def __init__(self, model: str = "base", names: str = "") -> None:
        self._recognizer = WhisperRecognizer(model, sorted(LANGUAGES), vocabulary=names)
        self._voices = {
            language: [Synthesizer(voice, rate_wpm=SPEED_WPM) for voice in voices]
            for language, voices in VOICES.items()
        }
        self._spoken = 0

    def hear(self, question: str) -> str:
        """Return what the recogniser makes of a question; the voices of a language take turns."""
        voices = self._voices[language_of(question)]
        self._spoken += 1
        sound = voices[self._spoken % len(voices)].say(question)
        converter = Converter(sound.sample_rate, 1)
        samples = np.concatenate([converter.push(sound.samples[:, None]), converter.flush()])
        heard = self._recognizer.recognize(samples)
        return "" if heard is None else heard.text


def language_of(question: str) -> str:
    """Return the language that knows most words of a question; English first."""
    plain = unicodedata.normalize("NFKD", question.casefold())
    words = re.findall(r"[a-z]+", "".join(letter for letter in plain if not unicodedata.combining(letter)))
    known = {
        code: {word for alternatives in each.phrases.values() for phrase in alternatives for word in phrase}
        for code, each in LANGUAGES.items()
    }
    return max(known, key=lambda code: sum(word in known[code] for word in words))
