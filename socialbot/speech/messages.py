"""Messages of the speech node."""

from typing import Literal

import msgspec

from socialbot.core.messages import Structured


class SpeechMark(msgspec.Struct, frozen=True):
    """Word, or phoneme in IPA, from ``start_s`` to ``end_s`` after the stamp of its message."""

    kind: Literal["word", "phoneme"]
    start_s: float
    end_s: float
    text: str


class SpeechMarks(Structured, frozen=True, kw_only=True):
    """Words and phonemes of a part of an utterance whose sound begins at the stamp; for mouth or LED animation."""

    utterance_id: str
    marks: tuple[SpeechMark, ...]


MESSAGES = (SpeechMarks,)
