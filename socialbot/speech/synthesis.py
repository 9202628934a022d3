"""Speech synthesis with espeak-ng from the wheel ``espeakng_loader`` (GPL-3.0, extra ``speech``).

The same text and voice always give the same samples, see `_espeak`.
"""

from __future__ import annotations

import contextlib
import ctypes
import difflib
import io
import os
import threading
import unicodedata
import wave
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.paths import replace_file
from socialbot.speech.messages import SpeechMark

# From espeak-ng's speak_lib.h.
_AUDIO_OUTPUT_SYNCHRONOUS = 2
_INITIALIZE_DONT_EXIT, _PHONEME_EVENTS, _PHONEMES_IPA = 0x8000, 0x0001, 0x0002
_LIST_END, _WORD_EVENT, _PHONEME_EVENT = 0, 1, 7
_RATE, _PITCH = 1, 3
_POSITION_CHARACTER = 1
_CHARS_UTF8 = 1
_ENDS_OF_WORDS = "\u200b\u200c\u200d"  # zero-width space, and (non-)joiners of parts of words and emoji


class _Event(ctypes.Structure):
    """``espeak_EVENT``: position in characters from 1, and the sample at which it happens."""

    _fields_ = [
        ("type", ctypes.c_int), ("identifier", ctypes.c_uint), ("position", ctypes.c_int), ("length", ctypes.c_int),
        ("audio_ms", ctypes.c_int), ("sample", ctypes.c_int), ("user_data", ctypes.c_void_p), ("id", ctypes.c_char * 8),
    ]  # fmt: skip


_SYNTH_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event))
_LOCK = threading.Lock()
_FAMILIAR = ("en", "en-us", "de", "es", "fr", "it", "nl", "pt-br")

SOUNDS_KEPT = 16  # size of the cache; espeak-ng leaks about 2 kB per synthesis


@dataclass(frozen=True, eq=False)
class Sound:
    """Mono sound: ``samples`` is int16 of shape (n,), ``sample_rate`` in Hz, ``marks`` its words and phonemes."""

    samples: np.ndarray
    sample_rate: int
    marks: tuple[SpeechMark, ...] = ()

    @property
    def duration_s(self) -> float:
        return self.samples.size / self.sample_rate

    def at_volume(self, volume: float) -> Sound:
        """Scale the amplitude by ``volume``, from 0 to 1."""
        return Sound(np.rint(self.samples * volume).astype(np.int16), self.sample_rate, self.marks)

    def wav(self) -> bytes:
        """Return the content of a 16-bit mono .wav file."""
        raw = io.BytesIO()
        with wave.open(raw, "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(self.sample_rate)
            file.writeframes(self.samples.astype("<i2").tobytes())
        return raw.getvalue()

    def write_wav(self, path: str | os.PathLike[str]) -> None:
        """Write a 16-bit mono .wav file atomically. Raises OSError."""
        replace_file(Path(path), self.wav())


class Synthesizer:
    """Thread-safe speech synthesizer.

    Args:
        voice: Language such as "en-us", optionally with a variant: "en-us+f3".
        rate_wpm: Words per minute, 80 to 450.
        pitch: Pitch, 0 to 100.

    Raises:
        InstallationError: espeak-ng is missing.
        ParameterError: The voice is unknown or a number out of range.
    """

    def __init__(self, voice: str = "en", rate_wpm: int = 165, pitch: int = 50) -> None:
        _check("rate_wpm", rate_wpm, 80, 450)
        _check("pitch", pitch, 0, 100)
        self.voice = voice
        self.language = voice.replace("+", "-").split("-")[0].lower()
        self.rate_wpm = rate_wpm
        self.pitch = pitch
        self._known = lru_cache(SOUNDS_KEPT)(self._make)
        with _espeak() as (library, _):
            _set_voice(library, voice)

    def say(self, text: str) -> Sound:
        """Synthesize ``text``. Raises MessageError for text without speech."""
        return self._known(text)

    def _make(self, text: str) -> Sound:
        data = _plain(text).encode("utf-8", "replace")
        if not data.strip():
            raise MessageError("an utterance without text", remedy="give a sentence")
        chunks: list[bytes] = []
        events: list[tuple[int, int, int, int, bytes]] = []

        @_SYNTH_CALLBACK
        def collect(samples: ctypes._Pointer[ctypes.c_short], count: int, found: ctypes._Pointer[_Event]) -> int:
            if samples and count > 0:
                chunks.append(ctypes.string_at(samples, 2 * count))
            at = 0
            while found[at].type != _LIST_END:
                event = found[at]
                events.append((event.type, event.position, event.length, event.sample, event.id))
                at += 1
            return 0

        with _espeak() as (library, sample_rate):
            library.espeak_SetSynthCallback(collect)
            _set_voice(library, self.voice)
            library.espeak_SetParameter(_RATE, self.rate_wpm, 0)
            library.espeak_SetParameter(_PITCH, self.pitch, 0)
            status = library.espeak_Synth(data, len(data) + 1, 0, _POSITION_CHARACTER, 0, _CHARS_UTF8, None, None)
        samples = np.frombuffer(b"".join(chunks), np.int16)
        if status or not samples.size:
            raise MessageError(f"espeak-ng makes no sound of {text!r}", remedy=f"is it in the language {self.voice!r}?")
        return Sound(samples, sample_rate, tuple(_marks(data.decode(), events, samples.size, sample_rate)))


def _marks(
    text: str, events: Sequence[tuple[int, int, int, int, bytes]], size: int, sample_rate: int
) -> Iterator[SpeechMark]:
    """Words and phonemes of events: type, position in the text, length, sample, and phoneme."""
    for kind, wanted in (("word", _WORD_EVENT), ("phoneme", _PHONEME_EVENT)):
        found = [event for event in events if event[0] == wanted]
        ends = [*(event[3] for event in found), size][1:] if found else []
        for (_, position, length, sample, symbol), end in zip(found, ends, strict=True):
            shown = text[position - 1 : position - 1 + length] if kind == "word" else symbol.decode("utf-8", "ignore")
            if shown.strip() and end > sample:  # pauses are phonemes without a symbol
                yield SpeechMark(kind, sample / sample_rate, end / sample_rate, shown)  # type: ignore[arg-type]


def phonemes(text: str, voice: str) -> str:
    """Return the IPA phonemes of a clause in a voice of espeak-ng, words separated by spaces.

    Raises:
        InstallationError: espeak-ng is missing.
        ParameterError: The voice is unknown.
    """
    clause = ctypes.create_string_buffer(_plain(text).encode("utf-8", "replace"))
    rest = ctypes.c_void_p(ctypes.addressof(clause))
    found: list[str] = []
    with _espeak() as (library, _):
        _set_voice(library, voice)
        while rest.value:
            found.append(library.espeak_TextToPhonemes(ctypes.byref(rest), _CHARS_UTF8, _PHONEMES_IPA).decode("utf-8"))
    return " ".join(part for part in found if part)


def _plain(text: str) -> str:
    """Remove control characters, which espeak-ng interprets as commands, and compose letters, which it reads better.

    Invisible characters within words, such as soft hyphens, do not end a word.
    """
    return "".join(
        character if character.isprintable() else "" if _is_within_words(character) else " "
        for character in unicodedata.normalize("NFC", text)
    )


def _is_within_words(character: str) -> bool:
    return unicodedata.category(character) == "Cf" and character not in _ENDS_OF_WORDS


def _check(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise ParameterError(f"{value!r} is out of range", where=name, remedy=f"give a value from {low} to {high}")


@contextlib.contextmanager
def _espeak() -> Iterator[tuple[ctypes.CDLL, int]]:
    """Load the library; yield it and its sample rate in Hz.

    espeak-ng keeps phases and pitch flutter in static variables that no function resets, so each sentence would depend
    on the previous one. Unloading the library resets them in 3 ms. The breath of voices such as ``fr+f2`` is random, by
    default with the time of day as its seed. A lock protects the library, since it is not re-entrant.
    """
    with _LOCK:
        library, data_path = _load()
        try:
            sample_rate = library.espeak_Initialize(
                _AUDIO_OUTPUT_SYNCHRONOUS,
                0,
                os.fsencode(data_path),
                _INITIALIZE_DONT_EXIT | _PHONEME_EVENTS | _PHONEMES_IPA,
            )
            if sample_rate <= 0:
                # espeak-ng truncates paths at 160 bytes.
                raise InstallationError(
                    f"espeak-ng cannot read its data in {data_path}",
                    remedy="install socialbot where the path to site-packages is shorter than 120 characters",
                )
            library.espeak_ng_SetRandSeed(1)
            try:
                yield library, sample_rate
            finally:
                library.espeak_Terminate()
        finally:
            _unload(library)


def _load() -> tuple[ctypes.CDLL, str]:
    try:
        import espeakng_loader

        library = ctypes.CDLL(espeakng_loader.get_library_path())
        data_path = espeakng_loader.get_data_path()
    except (ImportError, OSError, RuntimeError) as error:
        raise InstallationError(f"espeak-ng is not installed ({error})", remedy=extra_command("speech")) from error
    library.espeak_Initialize.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_int]
    library.espeak_ng_SetRandSeed.argtypes = [ctypes.c_long]
    library.espeak_SetSynthCallback.argtypes = [_SYNTH_CALLBACK]
    library.espeak_SetVoiceByName.argtypes = [ctypes.c_char_p]
    library.espeak_SetParameter.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_int]
    library.espeak_Synth.argtypes = [
        ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint, ctypes.c_int, ctypes.c_uint, ctypes.c_uint,
        ctypes.c_void_p, ctypes.c_void_p,
    ]  # fmt: skip
    library.espeak_TextToPhonemes.argtypes = [ctypes.POINTER(ctypes.c_void_p), ctypes.c_int, ctypes.c_int]
    library.espeak_TextToPhonemes.restype = ctypes.c_char_p
    library.espeak_ListVoices.argtypes = [ctypes.c_void_p]
    library.espeak_ListVoices.restype = ctypes.POINTER(ctypes.POINTER(_Voice))
    return library, data_path


def _unload(library: ctypes.CDLL) -> None:
    import _ctypes

    close = getattr(_ctypes, "dlclose", None) or _ctypes.FreeLibrary  # pyright: ignore[reportAttributeAccessIssue]
    close(library._handle)


class _Voice(ctypes.Structure):
    """First fields of ``espeak_VOICE``; ``identifier`` is a path like "gmw/en-US".

    ``languages`` are strings, each after a byte with its priority, of which the lowest counts most, and a last byte 0.
    """

    _fields_ = [("name", ctypes.c_char_p), ("languages", ctypes.c_void_p), ("identifier", ctypes.c_char_p)]

    @property
    def file(self) -> str:
        return self.identifier.decode("utf-8", "replace").rpartition("/")[2].lower()

    def priority_of(self, language: str) -> int | None:
        """Priority of a language of this voice; None for other languages."""
        at = self.languages
        while priority := ctypes.string_at(at, 1)[0]:
            name = ctypes.string_at(at + 1)
            if name.decode("utf-8", "replace") == language:
                return priority
            at += len(name) + 2
        return None


def _set_voice(library: ctypes.CDLL, voice: str) -> None:
    if library.espeak_SetVoiceByName(voice.encode("utf-8", "replace")):
        listed = _voices(library)
        language, plus, variant = voice.lower().partition("+")
        speaking = [(priority, each.file) for each in listed if (priority := each.priority_of(language)) is not None]
        # A language may have a voice of another name: that of "zh" is "cmn".
        if speaking and not library.espeak_SetVoiceByName(f"{min(speaking)[1]}{plus}{variant}".encode()):
            return
        known = sorted(each.file for each in listed)
        some = dict.fromkeys((*difflib.get_close_matches(voice.lower(), known), *_FAMILIAR))
        raise ParameterError(
            f"unknown voice {voice!r}", where="voice", remedy=f"one of {len(known)}, such as {', '.join(some)}"
        )


def _voices(library: ctypes.CDLL) -> list[_Voice]:
    """Return the voices of espeak-ng."""
    voices = library.espeak_ListVoices(None)
    found: list[_Voice] = []
    while voices[len(found)]:
        found.append(voices[len(found)].contents)
    return found
