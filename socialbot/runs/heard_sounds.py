"""Sounds of heard speech, cut from the sound of a bag for the page of a run."""

from __future__ import annotations

import re
import wave
from pathlib import Path

import numpy as np

from socialbot.bags.reader import Bag
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import MessageError, RunError
from socialbot.core.messages import AudioData
from socialbot.core.paths import writing
from socialbot.runs.folder import open_run
from socialbot.runs.record import SOUNDS
from socialbot.speech.audio import samples_of

SOUND_TOPIC = "/audio"
_NAME = re.compile(r"[\w-]+\.wav")
MARGIN_S = 0.2
"""Time before and after each sentence that is kept."""


def heard_sound(record_id: str) -> str:
    """Name of the sound file of a record of heard speech."""
    return f"{record_id}.wav"


def write_heard(bag: Bag, folder: Path) -> int:
    """Write the sound of each heard sentence of the run in ``folder``; return their number.

    Sound that no node can hear is left out, and so is a record whose id is no name of a file.

    Raises:
        BagError: The bag is damaged.
        OSError: The disk is full.
    """
    if SOUND_TOPIC not in {topic.name for topic in bag.topics}:
        return 0
    records = [record for record in open_run(folder).history if record.kind == "hearing"]
    heard = [record for record in records if _NAME.fullmatch(heard_sound(record.id))]
    margin = nanoseconds(MARGIN_S)
    spans = {each.id: (int(each.detail.get("start", each.stamp)) - margin, each.stamp + margin) for each in heard}
    pieces: dict[str, list[np.ndarray]] = {}
    rates: dict[str, int] = {}
    for _, message in bag.messages({SOUND_TOPIC: SOUND_TOPIC}) if spans else ():
        if not isinstance(message, AudioData):
            continue
        try:
            samples = samples_of(message)[:, 0]
        except MessageError:  # its node has counted it
            continue
        end = message.stamp + len(samples) * SECOND // message.sample_rate
        for record_id, (begin, until) in spans.items():
            if message.stamp < until and end > begin:
                first = max(begin - message.stamp, 0) * message.sample_rate // SECOND
                last = (until - message.stamp) * message.sample_rate // SECOND
                pieces.setdefault(record_id, []).append(samples[first:last])
                rates[record_id] = message.sample_rate
    if pieces:
        with writing(folder / SOUNDS, RunError):
            (folder / SOUNDS).mkdir(exist_ok=True)
    for record_id, parts in pieces.items():
        path = folder / SOUNDS / heard_sound(record_id)
        with writing(path, RunError), wave.open(str(path), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(rates[record_id])
            file.writeframes(np.concatenate(parts).astype("<i2").tobytes())
    return len(pieces)
