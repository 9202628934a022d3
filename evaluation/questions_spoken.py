"""Spoken questions for `evaluation.questions`: synthetic speech, then recognition, as between a person and a robot."""

from __future__ import annotations

import re
import unicodedata

import numpy as np

from socialbot.runs.asking import LANGUAGES
from socialbot.speech.audio import Converter
from socialbot.speech.neural import open_voice
from socialbot.speech.recognition import WhisperRecognizer

VOICE = "piper:joe"
SPEED_WPM = 150


class Listener:
    """Speaks questions in English and recognises them.

    Args:
        names: Words that the recogniser expects.
        model: Speech model.

    Raises:
        InstallationError: The extra ``hear`` or ``voices`` is not installed.
        ParameterError: The model is missing.
    """

    def __init__(self, names: str, model: str = "base") -> None:
        self._recognizer = WhisperRecognizer(model, ["en"], vocabulary=names)
        self._voice = open_voice(VOICE, SPEED_WPM)

    def hear(self, question: str) -> str:
        """Return what the recogniser makes of a question."""
        sound = self._voice.say(question)
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
