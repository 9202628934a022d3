"""Make the bag of ``socialbot demo reception``: ``python -m tools.reception_bag [FOLDER]``.

The pictures are those of the bag ``corridor``, smaller and fewer. The part in which the visitor stands goes to and fro,
so that the visitor stays for a conversation. The visitor speaks with a voice of espeak-ng. The sentences are also in
the bag as recognized speech, for installations without speech recognition.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from socialbot.bags.reader import open_bag
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import AudioData, CameraInfo, CompressedImage, HeardSpeech, Message
from socialbot.speech.synthesis import Synthesizer

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "data" / "synthetic" / "corridor"
TARGET = ROOT / "socialbot" / "agents" / "reception" / "bag"
IMAGES, INFO, AUDIO, SPEECH = (
    "/camera/image_raw/compressed", "/camera/camera_info", "/audio", "/humans/voices/speech",
)  # fmt: skip

START = 1_700_560_800 * SECOND  # Tuesday 2023-11-21, 10:00 UTC
SECONDS = 46.0
EVERY = 2  # of ten pictures a second
SIZE, QUALITY = (320, 240), 55
STANDS, LEAVES = (12.5, 21.5), (21.5, 31.5)
"""Parts of the source, in s: the visitor stands, and leaves; before it, the visitor comes."""
COMES, LEFT_AT = 5.0, 37.0
"""Beginning in the source, and time in the bag at which the visitor leaves, in s."""

VOICE, RATE_WPM, RATE_HZ, CHUNK_S = "en-us+f3", 150, 16000, 0.2
SILENCE_S = 0.5
"""Silence after which speech is recognized, as that of the node `hearing`."""
SENTENCES = (
    (16.0, "Yes, please. Where is the library?"),
    (24.5, "Why did you greet me?"),
    (34.0, "Thank you very much."),
)
"""What the visitor says, and when, in s."""


def pictures() -> Iterator[int]:
    """Yield the number of the picture of the source for each picture of the bag."""
    stands = range(round(STANDS[0] * 10), round(STANDS[1] * 10), EVERY)
    there_and_back = itertools.cycle([*stands, *reversed(stands[1:-1])])
    number = round(COMES * 10)
    while number < stands[0]:
        yield number
        number += EVERY
    count = round(LEFT_AT * 10 / EVERY) - (stands[0] - round(COMES * 10)) // EVERY
    yield from itertools.islice(there_and_back, count)
    yield from range(round(LEAVES[0] * 10), round(LEAVES[1] * 10), EVERY)


def sound(text: str) -> np.ndarray:
    """Return a sentence of the visitor as int16 at `RATE_HZ`."""
    spoken = Synthesizer(VOICE, RATE_WPM).say(text)
    times = np.arange(0, spoken.duration_s, 1 / RATE_HZ)
    known = np.arange(spoken.samples.size) / spoken.sample_rate
    # A moving average over a sample of the slower rate keeps out what it cannot represent.
    width = max(round(spoken.sample_rate / RATE_HZ), 1)
    smooth = np.convolve(spoken.samples.astype(float), np.ones(width) / width, "same")
    return np.rint(0.8 * np.interp(times, known, smooth)).astype(np.int16)


def messages() -> Iterator[tuple[str, Message]]:
    """Yield the topic and message of all messages."""
    with open_bag(SOURCE) as bag:
        frames = [message for _, message in bag.messages({IMAGES: IMAGES}) if isinstance(message, CompressedImage)]
        info = next(message for _, message in bag.messages({INFO: INFO}) if isinstance(message, CameraInfo))
    scale = SIZE[0] / info.width
    k = tuple(value if value == 1 else value * scale for value in info.k)
    small = CameraInfo(stamp=START, frame_id=info.frame_id, width=SIZE[0], height=SIZE[1], k=k, d=info.d)
    yield INFO, small
    step = EVERY * SECOND // 10
    for at, number in enumerate(itertools.islice(pictures(), round(SECONDS * 10 / EVERY))):
        image = cv2.imdecode(frames[number].data, cv2.IMREAD_COLOR)
        image = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
        jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].reshape(-1)
        yield IMAGES, CompressedImage(stamp=START + at * step, frame_id=info.frame_id, format="jpeg", data=jpeg)
    heard = np.zeros(round(SECONDS * RATE_HZ), np.int16)
    for at_s, text in SENTENCES:
        samples, begin = sound(text), round(at_s * RATE_HZ)
        heard[begin : begin + samples.size] = samples
        start = START + nanoseconds(at_s)
        end = start + nanoseconds(samples.size / RATE_HZ)
        yield SPEECH, HeardSpeech(stamp=end, start=start, text=text, language="en", confidence=1.0, voice="visitor")
    size = round(CHUNK_S * RATE_HZ)
    for begin in range(0, heard.size, size):
        piece = heard[begin : begin + size].astype("<i2").tobytes()
        stamp = START + nanoseconds(begin / RATE_HZ)
        yield AUDIO, AudioData(stamp=stamp, samples=piece, sample_rate=RATE_HZ)


def arrival(message: Message) -> int:
    """Time (ns) at which a message was received: sound at the end of its samples, speech after a silence."""
    if isinstance(message, HeardSpeech):
        return message.stamp + nanoseconds(SILENCE_S)
    if isinstance(message, AudioData):
        return message.stamp + len(message.samples) // 2 * SECOND // message.sample_rate
    return message.stamp


def main() -> None:
    """Write the bag."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=TARGET)
    folder = parser.parse_args().folder
    shutil.rmtree(folder, ignore_errors=True)
    with BagWriter(folder, compressed=True) as bag:
        for topic, message in sorted(messages(), key=lambda entry: (arrival(entry[1]), entry[0])):
            bag.write(topic, message, arrival(message))
    print(*(f"{file.name}: {file.stat().st_size / 1e6:.2f} MB" for file in sorted(folder.iterdir())), sep="\n")


if __name__ == "__main__":
    main()
