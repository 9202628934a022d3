from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from socialbot.bags.writer import STORAGES, BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import Utterance

SAY, ECHO = "/speech/say", "/speech/echo"


def say(bag: BagWriter, topic: str, number: int) -> None:
    bag.write(topic, Utterance(stamp=number, id=f"u{number}", text="hello"), number * SECOND)


@pytest.mark.parametrize("storage", STORAGES)
def test_what_was_flushed_is_there_although_the_bag_is_not_closed(tmp_path: Path, storage: str) -> None:
    with BagWriter(tmp_path / "bag", storage=storage) as bag:
        bag.flush()
        for number in (1, 2, 3):
            say(bag, SAY, number)
        bag.flush()
        bag.flush()
        say(bag, ECHO, 4)
        bag.flush()
        say(bag, SAY, 5)
        shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    with open_bag(tmp_path / "killed") as killed:
        found = [(topic, at) for topic, at, *_ in killed.raw_messages({SAY: SAY, ECHO: ECHO})]
    assert found == [(SAY, SECOND), (SAY, 2 * SECOND), (SAY, 3 * SECOND), (ECHO, 4 * SECOND)]
    with open_bag(tmp_path / "bag") as whole:
        assert not whole.damage
        assert {topic.name: topic.count for topic in whole.topics} == {SAY: 4, ECHO: 1}
