"""Measure the time to the first sound of voices: ``python -m evaluation.voices [VOICE...]``.

Each voice says the sentences of the reception in English. A time is processor time, so that it does not depend on the
load of the machine: for the first part of a sentence, and for a second of sound.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources

from evaluation.report import percentile
from socialbot.agents.dialogue import Script, load_script
from socialbot.agents.reception import load_building
from socialbot.agents.waldo import small_talk
from socialbot.speech.neural import PiperVoice, open_voice
from socialbot.speech.synthesis import Sound, Synthesizer

VOICES = ("en", "piper:joe")


@dataclass(frozen=True)
class Timing:
    """Processor time (s) of the first parts, sorted, and per second of sound."""

    first_s: tuple[float, ...]
    per_second: float


def sentences() -> list[str]:
    """Return the English sentences of the reception."""
    folder = resources.files("socialbot.agents.reception")
    building = load_building("building.yaml", folder.joinpath("building.yaml").read_text("utf-8"))
    base = Script(values={"room": building.rooms, "colleague": building.people}, base=small_talk())
    script = load_script("reception.yaml", folder.joinpath("reception.yaml").read_text("utf-8"), base)
    script |= building.script()
    return [script.sentence(name, ("Anna Miller", "18:00"), "en")[0] for name in script.sentences]


def measure(voice: Synthesizer | PiperVoice, texts: Sequence[str]) -> Timing:
    """Let a voice say the texts, each once."""
    voice.say("Ready.")
    first, spent_s, sound_s = [], 0.0, 0.0
    for text in texts:
        begin = time.process_time()
        for number, part in enumerate(_parts(voice, text)):
            if not number:
                first.append(time.process_time() - begin)
            sound_s += part.duration_s
        spent_s += time.process_time() - begin
    return Timing(tuple(sorted(first)), spent_s / sound_s)


def _parts(voice: Synthesizer | PiperVoice, text: str) -> Iterator[Sound]:
    return voice.parts(text) if isinstance(voice, PiperVoice) else iter([voice.say(text)])


def main() -> None:
    """Print a table of the voices."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("voices", nargs="*", default=VOICES, help="values of the parameter 'voice' of the speaker")
    texts = sentences()
    print(f"{len(texts)} sentences; processor time in s")
    print(f"{'voice':24} {'first p50':>9} {'p95':>6} {'most':>6} {'per s of sound':>15}")
    for name in parser.parse_args().voices:
        found = measure(open_voice(name), texts)
        p50, p95, most = (percentile(found.first_s, share) or 0.0 for share in (0.5, 0.95, 1.0))
        print(f"{name:24} {p50:9.3f} {p95:6.3f} {most:6.3f} {found.per_second:15.3f}")


if __name__ == "__main__":
    main()
