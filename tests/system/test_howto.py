"""The how-to pages, followed word by word in an empty folder."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.messages import CompressedImage
from socialbot.vision.images import bgr_from_compressed
from tests.system.following import DOCS, Terminal, blocks, follow, has_its_place

PAGES = sorted(f"howto/{page.name}" for page in (DOCS / "howto").glob("*.md"))
VIDEO_S = (12.0, 14.0)


def film(bag: Path, out: Path) -> None:
    """A part of a bag as a video, every third picture of it."""
    writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (640, 480))
    begin_s, end_s = VIDEO_S
    with open_bag(bag) as source:
        topics = {topic.name: topic.name for topic in source.image_topics}
        for number, (_, message) in enumerate(source.messages(topics)):
            seconds = (message.stamp - source.start) / 1e9
            if isinstance(message, CompressedImage) and begin_s <= seconds < end_s and number % 3 == 0:
                writer.write(bgr_from_compressed(message))
    writer.release()


def test_all_pages_are_there() -> None:
    assert [Path(page).stem for page in PAGES] == ["agentspeak", "cameras", "detectors", "planners", "voices"]


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_a_file_a_command_or_what_that_prints(page: str) -> None:
    told = blocks(page)
    for before, block in zip([None, *told], told, strict=False):
        assert has_its_place(block, before), block.text


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_what_it_shows_is_so(page: str, corridor: Path, tmp_path: Path) -> None:
    if page == "howto/cameras.md":
        film(corridor, tmp_path / "visit.avi")
    if page == "howto/planners.md":
        pytest.importorskip("kairos", reason="kairos-planner is not installed")
    assert follow(blocks(page), Terminal(tmp_path)) > 0
