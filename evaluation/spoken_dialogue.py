"""Measure how well a reception understands speech: ``python -m evaluation.spoken_dialogue``.

Synthetic voices say the sentences of spoken_dialogue.yaml into WAV files. The nodes microphone, hearing and
receptionist run in simulated time with the real networks. Each sentence is typed, too. A sentence that is lost only
when it is spoken is counted by where it was lost.
"""

from __future__ import annotations

import math
import re
import tempfile
import wave
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer
from ruamel.yaml import YAML

from evaluation.hearing import LEVEL, Scenery, speak, words
from evaluation.report import JsonOption, QuickOption, Report, Value, run
from socialbot.agents.reception import Receptionist, demo
from socialbot.agents.waldo import Listener
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import HeardSpeech, PersonDetection, PersonDetections
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.audio import RATE_HZ
from socialbot.speech.hearing import Hearing
from socialbot.speech.microphone import Microphone
from socialbot.speech.recognition import SpeechRecognizer
from socialbot.speech.speaker import Speaker
from socialbot.testing import GraphTester

SENTENCES = Path(__file__).with_name("spoken_dialogue.yaml")
LOST = 0.1
"""Greatest share of the sentences that may be lost."""

_DETECTIONS, _SPEECH, _ACTIVITY = "/humans/bodies/detections", "/humans/voices/speech", "/humans/voices/activity"
_PERSON = "t1"
_TUESDAY_10 = 1_700_560_800 * SECOND
_SAID_S = 6.0  # After the greeting, before the offer.
_REPLY_S = 0.2  # From the end of a question to the reply, as between people.
_AFTER_S = 3.0
_POSED_S = 15.0
_PROMPTS = {"shall_i_call": "Could you call Anna Miller?", "which_room": "Where is the swimming pool?"}
"""What makes the robot ask a question; it offers help on its own."""


@dataclass(frozen=True)
class Condition:
    """How a sentence is said: the voice, its level (dB, of the usual one), and noise so many dB weaker than it."""

    name: str
    voice: str
    level_db: float = 0.0
    noise: str = ""
    ratio_db: float = math.inf
    echo: bool = False


CONDITIONS = (
    Condition("natural voice, quiet", "piper:joe"),
    Condition("natural voice, room, babble 10 dB", "piper:joe", noise="babble", ratio_db=10.0, echo=True),
    Condition("British espeak voice, room, pink noise 20 dB", "en-gb-x-rp", noise="pink", ratio_db=20.0, echo=True),
    Condition("female espeak voice, 24 dB softer, pink noise 20 dB", "en-us+f3", -24.0, "pink", 20.0),
)


@dataclass(frozen=True)
class Sentence:
    """A sentence, the question of the robot to which it replies, and the intents with slots that are right."""

    text: str
    question: str
    wanted: tuple[tuple[str, ...], ...]

    @classmethod
    def read(cls, line: str) -> Sentence:
        said, _, wanted = line.rpartition(" -> ")
        found = re.fullmatch(r"(?:\((\w+)\) )?(.+)", said)
        assert found is not None
        return cls(found[2], found[1] or "", tuple(tuple(each.split()) for each in wanted.split(" | ")))

    def allows(self, heard: tuple[str, ...]) -> bool:
        """Return whether an intent with its slots is right; a wanted intent without slots takes any."""
        return any(heard[: len(each)] == each for each in self.wanted)


@dataclass(frozen=True)
class Outcome:
    """What became of a sentence: its intents with slots, the recognised texts, and the number of voices."""

    heard: tuple[tuple[str, ...], ...]
    texts: tuple[str, ...]
    voices: int
    answered: bool
    """Whether a question about the robot got an answer other than "I don't know"."""


class KeptHearing(Hearing):
    """Hearing whose recogniser is loaded once."""

    _kept: ClassVar[dict[tuple[str, str], SpeechRecognizer]] = {}

    def find_recognizer(self) -> SpeechRecognizer:
        key = self.model, self.vocabulary
        if key not in self._kept:
            self._kept[key] = super().find_recognizer()
        return self._kept[key]


class Reception(GraphTester):
    """The reception of the demo with one visitor; with ``sound``, a microphone plays this WAV file."""

    def __init__(self, sound: Path | None = None) -> None:
        nodes = [
            NodeConfig("bdi_engine", Receptionist, {}),
            NodeConfig("listener", Listener, {}),
            NodeConfig("speech", Speaker, {"playback": "off"}),
        ]
        inputs = {_DETECTIONS, _SPEECH}
        if sound is not None:
            ear = next(node for node in demo.hearing(load_graph("reception")).nodes if node.type is Hearing)
            nodes += [NodeConfig("microphone", Microphone, {"source": str(sound)}), replace(ear, type=KeptHearing)]
            inputs -= {_SPEECH}
        super().__init__(Graph("reception", tuple(nodes), inputs=frozenset(inputs)), start=_TUESDAY_10)

    def __enter__(self) -> Reception:
        super().__enter__()
        return self

    def see(self, seconds: float) -> None:
        """Let time pass with the visitor in view."""
        visitor = PersonDetection(x=0, y=0, w=10, h=30, score=1.0, track_id=_PERSON, distance_m=2.0)
        for _ in range(round(seconds * 10)):
            stamp = self.clock.now()
            seen = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=(visitor,))
            self.send(_DETECTIONS, seen)
            self.runner.advance(stamp + nanoseconds(0.1))

    def type(self, text: str) -> None:
        """Let the visitor say a text that is recognised without a mistake."""
        now = self.clock.now()
        speech = HeardSpeech(stamp=now, start=now - SECOND, text=text, language="en", confidence=1.0, person=_PERSON)
        self.send(_SPEECH, speech)

    def pose(self, question: str) -> None:
        """Let time pass until the robot has asked a question, or until `_SAID_S` if it is empty."""
        if question in _PROMPTS:
            self.see(3.0)
            self.type(_PROMPTS[question])
        if not question:
            self.see(_SAID_S)
            return
        end = self.seconds + _POSED_S
        while not self._posed(question) and self.seconds < end:  # Noise that is taken for speech may prevent it.
            self.see(0.1)

    def _posed(self, question: str) -> bool:
        told = [each for each in self.messages("/waldo/trace") if f'tell("{question}"' in each.what]
        return bool(told) and self.messages("/speech/status")[-1].state == "finished"

    def outcome(self, begin: int) -> Outcome:
        """Return how the sentence that was said from a time (ns) on was heard and read."""
        trace = [each for each in self.messages("/waldo/trace") if each.stamp >= begin]
        heard = [
            re.findall(r'"([^"]*)"', each.what)[1:]
            for each in trace
            if each.what.startswith("heard(") and each.kind == "belief"
        ]
        is_spoken = "hearing" in self.runner.nodes
        voices = {each.voice for each in self.messages(_ACTIVITY) if each.active} if is_spoken else set()
        return Outcome(
            tuple(map(tuple, heard)),
            tuple(each.text for each in self.messages(_SPEECH) if each.stamp >= begin),
            len(voices),
            all(each.detail["known"] for each in trace if each.kind == "answer"),
        )


@cache
def question_ends(question: str) -> float:
    """Return the time (s) at which the robot has asked a question, or at which a sentence without one is said."""
    with Reception() as reception:
        reception.pose(question)
        return (reception.clock.now() - _TUESDAY_10) / SECOND


def typed(sentence: Sentence) -> Outcome:
    """Return what becomes of a sentence that is recognised without a mistake."""
    with Reception() as reception:
        reception.pose(sentence.question)
        begin = reception.clock.now()
        reception.type(sentence.text)
        reception.see(_AFTER_S)
        return reception.outcome(begin)


def spoken(sentence: Sentence, condition: Condition, scenery: Scenery, folder: Path) -> Outcome:
    """Return what becomes of a sentence that is said into a microphone."""
    samples = speak(condition.voice, sentence.text).astype(float)
    level = LEVEL * 10 ** (condition.level_db / 20)
    samples *= level / np.sqrt(np.mean(samples**2))
    begin_s = question_ends(sentence.question) + (_REPLY_S if sentence.question else 0.0)
    wet = scenery.echo(samples) if condition.echo else samples
    silence = np.zeros(round(_AFTER_S * RATE_HZ))
    sound = np.concatenate([np.zeros(round(begin_s * RATE_HZ)), wet, silence])
    if condition.noise:
        sound = sound + level * 10 ** (-condition.ratio_db / 20) * scenery.noise(condition.noise, sound.size)
    file = folder / "said.wav"
    with wave.open(str(file), "wb") as writer:
        writer.setparams((1, 2, RATE_HZ, sound.size, "NONE", ""))
        writer.writeframes(np.clip(np.rint(sound), -32768, 32767).astype("<i2").tobytes())
    with Reception(file) as reception:
        reception.pose(sentence.question)
        begin = reception.clock.now()
        reception.see(_REPLY_S + samples.size / RATE_HZ + _AFTER_S - 0.5)
        return reception.outcome(begin)


def lost_where(sentence: Sentence, text: Outcome, voice: Outcome) -> str:
    """Return where a sentence was lost, or "" if it was understood."""
    if voice.heard and sentence.allows(voice.heard[-1]):
        return ""
    if not (text.heard and sentence.allows(text.heard[-1])):
        return "not understood when typed"
    if not voice.voices:
        return "not detected"
    if len(voice.texts) != 1:
        return "split" if voice.texts else "detected, but no text"
    expected, found = words(sentence.text), words(voice.texts[0])
    if expected == found:
        return "spelling, punctuation"
    if found in (expected[: len(found)], expected[len(expected) - len(found) :]):
        return "cut"
    return "misrecognised"


def dialogue(
    quick: QuickOption = False,
    only: Annotated[
        list[str] | None, typer.Option("--part", metavar="LIST", help="A list of spoken_dialogue.yaml; by default all.")
    ] = None,
    text_only: Annotated[bool, typer.Option("--typed", help="Only type the sentences.")] = False,
    json: JsonOption = None,
) -> None:
    """Say and type sentences to a reception, and count which are understood."""
    lists: Mapping[str, list[str]] = YAML(typ="safe").load(SENTENCES.read_text("utf-8"))
    if unknown := set(only or ()) - set(lists):
        raise ParameterError(f"there is no list {sorted(unknown)[0]!r}", remedy=f"give one of {', '.join(lists)}")
    report = Report("Spoken dialogue", quick)
    for name in only or lists:
        sentences = [Sentence.read(each) for each in (lists[name][::8] if quick else lists[name])]
        texts = [typed(each) for each in sentences]
        right = [bool(text.heard) and each.allows(text.heard[-1]) for each, text in zip(sentences, texts, strict=True)]
        report.add(f"typed_{name}", f"{name}: typed sentences that are lost (share)", _share(right), LOST)
        for each, text, ok in zip(sentences, texts, right, strict=True):
            if not ok or not text.answered:
                typer.echo(f"{name}, typed: {_line(each, text)}")
        if not text_only:
            _say(report, name, sentences, texts)
    report.finish(json)
    if report.unmet:
        raise typer.Exit(1)


def _say(report: Report, name: str, sentences: list[Sentence], texts: list[Outcome]) -> None:
    rows: dict[str, dict[str, Value]] = {}
    scenery = Scenery(1)
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
        for number, condition in enumerate(CONDITIONS, 1):
            lost: Counter[str] = Counter()
            for sentence, text in zip(sentences, texts, strict=True):
                voice = spoken(sentence, condition, scenery, Path(folder))
                where = lost_where(sentence, text, voice)
                lost[where] += 1
                if where:
                    typer.echo(f"{name}, {condition.name}, {where}: {_line(sentence, voice)}")
            share = round(1 - lost.pop("", 0) / len(sentences), 3)
            report.add(f"spoken_{name}_{number}", f"{name}: {condition.name}: lost (share)", share, LOST)
            rows[condition.name] = dict(lost)
    report.tables[f"{name}: lost"] = rows


def _share(right: list[bool]) -> float:
    return round(1 - sum(right) / len(right), 3)


def _line(sentence: Sentence, outcome: Outcome) -> str:
    heard = "; ".join(" ".join(each) for each in outcome.heard) or "nothing"
    texts = "" if outcome.texts in ((), (sentence.text,)) else f" (heard: {' | '.join(outcome.texts)})"
    unknown = "" if outcome.answered else ", not known"
    return f"{sentence.text}{texts}: {heard}{unknown}"


if __name__ == "__main__":
    run(dialogue)
