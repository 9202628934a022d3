"""Measure how many heads of labelled people `socialbot bag redact` blurs: ``python -m evaluation.privacy BAG...``.

A head is the upper part of a person's box in the ground truth. It counts if it may be recognised: at least
`LEAST_HEAD_PX` high, and at least `LEAST_VISIBLE` of the person visible. It is blurred if the regions cover it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialbot.bags.reader import open_bag
from socialbot.runtime.redaction import PeopleBlurrer
from socialbot.vision.annotate import regions_of
from socialbot.vision.metrics.truth import load_truth, truth_beside

LEAST_HEAD_PX = 8.0
LEAST_VISIBLE = 0.3
COVERED = 0.9
"""Share of the area of a head that the regions cover."""
_HEAD = 0.13  # Height of a head: share of the height of a person. Its width is three quarters of that.


@dataclass(frozen=True)
class Coverage:
    """Numbers of recognisable heads of a bag, of those that are blurred, and of blurred pixels per pixel."""

    heads: int
    blurred: int
    area: float

    @property
    def share(self) -> float:
        return self.blurred / self.heads if self.heads else 1.0


def covered(path: Path) -> Coverage:
    """Search the people of a bag as `redact` does, and compare with the ground truth."""
    truth = load_truth(truth_beside(path))
    persons = {frame.stamp: frame.persons for frame in truth.frames}
    heads = blurred = 0
    areas = []
    with open_bag(path) as bag:
        topic = bag.choose_image_topic(truth.image_topic).name
        blurrer = PeopleBlurrer(bag, [topic], False)
        for place in bag.locations(topic):
            message = bag.message_at(place)
            if message is None or place.stamp not in persons:
                continue
            width, height = _size(message)
            mask = np.zeros((height, width), bool)
            for x, y, w, h in regions_of(blurrer.boxes_at(topic, place.time), whole=False):
                mask[max(0, int(y)) : max(0, int(np.ceil(y + h))), max(0, int(x)) : max(0, int(np.ceil(x + w)))] = True
            areas.append(mask.mean())
            for person in persons[place.stamp]:
                tall = _HEAD * person.h
                if tall < LEAST_HEAD_PX or person.visible < LEAST_VISIBLE:
                    continue
                wide, left = 0.75 * tall, person.x + person.w / 2 - 0.375 * tall
                top, right = max(0, int(person.y)), min(width, int(left + wide))
                head = mask[top : int(person.y + tall), max(0, int(left)) : right]
                if head.size:
                    heads += 1
                    blurred += bool(head.mean() >= COVERED)
    return Coverage(heads, blurred, float(np.mean(areas)) if areas else 0.0)


def _size(message: object) -> tuple[int, int]:
    from socialbot.core.messages import CompressedImage, Image
    from socialbot.vision.images import bgr_from_compressed, bgr_from_image

    assert isinstance(message, CompressedImage | Image)
    pixels = bgr_from_compressed(message) if isinstance(message, CompressedImage) else bgr_from_image(message)
    return pixels.shape[1], pixels.shape[0]


def main() -> None:
    """Print the shares of the bags on the command line."""
    parser = argparse.ArgumentParser(description="Measure how many heads of labelled people are blurred.")
    parser.add_argument("bags", nargs="+", type=Path)
    total = Coverage(0, 0, 0.0)
    for path in parser.parse_args().bags:
        found = covered(path)
        total = Coverage(total.heads + found.heads, total.blurred + found.blurred, 0.0)
        print(
            f"{path.name:20} {found.blurred:5} of {found.heads:5} heads, {found.share:7.2%}; {found.area:.0%} of pixels"
        )
    print(f"{'all':20} {total.blurred:5} of {total.heads:5} heads, {total.share:7.2%}")


if __name__ == "__main__":
    main()
