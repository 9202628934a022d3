"""Measure how well speech is heard: ``python -m evaluation.hearing``, or of recordings: ``... FOLDER``.

Synthetic voices speak sentences, mixed with the echo of a room and with noise. The real `Hearing` node hears them in
simulated time. Printed are the word error rate by signal-to-noise ratio, the time from the end of speech to its text,
the false activations per hour of noise, and how soon a person interrupts the robot in a room. A folder holds pairs
NAME.wav and NAME.txt.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
import time
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.messages import HeardSpeech, Message, VoiceActivity
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.audio import RATE_HZ, Converter, chunks_of, read_wav
from socialbot.speech.hearing import Hearing
from socialbot.speech.neural import open_voice
from socialbot.speech.recognition import RecognizedText, SpeechRecognizer

SENTENCES = (
    "Good morning, I have an appointment with Doctor Miller.",
    "Where is the meeting room on the second floor?",
    "Why did you greet me?",
    "Could you please call my colleague?",
    "What time do you open on Saturday?",
    "I am looking for the toilet.",
    "No thank you, I know the way.",
    "Please say that again more slowly.",
    "What can you see at the moment?",
    "Why did you not offer me any help?",
    "Yes please, show me the way to the library.",
    "How do I get to the restaurant from here?",
    "What will you do next?",
    "I would like to speak to the receptionist.",
    "Go to sleep now, we are closing the office.",
    "Can I leave my umbrella and my bag here?",
)
BABBLE = (
    "The weather was fine when they walked along the river and talked about the holidays.",
    "Several people in the hall discuss the price of tickets and the long queue outside.",
    "After lunch she wrote a letter to her brother, who had moved to another country.",
    "It takes about forty minutes by train, unless there is snow on the mountains.",
)
VOICES = ("piper:joe", "en-us", "en-gb-x-rp", "en-us+f3")
NOISES = ("babble", "pink")
RATIOS_DB = (math.inf, 20.0, 10.0, 5.0, 0.0)
PARTS = ("recognition", "noise", "barge_in")
LEVEL = 3000.0  # Root mean square of speech.
_BEFORE_S, _AFTER_S = 2.0, 3.0
_QUIET = 0.02  # Share of the peak below which a recording is silent.


_LONG = {"n't": " not", "'s": " is", "'re": " are", "'ll": " will", "'m": " am", "dr.": "doctor"}


def words(text: str) -> list[str]:
    """Words of a text in lower case, in their long form, without punctuation and accents."""
    text = text.lower().replace("\u2019", "'")
    for short, full in _LONG.items():
        text = text.replace(short, full)
    plain = unicodedata.normalize("NFKD", text)
    return re.findall(r"[a-z0-9]+", "".join(letter for letter in plain if not unicodedata.combining(letter)))


def word_errors(expected: Sequence[str], found: Sequence[str]) -> int:
    """Number of substituted, missing and additional words (the edit distance)."""
    row = list(range(len(found) + 1))
    for line, word in enumerate(expected, 1):
        before, row[0] = row[0], line
        for column, other in enumerate(found, 1):
            before, row[column] = row[column], min(row[column] + 1, row[column - 1] + 1, before + (word != other))
    return row[-1]


@dataclass(frozen=True, eq=False)
class Sentence:
    """A spoken sentence: int16 samples with `RATE_HZ` without silence around them, and its text."""

    voice: str
    text: str
    samples: np.ndarray


@dataclass
class Score:
    """Words, word errors and delays (s) of sentences."""

    words: int = 0
    errors: int = 0
    delays: list[float] = field(default_factory=list)
    unheard: int = 0

    @property
    def rate(self) -> float:
        return self.errors / self.words if self.words else 0.0

    def add(self, other: Score) -> None:
        self.words += other.words
        self.errors += other.errors
        self.delays += other.delays
        self.unheard += other.unheard


def trimmed(samples: np.ndarray) -> np.ndarray:
    """Samples without the silence around them."""
    loud = np.flatnonzero(np.abs(samples.astype(np.int32)) > _QUIET * np.abs(samples.astype(np.int32)).max())
    return samples[loud[0] : loud[-1] + 1] if loud.size else samples


def speak(voice: str, text: str) -> np.ndarray:
    """Speech of a synthetic voice. Raises SocialbotError if the voice is not installed."""
    sound = open_voice(voice).say(text)
    converter = Converter(sound.sample_rate, 1)
    samples = np.concatenate([converter.push(sound.samples[:, None]), converter.flush()])
    return trimmed(samples)


def folder_sentences(folder: Path) -> Iterator[Sentence]:
    """Recordings NAME.wav with their texts NAME.txt."""
    for path in sorted(folder.glob("*.wav")):
        text = path.with_suffix(".txt")
        if text.is_file():
            yield Sentence(folder.name, text.read_text("utf-8").strip(), trimmed(read_wav(path)))


class Scenery:
    """Noise and rooms by seed."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._talk = np.zeros(0)

    def echo(self, samples: np.ndarray, reverberation_s: float = 0.4) -> np.ndarray:
        """Add the echo of a room, half as strong as the direct sound."""
        count = round(reverberation_s * RATE_HZ)
        tail = self._random.normal(0, 1, count) * np.exp(-6.9 * np.arange(count) / count)
        response = np.concatenate([[1.0], np.zeros(80), 0.7 * tail / np.linalg.norm(tail)])
        return np.convolve(samples, response)

    def noise(self, kind: str, count: int) -> np.ndarray:
        """Noise with a root mean square of 1: babble, hum, knocks, pink or white."""
        match kind:
            case "babble":
                made = np.roll(np.resize(self._babble(), count), int(self._random.integers(count)))
            case "hum":
                times = 2 * np.pi * np.arange(count) / RATE_HZ
                made = np.sum([np.sin(50 * n * times) / n for n in (1, 2, 3, 5)], axis=0) + 0.2 * self._pink(count)
            case "knocks":
                made = self._knocks(count)
            case "pink":
                made = self._pink(count)
            case _:
                made = self._random.normal(0, 1, count)
        return made / np.sqrt(np.mean(made**2))

    def _pink(self, count: int) -> np.ndarray:
        spectrum = np.fft.rfft(self._random.normal(0, 1, count))
        made = np.fft.irfft(spectrum / np.sqrt(np.maximum(1, np.arange(spectrum.size))), count)
        return made / made.std()

    def _knocks(self, count: int) -> np.ndarray:
        made = self._random.normal(0, 0.01, count)
        length = RATE_HZ // 4
        for at in self._random.integers(0, max(1, count - length), count // RATE_HZ + 1):
            knock = self._random.normal(0, 1, length) * np.exp(-np.arange(length) / 400)
            made[at : at + length] += knock[: count - at]
        return made

    def _babble(self) -> np.ndarray:
        """Many people who talk at once."""
        if not self._talk.size:
            parts = [speak(voice, text).astype(float) for voice in VOICES[1:] for text in BABBLE]
            longest = max(part.size for part in parts)
            turned = (np.roll(np.resize(part, longest), int(self._random.integers(longest))) for part in parts)
            self._talk = np.sum(list(turned), axis=0)
        return self._talk


class _Timed:
    """Recogniser that notes the processor time of each call."""

    def __init__(self, recognizer: SpeechRecognizer) -> None:
        self.last_s = 0.0
        self._recognizer = recognizer

    def recognize(self, samples: np.ndarray) -> RecognizedText | None:
        begun = time.process_time()
        found = self._recognizer.recognize(samples)
        self.last_s = time.process_time() - begun
        return found


class Listener:
    """The hearing node in simulated time; its networks are loaded once."""

    def __init__(self, parameters: dict[str, object]) -> None:
        kept: dict[str, object] = {}

        class Timed(Hearing):
            def find_recognizer(self) -> SpeechRecognizer:
                if "recognizer" not in kept:
                    kept["recognizer"] = _Timed(super().find_recognizer())
                return kept["recognizer"]  # type: ignore[return-value]

        self._kept = kept
        self._graph = Graph("hearing", (NodeConfig("hearing", Timed, parameters),), inputs=frozenset({"/audio"}))

    def hear(self, sound: np.ndarray) -> tuple[list[tuple[HeardSpeech, float]], int]:
        """Texts of a sound from 1 s on, each with the time (s) at which it is known, and the number of voices.

        That time is the end of the last sound needed, plus the processor time of recognition.
        """
        runner = InlineRunner(self._graph, start=SECOND)
        heard: list[tuple[HeardSpeech, float]] = []
        voices = set()

        def note(topic: str, message: Message) -> None:
            if isinstance(message, HeardSpeech):
                timed = self._kept["recognizer"]
                assert isinstance(timed, _Timed)
                heard.append((message, runner.clock.now() / SECOND + timed.last_s))
            elif isinstance(message, VoiceActivity) and message.active:
                voices.add(message.voice)

        for topic in ("/humans/voices/speech", "/humans/voices/activity"):
            runner.tap(topic, note)
        runner.start()
        chunks = chunks_of(np.clip(np.rint(sound), -32768, 32767).astype(np.int16), start=SECOND)
        for chunk, following in itertools.pairwise(chunks):
            runner.feed("/audio", chunk, time=following.stamp)
        runner.close()
        return heard, len(voices)

    def score(self, sentence: Sentence, scenery: Scenery, noise: str, ratio_db: float, *, echo: bool) -> Score:
        """Hear one sentence in noise, and compare."""
        speech = sentence.samples * (LEVEL / np.sqrt(np.mean(sentence.samples.astype(float) ** 2)))
        end_s = 1.0 + _BEFORE_S + speech.size / RATE_HZ
        wet = scenery.echo(speech) if echo else speech
        sound = np.concatenate([np.zeros(round(_BEFORE_S * RATE_HZ)), wet, np.zeros(round(_AFTER_S * RATE_HZ))])
        if math.isfinite(ratio_db):
            sound = sound + LEVEL * 10 ** (-ratio_db / 20) * scenery.noise(noise, sound.size)
        heard, _ = self.hear(sound)
        expected = words(sentence.text)
        found = [word for message, _ in heard for word in words(message.text)]
        delays = [heard[-1][1] - end_s] if heard else []
        return Score(len(expected), word_errors(expected, found), delays, int(not heard))


def false_activations(listener: Listener, scenery: Scenery, kind: str, minutes: float) -> tuple[int, int]:
    """Numbers of voices and of texts that were heard in noise."""
    voices = texts = 0
    for _ in range(math.ceil(minutes)):
        heard, found = listener.hear(0.3 * LEVEL * scenery.noise(kind, 60 * RATE_HZ))
        voices, texts = voices + found, texts + len(heard)
    return voices, texts


def percentile(values: Sequence[float], share: float) -> float:
    """Percentile of the values; NaN without any."""
    return float(np.quantile(values, share)) if values else math.nan


def line(name: str, score: Score) -> str:
    """Row of the results of some sentences."""
    p50, p95 = percentile(score.delays, 0.5), percentile(score.delays, 0.95)
    return f"{name:30} {score.rate:6.1%} {score.unheard:8} {p50:7.2f} {p95:7.2f}"


def main() -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description="Measure how well speech is heard.")
    parser.add_argument("folder", nargs="?", type=Path, help="recordings NAME.wav with their texts NAME.txt")
    parser.add_argument("--model", default="base", help="speech model")
    parser.add_argument("--languages", default="en", help="languages to choose from")
    parser.add_argument("--voices", nargs="+", default=list(VOICES), help="synthetic voices")
    parser.add_argument("--noise", nargs="+", default=list(NOISES), help="babble, hum, knocks, pink, white")
    parser.add_argument("--ratios", nargs="+", type=float, default=list(RATIOS_DB), help="signal-to-noise ratios, dB")
    parser.add_argument("--minutes", type=float, default=10.0, help="duration of each noise without speech")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="parts to measure")
    parser.add_argument("--rooms", type=int, default=20, help="rooms in which a person interrupts the robot")
    parser.add_argument("--jobs", type=int, default=1, help="parallel processes for the rooms")
    options = parser.parse_args()
    if options.folder is not None or "recognition" in options.parts:
        recognition(options)
    if options.folder is None and "noise" in options.parts and options.minutes > 0:
        noise(options)
    if options.folder is None and "barge_in" in options.parts and options.rooms > 0:
        from evaluation.hearing_rooms import measured

        for row in measured(options.rooms, options.seed, options.jobs):
            print(row, flush=True)


def recognition(options: argparse.Namespace) -> None:
    """Print word error rates and delays."""
    listener = Listener({"model": options.model, "languages": options.languages})
    scenery = Scenery(options.seed)
    if options.folder is not None:
        sentences = list(folder_sentences(options.folder))
    else:
        sentences = [Sentence(voice, text, speak(voice, text)) for voice in options.voices for text in SENTENCES]
    print(f"{len(sentences)} sentences, model {options.model}")
    print(f"{'':30} {'WER':>6} {'unheard':>8} {'p50 s':>7} {'p95 s':>7}")
    total = Score()
    for ratio in options.ratios:
        for noise in options.noise if math.isfinite(ratio) else ["no noise"]:
            by_voice: dict[str, Score] = {}
            for sentence in sentences:
                score = listener.score(sentence, scenery, noise, ratio, echo=options.folder is None)
                by_voice.setdefault(sentence.voice, Score()).add(score)
            every = Score()
            for voice, score in by_voice.items():
                every.add(score)
                print(line(f"{noise} {ratio:g} dB, {voice}", score), flush=True)
            print(line(f"{noise} {ratio:g} dB, all", every), flush=True)
            total.add(every)
    print(line("all", total))


def noise(options: argparse.Namespace) -> None:
    """Print how much of noise is taken for speech."""
    listener, scenery = Listener({"model": options.model, "languages": options.languages}), Scenery(options.seed)
    for kind in ("white", "pink", "hum", "knocks"):
        voices, texts = false_activations(listener, scenery, kind, options.minutes)
        hours = math.ceil(options.minutes) / 60
        print(f"{kind:10} {voices / hours:6.1f} voices an hour, {texts / hours:6.1f} texts an hour", flush=True)


if __name__ == "__main__":
    main()
