"""Spoken questions for `evaluation.questions`: synthetic speech, then recognition, as between a person and a robot."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence

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
        vocabulary: Names and words that the recogniser expects.
        names: The words of each name in the run.
        model: Speech model.

    Raises:
        InstallationError: The extra ``hear`` or ``voices`` is not installed.
        ParameterError: The model is missing.
    """

    def __init__(self, vocabulary: str, names: Iterable[Sequence[str]] = (), model: str = "base") -> None:
        self._recognizer = WhisperRecognizer(model, ["en"], vocabulary=vocabulary)
        self._names = tuple(names)
        self._voice = open_voice(VOICE, SPEED_WPM)

    def hear(self, question: str) -> Sequence[str]:
        """Return the texts that the recogniser makes of a question, the most likely one first."""
        sound = self._voice.say(as_spoken(question, self._names))
        converter = Converter(sound.sample_rate, 1)
        samples = np.concatenate([converter.push(sound.samples[:, None]), converter.flush()])
        heard = self._recognizer.recognize(samples)
        return [""] if heard is None else [heard.text, *heard.alternatives]


def as_spoken(question: str, names: Iterable[Sequence[str]]) -> str:
    """Return a question with the letters in names as a person reads them: ``carrier_a`` is "carrier A".

    Args:
        question: The question as it is written.
        names: The words of each name.
    """
    for words in names:
        if any(len(word) == 1 and word.isalpha() for word in words):
            written = re.compile(rf"\b{'[ _]?'.join(map(re.escape, words))}\b", re.IGNORECASE)
            spoken = " ".join(word.upper() if len(word) == 1 else word for word in words)
            question = written.sub(spoken, question)
    return question


def language_of(question: str) -> str:
    """Return the language that knows most words of a question; English first."""
    plain = unicodedata.normalize("NFKD", question.casefold())
    words = re.findall(r"[a-z]+", "".join(letter for letter in plain if not unicodedata.combining(letter)))
    known = {
        code: {word for alternatives in each.phrases.values() for phrase in alternatives for word in phrase}
        for code, each in LANGUAGES.items()
    }
    own = {code: sum(letter in each.letters for letter in question.lower()) for code, each in LANGUAGES.items()}
    return max(known, key=lambda code: sum(word in known[code] for word in words) + own[code])
